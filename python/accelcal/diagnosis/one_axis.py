"""Whether output and position are one axis of one body: coherence of output and second derivative of position."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import fft, special

from accelcal.data import (
    Array,
    Flags,
    Recording,
    RecordingError,
    in_usual_unit,
    require_few_holes,
    root_mean_square,
    usual_step,
)
from accelcal.diagnosis.faults import BANDS_PER_DECADE, RelationColumns, unexplained
from accelcal.diagnosis.policy import (
    COHERENCE_ALPHA,
    EXPECTED_COHERENCE,
    MISSING_POWER_SHARE,
    RELATED_COHERENCE,
    RELATED_LOG_LIKELIHOOD,
    RELATED_SHARE,
    RELATION_LEAST_BLOCKS,
    RELATION_LEAST_SEGMENTS,
    REST_LOG_LIKELIHOOD,
    REST_NOISE_RATIO,
    UNDECLARED_BIAS_INSTABILITY,
)
from accelcal.estimation.estimate import require_motion
from accelcal.estimation.gauss_newton import NotIdentifiable
from accelcal.estimation.plausible import other_column
from accelcal.estimation.run import PreparedRun, Source, inside, prepared, recording_of
from accelcal.signals.processing import LONG_TRANSFORM, even_times, forget_plans, low_pass, quintic
from accelcal.signals.series import grid_step, interpolation_spread
from accelcal.validation.evaluation import AVERAGED_SEGMENTS


def require_motion_above_noise(runs: Sequence[PreparedRun]) -> None:
    """Refuse runs of which none shows a motion above the noise.

    Raises
    ------
    NotIdentifiable
        With the departure from a resting position, and the noise that it does not exceed.
    """
    if not all(at_rest(run) for run in runs):
        return
    run = runs[0]
    require_motion(run)
    raise NotIdentifiable(
        f"{run.recording.title}: at rest throughout: position departs from a steady drift by "
        f"{in_usual_unit(departure(run), 'm')} rms, its own noise, and the output explains none of it; acceleration "
        "was not excited, so scale_factor and time_offset cannot be estimated. Record a run in which the stage moves"
    )


def at_rest(run: PreparedRun) -> bool:
    """Whether the readings are noise about a steady drift, the output explains none of it, and gravity does not turn.

    The second condition keeps a vibration that is smaller than the noise of a reading but that the output sees.
    """
    noise = float(np.sqrt(run.reading_variance_guess))
    return not run.turns and departure(run) <= REST_NOISE_RATIO * noise and not explained(run)


def departure(run: PreparedRun) -> float:
    """Root mean square departure of the readings from constant acceleration, m: what bias cannot be told from."""
    x = run.t - run.t[0]
    fitted = np.polynomial.Polynomial.fit(x, run.z, 2)
    return root_mean_square(run.z - fitted(x))


def explained(run: PreparedRun) -> bool:
    """Whether output and encoder are related in any band: gain of log-likelihood over a constant acceleration alone.

    Each period of a band counts as one independent sample.
    """
    columns = RelationColumns(run)
    for band in columns.bands(0.5, 1.0):  # readings may be slower than the motion
        gram = columns.in_band(band).gram
        if len(gram) < 2:
            continue
        share = float(unexplained(gram.sum(axis=0, keepdims=True))[1][0])
        periods = band * float(run.t[-1] - run.t[0])
        if -0.5 * periods * np.log1p(-min(share, 1.0 - 1e-15)) > REST_LOG_LIKELIHOOD:
            return True
    return False


SHORTEST = 32
"""Least samples of a segment."""
TOP = 0.25
"""Highest frequency that is judged, in rates of the slower channel."""
LOWEST_BIN = 2
"""First frequency bin that a Hann window keeps apart from the mean."""
BIN_WIDTH = 1.5
"""Bins of a Hann window that are one independent one."""
OVERLAP = 0.55
"""Independent segments in one of those that overlap by half."""
DRIFT_TIME = 100.0
"""Correlation time of a bias that wanders, s."""
PARTS = 5
"""Parts of the record, each half as long again as its share, in any of which a relation may hold."""
NOISE_SAMPLES = 100_000
"""Samples of a channel from which its noise is estimated."""

Spectra = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Band:
    """Coherence of both channels in one band, over the segments in which both stand above their noise."""

    low: float
    """Hz"""
    high: float
    segments: float
    """Independent segments in which motion is expected."""
    expected: float
    """Coherence that the noise of both channels leaves, mean of those segments."""
    observed: float
    """Squared coherence."""
    least: float
    """0.1 % quantile of the observed one if the expected one holds, over all bands; 0 where none is expected."""
    power: float
    """Share of the power of the output about its mean."""
    related: bool
    """Whether some part of the record shows a relation."""


def require_one_axis(sources: Sequence[Source], *, start: float | None = None, end: float | None = None) -> None:
    """Refuse a recording whose channels both show motion, and not the same one.

    Parameters
    ----------
    sources : one or several runs.
    start, end : s, optional; only this part is used.

    Raises
    ------
    RecordingError
        With the band in which a relation is expected most clearly, its coherence and the expected one.
    """
    for source in sources:
        recording = recording_of(source)
        bands = coherence_by_band(recording, start, end)
        if not unrelated(bands) or related_in_part(prepared(source, start=start, end=end)):
            continue
        elsewhere = other_column(recording)
        worst = max((band for band in bands if band.observed < band.least), key=lambda band: band.segments)
        searched = "".join(f". {note.text}" for note in recording.findings if note.kind == "rates_searched")
        raise RecordingError(
            f"{recording.title}: output and position are not one axis of one body: from "
            f"{worst.low:.3g} to {worst.high:.3g} Hz both move well above their noise, which would leave a coherence "
            f"of {worst.expected:.2f}, and it is {worst.observed:.2g}. No scale factor, mount or effect is read from "
            "them; check that both channels are of the same run and the same axis"
            f"{': ' * bool(elsewhere)}{elsewhere}{searched}"
        )


def unrelated(bands: Sequence[Band]) -> bool:
    """Whether a relation is expected somewhere and missing, and none is seen anywhere.

    An effect, a filter, jitter, a tilt lower the coherence of some band; they leave it in others. Bands that hold next
    to nothing of the output do not decide: a reference may err there more than its neighbours tell.
    """
    missing = sum(band.power for band in bands if band.observed < band.least)
    return missing > MISSING_POWER_SHARE and not any(band.related for band in bands)


def related_in_part(run: PreparedRun) -> bool:
    """Whether a linear relation explains more of the position than by chance in some band and part of the record.

    It may be slower than the segments of the coherence, where a reference errs at higher frequencies, or end early.
    Every block of at least one period counts as one independent sample.
    """
    columns = RelationColumns(run)
    for band in columns.bands(0.5, 1.0):
        gram = columns.in_band(band).gram
        if len(gram) < RELATION_LEAST_BLOCKS:
            continue
        before = np.concatenate([np.zeros((1, 6, 6)), np.cumsum(gram, axis=0)])
        for length in {max(RELATION_LEAST_BLOCKS, len(gram) // part) for part in (1, 2, 4, 8)}:
            begins = np.arange(0, len(gram) - length + 1, max(1, length // 2))
            share = unexplained(before[begins + length] - before[begins])[1]
            gain = -0.5 * length * np.log1p(-np.minimum(share, 1.0 - 1e-15))
            if np.any((gain > RELATED_LOG_LIKELIHOOD) & (share > RELATED_SHARE)):
                return True
    return False


def coherence_by_band(recording: Recording, start: float | None = None, end: float | None = None) -> list[Band]:
    """Coherence of output and second derivative of position in quarter decades, and the one that is expected.

    Notes
    -----
    Of each segment and band the share of either channel that its own noise does not explain is known: white noise as
    declared or as neighbours do not predict it, and a bias that wanders by its instability. Segments in which both
    shares leave a coherence above 0.8 count, each with the same weight, so that one violent event is one segment. The
    estimate over K segments and m frequencies has the density of Fisher's transform about the expected value, and
    about none that of a mean of m numbers Beta(1, K - 1) (derivations 6.7). A delay turns the phase of a frequency, the
    same in all segments, and one that is a fair part of a segment is taken off before.
    """
    pair = Pair.of(recording, start, end)
    if pair is None:
        return []
    f: Array = np.asarray(np.fft.rfftfreq(pair.segment, pair.step))
    output_noise, motion_noise = pair.noise(f)
    pair = pair.aligned(output_noise, motion_noise)
    edges = band_edges(f, TOP / pair.step)
    power = power_below(pair.output, pair.step)  # before the spectra, which are twice as long as both channels
    output, motion = pair.spectra(edges[-1])
    bands: list[Band] = []
    for low, high in pairwise(edges):
        inside = slice(low, high)
        u, a = output[:, inside], motion[:, inside]
        shares = above_noise(u, output_noise[inside]) * above_noise(a, motion_noise[inside])
        counts: Flags = shares > EXPECTED_COHERENCE
        bins = max(1.0, (high - low) / BIN_WIDTH)
        K = OVERLAP * np.count_nonzero(counts)
        # an output far beyond its noise, as from meaningless readings, rounds to a coherence of 1
        expected = min(float(np.mean(shares[counts])), 1.0 - np.finfo(float).eps) if counts.any() else 0.0
        chance = COHERENCE_ALPHA / (len(edges) - 1)
        observed, least = 0.0, 0.0
        if RELATION_LEAST_SEGMENTS <= K:
            observed = coherence(u[counts], a[counts])
            spread = -special.ndtri(chance) / math.sqrt(2.0 * (K - 1.0) * bins)
            least = math.tanh(max(0.0, math.atanh(math.sqrt(expected)) - float(spread))) ** 2
        related = any(
            holds(u[part][counts[part]], a[part][counts[part]], bins, chance / (PARTS + 1))
            for part in (slice(None), *parts(len(u)))
        )
        begin, end_of_band = (float(f[k]) for k in (low, high))
        held = float(power(end_of_band) - power(begin))
        bands.append(Band(begin, end_of_band, K, expected, observed, least, held, related))
    return bands


@dataclass(frozen=True, slots=True)
class Pair:
    """Output and second derivative of position at common, even times."""

    recording: Recording
    output: Array
    """(n,) m/s²"""
    motion: Array
    """(n,) m/s²"""
    periods: tuple[float, float]
    """Spacing of the samples of the output and of the readings, s."""
    segment: int
    """Samples."""

    @property
    def step(self) -> float:
        """Spacing of the common times, s: that of the slower channel."""
        return max(self.periods)

    @classmethod
    def of(cls, recording: Recording, start: float | None, end: float | None) -> Pair | None:
        """Both channels at the rate of the slower one; None where they are too short."""
        accel, position = recording.accel, recording.position
        _, (first, last) = inside(recording, start, end)
        periods = usual_step(accel.t), usual_step(position.t)
        step = max(periods)
        require_few_holes(recording, last - first, min(periods))
        count = int((last - first) / step) - 1
        segment = max(count // AVERAGED_SEGMENTS, SHORTEST)
        if count < 4 * segment:
            return None
        at = first + step * np.arange(count, dtype=np.float64)
        both = [
            evenly(channel.t, channel.y, period, at, step)
            for channel, period in zip((accel, position), periods, strict=True)
        ]
        return cls(recording, both[0][1:-1], np.diff(both[1], 2) / step**2, periods, segment)

    def aligned(self, output_noise: Array, motion_noise: Array) -> Pair:
        """The pair without a delay that is more than a sixteenth of a segment and less than one.

        It is where the correlation of the whitened channels is largest, at frequencies at which both stand above their
        noise, (m,) densities.
        """
        output, motion = self.spectra(len(output_noise))
        power = (np.mean(np.abs(output) ** 2, axis=0), np.mean(np.abs(motion) ** 2, axis=0))
        noises = zip((output_noise, motion_noise), power, strict=True)
        share = np.prod([np.maximum(0.0, 1.0 - noise / np.maximum(power, 1e-300)) for noise, power in noises], axis=0)
        n = fft.next_fast_len(2 * len(self.output), real=True)
        product = fft.rfft(self.output - np.mean(self.output), n) * np.conj(fft.rfft(self.motion, n))
        weight = np.interp(np.linspace(0.0, 1.0, len(product)), np.linspace(0.0, 1.0, len(share)), share)
        product *= np.where(weight > EXPECTED_COHERENCE, 1.0, 0.0) / np.maximum(np.abs(product), 1e-300)
        correlation = np.abs(fft.irfft(product, n))
        if n > LONG_TRANSFORM:
            forget_plans()
        reach = np.concatenate([np.arange(self.segment), np.arange(-self.segment, 0)])
        late = int(reach[int(np.argmax(correlation[reach]))])
        if abs(late) <= self.segment / 16:
            return self
        overlap = len(self.output) - abs(late)
        behind, before = slice(abs(late), None), slice(0, overlap)
        first, second = (behind, before) if late > 0 else (before, behind)
        return replace(self, output=self.output[first], motion=self.motion[second])

    def spectra(self, m: int) -> tuple[Spectra, Spectra]:
        """Of segments that overlap by half behind a Hann window, at the first m frequencies, (K, m) each; their squares
        are one-sided densities."""
        window = np.hanning(self.segment + 1)[:-1]
        scale = math.sqrt(2.0 * self.step / float(window @ window))
        blocks = []
        for y in (self.output, self.motion):
            views = np.lib.stride_tricks.sliding_window_view(y, self.segment)[:: self.segment // 2]
            blocks.append(np.stack([np.fft.rfft((view - view.mean()) * window)[:m] * scale for view in views]))
        return blocks[0], blocks[1]

    def noise(self, f: Array) -> tuple[Array, Array]:
        """One-sided densities of the noise of either channel at frequencies, (m/s²)²/Hz."""
        accel, position, rig = self.recording.accel, self.recording.position, self.recording.rig
        sample, between = self.periods
        few = slice(0, NOISE_SAMPLES)
        white = 2.0 * sample * interpolation_spread(accel.t[few], accel.y[few]) ** 2
        wander = rig.sensor.bias_instability or UNDECLARED_BIAS_INSTABILITY
        drift = 4.0 * DRIFT_TIME * wander**2 / (1.0 + (2.0 * np.pi * f * DRIFT_TIME) ** 2)
        resolution = rig.resolution or grid_step(position.y[few])
        reading = interpolation_spread(position.t[few], position.y[few]) ** 2 + resolution**2 / 12.0
        differences = (2.0 * np.sin(np.pi * f * self.step) / self.step) ** 4
        return max(white, (rig.sensor.noise or 0.0) ** 2) + drift, 2.0 * between * reading * differences


def power_below(y: Array, step: float) -> Callable[[float], float]:
    """Share of the power of samples about their mean below a frequency, Hz."""
    windowed = np.hanning(len(y))
    windowed *= y - np.mean(y)
    n = fft.next_fast_len(len(y), real=True)
    power = np.abs(fft.rfft(windowed, n)) ** 2
    share, f = np.cumsum(power) / max(float(np.sum(power)), 1e-300), np.fft.rfftfreq(n, step)
    return lambda frequency: float(np.interp(frequency, f, share))


def evenly(t: Array, y: Array, period: float, at: Array, step: float) -> Array:
    """A channel at even times, its faster part removed where it is sampled faster."""
    if period < 0.7 * step:
        fine = even_times(at[0] - 16.0 * step, at[-1] + 16.0 * step, period)
        y, t = low_pass(np.interp(fine, t, y), 1.0 / period, 0.4 / step), fine
    return quintic(t, y, at)


def band_edges(f: Array, top: float) -> list[int]:
    """First bins of quarter decades up to a frequency, Hz, and the bin behind the last."""
    last = int(np.searchsorted(f, top))
    if last <= LOWEST_BIN + 1:
        return [LOWEST_BIN]
    count = max(1, round(BANDS_PER_DECADE * math.log10(last / LOWEST_BIN)))
    return sorted({round(edge) for edge in np.geomspace(LOWEST_BIN, last, count + 1)})


def above_noise(spectra: Spectra, noise: Array) -> Array:
    """Share of the power of each segment that noise does not explain, (K,)."""
    power = np.sum(np.abs(spectra) ** 2, axis=1)
    return np.asarray(np.maximum(0.0, 1.0 - float(np.sum(noise)) / np.maximum(power, 1e-300)))


def coherence(u: Spectra, a: Spectra) -> float:
    """Squared coherence of two channels, mean of the frequencies weighted by their power; segments weigh alike."""
    u, a = (x / np.sqrt(np.mean(np.abs(x) ** 2, axis=1, keepdims=True)) for x in (u, a))
    cross = np.abs(np.sum(u * np.conj(a), axis=0)) ** 2
    power = np.sum(np.abs(u) ** 2, axis=0) * np.sum(np.abs(a) ** 2, axis=0)
    return float(np.sum(cross) / np.sum(power))


def holds(u: Spectra, a: Spectra, bins: float, chance: float) -> bool:
    """Whether two channels are related: coherent by more than a half, and by more than unrelated ones are by chance."""
    K = OVERLAP * len(u)
    if K < 2.0:
        return False
    observed = coherence(u, a)
    by_chance = float(special.gammaincinv(bins, 1.0 - chance)) / (bins * K)
    return observed > max(RELATED_COHERENCE, by_chance)


def parts(count: int) -> list[slice]:
    """Overlapping parts of a number of segments."""
    length = max(1, round(1.5 * count / PARTS))
    return [slice(begin, begin + length) for begin in np.linspace(0, max(0, count - length), PARTS).astype(int)]
