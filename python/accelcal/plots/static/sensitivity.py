"""Figure of a frequency response: magnitude and phase with expanded uncertainties, and the fitted structure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.formatting import label
from accelcal.plots import style
from accelcal.plots.style import ThemeName
from accelcal.response import FrequencyResponse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 7.0, 5.0
"""Inches."""


def sensitivity(found: FrequencyResponse, *, theme: ThemeName = "light") -> Figure:
    """Draw magnitude and phase against frequency.

    Parameters
    ----------
    found : from `accelcal.response.frequency_response`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    figure = style.new_figure(WIDTH, HEIGHT, palette)
    upper, lower = figure.subplots(2, 1, sharex=True)
    f = np.array([p.frequency for p in found.points])
    phase = np.unwrap(np.array([p.phase for p in found.points]))
    rows = (
        (upper, np.array([p.magnitude for p in found.points]), np.array([p.expanded for p in found.points])),
        (lower, np.degrees(phase), np.degrees([p.expanded_phase for p in found.points])),
    )
    for axes, y, unit in ((upper, "magnitude", "1"), (lower, "phase", "°")):
        style.format_axes(axes, palette, x=label("frequency", "Hz") if axes is lower else "", y=label(y, unit))
        axes.set_xscale("log")
    for axes, values, expanded in rows:
        axes.errorbar(
            f, values, expanded, color=palette.model.colour, linestyle="none", marker=palette.model.marker,
            markersize=4.0, capsize=2.0, label="measured, k = 2",
        )  # fmt: skip
    if found.model is not None:
        best = found.model.best
        grid = np.geomspace(f[0], f[-1], 400)
        fitted = best.response(grid)
        turns = np.unwrap(np.angle(fitted))
        turns += 2.0 * np.pi * round((phase[0] - turns[0]) / (2.0 * np.pi))
        upper.plot(grid, np.abs(fitted), color=palette.band, linewidth=1.4, label=best.structure.name)
        lower.plot(grid, np.degrees(turns), color=palette.band, linewidth=1.4)
    style.legend(upper, palette, columns=2)
    return figure
