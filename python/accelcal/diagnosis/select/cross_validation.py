"""Blocked cross-validation of an effect that is to enter a model, within the fitted runs (derivations D8).

Every run is cut into blocks, which share the time and what the effect contributes alike: a burst that holds most of it
is cut into several. The coefficients of both models, with the effect and without it, are estimated
from all blocks but one, by linear algebra on Gram matrices that are summed block by block, and the block that was left
out is predicted with them. The differences of the errors are paired, so that their scatter from block to block is that
of the comparison itself. Data that are held out take no part in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelcal.data import Array, Flags
from accelcal.data.arrays import VANISHING
from accelcal.diagnosis.policy import (
    VALIDATION_BLOCKS,
    VALIDATION_HORIZON,
    VALIDATION_LEAST_BLOCKS,
    VALIDATION_LEAST_FALL,
    VALIDATION_RISE,
    VALIDATION_SIGMA,
    VALIDATION_SPREAD,
)
from accelcal.diagnosis.search.scores import scaled_gram
from accelcal.effects import Effect, find, of_one_record
from accelcal.estimation.columns import evaluated
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.rows import rows_of_run
from accelcal.estimation.run_state import RunState
from accelcal.model import Term
from accelcal.signals.processing import integral
from accelcal.validation.prediction import accumulated

CENTRES = 4
"""Drifts taken per horizon."""
PIECES = 8
"""Pieces of equal time in a block of average length; blocks are made of whole pieces."""


@dataclass(frozen=True, slots=True)
class PairedChange:
    """Square error on left-out blocks without an effect and with it, summed in each, mean of all blocks."""

    measure: str
    """What is squared: the one-step prediction error over its standard deviation, or the drift, m."""
    before: float
    """Without the effect; the unit of the measure, squared."""
    after: float
    """With it."""
    std: float
    """Standard error of the difference, from its scatter over blocks."""
    blocks: int
    least: float = 0.0
    """Rise, as a share of the error without the effect, below which it does not matter."""
    spread: float = 0.0
    """Blocks over which the effect is spread: those of equal power that would scatter as much."""

    @property
    def sigma(self) -> float:
        """Rise of the error in paired standard errors; negative where the error falls."""
        return (self.after - self.before) / self.std if self.std > 0.0 else 0.0

    @property
    def ratio(self) -> float:
        """Rms error with the effect over that without it."""
        return math.sqrt(self.after / self.before) if self.before > 0.0 else 1.0

    @property
    def rises(self) -> bool:
        """Whether the error rises by more than the comparison is uncertain."""
        return self.sigma > VALIDATION_SIGMA and self.ratio > 1.0 + self.least


def refusing(changes: Sequence[PairedChange]) -> PairedChange | None:
    """The change for which an effect does not enter; None where it may.

    An error that rises significantly refuses it; that of the drift, which noise dominates, only where the one-step
    error does not fall. An effect that is spread over several blocks is refused, too, where it lets neither error fall
    by half a standard error; what a single block holds cannot be predicted there from the others.
    """
    falls = bool(changes) and changes[0].sigma <= -VALIDATION_LEAST_FALL
    rising = [] if falls else [change for change in changes if change.rises]
    if not rising and changes and changes[0].spread >= VALIDATION_SPREAD:
        rising = [change for change in changes if all(measure.sigma > -VALIDATION_LEAST_FALL for measure in changes)]
    return max(rising, key=lambda change: change.sigma, default=None)


def belongs_to_its_time(effect: Effect) -> bool:
    """Whether an effect lives at one instant or follows a function of time, which other blocks cannot predict.

    Such an effect is fitted anew in each block; it is refused only where the others become worse by it.
    """
    return of_one_record(effect) or any(shape.at_rest is not None for shape in effect.shapes.values())


def cross_validate(solution: Solution, entering: Sequence[str], leaving: Sequence[Term] = ()) -> list[PairedChange]:
    """Errors on left-out blocks with some effects of a fitted model and without them.

    Parameters
    ----------
    solution : fit of the model with the effects, with the states of its runs.
    entering : names of the effects.
    leaving : terms of the model without them that they replaced.

    Returns
    -------
    Changes of the one-step error and of the drift; none where there are too few blocks.
    """
    terms = (*solution.model.free, *leaving)
    width, new = len(solution.layout.slots), [t.effect.name in entering for t, _ in solution.layout.slots]
    count = max(VALIDATION_LEAST_BLOCKS // 2, VALIDATION_BLOCKS // len(solution.states))
    several = [
        pieces(state, terms, rows_of(solution, index, len(leaving)), width + len(leaving), count)
        for index, state in enumerate(solution.states)
    ]
    whitened, drifts, readings = (np.concatenate([block[kind] for block in several]) for kind in range(3))
    reference = np.zeros(width + len(leaving) + 1)  # the coefficient of an effect is counted from zero
    reference[:width] = np.where(new, solution.x, 0.0)
    reference[-1] = 1.0
    whitened, drifts = (with_reference(grams, reference) for grams in (whitened, drifts))
    belief = solution.layout.prior_information(solution.model)
    mean = solution.layout.prior_mean(solution.model) - np.where(new, 0.0, solution.x)
    belief, mean = (np.concatenate([entry, np.zeros(len(leaving))]) for entry in (belief, mean))
    with_them = np.array([*(True for _ in range(width)), *(False for _ in leaving)])
    without = np.array([*(not entering for entering in new), *(True for _ in leaving)])
    entered = np.array([*new, *(False for _ in leaving)], dtype=np.bool_)
    of_time = all(belongs_to_its_time(find(name)) for name in entering)
    energy = powers(whitened, belief, entered, reference)
    blocks = alike(readings, np.zeros_like(energy) if of_time else energy, len(solution.states), count)
    energy, whitened, drifts = (np.add.reduceat(sums, blocks) for sums in (energy, whitened, drifts))
    spread = float(np.sum(energy)) ** 2 / max(float(np.sum(energy**2)), 1e-300)
    scored = whitened, drifts
    if of_time:  # as on another recording: its own part is fitted anew there, what it does to all others counts
        scored = profiled(whitened, entered, belief), profiled(drifts, entered, np.zeros_like(belief))
        spread = 0.0
    errors = [left_out(whitened, scored, columns, belief, mean) for columns in (without, with_them)]
    least = VALIDATION_RISE if of_time else 0.0
    changes = [
        paired("one-step error", errors[0][0], errors[1][0], whitened[:, -1, -1] > 0.0, least, spread),
        paired("drift", errors[0][1], errors[1][1], drifts[:, -1, -1] > 0.0, VALIDATION_RISE, spread),
    ]
    return [change for change in changes if change.blocks >= VALIDATION_LEAST_BLOCKS]


def rows_of(solution: Solution, index: int, leaving: int) -> list[int]:
    """Row of each column of a run among all coefficients, and of its innovations."""
    width = len(solution.layout.slots)
    return [*solution.layout.rows(index), *range(width, width + leaving + 1)]


def paired(measure: str, before: Array, after: Array, usable: Flags, least: float, spread: float) -> PairedChange:
    """The change of an error over the blocks where it is known, (blocks,)."""
    before, after = before[usable], after[usable]
    count = len(before)
    std = float(np.std(after - before, ddof=1)) / math.sqrt(count) if count > 1 else math.inf
    if not count:
        return PairedChange(measure, 0.0, 0.0, math.inf, 0, least, spread)
    return PairedChange(measure, float(np.mean(before)), float(np.mean(after)), std, count, least, spread)


def profiled(grams: Array, prior_rows: Flags, belief: Array) -> Array:
    """Gram matrices of [X y] after the columns of an effect were fitted within each block, (blocks, m + 1, m + 1)."""
    rows = np.flatnonzero(prior_rows)
    reduced = np.empty_like(grams)
    for number, gram in enumerate(grams):
        inside = gram[np.ix_(rows, rows)] + np.diag(belief[rows])
        fitted = np.linalg.lstsq(inside, gram[rows], rcond=VANISHING)[0]
        reduced[number] = gram - gram[:, rows] @ fitted
    return reduced


def left_out(
    whitened: Array, scored: tuple[Array, Array], columns: Flags, belief: Array, mean: Array
) -> tuple[Array, Array]:
    """Square errors of each block, summed, under coefficients that all other blocks determine, (blocks,) each.

    `whitened` holds the Gram matrices that determine them, `scored` those of whitened readings and drifts.

    A direction that the other blocks do not determine stays where it was without the effect.
    """
    block_columns = np.flatnonzero(columns)
    wide = np.append(block_columns, len(columns))
    total = whitened.sum(axis=0)[np.ix_(wide, wide)]
    errors = np.zeros((2, len(whitened)))
    for number, block in enumerate(whitened):
        rest = total - block[np.ix_(wide, wide)]
        information = rest[:-1, :-1] + np.diag(belief[block_columns])
        score = rest[:-1, -1] + belief[block_columns] * mean[block_columns]
        scaled, size = scaled_gram(information)
        values, vectors = np.linalg.eigh(scaled)
        certain = values > VANISHING * values[-1]
        inverse = np.divide(1.0, values, out=np.zeros_like(values), where=certain)
        x = np.append(-(vectors * inverse) @ (vectors.T @ (score / size)) / size, 1.0)
        for kind, grams in enumerate(scored):
            errors[kind, number] = max(0.0, float(x @ grams[number][np.ix_(wide, wide)] @ x))
    return errors[0], errors[1]


def powers(whitened: Array, belief: Array, new: Flags, reference: Array) -> Array:
    """Power of the part of an effect that all other coefficients leave of it, block by block, (blocks,)."""
    total = whitened.sum(axis=0)
    entering, others = np.flatnonzero(new), np.flatnonzero(~new)
    contribution = np.zeros(len(reference))
    contribution[entering] = reference[entering]
    information = total[np.ix_(others, others)] + np.diag(belief[others])
    cross = total[np.ix_(others, entering)] @ reference[entering]
    contribution[others] = -np.linalg.lstsq(information, cross, rcond=VANISHING)[0]
    return np.asarray(np.maximum(np.einsum("i,bij,j->b", contribution, whitened, contribution), 0.0))


def with_reference(grams: Array, reference: Array) -> Array:
    """Gram matrices of [X y] with y + X c in place of y, (blocks, m + 1, m + 1)."""
    turned = grams.copy()
    turned[:, :, -1] = grams @ reference
    turned[:, -1, :] = turned[:, :, -1]
    turned[:, -1, -1] = np.einsum("i,bij,j->b", reference, grams, reference)
    return turned


def alike(readings: Array, energy: Array, runs: int, count: int) -> NDArray[np.intp]:
    """First piece of each block: blocks of a run are alike in readings and power of the effect together.

    Parameters
    ----------
    readings, energy : of each piece, runs one behind the other, (pieces,).
    runs, count : number of runs, and of blocks in each.
    """
    firsts = []
    for run, (number, power) in enumerate(zip(np.split(readings, runs), np.split(energy, runs), strict=True)):
        share = number / max(float(np.sum(number)), 1.0)
        if np.sum(power) > 0.0:
            share = 0.5 * (share + power / np.sum(power))
        middle = np.cumsum(share) - 0.5 * share
        block = np.minimum((count * middle).astype(np.intp), count - 1)
        firsts.append(run * len(number) + np.unique(block, return_index=True)[1])
    return np.concatenate(firsts)


def pieces(
    state: RunState, terms: Sequence[Term], rows: Sequence[int], width: int, count: int
) -> tuple[Array, Array, Array]:
    """Gram matrices of [X y] of a run piece by piece: of whitened readings and of drifts; and the number of readings.

    Parameters
    ----------
    state, terms : the run and the m columns.
    rows : row of each column, and of the innovations, among all coefficients, (m + 1,).
    width : number of all coefficients.
    count : number of blocks that are made of the pieces.
    """
    fine = PIECES * count
    counted = state.run.t[state.counts]
    edges = np.quantile(counted, np.linspace(0.0, 1.0, fine + 1)) if len(counted) else np.zeros(fine + 1)
    grams = np.zeros((2, fine, len(rows), len(rows)))
    number = np.zeros(fine)

    def collect(kind: int, t: Array, columns: Array) -> None:
        ends = np.searchsorted(t, edges[1:-1])
        for piece, part in enumerate(np.split(columns, ends)):
            grams[kind, piece] += part.T @ part
            number[piece] += len(part) if kind == 0 else 0

    for t, columns, y in rows_of_run(state, terms):
        collect(0, t, np.column_stack([columns, y]))
    horizon = min(VALIDATION_HORIZON, (edges[-1] - edges[0]) / count / 3.0)
    collect(1, *drift_rows(state, terms, horizon))
    whole = np.zeros((2, fine, width + 1, width + 1))
    whole[np.ix_(range(2), range(fine), rows, rows)] = grams
    return whole[0], whole[1], number


def drift_rows(state: RunState, terms: Sequence[Term], horizon: float) -> tuple[Array, Array]:
    """Drifts z(t + h) - 2 z(t) + z(t - h) of the readings from the integrated output, and their columns.

    The difference of three positions holds the motion's acceleration over both horizons and neither the position nor
    the velocity at the start, so that no filter and no noise enters.

    Returns
    -------
    Instants t (n,) s, and columns (n, terms + 1) in m per unit coefficient, the drift last.
    """
    run, s, drive = state.run, state.signals, state.drive
    centres = np.arange(run.t[0] + horizon, run.t[-1] - horizon, horizon / CENTRES)
    if horizon <= 0.0 or not len(centres):
        return np.empty(0), np.empty((0, len(terms) + 1))
    around = [centres - horizon, centres, centres + horizon]
    breaks = np.cumsum(drive.restart)
    whole = (
        breaks[np.searchsorted(run.t, around[0], side="right") - 1]
        == breaks[np.minimum(np.searchsorted(run.t, around[2]), len(run.t) - 1)]
    )

    def second_difference(t: Array, y: Array) -> Array:
        before, at, after = (np.interp(instants, t, y) for instants in around)
        return np.asarray(before - 2.0 * at + after)

    factor, grid = -run.rig.polarity / s.scale, s.t + run.origins.t
    columns = [
        second_difference(grid, factor * integral(integral(column, s.step), s.step))
        if term.port == "output"
        else second_difference(run.t, column)
        for term, column in zip(terms, evaluated(state, terms), strict=True)
    ]
    missed = drive.z - accumulated(drive, np.diff(run.t, prepend=run.t[0]))[1]
    return centres[whole], np.column_stack([*columns, second_difference(run.t, missed)])[whole]
