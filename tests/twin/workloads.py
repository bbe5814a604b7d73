"""The workloads W1 to W4 at a fixed rate from Python, and what a step of them costs beside a call that does nothing.

W1: ACI linear, RK2. W2: ACI cubic, second order, RK4. W3: CWPA linear. W4: CWPA cubic, second order. 1667 Hz, position
at every second sample.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from accelcal import _core, filters
from accelcal.filters.choice import FilterChoice
from accelcal.filters.stream import LiveFilter

DT = 1.0 / 1667.0
STEPS = 20_000
ROUNDS = 9
VARIANCE = {"p": 1e-10, "v": 1e-2, "a": 1.0, "k": 1e-4, "K0": 1e-2, "K2": 1e-6, "K3": 1e-8}
TONES = ((5.0, 7.3), (3.0, 19.1), (2.0, 41.7))
"""Amplitude, m/s², and angular frequency, rad/s."""
WORKLOADS = {
    "W1": FilterChoice("aci", "linear", "inverse", integrator="rk2"),
    "W2": FilterChoice("aci", "cubic", "inverse", integrator="rk4", order=2),
    "W3": FilterChoice("cwpa", "linear"),
    "W4": FilterChoice("cwpa", "cubic", order=2),
}


@dataclass(frozen=True)
class Cost:
    """Processor time per step, ns, the loop's own taken off where there is one."""

    step: float
    """`step(u, z)`."""
    run: float
    """`run(u, z)` on the whole record."""
    stamped: float
    """`LiveFilter.step`."""
    empty: float
    """A compiled function of two floats that does nothing."""

    @property
    def ratio(self) -> float:
        """Empty calls that a step costs."""
        return self.step / self.empty


def record(steps: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
    """Output and position, NaN where it was not read."""
    rng = np.random.default_rng(1)
    t = np.arange(steps) * DT
    a = np.sum([A * np.sin(w * t) for A, w in TONES], axis=0)
    p = np.sum([-A / w**2 * np.sin(w * t) for A, w in TONES], axis=0)
    z = p + 1e-6 * rng.standard_normal(steps)
    z[1::2] = np.nan
    return 0.05 + 1.01 * a + 1e-2 * rng.standard_normal(steps), z


def settings(choice: FilterChoice) -> dict[str, Any]:
    """Noise and prior of the workloads."""
    names = choice.states()
    cwpa = choice.system == "cwpa"
    return {
        "q": 25.0 if cwpa else 1e-4 * DT,
        "r_position": 1e-12,
        "r_accel": 1e-4 if cwpa else None,
        "x0": np.zeros(len(names)),
        "P0": np.diag([VARIANCE[name] for name in names]),
    }


def least(several: Mapping[str, Callable[[], None]], rounds: int) -> dict[str, float]:
    """Processor time of the fastest round of each, ns per step; in turn, since a processor changes its pace."""
    result = dict.fromkeys(several, math.inf)
    for _ in range(rounds):
        for name, work in several.items():
            result[name] = min(result[name], timed(work) / STEPS)
    return result


def timed(work: Callable[[], None]) -> float:
    """Processor time, ns."""
    begun = time.process_time_ns()
    work()
    return float(time.process_time_ns() - begun)


def cost(choice: FilterChoice, rounds: int = ROUNDS) -> Cost:
    """All ways to feed one filter."""
    u, z = record()
    pairs = [(float(x), None if np.isnan(y) else float(y)) for x, y in zip(u, z, strict=True)]
    given, empty = settings(choice), _core.empty_call

    def loop() -> None:
        for _x, _y in pairs:
            pass

    def nothing() -> None:
        for x, _y in pairs:
            empty(x, x)

    def stepping() -> None:
        step = filters.fixed_rate(choice, dt=DT, **given).step
        for x, y in pairs:
            step(x, y)

    def running() -> None:
        filters.fixed_rate(choice, dt=DT, **given).run(u, z)

    def stamped() -> None:
        step = LiveFilter(choice, **given).step
        for j, (x, y) in enumerate(pairs):
            step(j * DT, accel=x, position=y)

    ways = {"loop": loop, "step": stepping, "empty": nothing, "run": running, "stamped": stamped}
    of = least(ways, rounds)
    return Cost(
        step=of["step"] - of["loop"],
        run=of["run"],
        stamped=of["stamped"] - of["loop"],
        empty=of["empty"] - of["loop"],
    )
