"""Gain in log-likelihood of columns, from Gram matrix and scores alone."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import special

from accelcal.data.arrays import Array

DEGENERATE = 1e-5
"""Share of a column's power, beyond base and chosen effects, below which nothing of it is left to test."""
ROUNDING = 1e-10
"""The same share of all of its power, whatever of that a straight line of the acceleration takes up exactly."""
DEGENERATE_MIX = 1e-3
"""The same share for a mixture of several columns, whose weakest direction errors of the smoothed motion favour."""


def scale_of(power: Array) -> Array:
    """Square roots of the powers of columns, to scale them by; 1 for a column of which nothing is left."""
    return np.sqrt(np.where(power > 0.0, power, 1.0))


def project_out(G: Array, c: Array, columns: NDArray[np.intp], prior_std: float = math.inf) -> tuple[Array, Array]:
    """Gram matrix and scores with some columns projected out; their coefficients have mean zero and `prior_std`."""
    A = G[np.ix_(columns, columns)] + np.eye(len(columns)) / prior_std**2
    size = scale_of(np.diag(A))
    A = A / np.outer(size, size) + 1e-9 * np.eye(len(columns))
    left = scipy.linalg.cho_solve(scipy.linalg.cho_factor(A), G[columns] / size[:, None]) / size[:, None]
    return G - G[:, columns] @ left, c - left.T @ c[columns]


def score_gain(A: Array, b: Array, before: Array | None = None) -> tuple[float, int, Array, Array]:
    """Gain b' A^-1 b of free coefficients, degrees of freedom, estimate and covariance.

    Directions that other columns already contain (less than `DEGENERATE` of their power left) are not counted.
    """
    reference = np.diag(A if before is None else before)
    if len(b) == 1:
        if A[0, 0] <= DEGENERATE * reference[0] or A[0, 0] <= 0.0:
            return 0.0, 0, np.zeros(1), np.full((1, 1), np.inf)
        return float(b[0] ** 2 / A[0, 0]), 1, b / A[0, 0], 1.0 / A
    size = scale_of(reference)
    values, vectors = np.linalg.eigh(A / np.outer(size, size))
    good = values > DEGENERATE_MIX
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(size, size)
    return float(b @ inverse @ b), int(good.sum()), inverse @ b, inverse


def variance_gain(A: Array, b: Array) -> tuple[float, int, Array, Array]:
    """Gain of coefficients that are random with one unknown standard deviation s (derivations D3.4).

    2 log L = max_s [ b'(I/s² + A)^-1 b - log det(I + s² A) ].
    """
    values, vectors = np.linalg.eigh(A)
    values = np.maximum(values, 0.0)
    projected = (vectors.T @ b) ** 2

    def loss(log_s: float) -> float:
        s2 = math.exp(2.0 * log_s)
        return float(np.sum(np.log1p(s2 * values)) - np.sum(projected * s2 / (1.0 + s2 * values)))

    top = float(np.max(values, initial=1e-300))
    trials = -0.5 * math.log(top) + np.linspace(-2.0, 9.0, 23)
    scaled = np.exp(2.0 * trials)[:, None] * values
    explained = np.exp(2.0 * trials)[:, None] * projected / (1.0 + scaled)
    k = int(np.argmin(np.sum(np.log1p(scaled) - explained, axis=1)))
    low, high = trials[max(k - 1, 0)], trials[min(k + 1, len(trials) - 1)]
    best = scipy.optimize.minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 0.02})
    gain = max(0.0, -float(best.fun))
    s = math.exp(float(best.x))
    return (
        gain,
        1,
        np.array([s]),
        np.array([[s**2 / max(1.0, 2.0 * np.sum((s**2 * values / (1 + s**2 * values)) ** 2))]]),
    )


def log_survival(gain: float, dof: int) -> float:
    """Log of the probability that chi-square with `dof` exceeds `gain`; never saturates."""
    if dof == 0 or gain <= 0.0:
        return 0.0
    if dof == 1:
        return float(math.log(2.0) + special.log_ndtr(-math.sqrt(gain)))
    a, x = dof / 2.0, gain / 2.0
    if x < 600.0:
        return float(np.log(max(special.gammaincc(a, x), 1e-300)))
    series, term = 1.0, 1.0
    for k in range(1, 12):
        term *= (a - k) / x
        series += term
    return float((a - 1.0) * math.log(x) - x - special.gammaln(a) + math.log(series))
