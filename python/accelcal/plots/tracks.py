"""Figures of parameters over time, also while a measurement runs, and of a fitted curve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from accelcal.data.arrays import Array
from accelcal.effects import spelled
from accelcal.estimation.parameter_tracks import Track
from accelcal.estimation.shape_functions import Shape
from accelcal.live.session import Columns, LiveHistory
from accelcal.plots.figure import Axis, Band, Figure, Line, Mark, Panel, Points, sentence
from accelcal.plots.style import Role
from accelcal.plots.timeline import TIME
from accelcal.results import words as formatting

MOST = 8
"""Parameters that are drawn."""
SETTLED = 0.2
"""Share of a track after which its uncertainty sizes the axis."""
SIGMAS = "± 2 σ"


def tracks(track: Track) -> Figure:
    """Draw estimate and ± 2 standard deviations of every parameter against time.

    Parameters
    ----------
    track : from `accelcal.estimation.parameter_tracks.track`.
    """
    panels = []
    for name, y, std, si in zip(track.names[:MOST], track.values.T, track.std.T, track.units, strict=False):
        known = np.isfinite(std)
        ends = settled(y[known] - 2.0 * std[known], y[known] + 2.0 * std[known]) or (0.0, 1.0)
        factor, unit = formatting.prefixed(si, *ends) if si != "s" else milliseconds(*ends)
        y, reach = y[known] * factor, 2.0 * std[known] * factor
        marks = (Band(track.t[known], y - reach, y + reach, SIGMAS), Line(track.t[known], y, "estimate", "residual"))
        axis = Axis("estimate", unit, range=(ends[0] * factor, ends[1] * factor))
        panels.append(Panel(marks, TIME, axis, spelled(name), 138.0))
    left = len(track.names) - len(panels)
    note = f"{left} further parameters are not drawn" if left else ""
    headline = "Parameter estimates from the readings up to each instant, with their uncertainty"
    return Figure(tuple(panels), headline, note, columns=2)


def milliseconds(*values: float) -> tuple[float, str]:
    """Factor and unit in which the largest of some times reads well."""
    factor, unit = formatting.prefixed("m", *values)
    return factor, f"{unit[:-1]}s"


def settled(low: Array, high: Array) -> tuple[float, float] | None:
    """Range of a band (n,) once it has settled; None where all that is drawn is to be seen."""
    late = slice(int(SETTLED * len(low)), None)
    ends = (float(low[late].min()), float(high[late].max())) if len(low) else (np.nan, np.nan)
    return ends if np.isfinite(ends).all() and ends[0] < ends[1] else None


def live_tracks(history: LiveHistory) -> Figure:
    """Draw a live view: each parameter ± 2 standard deviations, the newest innovations, the running NIS.

    Parameters
    ----------
    history : of the view.
    """
    seen = Columns.of(history.moments, len(history.parameters))
    t = np.round(seen.t, 3)
    panels = []
    for parameter, y, std in zip(history.parameters, seen.values.T, seen.stds.T, strict=True):
        marks: tuple[Mark, ...] = (Band(t, y - 2.0 * std, y + 2.0 * std, SIGMAS), Line(t, y, role="residual"))
        axis = Axis("estimate", parameter.unit, range=settled(y - 3.0 * std, y + 3.0 * std))
        panels.append(Panel(marks, TIME, axis, spelled(parameter.name), 150.0))
    factor = 1e6
    wide = 2.0 * seen.std * factor
    marks = (Band(t, -wide, wide, SIGMAS), Line(t, seen.e * factor, role="residual", marker="."))
    panels.append(Panel(marks, TIME, Axis("innovation", "µm"), "innovation", 150.0))
    at = np.array([alarm.since for alarm in history.alarms], dtype=float)
    known = np.isfinite(seen.nis)
    height = np.interp(at, t[known], seen.nis[known]) if known.any() and len(at) else np.zeros(0)
    nis = (Band(t, seen.low, seen.high), Line(t, seen.nis, role="residual"))
    alarms = Points(at[: len(height)], height, "alarm", "fault", hover=[f"alarm at {s:.4g} s" for s in at])
    panels.append(Panel((*nis, alarms), TIME, Axis("NIS", "1"), "NIS, 99 % inside the band", 150.0))
    return Figure(tuple(panels), "Parameters, innovations and NIS up to now", shared_x=True, key="live")


def fitted_curve(recovered: Sequence[Shape]) -> Figure:
    """Draw the branches of one nonparametric curve with ± 2 standard deviations.

    Parameters
    ----------
    recovered : branches of one effect, from `accelcal.estimation.shape_functions.shapes`.
    """
    if not recovered:
        return sentence("Nonparametric curve", "The model contains no nonparametric curve.")
    first, marks = recovered[0], list[Mark]()
    factor, unit = formatting.prefixed(first.unit, *[branch.value for branch in recovered])
    x_factor, x_unit = (1.0, "s") if first.variable_unit == "s" else formatting.prefixed(first.variable_unit, first.x)
    roles: tuple[Role, ...] = ("model", "other")
    for branch, role in zip(recovered, roles, strict=False):
        x, y, reach = branch.x * x_factor, branch.value * factor, 2.0 * branch.std * factor
        name = branch.label or "estimate"
        marks += [Band(x, y - reach, y + reach, f"{name}, ± 2 σ", role), Line(x, y, name, role)]
    panel = Panel(tuple(marks), Axis(first.variable, x_unit), Axis("contribution", unit), height=282.0)
    return Figure((panel,), f"Nonparametric curve of {first.variable}", "a constant offset is confounded with bias")
