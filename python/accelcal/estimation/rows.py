"""Normal equations of one run: sums over the rows of its engine, and over blocks of the record."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelcal.data import STANDARD_GRAVITY, TILTS, Array, unit_diagonal
from accelcal.effects.registry import Effect, Shape, SizePrior
from accelcal.estimation.engines import ENGINES, Rows
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.run_state import RunState
from accelcal.model import Term
from accelcal.signals.signals import Signals

LEAST_BLOCKS = 8
"""Fewer blocks than this do not measure a scatter."""
MOST_BLOCKS = 40
"""More blocks are not needed to measure one."""


NEGLIGIBLE = 0.1
"""Standard deviation of an angle's rounding, times gravity, over that of the mean output of the rest, below which it
changes nothing: a hundredth of the variance. [; tests/estimation/test_arms.py]"""


def of_hold(s: Signals, begin: float, end: float) -> Array:
    """Output for each radian by which the angle of an arm is off while it rests."""
    level = math.cos(s.rig.axle or 0.0)
    return np.asarray(level * s.scale * s.side[TILTS[1]] * ((begin <= s.t) & (s.t <= end)))


INSTANT = Shape("s", (-math.inf, math.inf), trials=1)
ROUNDING = Effect(
    "angle_rounding",
    "rad",
    "output",
    "encoder",
    "ar",
    SizePrior(1e-3),
    of_hold,
    {"begin": INSTANT, "end": INSTANT},
    needs=TILTS,
)


def offsets_of(run: PreparedRun) -> tuple[tuple[Term, float], ...]:
    """Rounding error of the angle of an arm in each of its rests, and its standard deviation, rad.

    All readings of a rest share it, so that no number of them makes it smaller (derivations 7.9).
    """
    error = run.angle_error
    if error is None:
        return ()
    begin, end = error.spans.T
    least = NEGLIGIBLE * run.unpredicted.sample * np.sqrt(run.accel_step / (end - begin))
    pull = error.shared * STANDARD_GRAVITY * math.cos(run.rig.axle or 0.0)
    spans = error.spans[error.apart & (end > run.t[0]) & (begin < run.t[-1]) & (pull > least)] - run.origins.t
    return tuple((Term(ROUNDING, shape={"begin": a, "end": b}), error.shared) for a, b in spans.tolist())


def rows_of_run(state: RunState, terms: Sequence[Term]) -> Iterator[Rows]:
    """Rows of a run by its engine."""
    return ENGINES[state.run.engine].rows(state, terms)


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Normal equations of one run."""

    gram: Array
    """X'X, (m, m)."""
    score: Array
    """X'y, (m,)."""
    power: float
    """y'y."""
    spread: Array | None
    """Sum of outer products of block scores, (m, m); None if it is not asked for or there are fewer than 8 blocks."""
    blocks: Array | None = None
    """Number of equal blocks that would hold the information on each coefficient as unevenly, (m,); None without a
    band."""
    nuisances: tuple[tuple[Term, float], ...] = ()
    """Those of the run at their most likely sizes, the coefficients as they are."""
    following: Array | None = None
    """What these change by per unit of each coefficient, (nuisances, m); None where there are none."""

    def at(self, step: Array) -> tuple[tuple[Term, float], ...]:
        """The nuisances beside coefficients that a step (m,) has changed."""
        if self.following is None:
            return ()
        return tuple((t, u + float(row @ step)) for (t, u), row in zip(self.nuisances, self.following, strict=True))


def normal_equations(state: RunState, terms: Sequence[Term], *, scatter: bool = False) -> NormalEquations:
    """X'X and X'y of a run, its nuisances marginalised, stretch by stretch; X itself is never held whole.

    With `scatter` that of the block scores is summed without a band as well.
    """
    offsets, k = offsets_of(state.run), len(terms)
    terms = [*terms, *(term for term, _ in offsets)]
    m = len(terms)
    gram, score, power = np.zeros((m, m)), np.zeros(m), 0.0
    length = block_length(state)
    count = int(block_of(state, state.run.t[-1:], length)[0]) + 1 if scatter or state.band is not None else 0
    sums = np.zeros((count, m))
    squares = np.zeros_like(sums)
    for t, columns, y in rows_of_run(state, terms):
        gram += columns.T @ columns
        parts = columns * y[:, None]
        score += parts.sum(axis=0)
        power += float(y @ y)
        if count:
            block = block_of(state, t, length)
            np.add.at(sums, block, parts)
            np.add.at(squares, block, columns**2)
    blocks, following, belief = effective_number(squares[:, :k]) if count else None, None, np.zeros((k, k))
    nuisances: tuple[tuple[Term, float], ...] = ()
    if offsets:
        prior = np.array([std**-2 for _, std in offsets])
        at = np.array([u for _, u in state.values.nuisances] or np.zeros(len(offsets)))
        score[k:] -= prior * at
        among = np.linalg.inv(gram[k:, k:] + np.diag(prior))
        following, change = -among @ gram[k:, :k], among @ score[k:]
        gram = gram[:k, :k] + gram[:k, k:] @ following
        score, power = score[:k] + score[k:] @ following, power - float(score[k:] @ change)
        sums, belief = sums[:, :k] + sums[:, k:] @ following, following.T @ (prior[:, None] * following)
        nuisances = tuple((term, float(u)) for (term, _), u in zip(offsets, at + change, strict=True))
    spread = sums.T @ sums + belief if count >= LEAST_BLOCKS else None
    return NormalEquations(gram, score, power, spread, blocks, nuisances, following)


def effective_number(squares: Array) -> Array:
    """Sum squared over sum of squares of the blocks of each column (K, m): K where all are alike, else fewer."""
    total = squares.sum(axis=0)
    return np.asarray(total**2 / np.maximum((squares**2).sum(axis=0), 1e-300))


def inverse(information: Array) -> Array:
    """Pseudo-inverse of an information matrix (m, m), scaled to a unit diagonal."""
    scaled, size = unit_diagonal(information)
    return np.asarray(np.linalg.pinv(scaled, hermitian=True) / np.outer(size, size))


def information(state: RunState, term: Term) -> float:
    """Information of a run on the coefficient of one more term, all others known."""
    return float(normal_equations(state, [term]).gram[0, 0])


def block_length(state: RunState) -> float:
    """Length of a block, s; blocks outlast the memory of the filter."""
    t = state.run.t
    return max(float(t[-1] - t[0]) / MOST_BLOCKS, 1.0 / state.run.crossover(state.noise))


def block_of(state: RunState, t: Array, length: float) -> NDArray[np.intp]:
    """Block of each instant, (n,)."""
    return np.asarray((t - state.run.t[0]) / length, dtype=np.intp)
