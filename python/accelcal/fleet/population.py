"""One parameter over many runs of many sensors: mean, spread between sensors and runs, by restricted likelihood.

y_j = m + S_i + d_j + e_j for run j of sensor i: S ~ N(0, T²) between sensors, d ~ N(0, w²) between runs of one
sensor, and e with the standard deviation of the fit of the run (derivations 6.13). No recording is read again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal._support.errors import AccelcalError
from accelcal._support.result import Storable
from accelcal.data import Array
from accelcal.estimation.run_to_run import over_all

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
        """At a variance between runs."""
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
    surface = likelihoods(y, std, sensor, runs, sensors)
    i, j = np.unravel_index(int(np.argmax(surface)), surface.shape)

    def missed(x: Array) -> float:
        return float(Sums.of(y, std, sensor, float(x[0] ** 2)).minus_two_log(np.array([x[1] ** 2]))[0])

    start = np.array([runs[i], sensors[j]])
    simplex = np.array(
        [start, [start[0] * 1.2 + 0.01 * scale * repeated, start[1]], [start[0], start[1] * 1.2 + 0.01 * scale]]
    )
    options = {"initial_simplex": simplex, "xatol": 1e-9 * scale, "fatol": 1e-9, "maxiter": 400}
    found = np.abs(scipy.optimize.minimize(missed, start, method="Nelder-Mead", options=options).x)
    best = -0.5 * missed(found)
    if not repeated:
        found[0] = 0.0
    sums = Sums.of(y, std, sensor, float(found[0] ** 2))
    mean, variance = sums.mean(float(found[1] ** 2))
    share = found[1] ** 2 / (found[1] ** 2 + sums.v) if found[1] > 0.0 else np.zeros(count)
    return Population(
        mean=mean,
        mean_std=math.sqrt(variance),
        between_sensors=component(
            float(found[1]), float(found[0]), scale, best, lambda x, y: missed(np.array([y * repeated, x]))
        ),
        run_to_run=component(float(found[0]), float(found[1]), scale, best, lambda x, y: missed(np.array([x, y])))
        if repeated
        else Component(0.0, 0.0, 0.0),
        sensors=mean + share * (sums.ybar - mean),
        sensors_std=np.sqrt(share * sums.v + (1.0 - share) ** 2 * variance),
        outlying=deleted(sums, float(found[1] ** 2)),
    )


def likelihoods(y: Array, std: Array, sensor: NDArray[np.intp], runs: Array, sensors: Array) -> Array:
    """Log restricted likelihood at standard deviations between runs and between sensors, (runs, sensors)."""
    return np.array([-0.5 * Sums.of(y, std, sensor, float(w**2)).minus_two_log(sensors**2) for w in runs])


def component(
    value: float, other: float, scale: float, best: float, missed: Callable[[float, float], float]
) -> Component:
    """A standard deviation, and its 95 % interval: where the likelihood, the largest over the other one, has fallen.

    `missed` is -2 log-likelihood at this standard deviation and the other.
    """

    def above(x: float) -> float:
        widest = SPAN * max(other, 1e-3 * scale)
        options = {"xatol": 1e-7 * widest}
        found = scipy.optimize.minimize_scalar(
            lambda y: missed(x, y), bounds=(0.0, widest), method="bounded", options=options
        )
        return DROP - best - 0.5 * min(float(found.fun), missed(x, other))

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
        own = float(trials[int(np.argmin(others.minus_two_log(trials)))])
        mean, variance = others.mean(own)
        t = abs(float(sums.ybar[i]) - mean) / math.sqrt(float(sums.v[i]) + own + variance)
        alone = 2.0 * float(scipy.special.stdtr(count - 2, -t))
        p[i] = over_all(alone, count)
    return p
