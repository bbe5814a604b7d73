"""Gram matrix and scores of the candidates with the base projected out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data.arrays import Array
from accelcal.diagnosis.search.hypotheses import Hypothesis, nuisances
from accelcal.diagnosis.search.likelihood_gain import DEGENERATE, score_gain, variance_gain, without
from accelcal.estimation.columns import ColumnFilter
from accelcal.estimation.run_state import RunState
from accelcal.model import Model, Term

MOST_KEPT = 1 << 23
"""Sums of a run, all columns together, that are kept for a second look: 67 MB."""
APART = 1e6
"""Time between the starts of two runs as blocks are counted, s."""


class BaseProjection:
    """What one run says of its base: rows of the base and of the innovations, and how to take the base off.

    The base is projected out of each run on its own, so no run's offset can pose as an effect in another.
    """

    def __init__(self, one: RunState, model: Model, apart: Sequence[Term] = ()) -> None:
        self.carrier = ColumnFilter(one)
        self._kept: tuple[Sequence[Term], slice, Array] | None = None
        unsure = [*nuisances(one, model), *((term, np.inf) for term in apart)]
        base = [term for term in model.terms if term.name not in model.fixed]
        plain = [term for term in base if term.name not in {other.name for other, _ in unsure}]
        terms = [*plain, *(term for term, _ in unsure)]
        self.belief: Array = np.array([*np.zeros(len(plain)), *(std**-2.0 for _, std in unsure)])
        self.B: Array = self.carrier.whole(terms)
        self.y: Array = self.carrier.whitened
        moves = [row for term, row in zip(base, self.B, strict=False) if term.name == "scale_factor"]
        self.motion = float(sum(row @ row for row in moves))
        """Power of the motion itself in the innovations; 0 where the base leaves no scale factor free."""
        A = self.B @ self.B.T + np.diag(self.belief)
        self.size: Array = np.sqrt(np.maximum(np.diag(A), 1e-300))
        self.factor = scipy.linalg.cho_factor(A / np.outer(self.size, self.size) + 1e-12 * np.eye(len(A)))
        at = np.array([one.values.by_name.get(term.name, 0.0) for term in terms])
        # Belief pulls towards zero, not towards the values at hand.
        self.wy: Array = self.weights(self.B @ self.y - self.belief * at)

    def weights(self, products: Array) -> Array:
        """Weights with which the base, under its prior information, predicts columns from its products with them."""
        scaled = (products.T / self.size).T
        return np.asarray((scipy.linalg.cho_solve(self.factor, scaled).T / self.size).T)

    def stretches(self, terms: Sequence[Term]) -> Iterator[tuple[slice, Array]]:
        """Columns stretch by stretch; those of a short run are kept for a second look."""
        if self._kept is not None and self._kept[0] is terms:
            yield self._kept[1:]
            return
        self._kept = None
        for rows, Z in self.carrier.stretches(terms):
            if rows == slice(0, self.carrier.rows) and Z.size <= MOST_KEPT:
                self._kept = (terms, rows, Z)
            yield rows, Z

    def left(
        self, terms: Sequence[Term], report: Callable[[float], None] = lambda share: None
    ) -> tuple[Array, Array, Array, Array]:
        """What the base leaves of columns: Gram matrix (m, m) and scores (m,), the power that they have with it (m,),
        and the weights with which it predicts them (base, m)."""
        m = len(terms)
        G, products, score = np.zeros((m, m)), np.zeros((len(self.B), m)), np.zeros(m)
        for rows, Z in self.stretches(terms):
            G += Z @ Z.T
            products += self.B[:, rows] @ Z.T
            score += Z @ self.y[rows]
            report(rows.stop / self.carrier.rows)
        weights, own = self.weights(products), np.diag(G).copy()
        G -= products.T @ weights
        score -= products.T @ self.wy
        return G, score, own, weights


def columns_of(items: Sequence[Hypothesis]) -> tuple[list[Term], list[slice]]:
    """Coefficients of all items, and where each item's stand: a coarser shape is the beginning of the finer one."""
    terms: list[Term] = []
    begins: dict[tuple[object, ...], int] = {}
    keys = [(item.effect.name, *item.shape.items()) for item in items]
    for key, item in sorted(zip(keys, items, strict=True), key=lambda one: one[1].leading is not None):
        if key not in begins:
            begins[key] = len(terms)
            terms += item.terms
    return terms, [slice(begins[k], begins[k] + len(item.terms)) for k, item in zip(keys, items, strict=True)]


class CandidateScores:
    """Gram matrix and scores of the candidates over all runs, and what follows from them."""

    def __init__(
        self,
        runs: Sequence[BaseProjection],
        items: Sequence[Hypothesis],
        *,
        report: Callable[[float], None] = lambda share: None,
    ) -> None:
        self.items = items
        self.runs = runs
        self.terms, self.columns = columns_of(items)
        m = len(self.terms)
        self.G, self.c = np.zeros((m, m)), np.zeros(m)
        self.own: Array = np.zeros(m)
        """Power of each column before the base is taken out."""
        self.motion = sum(known.motion for known in runs)
        self._weights: list[Array] = []
        for known in runs:
            G, c, own, weights = known.left(self.terms, report)
            self.G += G
            self.own += own
            self.c += c
            self._weights.append(weights)
        swallowed = np.diag(self.G) <= DEGENERATE * self.own
        self.G[swallowed], self.G[:, swallowed], self.c[swallowed] = 0.0, 0.0, 0.0
        plain = [item.effect.width == 1 and item.effect.port != "process" for item in items]
        self._plain: NDArray[np.bool_] = np.array(plain, dtype=np.bool_)
        self._positive: NDArray[np.bool_] = np.array([item.effect.positive for item in items], dtype=np.bool_)
        self._after: dict[tuple[int, ...], tuple[Array, Array]] = {(): (self.G, self.c)}
        self._gains: dict[tuple[int, ...], tuple[Array, NDArray[np.intp]]] = {}

    def rows(self) -> Iterator[tuple[Array, Array, Array]]:
        """A second look at the rows that the Gram matrix was summed from, the base taken out, stretch by stretch.

        Yields
        ------
        Time of each row, runs far apart, s; the innovations, (rows,); the columns, (m, rows).
        """
        for number, (known, weights) in enumerate(zip(self.runs, self._weights, strict=True)):
            t = known.carrier.times
            t = t - t[0] + number * APART
            for rows, Z in known.stretches(self.terms):
                B = known.B[:, rows]
                yield t[rows], known.y[rows] - known.wy @ B, Z - weights.T @ B

    def after(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Gram matrix and scores once some items have entered: constant coefficients first, then wandering states.

        A wandering state enters with the intensity that it has beside those before it. Free, it would leave to the
        others what it cannot explain and yet be paid for what it can.
        """
        key = tuple(chosen)
        if key not in self._after:
            self._after[key] = self._taken_out(key)
        return self._after[key]

    def _taken_out(self, chosen: tuple[int, ...]) -> tuple[Array, Array]:
        G, c = self.G, self.c
        constant = [i for i in chosen if self.items[i].effect.port != "process"]
        if constant:
            columns = np.concatenate([np.arange(self.columns[i].start, self.columns[i].stop) for i in constant])
            G, c = without(G, c, columns)
        for i in chosen:
            if i not in constant:
                columns = np.arange(self.columns[i].start, self.columns[i].stop)
                _, _, intensity, _ = variance_gain(G[np.ix_(columns, columns)], c[columns])
                G, c = without(G, c, columns, float(intensity[0]))
        return G, c

    def gain(self, i: int, chosen: Sequence[int] = ()) -> tuple[float, int, Array, Array]:
        """Twice the log-likelihood gain of item `i` beside those chosen, its freedom, estimate, covariance."""
        G, c = self.after(chosen)
        columns = self.columns[i]
        A, b = G[columns, columns], c[columns]
        if self.items[i].effect.port == "process":
            return variance_gain(A, b)
        gain, dof, estimate, covariance = score_gain(A, b, self.G[columns, columns])
        if self.items[i].effect.positive and estimate[0] < 0.0:
            return 0.0, 0, estimate, covariance
        return gain, dof, estimate, covariance

    def gains(self, chosen: Sequence[int] = ()) -> tuple[Array, NDArray[np.intp]]:
        """Gain and degrees of freedom of every item beside those chosen, (items,) each."""
        key = tuple(chosen)
        if key in self._gains:
            return self._gains[key]
        G, c = self.after(key)
        gain, dof = np.zeros(len(self.items)), np.zeros(len(self.items), dtype=np.intp)
        at = np.array([columns.start for columns in self.columns], dtype=np.intp)[self._plain]
        A, b, before = np.diag(G)[at], c[at], np.diag(self.G)[at]
        alive = (DEGENERATE * before < A) & (A > 0.0) & ~(self._positive[self._plain] & (b < 0.0))
        gain[self._plain] = np.where(alive, b**2 / np.where(alive, A, 1.0), 0.0)
        dof[self._plain] = alive
        for i in np.flatnonzero(~self._plain):
            gain[i], dof[i], _, _ = self.gain(int(i), key)
        self._gains[key] = (gain, dof)
        return gain, dof
