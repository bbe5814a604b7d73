"""Channels against the test functions: sums that are integrals whatever the stamps, and their covariance."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.sparse import csr_array as Sparse

from accelcal import _core
from accelcal.data import Array
from accelcal.estimation.channel_filters import GRID_ERROR
from accelcal.signals.processing import even_times, low_pass
from accelcal.signals.series import lagrange_weights

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
    powers = np.ones((1, 1))  # lowest power first
    for degree in range(1, DEGREE + 1):
        raised = np.zeros((degree + 1, degree + 1))
        for cell in range(degree):
            raised[cell, :degree] += cell * powers[cell]
            raised[cell, 1:] += powers[cell]
            raised[cell + 1, :degree] += (degree - cell) * powers[cell]
            raised[cell + 1, 1:] -= powers[cell]
        powers = raised / degree
    for _ in range(order):
        powers = powers[:, 1:] * np.arange(1.0, powers.shape[1])
    return np.ascontiguousarray(powers[:, ::-1])


CARRIER_CUTOFF = 0.3
"""Bandwidth of the smooth carrier of an uneven channel over the rate of the test functions."""
RINGS = 10.0
"""Steps of the test functions over which what the carrier makes of a break dies away."""
CARRIER_DEGREE = 5
"""Of the splines that lead from uneven stamps to even ones and back."""
NEIGHBOURS = 4
"""Samples on either side from which a lost one of an even clock is interpolated."""
MOST_KEPT = 8_000_000
"""Elements of the matrices of one channel that are kept for the next sums."""
MOST_LOST = 1.0
"""Lost samples over those that are there, beyond which a clock is not taken for an even one."""


@dataclass(frozen=True, eq=False)
class SampledChannel:
    """Samples, the time that each stands for, and what a smooth carrier of uneven samples adds.

    A sum over even samples against a test function is its integral but for aliases, which the test function does not
    pass. Samples that an even clock lost are those of the polynomial through their neighbours, so that the sum stays
    linear in the samples that are there. Of uneven samples a smooth carrier is taken off, whose integral is found on
    even times: what is left is noise, and the sum of it needs no more than the trapezoid rule.
    """

    t: Array
    """(n,) s."""
    y: Array
    """(n,), the carrier taken off."""
    weight: Array
    """Time that each sample stands for, (n,) s; of an even clock that lost some, that each tick stands for."""
    carrier_t: Array
    """Even times, (m,) s; empty where the samples are even themselves."""
    carrier_y: Array
    """(m,)"""
    ticks: Array | None = None
    """Times of an even clock that lost samples, (N,) s; None where it lost none, or is uneven."""
    filled: Sparse | None = None
    """What leads from the samples to the ticks, (N, n)."""
    _kept: dict[tuple[Splines, int, float], tuple[slice, Sparse]] = field(default_factory=dict)
    """Of sums over ticks, what was asked for before."""

    @property
    def even(self) -> bool:
        """Whether its clock is even, and lost nothing."""
        return self.filled is None and not len(self.carrier_t)

    @classmethod
    def of(cls, t: Array, y: Array, step: float, rate: float, rounded: float = 0.0) -> SampledChannel:
        """A channel with samples every `step` s, whose stamps are rounded to some s, for test functions at a rate in
        Hz."""
        none, near = np.empty(0), max(GRID_ERROR**2 * step, min(rounded, GRID_ERROR * step))
        even = float(t[-1] - t[0]) / max(1, len(t) - 1)
        clock = t[0] + even * np.arange(len(t))
        if float(np.max(np.abs(t - clock), initial=0.0)) < near:
            return cls(clock, y, np.broadcast_to(even, len(t)), none, none)
        number = np.concatenate([[0], np.cumsum(np.maximum(1, np.rint(np.diff(t) / step)))]).astype(np.intp)
        even = float(t[-1] - t[0]) / max(1, int(number[-1]))
        clock, count = t[0] + even * number, int(number[-1]) + 1
        apart = float(np.max(np.abs(t - clock), initial=0.0))
        if apart < near and 2 * NEIGHBOURS < count <= (1.0 + MOST_LOST) * len(t):
            ticks = t[0] + even * np.arange(count)
            return cls(clock, y, np.broadcast_to(even, count), none, none, ticks, from_neighbours(number, count))
        weight = np.gradient(t)
        at = even_times(t[0], t[-1] + 0.5 * step, step)
        at = at[at <= t[-1]]
        carrier = low_pass(through(t, y)(at), 1.0 / step, CARRIER_CUTOFF * rate)
        return cls(t, y - through(at, carrier)(np.clip(t, at[0], at[-1])), weight, at, carrier)

    def around(self, begin: Array, end: Array, rate: float) -> Array:
        """Breaks (n, 2), s, wide enough that the carrier has died away behind them."""
        reach = RINGS / rate if len(self.carrier_t) else 0.0
        return np.column_stack([begin - reach, end + reach])

    def against(self, splines: Splines, order: int, tau: float = 0.0) -> tuple[slice, Sparse]:
        """Samples within some test functions, and what they weigh in each sum over a derivative; `tau` is that of a
        low-pass that is undone."""
        if self.ticks is None or self.filled is None:
            rows = covering(self.t, splines)
            return rows, splines.weights(self.t[rows], order, self.weight[rows], tau)
        asked = splines, order, tau
        if asked not in self._kept:
            near = covering(self.ticks, splines)
            weights = splines.weights(self.ticks[near], order, self.weight[near], tau) @ self.filled[near]
            used = weights.indices
            rows = slice(int(used.min()), int(used.max()) + 1) if len(used) else slice(0, 0)
            result = rows, weights[:, rows].tocsr()
            if sum(part.nnz for _, part in self._kept.values()) + weights.nnz > MOST_KEPT:
                self._kept.clear()
            self._kept[asked] = result
        return self._kept[asked]

    def on_ticks(self, y: Array) -> Array:
        """Samples (n,) on all ticks of an even clock, lost ones from their neighbours."""
        return y if self.filled is None else np.asarray(self.filled @ y)

    def sums(self, splines: Splines, order: int, weights: Sparse, rows: slice, tau: float = 0.0) -> Array:
        """Integrals of the channel against the derivatives of the test functions, a low-pass undone, (count,).

        `weights` are those of the samples in `rows`.
        """
        sums = np.asarray(weights @ self.y[rows])
        if len(self.carrier_t):
            near = covering(self.carrier_t, splines)
            t, y = self.carrier_t[near], self.carrier_y[near]
            step = float(self.carrier_t[1] - self.carrier_t[0])
            sums += splines.weights(t, order, np.full(len(t), step), tau) @ y
        return sums


def from_neighbours(number: NDArray[np.intp], count: int) -> Sparse:
    """What leads from the samples of an even clock, of a `number` each, (n,), to all its ticks, (count, n).

    A lost one is that of the polynomial through as many samples on either side.
    """
    lost = np.delete(np.arange(count), number)
    width = min(2 * NEIGHBOURS, len(number))
    first = np.clip(np.searchsorted(number, lost) - width // 2, 0, len(number) - width)
    columns = first[:, None] + np.arange(width)
    offsets = (number[columns] - lost[:, None]).astype(np.float64)
    weights = np.column_stack(lagrange_weights(list(offsets.T))) if len(lost) else np.empty((0, width))
    rows = np.concatenate([number, np.repeat(lost, width)])
    values = np.concatenate([np.ones(len(number)), weights.ravel()])
    return Sparse(
        (values, (rows, np.concatenate([np.arange(len(number)), columns.ravel()]))), shape=(count, len(number))
    )


def through(t: Array, y: Array) -> scipy.interpolate.BSpline:
    """A smooth function through samples."""
    return scipy.interpolate.make_interp_spline(t, y, k=CARRIER_DEGREE)


def covering(t: Array, splines: Splines) -> slice:
    """Samples within the supports of the test functions."""
    end = splines.start + (splines.count - 1) * splines.step + splines.support
    return slice(*np.searchsorted(t, [splines.start, end]))
