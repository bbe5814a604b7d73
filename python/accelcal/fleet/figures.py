"""Figures of a fleet: every sensor against the population, control charts over the dates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from accelcal.fleet.summary import LIMIT, OUTLYING, Chart, Fleet
from accelcal.plots.figure import Axis, Figure, Level, Line, Mark, Panel, Points

MOST_NAMES = 20
"""Sensors whose names are written on the axis."""
HEIGHT = 150.0
"""px"""


def sensors(fleet: Fleet) -> Figure:
    """Draw every sensor with two standard deviations, the population as a band, outlying ones filled."""
    count, panels = len(fleet.sensors), []
    names = (range(1, count + 1), fleet.sensors) if count <= MOST_NAMES else ([1, count], ["1", str(count)])
    for name, found in fleet.populations.items():
        number, half = np.arange(1.0, len(found.sensors) + 1.0), 2.0 * found.next_sensor_std
        odd = found.outlying < OUTLYING
        points = [
            Points(number[rows], found.sensors[rows], role="ink", error=2.0 * found.sensors_std[rows], hollow=hollow)
            for rows, hollow in ((~odd, True), (odd, False))
            if rows.any()
        ]
        band = Level(low=found.mean - half, high=found.mean + half, role="band")
        size = Axis(name, fleet.parameters[name])
        panels.append(Panel((band, Level(found.mean), *points), Axis("sensor", ticks=names), size, height=HEIGHT))
    return Figure(tuple(panels), shared_x=True)


def charts(fleet: Fleet, several: Sequence[Chart]) -> Figure:
    """Draw control charts: values over days from the first run, mean and limits of three standard deviations."""
    panels = []
    for chart in several:
        days, y, std = np.array(chart.days) - chart.days[0], np.array(chart.values), np.array(chart.std)
        limits = [Line(days, chart.mean + side * std, role="other") for side in (-LIMIT, LIMIT)]
        marks: tuple[Mark, ...] = (Level(chart.mean), Line(days, y, role="ink", marker="."), *limits)
        size = Axis(chart.parameter, fleet.parameters[chart.parameter])
        panels.append(Panel(marks, Axis("time", "days"), size, chart.sensor, HEIGHT))
    return Figure(tuple(panels), columns=2)
