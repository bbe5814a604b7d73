"""A fleet as one HTML page: population, sensors, control charts, one line a run with a link to its report."""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

from accelcal.fleet import figures
from accelcal.fleet.summary import OUTLYING, Fleet
from accelcal.fleet.task import STD
from accelcal.plots import matplotlib
from accelcal.report.page import environment, svg_url
from accelcal.results.words import concise, number, plain

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
    shown = [("Sensors", figures.sensors(fleet))] if fleet.populations else []
    shown += [("Control charts", figures.charts(fleet, charts))] if charts else []
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
