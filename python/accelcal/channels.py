"""Effects that the mean cannot see: noise that follows the motion, lines, outliers, steps of a converter, colour.

Each test takes a fitted state, removes the motion that the model explains, and states its null distribution. What is
left of the output above the motion's bandwidth, `high`, carries vibration, stamp jitter, outliers and lines; the
whitened innovations carry the encoder's cyclic error, lines below that, and whatever has no name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.breaks import LOCAL, local_spread
from accelcal.loudness import WINDOW, Spectra, block_means, contamination, follows, power_fit, steady_spread
from accelcal.passes import Pass
from accelcal.recording import Array
from accelcal.signals import Signals

HIGH = 0.09
"""Share of the sampling rate above which no motion leaks: a stage that starts with a jump in snap leaves f^-3."""
LEAST_BLOCKS = 40
"""Fewer blocks than this show no correlation that could be told from chance at 1e-4."""
MEMORY = 4.0
"""Time constants after which the filter has forgotten an outlier."""
ALARM = 1e-4
"""Level at which one test changes what another one says (a line that follows the motion is vibration)."""


@dataclass(frozen=True, slots=True)
class ChannelFinding:
    """What one test says of one effect; significant or not."""

    effect: str
    statistic: float
    p_value: float
    """Chance of such a statistic when the effect is absent, all that this test has looked at included."""
    estimate: float
    unit: str
    std: float
    sentence: str
    parts: Mapping[str, float] = field(default_factory=dict)
    """Particulars in SI: frequency, wavelength, step, count, ..."""
    at: tuple[float, ...] = ()
    """Instants it was seen at, where it has any, s on the clock of its channel."""


def channel_findings(state: Pass) -> tuple[ChannelFinding, ...]:
    """Run every test on a fitted state.

    Parameters
    ----------
    state : after `accelcal.gauss_newton.iterate`; it is not changed.

    Returns
    -------
    One finding for each of vibration, timing_jitter, accelerometer_outliers, encoder_outliers, quantisation,
    encoder_cyclic, whiteness, and one for each of at most five lines (`tone`; at least one, the loudest).
    """
    seen = Residuals(state)
    lines = tones(seen)
    vibration, jitter = motion_noise(seen, lines)
    return (
        vibration,
        jitter,
        accelerometer_outliers(seen),
        encoder_outliers(seen),
        quantisation(seen),
        *(line for line in lines if not line.parts["follows_motion"]),
        encoder_cyclic(seen),
        whiteness(seen),
    )


# ---- residuals ---------------------------------------------------------------------------------------------------


class Residuals:
    """What both channels say beyond the fitted model, on uniform times."""

    def __init__(self, state: Pass) -> None:
        assert state.signals is not None, "the fit has not been iterated"
        self.state, self.run = state, state.run
        self.signals: Signals = state.signals
        run, s = self.run, self.signals
        self.step = run.accel_step
        self.tau = run.tau(state.values)
        self.rate = 1.0 / self.step
        spoiled = 2.0 / s.cutoff if s.cutoff > 0.0 else 0.0
        spoiled = min(spoiled, 0.05 * float(run.t[-1] - run.t[0]))
        t = run.accel.t
        inside = (t >= run.t[0] + spoiled) & (t <= run.t[-1] - spoiled)
        self.t_u, self.u = t[inside], run.accel.y[inside]
        self.place: NDArray[np.intp] = np.rint((self.t_u - self.t_u[0]) / self.step).astype(np.intp)
        self.n = int(self.place[-1]) + 1
        self.taken = np.zeros(self.n, dtype=np.bool_)
        self.taken[self.place] = True
        self.t = self.t_u[0] + self.step * np.arange(self.n)
        self.edge = min(max(HIGH * self.rate, 2.0 * s.cutoff), 0.25 * self.rate)
        ends = int(4.0 * self.rate / self.edge)  # a spectrum takes the two ends of a record for a jump
        self.taken[:ends] = self.taken[self.n - ends :] = False

    @property
    def model(self) -> Array:
        """Output that the model expects at uniform times: smoothed motion through scale, effects, delay and RC."""
        s, values, run = self.signals, self.state.values, self.run
        grid = values.scale * s.a + values.bias
        for term, coefficient in values.additive("output"):
            grid = grid + coefficient * term.column(s)
        at = scipy.interpolate.CubicSpline(s.t + run.origins.t, grid)(self.t - values.time_offset)
        if self.tau > 0.0:  # exact for straight lines between samples
            x = self.step / self.tau
            d = math.exp(-x)
            b = [1.0 - (1.0 - d) / x, (1.0 - d) / x - d]
            at, _ = scipy.signal.lfilter(b, [1.0, -d], at, zi=[at[0] * (1.0 - b[0])])
        return np.asarray(at, dtype=np.float64)

    @cached_property
    def residual(self) -> Array:
        """Output minus model at uniform times, lost samples bridged by straight lines, (n,) m/s²."""
        model = self.model
        slope = np.gradient(model, self.step)[self.place]
        r = self.u - model[self.place] - slope * (self.t_u - self.t[self.place])
        return np.asarray(np.interp(np.arange(self.n), self.place, r))

    @cached_property
    def high(self) -> Array:
        """Residual above the band of any motion, (n,) m/s²."""
        return above(self.residual, self.rate, self.edge)

    @cached_property
    def background(self) -> Array:
        """`high` with lost and loud single samples filled in from their neighbours, so that none rings in its block."""
        lost = np.ones(self.n, dtype=np.bool_)
        lost[self.place] = False
        whole = self.high
        for _ in range(REPAIRS):
            gain = self.gain_of(Spectra.of(whole, self.taken, self.rate, 1.3 * self.edge))
            y, correction = self.surprises(gain, lost)
            y = y[self.taken]
            spread = np.hypot(spread_of(y)[0], self.lsb * math.sqrt(float(np.mean(gain**2)) / 12.0))
            loud = isolated(np.abs(y) / np.maximum(spread, 1e-300), np.flatnonzero(np.abs(y) > OUTLIER * spread))
            if len(loud) == 0:
                break
            loud = np.flatnonzero(self.taken)[loud]
            lost[np.clip(loud[:, None] + np.arange(-1, 2), 0, self.n - 1)] = True
            _, correction = self.surprises(gain, lost)
            whole = above(self.residual - correction, self.rate, self.edge)
        return above(self.residual - correction, self.rate, self.edge)

    def gain_of(self, spectra: Spectra) -> Array:
        """Filter that tells what a sample is off by when its neighbours are right: the noise is white behind its root.

        A single wrong sample is white: the filter divides by the power of the noise at each frequency.
        """
        f = scipy.fft.rfftfreq(scipy.fft.next_fast_len(self.n, real=True), self.step)
        gain = soft_edge(f, self.edge)
        if len(spectra.power):
            gain = gain / np.interp(f, spectra.f, np.maximum(np.mean(spectra.power, axis=0), 1e-300))
        return np.asarray(gain / np.mean(gain))

    def surprises(self, gain: Array, lost: NDArray[np.bool_]) -> tuple[Array, Array]:
        """What each sample of the residual is off by, and what lost ones must be corrected by not to be, (n,) m/s².

        Beside a lost sample less is known: the first is scaled to the spread that it has elsewhere. Beside several too
        little is known, and nothing is said.
        """
        n = scipy.fft.next_fast_len(self.n, real=True)

        def surprise(y: Array) -> Array:
            return np.asarray(scipy.fft.irfft(scipy.fft.rfft(y, n) * gain, n)[: self.n])

        y = surprise(self.residual - np.mean(self.residual))
        if not lost.any():
            return y, np.zeros_like(y)
        correction = filled(surprise, y, lost)
        response = scipy.fft.irfft(gain, n)
        reach = np.concatenate([response[REACH:0:-1], [0.0], response[1 : REACH + 1]]) / response[0]
        known = 1.0 - np.convolve(lost.astype(np.float64), reach**2, "same")
        y = y - surprise(correction)
        return np.where(known > KNOWN, y / np.sqrt(np.maximum(known, KNOWN)), 0.0), correction

    @cached_property
    def spectra(self) -> Spectra:
        """Power of `background` in blocks."""
        return Spectra.of(self.background, self.taken, self.rate, 1.3 * self.edge)

    @cached_property
    def matched(self) -> tuple[Array, Array]:
        """What each sample of the residual is off by when its neighbours are right, (n,) m/s²; the filter's gain."""
        gain = self.gain_of(self.spectra)
        lost = np.ones(self.n, dtype=np.bool_)
        lost[self.place] = False
        return self.surprises(gain, lost)[0], gain

    @cached_property
    def motion(self) -> tuple[Array, Array]:
        """Velocity and jerk at the uniform times."""
        t = self.signals.t + self.run.origins.t
        return np.interp(self.t, t, self.signals.v), np.interp(self.t, t, self.signals.jerk)

    @cached_property
    def lsb(self) -> float:
        """Step of the grid that the output lies on, m/s²; 0 when it lies on none."""
        return grid_step(self.u)

    @cached_property
    def smooth_position(self) -> Array:
        """RTS-smoothed position at the readings, m."""
        p, _, _ = self.state.track.smooth(*self.state.drive.arrays)
        return np.asarray(p)

    @cached_property
    def loud_readings(self) -> Outliers:
        """Outliers among the settled readings, against the smoothed position; see `outliers`."""
        z = (self.run.z - self.smooth_position)[self.state.counts]
        z = z - np.median(z)
        spread, dof = spread_of(z)
        return outliers(z, np.hypot(spread, self.run.least_step / math.sqrt(12.0)), len(z), dof)

    @cached_property
    def readings(self) -> Array:
        """Whitened innovations of settled readings, (m,); zero from an outlier on while the filter remembers it."""
        y = self.state.whitened[self.state.counts]
        limit = 5.0 * local_spread(y)
        y = np.clip(y, -limit, limit)
        peaks = self.loud_readings.peaks
        if self.loud_readings.p_value < ALARM:
            memory = MEMORY / (2.0 * math.pi * self.run.crossover(self.state.noise)) / self.run.reading_step
            forgotten = np.zeros(len(y) + 1)
            np.add.at(forgotten, peaks, 1.0)
            np.add.at(forgotten, np.minimum(peaks + int(memory) + 1, len(y)), -1.0)
            y = np.where(np.cumsum(forgotten)[:-1] > 0.0, 0.0, y)
        return y

    def rc_gain(self, frequency: float) -> float:
        """What the declared low-pass leaves of a line."""
        return 1.0 / math.sqrt(1.0 + (2.0 * math.pi * frequency * self.tau) ** 2)


REPAIRS = 2
"""Rounds of filling in loud samples; the noise that tells how to is known better without them."""
REACH = 16
"""Samples on either side that matter for what one should be."""
KNOWN = 0.5
"""Share of what is known of a sample that neighbours which are lost may take away."""
FILLINGS = 12
"""Steps of conjugate gradients for lost samples; most of them stand alone, and few steps fill those."""


def filled(surprise: Callable[[Array], Array], y: Array, lost: NDArray[np.bool_]) -> Array:
    """Corrections of lost samples after which none of them surprises: (n,), zero where a sample was taken."""
    x, r = np.zeros_like(y), np.where(lost, y, 0.0)
    p, power = r, float(r @ r)
    least = 1e-8 * power
    for _ in range(FILLINGS):
        if power <= least:
            break
        q = np.where(lost, surprise(p), 0.0)
        step = power / float(p @ q)
        x, r = x + step * p, r - step * q
        before, power = power, float(r @ r)
        p = r + (power / before) * p
    return x


def above(y: Array, rate: float, edge: float) -> Array:
    """Part of uniform samples above a frequency, with a soft edge that reaches 30 % higher."""
    n = scipy.fft.next_fast_len(len(y), real=True)
    f = np.asarray(np.fft.rfftfreq(n, 1.0 / rate), dtype=np.float64)
    return np.asarray(scipy.fft.irfft(scipy.fft.rfft(y - np.mean(y), n) * soft_edge(f, edge), n)[: len(y)])


def soft_edge(f: Array, edge: float) -> Array:
    """Gain that rises from 0 at a frequency to 1 at 30 % more."""
    weight = np.clip((f - edge) / (0.3 * edge), 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * weight))


def grid_step(y: Array) -> float:
    """Spacing of the values of a quantised channel; 0 when they are not on a grid that is used again and again."""
    levels = np.unique(y)
    if len(levels) < 2:
        return 0.0
    gaps = np.diff(levels)
    step = float(np.min(gaps[gaps > 1e-9 * (levels[-1] - levels[0])], initial=math.inf))
    if not math.isfinite(step) or len(levels) > 0.5 * len(y):
        return 0.0
    count = np.rint(gaps / step)
    step = float(np.sum(gaps) / np.sum(count))
    off = np.abs((levels - levels[0]) / step - np.rint((levels - levels[0]) / step))
    return step if float(np.max(off)) < 0.1 else 0.0


# ---- noise that grows with the motion ----------------------------------------------------------------------------


BANDS = (7, 14)
"""Bins of a block spectrum that one band of a vibration spans, besides all."""


def motion_noise(seen: Residuals, lines: tuple[ChannelFinding, ...]) -> tuple[ChannelFinding, ChannelFinding]:
    """Vibration (power grows with v², v⁴ in some band; physics F1) and jitter of stamps (white, with jerk²; E8).

    Block spectra are summed with the weights that suit each: one band after the other for a vibration, the squared
    inverse of the noise for jitter, which is white while noise and vibration are not. Each must pass two tests: the
    score of its own variable (`follows`), and its coefficient in power = s² + c1 v² + c2 v⁴ + c3 j² beside the
    other's. Where the record cannot tell the two apart (a single tone: j = -w² v), both keep the p value of the score.
    """
    spectra = seen.spectra
    v, jerk = seen.motion
    v2, v4, j2 = (block_means(x)[spectra.kept] for x in (v**2, v**4, jerk**2))
    if len(v2) < LEAST_BLOCKS or np.ptp(v2) == 0.0:
        nothing = ("the record is too short or too still to say whether noise follows the motion", 0.0, 1.0)
        return (
            ChannelFinding("vibration", nothing[1], nothing[2], 0.0, "m/s²", math.inf, nothing[0]),
            ChannelFinding("timing_jitter", nothing[1], nothing[2], 0.0, "s", math.inf, nothing[0]),
        )
    floor = 0.3 * seen.lsb**2 if coarse(seen) else 0.0  # below it power says how the motion crosses the steps
    everything = np.column_stack([np.ones_like(v2), v2, v4, j2])
    band, z_speed, p_speed = loudest_band(spectra, (v2, v4), floor)
    in_band = np.maximum(spectra.power[:, band].mean(axis=1), floor)
    c, covariance = power_fit(in_band, everything)
    alone_speed = math.exp(-0.5 * float(c[1:3] @ np.linalg.solve(covariance[1:3, 1:3], c[1:3])))  # two degrees

    weights = spectra.power.mean(axis=0) ** -2.0
    if p_speed < ALARM:
        skirts = shaken(spectra.power, v4, band)
        if skirts.stop - skirts.start < len(weights) - BANDS[0]:
            weights[skirts] = 0.0
    white = np.maximum(spectra.power @ (weights / weights.sum()), floor)
    z_jerk, p_jerk = follows(white, j2)
    c, covariance = power_fit(white, everything)
    alone_jerk = float(scipy.special.ndtr(-c[3] / math.sqrt(covariance[3, 3])))
    if max(p_speed, p_jerk) < ALARM and min(alone_speed, alone_jerk) > 10 * ALARM:
        alone_speed = alone_jerk = 0.0
    p_vibration, p_jitter = max(p_speed, min(1.0, alone_speed)), max(p_jerk, alone_jerk)
    beside = everything if p_vibration < ALARM else everything[:, [0, 3]]
    c, covariance = power_fit(white, beside)
    jitter, spread = rooted(c[-1], covariance[-1, -1], 1.0)
    stamps = ChannelFinding(
        "timing_jitter",
        z_jerk,
        p_jitter,
        jitter,
        "s",
        spread,
        f"noise grows with jerk as stamps uncertain by {jitter * 1e6:.3g} us would make it"
        if p_jitter < ALARM
        else "noise does not grow with jerk",
        {"score": z_jerk, "blocks": float(len(v2))},
    )
    return vibration_found(seen, lines, p_vibration, z_speed, band, jitter if p_jitter < ALARM else 0.0), stamps


def loudest_band(spectra: Spectra, motions: tuple[Array, ...], floor: float) -> tuple[slice, float, float]:
    """Bins whose power follows one of the variables most surely, the score, and its chance, all bands included."""
    F = spectra.power.shape[1]
    bands = [slice(0, F)]
    for width in (
        BANDS if floor == 0.0 else ()
    ):  # steps that are crossed in time with the motion have bands of their own
        bands += [slice(a, a + width) for a in range(0, F - width + 1, max(1, width // 2))]
    sums = np.cumsum(np.pad(spectra.power / spectra.power.mean(axis=0), ((0, 0), (1, 0))), axis=1)
    best = (1.0, -math.inf, bands[0])
    for band in bands:
        power = (sums[:, band.stop] - sums[:, band.start]) / (band.stop - band.start)
        if floor > 0.0:
            power = np.maximum(power, floor / float(spectra.power[:, band].mean()))
        for x in motions:
            z, p = follows(power, x)
            best = min(best, (p, -z, band), key=lambda one: one[:2])
    return best[2], -best[1], min(1.0, best[0] * len(bands) * len(motions))


SHAKEN = 3.0
"""Standard deviations by which the power of a bin follows v⁴ where it belongs to a vibration."""


def shaken(power: Array, v4: Array, band: slice) -> slice:
    """Bins about a band, as far as their power follows v⁴, and the two behind that its window reaches."""
    x = v4 - v4.mean()
    score = x @ (power / power.mean(axis=0)) / math.sqrt(float(x @ x))  # the power of one bin is exponential
    low, high = band.start, band.stop
    while low > 0 and score[low - 1] > SHAKEN:
        low -= 1
    while high < len(score) and score[high] > SHAKEN:
        high += 1
    return slice(max(0, low - 2), high + 2)


def rooted(c: float, variance: float, gain: float) -> tuple[float, float]:
    """Square root of a coefficient of power, and its standard deviation."""
    std = math.sqrt(variance)
    size = math.sqrt(max(c, 0.0)) * gain
    return size, 0.5 * std / max(c, std) * math.sqrt(max(c, std)) * gain


def vibration_found(
    seen: Residuals,
    lines: tuple[ChannelFinding, ...],
    p_value: float,
    score: float,
    band: slice,
    jitter: float,
) -> ChannelFinding:
    """What the test of vibration says: how loud at top speed, and where."""
    spectra = seen.spectra
    v, jerk = seen.motion
    v4, j2 = (block_means(x)[spectra.kept] for x in (v**4, jerk**2))
    share = 1.0 - 2.3 * seen.edge / seen.rate  # of white noise that `background` holds
    power = block_means(seen.background**2)[spectra.kept] - max(share, 0.0) * jitter**2 * j2
    power = np.maximum(power, 0.05 * float(np.median(power)))
    c, covariance = power_fit(power, np.column_stack([np.ones_like(v4), v4]))
    top = float(np.max(np.abs(v)))
    about = shaken(spectra.power, v4, band)
    line = next((f for f in lines if f.parts["follows_motion"] and f.p_value < ALARM), None)
    x = v4 - v4.mean()
    excess = x @ spectra.power
    frequency = line.parts["frequency"] if line else float(spectra.f[band][int(np.argmax(excess[band]))])
    gain = top**2 / seen.rc_gain(frequency)
    amplitude, spread = rooted(2.0 * c[1], 4.0 * covariance[1, 1], gain)
    return ChannelFinding(
        "vibration",
        score,
        p_value,
        amplitude,
        "m/s²",
        spread,
        f"noise above {seen.edge:.0f} Hz grows with speed: up to {amplitude:.2g} m/s² at {top:.2g} m/s, "
        f"strongest near {frequency:.0f} Hz"
        if p_value < ALARM
        else "noise does not grow with speed",
        {
            "frequency": frequency,
            "lowest": float(spectra.f[about.start]),
            "highest": float(spectra.f[min(about.stop, len(spectra.f)) - 1]),
            "top_speed": top,
            "score": score,
            "blocks": float(len(v4)),
        },
    )


def coarse(seen: Residuals) -> bool:
    """Whether the step of the converter outweighs the noise, so that the noise itself depends on the motion."""
    return seen.lsb > 0.8 * sample_noise(seen)


def sample_noise(seen: Residuals) -> float:
    """Standard deviation of one sample: what the fitted density implies, quantisation taken off, m/s².

    Coarse steps leave nothing to take off; then the declared density speaks, if there is one.
    """
    run, noise = seen.run, seen.state.noise
    bandwidth = 1.0 / (2.0 * seen.tau) if seen.tau > 0.0 else seen.rate
    variance = noise.q * seen.state.values.scale**2 * bandwidth
    declared = 0.5 * (run.rig.sensor.noise or 0.0) ** 2 * bandwidth
    return math.sqrt(max(variance - seen.lsb**2 / 12.0, 0.05 * variance, min(declared, variance)))


def rank_correlation(x: Array, y: Array) -> tuple[float, float]:
    """Spearman's correlation and the chance of one so large among independent series.

    The number of blocks is reduced by Bartlett's formula for two series that both wander.
    """
    a, b = (scipy.stats.rankdata(s) for s in (x, y))
    a, b = a - a.mean(), b - b.mean()
    scale = math.sqrt(float(a @ a) * float(b @ b))
    if scale == 0.0:
        return 0.0, 1.0
    rho = float(a @ b) / scale
    # What the common course explains is not what makes the series wander: correlation is taken off first.
    rest = a - (a @ b) / (b @ b) * b
    n, total = len(a), 0.0
    for lag in range(1, min(50, n // 8)):
        total += float(rest[lag:] @ rest[:-lag]) / float(rest @ rest) * float(b[lag:] @ b[:-lag]) / float(b @ b)
    effective = n / max(1.0, 1.0 + 2.0 * total)
    if effective < 5.0:
        return rho, 1.0
    t = rho * math.sqrt((effective - 2.0) / max(1.0 - rho**2, 1e-12))
    return rho, float(scipy.special.stdtr(effective - 2.0, -t))


# ---- outliers ----------------------------------------------------------------------------------------------------

OUTLIER = 5.5
"""Local standard deviations beyond which a sample may be an outlier."""
ISOLATED = 3
"""More samples than this in a row are an event, not an outlier."""


def course(seen: Residuals, gain: Array) -> Array:
    """Standard deviation that noise which follows the motion, named or not, gives `matched` in its course, (n,) m/s².

    Power of the blocks behind the filter = s² + c1 v² + c2 v⁴ + c3 j², put back to every sample.
    """
    spectra = seen.spectra
    v, jerk = seen.motion
    motions = np.column_stack([np.ones(seen.n), v**2, v**4, jerk**2])
    if len(spectra.power) < LEAST_BLOCKS:
        return np.ones(seen.n)
    f = np.linspace(0.0, 0.5 * seen.rate, len(gain))
    power = spectra.power @ np.interp(spectra.f, f, gain**2) * (2.0 / WINDOW)
    c, _ = power_fit(power, np.column_stack([block_means(x)[spectra.kept] for x in motions.T]))
    return np.asarray(np.sqrt(np.maximum(motions @ c, 0.1 * float(np.median(power)) + 1e-300)))


def accelerometer_outliers(seen: Residuals) -> ChannelFinding:
    """Single samples of the output that its local noise does not allow."""
    y, gain = seen.matched
    usual = course(seen, gain)[seen.taken]
    y = y[seen.taken]
    spread, dof = spread_of(y / usual)
    found = outliers(y, np.hypot(spread * usual, seen.lsb * math.sqrt(float(np.mean(gain**2)) / 12.0)), len(y), dof)
    text = found.sentence("samples of the output", "m/s²") if found.p_value < ALARM else "the output has none"
    n = len(seen.u)
    at = tuple(float(t) for t in seen.t[seen.taken][found.peaks])
    std = math.sqrt(max(found.count, 1.0)) / n
    return ChannelFinding(
        "accelerometer_outliers", found.score, found.p_value, found.count / n, "", std, text, found.parts, at
    )


def encoder_outliers(seen: Residuals) -> ChannelFinding:
    """Single readings that the smoothed position does not allow; those that the replay left out count as well."""
    found = seen.loud_readings
    left_out = seen.run.left_out
    n = len(seen.readings) + left_out
    p = 0.0 if left_out else found.p_value
    count = found.count + left_out
    at = tuple(float(t) for t in seen.run.t[seen.state.counts][found.peaks]) if p < ALARM else ()
    text = f"{count:.0f} readings of the encoder stand out by up to {found.size * 1e6:.2g} um" if p < ALARM else "none"
    parts = {**found.parts, "count": count, "left_out": float(left_out)}
    std = math.sqrt(max(count, 1.0)) / max(1, n)
    return ChannelFinding("encoder_outliers", found.score, p, count / max(1, n), "", std, text, parts, at)


@dataclass(frozen=True, slots=True)
class Outliers:
    """What stands out of a series."""

    size: float
    """Of the largest, in the unit of the series."""
    score: float
    """The largest in local standard deviations."""
    peaks: NDArray[np.intp]
    """Where the sure ones are."""
    count: float
    """How many there are: the sure ones, or where none is sure the number that the scatter implies."""
    p_value: float

    def sentence(self, what: str, unit: str) -> str:
        """How many and how large."""
        return f"{self.count:.0f} {what} stand out by up to {self.size:.2g} {unit}"

    @property
    def parts(self) -> dict[str, float]:
        """Particulars."""
        return {"count": self.count, "largest": self.size}


def spread_of(y: Array) -> tuple[Array, float]:
    """Local scale (n,) and its degrees of freedom: over a long span where the scatter is steady, else over a short."""
    steady = steady_spread(y)
    return steady if steady is not None else (local_spread(y), 0.7 * LOCAL)


def outliers(y: Array, spread: Array, n: int, dof: float = 0.7 * LOCAL) -> Outliers:
    """Samples that do not belong to the rest, p value over n samples.

    Null: samples over a local spread that is itself estimated, Student's t with `dof` degrees of freedom. Three looks
    share the error: the largest of all, the number beyond 5.5 (Poisson), and the likelihood of contamination.
    """
    if n < 8 * LOCAL:
        return Outliers(0.0, 0.0, np.empty(0, dtype=np.intp), 0.0, 1.0)
    score = np.abs(y) / np.maximum(spread, 1e-300)
    share, p_share = contamination(score, dof)
    peaks = isolated(score, np.flatnonzero(score > OUTLIER))
    if len(peaks) == 0:
        largest = float(np.max(np.abs(y))) if p_share < ALARM else 0.0
        return Outliers(largest, float(np.max(score, initial=0.0)), peaks, share * n, min(1.0, 3.0 * p_share))
    top = int(peaks[np.argmax(score[peaks])])
    p_top = min(1.0, 2.0 * n * float(scipy.special.stdtr(dof, -score[top])))
    expected = 2.0 * n * float(scipy.special.stdtr(dof, -OUTLIER))
    p_count = float(scipy.special.gammainc(len(peaks), expected))
    limit = -float(scipy.special.stdtrit(dof, 0.5 * ALARM / max(n, 1)))
    sure = peaks[score[peaks] > limit]
    chosen = sure if len(sure) else peaks
    p_value = min(1.0, 3.0 * min(p_top, p_count, p_share))
    return Outliers(float(np.abs(y[top])), float(score[top]), chosen, float(len(chosen)), p_value)


def isolated(score: Array, loud: NDArray[np.intp]) -> NDArray[np.intp]:
    """Peaks of short runs of loud samples; what a filter rings with around a peak belongs to it."""
    if len(loud) == 0:
        return loud
    groups = np.split(loud, np.flatnonzero(np.diff(loud) > 8) + 1)
    kept = []
    for group in groups:
        peak = group[int(np.argmax(score[group]))]
        if int(np.sum(score[group] > 0.5 * score[peak])) <= ISOLATED:
            kept.append(peak)
    return np.asarray(kept, dtype=np.intp)


# ---- steps of the converter --------------------------------------------------------------------------------------

COARSE = 1.2
"""Steps of more noise standard deviations than this are no longer dithered by the noise."""
HELD = 0.02
"""Share of readings that repeat the one before although the values are not on a grid."""
SAME_STEP = 1e-4
"""Relative error within which a step is the one that a converter of whole bits has over the declared range."""


def quantisation(seen: Residuals) -> ChannelFinding:
    """Step of the converter over the noise of one sample, and readings written twice.

    That values lie on a grid is no matter of chance. The p value says whether it matters: the noise of rounding, D²/12,
    would gain twice the log-likelihood sum(r - ln(1 + r)) over the sensor's own noise, r their ratio at each frequency;
    chi-square with one degree of freedom. A fine step that the declared range implies is no news.
    """
    noise = sample_noise(seen)
    ratio = seen.lsb / noise if noise > 0.0 else 0.0
    repeats = float(np.mean(np.diff(seen.u) == 0.0)) if seen.lsb == 0.0 and len(seen.u) > 1 else 0.0
    held = repeats > HELD or any(
        f.kind == "held_repeats" and f.channel == seen.run.accel.name for f in seen.run.recording.findings
    )
    p_value = 1.0
    if seen.lsb > 0.0 and (ratio > COARSE or not of_whole_bits(seen)):
        p_value = float(scipy.special.chdtrc(1.0, rounding_gain(seen, noise)))
    p_value = 0.0 if held or ratio > COARSE else p_value
    text = "the output is not on a grid that matters"
    if seen.lsb > 0.0 and p_value < ALARM:
        text = f"the output comes in steps of {seen.lsb:.3g} m/s², {ratio:.2g} times the noise of a sample"
    elif held:
        text = "readings of the output are written several times: the logger is faster than the sensor"
    parts = {"step": seen.lsb, "noise": noise, "held": max(repeats, float(held))}
    parts["coarse"] = float(ratio > COARSE or held)
    return ChannelFinding("quantisation", ratio, p_value, seen.lsb, "m/s²", 0.0, text, parts)


def rounding_gain(seen: Residuals, noise: float) -> float:
    """Twice the log-likelihood that white noise of rounding gains over low-passed noise of a sample's deviation."""
    keep = math.exp(-seen.step / seen.tau) if seen.tau > 0.0 else 0.0
    turn = np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    floor = noise**2 * (1.0 - keep**2) / (1.0 + keep**2 - 2.0 * keep * turn)
    r = seen.lsb**2 / 12.0 / floor
    return len(seen.u) * float(np.mean(r - np.log1p(r)))


def of_whole_bits(seen: Residuals) -> bool:
    """Whether the declared range holds 2^m steps, m whole: the converter that the data sheet implies."""
    limit = seen.run.rig.sensor.range
    if limit is None or seen.lsb <= 0.0:
        return False
    bits = math.log2(limit / seen.lsb)
    return abs(bits - round(bits)) < SAME_STEP


# ---- lines -------------------------------------------------------------------------------------------------------

MOST_LINES = 5
"""Lines that are reported."""
FEWEST_BINS = 64
"""Fewer bins than this have no level."""
LEVEL_SPAN = 0.04
"""Share of the sampling rate over which the level of the noise may be taken as one."""
STEP_LINE = 0.05
"""Share of a coarse converter step below which a line may be the converter's own."""
COMB = 25.0
"""Hz on either side of a line in which others may not ..."""
COMPANY = 3.0
"""... hold so many times its power together: a band of noise or a comb of lines is the vibration of some machine."""
NEIGHBOURS = 1001
"""Bins of the periodogram over which its local level is taken."""


def tones(seen: Residuals) -> tuple[ChannelFinding, ...]:
    """Lines at fixed frequency: in the output above the motion, in the whitened innovations below.

    Periodogram (Hann) over its local median; the median of m correlated bins is worth m/4 exponential ones, so one bin
    exceeds x times the level with chance (1 + x/(m/4))^-(m/4), times the number of bins. `follows_motion` marks a line
    whose power goes with speed: that is vibration.
    """
    t, y, rate = reading_grid(seen)
    split = max(2.0 * seen.signals.cutoff, 1.0 / max(seen.t[-1] - seen.t[0], 1e-9))
    below, bins_below = lines_of(y, rate, 0.0, min(split, 0.45 * rate))
    beyond, bins_beyond = lines_of(seen.residual, seen.rate, split, 0.5 * seen.rate, seen.tau)
    bins = bins_below + bins_beyond
    peaks = [(min(1.0, p * bins), -ratio, f, False) for f, ratio, p in below]
    peaks += [(min(1.0, p * bins), -ratio, f, True) for f, ratio, p in beyond]
    peaks.sort()
    loud = [peak for peak in peaks if peak[0] < ALARM] or peaks[:1]
    of_output, of_readings = (seen.t, seen.residual, seen.rate), (t, y, rate)
    return tuple(line(seen, of_output if up else of_readings, f, -minus, p, up) for p, minus, f, up in loud)


def reading_grid(seen: Residuals) -> tuple[Array, Array, float]:
    """Whitened innovations at uniform times, zero where none was taken."""
    step = seen.run.reading_step
    t = seen.run.t[seen.state.counts]
    place = np.rint((t - t[0]) / step).astype(np.intp)
    y = np.zeros(int(place[-1]) + 1)
    y[place] = seen.readings
    return t[0] + step * np.arange(len(y)), y, 1.0 / step


def lines_of(
    y: Array, rate: float, low: float, high: float, tau: float = 0.0
) -> tuple[list[tuple[float, float, float]], int]:
    """Peaks of the periodogram between two frequencies, loudest first: Hz, ratio to the level, chance of one bin.

    The slope that a low-pass of time constant `tau` gives to white noise is taken off first.
    """
    n = len(y)
    if n < 256:
        return [], 0
    window = np.hanning(n)
    spectrum = np.abs(scipy.fft.rfft((y - y.mean()) * window, scipy.fft.next_fast_len(n, real=True))) ** 2
    f = np.fft.rfftfreq(scipy.fft.next_fast_len(n, real=True), 1.0 / rate)
    spectrum *= 1.0 + (2.0 * np.pi * f * tau) ** 2
    rows = slice(*np.searchsorted(f, [max(low, 8.0 * rate / n), high]))
    part = spectrum[rows]
    if len(part) < FEWEST_BINS:
        return [], 0
    level, m = local_level(part, max(FEWEST_BINS, min(NEIGHBOURS, int(LEVEL_SPAN * n))))
    ratio = part / level
    worth = m / 4.0
    chance = np.exp(-worth * np.log1p(ratio / worth))
    peaks: list[tuple[float, float, float]] = []
    around = max(16, int(COMB * n / rate))
    for k in np.argsort(-ratio)[: 8 * MOST_LINES]:
        at = float(f[rows][k])
        if all(abs(at - other) > 4.0 * rate / n for other, _, _ in peaks) and stands_alone(part, level, int(k), around):
            i = int(k) + rows.start
            if 0 < i < len(spectrum) - 1:
                a, b, c = np.log(spectrum[i - 1 : i + 2] + 1e-300)
                bend = a - 2.0 * b + c
                at += 0.5 * (a - c) / bend * float(f[1]) if bend < 0.0 else 0.0
            peaks.append((at, float(ratio[k]), float(chance[k])))
        if len(peaks) == MOST_LINES:
            break
    return peaks, len(part)


def stands_alone(part: Array, level: Array, k: int, around: int) -> bool:
    """Whether a peak is more than one tooth of a comb: what its neighbours hold beyond the noise, each no more than it.

    Noise alone adds up to that with the chance of six standard deviations.
    """
    rows = slice(max(0, k - around), k + around + 1)
    excess = np.minimum(part[rows], part[k]) - level[rows]
    own = slice(max(0, k - 4 - rows.start), k + 5 - rows.start)
    mine = float(np.sum(excess[own]))
    others = float(np.sum(excess)) - mine
    noise = 1.5 * level[k] * math.sqrt(len(excess))
    return bool(others < COMPANY * mine + 6.0 * noise)


def local_level(part: Array, m: int = NEIGHBOURS) -> tuple[Array, int]:
    """Mean of exponential bins from their local median over m bins, and the number of bins behind each."""
    m = min(m, len(part))
    K = max(1, len(part) // m)
    edges = np.linspace(0, len(part), K + 1).astype(int)
    medians = np.array([np.median(part[a:b]) for a, b in pairwise(edges)]) / math.log(2.0)
    medians = np.maximum(medians, 1e-300)
    centres = 0.5 * (edges[:-1] + edges[1:])
    # The spectrum may fall steeply between blocks (RC, whitening): follow it by straight lines of its logarithm.
    return np.exp(np.interp(np.arange(len(part)), centres, np.log(medians))), m


def line(
    seen: Residuals, data: tuple[Array, Array, float], frequency: float, ratio: float, p_value: float, of_output: bool
) -> ChannelFinding:
    """Amplitude of one line at the sensor, and whether it comes and goes with speed."""
    t, y, rate = data
    turn = np.exp(-2j * np.pi * frequency * (t - t[0]))
    if of_output:
        amplitude = 2.0 * abs(complex(np.mean(turn * y))) / seen.rc_gain(frequency)
        std = amplitude / math.sqrt(2.0 * max(ratio, 1e-9) / 1.5)  # Hann: a line stands 1.5 times lower over the noise
    else:
        amplitude, std = line_fit(seen, frequency)
    length = max(1, int(0.1 * rate))
    K = len(y) // length
    heard = (turn * y)[: K * length].reshape(K, length).mean(axis=1)
    speed = np.mean(np.interp(t[: K * length], seen.t, seen.motion[0]).reshape(K, length) ** 2, axis=1)
    follows = False
    if K >= LEAST_BLOCKS and p_value < ALARM and np.ptp(speed) > 0.0:
        at_rest = abs(complex(np.mean(heard[speed <= np.quantile(speed, 0.4)])))
        fades = at_rest < 0.5 * abs(complex(np.mean(heard)))
        follows = fades and rank_correlation(np.abs(heard) ** 2, speed)[1] < ALARM
    if coarse(seen) and amplitude * seen.rc_gain(frequency) < STEP_LINE * seen.lsb:
        p_value = 1.0  # steps crossed by a periodic motion make lines of their own
    span = float(t[-1] - t[0])
    within = frequency < seen.signals.cutoff
    parts = {
        "frequency": frequency,
        "frequency_std": math.sqrt(12.0) / (2.0 * math.pi * span) * std / max(amplitude, 1e-300),
        "follows_motion": float(follows),
        "within_motion": float(within),
        "made_by_motion": float(within and p_value < ALARM and driven(seen.signals, frequency)),
    }
    text = f"a line of {amplitude:.2g} m/s² at {frequency:.4g} Hz" if p_value < ALARM else "no line stands out"
    return ChannelFinding("tone", ratio, p_value, amplitude, "m/s²", std, text, parts)


DRIVEN = 20.0
"""Power of a line of the motion's own nonlinear functions over that at its neighbours, where the motion makes lines."""


def driven(s: Signals, frequency: float) -> bool:
    """Whether a motion makes lines at a frequency: a nonlinearity that is missing would show as a tone there."""
    window = np.hanning(len(s.t))
    near, beside = np.arange(-2, 3) / 2.0, np.concatenate([np.arange(-24, -3), np.arange(4, 25)])
    turns = np.exp(-2j * np.pi * (frequency + np.concatenate([near, beside])[:, None] / s.length) * s.t) * window
    for made in (s.a**2, s.a**3, np.abs(s.a), np.sign(s.a), s.v**2, np.sign(s.v), s.p**2):
        power = np.abs(turns @ (made - np.mean(made))) ** 2
        if np.max(power[: len(near)]) > DRIVEN * np.median(power[len(near) :]):
            return True
    return False


def line_fit(seen: Residuals, frequency: float) -> tuple[float, float]:
    """Amplitude of a line at the output and its standard deviation, by exact columns of the replay, m/s²."""
    phase = 2.0 * np.pi * frequency * np.arange(int((seen.run.t[-1] - seen.run.t[0]) / seen.step) + 4) * seen.step
    grid = np.column_stack([np.cos(phase), np.sin(phase)]) / seen.state.values.scale
    X = carried(seen, grid, np.zeros((len(seen.run.t), 0)), seen.step)
    _, amplitude, std = pair_fit(X, seen.readings)
    return amplitude, std


def carried(seen: Residuals, on_grid: Array, direct: Array, step: float) -> Array:
    """Whitened columns of settled readings, either driven by accelerations on a grid or added to the readings."""
    run, state = seen.run, seen.state
    columns = on_grid.shape[1] + direct.shape[1]
    whitened = np.empty((len(run.t), columns))
    state.track.carry(
        run.t,
        state.drive.restart,
        on_grid,
        direct,
        start=float(run.t[0]),
        step=step,
        from_=0,
        to=len(run.t),
        state=np.zeros(2 * columns),
        whitened=whitened,
    )
    return np.asarray(whitened[state.counts])


def pair_fit(X: Array, y: Array) -> tuple[float, float, float]:
    """Twice the log-likelihood that two columns gain, length of their coefficients, and its standard deviation."""
    A = np.einsum("ni,nj->ij", X, X)  # tall and thin: starting threads would cost more than they save
    A += 1e-12 * np.trace(A) * np.eye(2)
    c = np.linalg.solve(A, np.einsum("ni,n->i", X, y))
    level = float(np.mean(y**2))
    std = math.sqrt(level * float(np.trace(np.linalg.inv(A))) / 2.0)
    return float(c @ A @ c) / level, float(np.hypot(*c)), std


# ---- cyclic error of the encoder ---------------------------------------------------------------------------------

SHORTEST, LONGEST = 2e-6, 5e-3
"""Periods of the scale that are looked for, m; the shortest is at least three counts."""
PERIODS = 64
"""Neighbouring periods over which the level of the spectrum is taken; rests at few places give a strong line side lobes
over all of them, so the level over sixteen times as many counts where it is lower."""
MOST_CELLS = 2**19
"""Cells of position; a longer travel raises the shortest period."""


def encoder_cyclic(seen: Residuals) -> ChannelFinding:
    """Error periodic in position (physics G2): a spectrum of the innovations over position, not time.

    The score of every period is one transform of the innovations, taken back through the filter, over cells of
    position; the best periods are taken again with exact columns of the replay. Null: twice the log-likelihood gained
    is chi-square with two degrees of freedom, times the number of periods looked at.
    """
    y, p = seen.readings, seen.smooth_position[seen.state.counts]
    p = p - p.min()
    travel = float(p.max())
    shortest = max(SHORTEST, 3.0 * seen.run.least_step, 12.0 * travel / MOST_CELLS)
    nothing = ChannelFinding("encoder_cyclic", 0.0, 1.0, 0.0, "m", math.inf, "the travel is too short to tell")
    if travel < 8.0 * shortest or len(y) < 256:
        return nothing
    cell = shortest / 6.0
    n = scipy.fft.next_fast_len(int(travel / cell) + 2 + int(0.25 * travel / cell), real=True)
    place = p / cell
    low = place.astype(np.intp)
    share = place - low
    wanted = backward(seen)
    cells = np.bincount(low, wanted * (1.0 - share), n) + np.bincount(low + 1, wanted * share, n)
    kappa = np.fft.rfftfreq(n, cell)
    rows = slice(*np.searchsorted(kappa, [max(1.0 / LONGEST, 4.0 / travel), 1.0 / shortest]))
    spectrum = np.abs(scipy.fft.rfft(cells)[rows]) ** 2
    if len(spectrum) < PERIODS:
        return nothing
    spectrum /= np.minimum(*(local_level(spectrum, several)[0] for several in (PERIODS, 16 * PERIODS)))
    best = (0.0, 0.0, 0.0, 0.0)
    step = float(kappa[1])
    tops = np.argsort(-spectrum)[:2]
    chance = len(spectrum) * np.exp(-spectrum[tops])
    for k in tops if chance[0] < 0.01 else tops[:1]:
        for shift in (-0.35, 0.0, 0.35) if chance[0] < 0.01 else (0.0,):
            trial = float(kappa[rows][k]) + shift * step
            best = max(best, cyclic_fit(seen, trial), key=lambda f: f[0])
    gained, amplitude, std, at = best
    p_value = min(1.0, len(spectrum) * math.exp(-0.5 * gained))
    found = p_value < ALARM
    text = f"the encoder errs by {amplitude * 1e6:.2g} um with a period of {1e6 / at:.4g} um" if found else "none found"
    parts = {"wavelength": 1.0 / at, "wavelength_std": 0.55 / (math.sqrt(max(gained, 1.0)) * travel * at**2)}
    return ChannelFinding("encoder_cyclic", gained, p_value, amplitude, "m", std, text, parts)


def backward(seen: Residuals) -> Array:
    """What the innovations ask of an error added to each reading: the steady filter, transposed, (m,)."""
    track, T = seen.state.track, seen.run.reading_step
    kp, kv = (float(np.median(track.series(name))) for name in ("gain_p", "gain_v"))
    F, K, H = np.array([[1.0, T], [0.0, 1.0]]), np.array([[kp], [kv]]), np.array([[1.0, 0.0]])
    b, a = scipy.signal.ss2tf(F @ (np.eye(2) - K @ H), F @ K, -H, np.eye(1))
    _, y, _ = reading_grid(seen)
    asked = scipy.signal.lfilter(b[0], a, y[::-1])[::-1]
    t = seen.run.t[seen.state.counts]
    return np.asarray(asked[np.rint((t - t[0]) / T).astype(np.intp)])


def cyclic_fit(seen: Residuals, kappa: float) -> tuple[float, float, float, float]:
    """Gain of twice the log-likelihood, amplitude, its standard deviation, and 1/period, by exact columns."""
    phase = 2.0 * np.pi * kappa * seen.smooth_position
    X = carried(seen, np.zeros((4, 0)), np.column_stack([np.cos(phase), np.sin(phase)]), seen.step)
    return (*pair_fit(X, seen.readings), kappa)


# ---- whatever has no name ----------------------------------------------------------------------------------------

LAGS = 5
"""Lags looked at on each scale of time."""


def whiteness(seen: Residuals) -> ChannelFinding:
    """Autocorrelation of the whitened innovations, at full rate and over ever longer block sums (Ljung and Box 1978).

    Each lag is scaled by its own sum of squared products, so that noise that comes and goes does not count as colour.
    Null: chi-square with five degrees of freedom on each scale, times the number of scales.
    """
    y = seen.readings
    scales: dict[int, tuple[float, float]] = {}
    length = 1
    while len(y) // length >= 4 * LEAST_BLOCKS:
        K = len(y) // length
        sums = y[: K * length].reshape(K, length).sum(axis=1)
        scales[length] = portmanteau(sums)
        length *= 4
    if not scales:
        return ChannelFinding("whiteness", 0.0, 1.0, 0.0, "", math.inf, "too few readings to tell")
    worst = min(scales, key=lambda k: scales[k][1])
    Q, p = scales[worst]
    p = min(1.0, p * len(scales))
    lag = worst * seen.run.reading_step
    first = float(np.mean(y[1:] * y[:-1]) / np.mean(y**2))
    text = f"innovations are correlated over {lag:.2g} s and longer" if p < ALARM else "the innovations are white"
    parts = {"scale": lag, **{f"p_{k}": value[1] for k, value in scales.items()}}
    return ChannelFinding("whiteness", Q, p, first, "", 1.0 / math.sqrt(len(y)), text, parts)


def portmanteau(y: Array) -> tuple[float, float]:
    """Sum of squared autocorrelations, each over its own variance, and its chance in white noise."""
    y = y - y.mean()
    Q = 0.0
    for lag in range(1, LAGS + 1):
        products = y[lag:] * y[:-lag]
        Q += float(products.sum()) ** 2 / max(float(np.sum(products**2)), 1e-300)
    return Q, float(scipy.special.gammaincc(0.5 * LAGS, 0.5 * Q))
