"""Covariance of the rows of the weak form, by its diagonals: sums of noise, Cholesky factor, whitening."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from scipy.sparse import csr_array as Sparse

from accelcal._support.errors import AccelcalError
from accelcal.data import Array, RecordingError
from accelcal.estimation.weak_form.channel import DEGREE

SAME = 1e-9
"""Difference of variances, over the variance, that is rounding and the tails of the test functions."""


class NoWeakForm(RecordingError):
    """A run has no weak form; the text says why."""


@dataclass(frozen=True, slots=True)
class Covariance:
    """Covariance of the rows, q of_output + r of_readings + extra, by diagonals (DEGREE + 1, rows), main one first."""

    of_output: Array
    of_readings: Array
    extra: Array

    @classmethod
    def of(cls, rows: int, constant: tuple[Array, Array] | None) -> Covariance:
        """Of so many rows: all zero, but for what is the same of each row, (DEGREE + 1,) of output and readings."""
        shape = DEGREE + 1, rows
        if constant is None:
            return cls(np.zeros(shape), np.zeros(shape), np.zeros(shape))
        of_output, of_readings = (np.broadcast_to(constant_part[:, None], shape) for constant_part in constant)
        return cls(of_output, of_readings, np.zeros(shape))

    def at(self, q: float, r: float) -> Array:
        """Diagonals at a density of process noise, (m/s²)²/Hz, and a variance of a reading, m²."""
        total = q * self.of_output
        total += r * self.of_readings
        total += self.extra
        return total

    def part(self, rows: slice) -> Covariance:
        """Of successive rows."""
        return Covariance(*(part[:, rows] for part in (self.of_output, self.of_readings, self.extra)))


class Whitening:
    """Forward substitution of many columns, stretch by stretch."""

    def __init__(self, factor: Array, columns: int) -> None:
        self.factor = factor
        self.before = np.zeros((0, columns))

    def __call__(self, rows: slice, y: Array) -> Array:
        """Whiten the columns (rows, m), stored column by column, of the stretch that follows the last;
        they are overwritten."""
        reach = len(self.before)
        for back in range(1, reach + 1):  # row i - back of the stretch before, for i of this
            for i in range(min(DEGREE, len(y))):
                k = back + i
                if k <= DEGREE:
                    y[i] -= self.factor[k, rows.start - back] * self.before[reach - back]
        whitened = solved(self.factor[:, rows], y, overwrite=True)
        self.before = np.concatenate([self.before, whitened])[-DEGREE:]
        return whitened


def bands(weights: Sparse, variance: Array | float = 1.0) -> Array:
    """Covariance of sums of independent samples of a variance, as its diagonals, (DEGREE + 1, count), lowest first."""
    scaled = weights.multiply(np.sqrt(variance)).tocsr() if np.ndim(variance) else weights * np.sqrt(variance)
    product = scaled @ scaled.T
    count = product.shape[0]
    diagonals = np.zeros((DEGREE + 1, count))
    for k in range(min(DEGREE + 1, count)):
        diagonals[k, : count - k] = product.diagonal(-k)
    return diagonals


def constant_diagonals(diagonals: Array) -> Array | None:
    """Diagonals (DEGREE + 1,) of a covariance (DEGREE + 1, rows) that is the same along its rows; None where it is
    not. Those of the last rows, which lead beyond the end, are not looked at."""
    whole = diagonals[:, :-DEGREE]
    if whole.shape[1] == 0 or np.max(np.ptp(whole, axis=1)) > SAME * np.max(whole[0]):
        return None
    return np.asarray(np.mean(whole, axis=1))


def factor(diagonals: Array) -> Array:
    """Cholesky factor of a banded covariance, by its diagonals.

    Raises
    ------
    NoWeakForm
        If it is not positive definite.
    """
    try:
        return np.asarray(scipy.linalg.cholesky_banded(diagonals, lower=True))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoWeakForm(f"the covariance of its rows is not positive definite: {error}") from error


def solved(factor: Array, y: Array, *, overwrite: bool = False) -> Array:
    """Forward substitution, (rows, m); in place of `y` where that may be overwritten and is stored
    column by column."""
    if factor.shape[1] != len(y):  # LAPACK would write beyond the end
        raise AccelcalError(f"{factor.shape[1]} rows of a factor, {len(y)} of what it divides")
    if y.size == 0:  # as it does without any row or column
        return y
    solution, info = scipy.linalg.lapack.dtbtrs(
        np.asfortranarray(factor), np.asfortranarray(y), uplo=b"L", overwrite_b=overwrite
    )
    assert info == 0
    return np.asarray(solution)
