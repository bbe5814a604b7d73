"""Fleet: the population of every parameter, sensors, runs, control charts over dates, and its page.

A parameter over many runs of many sensors is y_j = m + S_i + d_j + e_j for run j of sensor i, by restricted likelihood:
S ~ N(0, T²) between sensors, d ~ N(0, w²) between runs of a sensor, and e with the standard deviation of the fit of the
run (derivations 6.13). No recording is read again.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import quote

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal._support.errors import AccelcalError
from accelcal._support.result import Storable
from accelcal.data import Array, Counts
from accelcal.estimation.run_to_run import over_all
from accelcal.fleet.campaign import Results
from accelcal.io import load, sidecar_of
from accelcal.io.files import digest_of
from accelcal.model import Model, Prior
from accelcal.plots import matplotlib
from accelcal.plots.figure import Axis, Figure, Level, Line, Mark, Panel, Points
from accelcal.report.page import filled, svg_url
from accelcal.results.words import concise, number, plain
from accelcal.verbs import fit

GRID, SPAN = 32, 8.0
"""Trial values of each of the two standard deviations before they are refined, and how far one may move about its best
value while the other is held."""
REACH = 1e-5, 10.0
"""Least and largest trial standard deviation, in those of the estimates."""
DROP = 0.5 * 3.841458820694124
"""Fall of the log-likelihood at the ends of a 95 % interval."""
SUSPECTS = 8
"""Sensors farthest from the mean that are judged against all others."""


@dataclass(frozen=True, slots=True)
class Component:
    """A standard deviation with its 95 % interval by profile likelihood."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, eq=False)
class Population(Storable):
    """One parameter of a fleet."""

    derived: ClassVar[tuple[str, ...]] = ("next_sensor_std", "next_run_std")

    mean: float
    mean_std: float
    between_sensors: Component
    run_to_run: Component
    """Turn-on repeatability."""
    sensors: Array
    """Best estimate of each sensor, given the population, (sensors,)."""
    sensors_std: Array
    outlying: Array
    """Probability of each sensor under the population of all others, over all sensors, (sensors,)."""

    @property
    def next_sensor_std(self) -> float:
        """Standard deviation of the parameter of a sensor to come, before it is calibrated."""
        return math.hypot(self.between_sensors.value, self.mean_std)

    @property
    def next_run_std(self) -> float:
        """The same for one run of it."""
        return math.hypot(self.next_sensor_std, self.run_to_run.value)

    @property
    def prior(self) -> Prior:
        """Distribution of the parameter in one run of a sensor to come: the normal one with the 95 % interval of
        Student's, since the spread is known from as many sensors as there are."""
        student = float(scipy.special.stdtrit(len(self.sensors) - 1, 0.975) / scipy.special.ndtri(0.975))
        return Prior(self.mean, student * self.next_run_std)

    def shorter(self, std: float) -> float:
        """Share of the length of a calibration of standard deviation `std` that reaches the same with the population as
        prior: 1 where it does not help, 0 where it is enough by itself."""
        return max(0.0, 1.0 - (std / self.next_run_std) ** 2) if self.next_run_std > 0.0 else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Sums:
    """What the likelihood needs of runs, at one variance between them."""

    ybar: Array
    """Weighted mean of each sensor, (sensors,)."""
    v: Array
    """Its variance."""
    constant: float
    """-2 log-likelihood within the sensors."""

    @classmethod
    def of(cls, y: Array, std: Array, sensor: NDArray[np.intp], between_runs: float) -> Sums:
        """Evaluate at a given variance between runs."""
        w = 1.0 / (std**2 + between_runs)
        count = int(sensor[-1]) + 1 if len(sensor) else 0
        W = np.bincount(sensor, w, count)
        ybar = np.bincount(sensor, w * y, count) / W
        within = float(np.sum(w * (y - ybar[sensor]) ** 2))
        return cls(ybar, 1.0 / W, within - float(np.sum(np.log(w))) + float(np.sum(np.log(W))))

    def minus_two_log(self, between: Array) -> Array:
        """-2 log restricted likelihood at variances between sensors, (k,)."""
        w = 1.0 / (self.v + np.asarray(between)[:, None])
        information = w.sum(axis=1)
        mean = (w @ self.ybar) / information
        squares = np.sum(w * (self.ybar - mean[:, None]) ** 2, axis=1)
        return np.asarray(self.constant - np.sum(np.log(w), axis=1) + squares + np.log(information))

    def mean(self, between: float) -> tuple[float, float]:
        """Mean over sensors and its variance."""
        w = 1.0 / (self.v + between)
        return float(w @ self.ybar / np.sum(w)), float(1.0 / np.sum(w))


def population(y: Array, std: Array, sensor: NDArray[np.intp]) -> Population:
    """Components of one parameter.

    Parameters
    ----------
    y, std : estimate of each run and its standard deviation, (runs,).
    sensor : number of its sensor, 0, 1, ..., rising, (runs,).

    Raises
    ------
    ValueError
        If there are fewer than two sensors.
    """
    order = np.argsort(sensor, kind="stable")
    y, std, sensor = y[order], std[order], sensor[order]
    count = int(sensor[-1]) + 1
    if count < 2:
        raise AccelcalError(f"{count} sensor; a fleet has at least two")
    scale = max(float(np.std(y)), float(np.min(std)))
    repeated = len(y) > count  # with one run a sensor the two are one
    trials = scale * np.geomspace(*REACH, GRID)
    runs, sensors = np.array([0.0, *trials]) if repeated else np.zeros(1), np.array([0.0, *trials])
    surface = np.array([-0.5 * Sums.of(y, std, sensor, float(w**2)).minus_two_log(sensors**2) for w in runs])
    i, j = np.unravel_index(int(np.argmax(surface)), surface.shape)

    def missed(x: Array) -> float:
        return float(Sums.of(y, std, sensor, float(x[0] ** 2)).minus_two_log(np.array([x[1] ** 2]))[0])

    start = np.array([runs[i], sensors[j]])
    simplex = np.array(
        [start, [start[0] * 1.2 + 0.01 * scale * repeated, start[1]], [start[0], start[1] * 1.2 + 0.01 * scale]]
    )
    options = {"initial_simplex": simplex, "xatol": 1e-9 * scale, "fatol": 1e-9, "maxiter": 400}
    optimum = np.abs(scipy.optimize.minimize(missed, start, method="Nelder-Mead", options=options).x)
    best = -0.5 * missed(optimum)
    if not repeated:
        optimum[0] = 0.0
    sums = Sums.of(y, std, sensor, float(optimum[0] ** 2))
    mean, variance = sums.mean(float(optimum[1] ** 2))
    share = optimum[1] ** 2 / (optimum[1] ** 2 + sums.v) if optimum[1] > 0.0 else np.zeros(count)
    return Population(
        mean=mean,
        mean_std=math.sqrt(variance),
        between_sensors=component(
            float(optimum[1]), float(optimum[0]), scale, best, lambda x, y: missed(np.array([y * repeated, x]))
        ),
        run_to_run=component(float(optimum[0]), float(optimum[1]), scale, best, lambda x, y: missed(np.array([x, y])))
        if repeated
        else Component(0.0, 0.0, 0.0),
        sensors=mean + share * (sums.ybar - mean),
        sensors_std=np.sqrt(share * sums.v + (1.0 - share) ** 2 * variance),
        outlying=deleted(sums, float(optimum[1] ** 2)),
    )


def component(
    value: float, other: float, scale: float, best: float, missed: Callable[[float, float], float]
) -> Component:
    """A standard deviation, and its 95 % interval: where the likelihood, the largest over the other one, has fallen.

    `missed` is -2 log-likelihood at this standard deviation and the other.
    """

    def above(x: float) -> float:
        widest = SPAN * max(other, 1e-3 * scale)
        options = {"xatol": 1e-7 * widest}
        optimum = scipy.optimize.minimize_scalar(
            lambda y: missed(x, y), bounds=(0.0, widest), method="bounded", options=options
        )
        return DROP - best - 0.5 * min(float(optimum.fun), missed(x, other))

    low = 0.0 if value <= 0.0 or above(0.0) >= 0.0 else float(scipy.optimize.brentq(above, 0.0, value, rtol=1e-6))
    end = max(2.0 * value, 1e-3 * scale)
    while above(end) > 0.0 and end < REACH[1] * scale * SPAN:
        end *= 2.0
    high = float(scipy.optimize.brentq(above, value, end, rtol=1e-6)) if above(end) < 0.0 else end
    return Component(value, low, high)


def deleted(sums: Sums, between: float) -> Array:
    """Probability of each sensor under the mean and spread of all others, over all sensors (Sidak)."""
    count = len(sums.ybar)
    p = np.ones(count)
    if count < 4:
        return p
    mean, _ = sums.mean(between)
    away = np.abs(sums.ybar - mean) / np.sqrt(sums.v + between)
    for i in np.argsort(-away)[:SUSPECTS]:
        rest = np.arange(count) != i
        others = Sums(sums.ybar[rest], sums.v[rest], 0.0)
        trials = np.array([0.0, *np.geomspace(1e-6, 10.0, 200) * max(between, float(np.max(sums.v)))])
        weight = float(trials[int(np.argmin(others.minus_two_log(trials)))])
        mean, variance = others.mean(weight)
        t = abs(float(sums.ybar[i]) - mean) / math.sqrt(float(sums.v[i]) + weight + variance)
        alone = 2.0 * float(scipy.special.stdtr(count - 2, -t))
        p[i] = over_all(alone, count)
    return p


CONTENT = "content"
"""Name under which a store holds the mark of what was fitted."""


def content_of(path: Path) -> float:
    """Mark of the bytes of a recording and of its sidecar: 52 bits of their SHA-256, which a float holds exactly."""
    sidecar = sidecar_of(path)
    return float(int(digest_of(path)[:7] + (digest_of(sidecar)[:6] if sidecar.is_file() else ""), 16))


MODELS = {"linear": Model.linear, "cubic": Model.cubic}
STD = ".std"
"""Ending of the name under which a standard deviation is kept."""


def fit_of(path: Path, *, model: str = "linear") -> dict[str, float]:
    """Fit one recording.

    Parameters
    ----------
    path : with its sidecar beside it.
    model : a key of `MODELS`.

    Returns
    -------
    Value and standard deviation of each parameter; ratio of the noise to the declared one, normalised innovation
    squared, length (s), date (days), mean temperature (degC), NaN where not known; number of remarks; `content_of`.
    """
    content = content_of(path)  # before it is read: a file that grows meanwhile has changed
    recording = load(path)
    fitted = fit(recording, MODELS[model]())
    run = fitted.runs[0]
    warm = recording.side.get("temperature")
    values = {
        CONTENT: content,
        "nis": math.nan if run.nis is None else run.nis,
        "noise_ratio": math.nan if run.noise.ratio is None else run.noise.ratio,
        "seconds": run.end - run.start,
        "date": math.nan if recording.labels.date is None else recording.labels.date,
        "temperature": math.nan if warm is None else float(np.mean(warm.y)),
        "remarks": float(len(fitted.remarks)),
    }
    for e in fitted.free:
        values |= {e.name: e.value, e.name + STD: e.std}
    return values


LIMIT = 3.0
"""Standard deviations of a control chart."""
OUTLYING = 0.01
"""Probability, over all sensors, below which one is outlying."""
AGEING_ALPHA = 0.01
"""Probability, over all sensors and parameters, below which a slope over the dates is ageing."""
NO_SHORTER = 0.9
"""Share of a calibration beyond which the population does not help."""
RANGE_OF_TWO = 2.0 / math.sqrt(math.pi)
"""Mean of the absolute difference of two normal values of standard deviation 1."""
FEWEST_DATES = 4


@dataclass(frozen=True, slots=True)
class Chart:
    """One parameter of one sensor over the dates of its runs."""

    sensor: str
    parameter: str
    days: tuple[float, ...]
    """Since 1970."""
    values: tuple[float, ...]
    std: tuple[float, ...]
    """Of each value about the mean: fit and run-to-run together."""
    mean: float
    outside: tuple[int, ...]
    """Runs beyond three standard deviations."""
    slope: float
    """Per year."""
    slope_std: float
    p_value: float
    """Over all charts."""

    @property
    def ages(self) -> bool:
        """Whether the slope is more than chance."""
        return self.p_value < AGEING_ALPHA


@dataclass(frozen=True, slots=True, eq=False)
class Fleet(Storable):
    """Many runs of many sensors."""

    derived: ClassVar[tuple[str, ...]] = ("sentences",)

    sensors: tuple[str, ...]
    files: tuple[str, ...]
    """Of all runs that were fitted, in the order in which they were given."""
    sensor_of: Counts
    """Number of the sensor of each."""
    values: dict[str, Array]
    """By name, as `fleet.task` keeps them, (runs,)."""
    parameters: dict[str, str]
    """Unit of each parameter of the sensor."""
    populations: dict[str, Population]
    """Of each parameter; empty for a single sensor."""
    charts: tuple[Chart, ...]
    errors: dict[str, str]
    """By file, why it was not fitted."""

    @property
    def priors(self) -> dict[str, Prior]:
        """Priors of the parameters of the next sensor of this type, in one run of it, for `Model.with_priors`."""
        return {name: population.prior for name, population in self.populations.items() if population.next_run_std > 0}

    @property
    def outlying(self) -> list[tuple[str, str, float]]:
        """Sensor, parameter and probability of all that are outlying."""
        return [
            (self.sensors[i], name, float(p))
            for name, population in self.populations.items()
            for i, p in enumerate(population.outlying)
            if p < OUTLYING
        ]

    @property
    def sentences(self) -> list[str]:
        """What is remarkable, for people."""
        failed = len(self.errors)
        return [
            *(
                f"{name} of {sensor} is outlying among {len(self.sensors)} sensors (p = {p:.1g})"
                for sensor, name, p in self.outlying
            ),
            *(
                f"{chart.parameter} of {chart.sensor} ages: {chart.slope:.3g} ± {chart.slope_std:.2g} "
                f"{self.parameters[chart.parameter].removeprefix('1')} per year".rstrip()
                + f" (p = {chart.p_value:.1g})"
                for chart in self.charts
                if chart.ages
            ),
            *(
                f"{chart.parameter} of {chart.sensor}: {len(chart.outside)} of {len(chart.days)} runs beyond "
                f"{LIMIT:g} standard deviations"
                for chart in self.charts
                if chart.outside and not chart.ages
            ),
            *(
                f"{name}: with the population as prior the next sensor needs {100.0 * share:.0f} % of the length of a "
                "calibration"
                for name in self.populations
                if (share := self.share(name)) < NO_SHORTER
            ),
            *([f"{failed} of {failed + len(self.files)} recordings could not be fitted"] if failed else []),
        ]

    def share(self, name: str) -> float:
        """Share of the length of a calibration that suffices for a parameter of the next sensor."""
        return self.populations[name].shorter(float(np.median(self.values[name + STD])))

    def cells(self, i: int) -> tuple[str, ...]:
        """A sensor, its number of runs, and its estimates given the population."""
        several = (concise(float(p.sensors[i]), float(p.sensors_std[i])) for p in self.populations.values())
        return (self.sensors[i], str(np.count_nonzero(self.sensor_of == i)), *several)


def sensor_name(file: str) -> str:
    """Sensor of a recording: the folder that it is in."""
    return Path(file).parent.name or "."


def summarise(results: Results) -> Fleet:
    """Everything that follows from the fits of a fleet; no recording is read.

    Raises
    ------
    ValueError
        If no recording was fitted.
    """
    good = np.array([item not in results.errors for item in results.items], dtype=np.bool_)
    files = tuple(item for item, usable in zip(results.items, good, strict=True) if usable)
    if not files:
        first = next(iter(results.errors.items()), ("", ""))
        raise AccelcalError(
            f"no recording of the fleet could be fitted; {first[0]}: {first[1].strip().splitlines()[-1]}"
        )
    values = {name: y[good] for name, y in results.values.items() if name != CONTENT}
    names = [sensor_name(file) for file in files]
    sensors = tuple(dict.fromkeys(names))
    sensor_of = np.array([sensors.index(name) for name in names], dtype=np.intp)
    parameters = {
        term.name: term.unit for term in Model.cubic().terms if term.name in values and term.owner == "sensor"
    }
    populations: dict[str, Population] = {}
    for name in parameters if len(sensors) > 1 else ():
        there = np.isfinite(values[name]) & np.isfinite(values[name + STD])
        if set(sensor_of[there]) == set(range(len(sensors))):  # every sensor has it
            populations[name] = population(values[name][there], values[name + STD][there], sensor_of[there])
    charts = control_charts(sensors, sensor_of, values, tuple(parameters), populations)
    return Fleet(sensors, files, sensor_of, values, parameters, populations, charts, dict(results.errors))


def control_charts(
    sensors: Sequence[str],
    sensor_of: Counts,
    values: dict[str, Array],
    parameters: Sequence[str],
    populations: dict[str, Population],
) -> tuple[Chart, ...]:
    """A chart for each parameter of each sensor with enough dated runs."""
    charts = []
    for i, sensor in enumerate(sensors):
        mine = np.flatnonzero((sensor_of == i) & np.isfinite(values["date"]))
        if len(set(values["date"][mine].tolist())) < FEWEST_DATES:
            continue
        mine = mine[np.argsort(values["date"][mine], kind="stable")]
        for name in (n for n in parameters if np.all(np.isfinite(values[n][mine]))):
            between = populations[name].run_to_run.value if name in populations else moving_range(values[name][mine])
            charts.append(
                chart(sensor, name, values["date"][mine], values[name][mine], values[name + STD][mine], between)
            )
    return tuple(corrected(chart, len(charts)) for chart in charts)


def moving_range(y: Array) -> float:
    """Standard deviation of runs in their order, from the differences of neighbours (individuals chart)."""
    return float(np.mean(np.abs(np.diff(y)))) / RANGE_OF_TWO


def chart(sensor: str, name: str, days: Array, y: Array, std: Array, between: float) -> Chart:
    """Mean, limits and slope of one parameter.

    Limits are those of fit and run-to-run together. The slope is judged by the scatter of its own runs about the line,
    so that one sensor that ages does not hide behind the spread that it adds to all.
    """
    spread = np.hypot(std, between)
    mean = float(np.sum(y / spread**2) / np.sum(1.0 / spread**2))
    w = 1.0 / std**2
    t = (days - float(w @ days / np.sum(w))) / 365.25
    information = float(w @ t**2)
    slope = float(w @ (t * y)) / information
    left = y - float(w @ y / np.sum(w)) - slope * t
    freedom = len(y) - 2
    slope_std = math.sqrt(max(1.0, float(w @ left**2) / freedom) / information)
    sigma = np.abs(y - mean) / spread
    return Chart(
        sensor=sensor,
        parameter=name,
        days=tuple(days.tolist()),
        values=tuple(y.tolist()),
        std=tuple(spread.tolist()),
        mean=mean,
        outside=tuple(int(k) for k in np.flatnonzero(sigma > LIMIT)),
        slope=slope,
        slope_std=slope_std,
        p_value=2.0 * float(scipy.special.stdtr(freedom, -abs(slope) / slope_std)),
    )


def corrected(chart: Chart, count: int) -> Chart:
    """The chart with its probability over all charts (Sidak)."""
    return replace(chart, p_value=over_all(chart.p_value, count))


MOST_NAMES = 20
"""Sensors whose names are written on the axis."""
HEIGHT = 150.0
"""px"""


def sensors(fleet: Fleet) -> Figure:
    """Draw every sensor with two standard deviations, the population as a band, outlying ones filled."""
    count, panels = len(fleet.sensors), []
    names = (range(1, count + 1), fleet.sensors) if count <= MOST_NAMES else ([1, count], ["1", str(count)])
    for name, of_sensors in fleet.populations.items():
        number, half = np.arange(1.0, len(of_sensors.sensors) + 1.0), 2.0 * of_sensors.next_sensor_std
        odd = of_sensors.outlying < OUTLYING
        points = [
            Points(
                number[rows],
                of_sensors.sensors[rows],
                role="ink",
                error=2.0 * of_sensors.sensors_std[rows],
                hollow=hollow,
            )
            for rows, hollow in ((~odd, True), (odd, False))
            if rows.any()
        ]
        band = Level(low=of_sensors.mean - half, high=of_sensors.mean + half, role="band")
        size = Axis(name, fleet.parameters[name])
        panels.append(Panel((band, Level(of_sensors.mean), *points), Axis("sensor", ticks=names), size, height=HEIGHT))
    return Figure(tuple(panels), shared_x=True)


def drawn_charts(fleet: Fleet, several: Sequence[Chart]) -> Figure:
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
    charts = sorted(fleet.charts, key=lambda chart: (not chart.ages, -len(chart.outside), chart.p_value))[:MOST_CHARTS]
    shown = [("Sensors", sensors(fleet))] if fleet.populations else []
    shown += [("Control charts", drawn_charts(fleet, charts))] if charts else []
    return filled(
        "page.html",
        "accelcal.fleet",
        fleet=fleet,
        figures=[(title, svg_url(matplotlib.draw(figure))) for title, figure in shown],
        population=[population_row(fleet, name) for name in fleet.populations],
        sensors=[sensor_row(fleet, i) for i in range(len(fleet.sensors))] if fleet.populations else [],
        runs=[run_row(fleet, k, folder) for k in range(len(fleet.files))],
        undrawn=max(0, len(fleet.charts) - len(charts)),
    )


def population_row(fleet: Fleet, name: str) -> tuple[str, ...]:
    """Cells of one parameter."""
    of_sensors, unit = fleet.populations[name], fleet.parameters[name]
    spreads = [
        f"{number(std.value, 3)} ({number(std.low, 2)} to {number(std.high, 2)})"
        for std in (of_sensors.between_sensors, of_sensors.run_to_run)
    ]
    mean = f"{plain(unit, of_sensors.mean, of_sensors.mean_std)} = {concise(of_sensors.mean, of_sensors.mean_std)}"
    return (name, unit, mean, *spreads, number(2.0 * of_sensors.next_run_std, 2), f"{100.0 * fleet.share(name):.0f} %")


def sensor_row(fleet: Fleet, i: int) -> tuple[str, ...]:
    """Cells of one sensor."""
    odd = [name for name, of_sensors in fleet.populations.items() if of_sensors.outlying[i] < OUTLYING]
    return (*fleet.cells(i), f"outlying: {', '.join(odd)}" if odd else "")


def run_row(fleet: Fleet, k: int, folder: Path) -> dict[str, Any]:
    """Cells of one run; the report beside a recording is linked."""
    file = Path(fleet.files[k])
    report = file.with_suffix(".html")
    link = Path(os.path.relpath(report.resolve(), folder.resolve())).as_posix() if report.is_file() else ""
    cells = [concise(float(fleet.values[name][k]), float(fleet.values[name + STD][k])) for name in fleet.parameters]
    ratio = float(fleet.values["noise_ratio"][k])
    return {
        "sensor": fleet.sensors[fleet.sensor_of[k]],
        "file": file.name,
        "link": quote(link),
        "cells": [*cells, "" if ratio != ratio else number(ratio, 3), str(int(fleet.values["remarks"][k]))],
    }
