"""A running measurement: parameters with their bands, innovations and NIS over time; drawn once, then fed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.data.arrays import Array
from accelcal.effects import spelled
from accelcal.live.moments import Columns, LiveHistory
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import ThemeName

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PANEL, GAP = 150, 46
"""Height of a panel, and of the space between two, pixels."""
SETTLED = 0.2
"""Share of the moments after which the uncertainty sizes the axis."""
MICROMETRES = 1e6


def live_tracks(history: LiveHistory, *, theme: ThemeName = "light") -> Figure:
    """Draw a live view: each parameter ± 2 standard deviations, the newest innovations, the running NIS.

    Parameters
    ----------
    history : of the view.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    parameters = history.parameters
    rows = len(parameters) + 2
    inside = PANEL * rows + GAP * (rows - 1)
    titles = [spelled(parameter.name) for parameter in parameters] + ["innovation", "NIS, 99 % inside the band"]
    names = [drawing.escaped(title) for title in titles]
    figure = drawing.new_figure(
        rows, 1, shared_xaxes=True, vertical_spacing=GAP / inside, subplot_titles=names, row_heights=[1.0] * rows
    )
    data, span = iter(live_curves(history)), live_ranges(history)
    for i, unit in enumerate([*(parameter.unit for parameter in parameters), "µm", "1"]):
        (x, low), (_, high), (_, y) = next(data), next(data), next(data)
        is_parameter, row = i < len(parameters), i + 1
        name = "± 2 σ" if is_parameter or unit == "µm" else "99 %"
        drawing.band(figure, x, low, high, name, palette.band, row=row, legend=i == 0, group="band")
        drawing.curve(
            figure, x, y, palette.residual, titles[i], unit=unit, row=row, markers=unit == "µm", showlegend=False
        )
        quantity = "estimate" if is_parameter else ("innovation" if unit == "µm" else "NIS")
        figure.update_yaxes(title_text=drawing.axis_title(quantity, unit), row=row, col=1)
        if span[i] is not None:
            figure.update_yaxes(range=span[i], row=row, col=1)
    x, y = next(data)
    figure.add_scatter(
        x=x,
        y=y,
        mode="markers",
        name="alarm",
        marker={"symbol": "x", "size": 10, "color": palette.other.colour},
        hovertemplate="alarm at %{x:.4g} s<extra></extra>",
        row=rows,
        col=1,
    )
    figure.update_xaxes(title_text=drawing.axis_title("time", "s"), row=rows, col=1)
    figure.update_layout(uirevision="live")
    figure.update_traces(line_width=1.4, marker_size=4, selector={"mode": "lines+markers"})
    headline = "Parameters, innovations and NIS up to now"
    return drawing.format_figure(figure, palette, headline, height=drawing.BOTTOM + inside, titled=True, left=88)


def live_curves(history: LiveHistory) -> list[tuple[Array, Array]]:
    """Abscissa and ordinate of each trace of `live_tracks`, in its order, as they are now, in few digits."""
    seen = Columns.of(history.moments, len(history.parameters))
    t, found = np.round(seen.t, 3), []
    for i in range(len(history.parameters)):
        y, wide = seen.values[:, i], 2.0 * seen.stds[:, i]
        found += [(t, y - wide), (t, y + wide), (t, y)]
    wide = 2.0 * seen.std * MICROMETRES
    found += [(t, -wide), (t, wide), (t, seen.e * MICROMETRES)]
    found += [(t, seen.low), (t, seen.high), (t, seen.nis)]
    at = np.array([alarm["since_s"] for alarm in history.alarms], dtype=float)
    known = np.isfinite(seen.nis)
    height = np.interp(at, t[known], seen.nis[known]) if known.any() and len(at) else np.zeros(0)
    found.append((at[: len(height)], height))
    return [(x, y.astype(np.float32)) for x, y in found]


def live_ranges(history: LiveHistory) -> list[list[float] | None]:
    """Range of each ordinate of `live_tracks`; None where all that is drawn is to be seen."""
    seen = Columns.of(history.moments, len(history.parameters))
    late = slice(int(SETTLED * len(seen.t)), None)
    found: list[list[float] | None] = []
    for i in range(len(history.parameters)):
        low, high = seen.values[late, i] - 3.0 * seen.stds[late, i], seen.values[late, i] + 3.0 * seen.stds[late, i]
        ends = [float(low.min()), float(high.max())] if len(low) else [0.0, 1.0]
        found.append(ends if np.isfinite(ends).all() and ends[0] < ends[1] else None)
    return [*found, None, None]
