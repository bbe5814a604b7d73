"""The same coefficients by the replay and by the weak form: where two estimates of one record disagree."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import POSITION_ORDER, Array
from accelcal.diagnosis.policy import ENGINES_LEAST_STD
from accelcal.estimation.engines import ENGINES, Rows
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.rows import (
    LEAST_BLOCKS,
    block_length,
    block_of,
    effective_number,
    inverse,
    rows_of_run,
)
from accelcal.estimation.run_state import RunState
from accelcal.estimation.run_to_run import penalty
from accelcal.estimation.weak_form.covariance import NoWeakForm
from accelcal.model import Term

LARGEST = 38.0
"""Standard deviations beyond which the tail of a normal distribution is zero in double precision."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One coefficient by both."""

    name: str
    run: int | None
    """Of a coefficient that each run has for itself."""
    replay: float
    weak: float
    std: float
    """Of their difference."""
    sigma: float
    """The difference as a standard normal variable."""


def differences(solution: Solution) -> tuple[Difference, ...]:
    """Both estimates of every free coefficient; none where a run has no weak form, or it does not show a coefficient,
    or its reference is no position, which the replay needs.

    Parameters
    ----------
    solution : by either engine, with the states of its runs.

    Notes
    -----
    The second estimate is one Gauss-Newton step of the other engine from the first, with its noise. Each block of the
    record adds to the difference; how much these parts scatter about what the information in each would give it is its
    variance, no less than the difference of both variances and a hundredth of that of the estimate. A coefficient that
    fewer than eight blocks determine is not compared.
    """
    layout, model, x = solution.layout, solution.model, solution.x
    if any(state.run.order != POSITION_ORDER for state in solution.states):
        return ()
    try:
        runs = [ByBoth.of(state, model.free) for state in solution.states]
    except NoWeakForm:
        return ()
    belief = layout.prior_information(model)
    variances, other = np.diag(belief), np.diag(belief)
    score = belief * (layout.prior_mean(model) - x)
    for index, run in enumerate(runs):
        slots = layout.rows(index)
        variances[np.ix_(slots, slots)] += run.gram
        other[np.ix_(slots, slots)] += run.X.T @ run.X
        score[slots] += run.scores.sum(axis=0)
    for name, between in solution.between.items():
        places = layout.rows_of(name)
        drawn = penalty(len(places), between.variance)
        variances[np.ix_(places, places)] += drawn
        other[np.ix_(places, places)] += drawn
        score[places] -= drawn @ x[places]
    if not (
        np.all(np.isfinite(other)) and np.all(np.isfinite(score)) and min(*np.diag(variances), *np.diag(other)) > 0.0
    ):
        return ()
    before, covariance = inverse(variances), inverse(other)
    moved = covariance @ score
    added, shares = [], []
    for index, run in enumerate(runs):
        slots = layout.rows(index)
        added.append(run.scores @ covariance[slots] - run.of_fit @ before[slots])
        shares.append(run.shares(covariance[slots]))
    parts, share = np.concatenate(added), np.concatenate(shares)
    share /= np.maximum(share.sum(axis=0), 1e-300)
    scatter, blocks = np.sqrt(np.sum((parts - share * parts.sum(axis=0)) ** 2, axis=0)), effective_number(share)
    stated = np.diag(solution.covariance)
    lost = np.abs(np.diag(covariance) - np.diag(before))
    least = np.sqrt(np.maximum(lost, ENGINES_LEAST_STD**2 * stated))
    first = ENGINES[solution.states[0].run.engine]

    sigma = as_normal(moved, scatter, blocks, least)
    std = np.maximum(scatter, least)
    return tuple(
        Difference(
            term.name,
            run,
            **{first.name: float(x[i]), first.second: float(x[i] + moved[i])},
            std=float(std[i]),
            sigma=float(sigma[i]),
        )
        for i, (term, run) in enumerate((term, layout.whose(runs)[0]) for term, runs in layout.slots)
        if math.isfinite(moved[i]) and blocks[i] >= LEAST_BLOCKS
    )


def as_normal(difference: Array, scatter: Array, blocks: Array, least: Array) -> Array:
    """Differences (m,) as standard normal variables: by their scatter over so many blocks (Student), and by a least
    standard deviation, whichever is smaller."""
    freedom = np.maximum(blocks - 1.0, 1.0)
    student = difference / np.maximum(scatter * np.sqrt(blocks / freedom), 1e-300)
    by_scatter = np.minimum(-scipy.special.ndtri(scipy.special.stdtr(freedom, -np.abs(student))), LARGEST)
    return np.asarray(np.sign(difference) * np.minimum(by_scatter, np.abs(difference) / least))


@dataclass(frozen=True, slots=True)
class ByBoth:
    """Rows of one run by the engine that it was not fitted with, and the scores of its blocks by both."""

    X: Array
    """Whitened columns, (rows, m)."""
    block: NDArray[np.intp]
    """Of each row, (rows,)."""
    scores: Array
    """(blocks, m)"""
    of_fit: Array
    """By the engine that it was fitted with, (blocks, m)."""
    gram: Array
    """By the same, (m, m)."""

    @classmethod
    def of(cls, state: RunState, terms: Sequence[Term]) -> ByBoth:
        """Return both estimates of the coefficients of a model.

        Raises
        ------
        NoWeakForm
            If the run has none.
        """
        fitted, again = rows_of_run(state, terms), copy.copy(state)
        again.run, again.weak = state.run.but(engine=ENGINES[state.run.engine].second), None
        length = block_length(state)
        last = int(block_of(state, state.run.t[-1:], length)[0])
        t, X, y = joined(rows_of_run(again, terms))
        block, m = np.minimum(block_of(state, t, length), last), X.shape[1]
        scores, of_fit, gram = np.zeros((last + 1, m)), np.zeros((last + 1, m)), np.zeros((m, m))
        np.add.at(scores, block, X * y[:, None])
        for t, columns, innovations in fitted:
            np.add.at(of_fit, np.minimum(block_of(state, t, length), last), columns * innovations[:, None])
            gram += columns.T @ columns
        return cls(X, block, scores, of_fit, gram)

    def shares(self, covariance: Array) -> Array:
        """Information of the blocks on each coefficient, all others unknown, (blocks, p), up to a factor.

        `covariance` is that of the m coefficients of the run with all p.
        """
        errors = np.zeros((len(self.scores), covariance.shape[1]))
        np.add.at(errors, self.block, (self.X @ covariance) ** 2)
        return errors


def joined(rows: Iterable[Rows]) -> Rows:
    """All rows as one."""
    t, columns, y = zip(*rows, strict=True)
    return np.concatenate(t), np.concatenate(columns), np.concatenate(y)
