"""Spectra of the noise: lines at fixed frequencies, and bands above a spectrum that falls with frequency."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import Array
from accelcal.diagnosis.noise.motion_noise import BANDS, rank_correlation, speed_test, vibration_bins
from accelcal.diagnosis.noise.noise_test import LINE, NoiseTest
from accelcal.diagnosis.noise.residuals import (
    MIDDLE_BLOCKS,
    BlockSpectra,
    Residuals,
    high_passed,
    is_coarse,
    pearson_tail,
    power_fit,
)
from accelcal.diagnosis.policy import (
    COMB_HALF_WIDTH,
    COMB_POWER_RATIO,
    CONVERTER_LINE_SHARE,
    DRIVEN_LINE_RATIO,
    DRIVEN_LINE_SHARE,
    MOST_HARMONICS,
    MOTION_HARMONICS,
    MOTION_LINE_RATIO,
    NOISE_TEST_ALPHA,
    NOISE_TEST_LEAST_BLOCKS,
    PRESENT_SHARE,
    REPORTED_LINES,
)
from accelcal.effects import BUILT_IN, HARMONICS, Effect, find
from accelcal.estimation.columns import whitened_accelerations
from accelcal.signals.processing import Response
from accelcal.signals.signals import Signals

MOTION = ("p", "v", "a")
"""Variables whose nonlinear functions make harmonics of the motion."""
FEWEST_BINS = 64
"""Least number of bins from which a noise level is estimated."""
LEVEL_SPAN = 0.04
"""Share of the sampling rate over which the noise level counts as constant."""
GROUPS_PER_OCTAVE, LEAST_GROUP = 2, 8
"""Groups of bins to whose medians a level that falls with frequency is fitted, and the bins of the smallest."""
NEIGHBOURS = 1001
"""Bins of the periodogram over which its local level is estimated."""


def tones(residuals: Residuals) -> tuple[NoiseTest, ...]:
    """Tests for lines at fixed frequency: in the output above the band of the motion, in the whitened innovations up to
    twice the frequency at which its tail vanishes.

    Periodogram (Hann) over its local median, to which the tail of the motion belongs; the median of m correlated bins
    is worth m/4 exponential ones, so one bin exceeds x times the level with probability (1 + x/(m/4))^-(m/4), times the
    number of bins. `follows_motion` marks a line whose power follows speed: that is vibration.
    """
    t, y, rate = reading_grid(residuals)
    resolved = 4.0 / max(residuals.t[-1] - residuals.t[0], 1e-9)
    split = max(2.0 * residuals.reach, 0.25 * resolved)
    below, bins_below = spectral_peaks(y, rate, 0.0, min(split, 0.45 * rate)) if residuals.reads_position else ([], 0)
    beyond, bins_beyond = spectral_peaks(
        residuals.residual,
        residuals.rate,
        split,
        0.5 * residuals.rate,
        residuals.gain,
        residuals.least_gain,
        residuals.band,
    )
    bins = bins_below + bins_beyond
    peaks = [(min(1.0, p * bins), -ratio, f, True) for f, ratio, p in beyond]
    lines_above = [f for p, _, f, _ in peaks if p < NOISE_TEST_ALPHA]
    peaks += [
        (min(1.0, p * bins), -ratio, f, False)
        for f, ratio, p in below
        if all(abs(f - other) > resolved for other in lines_above)
    ]
    peaks.sort()
    significant = [candidate for candidate in peaks if candidate[0] < NOISE_TEST_ALPHA] or peaks[:1]
    of_output, of_readings = (residuals.t, residuals.residual, residuals.rate), (t, y, rate)
    tests = [
        tone_test(residuals, of_output if up else of_readings, f, -minus, p, up) for p, minus, f, up in significant
    ]
    return with_harmonics(tests, 0.25 * resolved)


def with_harmonics(tests: Sequence[NoiseTest], width: float) -> tuple[NoiseTest, ...]:
    """Tests for lines, the largest of them with the highest of its multiples that the others are.

    Lines that the motion makes, or that follow it, take no part. A multiple lies within half a `width`, Hz, of one turn
    over the record.
    """
    lines = [
        test
        for test in tests
        if test.p_value < NOISE_TEST_ALPHA and not test.parts["made_by_motion"] and not test.parts["follows_motion"]
    ]
    if not lines:
        return tuple(tests)
    largest = max(lines, key=lambda test: test.estimate)
    frequencies = np.array([test.parts["frequency"] for test in lines])
    multiples = np.arange(1, MOST_HARMONICS + 1)
    near = np.abs(frequencies[:, None] - multiples * largest.parts["frequency"]) < 0.5 * width
    highest = int(np.max(multiples[near.any(axis=0)]))
    grown = replace(largest, parts={**largest.parts, **({HARMONICS: float(highest)} if highest > 1 else {})})
    return tuple(grown if test is largest else test for test in tests)


def reading_grid(residuals: Residuals) -> tuple[Array, Array, float]:
    """Whitened innovations at uniform times, zero where no reading was taken."""
    step = residuals.run.reading_step
    t = residuals.run.t[residuals.state.counts]
    place = np.rint((t - t[0]) / step).astype(np.intp)
    y = np.zeros(int(place[-1]) + 1)
    y[place] = residuals.readings
    return t[0] + step * np.arange(len(y)), y, 1.0 / step


def spectral_peaks(
    y: Array,
    rate: float,
    low: float,
    high: float,
    gain: Response | None = None,
    least: float = 0.0,
    tail: float = math.inf,
) -> tuple[list[tuple[float, float, float]], int]:
    """Peaks of the periodogram between two frequencies, largest first: Hz, ratio to the level, probability for one bin.

    The shape that filters with a complex `gain` give to white noise is divided out first; frequencies
    with a gain below `least` are left out. From a frequency `tail` on the spectrum falls without a break: the level
    begins there, and lines count from where it follows the fall, half of what it is estimated from above.
    """
    n = len(y)
    if n < 256:
        return [], 0
    window = np.hanning(n)
    spectrum = np.abs(scipy.fft.rfft((y - y.mean()) * window, scipy.fft.next_fast_len(n, real=True))) ** 2
    f = np.asarray(np.fft.rfftfreq(scipy.fft.next_fast_len(n, real=True), 1.0 / rate), dtype=np.float64)
    rows = np.arange(*np.searchsorted(f, [max(min(low, tail), 8.0 * rate / n), high]))
    if gain is not None:
        shape = np.abs(gain(f))
        spectrum /= np.maximum(shape, max(least, 1e-150)) ** 2
        rows = rows[shape[rows] >= least]
    part = spectrum[rows]
    if len(part) < FEWEST_BINS:
        return [], 0
    level, m = local_level(part, max(FEWEST_BINS, min(NEIGHBOURS, int(LEVEL_SPAN * n))))
    first = slice(0, min(m, len(part)))  # where the level was taken to be constant from the lowest frequency on
    level[first] = np.maximum(level[first], falling_level(part[first], np.asarray(f[rows][first], dtype=np.float64)))
    tested = f[rows] >= min(low, f[rows[0]] + 0.5 * m * f[1])
    ratio = np.where(tested, part / level, 0.0)
    equivalent = m / 4.0
    chance = np.exp(-equivalent * np.log1p(ratio / equivalent))
    peaks: list[tuple[float, float, float]] = []
    neighbours = max(16, int(COMB_HALF_WIDTH * n / rate))
    for k in np.argsort(-ratio)[: 8 * REPORTED_LINES]:
        at = float(f[rows][k])
        if all(abs(at - other) > 4.0 * rate / n for other, _, _ in peaks) and is_single_line(
            part, level, int(k), neighbours
        ):
            i = int(rows[k])
            if 0 < i < len(spectrum) - 1:
                a, b, c = np.log(spectrum[i - 1 : i + 2] + 1e-300)
                curvature = a - 2.0 * b + c
                at += 0.5 * (a - c) / curvature * float(f[1]) if curvature < 0.0 else 0.0
            peaks.append((at, float(ratio[k]), float(chance[k])))
        if len(peaks) == REPORTED_LINES:
            break
    return peaks, int(np.count_nonzero(tested))


def is_single_line(part: Array, level: Array, k: int, neighbours: int) -> bool:
    """Whether a peak is more than one line of a comb, by the power of its neighbours beyond the noise, each at most its
    own.

    Noise alone adds up to such a power with the probability of six standard deviations.
    """
    rows = slice(max(0, k - neighbours), k + neighbours + 1)
    excess = np.minimum(part[rows], part[k]) - level[rows]
    window = slice(max(0, k - 4 - rows.start), k + 5 - rows.start)
    own_power = float(np.sum(excess[window]))
    other_power = float(np.sum(excess)) - own_power
    noise = 1.5 * level[k] * math.sqrt(len(excess))
    return bool(other_power < COMB_POWER_RATIO * own_power + 6.0 * noise)


def local_level(part: Array, m: int = NEIGHBOURS) -> tuple[Array, int]:
    """Mean of exponential bins from their local median over m bins, and the number of bins behind each."""
    m = min(m, len(part))
    K = max(1, len(part) // m)
    edges = np.linspace(0, len(part), K + 1).astype(int)
    medians = np.maximum(medians_between(part, edges) / math.log(2.0), 1e-300)
    centres = 0.5 * (edges[:-1] + edges[1:])
    # The spectrum may fall steeply between blocks (RC, whitening): follow it by straight lines of its logarithm.
    return np.exp(np.interp(np.arange(len(part)), centres, np.log(medians))), m


def falling_level(part: Array, f: Array) -> Array:
    """Mean of exponential bins at frequencies `f` whose level may fall as 1/f or 1/f² to a constant, (n,).

    Fitted to the medians of neighbouring bins, the more of them the higher the frequency, so that no line counts.
    """
    edges = np.unique(np.geomspace(1, len(part), int(GROUPS_PER_OCTAVE * math.log2(len(part))) + 1).astype(np.intp)) - 1
    edges = edges[np.concatenate([[True], np.diff(edges) >= LEAST_GROUP])]
    edges[0], edges[-1] = 0, len(part)
    if len(edges) < 5:
        return np.zeros(len(part))
    medians = medians_between(part, edges) / math.log(2.0)
    centres = np.sqrt(f[edges[:-1]] * f[edges[1:] - 1])
    powers = np.arange(3.0)
    c, _ = power_fit(medians, (centres[:, None] / f[0]) ** -powers)
    return np.asarray((f[:, None] / f[0]) ** -powers @ c)


def medians_between(y: Array, edges: NDArray[np.intp]) -> Array:
    """Median of each stretch of a series between neighbouring edges, (len(edges) - 1,)."""
    length = np.diff(edges)
    medians = np.empty(len(length))
    for stretch in np.unique(length):
        equal = length == stretch
        medians[equal] = np.median(y[edges[:-1][equal][:, None] + np.arange(stretch)], axis=1)
    return medians


def tone_test(
    residuals: Residuals,
    data: tuple[Array, Array, float],
    frequency: float,
    ratio: float,
    p_value: float,
    of_output: bool,
) -> NoiseTest:
    """Amplitude of one line at the sensor, and whether its power follows speed."""
    t, y, rate = data
    demodulated = -2j * np.pi * frequency * (t - t[0])
    np.exp(demodulated, out=demodulated)
    demodulated *= y
    if of_output:
        amplitude = 2.0 * abs(complex(np.mean(demodulated))) / residuals.lowpass_gain(frequency)
        std = amplitude / math.sqrt(
            2.0 * max(ratio, 1e-9) / 1.5
        )  # Hann: the ratio of a line to the noise is 1.5 times lower
    else:
        amplitude, std = fitted_amplitude(residuals, frequency)
        if p_value < NOISE_TEST_ALPHA and output_lacks(residuals, frequency, amplitude):
            p_value = 1.0  # it is the position's
    length = max(1, int(0.1 * rate))
    K = len(y) // length
    amplitudes = demodulated[: K * length].reshape(K, length).mean(axis=1)
    del demodulated
    speed = np.mean(np.interp(t[: K * length], residuals.t, residuals.motion[0]).reshape(K, length) ** 2, axis=1)
    follows = False
    if K >= NOISE_TEST_LEAST_BLOCKS and p_value < NOISE_TEST_ALPHA and np.ptp(speed) > 0.0:
        at_rest = abs(complex(np.mean(amplitudes[speed <= np.quantile(speed, 0.4)])))
        fades = at_rest < 0.5 * abs(complex(np.mean(amplitudes)))
        follows = fades and rank_correlation(np.abs(amplitudes) ** 2, speed)[1] < NOISE_TEST_ALPHA
    if is_coarse(residuals) and amplitude * residuals.lowpass_gain(frequency) < CONVERTER_LINE_SHARE * residuals.lsb:
        p_value = 1.0  # steps crossed by a periodic motion make lines of their own
    span = float(t[-1] - t[0])
    within_motion = frequency < MOTION_HARMONICS * residuals.reach
    parts = {
        "frequency": float(frequency),
        "frequency_std": math.sqrt(12.0) / (2.0 * math.pi * span) * std / max(amplitude, 1e-300),
        "follows_motion": float(follows),
        "within_motion": float(within_motion),
        "made_by_motion": float(
            p_value < NOISE_TEST_ALPHA and motion_makes_lines(residuals.signals, frequency, amplitude)
        ),
    }
    text = f"a line of {amplitude:.2g} m/s² at {frequency:.4g} Hz" if p_value < NOISE_TEST_ALPHA else "no spectral line"
    return NoiseTest(LINE, ratio, p_value, amplitude, "m/s²", std, text, parts)


def output_lacks(residuals: Residuals, frequency: float, amplitude: float) -> bool:
    """Whether the output itself has no line of such an amplitude at the sensor, m/s².

    The smoothed motion follows the output above the crossover, so that innovations do not tell whose line it is: steps
    of a coarse encoder, crossed at the constant speed of a move, make lines of their own. Where the motion is as strong
    as the line at that frequency, nothing is excluded.
    """
    t, u = residuals.t_u, residuals.u
    window = np.hanning(len(t))
    bins = np.concatenate([[0.0], np.arange(3.0, 20.0), -np.arange(3.0, 20.0)]) / (t[-1] - t[0])
    weights = window * (u - np.mean(u)) * (2.0 / np.sum(window))
    around = np.abs([np.sum(weights * np.exp(-2j * np.pi * (frequency + f) * t)) for f in bins])
    around /= residuals.lowpass_gain(frequency)
    return bool(np.max(around) < PRESENT_SHARE * amplitude)


def motion_makes_lines(s: Signals, frequency: float, amplitude: float) -> bool:
    """Whether a motion makes lines at a frequency, so that a missing nonlinearity would show as a tone there.

    The smoothed motion contains a part of any line of the output. Where it contains little more than that, the line is
    subtracted first, or it would pass for its own cause.
    """
    omega = 2j * np.pi * frequency
    has_line = line_detector(s, frequency)
    wave = np.exp(omega * s.t)
    window = np.hanning(len(s.t))
    line = 2.0 * np.sum(s.a * window * np.conj(wave)) / np.sum(window)
    if abs(line) > MOTION_LINE_RATIO * amplitude:
        if has_line(s.a):
            return True
        line = 0.0
    a, v, p = (y - np.real(line * wave / omega**k) for k, y in enumerate((s.a, s.v, s.p)))
    directions = (np.where(np.abs(y) > 2.0 * w, np.sign(y), 0.0) for y, w in ((a, s.a_width), (v, s.v_width)))
    return any(has_line(function) for function in (a**2, a**3, np.abs(a), v**2, p**2, *directions))


def line_detector(s: Signals, frequency: float) -> Callable[[Array], bool]:
    """What says whether a function of the motion, (n,), has a line at a frequency, Hz."""
    window, omega = np.hanning(len(s.t)), 2j * np.pi * frequency
    peak_bins, neighbours = np.arange(-2, 3) / 2.0, np.concatenate([np.arange(-24, -3), np.arange(4, 25)])
    phasors = np.exp(-(omega + 2j * np.pi * np.concatenate([peak_bins, neighbours])[:, None] / s.length) * s.t) * window

    def has_line(function: Array) -> bool:
        power = np.abs(phasors @ (function - np.mean(function))) ** 2
        top = float(np.max(power[: len(peak_bins)]))
        share = 2.0 * top / np.sum(window) ** 2 / max(float(np.var(function)), 1e-300)
        return bool(top > DRIVEN_LINE_RATIO * np.median(power[len(peak_bins) :]) and share > DRIVEN_LINE_SHARE)

    return has_line


def harmonic_effects(s: Signals, frequency: float) -> tuple[str, ...]:
    """Effects that are functions of position, velocity or acceleration and make a line at a frequency, Hz, from a
    motion.

    A line there is confounded with each of them.
    """
    has_line = line_detector(s, frequency)
    names = [name for e in BUILT_IN if e.function_of in MOTION for name in e.covers]
    effects = [e for e in (find(name) for name in names) if e.port in ("output", "position") and not e.needs]

    def column(effect: Effect) -> Array:
        shape = {name: float(np.median(declared.grid(s))) for name, declared in effect.shapes.items()}
        columns = effect.column(s, **shape).reshape(len(s.t), -1)
        return np.asarray(columns @ np.ones(columns.shape[1]))

    return tuple(effect.name for effect in effects if has_line(column(effect)))


def fitted_amplitude(residuals: Residuals, frequency: float) -> tuple[float, float]:
    """Amplitude of a line at the output and its standard deviation, by exact columns of the replay, m/s²."""
    samples = int((residuals.run.t[-1] - residuals.run.t[0]) / residuals.step) + 4
    phase = 2.0 * np.pi * frequency * np.arange(samples) * residuals.step
    scale = residuals.state.values.scale
    X = whitened_accelerations(residuals.state, [np.cos(phase) / scale, np.sin(phase) / scale], residuals.step)
    _, amplitude, std = pair_fit(X, residuals.readings)
    return amplitude, std


def pair_fit(X: Array, y: Array) -> tuple[float, float, float]:
    """Twice the log-likelihood that two columns gain, length of their coefficients, and its standard deviation."""
    A = np.einsum("ni,nj->ij", X, X)  # tall and thin: starting threads would cost more than they save
    A += 1e-12 * np.trace(A) * np.eye(2)
    c = np.linalg.solve(A, np.einsum("ni,n->i", X, y))
    level = float(np.mean(y**2))
    std = math.sqrt(level * float(np.trace(np.linalg.inv(A))) / 2.0)
    return float(c @ A @ c) / level, float(np.hypot(*c)), std


APART = 3
"""Bins from a band down to those that it is compared with: its window reaches two."""
BELOW = 3
"""Bins that it is compared with: one alone may be where two kinks cancel."""
TOGETHER = 8
"""Neighbouring blocks whose scatter is taken together: what disturbs several is one event."""
SCATTER = 1.6
"""Variance of a bin of exponential power less the mean of three others, in squares of their level."""


def vibration(residuals: Residuals, lines: Sequence[NoiseTest], above: NoiseTest) -> NoiseTest:
    """What tells most of a vibration: the test `above` any motion, that beside its tail, or a line that follows speed.

    The first two are two tests of one record, and the probability counts both; where both are significant, they see
    parts of one band, and the larger part is given. The line is one of the test for lines.
    """
    beside = beside_motion(residuals)
    tests = [replace(test, p_value=min(1.0, 2.0 * test.p_value)) for test in (above, beside) if test is not None]
    significant = [test for test in tests if test.p_value < NOISE_TEST_ALPHA]
    if significant:
        return max(significant, key=lambda test: test.estimate)
    of_lines = [
        line_vibration(residuals, line)
        for line in lines
        if line.parts["follows_motion"]
        and not line.parts["made_by_motion"]
        and line.parts["frequency"] > residuals.band
    ]
    return min((*tests, *of_lines), key=lambda test: test.p_value)


def beside_motion(residuals: Residuals) -> NoiseTest | None:
    """Test for vibration where the tail of the motion is not yet below the noise; None where nothing is left to test.

    Power of a motion falls with frequency: what it adds to a band, in units of the noise there, is between nothing and
    what it adds to bins below. So must a vibration grow with v² or v⁴ both as it is and with the bins below subtracted,
    or kinks that go with speed would pass for one, and kinks where the stage rests for its absence. Jitter and coarse
    steps are white: what goes with the jerk is left out, and a coarse converter is not tested. Derivations 7.2.
    """
    spectra = falling_spectra(residuals)
    bins = len(spectra.f)
    if len(spectra.power) < NOISE_TEST_LEAST_BLOCKS or bins < BELOW + APART or is_coarse(residuals):
        return None
    v2, v4, j2 = residuals.motion_blocks(spectra)
    relative = spectra.power / np.maximum(np.median(spectra.power, axis=0) / math.log(2.0), 1e-300)
    bands = [slice(a, a + width) for width in BANDS for a in range(BELOW + APART - 1, bins - width + 1)]
    tests = []
    for band in bands:
        inside = relative[:, band].mean(axis=1)
        below = relative[:, below_band(band)].mean(axis=1)
        y, level = np.column_stack([inside, inside - below]), np.maximum(below, 1.0)[:, None]
        for x in (v2, v4):
            z, p = excess_trend_test(y, level, x, j2)
            tests.append((float(p.max()), -float(z.min()), band))
    p_value, minus_z, band = min(tests, key=lambda test: test[:2])
    significance = -minus_z, min(1.0, len(tests) * p_value)
    lowest = below_band(band).stop
    near = spectra.power[:, lowest:]
    occupied = vibration_bins(near, v4, slice(band.start - lowest, band.stop - lowest))
    power = 2.0 / len(spectra.window) * near[:, occupied].sum(axis=1)
    tail = spectra.power[:, below_band(band)].mean(axis=1)
    c, covariance = power_fit(power, np.column_stack([np.ones_like(v4), v4, tail]))
    f = spectra.f[lowest:][occupied]
    share = np.maximum((v4 - v4.mean()) @ near[:, occupied], 0.0)
    frequency = float(f @ share / max(float(share.sum()), 1e-300))
    return speed_test(residuals, significance, frequency, (float(f[0]), float(f[-1])), c[1], covariance[1, 1], len(v4))


def below_band(band: slice) -> slice:
    """Bins that a band is compared with."""
    end = band.start - APART + 1
    return slice(end - BELOW, end)


def line_vibration(residuals: Residuals, line: NoiseTest) -> NoiseTest:
    """A spectral line of the output whose power follows speed, as a vibration."""
    f, half = line.parts["frequency"], 0.5 * residuals.rate / len(MIDDLE_BLOCKS)
    demodulated = residuals.residual * np.exp(-2j * np.pi * f * residuals.t)
    length = len(MIDDLE_BLOCKS)
    wave, v4 = (
        y[: len(y) // length * length].reshape(-1, length).mean(axis=1) for y in (demodulated, residuals.motion[0] ** 4)
    )
    c, covariance = power_fit(2.0 * np.abs(wave) ** 2, np.column_stack([np.ones_like(v4), v4]))
    significance = line.statistic, line.p_value
    return speed_test(residuals, significance, f, (f - half, f + half), c[1], covariance[1, 1], len(v4))


def falling_spectra(residuals: Residuals) -> BlockSpectra:
    """Power of the output in blocks, from the band of the motion up to where `background` begins."""
    y = high_passed(residuals.residual, residuals.rate, residuals.band / 1.3)
    spectra = BlockSpectra.of(y, residuals.sampled, residuals.rate, residuals.band, MIDDLE_BLOCKS)
    return residuals.passed(spectra, highest=1.3 * residuals.edge)


def excess_trend_test(y: Array, level: Array, x: Array, beside: Array) -> tuple[Array, Array]:
    """Tests whether what blocks hold, positive or not, grows with a variable: scores, and their probabilities.

    Parameters
    ----------
    y, level : (K, m) blocks of m series, and the mean of exponential powers that each holds under the null.
    x, beside : (K,) the variable, and another one that it may not stand for.

    Notes
    -----
    The variance of the score is that of the levels or, where that is more, that of sums over `TOGETHER` blocks about
    the fitted line, each as it would be if it had not been fitted (MacKinnon, White 1985, HC3). Its skewness and tail
    are as in `power_trend_test`.
    """
    x = x / max(float(x.max()), 1e-300)
    X = np.column_stack([np.ones_like(x), beside / max(float(beside.max()), 1e-300), x])
    Q, R = np.linalg.qr(X)
    if abs(R[2, 2]) <= 1e-3 * float(np.linalg.norm(x)):
        return np.zeros(y.shape[1]), np.ones(y.shape[1])
    left = Q[:, 2:] * np.sign(R[2, 2])
    residual = (y - Q @ (Q.T @ y)) / np.maximum(1.0 - np.sum(Q**2, axis=1, keepdims=True), 1e-3)
    groups = np.arange(0, len(x), TOGETHER)
    expected = np.add.reduceat(left**2 * SCATTER * level**2, groups, axis=0)
    variance = np.maximum(np.add.reduceat(left * residual, groups, axis=0) ** 2, expected).sum(axis=0)
    z = (left * y).sum(axis=0) / np.sqrt(variance)
    skew = 2.0 * np.maximum((left * level) ** 3, 0.0).sum(axis=0) / variance**1.5
    return z, pearson_tail(z, skew)
