"""The live filters again in plain NumPy: slow, readable, and the twin that the compiled core must equal.

Written from the equations and not from the core. Wherever a second road exists it is taken: matrix exponentials instead
of closed forms, a finer quadrature, the Rauch-Tung-Striebel recursion instead of Bryson and Frazier's.
Imported by tests alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]
FAR = 5.0  # segment lengths beyond which a neighbour does not shape the cubic
LONG = 4.0  # neighbours this many times closer than the segment is long do not either
SLACK = 1e-6  # by which a squared correlation may exceed one through rounding


class StepFailed(Exception):
    """A step that the core must refuse too, under the same name and at the same event."""

    def __init__(self, kind: str, event: int = -1) -> None:
        super().__init__(kind)
        self.kind = kind
        self.event = event


@dataclass(frozen=True)
class Twin:
    """The five choices and the settings, in the words of `accelcal.filters`."""

    system: Literal["aci", "cwpa"]
    form: Literal["inverse", "forward"]
    interpolation: Literal["hold", "linear", "cubic"]
    integrator: Literal["rk2", "rk4", "exact"]
    order: int
    carrier: Literal["dense", "factored"]
    q: float
    r_position: float
    r_accel: float = 1.0
    q_output: float = 0.0
    tau: float = 0.0
    rates: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    drifts: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    gate: float = math.inf
    consider: tuple[int, ...] = ()

    @property
    def first(self) -> int:
        """Index of k in the state."""
        if self.system == "aci":
            return 2
        return 4 if self.tau > 0 else 3


@dataclass
class TwinRun:
    """One row per event."""

    t: list[float] = field(default_factory=list)
    x: list[Array] = field(default_factory=list)
    P: list[Array] = field(default_factory=list)
    predicted: list[tuple[Array, Array, Array]] = field(default_factory=list)
    e: list[float] = field(default_factory=list)
    s: list[float] = field(default_factory=list)
    accepted: list[bool] = field(default_factory=list)
    log_likelihood: float = 0.0


# --- the sensor -------------------------------------------------------------------------------------------------------


def polynomial(form: str, theta: Array) -> Array:
    """Coefficients s, K2, K3 of the form's cubic without its bias; (4) and (6)."""
    s = 1 + theta[0] if form == "forward" else 1 - theta[0]
    K2, K3 = theta[2:] if len(theta) == 4 else (0.0, 0.0)
    return np.array([s, K2, K3])


def turning_points(c: Array) -> list[float]:
    """Where s + 2 K2 r + 3 K3 r² is zero; the root that cancels is taken from the product of both."""
    s, K2, K3 = map(float, c)
    if not K3:
        return [-s / (2 * K2)] if K2 else []
    root = K2 * K2 - 3 * K3 * s
    if root < 0:
        return []
    larger = -K2 - math.copysign(math.sqrt(root), K2)
    return [larger / (3 * K3), s / larger]


def invert(c: Array, y: float) -> float:
    """The root r of s r + K2 r² + K3 r³ = y on the branch through zero."""
    s, K2, K3 = c
    if not s > 0:
        raise StepFailed("Domain")
    turns = turning_points(c)
    low = max([r for r in turns if r < 0], default=-math.inf)
    high = min([r for r in turns if r > 0], default=math.inf)
    end = high if y >= 0 else low
    if math.isfinite(end) and not abs(y) < abs(end * (s + end * (K2 + end * K3))):
        raise StepFailed("Domain")
    roots = np.roots(np.trim_zeros(np.array([K3, K2, s, -y]), "f"))
    inside = [r.real for r in roots if low <= r.real <= high and abs(r.imag) <= 1e-6 * (1 + abs(r))]
    r = float(min(inside, key=abs))
    for _ in range(4):  # the roots of `roots` are good to 1e-8 at worst; Newton polishes them
        r -= (r * (s + r * (K2 + r * K3)) - y) / (s + 2 * K2 * r + 3 * K3 * r * r)
    return r


def solve(form: str, theta: Array, y: float) -> tuple[float, Array, Array]:
    """r with G(r) = y, its gradient and Hessian in (y, k, K0, K2, K3); K0 does not enter."""
    s, K2, K3 = c = polynomial(form, theta)
    r = invert(c, y)
    J, C = s + 2 * K2 * r + 3 * K3 * r * r, 2 * K2 + 6 * K3 * r
    sign = 1 if form == "forward" else -1
    m = np.array([0, sign, 0, 2 * r, 3 * r * r])
    g = np.array([1, -sign * r, 0, -r * r, -(r**3)]) / J
    hessian = -(np.outer(m, g) + np.outer(g, m) + C * np.outer(g, g)) / J
    return r, g, hessian


def evaluate(form: str, theta: Array, r: float) -> tuple[float, Array, Array]:
    """G(r), its gradient and Hessian in (r, k, K0, K2, K3); K0 does not enter."""
    s, K2, K3 = polynomial(form, theta)
    sign = 1 if form == "forward" else -1
    gradient = np.array([s + 2 * K2 * r + 3 * K3 * r * r, sign * r, 0, r * r, r**3])
    hessian = np.zeros((5, 5))
    hessian[0] = hessian[:, 0] = [2 * K2 + 6 * K3 * r, sign, 0, 2 * r, 3 * r * r]
    return s * r + K2 * r * r + K3 * r**3, gradient, hessian


def acceleration(form: str, theta: Array, u: float) -> tuple[float, Array, Array]:
    """a = g(u, theta) with partials in (u, k, K0, K2, K3)."""
    value, gradient, hessian = (evaluate if form == "inverse" else solve)(form, theta, u - theta[1])
    shift = np.eye(5)
    shift[0, 2] = -1  # u - K0
    shift[2, 2] = 0
    return value, shift.T @ gradient, shift.T @ hessian @ shift


def output(form: str, theta: Array, a: float) -> tuple[float, Array, Array]:
    """The sensor's output at true acceleration a, with partials in (a, k, K0, K2, K3)."""
    value, gradient, hessian = (evaluate if form == "forward" else solve)(form, theta, a)
    gradient[2] = 1
    return value + theta[1], gradient, hessian


def embed(filter: Twin, n: int, gradient: Array, hessian: Array, input: int | None) -> tuple[Array, Array]:
    """Gradient and Hessian in the sensor's variables as gradient and Hessian in the state."""
    E = np.zeros((5, n))
    if input is not None:
        E[0, input] = 1
    for j in range(n - filter.first):
        E[1 + j, filter.first + j] = 1
    return E.T @ gradient, E.T @ hessian @ E


# --- the motion -------------------------------------------------------------------------------------------------------


def slope(filter: Twin, x: Array, P: Array, u: float) -> tuple[Array, Array, Array]:
    """f (with its second-order term), F and D Q D' at one instant."""
    n, first = len(x), filter.first
    f, F, Q = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    for j in range(first, n):
        f[j], F[j, j], Q[j, j] = -filter.rates[j - first] * x[j], -filter.rates[j - first], filter.drifts[j - first]
    f[0], F[0, 1] = x[1], 1
    if filter.system == "aci":
        value, gradient, hessian = acceleration(filter.form, x[first:], u)
        row, bend = embed(filter, n, gradient, hessian, None)
        F[1] += row
        f[1] = value + (0.5 * np.trace(bend @ P) if filter.order == 2 else 0)
        Q[1, 1] = gradient[0] ** 2 * filter.q
        return f, F, Q
    f[1], F[1, 2], Q[2, 2] = x[2], 1, filter.q
    if filter.tau > 0:
        value, gradient, hessian = output(filter.form, x[first:], x[2])
        row, bend = embed(filter, n, gradient, hessian, 2)
        if filter.order == 2:
            value += 0.5 * np.trace(bend @ P)
        f[3] = (value - x[3]) / filter.tau
        F[3] += row / filter.tau
        F[3, 3] = -1 / filter.tau
        Q[3, 3] = filter.q_output / filter.tau**2
    return f, F, Q


def van_loan(F: Array, Q: Array, h: float) -> tuple[Array, Array]:
    """Phi and Q_d of a constant F, Q over h; halved until exp(-F h) is harmless, then doubled."""
    n = len(F)
    halvings = max(0, math.ceil(math.log2(max(np.abs(F).max() * h, 1e-9))))
    d = h / 2**halvings
    block = expm(np.block([[-F, Q], [np.zeros((n, n)), F.T]]) * d)
    Phi = block[n:, n:].T
    Qd = Phi @ block[:n, n:]
    for _ in range(halvings):
        Qd = Qd + Phi @ Qd @ Phi.T
        Phi = Phi @ Phi
    return Phi, Qd


def frozen_step(filter: Twin, x: Array, P: Array, h: float) -> tuple[Array, Array, Array]:
    """CWPA over h with f and F frozen at its start: the exact solution of x' = f + F (x - x0).

    In units of each state in which the entries of F are rates: a matrix exponential is only as good as its scaling.
    """
    f, F, Q = slope(filter, x, P, 0.0)
    n = len(x)
    units = np.ones(n)
    units[:2] = h * h, h
    if filter.tau > 0:
        units[4:] = 1 / np.maximum(np.abs(F[3, 4:]) * filter.tau, 1e-6)
    Phi, Qd = van_loan(F * units / units[:, None], Q / np.outer(units, units), h)
    augmented = np.zeros((n + 1, n + 1))
    augmented[:n, :n], augmented[:n, n] = F * units / units[:, None], f / units
    moved = expm(augmented * h)[:n, n] * units
    return x + moved, Phi * units[:, None] / units, Qd * np.outer(units, units)


def quadrature_step(filter: Twin, x: Array, P: Array, u: Array, a: float, b: float) -> tuple[Array, Array, Array]:
    """ACI over [a, b] of the segment u: every integral by a 12-point rule."""
    n, h = len(x), b - a
    points, weights = np.polynomial.legendre.leggauss(12)
    rates, drifts = np.zeros(n), np.zeros(n)
    rates[2:], drifts[2:] = filter.rates[: n - 2], filter.drifts[: n - 2]

    def row(s: float) -> tuple[float, Array, float]:
        """Mean of v', its partials with respect to the start of the step, and g_u, s seconds into the step."""
        decay = np.exp(-rates * s)
        xs = x * decay
        Ps = P * np.outer(decay, decay) + np.diag(drifts * spread_factor(rates, s))
        value, gradient, hessian = acceleration(filter.form, xs[2:], horner(u, a + s))
        partials, bend = embed(filter, n, gradient, hessian, None)
        if filter.order == 2:
            value += 0.5 * np.trace(bend @ Ps)
        return value, partials * decay, gradient[0]

    new, Phi, Q = x * np.exp(-rates * h), np.diag(np.exp(-rates * h)), np.zeros((n, n))
    new[0] += h * x[1]
    Phi[0, 1] = h
    for point, weight in zip(points, weights, strict=True):
        s, w = h * (1 + point) / 2, h * weight / 2
        value, partials, d = row(s)
        new[:2] += w * value * np.array([h - s, 1])
        Phi[:2] += w * np.outer([h - s, 1], partials)
        push = np.zeros(n)
        push[:2] = h - s, 1
        Q += w * d * d * filter.q * np.outer(push, push)
    drifting = np.flatnonzero(drifts)
    for point, weight in zip(points if len(drifting) else (), weights, strict=False):
        s, w = h * (1 + point) / 2, h * weight / 2
        pushes = np.diag(np.exp(-rates * (h - s)))  # a row for each state that is pushed
        for point2, weight2 in zip(points, weights, strict=True):
            r, w2 = s + (h - s) * (1 + point2) / 2, (h - s) * weight2 / 2
            pushes[:, :2] += w2 * np.outer(row(r)[1] * np.exp(rates * s), [h - r, 1])
        Q += w * (pushes[drifting].T * drifts[drifting]) @ pushes[drifting]
    return new, Phi, Q


def spread_factor(rates: Array, s: float) -> Array:
    """(1 - exp(-2 rate s)) / (2 rate), s at rate zero."""
    return np.array([s if r == 0 else -math.expm1(-2 * r * s) / (2 * r) for r in rates])


def exact_step(filter: Twin, x: Array, P: Array, u: Array, a: float, b: float) -> tuple[Array, Array, Array]:
    """x, Phi and Q_d at the end of the step."""
    if filter.system == "aci":
        return quadrature_step(filter, x, P, u, a, b)
    return frozen_step(filter, x, P, b - a)


def runge_kutta(filter: Twin, x: Array, P: Array, u: Array, a: float, b: float) -> tuple[Array, Array, Array]:
    """x, P and Phi at the end of the step: (11)-(14), midpoint or classical fourth order."""
    n, h = len(x), b - a

    def rate(state: Array, s: float) -> Array:
        xs, Ps, Phis = state[:, 0], state[:, 1 : n + 1], state[:, n + 1 :]
        f, F, Q = slope(filter, xs, Ps, horner(u, s))
        return np.hstack([f[:, None], F @ Ps + Ps @ F.T + Q, F @ Phis])

    start = np.hstack([x[:, None], P, np.eye(n)])
    k1 = rate(start, a)
    k2 = rate(start + h / 2 * k1, a + h / 2)
    end = start + h * k2
    if filter.integrator == "rk4":
        k3 = rate(start + h / 2 * k2, a + h / 2)
        k4 = rate(start + h * k3, b)
        end = start + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return end[:, 0], end[:, 1 : n + 1], end[:, n + 1 :]


def predict(filter: Twin, x: Array, P: Array, u: Array, a: float, b: float) -> tuple[Array, Array, Array]:
    """x, P and Phi at the end of the step; refuses a P that is no covariance."""
    if filter.integrator == "exact":
        x, Phi, Q = exact_step(filter, x, P, u, a, b)
        P = Phi @ P @ Phi.T + Q
    elif filter.carrier == "factored":  # the Q_d of RK2 is indefinite, so factors take the exact one
        Q = exact_step(filter, x, P, u, a, b)[2]
        x, _, Phi = runge_kutta(filter, x, P, u, a, b)
        P = Phi @ P @ Phi.T + Q
    else:
        x, P, Phi = runge_kutta(filter, x, P, u, a, b)
    if filter.carrier == "dense":
        refuse_infinite(x)
        refuse_indefinite(P)
    return x, (P + P.T) / 2, Phi


def refuse_infinite(x: Array) -> None:
    """Raise unless every mean is a number."""
    if not np.all(np.isfinite(x)):
        raise StepFailed("Mean")


def refuse_indefinite(P: Array) -> None:
    """Raise unless every variance is non-negative and no two states correlate by more than one."""
    d = np.diag(P)
    for i in range(len(P)):
        if not (d[i] >= 0 and math.isfinite(d[i])):
            raise StepFailed("Variance")
        if np.any(P[i, :i] ** 2 > d[i] * d[:i] * (1 + SLACK)):
            raise StepFailed("Correlation")


# --- the readings -----------------------------------------------------------------------------------------------------


def expect(filter: Twin, x: Array, P: Array, position: bool) -> tuple[float, Array, float] | None:
    """Expected reading, H, and 1/2 tr(h_xx P h_xx P); None where the output drives the state."""
    n = len(x)
    H = np.zeros(n)
    if position:
        H[0] = 1
        if filter.system == "aci":
            H[1] = filter.tau
        return float(H @ x), H, 0.0
    if filter.system == "aci":
        return None
    if filter.tau > 0:
        H[3] = 1
        return float(x[3]), H, 0.0
    value, gradient, hessian = output(filter.form, x[filter.first :], x[2])
    H, bend = embed(filter, n, gradient, hessian, 2)
    if filter.order == 1:
        return value, H, 0.0
    BP = bend @ P
    return value + 0.5 * np.trace(BP), H, 0.5 * np.trace(BP @ BP)


def update(
    x: Array, P: Array, H: Array, R: float, e: float, s: float, consider: tuple[int, ...] = ()
) -> tuple[Array, Array]:
    """Joseph form; in blocks where states are considered, as Schmidt wrote it: their own block stays as it is."""
    if consider:
        i, c = np.setdiff1d(np.arange(len(x)), consider), np.array(consider)
        x, P, before = x.copy(), P.copy(), P
        gain = (before[np.ix_(i, i)] @ H[i] + before[np.ix_(i, c)] @ H[c]) / s
        x[i] += gain * e
        P[np.ix_(i, i)] -= s * np.outer(gain, gain)
        P[np.ix_(i, c)] -= np.outer(gain, before[np.ix_(c, i)] @ H[i] + before[np.ix_(c, c)] @ H[c])
        P[np.ix_(c, i)] = P[np.ix_(i, c)].T
        return x, P
    gain = P @ H / s
    IKH = np.eye(len(x)) - np.outer(gain, H)
    return x + gain * e, IKH @ P @ IKH.T + R * np.outer(gain, gain)


# --- the record -------------------------------------------------------------------------------------------------------


def horner(c: Array, s: float) -> float:
    """c0 + c1 s + c2 s² + c3 s³."""
    return float(c[0] + s * (c[1] + s * (c[2] + s * c[3])))


def segment(filter: Twin, t: Array, u: Array, sampled: int) -> tuple[Array, float]:
    """Coefficients of the output after `sampled` samples, and the instant they count from."""
    n = len(t)
    if sampled == 0 or sampled == n:
        i = min(sampled, n - 1)
        return np.array([u[i], 0, 0, 0]), float(t[i])
    i = sampled - 1
    if filter.interpolation == "hold":
        return np.array([u[i], 0, 0, 0]), float(t[i])
    first = min(max(i - 1, 0), n - 4)
    length, nodes = t[i + 1] - t[i], t[first : first + 4]
    near = n >= 4 and np.all(np.abs(nodes - t[i]) <= FAR * length) and np.all(length <= LONG * np.diff(nodes))
    if filter.interpolation == "cubic" and near:
        nodes = t[first : first + 4] - t[i]
        c = np.zeros(4)
        for k in range(4):  # Lagrange's basis, multiplied out
            others = np.delete(nodes, k)
            c += u[first + k] * np.poly(others)[::-1] / np.prod(nodes[k] - others)
        return c, float(t[i])
    return np.array([u[i], (u[i + 1] - u[i]) / (t[i + 1] - t[i]), 0, 0]), float(t[i])


def run(filter: Twin, x: Array, P: Array, t_u: Array, u: Array, t_z: Array, z: Array) -> TwinRun:
    """The filter over one record; at a tie the output comes first."""
    events = sorted([(t, 0, v) for t, v in zip(t_u, u, strict=True)] + [(t, 1, v) for t, v in zip(t_z, z, strict=True)])
    rows, sampled, now = TwinRun(), 0, events[0][0]
    for count, (t, kind, reading) in enumerate(events):
        try:
            Phi = np.eye(len(x))
            if t > now:
                c, start = segment(filter, t_u, u, sampled)
                x, P, Phi = predict(filter, x, P, c, now - start, t - start)
            rows.predicted.append((x, P, Phi))
            expected = expect(filter, x, P, kind == 1)
            e = s = math.nan
            accepted = False
            if expected is not None:
                h, H, spread = expected
                R = (filter.r_position if kind else filter.r_accel) + spread
                e, s = float(reading - h), float(H @ P @ H + R)
                if not (s > 0 and math.isfinite(s)):
                    raise StepFailed("InnovationVariance")
                if not math.isfinite(e):
                    raise StepFailed("Innovation")
                accepted = e * e / s <= filter.gate
                if accepted:
                    x, P = update(x, P, H, R, e, s, filter.consider)
                    if filter.carrier == "dense":
                        refuse_indefinite(P)
                    rows.log_likelihood -= 0.5 * (e * e / s + math.log(2 * math.pi * s))
        except StepFailed as failure:
            raise StepFailed(failure.kind, count) from None
        now, sampled = t, sampled + (kind == 0)
        for column, value in zip((rows.t, rows.x, rows.P, rows.e, rows.s), (t, x, P, e, s), strict=True):
            column.append(value)  # type: ignore[attr-defined]
        rows.accepted.append(accepted)
    return rows


def smooth(rows: TwinRun) -> tuple[Array, Array]:
    """Rauch-Tung-Striebel over the run: states (n, N) and variances (n, N); needs invertible predictions."""
    x, P = [rows.x[-1]], [rows.P[-1]]
    for k in range(len(rows.t) - 2, -1, -1):
        x_next, P_next, Phi = rows.predicted[k + 1]
        G = np.linalg.solve(P_next, Phi @ rows.P[k]).T
        x.append(rows.x[k] + G @ (x[-1] - x_next))
        P.append(rows.P[k] + G @ (P[-1] - P_next) @ G.T)
    return np.array(x[::-1]), np.array([np.diag(p) for p in P[::-1]])
