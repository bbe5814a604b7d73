"""numba: whole matrices in compiled loops."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from benches.peers.workload import DT, R_OUTPUT, R_POSITION, Array, Data, Ended, Q, Workload, timed, transition

NAME = f"numba {numba.__version__}, dense loops"
STEPS = {"W1": 20_000, "W2": 20_000, "W3": 20_000, "W4": 20_000}

compiled = numba.njit(fastmath={"contract"}, error_model="numpy", inline="never")


def prepare(workload: Workload, data: Data) -> Callable[[], Ended]:
    """The run over a record, compiled before it is timed."""
    F, noise = transition(workload) if workload.system == "cwpa" else (np.eye(1), np.eye(1))
    follow = aci if workload.system == "aci" else cwpa

    def work() -> tuple[Array, Array]:
        return follow(workload.order == 2, workload.P0.copy(), F, noise, data.u, data.z)

    work()
    return timed(work)


@compiled
def product(A, B, C):  # type: ignore[no-untyped-def]
    """C = A B."""
    N = len(A)
    for i in range(N):
        for j in range(N):
            s = 0.0
            for k in range(N):
                s += A[i, k] * B[k, j]
            C[i, j] = s


@compiled
def update(x, P, H, e, R, gain, IKH, half):  # type: ignore[no-untyped-def]
    """A scalar reading, Joseph form, in place."""
    N = len(x)
    S = R
    for i in range(N):
        s = 0.0
        for j in range(N):
            s += P[i, j] * H[j]
        gain[i] = s
        S += H[i] * s
    for i in range(N):
        gain[i] /= S
        x[i] += gain[i] * e
    for i in range(N):
        for j in range(N):
            IKH[i, j] = (1.0 if i == j else 0.0) - gain[i] * H[j]
    product(IKH, P, half)
    for i in range(N):
        for j in range(N):
            s = R * gain[i] * gain[j]
            for k in range(N):
                s += half[i, k] * IKH[j, k]
            P[i, j] = s


@compiled
def rates(second, x, P, u, F, hessian, dx, dP, FP):  # type: ignore[no-untyped-def]
    """x' and P' of the ACI system (9), into dx and dP."""
    N = len(x)
    w = u - x[3]
    slope, a = 1.0 - x[2], (1.0 - x[2]) * w
    if N == 6:
        slope += 2.0 * x[4] * w + 3.0 * x[5] * w * w
        a += x[4] * w * w + x[5] * w * w * w
        F[1, 4], F[1, 5] = w * w, w * w * w
    F[1, 2], F[1, 3] = -w, -slope
    if second:
        hessian[3, 3] = 2.0 * x[4] + 6.0 * x[5] * w
        hessian[3, 4] = hessian[4, 3] = -2.0 * w
        hessian[3, 5] = hessian[5, 3] = -3.0 * w * w
        for i in range(N):
            for j in range(N):
                a += 0.5 * hessian[i, j] * P[j, i]
    dx[0], dx[1] = x[1], a
    product(F, P, FP)
    for i in range(N):
        for j in range(N):
            dP[i, j] = FP[i, j] + FP[j, i]
    dP[1, 1] += Q


@compiled
def ahead(x, P, dx, dP, h, x_out, P_out):  # type: ignore[no-untyped-def]
    """x + h dx and P + h dP."""
    N = len(x)
    for i in range(N):
        x_out[i] = x[i] + h * dx[i]
        for j in range(N):
            P_out[i, j] = P[i, j] + h * dP[i, j]


@compiled
def aci(second, P, _F, _noise, u, z):  # type: ignore[no-untyped-def]
    """x and the diagonal of P after the last sample."""
    N = len(P)
    x, xm, gain, H = np.zeros(N), np.zeros(N), np.zeros(N), np.zeros(N)
    dx, dP = np.zeros((4, N)), np.zeros((4, N, N))
    Pm, F, hessian, IKH, half = np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N))
    H[0] = F[0, 1] = 1.0
    if second:
        hessian[2, 3] = hessian[3, 2] = 1.0
    for j in range(1, len(u)):
        um = 0.5 * (u[j - 1] + u[j])
        rates(second, x, P, u[j - 1], F, hessian, dx[0], dP[0], half)
        ahead(x, P, dx[0], dP[0], 0.5 * DT, xm, Pm)
        rates(second, xm, Pm, um, F, hessian, dx[1], dP[1], half)
        if not second:
            ahead(x, P, dx[1], dP[1], DT, x, P)
        else:
            ahead(x, P, dx[1], dP[1], 0.5 * DT, xm, Pm)
            rates(second, xm, Pm, um, F, hessian, dx[2], dP[2], half)
            ahead(x, P, dx[2], dP[2], DT, xm, Pm)
            rates(second, xm, Pm, u[j], F, hessian, dx[3], dP[3], half)
            for i in range(N):
                x[i] += DT / 6.0 * (dx[0, i] + 2.0 * dx[1, i] + 2.0 * dx[2, i] + dx[3, i])
                for k in range(N):
                    P[i, k] += DT / 6.0 * (dP[0, i, k] + 2.0 * dP[1, i, k] + 2.0 * dP[2, i, k] + dP[3, i, k])
        if not np.isnan(z[j]):
            update(x, P, H, z[j] - x[0], R_POSITION, gain, IKH, half)
    return x, np.diag(P).copy()


@compiled
def cwpa(second, P, F, noise, u, z):  # type: ignore[no-untyped-def]
    """x and the diagonal of P after the last sample."""
    N = len(P)
    x, xm, gain, H, position = np.zeros(N), np.zeros(N), np.zeros(N), np.zeros(N), np.zeros(N)
    hessian, IKH, half = np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N))
    position[0] = H[4] = 1.0
    for j in range(1, len(u)):
        for i in range(N):
            s = 0.0
            for k in range(N):
                s += F[i, k] * x[k]
            xm[i] = s
        x[:] = xm
        product(F, P, half)
        for i in range(N):
            for k in range(N):
                s = noise[i, k]
                for m in range(N):
                    s += half[i, m] * F[k, m]
                P[i, k] = s
        a, R = x[2], R_OUTPUT
        slope, expected = 1.0 + x[3], x[4] + (1.0 + x[3]) * a
        if second:
            slope += 2.0 * x[5] * a + 3.0 * x[6] * a * a
            expected += x[5] * a * a + x[6] * a * a * a
            H[5], H[6] = a * a, a * a * a
            hessian[2, 2] = 2.0 * x[5] + 6.0 * x[6] * a
            hessian[2, 3] = hessian[3, 2] = 1.0
            hessian[2, 5] = hessian[5, 2] = 2.0 * a
            hessian[2, 6] = hessian[6, 2] = 3.0 * a * a
            product(hessian, P, half)
            for i in range(N):
                expected += 0.5 * half[i, i]
                for k in range(N):
                    R += 0.5 * half[i, k] * half[k, i]
        H[2], H[3] = slope, a
        update(x, P, H, u[j] - expected, R, gain, IKH, half)
        if not np.isnan(z[j]):
            update(x, P, position, z[j] - x[0], R_POSITION, gain, IKH, half)
    return x, np.diag(P).copy()
