"""Checks: what must be read with a verdict, each a function of the evidence that gives its remarks or none.

A new check is one function here or in a file of its own, one row of `CHECKS`, and one test with its null.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from accelcal.data import (
    ACCELERATION,
    DERIVED,
    STANDARD_GRAVITY,
    Array,
    ChannelFilter,
    LowPass,
    Recording,
    Rig,
    instant,
    median_step,
    runs_of,
    usual_step,
    white_variance,
    within_spans,
)
from accelcal.diagnosis.evidence import DELAY_CLASS, Evidence, noise_ratio
from accelcal.diagnosis.findings import FILTER_KEYS
from accelcal.diagnosis.left_out import cut_without
from accelcal.diagnosis.noise.noise_test import LINE
from accelcal.diagnosis.policy import (
    COHERENCE_LEAST_SHARE,
    DATA_SHEET_NOISE_RATIO,
    DISTURBED_SECONDS,
    DISTURBED_SHARE,
    DISTURBED_STRETCHES,
    DRIFT_BAND,
    ENGINES_APART,
    FAMILYWISE_ALPHA,
    RESONANCE_SPREAD,
    TRANSVERSE_ALPHA,
    TURNING_BAND,
    TURNING_LEAST_PERIODS,
    TURNING_MOST_DEGREES,
    UNDECLARED_BIAS_INSTABILITY,
    UNRESOLVED_MOST_SHARE,
)
from accelcal.diagnosis.runs import runs_disagree
from accelcal.diagnosis.search.confounding import DetectedEffect, with_members
from accelcal.diagnosis.search.homogeneity import OF_FREQUENCY
from accelcal.effects import BUILT_IN, OF_TIME, find
from accelcal.estimation.estimate import Fit, most_noise, result, solve_runs
from accelcal.estimation.plausible import implausible_scale
from accelcal.estimation.remarks import Remark, Value, remark
from accelcal.estimation.run import PreparedRun, prepared
from accelcal.io.write import filter_entries
from accelcal.model import Model
from accelcal.signals.processing import ORDER, low_pass, memory, spectral_density
from accelcal.signals.series import widened
from accelcal.validation.comparison import Evaluation
from accelcal.validation.evaluation import AVERAGED_SEGMENTS, compare, residual_of
from accelcal.validation.prediction import DrivenRun

PROCESSES = frozenset(effect.name for effect in BUILT_IN if effect.port == "process")
RESONANCE = find("sensor_resonance").name
RESONANCE_STEPS = 8
"""Fits until the coefficients of a resonance stay."""
RESONANCE_FIRST = 1.15
"""Least ratio by which the first declared one lowers the noise density."""
RESONANCE_LOWER = 1.005
"""Ratio by which the frequency of the least noise has to lower the noise density to be the one that is said."""
RELAXED = 0.75
"""Share of what a fit says of a declared resonance that is taken over: with all of it the steps alternate."""
FOLLOW_TIME = PROCESSES | {LINE, *(name for name in OF_TIME if find(name).family)}
"""Effects that follow any function of time, the turning of a sensor and a touched cable among them."""
TILT = find("tilt").name
LAG = next(name for name, declared in FILTER_KEYS.items() if declared == ("accel", "lowpass"))
"""Effect that a low-pass of the output is."""
DRIFTS = OF_TIME | {name for name in PROCESSES if find(name).traits.changes == "bias"}
"""Drifts of the bias: what a slow tilt looks like, and does."""


def turning_sensor(e: Evidence) -> Iterator[Remark]:
    """Slow residual beyond the bias instability that a tilt can cause; not beside a scale factor that none has.

    Notes
    -----
    What counts is left by a model with every effect that was found, those excepted that follow any function of time: a
    bias that wanders follows a tilt as well. What a recorded channel explains is no tilt. Where it lives in a few
    stretches they are named, unless such are left out already. Else a drift of the bias that explains it stands beside
    the tilt, if all of it is as slow as a bias drifts; where none does no name is certain. No null: the limit
    is the declared bias instability, noise subtracted (tests/diagnosis/test_turning.py).
    """
    model, scan, recording = e.model, e.scan.detected, e.recording
    if e.forbidden or not e.scan.enough or gravity_is_recorded(recording):
        return
    slow = SlowResidual.of(recording, e.where.accel_residual, e.where.band)
    following = [n for n in model.effects if n in FOLLOW_TIME and n in e.sizes and e.sizes[n].value > slow.ordinary]
    if not following and slow.rms <= slow.ordinary:
        return
    begin, end = float(e.runs[0].t[0]), float(e.runs[0].t[-1])

    def left_by(reference: Model, entering: Sequence[DetectedEffect], span: tuple[float, float]) -> SlowResidual:
        for finding in entering:
            reference = finding.enter(reference)
        fitted = result(solve_runs(reference, e.sources, start=begin, end=end, others_whole=True))
        leaving = compare(fitted, e.sources[0], horizons=(), start=span[0], end=span[1])
        return SlowResidual.of(recording, leaving.accel_residual, leaving.band)

    certain = [finding for finding in scan if finding.effect not in FOLLOW_TIME]
    left = slow
    if certain or following:
        try:
            left = left_by(model.drop(*following) if following else model, certain, e.span)
        except ValueError:
            if following:
                return
    if left.rms <= left.ordinary:
        if slow.rms > slow.ordinary and any(finding.effect in DRIFTS for finding in scan):
            yield from slow.remark("tilt_or_drift")
        return
    if left.stretches and all(note.code != "disturbed" for note in e.stretch.remarks):
        yield left.apart(recording)
        return
    recorded = [find(name) for name in e.scan.detection_limits if name not in model.effects]
    for driven in (
        DetectedEffect(effect.name, {}, {}, "") for effect in recorded if effect.needs and not effect.shapes
    ):
        with suppress(ValueError):
            others = [finding for finding in certain if finding.effect != driven.effect]
            if left_by(model, [*others, driven], e.span).rms <= left.ordinary:
                return
    wandering = [finding for finding in scan if finding.effect in FOLLOW_TIME & DRIFTS]
    code = "turning_sensor"
    if left.faster <= left.ordinary and (wandering or (following and DRIFTS.issuperset(following))):
        try:  # a process says nothing of what lies beyond the fitted part
            explained = left_by(model, [*certain, *wandering], (begin, end))
            code = "tilt_or_drift" if explained.rms <= left.ordinary else code
        except ValueError:
            pass
    yield from left.remark(code)


def beside_tilt(detected: Sequence[DetectedEffect]) -> tuple[DetectedEffect, ...]:
    """Effects that were found, with a tilt in the class of each drift of the bias."""
    return tuple(
        replace(effect, weights=with_members(effect.weights, [TILT])) if effect.effect in DRIFTS else effect
        for effect in detected
    )


def slow_residual(fit: Fit, run: PreparedRun, *, stretches: bool = True) -> Iterator[Remark]:
    """Slow residual of a fit alone, beyond the bias instability and within what a tilt can cause; `stretches` says
    whether the few in which it lives are named."""
    recording = run.recording
    if gravity_is_recorded(recording):
        return
    try:
        ahead = DrivenRun.on(fit, run)
    except ValueError:
        return
    band = min(ahead.crossover, 0.2 / run.reading_step)
    t, residual, inside = residual_of(ahead, band)
    slow = SlowResidual.of(recording, (t[inside], residual[inside]), band)
    if slow.stretches and stretches:
        yield slow.apart(recording)
    else:
        yield from slow.remark("slow_residual")


def disturbance(evaluation: Evaluation, recording: Recording, place: str = "") -> Remark | None:
    """The remark on stretches of a recording that something disturbed, by the residual of a model that was not fitted
    to it; None where there are none."""
    slow = SlowResidual.of(recording, evaluation.accel_residual, evaluation.band)
    return slow.apart(recording, place) if slow.stretches and not gravity_is_recorded(recording) else None


@dataclass(frozen=True, slots=True)
class SlowResidual:
    """A residual up to the frequency of a turning sensor, as far as noise does not explain it."""

    rig: Rig
    rms: float
    """m/s²; 0 where the record is too short for one."""
    faster: float
    """The part of it that is faster than a bias drifts, m/s² rms."""
    band: float
    """Hz"""
    ordinary: float
    """Slow change of the bias that is ordinary for the sensor, rms, m/s²."""
    stretches: tuple[tuple[float, float], ...]
    """Begin and end of the few stretches in which it lives, s: without them it is ordinary."""

    @classmethod
    def of(cls, recording: Recording, residual_at: tuple[Array, Array], highest: float) -> SlowResidual:
        """The slow part of a residual: times (n,) s, residual (n,) m/s², and its bandwidth, Hz."""
        if (
            recording.reference is not None and not recording.rig.coupled
        ):  # the unknown state of a high-pass at the start
            behind = recording.accel.t[0] + 0.5 * memory(recording.rig.filters, 1.0 / usual_step(recording.accel.t))
            residual_at = tuple(y[residual_at[0] > behind] for y in residual_at)
        limit, floor = ordinary(recording.rig), output_noise(recording.rig, recording.accel.t, recording.accel.y)
        rms = excess(residual_at, highest, floor)
        if rms <= limit:
            return cls(recording.rig, rms, 0.0, min(TURNING_BAND, highest), limit, ())
        t, residual = residual_at
        drifting = low_pass(residual, 1.0 / median_step(t), DRIFT_BAND)
        faster, length = excess((t, residual - drifting), highest, floor), float(np.ptp(recording.accel.t))
        apart = disturbed(residual_at, highest, floor, limit, length)
        return cls(recording.rig, rms, faster, min(TURNING_BAND, highest), limit, apart)

    def remark(self, code: str) -> Iterator[Remark]:
        """The remark on a tilt that would explain it; none where it is ordinary, or no sensor tilts as much."""
        degrees = tilt(self.rms, self.rig)
        if self.rms > self.ordinary and degrees <= TURNING_MOST_DEGREES:
            yield remark(code, tilt_deg=degrees, rms=self.rms, band=self.band, bias_instability=self.ordinary)

    def apart(self, recording: Recording, place: str = "") -> Remark:
        """The remark on its stretches in a recording, with the command that cuts them out; `place` stands before its
        name."""
        pieces = [(instant(begin), instant(end)) for begin, end in self.stretches]
        values: dict[str, Value] = {
            "recording": f"{place}{recording.title}",
            "stretches": " ".join(f"{begin}:{end}" for begin, end in pieces),
            "between": " and ".join(f"between {begin} and {end} s" for begin, end in pieces),
            "rms": self.rms,
            "band": self.band,
            "bias_instability": self.ordinary,
            "cut": cut_without(recording, self.stretches),
        }
        return remark("disturbed", **values)


def stretches_of(disturbed: Remark) -> list[tuple[float, float]]:
    """Begin and end of the stretches that a remark names, s."""
    return [
        (float(begin), float(end))
        for begin, _, end in (piece.partition(":") for piece in str(disturbed.values["stretches"]).split())
    ]


def gravity_is_recorded(recording: Recording) -> bool:
    """Whether a channel says how the axis turns, or a reference on the same body feels gravity as the sensor does."""
    reference = recording.reference
    return any(name in recording.side for name in DERIVED) or (reference is not None and reference.name == ACCELERATION)


def ordinary(rig: Rig) -> float:
    """Slow change of the bias that is ordinary for a sensor, rms, m/s²."""
    return rig.sensor.bias_instability or UNDECLARED_BIAS_INSTABILITY


def excess(residual_at: tuple[Array, Array], highest: float, floor: float) -> float:
    """Slow residual beyond the noise, m/s² rms about its mean; 0 where the record is too short for one.

    Parameters
    ----------
    residual_at : times (n,) s and residual (n,) m/s².
    highest : its bandwidth, Hz.
    floor : one-sided noise density of the output, (m/s²)/sqrt(Hz).
    """
    t, residual = residual_at
    if len(t) < 16:
        return 0.0
    step, band = median_step(t), min(TURNING_BAND, highest)
    if len(t) * step * band < TURNING_LEAST_PERIODS:
        return 0.0
    length = scipy.fft.next_fast_len(len(residual), real=True)  # a prime length would cost 18 arrays
    spectrum = scipy.fft.rfft(residual - np.mean(residual), length)[: 1 + int(band * length * step)]
    slow = 2.0 * float(np.vdot(spectrum, spectrum).real) / (len(residual) * length)
    return math.sqrt(max(slow - DATA_SHEET_NOISE_RATIO**2 * floor**2 * band, 0.0))


def disturbed(
    residual_at: tuple[Array, Array], highest: float, floor: float, limit: float, length: float
) -> tuple[tuple[float, float], ...]:
    """Begin and end of the few stretches without which a slow residual is within `limit`, s; empty where it is spread
    over the record.

    Parameters
    ----------
    residual_at, highest, floor : as of `excess`.
    limit : m/s² rms.
    length : of the record, s; a residual lacks its ends.
    """
    t, residual = residual_at
    step, band = median_step(t), min(TURNING_BAND, highest)
    slow = low_pass(residual, 1.0 / step, band)
    slow = np.abs(slow - np.median(slow))
    usual = math.hypot(limit, DATA_SHEET_NOISE_RATIO * floor * math.sqrt(band))
    edges = runs_of(widened(slow > usual, math.ceil(0.5 / (band * step))))
    high = [(b, e) for b, e in edges.tolist() if np.max(slow[b:e]) > usual / math.sqrt(DISTURBED_SHARE)]
    rest = ~within_spans(high, len(t))
    lasting = max(usual, 0.1 * float(np.max(slow)))  # below it the low-pass spreads what is short
    seconds = np.count_nonzero((slow > lasting) & ~rest) * step
    longest = max(DISTURBED_SHARE * length, DISTURBED_SECONDS * len(high))
    few = len(high) <= DISTURBED_STRETCHES and seconds <= longest < 0.5 * length
    if not (few and high) or float(np.mean(slow[rest] ** 2)) > usual**2:
        return ()
    tail = 0.5 / band  # what is below the limit there still adds up to a jump of the position over the hole
    return tuple((float(t[begin]) - tail, float(t[end - 1]) + tail) for begin, end in high)


def output_noise(rig: Rig, t: Array, y: Array) -> float:
    """One-sided white density of the output, (m/s²)/sqrt(Hz): declared, or from third differences if they show more."""
    return max(math.sqrt(2.0 * white_variance(y) * median_step(t)), rig.sensor.noise or 0.0)


def tilt(rms: float, rig: Rig) -> float:
    """Turning about the mean attitude that changes gravity along the input axis by `rms`, degrees rms; 90 where none
    does.

    On a level axis gravity enters by the sine of the angle, along a vertical one by the cosine.
    """
    share = min(rms / STANDARD_GRAVITY, 1.0)
    vertical = abs(rig.gravity) > math.sqrt(0.5) * STANDARD_GRAVITY
    return math.degrees(math.acos(1.0 - share) if vertical else math.asin(share))


OVERLAP, WINDOW = 1.22, 1.5
"""Segments and bins, over independent ones, of half overlapping Hann windows."""
BANDS_PER_OCTAVE = 2
FASTEST = 0.4
"""Highest frequency of a channel, over its sampling rate."""


@dataclass(frozen=True, slots=True)
class CoherentBand:
    """One band of a side channel."""

    channel: str
    low: float
    """Hz"""
    high: float
    coherence: float
    """Of residual and channel, without what both share with the motion; squared magnitude."""
    sensitivity: float
    """Residual per unit of the channel."""
    p_value: float


def transverse_coherence(e: Evidence) -> Iterator[Remark]:
    """Side channels with which the residual is coherent; at most one remark for each, over its whole band.

    A channel that an effect needs which was found is left out until the model has it.

    Notes
    -----
    Partial coherence given the acceleration. Without any, its square exceeds x with probability (1 - x)^(K - 2) for K
    independent averages (Goodman 1957), times the number of bands of all channels (`TRANSVERSE_ALPHA`,
    tests/diagnosis/test_transverse.py).
    """
    if not e.scan.enough:
        return
    explained = {name for effect in e.detected for name in find(effect.effect).needs}
    t, residual = e.where.accel_residual
    channels = {
        name: c
        for name, c in e.recording.side.items()
        if name not in {*explained, *DERIVED, "temperature"} and len(c.t) > 64
    }
    a = np.interp(t - e.runs[0].origins.t, e.signals.t, e.signals.a)
    bands = [
        band
        for name, channel in channels.items()
        for band in coherent_bands(
            name, np.interp(t, channel.t, channel.y), t, residual, a, highest(channel.t, e.where.band)
        )
    ]
    excesses = [
        band
        for band in bands
        if band.p_value * len(bands) < TRANSVERSE_ALPHA and band.coherence > COHERENCE_LEAST_SHARE
    ]
    for name in channels:
        if coherent := [band for band in excesses if band.channel == name]:
            strongest = max(coherent, key=lambda band: band.coherence)
            yield remark(
                "transverse_coherence",
                channel=name,
                low=min(band.low for band in coherent),
                high=max(band.high for band in coherent),
                share=100.0 * strongest.coherence,
                sensitivity=strongest.sensitivity,
            )


def highest(t: Array, band: float) -> float:
    """Highest frequency at which a channel is compared, Hz."""
    return min(band, FASTEST / median_step(t))


def coherent_bands(
    name: str, side: Array, t: Array, residual: Array, a: Array, highest: float
) -> Iterator[CoherentBand]:
    """Partial coherence of a residual with one channel given the acceleration, in bands up to a frequency, Hz."""
    segment = 2 * len(t) // (AVERAGED_SEGMENTS + 1)
    if segment < 64 or np.ptp(side) == 0.0:
        return
    rate = 1.0 / median_step(t)
    f, _, r = scipy.signal.stft(residual - np.mean(residual), rate, nperseg=segment, boundary=None, padded=False)
    x, m = (scipy.signal.stft(y - np.mean(y), rate, nperseg=segment, boundary=None, padded=False)[2] for y in (side, a))
    lowest = 2.0 * float(f[1])
    count = int(BANDS_PER_OCTAVE * math.log2(max(highest / lowest, 1.0)))
    for low, high in pairwise(np.geomspace(lowest, highest, count + 1)):
        rows = (f >= low) & (f < high)
        averages = r.shape[1] / OVERLAP * np.count_nonzero(rows) / WINDOW
        if averages < 4.0:
            continue
        S = np.array([[np.sum(p[rows] * np.conj(q[rows])) for q in (r, x, m)] for p in (r, x, m)])
        motion = max(float(S[2, 2].real), 1e-300)
        rx = S[0, 1] - S[0, 2] * S[2, 1] / motion
        rr, xx = (float((S[k, k] - abs(S[k, 2]) ** 2 / motion).real) for k in (0, 1))
        if rr <= 0.0 or xx <= 1e-12 * float(S[1, 1].real):
            continue
        coherence = min(float(abs(rx) ** 2 / (rr * xx)), 1.0)
        p = math.exp((averages - 2.0) * math.log1p(-min(coherence, 1.0 - 1e-12)))
        yield CoherentBand(name, float(low), float(high), coherence, float(abs(rx) / xx), p)


TRIAL_TIMES = 12
"""Correlation times that are tried, from two readings to a quarter of the record."""
SEGMENTS = 8
"""Segments of the averaged spectrum."""
BAND_SHARE = 0.2
"""Of the rate of the readings: as far as their second derivative is resolved."""


def coloured_position(e: Evidence) -> Iterator[Remark]:
    """Noise of the position that is not white; no remark where a noisier sensor explains the residual as well.

    Notes
    -----
    White noise of the sensor is flat in the residual acceleration, white noise of a reading rises with f⁴, and a
    Gauss-Markov process on the reading with f² above its corner. Two models of that spectrum are compared by Whittle's
    likelihood: a sensor of any noise with white readings, and a sensor as declared with white and Gauss-Markov noise of
    the readings, whose likelihood must be 1/`FAMILYWISE_ALPHA` times as large (tests/diagnosis/test_position_noise.py).
    """
    fit, span, declared = e.fit, e.span, e.recording.rig.sensor.noise
    judged = e.scan.enough and e.recording.reference is None
    if declared is None or not judged or noise_ratio(fit) <= DATA_SHEET_NOISE_RATIO:
        return
    step = prepared(e.sources[0], fit.origins, start=span[0], end=span[1]).reading_step  # compare takes the replay
    spectrum = residual_spectrum(compare(fit, e.sources[0], band=BAND_SHARE / step, start=span[0], end=span[1]), step)
    if spectrum is None:
        return
    f, density, averages = spectrum
    w4 = (2.0 * np.pi * f) ** 4
    passed = 1.0 / (1.0 + (f / (BAND_SHARE / step)) ** (2 * ORDER)) ** 2
    flat, reading = np.ones_like(f), 2.0 * step * w4
    start = declared**2, fit.noise().r
    _, by_sensor = most_likely(density / passed, averages, np.zeros_like(f), (flat, reading), start)
    best: tuple[float, float, float] | None = None
    for tau in np.geomspace(2.0 * step, 0.25 * (span[1] - span[0]), TRIAL_TIMES):
        process = 4.0 * tau * w4 / (1.0 + (2.0 * np.pi * f * tau) ** 2)
        sizes, likelihood = most_likely(
            density / passed, averages, declared**2 * flat, (process, reading), (1e-2 * fit.noise().r, fit.noise().r)
        )
        if best is None or likelihood > best[0]:
            best = likelihood, math.sqrt(float(sizes[0])), float(tau)
    if best is not None and best[0] - by_sensor >= -math.log(FAMILYWISE_ALPHA):
        yield remark("coloured_position", rms=best[1], tau=best[2], log_evidence=best[0] - by_sensor)


def residual_spectrum(evaluation: Evaluation, step: float) -> tuple[Array, Array, float] | None:
    """Frequencies, density of the residual acceleration, and independent averages in it; None where it is too short."""
    _, residual = evaluation.accel_residual
    segment = 2 * len(residual) // (SEGMENTS + 1)
    if segment < 64:
        return None
    f, density = spectral_density(residual, 1.0 / step, segment)
    inside = (f > 2.5 / (segment * step)) & (f < BAND_SHARE / step)
    # neighbouring ordinates of a Hann window and overlapping segments share a third and a tenth of their power
    return f[inside], density[inside], SEGMENTS / (1.5 * 1.1)


def most_likely(
    density: Array, averages: float, white: Array, parts: tuple[Array, Array], start: tuple[float, float]
) -> tuple[Array, float]:
    """Sizes of two parts of a spectrum beside a known one, and Whittle's log-likelihood at them."""

    def cost(x: Array) -> float:
        model = white + math.exp(x[0]) * parts[0] + math.exp(x[1]) * parts[1]
        return float(averages * np.sum(np.log(model) + density / model))

    best = scipy.optimize.minimize(cost, np.log(start), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-2})
    return np.exp(best.x), -float(best.fun)


def scale_factor(e: Evidence) -> Iterator[Remark]:
    """Scale factor that no working sensor has: beside it every curve is significant.

    No null: the range is that of units mistaken for one another (tests/workflow/test_judgement.py).
    """
    scale = e.fit.values().scale
    if "scale_factor" not in e.model.fixed:
        yield from implausible_scale(e.runs[0], scale)


def undeclared_filter(e: Evidence) -> Iterator[Remark]:
    """Filter of the output that is not declared: the one of one pole, unless a resonance leaves clearly less noise."""
    remarks = [*undeclared_lowpass(e), *undeclared_resonance(e)]
    if remarks:
        yield min(remarks, key=lambda note: float(note.values["left"]) * (1.0 if note is remarks[-1] else 0.9))


def undeclared_lowpass(e: Evidence) -> Iterator[Remark]:
    """First-order low-pass in front of the output that is not declared and is so slow that no effect stands for it.

    The search evaluates effects at the motion that the output shows, which behind such a filter is another motion: what
    is left follows it, and has many names. With the filter in the model of the output the noise must be far less. No
    null: noise that no filter lowers by `DATA_SHEET_NOISE_RATIO` gives none
    (tests/diagnosis/test_undeclared_lowpass.py).
    """
    rig, delay = e.recording.rig, e.fit.values().time_offset
    slower = delay > find(LAG).shapes["tau"].span(e.signals)[1]  # than the search tries
    imposed, coloured = _filtered(e)
    named = any(LAG in finding.members for finding in e.scan.detected)
    filtered = imposed or coloured if slower else imposed and not named
    if not (e.delayed and filtered) or rig.passed_by_output:
        return
    before = most_noise(e.fit)
    for tau in (delay, 0.5 * delay):  # all of the delay, or half of it beside another
        with suppress(ValueError):
            fit = _behind(e, e.model, replace(rig, lowpass=LowPass(1.0 / (2.0 * math.pi * tau), 0.5)))
            error, left = fit["lowpass_error"], most_noise(fit)
            if (
                DATA_SHEET_NOISE_RATIO * left < before
                and abs(error.value) < 0.5 * tau
                and tau + error.value > 5.0 * error.std
            ):
                tau += error.value
                values = {"tau": 1e3 * tau, "std": 1e3 * error.std, "corner": 1.0 / (2.0 * math.pi * tau)}
                yield remark("undeclared_lowpass", **values, before=before, left=left)
                return


def undeclared_resonance(e: Evidence) -> Iterator[Remark]:
    """Resonance of mount or element within or near the band of the motion, w0²/(s² + w0 s/Q + w0²).

    Its inverse is 1 + s/(Q w0) + s²/w0²: the time offset estimates the first coefficient and `sensor_resonance` what
    the second has beyond a delay. With what they say declared, both estimate what it lacks; the frequency said is that
    which leaves the least noise, half of the way to it in its uncertainty (derivations 7.3d). No null:
    noise that no resonance lowers by `DATA_SHEET_NOISE_RATIO` gives none (tests/diagnosis/test_undeclared_lowpass.py).
    """
    rig, before = e.recording.rig, most_noise(e.fit)
    imposed, coloured = _filtered(e)
    named = any(member in DELAY_CLASS for finding in e.scan.detected for member in finding.members)
    filtered = imposed or (coloured and named)
    if not (e.delayed and filtered) or any(item.kind == "resonance" for item in rig.output_filters):
        return

    def behind(f0: float, q: float, tolerance: float | None = None) -> Rig:
        resonance = ChannelFilter("resonance", cutoff=f0, quality=q, tolerance=tolerance)
        return replace(rig, lowpass=None, output_filters=(resonance, *rig.passed_by_output))

    model = e.model if RESONANCE in e.model.effects else e.model.add(RESONANCE)
    declared, first, second, share = rig, 0.0, 0.0, 1.0
    with suppress(ValueError):
        for step in range(RESONANCE_STEPS):
            fit = _behind(e, model, declared)
            lag, rest = fit["time_offset"], fit[RESONANCE]
            first += share * lag.value
            second += share * (rest.value + (0.5 * lag.value**2 if step == 0 else 0.0))
            if min(first, second) <= 0.0 or (step and RESONANCE_FIRST * most_noise(fit) > before):
                return
            f0, q, share = 0.5 / (math.pi * math.sqrt(second)), math.sqrt(second) / first, RELAXED
            declared = behind(f0, q)
            if abs(lag.value) < lag.std and abs(rest.value) < rest.std:
                break

        def noise(shift: float) -> float:
            return most_noise(_behind(e, e.model, behind(f0 * (1.0 + shift), q)))

        below, left, above = map(noise, (-0.03, 0.0, 0.03))
        shift = 0.015 * (below**2 - above**2) / max(below**2 - 2.0 * left**2 + above**2, 1e-2 * left**2)
        least = noise(shift)
        shift, left = (shift, least) if RESONANCE_LOWER * least < left else (0.0, left)
        unknown = math.hypot(rig.lowpass_tolerance, rig.offset_tolerance)  # a delay behind it, s
        of_first = math.hypot(lag.value, lag.std, unknown) / first
        of_second = math.hypot(rest.value, rest.std, unknown * first) / second
        spread = math.hypot(0.5 * of_second, 0.5 * shift)
        if DATA_SHEET_NOISE_RATIO * left < before and spread < RESONANCE_SPREAD:
            f0 = float(f"{f0 * (1.0 + shift):.4g}")
            values = {"f0": f0, "f0_std": spread * f0, "q": q, "q_std": math.hypot(spread, of_first) * q}
            entry = filter_entries(behind(f0, float(f"{q:.4g}"), float(f"{spread:.2g}")), "accel")["lowpass"]
            yield remark("undeclared_resonance", **values, before=before, left=left, entry=str(entry))


def _filtered(e: Evidence) -> tuple[bool, bool]:
    """Whether the noise of the fit is that of a band, and whether its spectrum was measured: it is not white."""
    coloured = any(note.code == "measured_spectrum" for note in e.fit.remarks)
    return any(run.noise.band is not None for run in e.fit.runs), coloured


def _behind(e: Evidence, model: Model, rig: Rig) -> Fit:
    """A fit of the diagnosed runs with other filters declared."""
    begin, end = float(e.runs[0].t[0]), float(e.runs[0].t[-1])
    recordings = [replace(run.recording, rig=rig) for run in e.sources]
    return result(solve_runs(model, recordings, start=begin, end=end, others_whole=True))


def engines(e: Evidence) -> Iterator[Remark]:
    """Replay and weak form that disagree: normal differences of two estimates, beyond `ENGINES_APART` standard
    deviations (tests/diagnosis/test_independent_estimate.py)."""
    apart = sorted(
        (difference for difference in e.differences if abs(difference.sigma) > ENGINES_APART),
        key=lambda difference: -abs(difference.sigma),
    )
    for worst in apart[:1]:
        yield remark(
            "engines_disagree",
            parameters=", ".join(dict.fromkeys(difference.name for difference in apart)),
            parameter=worst.name,
            replay=float(f"{worst.replay:.6g}"),
            weak=float(f"{worst.weak:.6g}"),
            sigma=abs(worst.sigma),
        )


def unresolved_motion(e: Evidence) -> Iterator[Remark]:
    """Motion that jumps between two samples; beyond `UNRESOLVED_MOST_SHARE` of a record what is left is too little to
    judge (tests/diagnosis/noise_tests/test_unresolved.py)."""
    jumps = [run.jumps for run in e.runs]
    if any(np.any(jump.certain) for jump in jumps):
        share = sum(float(np.sum(jump.before + jump.after)) for jump in jumps)
        share /= sum(float(run.t[-1] - run.t[0]) for run in e.runs)
        code = "unresolved_motion" if share < UNRESOLVED_MOST_SHARE else "motion_beyond_sampling"
        yield remark(code, instants=sum(len(jump.t) for jump in jumps), share=100.0 * share)


def agreement(e: Evidence) -> Iterator[Remark]:
    """Recordings with another value of a shared parameter: chi-square over the runs, below `HOMOGENEITY_ALPHA`
    (tests/diagnosis/test_run_agreement.py)."""
    yield from runs_disagree(e.by_run)


def run_to_run(e: Evidence) -> Iterator[Remark]:
    """Coefficients that differ from run to run, and what they go with; tested in the fit (REML,
    tests/estimation/test_run_to_run.py)."""
    yield from (note for note in e.fit.remarks if note.code in ("goes_with", "run_to_run"))


def faults(e: Evidence) -> Iterable[Remark]:
    """Faults of the data, which were sought before the fit, each with its own null (tests/diagnosis)."""
    return e.stretch.remarks


def unsteady(e: Evidence) -> Iterator[Remark]:
    """Effects that would have entered, had they one size in all parts of the runs and happened once: chi-square over
    the parts, below `HOMOGENEITY_ALPHA` (tests/diagnosis/search/test_homogeneity.py)."""
    sigma = {candidate.effect: candidate.snr for candidate in e.scan.candidates}
    for change in () if e.forbidden else e.scan.changing:
        if change.effect in sigma:  # of those that explain part of what is left at the end
            sizes = {"sizes": change.unequal.text} if change.unequal else {}
            over_frequency = change.unequal is not None and change.unequal.of_what == OF_FREQUENCY
            code = "depends_on_frequency" if over_frequency else "no_single_size" if change.unequal else "recurs"
            yield remark(code, effect=change.effect, sigma=sigma[change.effect], **sizes)


def slow_noise(e: Evidence) -> Iterator[Remark]:
    """Slow noise that effects were judged against, the run with the highest knee: by log-evidence of its spectrum
    (tests/diagnosis/search/test_slow_noise.py)."""
    worst = max(e.scan.slow_noise, key=lambda noise: noise.knee, default=None)
    if worst is not None and worst.knee:
        yield remark("slow_noise", knee=worst.knee, log_evidence=worst.log_evidence)


CHECKS: tuple[Callable[[Evidence], Iterable[Remark]], ...] = (
    scale_factor,
    undeclared_filter,
    engines,
    turning_sensor,
    coloured_position,
    unresolved_motion,
    agreement,
    run_to_run,
    faults,
    unsteady,
    slow_noise,
    transverse_coherence,
)
"""Every check, in the order of their remarks; one reads what those before it found."""
