"""Normal equations of one run: sums over the rows of its engine, and over blocks of the record."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelcal.data import Array, unit_diagonal
from accelcal.estimation.engines import ENGINES, Rows
from accelcal.estimation.run_state import RunState
from accelcal.model import Term

LEAST_BLOCKS = 8
"""Fewer blocks than this do not measure a scatter."""
MOST_BLOCKS = 40
"""More blocks are not needed to measure one."""


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


def normal_equations(state: RunState, terms: Sequence[Term], *, scatter: bool = False) -> NormalEquations:
    """X'X and X'y of a run, stretch by stretch; X itself is never held whole.

    With `scatter` that of the block scores is summed without a band as well.
    """
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
    spread = sums.T @ sums if count >= LEAST_BLOCKS else None
    return NormalEquations(gram, score, power, spread, effective_number(squares) if count else None)


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
