"""Parameters as readings come in, with their bands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal.effects import spelled
from accelcal.estimation.parameter_tracks import Track
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import ThemeName

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

COLUMNS = 2
PANEL, GAP = 220, 82
"""Height of a row of panels, and of the space between two, pixels."""
MOST = 8
"""Parameters that are drawn."""
SETTLED = 0.2
"""Share of the track whose uncertainty sizes the axis."""


def tracks(track: Track, *, theme: ThemeName = "light") -> Figure:
    """Draw estimate and ± 2 standard deviations of every parameter against time.

    Parameters
    ----------
    track : from `accelcal.estimation.parameter_tracks.track`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    count = min(MOST, len(track.names))
    rows = math.ceil(count / COLUMNS)
    names = [drawing.escaped(spelled(n)) for n in track.names[:count]]
    figure = drawing.new_figure(
        rows, COLUMNS, subplot_titles=names, vertical_spacing=min(0.5, GAP / (PANEL * rows)), horizontal_spacing=0.11
    )
    for i in range(count):
        place: dict[str, Any] = {"row": i // COLUMNS + 1, "column": i % COLUMNS + 1}
        y, std = track.values[:, i], track.std[:, i]
        known = np.isfinite(std)
        t, y, std = track.t[known], y[known], std[known]
        low, high = y - 2.0 * std, y + 2.0 * std
        late = slice(int(SETTLED * len(y)), None)
        ends = (float(low[late].min()), float(high[late].max())) if len(y) else (0.0, 1.0)
        factor, unit = drawing.display_scale(track.units[i], *ends)
        drawing.band(
            figure, t, low * factor, high * factor, "± 2 σ", palette.band, legend=i == 0, group="band", **place
        )
        drawing.curve(
            figure,
            t,
            y * factor,
            palette.residual,
            "estimate",
            unit=unit,
            showlegend=i == 0,
            legendgroup="estimate",
            **place,
        )
        figure.update_yaxes(range=[e * factor for e in ends], row=place["row"], col=place["column"])
        figure.update_yaxes(title_text=drawing.axis_title("estimate", unit), row=place["row"], col=place["column"])
        figure.update_xaxes(title_text=drawing.axis_title("time", "s"), row=place["row"], col=place["column"])
    left = len(track.names) - count
    drawing.format_figure(
        figure,
        palette,
        "Parameters from the readings up to each instant, with their uncertainty",
        note=f"{left} further parameters are not drawn" if left else "",
        height=drawing.BOTTOM + PANEL * rows,
        titled=True,
        left=92,
    )
    return figure
