"""Stretches of a record that count as independent: errors averaged over them, and the drift that has enough of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array
from accelcal.validation.comparison import Evaluation

LEAST_STRETCHES = 5
"""Fewer stretches than this do not determine a standard error."""
HORIZONS_APART = 2.0
"""Length of a stretch in horizons: windows that begin in one hardly reach into the next but one."""


def stretch_means(t: Array, length: float, *squares: Array) -> tuple[NDArray[np.intp], list[Array]]:
    """Number of errors in each stretch of time that holds any, (k,), and the means of their squares, (k,) each.

    Parameters
    ----------
    t : instants, rising, (n,) s.
    length : of a stretch, s.
    squares : squared errors at these instants, (n,) each.
    """
    if not len(t):
        return np.empty(0, dtype=np.intp), [np.empty(0) for _ in squares]
    stretch = ((t - t[0]) / length).astype(np.intp)
    number = np.bincount(stretch)
    some = number > 0
    return number[some], [np.bincount(stretch, y)[some] / number[some] for y in squares]


def stretch_count(seen: Evaluation, horizon: float) -> int:
    """Stretches of two horizons among the start points of a drift; 0 where the record is too short for it."""
    if horizon not in seen.drifts:
        return 0
    return len(stretch_means(seen.drifts[horizon][0], HORIZONS_APART * horizon)[0])


def headline_horizon(*seen: Evaluation) -> float | None:
    """The drift that is quoted first: the longest horizon with enough independent stretches to have an interval.

    Parameters
    ----------
    seen : the comparisons that are shown together, at least one.

    Returns
    -------
    s; the shortest horizon that all of them allow where none has enough stretches, None where they allow none.
    """
    allowed = [h for h in seen[0].coast_rms if all(each.coast_rms.get(h) is not None for each in seen)]
    sure = [h for h in allowed if all(stretch_count(each, h) >= LEAST_STRETCHES for each in seen)]
    return max(sure, default=min(allowed, default=None))


def quoted_error(seen: Evaluation, horizon: float | None) -> float:
    """Rms unaided drift over a horizon, or the free-running error for None, m; NaN where there is none."""
    value = seen.simulated_rms if horizon is None else seen.coast_rms.get(horizon)
    return math.nan if value is None else value
