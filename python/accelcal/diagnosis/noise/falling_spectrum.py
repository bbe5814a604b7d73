"""Vibration beside the tail of a motion: a band that stands out of a spectrum which falls with frequency."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from accelcal.data import Array
from accelcal.diagnosis.noise.motion_noise import BANDS, amplitude_from_power, vibration_bins
from accelcal.diagnosis.noise.noise_test import VIBRATION, NoiseTest
from accelcal.diagnosis.noise.residuals import (
    MIDDLE_BLOCKS,
    BlockSpectra,
    Residuals,
    high_passed,
    is_coarse,
    pearson_tail,
    power_fit,
)
from accelcal.diagnosis.policy import NOISE_TEST_ALPHA, NOISE_TEST_LEAST_BLOCKS

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


def speed_test(
    residuals: Residuals,
    significance: tuple[float, float],
    frequency: float,
    ends: tuple[float, float],
    c: float,
    variance: float,
    blocks: int,
) -> NoiseTest:
    """Result of a test for vibration in a band with `ends`, Hz, whose mean square is c v⁴ at the output."""
    score, p_value = significance
    top_speed = float(np.max(np.abs(residuals.motion[0])))
    gain = top_speed**2 / residuals.lowpass_gain(frequency)
    amplitude, spread = amplitude_from_power(2.0 * c, 4.0 * variance, gain)
    return NoiseTest(
        VIBRATION,
        score,
        p_value,
        amplitude,
        "m/s²",
        spread,
        f"noise near {frequency:.0f} Hz grows with speed and stands out of the tail of the motion: up to "
        f"{amplitude:.2g} m/s² at {top_speed:.2g} m/s"
        if p_value < NOISE_TEST_ALPHA
        else "noise does not grow with speed",
        {
            "frequency": frequency,
            "lowest": ends[0],
            "highest": ends[1],
            "top_speed": top_speed,
            "score": score,
            "blocks": float(blocks),
        },
    )


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
