"""Measured and simulated output over each other, closely, and the residual over the whole record: on paper and mail."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from accelcal.plots import style
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting
from accelcal.validation.comparison import Comparison
from accelcal.validation.worst import worst_stretches

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 8.0, 3.9
"""Inches."""
CLOSE = 2.0
"""Length of the stretch in which the two outputs are drawn, s."""
CLOSE_COLUMNS = 240
"""Columns of a curve in it: few enough for thick lines."""


def overlay(models: Sequence[tuple[str, Comparison]], *, theme: ThemeName = "light") -> Figure:
    """Draw what was measured and what the last model says where its residual is largest, and the whole residual.

    Parameters
    ----------
    models : name and comparison of each model, with one recording, in order; the last one is the current model. The
        residual of the first is drawn as well, behind that of the last.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    ValueError
        If there is no model.
    """
    if not models:
        raise ValueError("an overlay needs at least one comparison")
    palette = style.theme_of(theme)
    name, current = models[-1]
    t, residual = current.accel_residual
    figure = style.new_figure(WIDTH, HEIGHT, palette)
    if len(t) == 0:
        style.headline(figure, "Measured and simulated output", palette)
        style.message(figure.subplots(), f"The record is too short below {current.band:.3g} Hz.", palette)
        return figure
    above, below = figure.subplots(2, 1, height_ratios=(1.5, 1.0))
    begin, end = close_stretch(current)
    inside = (t >= begin) & (t <= end)
    style.format_axes(above, palette, x="", y=formatting.label("output", "m/s²"))
    said, simulated = current.measured[inside], (current.measured - residual)[inside]
    style.trace(above, t[inside], said, palette.measured, name="measured", columns=CLOSE_COLUMNS)
    style.trace(above, t[inside], simulated, palette.model, name=f"simulated, {name}", columns=CLOSE_COLUMNS)
    above.set_xlim(begin, end)
    style.legend(above, palette)
    factor, unit = formatting.prefixed("m/s²", *(seen.accel_residual[1] for _, seen in models))
    style.format_axes(below, palette, x=formatting.label("time", "s"), y=formatting.label("residual", unit))
    shown = [*([(*models[0], palette.other)] if len(models) > 1 else []), (name, current, palette.residual)]
    drawn = [style.trace(below, *seen.accel_residual, line, factor=factor, name=called) for called, seen, line in shown]
    below.axvspan(begin, end, color=palette.band, alpha=0.3, linewidth=0.0, label="stretch drawn above")
    style.legend(below, palette)
    style.note(below, drawn[-1].note, palette)
    text = "too short for a fit in percent"
    if current.fit_percent is not None:
        text = f"fit {formatting.percent(current.fit_percent)} below {current.band:.3g} Hz"
    style.headline(figure, f"Measured and simulated output: {text}", palette)
    return figure


def close_stretch(seen: Comparison) -> tuple[float, float]:
    """The stretch of a record, at most `CLOSE` long, about the largest residual or, where none stands out, the largest
    output.

    Both ends lie in the record, s.
    """
    t, residual = seen.accel_residual
    first, last = float(t[0]), float(t[-1])
    worst = worst_stretches(t, residual)
    middle = float(np.mean(worst[0])) if worst else float(t[np.argmax(np.abs(seen.measured - np.mean(seen.measured)))])
    begin = min(max(first, middle - 0.5 * CLOSE), max(first, last - CLOSE))
    return begin, min(last, begin + CLOSE)
