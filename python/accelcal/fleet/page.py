"""A fleet as one HTML page: population, sensors, control charts, one line a run with a link to its report."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from accelcal.fleet.summary import LIMIT, OUTLYING, STD, Chart, Fleet
from accelcal.plots import matplotlib
from accelcal.plots.figure import Axis, Figure, Level, Line, Mark, Panel, Points
from accelcal.report.page import environment, svg_url
from accelcal.results.words import concise, number, plain

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


def control_charts(fleet: Fleet, several: Sequence[Chart]) -> Figure:
    """Draw control charts: values over days from the first run, mean and limits of three standard deviations."""
    panels = []
    for chart in several:
        days, y, std = np.array(chart.days) - chart.days[0], np.array(chart.values), np.array(chart.std)
        limits = [Line(days, chart.mean + side * std, role="other") for side in (-LIMIT, LIMIT)]
        marks: tuple[Mark, ...] = (Level(chart.mean), Line(days, y, role="ink", marker="."), *limits)
        size = Axis(chart.parameter, fleet.parameters[chart.parameter])
        panels.append(Panel(marks, Axis("time", "days"), size, chart.sensor, HEIGHT))
    return Figure(tuple(panels), columns=2)


MOST_CHARTS = 12
"""Control charts that are drawn: those that age first, then those with runs outside."""


def html(fleet: Fleet, folder: Path) -> str:
    """Return the page.

    Parameters
    ----------
    fleet : what is shown.
    folder : of the page, from which links begin.

    Raises
    ------
    MissingExtra
        If matplotlib or jinja2 is not installed.
    """
    template = environment().from_string(resources.files("accelcal.fleet").joinpath("page.html").read_text("utf-8"))
    style = resources.files("accelcal.report").joinpath("page.css").read_text(encoding="utf-8")
    charts = sorted(fleet.charts, key=lambda one: (not one.ages, -len(one.outside), one.p_value))[:MOST_CHARTS]
    shown = [("Sensors", sensors(fleet))] if fleet.populations else []
    shown += [("Control charts", control_charts(fleet, charts))] if charts else []
    return template.render(
        style=style,
        fleet=fleet,
        figures=[(title, svg_url(matplotlib.draw(figure))) for title, figure in shown],
        population=[population_row(fleet, name) for name in fleet.populations],
        sensors=[sensor_row(fleet, i) for i in range(len(fleet.sensors))] if fleet.populations else [],
        runs=[run_row(fleet, k, folder) for k in range(len(fleet.files))],
        undrawn=max(0, len(fleet.charts) - len(charts)),
    )


def population_row(fleet: Fleet, name: str) -> tuple[str, ...]:
    """Cells of one parameter."""
    found = fleet.parameter_to_dict(name)
    each = [
        f"{number(found[key]['value'], 3)} ({number(found[key]['low'], 2)} to {number(found[key]['high'], 2)})"
        for key in ("between_sensors", "run_to_run")
    ]
    share = f"{100.0 * found['calibration_share']:.0f} %"
    mean = f"{plain(found['unit'], found['mean'], found['mean_std'])} = {concise(found['mean'], found['mean_std'])}"
    return (name, found["unit"], mean, *each, number(2.0 * found["next_run_std"], 2), share)


def sensor_row(fleet: Fleet, i: int) -> tuple[str, ...]:
    """Cells of one sensor."""
    content = fleet.sensor_to_dict(i)
    each = [concise(one["value"], one["std"]) for one in content["parameters"].values()]
    odd = [name for name, one in content["parameters"].items() if one["p"] < OUTLYING]
    return (content["sensor"], str(content["runs"]), *each, f"outlying: {', '.join(odd)}" if odd else "")


def run_row(fleet: Fleet, k: int, folder: Path) -> dict[str, Any]:
    """Cells of one run; the report beside a recording is linked."""
    file = Path(fleet.files[k])
    report = file.with_suffix(".html")
    link = ""
    if report.is_file():
        link = quote(Path(os.path.relpath(report.resolve(), folder.resolve())).as_posix())
    each = [concise(float(fleet.values[name][k]), float(fleet.values[name + STD][k])) for name in fleet.parameters]
    ratio = float(fleet.values["noise_ratio"][k])
    return {
        "sensor": fleet.sensors[fleet.sensor_of[k]],
        "file": file.name,
        "link": link,
        "cells": [*each, "" if ratio != ratio else number(ratio, 3), str(int(fleet.values["remarks"][k]))],
    }
