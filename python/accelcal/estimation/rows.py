"""Rows of the regression of one run: times, whitened columns and innovations, whatever the spectrum of its noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import POSITION_ORDER, Array, RecordingError
from accelcal.estimation.columns import ColumnFilter, whitened_columns
from accelcal.estimation.dwell_rows import DwellRows, Nuisances, dwell_rows, stepped, with_scatter
from accelcal.estimation.noise import (
    MeasuredSpectrum,
    NoiseSearch,
    blocks,
    measured_spectrum,
    most_likely_noise,
    whitener,
)
from accelcal.estimation.run_state import RunState
from accelcal.estimation.values import Noise
from accelcal.estimation.weak_form.covariance import NoWeakForm, factor, solved
from accelcal.estimation.weak_form.rows import WeakRows
from accelcal.model import Model, Term

MOST_OF_BOTH = 0.9
"""Largest share of the sensor in the noise of two accelerations."""
READINGS_KNOWN = math.log(3.0)
"""Standard deviation of what the readings themselves tell of the logarithm of their variance."""
BLOCK_ROWS = 2048
"""Rows of one of the blocks that the likelihood is taken over."""


def with_noise(rows: WeakRows, width: float = 0.3) -> WeakRows:
    """The rows at the noise that is most likely near theirs; first steps in log q and log r are `width`.

    What varies along the record stays as it is. Readings so good that the rows do not show their noise have the one
    that their neighbours do not predict.
    """
    start, told = rows.noise, rows.state.run.unpredicted.reading
    if rows.order == 0:
        return rows.at_noise(shared(rows))
    known = 2.0 * math.log(told) if told > 0.0 and rows.order == POSITION_ORDER else None
    parts = [(rows.covariance.part(block), rows.raw[block][:, None]) for block in blocks(rows.rows, BLOCK_ROWS)]

    def log_likelihood(log_q: float, log_r: float) -> float:
        total = 0.0 if known is None else -0.5 * ((log_r - known) / READINGS_KNOWN) ** 2
        for covariance, y in parts:
            try:
                L = factor(covariance.at(math.exp(log_q), math.exp(log_r)))
            except NoWeakForm:
                return -math.inf
            total -= 0.5 * float(np.sum(solved(L, y) ** 2)) + float(np.sum(np.log(L[0])))
        return total

    found = most_likely_noise(log_likelihood, rows.least_reading_variance, start, width)
    return rows.at_noise(replace(start, q=found.q, r=found.r))


def shared(rows: WeakRows) -> Noise:
    """Noise of the output and of a reference that is an acceleration, of which the rows show the sum alone.

    The sensor has what is declared of it, if that is less than all, and half of it where nothing is.
    """
    run, step = rows.state.run, rows.reading_step
    both = float(np.mean(rows.whitened**2)) * (rows.noise.q + rows.noise.r * step)
    declared = run.rig.sensor.noise
    q = both / 2.0 if declared is None else 0.5 * (declared / rows.state.values.scale) ** 2
    q = min(q, MOST_OF_BOTH * both)
    return replace(rows.noise, q=q, r=(both - q) / step)


Rows = tuple[Array, Array, Array]
"""Times (n,) s, columns (n, m), innovations (n,)."""


def sums_of(state: RunState) -> ColumnFilter | WeakRows:
    """What makes innovations and columns of a run at a rate that its motion needs.

    Raises
    ------
    RecordingError
        If it is to be the weak form, and the run has none.
    """
    if state.run.engine == "replay":
        return ColumnFilter(state)
    if isinstance(state.weak, WeakRows):
        return state.weak
    state.weak = made = weak_form(state)
    return made


def weak_form(state: RunState) -> WeakRows:
    """The weak form of a run that is to be fitted by it, and holds it.

    Raises
    ------
    RecordingError
        If the run has none; the text names it.
    """
    try:
        return WeakRows(state).held()
    except NoWeakForm as error:
        name = state.run.recording.name or "recording"
        raise RecordingError(f"{name}: no weak form: {error}; fit it by the replay, --method replay") from error


def rows_of_run(state: RunState, terms: Sequence[Term]) -> Iterator[Rows]:
    """Rows of the readings that count, stretch by stretch, those of dwells last, at the time of the last reading.

    A run whose noise is not white is one stretch of sums.
    """
    sums = sums_of(state)
    yield from rows_of_weak_form(state, sums, terms) if isinstance(sums, WeakRows) else rows_of_replay(state, terms)


def rows_of_replay(state: RunState, terms: Sequence[Term]) -> Iterator[Rows]:
    """Those of the replay."""
    if state.spectrum is None:
        for readings, columns in whitened_columns(state, terms):
            kept = state.counts[readings]
            yield state.run.t[readings][kept], columns, state.whitened[readings][kept]
    else:
        yield coloured_rows(state.spectrum, ColumnFilter(state), terms)
    yield from last_rows(state, terms)


def rows_of_weak_form(state: RunState, weak: WeakRows, terms: Sequence[Term]) -> Iterator[Rows]:
    """Those of the weak form of the run."""
    if state.spectrum is None:
        times, y = weak.times, weak.whitened
        for part, columns in weak.stretches(terms):
            yield times[part], columns.T, y[part]
    else:
        yield coloured_rows(state.spectrum, weak, terms)
    yield from last_rows(state, terms)


def coloured_rows(spectrum: MeasuredSpectrum, sums: ColumnFilter | WeakRows, terms: Sequence[Term]) -> Rows:
    """Sums of the whole run, whitened by a spectrum."""
    whiten = whitener(spectrum, sums.rate)
    return sums.times, whiten(sums.whole(terms)).T, whiten(sums.whitened)


def last_rows(state: RunState, terms: Sequence[Term]) -> Iterator[Rows]:
    """Those of the dwells of a run, at the time of its last reading."""
    rest = rows_of_dwells(state, terms)
    if rest is not None:
        yield np.full(len(rest.y), state.run.t[-1]), rest.columns, rest.y


def rows_of_dwells(state: RunState, terms: Sequence[Term]) -> DwellRows | None:
    """Rows of the dwells that a recording has; None where it has none."""
    dwells = state.run.recording.dwells
    if dwells is None:
        return None
    return dwell_rows(dwells, terms, state.values, state.run.origins, state.of_dwells)


def measure_noise(state: RunState, model: Model, *, search: bool = True) -> None:
    """Measure what is no white noise in what a model leaves of a run: the spectrum of its innovations, and the angle
    zeros of its dwells, a step on, with the scatter between them.

    Where noise is to be searched for, the weak form takes that of its own likelihood, but beside a band, or effects on
    noise.
    """
    if state.run.engine == "weak" and search and state.band is None and not state.noise.growth:
        state.weak = made = with_noise(weak_form(state))
        state.noise = made.of_positions
        state.search = NoiseSearch(state.noise)
    state.spectrum = spectrum_of(state, model.free)
    settle_dwells(state, model)


def settle_dwells(state: RunState, model: Model, steps: int = 1) -> None:
    """Move the angle zeros of the dwells of a run on by some Newton steps; at first they are 0."""
    dwells, known = state.run.recording.dwells, state.of_dwells
    if dwells is None:
        return
    at = state.values, state.run.origins
    for _ in range(0 if known is None and steps == 1 else steps):
        known = stepped(dwells, *at, replace(known or Nuisances(), apart=model.per_run))
    state.of_dwells = with_scatter(dwells, model, *at, replace(known or Nuisances(), apart=model.per_run))


def spectrum_of(state: RunState, terms: Sequence[Term]) -> MeasuredSpectrum | None:
    """Spectrum of what the terms leave of a run's innovations; None where it is white."""
    crossover, sums = state.run.crossover(state.noise), sums_of(state)
    y = sums.whitened
    if state.band is None and white(measured_spectrum(y, sums.rate, crossover)):
        return None
    X = sums.whole(terms)
    size = np.sqrt(np.maximum(np.sum(X**2, axis=1), 1e-300))
    if not np.all(np.isfinite(size)) or not np.isfinite(y @ y):
        return None  # the solve says so
    basis = scipy.linalg.orth((X / size[:, None]).T)
    explained = np.minimum(np.sum(scipy.fft.dct(basis, norm="ortho", axis=0) ** 2, axis=1), 1.0)
    found = measured_spectrum(y - basis @ (basis.T @ y), sums.rate, crossover, explained)
    return None if state.band is None and white(found) else found


def white(spectrum: MeasuredSpectrum | None) -> bool:
    """Whether a run needs no spectrum."""
    return spectrum is None or spectrum.white


LEAST_BLOCKS = 8
"""Fewer blocks than this do not measure a scatter."""
MOST_BLOCKS = 40
"""More blocks are not needed to measure one."""


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
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.asarray(np.linalg.pinv(information / np.outer(size, size), hermitian=True) / np.outer(size, size))


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
