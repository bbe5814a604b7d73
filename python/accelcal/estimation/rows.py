"""Rows of the regression of one run: times, whitened columns and innovations, whatever the spectrum of its noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.data.recording import RecordingError
from accelcal.estimation.columns import ColumnFilter, whitened_columns
from accelcal.estimation.dwell_rows import DwellRows, Nuisances, dwell_rows, stepped, with_scatter
from accelcal.estimation.noise import NoiseSearch
from accelcal.estimation.noise_spectrum import MeasuredSpectrum, measured_spectrum, whitener
from accelcal.estimation.run_state import RunState
from accelcal.estimation.weak_form.covariance import NoWeakForm
from accelcal.estimation.weak_form.noise import with_noise
from accelcal.estimation.weak_form.rows import WeakRows
from accelcal.model import Model, Term

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
