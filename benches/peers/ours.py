"""The product through its Python interface: a record in one call, and a stream of one sample a call."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from accelcal.filters.choice import FilterChoice
from accelcal.filters.record import run_batch
from accelcal.filters.stream import LiveFilter
from benches.peers.workload import DT, JERK, R_OUTPUT, R_POSITION, Array, Data, Ended, Q, Workload, timed


def settings(workload: Workload) -> dict[str, object]:
    """Settings of `run_batch` and `LiveFilter`."""
    aci = workload.system == "aci"
    return {
        "q": Q if aci else JERK,
        "r_position": R_POSITION,
        "r_accel": None if aci else R_OUTPUT,
        "x0": np.zeros(workload.states),
        "P0": workload.P0,
    }


def choice(workload: Workload) -> FilterChoice:
    """The filter of a workload."""
    return FilterChoice(
        workload.system,
        "linear" if workload.parameters == 2 else "cubic",
        form="inverse" if workload.system == "aci" else "forward",
        integrator={"W1": "rk2"}.get(workload.name, "rk4") if workload.system == "aci" else "exact",
        order=workload.order,
    )


def record(workload: Workload, data: Data) -> Callable[[], Ended]:
    """`run_batch` on one record, or on all runs of W5 side by side; one thread."""

    def work() -> tuple[Array, Array]:
        result = run_batch(choice(workload), data.u, data.z, dt=DT, **settings(workload))
        variances = np.diagonal(result.covariances, axis1=1, axis2=2)
        return (result.states, variances) if workload.runs > 1 else (result.states[0], variances[0])

    return timed(work)


def stream(workload: Workload, data: Data) -> Callable[[], Ended]:
    """`LiveFilter.step`, called for every sample."""
    times = (np.arange(data.steps + 1) * DT).tolist()
    u, z = data.u.tolist(), [None if np.isnan(p) else p for p in data.z.tolist()]

    def work() -> tuple[Array, Array]:
        live = LiveFilter(choice(workload), **settings(workload))
        step = live.step
        for t, accel, position in zip(times, u, z, strict=True):
            step(t, accel=accel, position=position)
        live.finish()
        return live.estimate, np.diag(live.covariance)

    return timed(work)
