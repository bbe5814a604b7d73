"""The workloads W1 to W5: what every peer is given, and what it must arrive at.

1667 Hz output, position at every second step, three tones. W1: ACI, linear, first order, RK2. W2: ACI, cubic, second
order, RK4. W3: CWPA, linear, first order. W4: CWPA, cubic, second order. W5: 100 runs of W2. The output is linear
between its samples. In W1 to W4 the process noise acts on the acceleration; the product has it at the output, where
the sensor's slope acts on it, and `public` says so.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DT = 1.0 / 1667.0
Q = 1e-4 * DT
"""Two-sided density of the acceleration's or output's noise, (m/s²)² s."""
JERK = 25.0
R_POSITION, R_OUTPUT = 1e-12, 1e-4
TONES = ((5.0, 7.3), (3.0, 19.1), (2.0, 41.7))
"""Amplitudes, m/s², and angular frequencies, rad/s."""
RUNS = 100
"""Of W5."""
MOTION = {"aci": (1e-10, 1e-2), "cwpa": (1e-10, 1e-2, 1.0)}
PARAMETERS = (1e-4, 1e-2, 1e-6, 1e-8)
"""Prior variances, SI."""


@dataclass(frozen=True, slots=True)
class Workload:
    """One row of numbers to be filtered, and how."""

    name: str
    system: Literal["aci", "cwpa"]
    parameters: int
    order: Literal[1, 2]
    runs: int = 1
    public: bool = False
    """Noise at the output, and sample 0 of CWPA read: as the product's Python interface has it."""

    @property
    def number(self) -> int:
        """1 for W1, and so on."""
        return int(self.name[1:])

    @property
    def states(self) -> int:
        """N."""
        return len(MOTION[self.system]) + self.parameters

    @property
    def P0(self) -> Array:
        """(N, N) prior covariance; the prior mean is zero."""
        return np.diag([*MOTION[self.system], *PARAMETERS[: self.parameters]])

    @property
    def as_published(self) -> Workload:
        """The same as the product's Python interface runs it."""
        return replace(self, public=True)


WORKLOADS = (
    Workload("W1", "aci", 2, 1),
    Workload("W2", "aci", 4, 2),
    Workload("W3", "cwpa", 2, 1),
    Workload("W4", "cwpa", 4, 2),
    Workload("W5", "aci", 4, 2, runs=RUNS, public=True),
)


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """Samples of one run (n,), or of several (runs, n)."""

    u: Array
    """Output, m/s²."""
    z: Array
    """Position, m; NaN where it was not read."""

    @property
    def steps(self) -> int:
        """n - 1."""
        return self.u.shape[-1] - 1

    def cut(self, steps: int) -> Data:
        """The first so many steps."""
        return Data(self.u[..., : steps + 1].copy(), self.z[..., : steps + 1].copy())


@dataclass(frozen=True, slots=True, eq=False)
class Ended:
    """Where a run ended, and what it took."""

    seconds: float
    """Processor time of the filter alone."""
    x: Array
    """(N,) or (runs, N)."""
    variances: Array
    """Diagonal of P, as x."""


class Missing(Exception):
    """A peer that is not here; the text says why."""


def draw(workload: Workload, steps: int, seed: int = 1) -> Data:
    """A record; those of several runs differ in their noise."""
    rng = np.random.default_rng(seed)
    shape = (workload.runs, steps + 1) if workload.runs > 1 else (steps + 1,)
    t = np.arange(steps + 1) * DT
    a = sum(A * np.sin(w * t) for A, w in TONES)
    p = sum(-A / w**2 * np.sin(w * t) for A, w in TONES)
    z = p + np.sqrt(R_POSITION) * rng.standard_normal(shape)
    z[..., 0], z[..., 1::2] = np.nan, np.nan
    return Data(0.05 + 1.01 * a + np.sqrt(R_OUTPUT) * rng.standard_normal(shape), z)


def timed(work: Callable[[], tuple[Array, Array]]) -> Callable[[], Ended]:
    """Work that returns x and variances, with its processor time."""

    def once() -> Ended:
        start = time.process_time()
        x, variances = work()
        return Ended(time.process_time() - start, x, variances)

    return once


def white_jerk() -> tuple[Array, Array]:
    """Transition (3, 3) and noise (3, 3) of p, v, a over one step (10)."""
    F = np.array([[1.0, DT, DT**2 / 2], [0.0, 1.0, DT], [0.0, 0.0, 1.0]])
    Q3 = [[DT**5 / 20, DT**4 / 8, DT**3 / 6], [DT**4 / 8, DT**3 / 3, DT**2 / 2], [DT**3 / 6, DT**2 / 2, DT]]
    return F, JERK * np.array(Q3)


def transition(workload: Workload) -> tuple[Array, Array]:
    """F (N, N) and Q (N, N) of CWPA over one step."""
    F, noise = np.eye(workload.states), np.zeros((workload.states, workload.states))
    F[:3, :3], noise[:3, :3] = white_jerk()
    return F, noise
