"""NumPy, step by step: the reference that every peer must agree with, and a peer itself.

All functions take one run, x (N,) and P (N, N), or many side by side, x (runs, N) and P (runs, N, N).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benches.peers.workload import DT, R_OUTPUT, R_POSITION, Array, Data, Ended, Q, Workload, timed, transition

NAME = f"NumPy {np.__version__}, step by step"
STEPS = {"W1": 2000, "W2": 1000, "W3": 2000, "W4": 1000, "W5": 200}


def prepare(workload: Workload, data: Data) -> Callable[[], Ended]:
    """The run over a record."""
    return timed(lambda: follow(workload, data))


def follow(workload: Workload, data: Data) -> tuple[Array, Array]:
    """x and the diagonal of P after the last sample."""
    lead = data.u.shape[:-1]
    x = np.zeros((*lead, workload.states))
    P = np.broadcast_to(workload.P0, (*lead, workload.states, workload.states)).copy()
    u, z = np.moveaxis(data.u, -1, 0), np.moveaxis(data.z, -1, 0)
    position = np.eye(workload.states)[0]
    F, noise = transition(workload) if workload.system == "cwpa" else (None, None)
    if F is not None and workload.public:
        x, P = read_output(workload, x, P, u[0])
    for j in range(1, data.steps + 1):
        if F is None:
            x, P = runge_kutta(workload, x, P, u[j - 1], u[j])
        else:
            x, P = x @ F.T, F @ P @ F.T + noise
            x, P = read_output(workload, x, P, u[j])
        if j % 2 == 0:
            x, P = update(x, P, np.broadcast_to(position, x.shape), z[j] - x[..., 0], R_POSITION)
    return x, np.diagonal(P, axis1=-2, axis2=-1)


def runge_kutta(workload: Workload, x: Array, P: Array, u0: Array, u1: Array) -> tuple[Array, Array]:
    """One step of x and P: midpoint rule for W1, the classical one for W2."""
    um = 0.5 * (u0 + u1)
    dx1, dP1 = rates(workload, x, P, u0)
    dx2, dP2 = rates(workload, x + 0.5 * DT * dx1, P + 0.5 * DT * dP1, um)
    if workload.order == 1:
        return x + DT * dx2, P + DT * dP2
    dx3, dP3 = rates(workload, x + 0.5 * DT * dx2, P + 0.5 * DT * dP2, um)
    dx4, dP4 = rates(workload, x + DT * dx3, P + DT * dP3, u1)
    return x + DT / 6.0 * (dx1 + 2.0 * dx2 + 2.0 * dx3 + dx4), P + DT / 6.0 * (dP1 + 2.0 * dP2 + 2.0 * dP3 + dP4)


def rates(workload: Workload, x: Array, P: Array, u: Array) -> tuple[Array, Array]:
    """x' and P' of the ACI system (9), inverse sensor (5)(6), first or second order (11)-(14)."""
    k, w = x[..., 2], u - x[..., 3]
    F = np.zeros(P.shape)
    F[..., 0, 1] = 1.0
    F[..., 1, 2] = -w
    slope, a = 1.0 - k, (1.0 - k) * w
    if workload.parameters == 4:
        K2, K3 = x[..., 4], x[..., 5]
        slope = slope + 2.0 * K2 * w + 3.0 * K3 * w**2
        a = a + K2 * w**2 + K3 * w**3
        F[..., 1, 4] = w**2
        F[..., 1, 5] = w**3
    F[..., 1, 3] = -slope
    if workload.order == 2:
        hessian = np.zeros(P.shape)
        hessian[..., 2, 3] = hessian[..., 3, 2] = 1.0
        hessian[..., 3, 3] = 2.0 * K2 + 6.0 * K3 * w
        hessian[..., 3, 4] = hessian[..., 4, 3] = -2.0 * w
        hessian[..., 3, 5] = hessian[..., 5, 3] = -3.0 * w**2
        a = a + 0.5 * np.sum(hessian * P, axis=(-2, -1))
    dx = np.zeros(x.shape)
    dx[..., 0], dx[..., 1] = x[..., 1], a
    FP = F @ P
    dP = FP + np.swapaxes(FP, -2, -1)
    dP[..., 1, 1] += Q * slope**2 if workload.public else Q
    return dx, dP


def sensed(workload: Workload, x: Array) -> tuple[Array, Array]:
    """Expected output (3)(4) and its gradient (N,)."""
    a, k, K0 = x[..., 2], x[..., 3], x[..., 4]
    H = np.zeros(x.shape)
    slope, expected = 1.0 + k, K0 + (1.0 + k) * a
    if workload.parameters == 4:
        K2, K3 = x[..., 5], x[..., 6]
        slope = slope + 2.0 * K2 * a + 3.0 * K3 * a**2
        expected = expected + K2 * a**2 + K3 * a**3
        H[..., 5], H[..., 6] = a**2, a**3
    H[..., 2], H[..., 3], H[..., 4] = slope, a, 1.0
    return expected, H


def read_output(workload: Workload, x: Array, P: Array, z: Array) -> tuple[Array, Array]:
    """The output's reading in CWPA, first or second order."""
    expected, H = sensed(workload, x)
    R = R_OUTPUT
    if workload.order == 2:
        a, K2, K3 = x[..., 2], x[..., 5], x[..., 6]
        hessian = np.zeros(P.shape)
        hessian[..., 2, 2] = 2.0 * K2 + 6.0 * K3 * a
        hessian[..., 2, 3] = hessian[..., 3, 2] = 1.0
        hessian[..., 2, 5] = hessian[..., 5, 2] = 2.0 * a
        hessian[..., 2, 6] = hessian[..., 6, 2] = 3.0 * a**2
        spread = hessian @ P
        expected = expected + 0.5 * np.trace(spread, axis1=-2, axis2=-1)
        R = R + 0.5 * np.sum(spread * np.swapaxes(spread, -2, -1), axis=(-2, -1))
    return update(x, P, H, z - expected, R)


def update(x: Array, P: Array, H: Array, e: Array, R: Array | float) -> tuple[Array, Array]:
    """A scalar reading, Joseph form."""
    PHt = (P @ H[..., None])[..., 0]
    S = np.sum(H * PHt, axis=-1) + R
    gain = PHt / S[..., None]
    IKH = np.eye(x.shape[-1]) - gain[..., :, None] * H[..., None, :]
    noise = gain[..., :, None] * gain[..., None, :] * np.asarray(R)[..., None, None]
    return x + gain * np.asarray(e)[..., None], IKH @ P @ np.swapaxes(IKH, -2, -1) + noise
