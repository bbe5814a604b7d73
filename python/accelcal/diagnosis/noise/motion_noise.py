"""Noise that follows the motion: vibration, and jitter of the time stamps."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import Array, in_usual_unit
from accelcal.data.arrays import stretch_about
from accelcal.diagnosis.noise.counts import known_jitter
from accelcal.diagnosis.noise.noise_test import JITTER, VIBRATION, NoiseTest
from accelcal.diagnosis.noise.residuals import TAIL, BlockSpectra, Residuals, is_coarse, power_fit, power_trend_test
from accelcal.diagnosis.policy import (
    CLEAR_TAIL_RATIO,
    JITTER_BAND,
    JUMP_TAIL_RATIO,
    NOISE_TEST_ALPHA,
    NOISE_TEST_LEAST_BLOCKS,
    SEPARATE_POWER_ALPHA,
    VIBRATION_BIN_SIGMA,
)

BANDS = (1, 2, 4)
"""Bins of a block spectrum in one band of a vibration, next to all of them."""
FEWEST_BINS = 3
"""Bins outside a vibration that suffice to test for jitter."""
TESTED_BANDS = 6
"""Bands with the highest scores, whose probability is computed."""


def motion_noise(residuals: Residuals, lines: tuple[NoiseTest, ...]) -> tuple[NoiseTest, NoiseTest]:
    """Tests for vibration (power grows with v², v⁴ in some band) and for time-stamp jitter (white, with jerk²).

    Derivations 7.2. Block spectra are summed with the weights that suit each test: one band after the other for a
    vibration, the squared inverse of the noise for jitter, which is white while noise and vibration are not. The p
    value of each is that of the score of its own variable (`power_trend_test`), as long as its coefficient in power =
    s² + c1 v² + c2 v⁴ + c3 j² is significant given the other's. Where the record confounds the two (a single tone: j =
    -w² v), both are reported. Jumps of the motion reach into the band of jitter from below: it is judged with what they
    leave there taken off, and in the blocks that hold nothing but noise there, and its p value counts both.
    """
    spectra = residuals.short_spectra
    v2, v4, j2 = residuals.motion_blocks(spectra)
    blocked = len(spectra.f) <= FEWEST_BINS
    if len(v2) < NOISE_TEST_LEAST_BLOCKS or np.ptp(v2) == 0.0 or blocked:
        why = "the record is too short or has too little motion to test whether noise follows the motion"
        if blocked:
            why = "declared filters let no noise pass above the motion, so whether it follows the motion is not tested"
        return (
            NoiseTest(VIBRATION, 0.0, 1.0, 0.0, "m/s²", math.inf, why),
            NoiseTest(JITTER, 0.0, 1.0, 0.0, "s", math.inf, why),
        )
    floor = (
        0.3 * residuals.lsb**2 if is_coarse(residuals) else 0.0
    )  # below it power says how the motion crosses the steps
    design = np.column_stack([np.ones_like(v2), v2, v4, j2])
    band, z_speed, p_speed = strongest_band(spectra, (v2, v4), floor)
    in_band = np.maximum(spectra.power[:, band].mean(axis=1), floor)
    c, covariance = power_fit(in_band, design)
    p_speed_given_jerk = math.exp(-0.5 * float(c[1:3] @ np.linalg.solve(covariance[1:3, 1:3], c[1:3])))  # two degrees

    shaken = vibration_bins(spectra.power, v4, band) if p_speed < NOISE_TEST_ALPHA else slice(0, 0)
    every = spectra.power.mean(axis=0) ** -2.0
    high = spectra.f > JITTER_BAND * residuals.rate
    weights = outside(np.where(high, every, 0.0) if int(high.sum()) > FEWEST_BINS else every, shaken)
    every = outside(every, shaken)
    white = np.maximum(spectra.power @ (weights / weights.sum()), floor)
    judged = without_jumps(residuals, spectra, white, j2)
    p_jerk, z_jerk, which = min(
        (p, z, k) for k, (power, rows) in enumerate(judged) for z, p in [repeated_trend_test(power[rows], j2[rows])]
    )
    p_jerk = min(1.0, len(judged) * p_jerk)
    power, rows = judged[which]
    c, covariance = power_fit(power[rows], design[rows])
    p_jerk_given_speed = float(scipy.special.ndtr(-c[3] / math.sqrt(covariance[3, 3])))
    variance = known_jitter(residuals) ** 2
    if variance > 0.0:  # that noise grows with jerk is known: jitter is what exceeds the rounding of the stamps
        c, covariance = power_fit(white, design)
        z_jerk = (c[3] - variance) / math.sqrt(covariance[3, 3])
        p_jerk = max(p_jerk, float(scipy.special.ndtr(-z_jerk)))
        p_jerk_given_speed = max(p_jerk_given_speed, p_jerk)
    confounded = (
        max(p_speed, p_jerk) < NOISE_TEST_ALPHA and min(p_speed_given_jerk, p_jerk_given_speed) > SEPARATE_POWER_ALPHA
    )
    p_vibration, p_jitter = (
        p if confounded or given_other < SEPARATE_POWER_ALPHA else max(p, min(1.0, given_other))
        for p, given_other in ((p_speed, p_speed_given_jerk), (p_jerk, p_jerk_given_speed))
    )
    columns = design if p_vibration < NOISE_TEST_ALPHA else design[:, [0, 3]]
    c, covariance = power_fit(np.maximum(spectra.power @ (every / every.sum()), floor), columns)
    jitter, spread = amplitude_from_power(c[-1] - variance, covariance[-1, -1], 1.0)
    stamps = NoiseTest(
        JITTER,
        z_jerk,
        p_jitter,
        jitter,
        "s",
        spread,
        f"noise grows with jerk, as time-stamp jitter of {in_usual_unit(jitter, 's')} would cause"
        if p_jitter < NOISE_TEST_ALPHA
        else "noise does not grow with jerk",
        {"score": z_jerk, "blocks": float(len(v2))},
    )
    return vibration_test(
        residuals,
        lines,
        p_vibration,
        z_speed,
        band,
        math.hypot(jitter if p_jitter < NOISE_TEST_ALPHA else 0.0, math.sqrt(variance)),
    ), stamps


def repeated_trend_test(power: Array, x: Array) -> tuple[float, float]:
    """`power_trend_test` without the two neighbouring blocks that say most for a trend: one event is none."""
    most = int(np.argmax((x - x.mean()) * power))
    others = np.abs(np.arange(len(x)) - most) > 1
    return power_trend_test(power[others], x[others])


def pole_ratio(residuals: Residuals) -> float:
    """Power that the pole of a low-pass passes of a jump in the band of jitter, over that in the band `TAIL`."""
    if residuals.tau <= 0.0:
        return 1.0

    def passed(low: float, high: float) -> float:
        decay = math.exp(-residuals.step / residuals.tau)
        return float(np.mean(np.abs(1.0 - decay * np.exp(-2j * np.pi * np.linspace(low, high, 32))) ** -2.0))

    return passed(JITTER_BAND, 0.5) / passed(*TAIL)


def strongest_band(spectra: BlockSpectra, motions: tuple[Array, ...], floor: float) -> tuple[slice, float, float]:
    """Bins whose power follows one of the variables most significantly, the score, and its p value over all bands."""
    F = spectra.power.shape[1]
    bands = [slice(0, F)]
    for width in BANDS if floor == 0.0 else ():  # steps crossed in time with the motion have bands of their own
        bands += [slice(a, a + width) for a in range(F - width + 1)]
    sums = np.cumsum(np.pad(spectra.power / spectra.power.mean(axis=0), ((0, 0), (1, 0))), axis=1)
    least = floor / float(spectra.power.mean())

    def band_power(band: slice) -> Array:
        mean = (sums[:, band.stop] - sums[:, band.start]) / (band.stop - band.start)
        return np.asarray(np.maximum(mean, least))

    X = np.column_stack(motions)
    X = X - X.mean(axis=0)
    X /= np.linalg.norm(X, axis=0)
    score = np.array([y @ X / max(float(y.std()), 1e-300) for y in map(band_power, bands)])
    best = (1.0, -math.inf, bands[0])
    for which in np.argsort(-score, axis=None)[:TESTED_BANDS]:
        index, motion = np.unravel_index(which, score.shape)
        z, p = repeated_trend_test(band_power(bands[index]), motions[motion])
        best = min(best, (p, -z, bands[index]), key=lambda test: test[:2])
    return best[2], -best[1], min(1.0, best[0] * len(bands) * len(motions))


def outside(weights: Array, bins: slice) -> Array:
    """Weights of frequency bins, those of a vibration set to zero where enough others are left."""
    left = weights.copy()
    left[bins] = 0.0
    return left if np.count_nonzero(left) > FEWEST_BINS else weights


def without_jumps(
    residuals: Residuals, spectra: BlockSpectra, white: Array, j2: Array
) -> list[tuple[Array, NDArray[np.bool_]]]:
    """White power of blocks without what jumps of the motion leave in it, and the blocks that are judged, by both ways
    of the test for jitter: all less what jumps leave at most, and those that hold nothing but noise below its band.

    Parameters
    ----------
    residuals, spectra : the run and its block spectra.
    white, j2 : power in the band of jitter and mean square of the jerk, (K,) each.
    """
    tail = residuals.tail_blocks(spectra)
    leaked = JUMP_TAIL_RATIO * tail  # at most, of jumps that sampling does not resolve
    certain = np.maximum(white - leaked, 0.1 * float(np.median(white)))
    judged = [(certain, np.ones(len(tail), dtype=np.bool_))]
    clear = tail < CLEAR_TAIL_RATIO * float(np.median(tail))
    if np.count_nonzero(clear) >= NOISE_TEST_LEAST_BLOCKS and np.ptp(j2[clear]) > 0.0:
        leaked = JUMP_TAIL_RATIO * pole_ratio(residuals) * np.maximum(tail - np.median(tail), 0.0)
        judged.append((np.maximum(white - leaked, 0.1 * float(np.median(white))), clear))
    return judged


def vibration_bins(power: Array, v4: Array, band: slice) -> slice:
    """Bins about a band, as far as their power follows v⁴, and one more on either side that the window reaches."""
    x = v4 - v4.mean()
    score = x @ (power / power.mean(axis=0)) / math.sqrt(float(x @ x))  # the power of one bin is exponential
    follows = score > VIBRATION_BIN_SIGMA
    follows[band] = True
    low, high = stretch_about(follows, band.start)
    return slice(max(0, low - 1), high + 2)


def amplitude_from_power(c: float, variance: float, gain: float) -> tuple[float, float]:
    """Square root of a coefficient of power, and its standard deviation."""
    std = math.sqrt(variance)
    size = math.sqrt(max(c, 0.0)) * gain
    return size, 0.5 * std / max(c, std) * math.sqrt(max(c, std)) * gain


def vibration_test(
    residuals: Residuals,
    lines: tuple[NoiseTest, ...],
    p_value: float,
    score: float,
    band: slice,
    jitter: float,
) -> NoiseTest:
    """Result of the test for vibration: its amplitude at top speed, and its frequency."""
    spectra = residuals.short_spectra
    _, v4, j2 = residuals.motion_blocks(spectra)
    share = 1.0 - 2.3 * residuals.edge / residuals.rate  # of white noise that `background` holds
    power = spectra.means(residuals.background**2) - max(share, 0.0) * jitter**2 * j2
    power = np.maximum(power, 0.05 * float(np.median(power)))
    c, covariance = power_fit(power, np.column_stack([np.ones_like(v4), v4]))
    bins = vibration_bins(spectra.power, v4, band)
    line = next((f for f in lines if f.parts["follows_motion"] and f.p_value < NOISE_TEST_ALPHA), None)
    frequency = line.parts["frequency"] if line else strongest_frequency(residuals, spectra.f[band])
    ends = float(spectra.f[bins.start]), float(spectra.f[min(bins.stop, len(spectra.f)) - 1])
    size = c[1], covariance[1, 1]
    return speed_test(residuals, (score, p_value), frequency, ends, *size, len(v4), above=residuals.edge)


def speed_test(
    residuals: Residuals,
    significance: tuple[float, float],
    frequency: float,
    ends: tuple[float, float],
    c: float,
    variance: float,
    blocks: int,
    *,
    above: float | None = None,
) -> NoiseTest:
    """Result of a test for vibration in a band with `ends`, Hz, whose mean square is c v⁴ at the output.

    The band is `above` that of any motion, Hz; None where it is beside the tail of a motion.
    """
    score, p_value = significance
    top_speed = float(np.max(np.abs(residuals.motion[0])))
    gain = top_speed**2 / residuals.lowpass_gain(frequency)
    amplitude, spread = amplitude_from_power(2.0 * c, 4.0 * variance, gain)
    size = f"up to {amplitude:.2g} m/s² at {top_speed:.2g} m/s"
    text = f"noise near {frequency:.0f} Hz grows with speed and stands out of the tail of the motion: {size}"
    if above is not None:
        text = f"noise above {above:.0f} Hz grows with speed: {size}, strongest near {frequency:.0f} Hz"
    return NoiseTest(
        VIBRATION,
        score,
        p_value,
        amplitude,
        "m/s²",
        spread,
        text if p_value < NOISE_TEST_ALPHA else "noise does not grow with speed",
        {
            "frequency": frequency,
            "lowest": ends[0],
            "highest": ends[1],
            "top_speed": top_speed,
            "score": score,
            "blocks": float(blocks),
        },
    )


def strongest_frequency(residuals: Residuals, bins: Array) -> float:
    """Frequency within half a bin of `bins` (Hz) whose power follows v⁴ most closely."""
    fine, half = residuals.spectra, 0.5 * residuals.rate / len(residuals.short_spectra.window)
    x = fine.means((residuals.motion[0] ** 2) ** 2)
    within = (fine.f >= bins[0] - half) & (fine.f <= bins[-1] + half)
    return float(fine.f[np.argmax(np.where(within, (x - x.mean()) @ fine.power, -math.inf))])


def ranks(x: Array) -> Array:
    """Ranks of samples (n,) from 1 on; equal ones share the mean of theirs."""
    _, place, count = np.unique(x, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - 0.5 * (count - 1.0))[place])


def rank_correlation(x: Array, y: Array) -> tuple[float, float]:
    """Spearman's correlation, and the probability of one as large among independent series.

    The number of blocks is reduced by Bartlett's formula for two series that are both correlated in time.
    """
    a, b = (ranks(s) for s in (x, y))
    a, b = a - a.mean(), b - b.mean()
    scale = math.sqrt(float(a @ a) * float(b @ b))
    if scale == 0.0:
        return 0.0, 1.0
    rho = float(a @ b) / scale
    # What the two series have in common is no correlation in time of one of them: it is subtracted first.
    residual = a - (a @ b) / (b @ b) * b
    n, total = len(a), 0.0
    for lag in range(1, min(50, n // 8)):
        total += (
            float(residual[lag:] @ residual[:-lag])
            / float(residual @ residual)
            * float(b[lag:] @ b[:-lag])
            / float(b @ b)
        )
    effective = n / max(1.0, 1.0 + 2.0 * total)
    if effective < 5.0:
        return rho, 1.0
    t = rho * math.sqrt((effective - 2.0) / max(1.0 - rho**2, 1e-12))
    return rho, float(scipy.special.stdtr(effective - 2.0, -t))
