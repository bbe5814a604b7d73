"""Noise that follows the motion: vibration, and jitter of the stamps."""

from __future__ import annotations

import math

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.diagnosis.noise_tests.block_spectra import BlockSpectra, power_fit, power_trend_test
from accelcal.diagnosis.noise_tests.noise_test import JITTER, VIBRATION, NoiseTest
from accelcal.diagnosis.noise_tests.residuals import Residuals, coarse
from accelcal.diagnosis.policy import (
    NOISE_TEST_ALPHA,
    NOISE_TEST_LEAST_BLOCKS,
    SEPARATE_POWER_ALPHA,
    VIBRATION_BIN_SIGMA,
)

BANDS = (1, 2, 4)
"""Bins of a block spectrum that one band of a vibration spans, besides all."""
FEWEST_BINS = 3
"""Bins beside a vibration that show whether the noise is jitter."""
CLOSE_LOOKS = 6
"""Bands that seem loudest, whose chance is worked out."""


def motion_noise(seen: Residuals, lines: tuple[NoiseTest, ...]) -> tuple[NoiseTest, NoiseTest]:
    """Vibration (power grows with v², v⁴ in some band) and jitter of stamps (white, with jerk²), derivations 7.2.

    Block spectra are summed with the weights that suit each: one band after the other for a vibration, the squared
    inverse of the noise for jitter, which is white while noise and vibration are not. The chance of each is that of
    the score of its own variable (`power_trend_test`), as long as its coefficient in
    power = s² + c1 v² + c2 v⁴ + c3 j² stands beside the other's. Where the record cannot tell the two apart (a single
    tone: j = -w² v), both are told of.
    """
    spectra = seen.brief
    v2, v4, j2 = seen.motion_blocks(spectra)
    if len(v2) < NOISE_TEST_LEAST_BLOCKS or np.ptp(v2) == 0.0:
        nothing = ("the record is too short or too still to say whether noise follows the motion", 0.0, 1.0)
        return (
            NoiseTest(VIBRATION, nothing[1], nothing[2], 0.0, "m/s²", math.inf, nothing[0]),
            NoiseTest(JITTER, nothing[1], nothing[2], 0.0, "s", math.inf, nothing[0]),
        )
    floor = 0.3 * seen.lsb**2 if coarse(seen) else 0.0  # below it power says how the motion crosses the steps
    everything = np.column_stack([np.ones_like(v2), v2, v4, j2])
    band, z_speed, p_speed = loudest_band(spectra, (v2, v4), floor)
    in_band = np.maximum(spectra.power[:, band].mean(axis=1), floor)
    c, covariance = power_fit(in_band, everything)
    alone_speed = math.exp(-0.5 * float(c[1:3] @ np.linalg.solve(covariance[1:3, 1:3], c[1:3])))  # two degrees

    weights = spectra.power.mean(axis=0) ** -2.0
    if p_speed < NOISE_TEST_ALPHA:
        skirts = shaken(spectra.power, v4, band)
        if skirts.stop - skirts.start < len(weights) - FEWEST_BINS:
            weights[skirts] = 0.0
    white = np.maximum(spectra.power @ (weights / weights.sum()), floor)
    z_jerk, p_jerk = power_trend_test(white, j2)
    c, covariance = power_fit(white, everything)
    alone_jerk = float(scipy.special.ndtr(-c[3] / math.sqrt(covariance[3, 3])))
    inseparable = max(p_speed, p_jerk) < NOISE_TEST_ALPHA and min(alone_speed, alone_jerk) > SEPARATE_POWER_ALPHA
    p_vibration, p_jitter = (
        p if inseparable or alone < SEPARATE_POWER_ALPHA else max(p, min(1.0, alone))
        for p, alone in ((p_speed, alone_speed), (p_jerk, alone_jerk))
    )
    beside = everything if p_vibration < NOISE_TEST_ALPHA else everything[:, [0, 3]]
    c, covariance = power_fit(white, beside)
    jitter, spread = rooted(c[-1], covariance[-1, -1], 1.0)
    stamps = NoiseTest(
        JITTER,
        z_jerk,
        p_jitter,
        jitter,
        "s",
        spread,
        f"noise grows with jerk as stamps uncertain by {jitter * 1e6:.3g} us would make it"
        if p_jitter < NOISE_TEST_ALPHA
        else "noise does not grow with jerk",
        {"score": z_jerk, "blocks": float(len(v2))},
    )
    return vibration_found(
        seen, lines, p_vibration, z_speed, band, jitter if p_jitter < NOISE_TEST_ALPHA else 0.0
    ), stamps


def loudest_band(spectra: BlockSpectra, motions: tuple[Array, ...], floor: float) -> tuple[slice, float, float]:
    """Bins whose power follows one of the variables most surely, the score, and its chance, all bands included."""
    F = spectra.power.shape[1]
    bands = [slice(0, F)]
    for width in BANDS if floor == 0.0 else ():  # steps crossed in time with the motion have bands of their own
        bands += [slice(a, a + width) for a in range(F - width + 1)]
    sums = np.cumsum(np.pad(spectra.power / spectra.power.mean(axis=0), ((0, 0), (1, 0))), axis=1)
    least = floor / float(spectra.power.mean())

    def loudness(band: slice) -> Array:
        mean = (sums[:, band.stop] - sums[:, band.start]) / (band.stop - band.start)
        return np.asarray(np.maximum(mean, least))

    X = np.column_stack(motions)
    X = X - X.mean(axis=0)
    X /= np.linalg.norm(X, axis=0)
    seem = np.array([y @ X / max(float(y.std()), 1e-300) for y in map(loudness, bands)])
    best = (1.0, -math.inf, bands[0])
    for which in np.argsort(-seem, axis=None)[:CLOSE_LOOKS]:
        at, motion = np.unravel_index(which, seem.shape)
        z, p = power_trend_test(loudness(bands[at]), motions[motion])
        best = min(best, (p, -z, bands[at]), key=lambda one: one[:2])
    return best[2], -best[1], min(1.0, best[0] * len(bands) * len(motions))


def shaken(power: Array, v4: Array, band: slice) -> slice:
    """Bins about a band, as far as their power follows v⁴, and the one behind that its window reaches."""
    x = v4 - v4.mean()
    score = x @ (power / power.mean(axis=0)) / math.sqrt(float(x @ x))  # the power of one bin is exponential
    low, high = band.start, band.stop
    while low > 0 and score[low - 1] > VIBRATION_BIN_SIGMA:
        low -= 1
    while high < len(score) and score[high] > VIBRATION_BIN_SIGMA:
        high += 1
    return slice(max(0, low - 1), high + 1)


def rooted(c: float, variance: float, gain: float) -> tuple[float, float]:
    """Square root of a coefficient of power, and its standard deviation."""
    std = math.sqrt(variance)
    size = math.sqrt(max(c, 0.0)) * gain
    return size, 0.5 * std / max(c, std) * math.sqrt(max(c, std)) * gain


def vibration_found(
    seen: Residuals,
    lines: tuple[NoiseTest, ...],
    p_value: float,
    score: float,
    band: slice,
    jitter: float,
) -> NoiseTest:
    """What the test of vibration says: how loud at top speed, and where."""
    spectra = seen.brief
    _, v4, j2 = seen.motion_blocks(spectra)
    share = 1.0 - 2.3 * seen.edge / seen.rate  # of white noise that `background` holds
    power = spectra.means(seen.background**2) - max(share, 0.0) * jitter**2 * j2
    power = np.maximum(power, 0.05 * float(np.median(power)))
    c, covariance = power_fit(power, np.column_stack([np.ones_like(v4), v4]))
    top = float(np.max(np.abs(seen.motion[0])))
    about = shaken(spectra.power, v4, band)
    line = next((f for f in lines if f.parts["follows_motion"] and f.p_value < NOISE_TEST_ALPHA), None)
    frequency = line.parts["frequency"] if line else loudest_at(seen, spectra.f[band])
    gain = top**2 / seen.rc_gain(frequency)
    amplitude, spread = rooted(2.0 * c[1], 4.0 * covariance[1, 1], gain)
    return NoiseTest(
        VIBRATION,
        score,
        p_value,
        amplitude,
        "m/s²",
        spread,
        f"noise above {seen.edge:.0f} Hz grows with speed: up to {amplitude:.2g} m/s² at {top:.2g} m/s, "
        f"strongest near {frequency:.0f} Hz"
        if p_value < NOISE_TEST_ALPHA
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


def loudest_at(seen: Residuals, bins: Array) -> float:
    """Frequency within half a bin of `bins` (Hz) whose power follows v⁴ most."""
    fine, half = seen.spectra, 0.5 * seen.rate / len(seen.brief.window)
    x = fine.means((seen.motion[0] ** 2) ** 2)
    within = (fine.f >= bins[0] - half) & (fine.f <= bins[-1] + half)
    return float(fine.f[np.argmax(np.where(within, (x - x.mean()) @ fine.power, -math.inf))])


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
