"""Colour of the innovations that no other test explains."""

from __future__ import annotations

import math

import numpy as np
import scipy

from accelcal.data import Array
from accelcal.diagnosis.noise_tests.noise_test import WHITENESS, NoiseTest
from accelcal.diagnosis.noise_tests.residuals import Residuals
from accelcal.diagnosis.policy import NOISE_TEST_ALPHA, NOISE_TEST_LEAST_BLOCKS, REPEATED_LEAST_SHARE

LAGS = 5
"""Lags on each time scale."""
MEMORIES = 2.0
"""Memories of the filter from which on sums of innovations are compared, behind a coarse encoder."""


def whiteness(residuals: Residuals) -> NoiseTest:
    """Autocorrelation of the whitened innovations, at full rate and over ever longer block sums (Ljung and Box 1978).

    Each lag is scaled by its own sum of squared products, so that noise of varying level does not count as colour.
    Null: chi-square with five degrees of freedom on each scale, times the number of scales.
    """
    if residuals.run.filters.colour(residuals.run.crossover(residuals.state.noise)):
        return NoiseTest(
            WHITENESS,
            0.0,
            1.0,
            0.0,
            "",
            math.inf,
            "declared filters colour the noise; whether it is white is not tested",
        )
    y, step = residuals.innovations
    scales: dict[int, tuple[float, float]] = {}
    length, least = 1, shortest_scale(residuals)
    while length < least:
        length *= 4
    while len(y) // length >= 4 * NOISE_TEST_LEAST_BLOCKS:
        K = len(y) // length
        sums = y[: K * length].reshape(K, length).sum(axis=1)
        scales[length] = portmanteau(sums)
        length *= 4
    if not scales:
        return NoiseTest(WHITENESS, 0.0, 1.0, 0.0, "", math.inf, "too few readings for this test")
    worst = min(scales, key=lambda k: scales[k][1])
    Q, p = scales[worst]
    p = min(1.0, p * len(scales))
    lag = worst * step
    first = float(np.mean(y[1:] * y[:-1]) / np.mean(y**2))
    text = (
        f"innovations are correlated over {lag:.2g} s and longer"
        if p < NOISE_TEST_ALPHA
        else "the innovations are white"
    )
    parts = {"scale": lag, **{f"p_{k}": value[1] for k, value in scales.items()}}
    return NoiseTest(WHITENESS, Q, p, first, "", 1.0 / math.sqrt(len(y)), text, parts)


def shortest_scale(residuals: Residuals) -> float:
    """Readings from which on colour is tested: 1, or more than the filter averages over where a coarse encoder repeats
    its counts while it moves. Its rounding errors then follow the position, and are white over longer times only."""
    run = residuals.run
    moving = np.count_nonzero(np.diff(run.z) == 0.0) / len(run.z) if run.rounding > 0.0 else 0.0
    if moving < REPEATED_LEAST_SHARE:
        return 1.0
    return MEMORIES / (2.0 * math.pi * run.crossover(residuals.state.noise) * run.reading_step)


def portmanteau(y: Array) -> tuple[float, float]:
    """Sum of squared autocorrelations, each over its own variance, and its probability in white noise."""
    y = y - y.mean()
    Q = 0.0
    for lag in range(1, LAGS + 1):
        products = y[lag:] * y[:-lag]
        Q += float(products.sum()) ** 2 / max(float(np.sum(products**2)), 1e-300)
    return Q, float(scipy.special.gammaincc(0.5 * LAGS, 0.5 * Q))
