"""The record over time: position, output, rest, the used part, breaks and faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal import formatting
from accelcal.data.recording import Recording
from accelcal.data.summary import rest
from accelcal.data.units import instant
from accelcal.diagnosis.change_points import usable
from accelcal.diagnosis.faults import Fault, fault_remarks, faults
from accelcal.diagnosis.left_out import left_out_remarks, without_wrong_readings
from accelcal.diagnosis.remarks import Remark
from accelcal.estimation.run import prepare
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import ThemeName

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST = 400
"""Stretches of rest that are shaded, the longest ones."""


@dataclass(frozen=True, slots=True)
class Marks:
    """Marks on the time axis, s."""

    start: float
    end: float
    """Used part."""
    breaks: tuple[float, ...]
    faults: tuple[Fault, ...]
    rest: tuple[tuple[float, float], ...]
    left_out: tuple[Remark, ...] = ()

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What is left out, and the faults as remarks, many of one kind as one."""
        return (*self.left_out, *fault_remarks(self.faults, self.end - self.start))


def marks(recording: Recording) -> Marks:
    """Breaks, faults, rest and the stretch on which one model can hold.

    Raises
    ------
    RecordingError
        If the channels do not overlap.
    """
    recording = without_wrong_readings(recording)
    found = usable(recording)
    seen = faults(recording, prepare(recording, start=found.start, end=found.end))
    gone = tuple(left_out_remarks([recording], "", found.start, found.end))
    return Marks(found.start, found.end, found.breaks, seen, tuple(rest(recording)), gone)


def longest(stretches: Sequence[tuple[float, float]], most: int = MOST) -> list[tuple[float, float]]:
    """The longest of some stretches."""
    return sorted(stretches, key=lambda stretch: stretch[0] - stretch[1])[:most]


def timeline(recording: Recording, seen: Marks, *, theme: ThemeName = "light") -> Figure:
    """Draw position and output over time with breaks, faults and rest marked.

    Parameters
    ----------
    recording : whole.
    seen : from `marks`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly or tsdownsample is not installed.
    """
    palette = style.theme_of(theme)
    position, accel = recording.position, recording.accel
    figure = drawing.new_figure(2, 1, shared_xaxes=True, vertical_spacing=0.06)
    factor, unit = formatting.prefixed("m", position.y)
    drawn = [
        drawing.trace(figure, position.t, position.y, palette.measured, "position", factor=factor, unit=unit),
        drawing.trace(figure, accel.t, accel.y, palette.residual, "output", unit="m/s²", row=2),
    ]
    figure.update_layout(shapes=[_shade(begin, end, palette.grid) for begin, end in longest(seen.rest)])
    for at in seen.breaks:
        figure.add_vline(
            x=at,
            line={"color": palette.other.colour, "dash": "dash", "width": 2},
            annotation={"text": f"break at {instant(at)} s", "yanchor": "top", "xanchor": "left"},
            row=1,
            col=1,
        )
        figure.add_vline(x=at, line={"color": palette.other.colour, "dash": "dash", "width": 2}, row=2, col=1)
    if seen.faults:
        times = np.array([f.time for f in seen.faults])
        figure.add_scatter(
            x=times,
            y=np.interp(times, position.t, position.y * factor),
            mode="markers",
            name="fault",
            row=1,
            col=1,
            marker={"symbol": "x", "size": 10, "color": palette.other.colour},
            text=[drawing.escaped(f.sentence) for f in seen.faults],
            hovertemplate="%{text}<extra></extra>",
        )
    broken = f"{len(seen.breaks)} break" + ("" if len(seen.breaks) == 1 else "s") if seen.breaks else "no break"
    counted = f"{len(seen.faults)} fault" + ("" if len(seen.faults) == 1 else "s") if seen.faults else "no fault"
    drawing.format_figure(
        figure,
        palette,
        f"Used from {instant(seen.start)} s to {instant(seen.end)} s: {broken}, {counted}",
        note="; ".join(filter(None, ("shaded: at rest" if seen.rest else "", drawing.thinning_note(*drawn)))),
        height=400,
    )
    figure.update_yaxes(title_text=drawing.axis_title("position", unit), row=1, col=1)
    figure.update_yaxes(title_text=drawing.axis_title("output", "m/s²"), row=2, col=1)
    figure.update_xaxes(title_text=drawing.axis_title("time", "s"), row=2, col=1)
    return figure


def _shade(begin: float, end: float, colour: str) -> dict[str, Any]:
    """A stretch of time, shaded behind all panels."""
    across = {"xref": "x", "x0": begin, "x1": end}
    upward = {"yref": "paper", "y0": 0.0, "y1": 1.0}
    return {
        "type": "rect",
        **across,
        **upward,
        "fillcolor": colour,
        "opacity": 0.5,
        "line": {"width": 0},
        "layer": "below",
    }
