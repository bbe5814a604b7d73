"""Measured and simulated position, and the error of the simulation with the band expected from noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.data.units import instant
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting
from accelcal.validation.comparison import Comparison

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def simulated(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw measured and simulated position, and below them the error of the simulation.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly or tsdownsample is not installed.
    """
    palette = style.theme_of(theme)
    t, measured, position = comparison.simulated
    error, spread = position - measured, 2.0 * comparison.simulated_std
    factor, unit = formatting.prefixed("m", measured)
    error_factor, error_unit = formatting.prefixed("m", error)
    figure = drawing.new_figure(2, 1, shared_xaxes=True, row_heights=[0.58, 0.42], vertical_spacing=0.06)
    drawn = drawing.trace(figure, t, measured, palette.measured, "measured", factor=factor, unit=unit)
    drawing.trace(figure, t, position, palette.model, "simulated", factor=factor, unit=unit)
    at, reach = style.column_medians(t, spread)
    reach = reach * error_factor
    drawing.band(figure, at, -reach, reach, "expected from noise, ± 2 σ", palette.band, row=2)
    drawing.trace(
        figure, t, error, palette.residual, "simulated − measured", factor=error_factor, unit=error_unit, row=2
    )
    drawing.format_figure(
        figure,
        palette,
        f"Simulated without position from {instant(t[0])} s on: "
        f"rms error {formatting.length(comparison.simulated_rms)}",
        note=drawn.note,
        height=460,
    )
    figure.update_yaxes(title_text=drawing.axis_title("position", unit), row=1, col=1)
    edge = (
        1.1 * error_factor * max(float(np.abs(error).max()), min(float(spread.max()), 3.0 * float(np.abs(error).max())))
    )
    figure.update_yaxes(title_text=drawing.axis_title("error", error_unit), range=[-edge, edge], row=2, col=1)
    figure.update_xaxes(title_text=drawing.axis_title("time", "s"), row=2, col=1)
    return figure
