"""Position, output, residual and side channels over one time axis, zoomed together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.recording import Channel, Recording
from accelcal.data.units import instant
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting
from accelcal.validation.comparison import Comparison

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

SIDE = 3
"""Side channels that are drawn, temperature first."""
CHOSEN = "chosen"
"""Label of a stretch that was chosen."""
PANEL = 150
"""Height of a panel, pixels."""


def linked(
    recording: Recording,
    comparison: Comparison | None = None,
    *,
    previous: Comparison | None = None,
    window: tuple[float, float] | None = None,
    marked: Sequence[tuple[float, float, str]] = (),
    theme: ThemeName = "light",
) -> Figure:
    """Draw position, output, accelerometer residual and side channels over one time axis.

    Parameters
    ----------
    recording : what was measured.
    comparison : of a model with it, for the residual; previous : of the previous model, drawn pale.
    window : s, optional; only this part is drawn, thinned for it.
    marked : stretches (from, to, label), s.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly or tsdownsample is not installed.
    """
    palette = style.theme_of(theme)
    first = sorted(recording.side.values(), key=lambda side: (side.name != "temperature", side.name))[:SIDE]
    residual = comparison is not None and len(comparison.accel_residual[0]) > 0
    rows = 2 + int(residual) + len(first)
    figure = drawing.new_figure(rows, 1, shared_xaxes=True, vertical_spacing=0.28 / rows)

    def draw(row: int, channel: Channel, name: str, chosen: style.LineStyle) -> style.Thinned:
        t, y = inside(channel.t, channel.y, window)
        factor, unit = formatting.prefixed(channel.unit, y) if channel.unit in ("m", "m/s²") else (1.0, channel.unit)
        figure.update_yaxes(title_text=drawing.axis_title(name, unit), row=row, col=1)
        return drawing.trace(figure, t, y, chosen, name, factor=factor, unit=unit, row=row, showlegend=False)

    drawn = [
        draw(1, recording.position, "position", palette.measured),
        draw(2, Channel("accel", recording.accel.t, recording.accel.y, "m/s²"), "output", palette.measured),
    ]
    if comparison is not None and residual:
        t, y = inside(*comparison.accel_residual, window)
        factor, unit = formatting.prefixed("m/s²", y)
        if previous is not None and len(previous.accel_residual[0]):
            old = inside(*previous.accel_residual, window)
            drawing.trace(figure, *old, palette.floor, "before", factor=factor, unit=unit, row=3, opacity=0.35)
        drawn.append(drawing.trace(figure, t, y, palette.residual, "residual", factor=factor, unit=unit, row=3))
        figure.update_yaxes(title_text=drawing.axis_title("residual", unit), row=3, col=1)
    drawn += [draw(rows - len(first) + 1 + i, channel, channel.name, palette.other) for i, channel in enumerate(first)]
    low, high = (recording.position.t[0], recording.position.t[-1]) if window is None else window
    drawing.format_figure(
        figure,
        palette,
        f"From {instant(low)} s to {instant(high)} s",
        note=drawing.thinning_note(*drawn),
        height=drawing.BOTTOM + PANEL * rows,
        legend=previous is not None and residual,
        left=92,
    )
    for begin, end, label in marked:
        mark(figure, begin, end, label, palette)
    figure.update_xaxes(range=[float(low), float(high)])
    figure.update_xaxes(title_text=drawing.axis_title("time", "s"), row=rows, col=1)
    return figure


def inside(t: Array, y: Array, window: tuple[float, float] | None) -> tuple[Array, Array]:
    """A series (n,) within a window of time, one sample more at either end; whole without a window."""
    if window is None:
        return t, y
    a, b = np.searchsorted(t, window)
    return t[max(0, a - 1) : b + 1], y[max(0, a - 1) : b + 1]


def mark(figure: Figure, begin: float, end: float, label: str, palette: style.Theme) -> None:
    """Shade a stretch of time over all panels and name it, unless the label is empty."""
    box: dict[str, Any] = {"type": "rect", "xref": "x", "yref": "paper", "x0": begin, "x1": end, "y0": 0.0, "y1": 1.0}
    colour = {"held out": palette.band, CHOSEN: palette.model.colour}.get(label, palette.other.colour)
    line = {"width": 2, "dash": "solid"} if label == CHOSEN else {"width": 1, "dash": "dash"}
    figure.add_shape(**box, fillcolor=colour, opacity=0.16, layer="below", line={**line, "color": colour})
    if not label:
        return
    figure.add_annotation(
        x=0.5 * (begin + end),
        y=1.0,
        xref="x",
        yref="paper",
        yanchor="top",
        text=drawing.escaped(label),
        showarrow=False,
        bgcolor=palette.page,
        font={"size": drawing.SMALL, "color": palette.ink},
    )
