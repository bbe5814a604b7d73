"""Slow noise: the spectrum of what a run's effects leave, and rows whitened by it, so that the null is not white."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data import Array
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA, SLOW_NOISE_SIGMA
from accelcal.estimation.noise import BANDS_PER_OCTAVE

POWERS = (0, 1, 2)
"""Noise of either channel that is white, 1/f and 1/f²; sums of them come close to any power law between."""
LEAST_DOF = 0.5
"""Degrees of freedom below which the effects have taken a band whole."""
ROUNDS = 30
"""Rounds of the iterated least squares, and the share of a round's change that is applied."""
FLOOR = 1e-6
"""Least level of a band over the largest, so that an empty one has a logarithm."""


@dataclass(frozen=True, slots=True)
class SlowNoise:
    """Spectrum of the innovations of one run, over that of white noise; never below 1."""

    coefficients: Array
    """Of the output (white, 1/f, 1/f²) and of the position, (6,)."""
    covariance: Array
    """(6, 6)"""
    crossover: float
    """Hz; output noise shows below it, position noise above."""
    log_evidence: float
    """Gain in log-likelihood over white noise of both channels."""

    def __call__(self, f: Array) -> Array:
        """`SLOW_NOISE_SIGMA` standard deviations above the fit at frequencies `f`, Hz, none of them 0; (n,)."""
        shapes = spectral_shapes(f, self.crossover)
        fitted = shapes @ self.coefficients
        std = np.sqrt(np.einsum("ni,ij,nj->n", shapes, self.covariance, shapes))
        return np.asarray(np.maximum(1.0, fitted + SLOW_NOISE_SIGMA * std))

    @property
    def knee(self) -> float:
        """Frequency below which slow noise exceeds white noise, Hz; 0 where it nowhere does."""
        f = np.geomspace(1e-3, 10.0, 200) * self.crossover
        shapes = spectral_shapes(f, self.crossover)
        white = shapes[:, [0, 3]] @ self.coefficients[[0, 3]]
        above = np.flatnonzero(shapes @ self.coefficients > 2.0 * np.maximum(white, 1.0))
        return float(f[above[-1]]) if len(above) else 0.0


def spectral_shapes(f: Array, crossover: float) -> Array:
    """Innovation spectra of output and position noise that is white, 1/f and 1/f² at the crossover, (n, 6).

    The filter's innovations of white noise of both channels are white, so that those of one are its share.
    """
    share = 1.0 / (1.0 + (f / crossover) ** 4)
    ratio = crossover / f
    return np.column_stack(
        [share * ratio**k for k in POWERS] + [(1.0 - share) * ratio**k for k in POWERS],
    )


def slow_noise(r: Array, rate: float, crossover: float, explained: Array | None = None) -> SlowNoise | None:
    """Fit the spectrum of a residual; None where noise that is white in both channels describes it.

    Parameters
    ----------
    r : residual of the whitened rows, (n,).
    rate : of the rows, Hz.
    crossover : of the filter, Hz.
    explained : share of each cosine that the fitted columns take, (n,); none by default.

    Notes
    -----
    Sums of squared cosine coefficients are gamma distributed with half the bins as shape: iterated least squares with
    the inverse of the squared mean as weight is their likelihood (derivations D3.6).
    """
    if len(r) < 64:
        return None
    f, level, dof = levels(r, rate, explained)
    if not np.any(level > 0.0):  # a planned motion leaves nothing
        return None
    shapes = spectral_shapes(f, crossover)
    _, _, by_white = most_likely(shapes[:, [0, 3]], level, dof)
    coefficients, covariance, by_slow = most_likely(shapes, level, dof)
    if by_slow - by_white < -math.log(FAMILYWISE_ALPHA):
        return None
    return SlowNoise(coefficients, covariance, crossover, by_slow - by_white)


def levels(r: Array, rate: float, explained: Array | None = None) -> tuple[Array, Array, Array]:
    """Frequencies of the bands of a residual (n,) whose level is determined, Hz, that level, and its degrees of
    freedom, (bands,) each; the other parameters are as of `slow_noise`."""
    n = len(r)
    power = scipy.fft.dct(r, norm="ortho")[1:] ** 2
    f = np.arange(1.0, n) * rate / (2.0 * n)
    edges = np.unique(np.geomspace(1.0, float(n), int(BANDS_PER_OCTAVE * math.log2(n))).astype(np.intp)) - 1
    edges = edges[edges < n - 1]
    count = np.diff(np.append(edges, n - 1)).astype(np.float64)
    dof = count if explained is None else count - np.add.reduceat(explained[1:], edges)
    centre, determined = np.exp(np.add.reduceat(np.log(f), edges) / count), dof > LEAST_DOF
    return centre[determined], np.add.reduceat(power, edges)[determined] / dof[determined], dof[determined]


def log_likelihood(r: Array, rate: float, crossover: float) -> float:
    """Log-likelihood of a residual (n,) in noise of its most likely spectrum, up to a constant."""
    f, level, dof = levels(r, rate)
    return most_likely(spectral_shapes(f, crossover), level, dof)[2]


def most_likely(X: Array, level: Array, dof: Array) -> tuple[Array, Array, float]:
    """Coefficients of level = X c, c not negative, by gamma likelihood; their covariance; log-likelihood."""
    size = np.max(X, axis=0)
    X = X / size
    least = FLOOR * float(np.max(level)) + 1e-300
    mean = np.full(len(level), float(dof @ level / np.sum(dof)) + least)
    best: tuple[float, Array, Array] | None = None
    for _ in range(ROUNDS):
        w = np.sqrt(dof) / mean
        c, _ = scipy.optimize.nnls(X * w[:, None], level * w)
        fitted = np.maximum(X @ c, least)
        likelihood = float(-0.5 * dof @ (np.log(fitted) + level / fitted))
        if best is None or likelihood > best[0]:
            best = likelihood, c, fitted
        mean = np.sqrt(mean * fitted)
    assert best is not None
    likelihood, c, fitted = best
    used = np.flatnonzero(c > 0.0)
    A = (X[:, used] * (dof / (2.0 * fitted**2))[:, None]).T @ X[:, used]
    covariance = np.zeros((len(c), len(c)))
    covariance[np.ix_(used, used)] = np.linalg.pinv(A, hermitian=True)
    return c / size, covariance / np.outer(size, size), likelihood
