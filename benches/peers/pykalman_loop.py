"""pykalman: `filter_update` with each reading linearised outside; it integrates no covariance, which leaves W3."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version

import numpy as np
from pykalman import KalmanFilter

from benches.peers import plain
from benches.peers.workload import R_OUTPUT, R_POSITION, Array, Data, Ended, Workload, timed, transition

NAME = f"pykalman {version('pykalman')}"
STEPS = {"W3": 200}


def prepare(workload: Workload, data: Data) -> Callable[[], Ended]:
    """The run over a record."""
    return timed(lambda: follow(workload, data))


def follow(workload: Workload, data: Data) -> tuple[Array, Array]:
    """x and the diagonal of P after the last sample."""
    N = workload.states
    F, noise = transition(workload)
    still, silent, none = np.eye(N), np.zeros((N, N)), np.zeros(N)
    position = still[:1]
    f = KalmanFilter(n_dim_state=N, n_dim_obs=1)
    x, P = np.zeros(N), workload.P0
    for j in range(1, data.steps + 1):
        expected, H = plain.sensed(workload, F @ x)
        x, P = f.filter_update(
            x,
            P,
            observation=data.u[j : j + 1],
            transition_matrix=F,
            transition_covariance=noise,
            transition_offset=none,
            observation_matrix=H[None],
            observation_offset=np.array([expected - H @ (F @ x)]),
            observation_covariance=np.array([[R_OUTPUT]]),
        )
        if j % 2 == 0:
            x, P = f.filter_update(
                x,
                P,
                observation=data.z[j : j + 1],
                transition_matrix=still,
                transition_covariance=silent,
                transition_offset=none,
                observation_matrix=position,
                observation_offset=np.zeros(1),
                observation_covariance=np.array([[R_POSITION]]),
            )
    return np.asarray(x), np.diag(P)
