"""FilterPy: its extended filter, `predict` overridden where the covariance follows a differential equation."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version

import filterpy.kalman
import numpy as np

from benches.peers import plain
from benches.peers.workload import R_OUTPUT, R_POSITION, Array, Data, Ended, Workload, timed, transition

NAME = f"FilterPy {version('filterpy')}"
STEPS = {"W1": 2000, "W2": 1000, "W3": 2000}
"""It has no second-order update, hence no W4."""


def prepare(workload: Workload, data: Data) -> Callable[[], Ended]:
    """The run over a record."""
    return timed(lambda: follow(workload, data))


class RungeKutta(filterpy.kalman.ExtendedKalmanFilter):  # type: ignore[misc]
    """FilterPy's filter with the coupled equations of x and P in its `predict`."""

    workload: Workload

    def predict(self, u: tuple[float, float] = (0.0, 0.0)) -> None:
        """One step under the output at both of its ends."""
        self.x, self.P = plain.runge_kutta(self.workload, self.x, self.P, *u)


def follow(workload: Workload, data: Data) -> tuple[Array, Array]:
    """x and the diagonal of P after the last sample."""
    N = workload.states
    position = np.eye(N)[:1]
    f = (RungeKutta if workload.system == "aci" else filterpy.kalman.ExtendedKalmanFilter)(N, 1)
    f.x, f.P, f.workload = np.zeros(N), workload.P0, workload
    if workload.system == "cwpa":
        f.F, f.Q = transition(workload)

    def gradient(x: Array) -> Array:
        return plain.sensed(workload, x)[1][None]

    def output(x: Array) -> Array:
        return plain.sensed(workload, x)[0]

    for j in range(1, data.steps + 1):
        if workload.system == "aci":
            f.predict((data.u[j - 1], data.u[j]))
        else:
            f.predict()
            f.update(
                data.u[j],
                lambda x: plain.sensed(workload, x)[1][None],
                lambda x: plain.sensed(workload, x)[0],
                R=R_OUTPUT,
            )
        if j % 2 == 0:
            f.update(data.z[j], lambda x: position, lambda x: x[:1], R=R_POSITION)
    return f.x, np.diag(f.P)
