"""Rows of the regression of one run: times, whitened columns and innovations, whatever the spectrum of its noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.estimation.columns import ColumnFilter, whitened_columns
from accelcal.estimation.noise_spectrum import MeasuredSpectrum, measured_spectrum, whitener
from accelcal.estimation.run_state import RunState
from accelcal.model import Term

Rows = tuple[Array, Array, Array]
"""Times (n,) s, columns (n, m), innovations (n,)."""


def rows_of_run(state: RunState, terms: Sequence[Term]) -> Iterator[Rows]:
    """Rows of the readings that count, stretch by stretch; a run whose noise is not white is one stretch of sums."""
    if state.spectrum is None:
        for readings, columns in whitened_columns(state, terms):
            kept = state.counts[readings]
            yield state.run.t[readings][kept], columns, state.whitened[readings][kept]
        return
    sums = ColumnFilter(state)
    whiten = whitener(state.spectrum, sums.rate)
    yield sums.times, whiten(sums.whole(terms)).T, whiten(sums.whitened)


def spectrum_of(state: RunState, terms: Sequence[Term]) -> MeasuredSpectrum | None:
    """Spectrum of what the terms leave of a run's innovations; None where it is white."""
    crossover, sums = state.run.crossover(state.noise), ColumnFilter(state)
    y = sums.whitened
    if state.band is None and white(measured_spectrum(y, sums.rate, crossover)):
        return None
    X = sums.whole(terms)
    size = np.sqrt(np.maximum(np.sum(X**2, axis=1), 1e-300))
    basis = scipy.linalg.orth((X / size[:, None]).T)
    explained = np.minimum(np.sum(scipy.fft.dct(basis, norm="ortho", axis=0) ** 2, axis=1), 1.0)
    found = measured_spectrum(y - basis @ (basis.T @ y), sums.rate, crossover, explained)
    return None if state.band is None and white(found) else found


def white(spectrum: MeasuredSpectrum | None) -> bool:
    """Whether a run needs no spectrum."""
    return spectrum is None or spectrum.white
