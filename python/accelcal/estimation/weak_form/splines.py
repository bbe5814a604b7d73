"""Cardinal B-splines: the test functions of the weak form, their derivatives, and sums of samples against them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array as Sparse

from accelcal import _core
from accelcal.data.arrays import Array

DEGREE = 9
"""Of the test functions: their spectrum falls as the tenth power, so that sums over samples are integrals."""


@dataclass(frozen=True, slots=True)
class Splines:
    """Test functions phi_k on a uniform sequence of knots; each spans `DEGREE` + 1 steps and vanishes at both ends."""

    start: float
    """Where the first begins, s."""
    step: float
    """From one to the next, s."""
    count: int

    @property
    def support(self) -> float:
        """Length of each, s."""
        return (DEGREE + 1) * self.step

    @property
    def begins(self) -> Array:
        """Where each begins, (count,) s."""
        return self.start + self.step * np.arange(float(self.count))

    def part(self, first: int, end: int) -> Splines:
        """The test functions from `first` up to `end`."""
        return Splines(self.start + first * self.step, self.step, end - first)

    def weights(self, t: Array, order: int, weight: Array, tau: float = 0.0) -> Sparse:
        """Derivatives of the test functions at sample times, times weights, (count, n).

        Parameters
        ----------
        t : (n,) s.
        order : of the derivative.
        weight : (n,) time that each sample stands for, s.
        tau : of a first-order low-pass that is undone, s: phi - tau phi' in place of phi.
        """
        coefficients = pieces(order)
        if tau:
            coefficients = coefficients.copy()
            coefficients[:, 1:] -= tau / self.step * pieces(order + 1)
        rows = _core.spline_weights(
            np.ascontiguousarray(t),
            weight / self.step**order,
            np.ascontiguousarray(coefficients.T),
            start=self.start,
            step=self.step,
            count=self.count,
        )
        return Sparse(rows, shape=(self.count, len(t)))


@lru_cache(maxsize=4)
def pieces(order: int) -> Array:
    """Polynomials of a derivative of the cardinal B-spline on its unit cells, highest power first.

    Returns
    -------
    (DEGREE + 1, DEGREE + 1 - order): row m holds cell [m, m + 1], in powers of the distance from m.
    """
    found = np.ones((1, 1))  # lowest power first
    for degree in range(1, DEGREE + 1):
        raised = np.zeros((degree + 1, degree + 1))
        for cell in range(degree):
            raised[cell, :degree] += cell * found[cell]
            raised[cell, 1:] += found[cell]
            raised[cell + 1, :degree] += (degree - cell) * found[cell]
            raised[cell + 1, 1:] -= found[cell]
        found = raised / degree
    for _ in range(order):
        found = found[:, 1:] * np.arange(1.0, found.shape[1])
    return np.ascontiguousarray(found[:, ::-1])
