"""Ordinary setups of live and batch filters, drawn at random: is every negative variance and every NaN an error?

A draw is a setup with a record: a motion of one tone, an output with noise, a position read at every sample or every
tenth. Rates, noise, priors and motions are spread over what stages and sensors have; nothing is drawn to break a
filter.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from accelcal import filters
from accelcal._core import FilterError
from accelcal.data.arrays import Array
from accelcal.data.recording import Channel
from accelcal.data.rig import Rig
from accelcal.filters.choice import PARAMETERS, FilterChoice, GaussMarkov
from accelcal.filters.live_model import LiveModel
from accelcal.filters.stream import LiveFilter
from accelcal.model import Model

SAMPLES = 48
"""Of a record; of a record for `LiveModel` a third."""
RUNS = 200
"""Records that `run_batch` runs side by side: they share rate, noise and choice, nothing else."""
LIVE_MODELS: tuple[tuple[str, ...], ...] = (
    (),
    ("quadratic",),
    ("quadratic", "cubic"),
    ("velocity", "rail_slope"),
    ("quadratic", "cubic", "velocity", "rail_slope"),
)


@dataclass
class Tally:
    """What became of the draws of one kind."""

    draws: int = 0
    refused: int = 0
    """Ended in an error of one sentence."""
    lost: int = 0
    """With a negative variance or a NaN that is no error."""
    kinds: Counter[str] = field(default_factory=Counter)
    """Errors by choice."""

    def add(self, other: Tally) -> None:
        self.draws += other.draws
        self.refused += other.refused
        self.lost += other.lost
        self.kinds += other.kinds


@dataclass(frozen=True)
class Setup:
    """A filter and its settings; the records that go with it."""

    choice: FilterChoice
    dt: float
    given: dict[str, Any]
    """Settings of `fixed_rate`, without prior."""
    x0: Array
    """(r, N)"""
    P0: Array
    """(r, N, N)"""
    u: Array
    """(r, n) m/s²"""
    z: Array
    """(r, n) m; NaN where position was not read."""
    speed: float
    """Largest of all records, m/s."""


def log_uniform(rng: np.random.Generator, low: float, high: float, size: Any = None) -> Any:
    """Powers of ten, exponents uniform from `low` to `high`."""
    return 10.0 ** rng.uniform(low, high, size)


def draw(rng: np.random.Generator, *, runs: int = 1, low_pass: bool = True, **fixed: Any) -> Setup:
    """One setup with `runs` records, some behind a low-pass; `fixed` are fields of `FilterChoice`."""

    def pick(name: str, *values: Any) -> Any:
        return fixed[name] if name in fixed else values[rng.integers(len(values))]

    choice = FilterChoice(
        pick("system", "aci", "cwpa"),
        pick("model", "linear", "cubic"),
        pick("form", "forward", "inverse"),
        pick("interpolation", "linear", "hold", "cubic"),
        pick("integrator", "exact", "rk4", "rk2"),
        pick("order", 1, 2),
        pick("carrier", "dense"),
    )
    aci = choice.system == "aci"
    dt = 1.0 / log_uniform(rng, 1, 4)
    r_position = log_uniform(rng, -16, -8)
    noise = log_uniform(rng, -6, -2)
    names = choice.states()
    n = len(names)
    given: dict[str, Any] = {
        "q": noise**2 / 2 if aci else log_uniform(rng, -2, 4),
        "r_position": r_position,
        "r_accel": None if aci else max(noise**2 / dt, 1e-12),
        "tau": dt * rng.uniform(0.1, 2.0) if aci and low_pass and rng.random() < 0.2 else 0.0,
    }
    if rng.random() < 0.2:
        given["parameters"] = {
            name: GaussMarkov(log_uniform(rng, -12, -4) * UNITS.get(name, 1.0) ** 2, (np.inf, 10.0)[rng.integers(2)])
            for name in PARAMETERS[choice.model]
            if rng.random() < 0.5
        }
    sigma = np.sqrt(log_uniform(rng, -8, 0, (runs, n))) * [UNITS.get(name, 1.0) for name in names]
    t = dt * np.arange(SAMPLES)
    a = log_uniform(rng, -1, 1.3, (runs, 1))
    w = 2 * np.pi * np.maximum(log_uniform(rng, -3, -1, (runs, 1)) / dt, np.sqrt(a) / (2 * np.pi))  # within a metre
    phase = rng.uniform(0, 2 * np.pi, (runs, 1))
    acceleration, position = a * np.sin(w * t + phase), -a / w**2 * np.sin(w * t + phase)
    z = position + np.sqrt(r_position) * rng.standard_normal((runs, SAMPLES))
    z[:, np.arange(SAMPLES) % int(rng.choice([1, 2, 3, 5, 10])) != 0] = np.nan
    truth = {"p": position[:, 0], "v": (-a / w * np.cos(w * t + phase))[:, 0], "a": acceleration[:, 0]}
    mean = np.stack([truth.get(name, np.zeros(runs)) for name in names], axis=1)
    u = 0.05 + 1.01 * acceleration + noise / np.sqrt(dt) * rng.standard_normal((runs, SAMPLES))
    P0 = np.eye(n) * (sigma**2)[:, None, :]
    return Setup(choice, dt, given, mean + 0.5 * sigma * rng.standard_normal((runs, n)), P0, u, z, float(np.max(a / w)))


UNITS = {"a": 10.0, "K2": 1e-2, "K3": 1e-4}
"""Standard deviations of a prior as multiples of 1e-4 to 1 in SI, where that is no ordinary size."""


def sound(x: Array, variances: Array) -> bool:
    """States are numbers and variances numbers that are not negative."""
    return bool(np.all(np.isfinite(x)) and np.all(variances >= 0.0) and np.all(np.isfinite(variances)))


def outcome(name: str, work: Callable[[], bool]) -> Tally:
    """One draw: was it sound, lost, or refused?"""
    try:
        return Tally(1, 0, 0 if work() else 1)
    except FilterError as error:
        return Tally(1, 1, 0, Counter([f"{name}: {error.kind}"]))


def named(setup: Setup) -> str:
    """The choice that decides whether a covariance holds."""
    return f"{setup.choice.system} {setup.choice.integrator} {setup.choice.carrier}"


def batch(rng: np.random.Generator) -> Tally:
    """`run_batch`, `RUNS` records."""
    setup = draw(rng, runs=RUNS)
    done = filters.run_batch(setup.choice, setup.u, setup.z, dt=setup.dt, x0=setup.x0, P0=setup.P0, **setup.given)
    faults = [fault is not None for fault in done.faults]
    whole = [
        sound(x, np.diag(P)) and bool(np.all(np.isfinite(P))) and bool(np.isfinite(likelihood))
        for x, P, likelihood in zip(done.states, done.covariances, done.log_likelihoods, strict=True)
    ]
    lost = sum(not (fault or good) for fault, good in zip(faults, whole, strict=True))
    name = f"{setup.choice.system} {setup.choice.integrator} batch"
    return Tally(RUNS, sum(faults), lost, Counter({name: sum(faults)} if any(faults) else {}))


def fixed_rate(rng: np.random.Generator) -> Tally:
    """`fixed_rate`, every variance of the history looked at; after an error the filter must be what it was."""
    factored = rng.random() < 0.3
    fixed = {"system": "aci", "integrator": "exact", "carrier": "factored"} if factored else {}
    return stepped(draw(rng, **fixed))


def stepped(setup: Setup) -> Tally:
    """`fixed_rate` on a setup."""
    live = filters.fixed_rate(setup.choice, dt=setup.dt, x0=setup.x0[0], P0=setup.P0[0], **setup.given)
    n = setup.x0.shape[1]
    states, variances = np.zeros((SAMPLES, n)), np.zeros((SAMPLES, n))
    result = outcome(named(setup), lambda: live.run(setup.u[0], setup.z[0], states=states, variances=variances) is None)
    done = live.samples
    if not sound(states[:done], variances[:done]) or (done > 0 and live.x.tobytes() != states[done - 1].tobytes()):
        result.lost = 1
    return result


def with_effects(rng: np.random.Generator) -> Tally:
    """`fixed_rate_with_effects` under random columns."""
    setup = draw(rng, system="aci", model="linear", form="forward", interpolation="cubic", integrator="exact")
    m = int(rng.integers(1, 6))
    sigma = np.sqrt(log_uniform(rng, -8, 0, m))
    P0 = np.diag([*np.diag(setup.P0[0]), *sigma**2])
    given = {key: setup.given[key] for key in ("q", "r_position", "tau")}
    live = filters.fixed_rate_with_effects(dt=setup.dt, x0=[*setup.x0[0], *np.zeros(m)], P0=P0, **given)
    columns = rng.standard_normal((SAMPLES, 3, m))
    read = 1e-6 * rng.standard_normal((SAMPLES, m))
    x, variances = np.zeros(4 + m), np.zeros(4 + m)

    def work() -> bool:
        good = True
        for u, z, e, b in zip(setup.u[0].tolist(), setup.z[0].tolist(), columns, read, strict=True):
            live.step_with_effects(u, None if np.isnan(z) else z, e, b)
            live.read(x, variances)
            good = good and sound(x, variances)
        return good

    return outcome(named(setup), work)


def recorded(setup: Setup, *, smooth: bool) -> Tally:
    """`filters.run` over a record with time stamps."""
    t = setup.dt * np.arange(SAMPLES)
    read = ~np.isnan(setup.z[0])
    accel, position = Channel("accel", t, setup.u[0], "m/s²"), Channel("position", t[read], setup.z[0, read], "m")

    def work() -> bool:
        run = filters.run(setup.choice, accel, position, x0=setup.x0[0], P0=setup.P0[0], smooth=smooth, **setup.given)
        if smooth:
            assert run.smoothed_states is not None
            assert run.smoothed_variances is not None
            return sound(run.states, run.variances) and sound(run.smoothed_states, run.smoothed_variances)
        return sound(run.states, run.variances)

    return outcome(named(setup), work)


def record(rng: np.random.Generator) -> Tally:
    """`filters.run`."""
    return recorded(draw(rng, carrier=("dense", "factored")[rng.integers(2)]), smooth=False)


def smoothed(rng: np.random.Generator) -> Tally:
    """`filters.run` with smoothing."""
    return recorded(draw(rng, carrier=("dense", "factored")[rng.integers(2)]), smooth=True)


def stream(rng: np.random.Generator) -> Tally:
    """`LiveFilter`, covariance looked at after every sample."""
    setup = draw(rng, carrier=("dense", "factored")[rng.integers(2)])
    live = LiveFilter(setup.choice, x0=setup.x0[0], P0=setup.P0[0], **setup.given)

    def work() -> bool:
        good = True
        for j, (u, z) in enumerate(zip(setup.u[0].tolist(), setup.z[0].tolist(), strict=True)):
            live.step(j * setup.dt, accel=u, position=None if np.isnan(z) else z)
            good = good and sound(live.estimate, np.diag(live.covariance))
        return good

    result = outcome(named(setup), work)
    if not sound(live.estimate, np.diag(live.covariance)):
        result.lost = 1
    return result


def live_model(rng: np.random.Generator) -> Tally:
    """`LiveModel` at 10 Hz to 10 kHz, variances of all coefficients looked at after every sample."""
    setup = draw(rng, system="aci", model="linear", form="forward", integrator="exact")
    model = Model.linear().add(*LIVE_MODELS[rng.integers(len(LIVE_MODELS))])
    z = setup.z[0, : SAMPLES // 3].tolist()

    def work() -> bool:
        good = True
        live = LiveModel(
            model,
            Rig(),
            rate=1.0 / setup.dt,
            q=setup.given["q"],
            r_position=setup.given["r_position"],
            position=z[0],
            speed=2.0 * setup.speed,
            order=setup.choice.order,
        )
        for u, read in zip(setup.u[0].tolist(), z, strict=False):
            live.step(u, None if np.isnan(read) else read)
            good = good and sound(live.values, np.diag(live.covariance))
        return good

    return outcome("LiveModel", work)


KINDS: dict[str, tuple[Callable[[np.random.Generator], Tally], float]] = {
    "run_batch": (batch, 0.80),
    "fixed_rate": (fixed_rate, 0.14),
    "run": (record, 0.02),
    "run, smoothed": (smoothed, 0.02),
    "LiveFilter": (stream, 0.01),
    "with effects": (with_effects, 0.01),
}
"""Every way to run a live or batch filter, and its share of the draws."""


def tally(work: Callable[[np.random.Generator], Tally], draws: int, seed: int) -> Tally:
    """At least `draws` draws of one kind."""
    rng = np.random.default_rng(seed)
    total = Tally()
    while total.draws < draws:
        total.add(work(rng))
    return total


def rk2_unguarded(setup: Setup) -> bool:
    """Whether RK2 of the covariance (11)-(12), written down without any check, keeps variances of a setup positive.

    ACI, forward linear sensor, output held; the twin that must fail.
    """
    h, q, R = setup.dt, setup.given["q"], setup.given["r_position"]
    x, P = setup.x0[0].copy(), setup.P0[0].copy()
    for j in range(SAMPLES):
        if j > 0:
            scale = 1.0 + x[2]
            a = (setup.u[0, j - 1] - x[3]) / scale
            F = np.zeros((4, 4))
            F[0, 1], F[1, 2:] = 1.0, [-a / scale, -1.0 / scale]
            D = np.zeros((4, 4))
            D[1, 1] = q / scale**2
            half = P + h / 2 * (F @ P + P @ F.T + D)
            P = P + h * (F @ half + half @ F.T + D)
            x[:2] += h * np.array([x[1] + h / 2 * a, a])
        z = setup.z[0, j]
        if not np.isnan(z):
            gain = P[:, 0] / (P[0, 0] + R)
            x, P = x + gain * (z - x[0]), P - np.outer(gain, P[0])
        if not np.all(np.diag(P) >= 0.0):
            return False
    return True
