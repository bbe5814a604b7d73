"""Frequency response: magnitude and phase with expanded uncertainties, each above its deviation from the fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.data.arrays import Flags
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.response import ResponseCurves, ResponsePanel, response_curves
from accelcal.plots.style import LineStyle, Theme, ThemeName
from accelcal.response import FrequencyResponse

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

TALL, THIN = 180, 100
"""Heights of a panel and of a deviation, pixels."""


def sensitivity(found: FrequencyResponse, *, theme: ThemeName = "light") -> Figure:
    """Draw magnitude and phase against frequency, and where the parametric fit deviates.

    Parameters
    ----------
    found : from `accelcal.response.frequency_response`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    curves = response_curves(found)
    heights = [THIN if panel.is_deviation else TALL for panel in curves.panels]
    figure = drawing.new_figure(
        len(heights), 1, shared_xaxes=True, row_heights=heights, vertical_spacing=24.0 / (sum(heights) + 72.0)
    )
    for row, panel in enumerate(curves.panels, 1):
        for chosen, line, name in (
            (~curves.failing, palette.model, "measured, U (k = 2)"),
            (curves.failing, palette.other, "measured, the fit fails"),
        ):
            if chosen.any():
                _measured(figure, curves, panel, chosen, line, name, row)
        _fitted(figure, curves, panel, palette, row)
    drawing.format_figure(figure, palette, curves.sentence, height=sum(heights) + 72 + drawing.BOTTOM)
    figure.update_xaxes(**drawing.logarithmic(*curves.ends()))
    figure.update_xaxes(title_text=drawing.axis_title("frequency", "Hz"), row=len(heights), col=1)
    figure.update_yaxes(tickfont_size=11)  # four digits beside a title, also on a phone
    for row, panel in enumerate(curves.panels, 1):
        figure.update_yaxes(
            title_text=drawing.axis_title(panel.quantity, panel.unit), range=panel.reach(), row=row, col=1
        )
    return figure


def _measured(
    figure: Figure,
    curves: ResponseCurves,
    panel: ResponsePanel,
    chosen: Flags,
    line: LineStyle,
    name: str,
    row: int,
) -> None:
    """Points with bars of the expanded uncertainty; named in the legend once."""
    expanded = panel.expanded[chosen]
    unit = "" if panel.unit == "1" else f" {panel.unit}"
    figure.add_scatter(
        x=curves.frequency[chosen],
        y=panel.measured[chosen],
        error_y={"type": "data", "array": expanded, "color": line.colour, "thickness": 1.3, "width": 3},
        customdata=expanded,
        name=name,
        legendgroup=name,
        showlegend=row == 1,
        mode="markers",
        marker={"symbol": drawing.MARKERS[line.marker], "size": 7, "color": line.colour},
        hovertemplate=f"%{{x:.5g}} Hz: %{{y:.6g}} ± %{{customdata:.2g}}{unit}<extra>{panel.quantity}</extra>",
        row=row,
        col=1,
    )


def _fitted(figure: Figure, curves: ResponseCurves, panel: ResponsePanel, palette: Theme, row: int) -> None:
    """The parametric fit; a deviation is measured from it."""
    if panel.fitted is None:
        return
    ends = np.array([0, -1]) if panel.is_deviation else slice(None)
    figure.add_scatter(
        x=curves.grid[ends],
        y=panel.fitted[ends],
        name=drawing.escaped(curves.structure),
        legendgroup="fit",
        showlegend=row == 1,
        mode="lines",
        line={"color": palette.band, "width": 1.8},
        hovertemplate="%{x:.5g} Hz: %{y:.6g}<extra>fit</extra>",
        row=row,
        col=1,
    )
