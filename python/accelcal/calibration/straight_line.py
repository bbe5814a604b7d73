"""Deviation of a sensor's characteristic from its best straight line, with its uncertainty (IEEE 1293)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.calibration.characteristic import STATIC
from accelcal.data.arrays import Array
from accelcal.estimation.estimate import Fit

POINTS = 201
"""Accelerations at which the characteristic is evaluated, over which the line is fitted."""


@dataclass(frozen=True, slots=True)
class StraightLine:
    """Output over a range of acceleration, the best line through it, and what is left; m/s², n points."""

    a: Array
    """(n,) acceleration, equally spaced, rising."""
    output: Array
    """(n,) output of the characteristic at the reference temperature."""
    output_std: Array
    """(n,) its standard uncertainty from the fit."""
    offset: float
    slope: float
    """Of the line with the least sum of squares over `a`; slope 1."""
    deviation: Array
    """(n,) output less line."""
    deviation_std: Array
    """(n,) its standard uncertainty; below that of the output, since bias and scale factor have no part in it."""

    @property
    def largest(self) -> int:
        """Index of the largest deviation."""
        return int(np.argmax(np.abs(self.deviation)))

    @property
    def span(self) -> float:
        """Width of the range, m/s²."""
        return float(self.a[-1] - self.a[0])


def straight_line(fit: Fit, low: float | None = None, high: float | None = None) -> StraightLine:
    """Fit a line to the characteristic of a fit.

    The characteristic is linear in its coefficients, and so is its deviation from the line; both uncertainties are
    exact for the covariance of the fit. A level at which an effect clips is not part of it.

    Parameters
    ----------
    fit : estimates in forward sense.
    low, high : m/s² along the input axis, gravity included; the trained range by default.

    Raises
    ------
    ValueError
        If the range is empty: a fit to dwells at one acceleration.
    """
    trained = fit.validity["a"]
    low, high = trained[0] if low is None else low, trained[1] if high is None else high
    if not low < high:
        raise AccelcalError(f"straight_line: the range {low:g} to {high:g} m/s² is empty.")
    a = np.linspace(low, high, POINTS)
    terms = {name: np.array([term.per_unit(x, 0.0) for x in a]) for name, term in STATIC.items()}
    kept = [name for name in terms if name in fit.model.effects]
    values = np.array([fit[name].value for name in kept])
    columns = np.column_stack([terms[name] for name in kept])
    output = a + columns @ values
    lines = np.column_stack([np.ones(POINTS), a])
    offset, slope = np.linalg.lstsq(lines, output, rcond=None)[0].tolist()
    onto, _ = np.linalg.qr(lines)
    free = [e.name for e in fit.free]
    C = fit.covariance[np.ix_(*[[free.index(name) for name in kept if name in free]] * 2)]
    partials = columns[:, [name in free for name in kept]]
    return StraightLine(
        a=a,
        output=output,
        output_std=_std(partials, C),
        offset=offset,
        slope=slope,
        deviation=_left(columns, onto) @ values,
        deviation_std=_std(_left(partials, onto), C),
    )


def _left(y: Array, onto: Array) -> Array:
    """What a line does not explain of columns (n, m), zero where that is rounding; `onto` (n, 2) spans the lines."""
    left = y - onto @ (onto.T @ y)
    return np.asarray(np.where(np.abs(left) < 1e-12 * np.abs(y).max(axis=0, initial=0.0), 0.0, left))


def _std(partials: Array, covariance: Array) -> Array:
    """Standard deviations (n,) for partial derivatives (n, m)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", partials, covariance, partials), 0.0)))
