"""numba: our own block scheme written out by hand, since a fair peer may use it, too.

P is split into the motion's block, the rows c of covariance with the parameters, and the parameters' own block M, which
a prediction leaves alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from benches.peers.workload import DT, JERK, R_OUTPUT, R_POSITION, Array, Data, Ended, Q, Workload, timed

NAME = f"numba {numba.__version__}, our block scheme"
STEPS = {"W1": 20_000, "W2": 20_000, "W3": 20_000, "W4": 20_000}

compiled = numba.njit(fastmath={"contract"}, error_model="numpy")


def prepare(workload: Workload, data: Data) -> Callable[[], Ended]:
    """The run over a record, compiled before it is timed."""
    follow = {"W1": aci_linear, "W2": aci_cubic}.get(workload.name, cwpa)
    motion = len(workload.P0) - workload.parameters

    def work() -> tuple[Array, Array]:
        return follow(np.diag(workload.P0)[:motion].copy(), workload.P0[motion:, motion:].copy(), data.u, data.z)

    work()
    return timed(work)


@compiled
def aci_linear(prior, M, u, z):  # type: ignore[no-untyped-def]
    """W1 in scalars: c1 = cov(p; k, K0), c2 = cov(v; k, K0)."""
    p = v = k = K0 = ppv = c1k = c1b = c2k = c2b = 0.0
    ppp, pvv = prior
    Mkk, Mkb, Mbb = M[0, 0], M[0, 1], M[1, 1]
    for j in range(1, len(u)):
        u0, um = u[j - 1], 0.5 * (u[j - 1] + u[j])
        s = 1.0 - k
        g0, gm = K0 - u0, K0 - um
        a0, am = -s * g0, -s * gm
        h0k, h0b = Mkk * g0 - Mkb * s, Mkb * g0 - Mbb * s
        hmk, hmb = Mkk * gm - Mkb * s, Mkb * gm - Mbb * s
        d2k, d2b = c2k + 0.5 * DT * h0k, c2b + 0.5 * DT * h0b
        d1k, d1b = c1k + 0.5 * DT * c2k, c1b + 0.5 * DT * c2b
        pvm = ppv + 0.5 * DT * (pvv + g0 * c1k - s * c1b)
        vvm = pvv + 0.5 * DT * (2.0 * (g0 * c2k - s * c2b) + Q)
        ppp += 2.0 * DT * pvm
        ppv += DT * (vvm + gm * d1k - s * d1b)
        pvv += DT * (2.0 * (gm * d2k - s * d2b) + Q)
        c1k, c1b = c1k + DT * d2k, c1b + DT * d2b
        c2k, c2b = c2k + DT * hmk, c2b + DT * hmb
        p += DT * (v + 0.5 * DT * a0)
        v += DT * am
        if j % 2 == 0:
            i = 1.0 / (ppp + R_POSITION)
            e, f = (z[j] - p) * i, R_POSITION * i
            p, v, k, K0 = p + ppp * e, v + ppv * e, k + c1k * e, K0 + c1b * e
            Mkk, Mkb, Mbb = Mkk - c1k * c1k * i, Mkb - c1k * c1b * i, Mbb - c1b * c1b * i
            c2k, c2b, pvv = c2k - ppv * i * c1k, c2b - ppv * i * c1b, pvv - ppv * i * ppv
            c1k, c1b, ppv, ppp = f * c1k, f * c1b, f * ppv, f * ppp
    return np.array([p, v, k, K0]), np.array([ppp, pvv, Mkk, Mbb])


@compiled
def at(theta, M, u, g, h):  # type: ignore[no-untyped-def]
    """g = da/dtheta and h = M g of the cubic inverse sensor; returned is a with its second-order term."""
    k, K0, K2, K3 = theta
    w = u - K0
    w2 = w * w
    g[0], g[1], g[2], g[3] = -w, -(1.0 - k + 2.0 * K2 * w + 3.0 * K3 * w2), w2, w2 * w
    for i in range(4):
        h[i] = M[i, 0] * g[0] + M[i, 1] * g[1] + M[i, 2] * g[2] + M[i, 3] * g[3]
    a = (1.0 - k) * w + K2 * w2 + K3 * w2 * w
    return a + M[0, 1] + (K2 + 3.0 * K3 * w) * M[1, 1] - 2.0 * w * M[1, 2] - 3.0 * w2 * M[1, 3]


@compiled
def aci_cubic(prior, M, u, z):  # type: ignore[no-untyped-def]
    """W2: RK4 of the coupled equations in closed form."""
    p = v = ppv = 0.0
    ppp, pvv = prior
    theta, c1, c2 = np.zeros(4), np.zeros(4), np.zeros(4)
    g0, gm, g1, h0, hm, h1 = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    for j in range(1, len(u)):
        a0 = at(theta, M, u[j - 1], g0, h0)
        am = at(theta, M, 0.5 * (u[j - 1] + u[j]), gm, hm)
        a1 = at(theta, M, u[j], g1, h1)
        sv = sp = sq = 0.0
        for i in range(4):
            gf = g0[i] + 2.0 * gm[i]
            gs = gf + 2.0 * gm[i] + g1[i]
            x, y = gm[i] * (h0[i] + hm[i]), gm[i] * h0[i]
            w = g1[i] * hm[i]
            sv += gs * c2[i] + DT * (x + w)
            sp += gs * c1[i] + DT * ((gs + gf) * c2[i] + DT * (x + 0.5 * (y + w)))
            sq += gf * c1[i] + DT * (gf * c2[i] + 0.75 * DT * y)
            t = h0[i] + 2.0 * hm[i]
            c1[i] += DT * c2[i] + DT * DT / 6.0 * t
            c2[i] += DT / 6.0 * (t + 2.0 * hm[i] + h1[i])
        ppp += 2.0 * DT * ppv + DT * DT / 3.0 * (3.0 * pvv + sq + Q * DT)
        ppv += DT * pvv + DT / 6.0 * (sp + 3.0 * Q * DT)
        pvv += DT / 3.0 * sv + Q * DT
        p += DT * v + DT * DT / 6.0 * (a0 + 2.0 * am)
        v += DT / 6.0 * (a0 + 4.0 * am + a1)
        if j % 2 == 0:
            i = 1.0 / (ppp + R_POSITION)
            e, f, c = (z[j] - p) * i, R_POSITION * i, ppv * i
            p, v = p + ppp * e, v + ppv * e
            for r in range(4):
                theta[r] += c1[r] * e
                w = c1[r] * i
                for s in range(4):
                    M[r, s] -= w * c1[s]
            for r in range(4):
                c2[r] -= c * c1[r]
                c1[r] *= f
            pvv, ppv, ppp = pvv - c * ppv, f * ppv, f * ppp
    x, variances = np.empty(6), np.empty(6)
    x[0], x[1], x[2:] = p, v, theta
    variances[0], variances[1], variances[2:] = ppp, pvv, np.diag(M)
    return x, variances


@compiled
def cwpa(prior, M, u, z):  # type: ignore[no-untyped-def]
    """W3 and W4: K holds the motion's covariance, C its rows with the parameters."""
    m = len(M)
    x, theta, K, C = np.zeros(3), np.zeros(m), np.diag(prior), np.zeros((3, m))
    c, gain, along = np.zeros(m), np.zeros(m), np.zeros(3)
    q = JERK
    for j in range(1, len(u)):
        x[0] += DT * x[1] + 0.5 * DT * DT * x[2]
        x[1] += DT * x[2]
        pp, pv, pa, vv, va, aa = K[0, 0], K[0, 1], K[0, 2], K[1, 1], K[1, 2], K[2, 2]
        d = 0.5 * DT * DT
        K[0, 0] = pp + 2.0 * DT * pv + 2.0 * d * pa + DT * DT * vv + 2.0 * DT * d * va + d * d * aa + q * DT**5 / 20.0
        K[0, 1] = pv + DT * pa + DT * vv + (DT * DT + d) * va + d * DT * aa + q * DT**4 / 8.0
        K[0, 2] = pa + DT * va + d * aa + q * DT**3 / 6.0
        K[1, 1] = vv + 2.0 * DT * va + DT * DT * aa + q * DT**3 / 3.0
        K[1, 2] = va + DT * aa + q * d
        K[2, 2] = aa + q * DT
        for i in range(m):
            C[0, i] += DT * C[1, i] + d * C[2, i]
            C[1, i] += DT * C[2, i]
        a = x[2]
        slope, expected, R = 1.0 + theta[0], theta[1] + (1.0 + theta[0]) * a, R_OUTPUT
        c[0], c[1] = a, 1.0
        if m == 4:
            slope += 2.0 * theta[2] * a + 3.0 * theta[3] * a * a
            expected += theta[2] * a * a + theta[3] * a * a * a
            c[2], c[3] = a * a, a * a * a
            # The Hessian is an arrow, e b' + b e': trace(H P)/2 = b'Pe and trace(HPHP)/2 = (b'Pe)² + (b'Pb) Paa.
            b0, b1, b2, b3 = theta[2] + 3.0 * theta[3] * a, 1.0, 2.0 * a, 3.0 * a * a
            Pe = b0 * K[2, 2] + b1 * C[2, 0] + b2 * C[2, 2] + b3 * C[2, 3]
            Pb = b0 * b0 * K[2, 2] + 2.0 * b0 * (b1 * C[2, 0] + b2 * C[2, 2] + b3 * C[2, 3])
            Pb += b1 * (b1 * M[0, 0] + 2.0 * b2 * M[0, 2] + 2.0 * b3 * M[0, 3])
            Pb += b2 * (b2 * M[2, 2] + 2.0 * b3 * M[2, 3]) + b3 * b3 * M[3, 3]
            expected += Pe
            R += Pe * Pe + Pb * K[2, 2]
        along[0], along[1], along[2] = slope * K[0, 2], slope * K[1, 2], slope * K[2, 2]
        S = R
        for i in range(m):
            s = slope * C[2, i]
            for r in range(m):
                s += M[i, r] * c[r]
            gain[i] = s
            S += c[i] * s
            along[0] += C[0, i] * c[i]
            along[1] += C[1, i] * c[i]
            along[2] += C[2, i] * c[i]
        correct(x, theta, K, C, M, along, gain, 1.0 / (S + slope * along[2]), u[j] - expected)
        if j % 2 == 0:
            i = 1.0 / (K[0, 0] + R_POSITION)
            along[0], along[1], along[2] = K[0, 0], K[0, 1], K[0, 2]
            for r in range(m):
                gain[r] = C[0, r]
            correct(x, theta, K, C, M, along, gain, i, z[j] - x[0])
            f = R_POSITION * i
            K[0, 0], K[0, 1], K[0, 2] = f * along[0], f * along[1], f * along[2]
            for r in range(m):
                C[0, r] = f * gain[r]
    states, variances = np.empty(3 + m), np.empty(3 + m)
    states[:3], states[3:] = x, theta
    variances[:3], variances[3:] = np.diag(K), np.diag(M)
    return states, variances


@compiled
def correct(x, theta, K, C, M, along, gain, i, e):  # type: ignore[no-untyped-def]
    """P - PH' (PH')' i, where PH' is `along` in the motion and `gain` in the parameters; upper half of K."""
    for r in range(3):
        t = along[r] * i
        x[r] += t * e
        for s in range(r, 3):
            K[r, s] -= t * along[s]
        for s in range(len(theta)):
            C[r, s] -= t * gain[s]
    for r in range(len(theta)):
        t = gain[r] * i
        theta[r] += t * e
        for s in range(len(theta)):
            M[r, s] -= t * gain[s]
