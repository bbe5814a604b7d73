"""Power spectra of short blocks of a record, and tests whether power follows the motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import Array

LONG_BLOCKS: Array = scipy.signal.windows.blackmanharris(128, sym=False)
"""Window of blocks that resolve colour: it suppresses a line 90 dB stronger at 100 Hz distance, at a few kHz."""
SHORT_BLOCKS: Array = scipy.signal.windows.hann(32, sym=False)
"""Window of blocks that resolve the peaks of a move's speed; for series without strong lines below them."""
MIDDLE_BLOCKS: Array = scipy.signal.windows.hann(64, sym=False)
"""Window of blocks between the two, which tells a band from one three bins below it."""
BATCH = 4096
"""Blocks transformed at a time."""
MOST_LAGS = 200
"""Blocks over which the scatter may be correlated."""


@dataclass(frozen=True, slots=True)
class BlockSpectra:
    """Power of short blocks at each frequency, in the unit of the series squared: white noise has its variance.

    Blocks overlap by half; with both windows such blocks are nearly independent.
    """

    f: Array
    """(F,) Hz"""
    power: Array
    """(K, F)"""
    kept: NDArray[np.bool_]
    """(all blocks,) whether a block holds enough samples to be among the K."""
    window: Array

    @classmethod
    def of(
        cls, y: Array, sampled: NDArray[np.bool_], rate: float, low: float, window: Array = LONG_BLOCKS
    ) -> BlockSpectra:
        """Blocks of a uniform series `y` (n,), frequencies from `low` on; `sampled` (n,) marks what was measured."""
        n = len(window)
        f = np.asarray(np.fft.rfftfreq(n, 1.0 / rate), dtype=np.float64)
        rows = slice(int(np.searchsorted(f, low)), len(f) - 1)
        kept = _block_means(sampled.astype(np.float64), window) > 0.7
        if len(y) < n:
            return cls(f[rows], np.zeros((0, len(f[rows]))), kept, window)
        blocks = np.lib.stride_tricks.sliding_window_view(y, n)[:: n // 2]
        weight = window / math.sqrt(float(window @ window))
        power = np.empty((int(np.sum(kept)), len(f[rows])))
        filled = 0
        for begin in range(0, len(blocks), BATCH):
            part = blocks[begin : begin + BATCH][kept[begin : begin + BATCH]]
            transform = scipy.fft.rfft(part * weight, axis=1)[:, rows]
            power[filled : filled + len(part)] = transform.real**2 + transform.imag**2
            filled += len(part)
        return cls(f[rows], power, kept, window)

    def means(self, x: Array) -> Array:
        """Mean of a uniform series (n,) over each block that is kept, weighted as its power is, (K,)."""
        return _block_means(x, self.window)[self.kept]


def _block_means(x: Array, window: Array) -> Array:
    n = len(window)
    if len(x) < n:
        return np.zeros(0)
    weight = window**2 / float(window @ window)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(x, n)[:: n // 2] @ weight)


def power_trend_test(power: Array, x: Array) -> tuple[float, float]:
    """Test whether the power of blocks grows with a variable: standardised score, and its probability under the null.

    Parameters
    ----------
    power, x : (K,), both not negative.

    Notes
    -----
    Score of x in power = c0 + c1 x at c1 = 0, one-sided. Its spread is that of the residual from the fitted line,
    correlation from block to block included (Bartlett). The few blocks in which x is large make it skew, and a gamma
    distribution with the same three cumulants (Pearson's type III) gives the tail.
    """
    largest = float(np.max(x, initial=0.0))
    if not 0.0 < largest < math.inf:
        return 0.0, 1.0
    x = x / largest  # the fourth power of a motion that a model sends astray has a cube beyond every number
    deviation = x - x.mean()
    total = float(deviation @ deviation)
    if total <= 0.0:
        return 0.0, 1.0
    c, _ = power_fit(power, np.column_stack([np.ones_like(x), x]))
    residual = power / np.maximum(c[0] + c[1] * x, 0.05 * float(np.median(power)) + 1e-300) - 1.0
    scatter = max(float(np.mean(residual**2)), 1e-12)
    correlation = 0.0
    for lag in range(1, min(MOST_LAGS, len(x) // 8)):
        lag_correlation = float(deviation[lag:] @ deviation[:-lag]) / total
        correlation += lag_correlation * float(residual[lag:] @ residual[:-lag]) / (len(residual) * scatter)
    scatter *= max(1.0, 1.0 + 2.0 * correlation)
    z = float(deviation @ (power / power.mean())) / math.sqrt(scatter * total)
    return z, float(pearson_tail(z, 2.0 * math.sqrt(scatter) * float(np.sum(deviation**3)) / total**1.5))


def pearson_tail(z: float | Array, skew: float | Array) -> Array:
    """Probability of a larger standardised value under Pearson's type III; normal where it is hardly skew."""
    shape = 4.0 / np.maximum(skew, 1e-3) ** 2
    tail = scipy.special.gammaincc(shape, np.maximum(0.0, shape + z * np.sqrt(shape)))
    return np.asarray(np.where(np.asarray(skew) < 1e-3, scipy.special.ndtr(-np.asarray(z)), tail))


def power_fit(power: Array, X: Array) -> tuple[Array, Array]:
    """Coefficients of power = X c, c not negative, spread proportional to the mean (quasi-likelihood), covariance."""
    size = np.maximum(np.max(np.abs(X), axis=0), 1e-300)
    X = X / size
    usual = float(np.median(power)) or float(np.mean(power)) or 1.0  # a channel that is exact has no power
    mean = np.full(len(power), usual)
    for _ in range(8):
        w = 1.0 / mean
        c, _ = scipy.optimize.nnls(X * w[:, None], power * w)
        mean = np.maximum(X @ c, 0.05 * usual + 1e-300)
    spread = max(float(np.mean((power / mean - 1.0) ** 2)), 1e-12)  # all at one floor scatters not at all
    A = (X / mean[:, None]).T @ (X / mean[:, None])
    covariance = spread * np.linalg.inv(A + 1e-12 * np.trace(A) * np.eye(len(A)))
    return c / size, covariance / np.outer(size, size)
