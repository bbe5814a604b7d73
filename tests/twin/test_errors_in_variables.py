"""The correction for errors in variables: the core against a twin in whole matrices, and what it is for."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from accelcal._support.errors import AccelcalError
from accelcal.data.recording import Channel
from accelcal.filters import FilterChoice, LiveFilter, fixed_rate, run

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
EVERY = 16
"""Readings between two corrections."""
PARAMETERS = {"linear": ("k", "K0"), "cubic": ("k", "K0", "K2", "K3")}


def partials(model: str, form: str, theta: np.ndarray, u: float) -> tuple[float, np.ndarray, float, np.ndarray]:
    """Acceleration, its gradient, da/du and the derivative of the gradient by u, by steps into the complex plane."""
    k, K0, K2, K3 = (*theta, 0.0, 0.0) if model == "linear" else theta

    def a_of(k: complex, K0: complex, K2: complex, K3: complex, u: complex) -> complex:
        if form == "inverse":
            w = u - K0
            return (1 - k) * w + K2 * w**2 + K3 * w**3
        a = (u - K0) / (1 + k)
        for _ in range(12):  # Newton's, in complex numbers, so that the step below may be tiny
            a = a - (K0 + (1 + k) * a + K2 * a**2 + K3 * a**3 - u) / ((1 + k) + 2 * K2 * a + 3 * K3 * a**2)
        return a

    at = [k, K0, K2, K3]

    def gradient(u: float) -> np.ndarray:
        steps = [a_of(*(x + 1e-30j * (i == j) for j, x in enumerate(at)), u).imag / 1e-30 for i in range(len(theta))]
        return np.array(steps)

    slope = a_of(*at, u + 1e-30j).imag / 1e-30
    mixed = (gradient(u + 1e-4) - gradient(u - 1e-4)) / 2e-4
    return a_of(*at, u).real, gradient(u), slope, mixed


def lagrange(x: float, nodes: np.ndarray) -> np.ndarray:
    """Weights of the samples at `nodes` in the polynomial at `x`."""
    return np.array([np.prod([(x - b) / (a - b) for b in nodes if b != a]) for a in nodes])


def twin(
    choice: FilterChoice, causal: bool, dt: float, u: np.ndarray, z: np.ndarray, start: Any, corrected: bool = True
) -> Any:
    """States and covariance after the record: Joseph's form, and the noise of the last samples as further states."""
    x, P, q, r, tau = np.array(start["x0"], float), np.array(start["P0"]), start["q"], start["r_position"], start["tau"]
    m = len(x) - 2
    window = {"hold": [0.0], "linear": [0.0, 1.0], "cubic": [-2.0, -1.0, 0.0, 1.0] if causal else [-1.0, 0.0, 1.0, 2.0]}
    nodes = np.array(window[choice.interpolation])
    noise = np.zeros((2 + len(nodes), 2 + len(nodes)))  # of what it left in p, v; of the samples of the window
    noise[2:, 2:] = q / dt * np.eye(len(nodes))
    H = np.zeros(m + 2)
    H[:2] = 1.0, tau
    gathered, share, readings = np.zeros(m), 0.0, 0
    for j in range(len(u)):
        if j > 0:
            picked = nodes.astype(int) + j - 1
            inside = picked + max(0, -picked[0]) - max(0, picked[-1] - len(u) + 1)
            picked = picked[-2:] if causal and j < 3 else inside  # a line while there are fewer than four
            here = picked - (j - 1.0)
            Phi, Q, moved = np.eye(m + 2), np.zeros((m + 2, m + 2)), np.zeros(m + 2)
            Phi[0, 1] = dt
            for node, weight in zip(NODES, WEIGHTS, strict=True):
                s = 0.5 * (1.0 + node)
                lever = np.array([(1.0 - s) * dt, 1.0]) * 0.5 * weight * dt
                a, g, slope, _ = partials(choice.model, choice.form, x[2:], float(lagrange(s, here) @ u[picked]))
                moved[:2] += lever * a
                Phi[:2, 2:] += np.outer(lever, g)
                values = np.array([(1.0 - s) * dt, 1.0])
                Q[:2, :2] += 0.5 * weight * dt * q * slope**2 * np.outer(values, values)
            ends = [float(lagrange(s, here) @ u[picked]) for s in (0.0, 1.0)]
            both = [partials(choice.model, choice.form, x[2:], end)[2:] for end in ends]
            driven = np.mean([slope * mixed for slope, mixed in both], axis=0)
            square = np.mean([slope**2 for slope, _ in both])
            x = np.concatenate([[x[0] + dt * x[1], x[1]], x[2:]]) + moved
            P = Phi @ P @ Phi.T + Q
            T = np.eye(len(noise))
            T[0, 1] = dt
            for node, weight in zip(NODES, WEIGHTS, strict=True):
                s = 0.5 * (1.0 + node)
                T[:2, 2:] += np.outer(np.array([(1.0 - s) * dt, 1.0]) * 0.5 * weight * dt, lagrange(s, nodes))
            noise = T @ noise @ T.T
            shifted = np.eye(len(noise))  # the oldest sample leaves, a new one comes
            shifted[2:, 2:] = np.eye(len(nodes), k=1)
            noise = shifted @ noise @ shifted.T
            noise[-1, -1] = q / dt
        if np.isnan(z[j]):
            continue
        S = H @ P @ H + r
        K = P @ H / S
        h = H[:2]
        motion = P[:2, :2] - P[:2, 2:] @ np.linalg.solve(P[2:, 2:], P[2:, :2])  # with the parameters known
        variance = h @ motion @ h + r
        left = h @ noise[:2, :2] @ h / variance
        x = x + K * (z[j] - H @ x)
        A = np.eye(m + 2) - np.outer(K, H)
        P = A @ P @ A.T + r * np.outer(K, K)
        B = np.eye(len(noise))
        B[:2, :2] -= np.outer(motion @ h / variance, h)
        noise = B @ noise @ B.T
        if j > 0:
            gathered, share = gathered + left * driven, share + left * square
        readings += 1
        if readings % EVERY == 0:
            if corrected and share > 0.0:
                y = P[:, 2:] @ gathered
                x, P = x + y, P + np.outer(y, y) / share
            gathered, share = np.zeros(m), 0.0
    return x, P


def case(model: str, seed: int, every: int, tau: float) -> tuple[float, np.ndarray, np.ndarray, dict[str, Any]]:
    rng, dt, n = np.random.default_rng(seed), 1e-3, 100
    t = np.arange(n) * dt
    a = 3.0 * np.sin(20.0 * t + rng.uniform(0, 6)) + 2.0 * np.sin(47.0 * t)
    u = 0.1 + 1.02 * a + 0.3 * rng.standard_normal(n)
    z = 1e-6 * rng.standard_normal(n).cumsum()
    z[np.arange(n) % every != 0] = np.nan
    sizes = [1e-4, 1.0, 0.05, 0.2, 0.02, 0.005][: 2 + len(PARAMETERS[model])]
    start = {"x0": np.zeros(len(sizes)), "P0": np.diag(np.square(sizes)), "q": 4e-5, "r_position": 1e-13, "tau": tau}
    return dt, u, z, start


@settings(max_examples=6)
@given(
    st.sampled_from(["linear", "cubic"]),
    st.sampled_from(["inverse", "forward"]),
    st.sampled_from(["hold", "linear", "cubic"]),
    st.sampled_from([(1, 0.0), (1, 2e-3), (3, 0.0), (2, 1e-3)]),
    st.integers(0, 10**6),
)
def test_core_and_twin_agree(model: Any, form: Any, interpolation: Any, how: tuple[int, float], seed: int) -> None:
    """As a stream with its own stamps, and at a fixed rate: on a cubic of the past alone."""
    dt, u, z, start = case(model, seed, *how)
    choice = FilterChoice("aci", model, form, interpolation, carrier="factored", corrected=True)
    there = ~np.isnan(z)
    t = np.arange(len(u)) * dt
    stream = run(choice, Channel("accel", t, u, "m/s²"), Channel("position", t[there], z[there], "m"), **start)
    steps = fixed_rate(choice, dt=dt, **start)
    steps.run(u, z)
    plain, _ = twin(choice, False, dt, u, z, start, corrected=False)
    for causal, x, P in ((False, stream.states[-1], stream.covariance), (True, steps.x, steps.covariance)):
        expected, spread = twin(choice, causal, dt, u, z, start)
        sigma = np.sqrt(np.diag(spread))
        # Differences of the gradient in the twin: 1e-8 of a correction of some sigma; variances that fall by 1e8.
        assert np.max(np.abs(x - expected) / sigma) < 1e-5, (causal, (x - expected) / sigma)
        assert np.max(np.abs(P - spread) / np.outer(sigma, sigma)) < 1e-5
        assert np.max(np.abs(x - plain) / sigma) > 1e-3  # the twin without the correction


def test_a_noisy_output_leaves_the_scale_factor_alone() -> None:
    """20 records, two engines, |mean z| < 3.5/sqrt(20): 1e-3 of false alarms; without the correction it is 30 sigma."""
    w, size = np.array([2.0, 5.0, 9.0]), np.array([1.5, 1.0, 0.7])
    rate, noise, n = 1000.0, 2e-2, 20_000
    t = np.arange(n) / rate
    z: dict[str, list[float]] = {"stream": [], "fixed rate": [], "without": [], "lost rows": []}
    for seed in range(20):
        rng = np.random.default_rng((41, seed))
        s = np.sin(w[:, None] * t + rng.uniform(0, 6, (3, 1)))
        u = 0.05 + 1.01 * (size @ s) + rng.standard_normal(n) * noise * np.sqrt(rate / 2.0)
        p = -(size / w**2) @ s + 3e-8 * rng.standard_normal(n)
        P0 = np.diag([1e-15, 100.0, 1e-2, 4.0])
        start = {"q": noise**2 / 2.0, "r_position": 9e-16, "x0": [p[0], 0.0, 0.0, 0.0], "P0": P0}
        kinds = np.tile([True, False], n)
        events = np.repeat(t, 2), kinds, np.column_stack([u, p]).ravel()
        there = (rng.random(2 * n) > 0.2) | (np.arange(2 * n) < 8)
        for name, corrected in (("stream", True), ("without", False), ("lost rows", True)):
            choice = FilterChoice("aci", interpolation="cubic", carrier="factored", corrected=corrected)
            live = LiveFilter(choice, **start)
            live.feed(*(column[there] if name == "lost rows" else column for column in events))
            z[name].append((live.estimate[2] - 0.01) / np.sqrt(live.covariance[2, 2]))
        choice = FilterChoice("aci", interpolation="cubic", carrier="factored", corrected=True)
        steps = fixed_rate(choice, dt=1.0 / rate, **start)
        steps.run(u, p)
        z["fixed rate"].append((steps.x[2] - 0.01) / np.sqrt(steps.covariance[2, 2]))
    print({name: (round(float(np.mean(of)), 2), round(float(np.std(of)), 2)) for name, of in z.items()})
    assert abs(np.mean(z["stream"])) < 3.5 / np.sqrt(20)
    assert abs(np.mean(z["fixed rate"])) < 3.5 / np.sqrt(20)
    assert abs(np.mean(z["lost rows"])) < 0.1 * np.mean(z["without"])  # a fifth of outputs and readings
    assert np.mean(z["without"]) > 20.0


def test_blocks_of_events_are_the_events() -> None:
    dt, u, z, start = case("linear", 5, 3, 0.0)
    choice = FilterChoice("aci", interpolation="cubic", carrier="factored", corrected=True)
    single, many = LiveFilter(choice, **start), LiveFilter(choice, **start)
    events = [(i * dt, True, x) for i, x in enumerate(u)] + [(i * dt, False, x) for i, x in enumerate(z) if x == x]
    events.sort(key=lambda event: (event[0], not event[1]))
    events.insert(40, (0.0, False, 1.0))  # out of order: refused, and nothing is changed
    innovations = []
    for t, output, value in events[:40] + events[41:]:
        single.step(t, **{"accel" if output else "position": value})
    refused = 0
    for a, b in pairwise([0, 1, 17, 39, 100, len(events)]):
        t, kinds, values = (np.array(column) for column in zip(*events[a:b], strict=True))
        readings = many.feed(t, kinds, values)
        refused += readings.refused
        innovations += readings.t.tolist()
    assert refused == 1
    innovations += many.finish().t.tolist()
    single.finish()
    assert np.array_equal(single.estimate, many.estimate)
    assert np.array_equal(single.covariance, many.covariance)
    assert innovations == [t for t, output, _ in events[:40] + events[41:] if not output]


@pytest.mark.parametrize("choice", [{"system": "cwpa"}, {"integrator": "rk4"}, {"carrier": "dense"}])
def test_published_filters_stay_as_published(choice: dict[str, Any]) -> None:
    with pytest.raises(AccelcalError, match='integrator="exact" and carrier="factored"'):
        FilterChoice(**{"carrier": "factored"} | choice, corrected=True)


def whole_scores(u: np.ndarray, dt: float, q: float, r: float, every: int, first: int) -> Any:
    """Cholesky factor of all innovations behind reading `first` at once, the readings' share of each score, and what a
    unit of k and of K0 adds to each innovation.

    Innovations are linear in the errors of p, v at that reading and in the noise of samples and readings: columns of
    one matrix, from a filter of known parameters. The curve has another shape in the first segment.
    """
    n, begin, readings = len(u), first * every, (len(u) - 1) // every - first
    F, Q = np.array([[1.0, dt], [0.0, 1.0]]), q * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    x, weight = 0.5 * (NODES + 1.0), 0.5 * WEIGHTS

    def gains(nodes: list[float]) -> np.ndarray:
        curve = np.array([lagrange(share, np.array(nodes)) for share in x])
        return np.stack([dt**2 * (weight * (1.0 - x)) @ curve, dt * weight @ curve])

    usual, at_start = gains([-1.0, 0.0, 1.0, 2.0]), gains([0.0, 1.0, 2.0, 3.0])
    error, unit = np.zeros((2, 2 + n + readings)), np.zeros((2, 2))
    P, rows, units = np.diag([r, 1.0]), [], []
    gradient = -np.stack([u, np.ones(n)], axis=1)  # of a = (u - K0)/(1 + k) at k = K0 = 0
    for i in range(n - 1):
        if i:
            error, P, j = F @ error, F @ P @ F.T + Q, max(i - 2, 0)
            G = usual if i > 1 else at_start
            unit = F @ unit + G @ gradient[j : j + 4]
            if i > begin:
                error[:, 2 + j : 6 + j] += G
        if i % every:
            continue
        K = P[0] / (P[0, 0] + r)
        P = P - np.outer(K, P[0])
        if i == begin:
            covariance, error[:, :2] = P.copy(), np.eye(2)
        elif i > begin:
            row = error[0].copy()
            row[2 + n + len(rows)] += 1.0
            rows.append(row)
            units.append(unit[0].copy())
            error = error - np.outer(K, row)
        unit = unit - np.outer(K, unit[0])
    M = np.stack(rows)
    prior = np.diag([0.0, 0.0, *[q / dt] * n, *[r] * readings])
    prior[:2, :2] = covariance
    L = np.linalg.cholesky(M @ prior @ M.T)
    of_readings = np.sum(np.linalg.solve(L, M[:, 2 + n :]) ** 2 * r, axis=1)
    return L, of_readings, np.stack(units)


@pytest.mark.parametrize(("rate", "noise", "r", "every"), [(50, 2e-3, 8e-14, 1), (1000, 2e-2, 8e-16, 3)])
def test_white_scores_are_those_of_all_innovations_at_once(rate: float, noise: float, r: float, every: int) -> None:
    dt, n, rng, first = 1.0 / rate, 180, np.random.default_rng(8), 15
    t = dt * np.arange(n)
    u = 1.5 * np.sin(2.0 * t) + rng.standard_normal(n) * noise * np.sqrt(rate / 2.0)
    z = -1.5 / 4.0 * np.sin(2.0 * t) + np.sqrt(r) * rng.standard_normal(n)
    choice = FilterChoice("aci", interpolation="cubic", carrier="factored", corrected=True, scores=True)
    q, P0 = noise**2 / 2.0, np.diag([r, 1.0, 1e-28, 1e-28])
    live = LiveFilter(choice, q=q, r_position=r, x0=[0.0, -0.75, 0.0, 0.0], P0=P0)
    there = np.ones(2 * n, dtype=bool)
    there[1::2] = np.arange(n) % every == 0
    events = np.repeat(t, 2), np.tile([True, False], n), np.column_stack([u, z]).ravel()
    rows = live.feed(*(column[there] for column in events)).table[first + 1 :]
    L, of_readings, units = (part[: len(rows)] for part in whole_scores(u, dt, q, r, every, first))
    L = L[:, : len(rows)]
    white, slopes = np.linalg.solve(L, rows[:, 2]), np.linalg.solve(L, -units)
    deviation = np.sqrt(rows[:, 5])
    assert deviation == pytest.approx(np.diag(L), rel=1e-7)
    assert rows[:, 4] / deviation == pytest.approx(white, rel=1e-6, abs=1e-6)
    assert rows[:, 6] == pytest.approx(of_readings, rel=1e-6)
    share = np.outer(1.0 - of_readings, [1.0, 0.0])  # a by k and u has the slope -1, by K0 and u none
    assert rows[:, 7:9] == pytest.approx(-slopes * white[:, None] - share, rel=1e-4, abs=1e-4)
    assert rows[:, 9:11] == pytest.approx(slopes**2 + share, rel=1e-4, abs=1e-4)
    assert rows[:, 11] == pytest.approx(slopes[:, 0] * slopes[:, 1], rel=1e-4, abs=1e-4)
    # The twin: raw innovations are not white where the noise of the output dominates.
    assert np.max(np.abs(rows[:, 2] / np.sqrt(rows[:, 3]) - white)) > 0.01
