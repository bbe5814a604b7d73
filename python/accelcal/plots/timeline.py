"""Figures over time: a recording with its marks, and measurement and models over each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.data import NORMAL_95, Array, Channel, Recording, instant
from accelcal.data.quality import rest
from accelcal.diagnosis.faults import Fault, examine
from accelcal.diagnosis.left_out import MILLISECOND
from accelcal.effects import spelled
from accelcal.estimation.remarks import Remark
from accelcal.estimation.tracks import Path, Shape, Track
from accelcal.plots.figure import (
    COLUMNS,
    Axis,
    Band,
    Figure,
    Level,
    Line,
    Mark,
    Panel,
    Points,
    Role,
    Stretch,
    role_of_model,
    sentence,
)
from accelcal.results import words as formatting
from accelcal.results.words import percent, prefixed
from accelcal.validation.comparison import Evaluation
from accelcal.validation.regions import worst_stretches

if TYPE_CHECKING:
    from accelcal.live.session import LiveHistory

TIME = Axis("time", "s")
MOST = 100
"""Stretches of a kind that are marked, of rest the longest ones."""
LEFT_OUT = "left out"
"""Name of the first stretch of readings that are known to be wrong; the others have none."""
SHORTEST = 2e-3
"""Share of the time axis as which a shorter stretch is drawn."""
SIDE = 3
"""Side channels that are drawn, temperature first."""
CHOSEN = "chosen"
"""Name of a stretch that was chosen."""
CLOSE = 2.0
"""Length of the stretch in which two outputs are drawn closely, s."""
CLOSE_COLUMNS = 240
"""Columns of a curve in it: few enough for thick lines."""
Models = Evaluation | Sequence[tuple[str, Evaluation]]
"""From `accelcal.compare`; or name and comparison of several models with one recording, the current one last."""
Window = tuple[float, float]
"""From and to, s."""


@dataclass(frozen=True, slots=True)
class Marks:
    """Marks on the time axis, s."""

    start: float
    end: float
    """Used part."""
    breaks: tuple[float, ...]
    faults: tuple[Fault, ...]
    rest: tuple[Window, ...]
    left_out: tuple[Window, ...] = ()
    """Stretches of readings that are known to be wrong."""
    remarks: tuple[Remark, ...] = ()
    """What every command lists of it."""


def marks(recording: Recording) -> Marks:
    """Breaks, faults, rest and the stretch on which one model can hold.

    Raises
    ------
    RecordingError
        If the channels do not overlap.
    """
    of_record = examine(recording)
    part, clean = of_record.usable, of_record.source.recording
    lost = tuple((a - MILLISECOND, b + MILLISECOND) for item in clean.left_out for a, b in item.stretches)
    noticed = tuple(of_record.remarks())
    return Marks(part.start, part.end, part.breaks, of_record.faults, tuple(rest(clean)), lost, noticed)


def timeline(recording: Recording, marked: Marks) -> Figure:
    """Draw position and output over time with breaks, faults and rest marked.

    Parameters
    ----------
    recording : whole.
    marked : from `marks`.
    """
    recording = recording.without(*marked.left_out[:MOST])
    position, accel, shortest = recording.position, recording.accel, SHORTEST * (marked.end - marked.start)
    factor, unit = prefixed("m", position.y)
    above: list[Mark] = [Line(position.t, position.y * factor, "position", "measured", COLUMNS)]
    below: list[Mark] = [Line(accel.t, accel.y, "output", "residual", COLUMNS)]
    above += [Level(at, role="other", upright=True, text=f"break at {instant(at)} s") for at in marked.breaks]
    below += [Level(at, role="other", upright=True) for at in marked.breaks]
    if marked.faults:
        times = np.array([f.time for f in marked.faults])
        at = np.interp(times, position.t, position.y * factor)
        above.append(Points(times, at, "fault", "fault", hover=[f.sentence for f in marked.faults]))
    longest = sorted(marked.rest, key=lambda stretch: stretch[0] - stretch[1])[:MOST]
    text = ", ".join(
        f"{len(stretches)} {what}{'s'[: len(stretches) != 1]}" if stretches else f"no {what}"
        for stretches, what in ((marked.breaks, "break"), ((*marked.left_out, *marked.faults), "fault"))
    )
    return Figure(
        (
            Panel(tuple(above), TIME, Axis("position", unit), height=160.0),
            Panel(tuple(below), TIME, Axis("output", "m/s²"), height=160.0),
        ),
        f"Used from {instant(marked.start)} s to {instant(marked.end)} s: {text}",
        "shaded: at rest" if marked.rest else "",
        shared_x=True,
        stretches=(
            *(Stretch(begin, end, role="grid") for begin, end in longest),
            *(
                Stretch(a, max(b, a + shortest), "" if k else LEFT_OUT, "fault")
                for k, (a, b) in enumerate(marked.left_out[:MOST])
            ),
        ),
    )


def linked(
    recording: Recording,
    comparison: Evaluation | None = None,
    *,
    previous: Evaluation | None = None,
    window: Window | None = None,
    marked: Iterable[tuple[float, float, str]] = (),
) -> Figure:
    """Draw position, output, accelerometer residual and side channels over one time axis.

    Parameters
    ----------
    recording : what was measured.
    comparison : of a model with it, for the residual; previous : of the previous model, drawn pale.
    window : s, optional; only this part is drawn, thinned for it.
    marked : stretches (from, to, label), s.
    """
    low, high = window or (float(recording.position.t[0]), float(recording.position.t[-1]))
    time = Axis("time", "s", range=(low, high))
    side = sorted(recording.side.values(), key=lambda side: (side.name != "temperature", side.name))[:SIDE]
    shown: list[tuple[Channel, str, Role]] = [
        (recording.position, "position", "measured"),
        (Channel("accel", recording.accel.t, recording.accel.y, "m/s²"), "output", "measured"),
    ]
    residual = comparison is not None and len(comparison.accel_residual[0]) > 0
    if comparison is not None and residual:
        shown.append((Channel("residual", *comparison.accel_residual, "m/s²"), "residual", "residual"))
    panels = []
    for channel, name, role in (*shown, *((channel, channel.name, "other") for channel in side)):
        t, y = inside(channel.t, channel.y, window)
        factor, unit = prefixed(channel.unit, y) if channel.unit in ("m", "m/s²") else (1.0, channel.unit)
        lines = [Line(t, y * factor, "" if name != "residual" or previous is None else name, role, COLUMNS, solid=True)]
        if name == "residual" and previous is not None and len(previous.accel_residual[0]):
            at, old = inside(*previous.accel_residual, window)
            lines.insert(0, Line(at, old * factor, "before", "before", COLUMNS, opacity=0.35))
        panels.append(Panel(tuple(lines), time, Axis(name, unit), height=122.0))
    return Figure(
        tuple(panels),
        f"From {instant(low)} s to {instant(high)} s",
        shared_x=True,
        stretches=tuple(mark(*stretch) for stretch in marked),
        key="linked",
    )


def inside(t: Array, y: Array, window: Window | None) -> tuple[Array, Array]:
    """A series (n,) within a window of time, one sample more at either end; whole without a window."""
    if window is None:
        return t, y
    a, b = np.searchsorted(t, window)
    return t[max(0, a - 1) : b + 1], y[max(0, a - 1) : b + 1]


def mark(begin: float, end: float, name: str) -> Stretch:
    """A stretch of time in the role that its name gives it."""
    roles: dict[str, Role] = {"held out": "band", CHOSEN: "model"}
    return Stretch(begin, end, name, roles.get(name, "other"), strong=name == CHOSEN)


def overlay(models: Models, *, window: Window | None = None, chosen: Window | None = None) -> Figure:
    """Draw what was measured, what each model says, and the difference, over one time axis.

    The stretches in which the residual of the last model is largest are shaded in all panels.

    Parameters
    ----------
    models : from `accelcal.compare`; or name and comparison of several models with one recording, the current one last.
    window : s, optional; only this part is drawn, thinned for it.
    chosen : a stretch of time that is marked in all panels, s.

    Raises
    ------
    ValueError
        If there is no model.
    """
    several = named_models(models)
    _, current = several[-1]
    t, moved, _ = current.simulated
    scale, unit = prefixed("m", moved)
    ruler, residual_unit = prefixed("m/s²", *(compared.accel_residual[1] for _, compared in several))

    def line(t: Array, y: Array, name: str, role: Role, opacity: float = 1.0, *, solid: bool = False) -> Line:
        return Line(*inside(t, y, window), name, role, COLUMNS, solid, opacity=opacity)

    output = [line(current.accel_residual[0], current.measured, "measured", "measured")]
    residual, position = list[Line](), [line(t, moved * scale, "measured", "measured")]
    for number, (name, evaluation) in enumerate(several):
        role, faint = (
            role_of_model(number, len(several)),
            1.0 if evaluation is current else 0.5 + 0.4 * number / len(several),
        )
        at, left = evaluation.accel_residual
        label = f"{name or 'model'}, {fit_text(evaluation)}"
        output.append(line(at, evaluation.measured - left, label, role, faint))
        residual.append(line(at, left * ruler, label, role, faint, solid=True))
        position.append(line(evaluation.simulated[0], evaluation.simulated[2] * scale, label, role, faint))
    ends = [float(end) for axis in (t, current.accel_residual[0]) if len(axis) for end in (axis[0], axis[-1])]
    time = Axis("time", "s", range=window or (min(ends, default=0.0), max(ends, default=1.0)))
    worst = [stretch for stretch in worst_stretches(*current.accel_residual) if stretch != chosen]
    shades = [Stretch(*stretch, "" if i else "largest residual") for i, stretch in enumerate(worst)]
    short = (
        "" if len(current.accel_residual[0]) else f"The record is too short for a residual below {current.band:.3g} Hz."
    )
    return Figure(
        (
            Panel(() if short else tuple(output), time, Axis("output", "m/s²"), height=174.0, sentence=short),
            Panel((Level(0.0), *residual), time, Axis("residual", residual_unit), height=130.0),
            Panel(tuple(position), time, Axis("position", unit), height=174.0),
        ),
        f"Measured and simulated output{f' ({name})' if name else ''}: {fit_text(current)} below {current.band:.3g} Hz",
        "position: simulated from the output alone",
        shared_x=True,
        stretches=(*shades, *([mark(*chosen, CHOSEN)] if chosen is not None else [])),
        key="overlay",
    )


def named_models(models: Models) -> list[tuple[str, Evaluation]]:
    """Comparisons with their names; that of a single model has none.

    Raises
    ------
    ValueError
        If there is no model.
    """
    several = [("", models)] if isinstance(models, Evaluation) else list(models)
    if not several:
        raise AccelcalError("an overlay needs at least one comparison")
    return several


def fit_text(evaluation: Evaluation) -> str:
    """The fit of one model in percent."""
    if evaluation.fit_percent is None:
        return "too short for a fit in percent"
    return f"fit {percent(evaluation.fit_percent)}"


def closely(models: Sequence[tuple[str, Evaluation]]) -> Figure:
    """Draw what was measured and what the last model says where its residual is largest, and the whole residual.

    Parameters
    ----------
    models : name and comparison of each model, with one recording, in order; the last one is the current model. The
        residual of the first is drawn as well, behind that of the last.

    Raises
    ------
    ValueError
        If there is no model.
    """
    several = named_models(models)
    name, current = several[-1]
    t, residual = current.accel_residual
    if len(t) == 0:
        return sentence("Measured and simulated output", f"The record is too short below {current.band:.3g} Hz.")
    begin, end = close_stretch(current)
    part = (t >= begin) & (t <= end)
    factor, unit = prefixed("m/s²", *(evaluation.accel_residual[1] for _, evaluation in several))
    above = (
        Line(t[part], current.measured[part], "measured", "measured", CLOSE_COLUMNS),
        Line(t[part], (current.measured - residual)[part], f"simulated, {name}", "model", CLOSE_COLUMNS),
    )
    shown: list[tuple[str, Evaluation, Role]] = [(*several[0], "other")] if len(several) > 1 else []
    shown.append((name, current, "residual"))
    below = [
        Line(evaluation.accel_residual[0], evaluation.accel_residual[1] * factor, f"residual, {called}", role, COLUMNS)
        for called, evaluation, role in shown
    ]
    below_band = "" if current.fit_percent is None else f" below {current.band:.3g} Hz"
    stretch = Level(low=begin, high=end, name="stretch drawn above", role="band", upright=True)
    return Figure(
        (
            Panel(above, Axis("time", "s", range=(begin, end)), Axis("output", "m/s²"), height=140.0),
            Panel((*below, stretch), TIME, Axis("residual", unit), height=95.0),
        ),
        f"Measured and simulated output: {fit_text(current)}{below_band}",
    )


def close_stretch(evaluation: Evaluation) -> tuple[float, float]:
    """The stretch of a record, at most `CLOSE` long, about the largest residual or, where none stands out, the largest
    output.

    Both ends lie in the record, s.
    """
    t, residual = evaluation.accel_residual
    first, last = float(t[0]), float(t[-1])
    worst = worst_stretches(t, residual)
    middle = (
        float(np.mean(worst[0]))
        if worst
        else float(t[np.argmax(np.abs(evaluation.measured - np.mean(evaluation.measured)))])
    )
    begin = min(max(first, middle - 0.5 * CLOSE), max(first, last - CLOSE))
    return begin, min(last, begin + CLOSE)


MOST_TRACKS = 8
"""Parameters that are drawn."""
SETTLED = 0.2
"""Share of a track after which its uncertainty sizes the axis."""
SIGMAS = "± 2 σ"


def tracks(track: Track) -> Figure:
    """Draw estimate and ± 2 standard deviations of every parameter against time.

    Parameters
    ----------
    track : from `accelcal.estimation.tracks.track`.
    """
    panels = []
    for name, y, std, si in zip(track.names[:MOST_TRACKS], track.values.T, track.std.T, track.units, strict=False):
        finite = np.isfinite(std)
        ends = settled(y[finite] - 2.0 * std[finite], y[finite] + 2.0 * std[finite]) or (0.0, 1.0)
        factor, unit = formatting.prefixed(si, *ends) if si != "s" else milliseconds(*ends)
        y, reach = y[finite] * factor, 2.0 * std[finite] * factor
        marks = (Band(track.t[finite], y - reach, y + reach, SIGMAS), Line(track.t[finite], y, "estimate", "residual"))
        axis = Axis("estimate", unit, range=(ends[0] * factor, ends[1] * factor))
        panels.append(Panel(marks, TIME, axis, spelled(name), 138.0))
    left = len(track.names) - len(panels)
    note = f"{left} further parameters are not drawn" if left else ""
    headline = "Parameter estimates from the readings up to each instant, with their uncertainty"
    return Figure(tuple(panels), headline, note, columns=2)


def paths(moving: Sequence[Path]) -> Figure:
    """Draw coefficients over a recording with a 95 % band, and the driver that each follows best.

    Parameters
    ----------
    moving : from `accelcal.estimation.tracks.paths`.
    """
    panels = []
    for path in moving:
        reach = NORMAL_95 * path.std
        factor, unit = (100.0, "%") if path.unit == "1" else formatting.prefixed(path.unit, path.value)
        low, high, y = ((path.value + side * reach) * factor for side in (-1.0, 1.0, 0.0))
        marks: list[Mark] = [Band(path.t, low, high, "95 %"), Line(path.t, y, "estimate", "residual")]
        if path.followers:
            best = path.followers[0]
            name = f"{spelled(best.mechanism)}: {100.0 * best.share:.0f} %"
            marks.append(Line(path.t, best.value * factor, name, "other"))
        name = spelled(path.coefficient)
        panels.append(Panel(tuple(marks), TIME, Axis(name, unit), name, 200.0))
    note = "the share is that of the variance of the path which the driver explains"
    subtitle = note if any(path.followers for path in moving) else ""
    return Figure(tuple(panels), "Coefficients that change during the run", subtitle)


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
    columns = history.columns
    t = np.round(columns.t, 3)
    panels = []
    for parameter, y, std in zip(history.parameters, columns.values.T, columns.stds.T, strict=True):
        marks: tuple[Mark, ...] = (Band(t, y - 2.0 * std, y + 2.0 * std, SIGMAS), Line(t, y, role="residual"))
        axis = Axis("estimate", parameter.unit, range=settled(y - 3.0 * std, y + 3.0 * std))
        panels.append(Panel(marks, TIME, axis, spelled(parameter.name), 150.0))
    factor = 1e6
    wide = 2.0 * columns.std * factor
    marks = (Band(t, -wide, wide, SIGMAS), Line(t, columns.e * factor, role="residual", marker="."))
    panels.append(Panel(marks, TIME, Axis("innovation", "µm"), "innovation", 150.0))
    at = np.array([alarm.since for alarm in history.alarms], dtype=float)
    finite = np.isfinite(columns.nis)
    height = np.interp(at, t[finite], columns.nis[finite]) if finite.any() and len(at) else np.zeros(0)
    nis = (Band(t, columns.low, columns.high), Line(t, columns.nis, role="residual"))
    alarms = Points(at[: len(height)], height, "alarm", "fault", hover=[f"alarm at {s:.4g} s" for s in at])
    panels.append(Panel((*nis, alarms), TIME, Axis("NIS", "1"), "NIS, 99 % inside the band", 150.0))
    return Figure(tuple(panels), "Parameters, innovations and NIS up to now", shared_x=True, key="live")


def fitted_curve(recovered: Sequence[Shape]) -> Figure:
    """Draw the branches of one nonparametric curve with ± 2 standard deviations.

    Parameters
    ----------
    recovered : branches of one effect, from `accelcal.estimation.tracks.shapes`.
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
