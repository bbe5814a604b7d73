"""The same coefficients by the replay and by the weak form: where two estimates of one record disagree."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data.arrays import Array
from accelcal.diagnosis.policy import ENGINES_APART, ENGINES_LEAST_STD
from accelcal.diagnosis.remarks import Remark, remark
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.noise_spectrum import whitener
from accelcal.estimation.normal_equations import LEAST_BLOCKS, block_length, block_of, effective_number
from accelcal.estimation.rows import Rows, rows_of_dwells, rows_of_run
from accelcal.estimation.run_state import RunState
from accelcal.estimation.run_to_run import penalty
from accelcal.estimation.weak_form.rows import NoWeakForm, WeakRows
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


def disagreement(differences: Sequence[Difference]) -> Remark | None:
    """The remark on the coefficient in which both differ most; None where they agree."""
    apart = [one for one in differences if abs(one.sigma) > ENGINES_APART]
    if not apart:
        return None
    worst = max(apart, key=lambda one: abs(one.sigma))
    names = dict.fromkeys(one.name for one in sorted(apart, key=lambda one: -abs(one.sigma)))
    return remark(
        "engines_disagree",
        parameters=", ".join(names),
        parameter=worst.name,
        replay=float(f"{worst.replay:.6g}"),
        weak=float(f"{worst.weak:.6g}"),
        sigma=abs(worst.sigma),
    )


def differences(solution: Solution) -> tuple[Difference, ...]:
    """Both estimates of every free coefficient; none where a run has no weak form, or it does not show a coefficient.

    Parameters
    ----------
    solution : of the replay, with the states of its runs.

    Notes
    -----
    The weak form is one Gauss-Newton step from the estimates of the replay, with its noise. Each block of the record
    adds to the difference; how much these parts scatter about what the information in each would give it is its
    variance, no less than the difference of both variances and a hundredth of that of the estimate. A coefficient that
    fewer than eight blocks determine is not compared.
    """
    layout, model, x = solution.layout, solution.model, solution.x
    information = np.diag(layout.prior_information(model))
    score = layout.prior_information(model) * (layout.prior_mean(model) - x)
    try:
        weak = [WeakRows(state) for state in solution.states]
    except NoWeakForm:
        return ()
    runs = [ByBoth.of(state, rows, model.free) for state, rows in zip(solution.states, weak, strict=True)]
    for index, run in enumerate(runs):
        slots = layout.rows(index)
        information[np.ix_(slots, slots)] += run.X.T @ run.X
        score[slots] += run.scores.sum(axis=0)
    for name, between in solution.between.items():
        places = layout.rows_of(name)
        drawn = penalty(len(places), between.variance)
        information[np.ix_(places, places)] += drawn
        score[places] -= drawn @ x[places]
    size = np.sqrt(np.diag(information))
    if not (np.all(np.isfinite(information)) and np.all(np.isfinite(score)) and np.all(size > 0.0)):
        return ()
    covariance = np.linalg.pinv(information / np.outer(size, size), hermitian=True) / np.outer(size, size)
    moved = covariance @ score
    added, shares = [], []
    for index, run in enumerate(runs):
        slots = layout.rows(index)
        added.append(run.scores @ covariance[slots] - run.of_replay @ solution.covariance[slots])
        shares.append(run.shares(covariance[slots]))
    parts, share = np.concatenate(added), np.concatenate(shares)
    share /= np.maximum(share.sum(axis=0), 1e-300)
    scatter, blocks = np.sqrt(np.sum((parts - share * parts.sum(axis=0)) ** 2, axis=0)), effective_number(share)
    variance = np.diag(solution.covariance)
    least = np.sqrt(np.maximum(np.abs(np.diag(covariance) - variance), ENGINES_LEAST_STD**2 * variance))
    sigma = as_normal(moved, scatter, blocks, least)
    std = np.maximum(scatter, least)
    return tuple(
        Difference(term.name, run, float(x[i]), float(x[i] + moved[i]), float(std[i]), float(sigma[i]))
        for i, (term, run) in enumerate(layout.slots)
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
    """Rows of the weak form of one run, and the scores of its blocks by both."""

    X: Array
    """Whitened columns of the weak form, (rows, m)."""
    block: NDArray[np.intp]
    """Of each row, (rows,)."""
    scores: Array
    """Of the weak form, (blocks, m)."""
    of_replay: Array
    """(blocks, m)"""

    @classmethod
    def of(cls, state: RunState, weak: WeakRows, terms: Sequence[Term]) -> ByBoth:
        """Both for the terms of a model."""
        length = block_length(state)
        count = int(block_of(state, state.run.t[-1:], length)[0]) + 1
        t, X, y = joined(weak_rows(state, weak, terms))
        block = block_of(state, t, length)
        scores, of_replay = np.zeros((count, X.shape[1])), np.zeros((count, X.shape[1]))
        np.add.at(scores, block, X * y[:, None])
        for t, columns, innovations in rows_of_run(state, terms):
            np.add.at(of_replay, block_of(state, t, length), columns * innovations[:, None])
        return cls(X, block, scores, of_replay)

    def shares(self, covariance: Array) -> Array:
        """Information of the blocks on each coefficient, all others unknown, (blocks, p), up to a factor.

        `covariance` is that of the m coefficients of the run with all p.
        """
        found = np.zeros((len(self.scores), covariance.shape[1]))
        np.add.at(found, self.block, (self.X @ covariance) ** 2)
        return found


def joined(rows: Iterable[Rows]) -> Rows:
    """All rows as one."""
    t, columns, y = zip(*rows, strict=True)
    return np.concatenate(t), np.concatenate(columns), np.concatenate(y)


def weak_rows(state: RunState, rows: WeakRows, terms: Sequence[Term]) -> Iterable[Rows]:
    """Rows of the weak form of one run as `rows_of_run` gives those of the replay."""
    whiten = whitener(state.spectrum, rows.rate)
    yield rows.times, whiten(rows.whole(terms)).T, whiten(rows.whitened)
    rest = rows_of_dwells(state, terms)
    if rest is not None:
        yield np.full(len(rest.y), state.run.t[-1]), rest.columns, rest.y
