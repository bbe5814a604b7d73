"""Figures of a fleet: every sensor against the population, control charts over the dates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from accelcal.fleet.summary import LIMIT, OUTLYING, Chart, Fleet
from accelcal.plots import style
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_NAMES = 20
"""Sensors whose names are written on the axis."""
WIDTH, ROW = 10.0, 2.2
"""Inches."""


def draw_sensors(fleet: Fleet, *, theme: ThemeName = "light") -> Figure:
    """Every sensor with two standard deviations, the population as a band, outlying ones filled."""
    look, names = style.theme_of(theme), list(fleet.populations)
    figure = style.new_figure(WIDTH, ROW * len(names), look)
    for axes, name in zip(np.atleast_1d(figure.subplots(len(names), sharex=True)), names, strict=True):
        found = fleet.populations[name]
        number = np.arange(1, len(found.sensors) + 1)
        style.format_axes(axes, look, x="", y=formatting.label(name, fleet.parameters[name]))
        half = 2.0 * found.next_sensor_std
        axes.axhspan(found.mean - half, found.mean + half, color=look.grid, alpha=0.6, linewidth=0.0, zorder=0)
        axes.axhline(found.mean, color=look.ink, linewidth=0.8)
        odd = found.outlying < OUTLYING
        for kept, filled in ((~odd, False), (odd, True)):
            axes.errorbar(
                number[kept],
                found.sensors[kept],
                2.0 * found.sensors_std[kept],
                fmt="o",
                markersize=4.0,
                markerfacecolor=look.ink if filled else look.page,
                color=look.ink,
                linewidth=0.8,
                linestyle="none",
            )
    named = len(fleet.sensors) <= MOST_NAMES
    axes.set_xticks(number if named else [1, len(number)], fleet.sensors if named else ["1", str(len(number))])
    axes.set_xlabel("sensor", color=look.ink, fontsize=style.NORMAL)
    return figure


def draw_charts(fleet: Fleet, charts: Sequence[Chart], *, theme: ThemeName = "light") -> Figure:
    """Control charts: values over days from the first run, mean and limits of three standard deviations."""
    look, columns = style.theme_of(theme), 2
    rows = -(-len(charts) // columns)
    figure = style.new_figure(WIDTH, ROW * rows, look)
    panels = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for axes, one in zip(panels, charts, strict=False):
        days, y, std = np.array(one.days) - one.days[0], np.array(one.values), np.array(one.std)
        unit = formatting.label(one.parameter, fleet.parameters[one.parameter])
        style.format_axes(axes, look, x=formatting.label("time", "days"), y=unit, title=one.sensor)
        axes.plot(days, y, "o-", color=look.ink, markersize=3.5, linewidth=0.7)
        axes.axhline(one.mean, color=look.ink, linewidth=0.8)
        for side in (-LIMIT, LIMIT):
            axes.plot(days, one.mean + side * std, "--", color=look.ink, linewidth=0.7)
    for axes in panels[len(charts) :]:
        axes.set_visible(False)
    return figure
