"""Estimates as readings come in: the parameters and their uncertainty from the readings up to each instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from accelcal._support.result import Result
from accelcal._support.values import immutable, listing
from accelcal.data.arrays import Array
from accelcal.data.recording import Recording
from accelcal.estimation.estimate import Fit, engine_of, solve_runs
from accelcal.estimation.rows import rows_of_run

if TYPE_CHECKING:
    pass

POINTS = 240
"""Instants of a track."""
SINGULAR = 1e-10
"""Least eigenvalue of the scaled information at which a model is determined."""


@immutable
@dataclass(frozen=True, slots=True)
class Track(Result):
    """Estimates of every free parameter over time."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    t: Array
    """(n,) s"""
    values: Array
    """(n, m) SI; NaN while the readings do not determine the model."""
    std: Array
    """(n, m) SI"""

    def __repr__(self) -> str:
        return f"Track({', '.join(self.names)}: {len(self.t)} instants)"


def track(
    fit: Fit, recording: Recording, *, start: float | None = None, end: float | None = None, points: int = POINTS
) -> Track:
    """Estimate the parameters of a model from the readings up to each instant of a recording.

    Parameters
    ----------
    fit : its model and origins are used; the parameters are estimated anew.
    recording : one run.
    start, end : s, optional; only this part is used.
    points : instants, evenly spread.

    Raises
    ------
    NotIdentifiable
        If the whole record does not determine the model.

    Notes
    -----
    Information adds up: beta(t) = beta + G(t)^-1 s(t), with the Gram matrix G and the score s of the readings up to t,
    as a Kalman filter with the parameters in its state would. Noise and smoothed regressors are those of the whole
    record. Where a band was imposed, deviations are scaled to the robust ones at the end.
    """
    solution = solve_runs(fit.model, [recording], start=start, end=end, origins=fit.origins, engine=engine_of(fit))
    state, model = solution.states[0], solution.model
    run = state.run
    belief = solution.layout.prior_information(model)
    m = len(model.free)
    gram, score = np.diag(belief), belief * (solution.layout.prior_mean(model) - solution.x)
    at = np.linspace(run.t[0], run.t[-1], points + 1)[1:]
    values, std = np.full((points, m), np.nan), np.full((points, m), np.nan)
    k = 0
    for t, columns, y in rows_of_run(state, model.free):
        ends = np.searchsorted(t, at[k:], side="right")
        begin = 0
        for end in [*(int(each) for each in ends if each < len(t)), len(t)]:
            gram = gram + columns[begin:end].T @ columns[begin:end]
            score = score + columns[begin:end].T @ y[begin:end]
            if end < len(t):
                values[k], std[k] = estimate_from(gram, score, solution.x)
                k += 1
            begin = end
    values[k:], std[k:] = estimate_from(gram, score, solution.x)
    if state.band is not None:
        std = std * (np.sqrt(np.diag(solution.covariance)) / std[-1])
    return Track(
        names=tuple(term.name for term in model.free),
        units=tuple(term.unit for term in model.free),
        t=at,
        values=values,
        std=std,
    )


def estimate_from(gram: Array, score: Array, x: Array) -> tuple[Array, Array]:
    """Estimates and standard deviations from a Gram matrix and a score, NaN while the information is singular."""
    nothing = np.full(len(x), np.nan)
    size = np.sqrt(np.diag(gram))
    if not np.all(size > 0.0):
        return nothing, nothing
    eigenvalues, vectors = np.linalg.eigh(gram / np.outer(size, size))
    if eigenvalues[0] < SINGULAR:
        return nothing, nothing
    covariance = (vectors / eigenvalues) @ vectors.T / np.outer(size, size)
    return x + covariance @ score, np.sqrt(np.diag(covariance))


__dir__ = listing(globals())
