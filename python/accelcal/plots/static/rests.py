"""Figure of a long record with the rests that were found in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from accelcal.io.rests import Rests
from accelcal.plots import style
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 10.0, 4.2
"""Inches."""
MARGIN = 0.04
"""Of the range of the outputs, above the highest rest, for its number."""


def draw_rests(found: Rests, *, theme: ThemeName = "light") -> Figure:
    """Outputs over time, every rest shaded and numbered, with its mean.

    Parameters
    ----------
    found : rests of one record.
    theme : "light" or "dark".
    """
    look = style.theme_of(theme)
    figure = style.new_figure(WIDTH, HEIGHT, look)
    axes = figure.subplots()
    style.format_axes(axes, look, x=formatting.label("time", "s"), y=formatting.label("output", found.unit))
    for k, (name, y) in enumerate(zip(found.names, found.outputs.T, strict=True)):
        style.trace(axes, found.t, y, look.line_styles[k], name=name)
    top = float(found.outputs.max()) + MARGIN * float(found.outputs.max() - found.outputs.min())
    for number, rest in enumerate(found.rests, 1):
        axes.axvspan(rest.start, rest.end, color=look.grid, alpha=0.6, linewidth=0.0, zorder=0)
        axes.text(0.5 * (rest.start + rest.end), top, str(number), color=look.ink, fontsize=style.SMALL, ha="center")
    if len(found.names) > 1:
        style.legend(axes, look)
    style.headline(figure, f"{found.name}: {len(found.rests)} rests found; look at them before they are used", look)
    return figure
