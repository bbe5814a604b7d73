"""Rows of the regression of one run: times, whitened columns and innovations, whatever the spectrum of its noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.estimation.columns import ColumnFilter, whitened_columns
from accelcal.estimation.dwell_rows import DwellRows, Nuisances, dwell_rows, stepped, with_scatter
from accelcal.estimation.noise import NoiseSearch
from accelcal.estimation.noise_spectrum import MeasuredSpectrum, measured_spectrum, whitener
from accelcal.estimation.run_state import RunState
from accelcal.estimation.weak_form.noise import with_noise
from accelcal.estimation.weak_form.rows import WeakRows
from accelcal.model import Model, Term

Rows = tuple[Array, Array, Array]
"""Times (n,) s, columns (n, m), innovations (n,)."""


def sums_of(state: RunState) -> ColumnFilter | WeakRows:
    """What makes innovations and columns of a run at a rate that its motion needs."""
    if state.run.engine == "replay":
        return ColumnFilter(state)
    if isinstance(state.weak, WeakRows):
        return state.weak
    state.weak = made = WeakRows(state)
    return made


def rows_of_run(state: RunState, terms: Sequence[Term]) -> Iterator[Rows]:
    """Rows of the readings that count, stretch by stretch, those of dwells last, at the time of the last reading.

    A run whose noise is not white is one stretch of sums.
    """
    if state.spectrum is None and state.run.engine == "weak":
        rows = sums_of(state)
        for part, columns in rows.stretches(terms):
            yield rows.times[part], columns.T, rows.whitened[part]
    elif state.spectrum is None:
        for readings, columns in whitened_columns(state, terms):
            kept = state.counts[readings]
            yield state.run.t[readings][kept], columns, state.whitened[readings][kept]
    else:
        sums = sums_of(state)
        whiten = whitener(state.spectrum, sums.rate)
        yield sums.times, whiten(sums.whole(terms)).T, whiten(sums.whitened)
    rest = rows_of_dwells(state, terms)
    if rest is not None:
        yield np.full(len(rest.y), state.run.t[-1]), rest.columns, rest.y


def rows_of_dwells(state: RunState, terms: Sequence[Term]) -> DwellRows | None:
    """Rows of the dwells that a recording has; None where it has none."""
    dwells = state.run.recording.dwells
    if dwells is None:
        return None
    return dwell_rows(dwells, terms, state.values, state.run.origins, state.of_dwells)


def measure_noise(state: RunState, model: Model) -> None:
    """Measure what is no white noise in what a model leaves of a run: the spectrum of its innovations, and the angle
    zeros of its dwells, a step on, with the scatter between them. The weak form has a likelihood of its own for q and
    R."""
    if state.run.engine == "weak":
        state.weak = made = with_noise(WeakRows(state)) if state.band is None else WeakRows(state)
        state.noise = made.noise
        state.search = NoiseSearch(state.noise) if state.band is None else state.search
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
