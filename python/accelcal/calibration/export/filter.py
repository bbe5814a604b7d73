"""The live filter of a model as C99 or Rust for a device: the effects traced, the factored filter beside them.

The effects, and the signals that they are evaluated on, are those of `LiveModel`, called once on symbols. The filter is
`AciFactored` of `ekf-core` (`structured/aci_ud.rs`): the step without integration error, Thornton's prediction,
Bierman's reading, and the rank-one updates of Agee and Turner for random processes; here its products are unrolled for
the number of parameters, and those with a known zero are left out.
"""

from __future__ import annotations

import copy
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from accelcal._core import __version__
from accelcal.calibration.export import watch as watching
from accelcal.calibration.export.calibration import (
    WIDTH,
    NotExportable,
    identifier,
    plain,
    require_covariance,
    require_finite,
    strict,
    unit as ascii_unit,
)
from accelcal.calibration.export.symbols import (
    FORMATS,
    Format,
    Graph,
    NotTraceable,
    Symbol,
    body,
    exponential,
    less,
    narrow,
    over,
    select,
    symbols,
)
from accelcal.data import Array, Rig
from accelcal.effects import of_one_record
from accelcal.effects.building_blocks import lagged
from accelcal.effects.own import probe
from accelcal.effects.registry import Effect
from accelcal.estimation.engines import live_start
from accelcal.estimation.estimate import Fit
from accelcal.filters.choice import rate_and_density
from accelcal.filters.live_model import MOST_SHARE, MOTION, LiveModel, newton, noise_in_band
from accelcal.model import Model, Prior, evaluate
from accelcal.signals.signals import Signals

Language = Literal["c", "rust"]
Precision = Literal["f32", "f64"]


def live_filter(
    fit: Fit, rate: float, *, position: float = 0.0, watch: Sequence[str] = (), gate: float | None = None
) -> LiveModel:
    """The live filter that starts from what a fit knows.

    Parameters
    ----------
    fit : its estimates with their covariance are the prior, its noise that of the filter. What belongs to the fitted
        record starts from zero, and the error of the low-pass goes into its time constant.
    rate : samples of the output per second, Hz.
    position : position of the stage at the first sample, m.
    watch : effects that the model lacks, for each of which the filter says how much speaks for it.
    gate : leave out readings whose squared innovation over its variance is above this; None for no gate.

    Raises
    ------
    ValueError
        For an effect that cannot be tracked or watched live, by name.
    """
    require_finite({f"the estimate of {e.name}": e for e in fit.estimates} | {"the covariance": fit.covariance})
    require_covariance(fit.covariance)
    fit = fit.given_choice
    start = live_start(fit, fit.rig)
    model = with_held_as_states(start.model)
    return LiveModel(
        model,
        start.rig,
        rate=rate,
        q=start.q,
        r_position=start.r_position,
        position=position,
        origins=replace(fit.origins, t=0.0),
        covariance=start.spread(fit, model),
        watch=watch,
        gate=gate,
    )


def with_held_as_states(model: Model) -> Model:
    """The model whose held coefficients are states without variance, which a program holds as numbers."""
    held = {t.name: Prior(model.fixed[t.name], 0.0) for t in model.terms if model.fixed.get(t.name, 0.0) != 0.0}
    fixed = {name: value for name, value in model.fixed.items() if name not in held}
    return replace(model, priors={**model.priors, **held}, fixed=fixed)


AT, WEIGHTS = np.polynomial.legendre.leggauss(5)
"""The quadrature over a step, as in `ekf-core/src/integration.rs`."""


def nodes(start: float, end: float) -> Iterator[tuple[float, float]]:
    """Points and weights of the quadrature, s."""
    half = 0.5 * (end - start)
    return ((start + half * (1.0 + x), half * w) for x, w in zip(AT.tolist(), WEIGHTS.tolist(), strict=True))


def parabola(x: float) -> Array:
    """Weights of the values at the beginning, in the middle and at the end of a step at a share of it, (3,)."""
    return np.array([(2.0 * x - 1.0) * (x - 1.0), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)])


def weights(parts: Iterable[Array]) -> tuple[float, Array]:
    """A sum as its first entry times ratios, which are whole numbers where they are so but for rounding."""
    total = np.sum(list(parts), axis=0)
    ratios = total / total[0]
    whole = np.round(ratios)
    return float(total[0]), np.where(np.abs(ratios - whole) < 1e-12, whole, ratios)


def factorised(P: Array) -> tuple[Array, Array]:
    """Unit upper triangular U and D with P = U D U', (n, n) and (n,)."""
    P, n = P.copy(), len(P)
    U, D = np.eye(n), np.zeros(n)
    for j in reversed(range(n)):
        D[j] = max(P[j, j], 0.0)
        if D[j] > 0.0:
            U[:j, j] = P[:j, j] / D[j]
            P[:j, :j] -= D[j] * np.outer(U[:j, j], U[:j, j])
    return U, D


def added(x: Any, low: Any, way: Any) -> tuple[Any, Any]:
    """A sum of two numbers with another, and what its rounding left out (Kahan)."""
    way = way + low
    total = x + way
    return total, way - (total - x)


@dataclass(slots=True)
class Belief:
    """Mean and factors of the covariance, as in `aci_ud.rs`: symbols that each step renews."""

    p: Any
    v: Any
    theta: list[Any]
    upv: Any
    up: list[Any]
    uv: list[Any]
    U: list[Any]
    """Above the diagonal, column by column."""
    d: list[Any]
    D: list[Any]
    Pi: list[Any]
    """What the noise of the output left in p and v: of p, of both, of v (`errors_in_variables.rs`)."""
    cross: list[Any]
    """Its covariance with the noise of the samples that still drive: of p and v with the oldest, ..."""
    low: Any
    """What the rounding of p left out, which single precision needs: readings by the hundred make one position."""
    theta_low: list[Any]
    """Likewise of the parameters: after an hour a reading moves them by less than their last bit."""

    @classmethod
    def of(cls, entry: Callable[[str], Any], m: int) -> Belief:
        """From what each field of the program holds."""

        def row(name: str, count: int) -> list[Any]:
            return [entry(f"{name}[{j}]") for j in range(count)]

        motion = entry("p"), entry("v"), row("theta", m), entry("upv"), row("up", m), row("uv", m)
        factors = row("U", m * (m - 1) // 2), row("d", 2), row("D", m)
        return cls(*motion, *factors, row("Pi", 3), row("cross", 6), entry("low"), row("theta_low", m))

    def fields(self) -> dict[str, Any]:
        """By the names of the fields."""
        listed = {"p": self.p, "low": self.low, "v": self.v, "upv": self.upv}
        for name in ("theta", "theta_low", "up", "uv", "U", "d", "D", "Pi", "cross"):
            listed |= {f"{name}[{j}]": x for j, x in enumerate(getattr(self, name))}
        return listed

    def move(self, way: Any) -> None:
        """Add to the position."""
        self.p, self.low = added(self.p, self.low, way)

    def learn(self, ways: Sequence[Any]) -> None:
        """Add to the parameters."""
        for j, way in enumerate(ways):
            self.theta[j], self.theta_low[j] = added(self.theta[j], self.theta_low[j], way)

    def among(self, i: int, j: int) -> int:
        """Place of the entry of rows i < j of the parameters."""
        return j * (j - 1) // 2 + i

    def predict(self, h: float, step: Push) -> None:
        """Thornton's step; the noise has a positive pivot of the velocity."""
        for j in range(len(self.theta)):
            p, v = step.to_p[j], step.to_v[j]
            for i in range(j):
                u = self.U[self.among(i, j)]
                p, v = p + step.to_p[i] * u, v + step.to_v[i] * u
            self.up[j] = self.up[j] + h * self.uv[j] + p
            self.uv[j] = self.uv[j] + v
        w, (dp, dv) = self.upv + h, self.d
        inverse = over(1.0, dv + step.noise * h)
        remainder = w - 0.5 * h
        self.move(h * self.v + step.dp)
        self.v = self.v + step.dv
        self.upv = (w * dv + step.noise * (0.5 * h * h)) * inverse
        self.d = [
            dp + step.noise * (h**3 / 12.0) + dv * (step.noise * h * inverse) * remainder * remainder,
            dv + step.noise * h,
        ]

    def spread(self, h: float, variance: float) -> None:
        """Noise of the output over a step; `variance` is that of one sample."""
        pp, pv, vv = self.Pi
        cross, g = [*self.cross, 0.0, 0.0], taps(h)
        white = variance * (g.T @ g)
        Pi = [pp + h * (2.0 * pv + h * vv) + white[0, 0], pv + h * vv + white[0, 1], vv + white[1, 1]]
        for i, (gp, gv) in enumerate(g.tolist()):
            cp, cv = cross[2 * i] + h * cross[2 * i + 1], cross[2 * i + 1]
            Pi = [Pi[0] + (2.0 * gp) * cp, Pi[1] + (gv * cp + gp * cv), Pi[2] + (2.0 * gv) * cv]
            cross[2 * i : 2 * i + 2] = cp + variance * gp, cv + variance * gv
        self.Pi, self.cross = Pi, cross[2:]

    def read_noise(self, tau: float, gain: Sequence[Any]) -> None:
        """What a reading of p + tau v leaves of it, by the gains of p and v."""

        def moved(p: Any, v: Any) -> tuple[Any, Any]:
            read = p + tau * v
            return p - gain[0] * read, v - gain[1] * read

        pp, pv, vv = self.Pi
        left, right = moved(pp, pv), moved(pv, vv)
        top, bottom = moved(left[0], right[0]), moved(left[1], right[1])
        self.Pi = [top[0], top[1], bottom[1]]
        self.cross = [x for i in range(0, 6, 2) for x in moved(self.cross[i], self.cross[i + 1])]

    def decay(self, left: Sequence[float]) -> None:
        """Of random processes: what is left of each parameter."""
        for j, share in enumerate(left):
            self.theta[j], self.D[j] = self.theta[j] * share, self.D[j] * share**2
            self.up[j], self.uv[j] = self.up[j] * (1.0 / share), self.uv[j] * (1.0 / share)
            for i in range(j):
                self.U[self.among(i, j)] = self.U[self.among(i, j)] * (left[i] / share)

    def wait(self, left: Sequence[Any], grown: Sequence[Any]) -> None:
        """Random processes over any time: what is left of each parameter, however little, and what its variance gains.

        With y the column of U whose rows have decayed, D (y, share)(y, share)' + gain (0, 1)(0, 1)' has the pivot
        D share^2 + gain and the column y D share / pivot, and leaves y y' D gain / pivot to those before.
        """
        for j, (share, gain) in enumerate(zip(left, grown, strict=True)):
            y = [self.U[self.among(i, j)] * left[i] for i in range(j)]
            D, self.theta[j] = self.D[j], self.theta[j] * share
            self.D[j] = D * share * share + gain
            if isinstance(gain, Symbol):
                ratio = D * over(1.0, self.D[j])
                column = [x * (ratio * share) for x in y]
                self.add_outer(ratio * gain, 0.0, 0.0, list(y))
            else:
                column = [x * over(1.0, share) for x in y]
            for i in range(j):
                self.U[self.among(i, j)] = column[i]

    def columns(self, w: Sequence[Any]) -> tuple[Any, Any, list[Any]]:
        """P[:, theta] w: in the rows of p, of v and of the parameters."""
        m = len(w)
        f = [(sum((w[i] * self.U[self.among(i, j)] for i in range(j)), w[j])) * self.D[j] for j in range(m)]
        p, v = (sum((x * y for x, y in zip(row, f, strict=True)), 0.0) for row in (self.up, self.uv))
        return p, v, [sum((self.U[self.among(i, j)] * f[j] for j in range(i + 1, m)), f[i]) for i in range(m)]

    def add_outer(self, c: Any, to_p: Any, to_v: Any, a: list[Any]) -> None:
        """P += c a a', a zero behind the parameters that are given."""
        for j in reversed(range(len(a))):
            s = a[j]
            pivot = self.D[j] + c * s * s
            inverse = over(1.0, pivot)
            beta, c, self.D[j] = s * c * inverse, c * self.D[j] * inverse, pivot
            to_p, to_v = to_p - s * self.up[j], to_v - s * self.uv[j]
            self.up[j], self.uv[j] = self.up[j] + beta * to_p, self.uv[j] + beta * to_v
            for k in range(j):
                u = self.U[self.among(k, j)]
                a[k] = a[k] - s * u
                self.U[self.among(k, j)] = u + beta * a[k]
        pivot = self.d[1] + c * to_v * to_v
        inverse = over(1.0, pivot)
        beta, c, pivot_before = to_v * c * inverse, c * self.d[1] * inverse, self.upv
        to_p = to_p - to_v * pivot_before
        self.upv = pivot_before + beta * to_p
        self.d = [self.d[0] + c * to_p * to_p, pivot]

    def correct(self, tau: float, b: Sequence[Any], e: Any, R: float) -> tuple[Update, Update]:
        """Bierman's reading of p + tau v + b'theta, and what it would be with known parameters."""
        m = len(self.theta)
        columns = [[self.upv], *([self.up[j], self.uv[j]] for j in range(m))]
        s, gains = self.d[0] + R, [self.d[0]]
        self.d[0] = self.d[0] * over(R, s)
        inverse = over(1.0, s)
        settled = Update(s, inverse, [])
        for j, column in enumerate(columns, start=-1):
            rows = column if j < 1 else [*column, *(self.U[self.among(i, j)] for i in range(j))]
            weights = [1.0, tau, *b[: max(j, 0)]]
            f = sum((w * u for w, u in zip(weights, rows, strict=False)), tau if j < 0 else b[j])
            D = self.d[1] if j < 0 else self.D[j]
            g, before, last = D * f, s, inverse
            s = before + f * g
            inverse = over(1.0, s)
            renewed, fraction = D * (before * inverse), f * last
            updated = [u - fraction * gain for u, gain in zip(rows, gains, strict=True)]
            gains = [*(gain + u * g for u, gain in zip(rows, gains, strict=True)), g]
            if j < 0:
                self.d[1], self.upv = renewed, updated[0]
                settled = Update(s, inverse, [gain * inverse for gain in gains])
                continue
            self.D[j], self.up[j], self.uv[j] = renewed, updated[0], updated[1]
            for i in range(j):
                self.U[self.among(i, j)] = updated[2 + i]
        scaled = e * inverse
        self.move(gains[0] * scaled)
        self.v = self.v + gains[1] * scaled
        self.learn([gain * scaled for gain in gains[2:]])
        return Update(s, inverse, [gain * inverse for gain in gains]), settled


@dataclass(slots=True)
class Update:
    """A reading as its filter took it in: variance of the innovation, one over it, gains of p, v and the parameters."""

    s: Any
    inverse: Any
    gains: list[Any]


def taps(h: float) -> Array:
    """What each of the last four samples of the output adds to position and velocity over a step, (4, 2)."""
    ends = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -1.0, 1.0], [0.0, 1.0, -2.0, 1.0], [-1.0, 3.0, -3.0, 1.0]])
    summed: Array = np.sum([np.outer(newton(s / h) @ ends, [w * (h - s), w]) for s, w in nodes(0.0, h)], axis=0)
    return summed


@dataclass(slots=True)
class Push:
    """The integrals of a step: what it adds to position and velocity, its gradients, and the density of its noise."""

    dp: Any
    dv: Any
    to_p: list[Any]
    to_v: list[Any]
    noise: Any
    left: list[float]
    """What is left of each parameter at its end."""


@dataclass(slots=True)
class Program:
    """What the device computes: values of fields and variables, for the first sample, the others, a reading."""

    live: LiveModel
    format: Format
    graph: Graph
    free: tuple[int, ...]
    """Parameters in the order of the program, by their place among those of the live filter: processes first."""
    first: dict[str, Any] = field(default_factory=dict)
    again: dict[str, Any] = field(default_factory=dict)
    """For the first sample behind a gap, which effects with memory reach over."""
    next: dict[str, Any] = field(default_factory=dict)
    reading: dict[str, Any] = field(default_factory=dict)
    distance: dict[str, Any] = field(default_factory=dict)
    """Squared innovation of a reading and the most that the gate lets through; empty without a gate."""
    correction: dict[str, Any] = field(default_factory=dict)
    """For the noise of the output in the gradient, at every sixteenth reading."""
    gap: dict[str, Any] = field(default_factory=dict)
    """Behind samples that are missing: how random processes went on."""
    side: tuple[str, ...] = ()
    """Side channels, arguments of a step."""
    held: dict[str, float] = field(default_factory=dict)
    """Fields that never change, by what they would hold."""
    memories: tuple[int, ...] = ()
    """How many numbers each effect remembers."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the free parameters."""
        return tuple(self.live.names[j] for j in self.free)

    @property
    def suspects(self) -> dict[str, float]:
        """Effects of a watch and their typical sizes, SI."""
        names = (term.name for term in self.live._suspects)
        return dict(zip(names, self.live.settings["watch"][0], strict=True))


def program(live: LiveModel, precision: Precision) -> Program:
    """Trace the step of a live filter that has received nothing yet.

    Raises
    ------
    NotExportable
        Naming the effect that cannot be traced, or the setting that a device's filter has not.
    """
    settings = live.settings
    moving = rate_and_density_of(live)
    if settings["choice"].order != 1 or moving[0] != (0.0, 0.0):
        raise NotExportable(
            "an exported filter is of first order, and its scale_factor is constant; "
            "leave these settings of LiveModel as they are"
        )
    if not settings["q"] > 0.0 or not settings["r_position"] > 0.0:
        raise NotExportable("an exported filter needs noise of output and position above zero; fit a longer record")
    if any(part.values.any() for part in live._parts):
        raise NotExportable("an exported filter has no coefficients that are subtracted; see with_held_as_states")
    variances = np.diag(settings["P0"])[MOTION:]
    order = sorted(range(len(live.names)), key=lambda j: moving[j] == (0.0, 0.0))
    free = tuple(j for j in order if variances[j] > 0.0 or moving[j] != (0.0, 0.0))
    graph = Graph(precision == "f32")
    needs = tuple(dict.fromkeys(name for term in live.model.terms for name in term.effect.needs))
    plan = Program(live, FORMATS[precision], graph, free, side=needs)
    trace(plan)
    numbers = {name: float(x) for name, x in plan.first.items() if not isinstance(x, Symbol)}
    held = {name: x for name, x in numbers.items() if not isinstance(y := plan.next.get(name), Symbol) and x == y}
    if held:
        plan = replace(plan, first={}, again={}, next={}, held=held)
        trace(plan)
    read(plan)
    plan.again |= {name: x for name, x in plan.first.items() if name not in plan.again}
    plan.gap = waited(plan)
    return plan


def untraced(effect: Effect) -> str | None:
    """Why a device's filter cannot have an effect that a live filter has; None where it can."""
    s, base = probe(effect.needs), Model.linear().freeze(time_offset=0.0)
    shapes = {name: float(np.mean(np.clip(shape.span(s), -1e3, 1e3))) for name, shape in effect.shapes.items()}
    model = (
        base if effect.name in base.effects else base.add(effect.name, shapes={effect.name: shapes} if shapes else {})
    )
    random = {term.name: Prior(0.0, effect.prior.typical) for term in model.terms if term.effect.port == "process"}
    model = replace(model, priors={**model.priors, **random})
    live = LiveModel(model, Rig(), rate=1e3, q=1e-6, r_position=1e-12, position=0.0)
    try:
        program(live, "f64")
    except NotExportable as error:
        return str(error).removeprefix(f"{effect.name} ")
    return None


def trace(plan: Program) -> None:
    """Every kind of step, before the reading."""
    graph, free, settings = plan.graph, plan.free, plan.live.settings
    for target in (plan.first, plan.again, plan.next):
        first = target is not plan.next
        belief = Belief.of(lambda name: graph.leaf(f"@{name}"), len(free))
        theta = full(plan, belief)
        columns, position_columns, slopes, ports = effects_of(plan, belief, theta, first, target is plan.first)
        if not first:
            step = push(plan, belief, theta, columns)
            belief.spread(settings["dt"], settings["q"] / settings["dt"])
            slope = over(1.0, 1.0 + theta[0])
            target |= watching.predicted(plan, step, slope, taps(settings["dt"]), columns, slopes)
            mixed = [slope, 0.0, *slopes]
            ports |= {f"@mixed[{at}]": -slope * slope * mixed[j] for at, j in enumerate(free)} | {
                "@slope": slope * slope
            }
            target |= {f"@{name}": x for name, x in belief.fields().items()}
            target |= {"@u[2]": graph.leaf("@u[1]"), "@u[1]": graph.leaf("@u[0]")}
        target |= {"@u[0]": graph.leaf("u"), **ports}
        target |= {f"b{j}": narrow(x) for j, x in enumerate(position_columns) if isinstance(x, Symbol) or x != 0.0}


def rate_and_density_of(live: LiveModel) -> list[tuple[float, float]]:
    """Of each parameter's process, (0, 0) of a constant."""
    return [rate_and_density(process) for process in live.settings["parameters"]]


def full(plan: Program, belief: Belief) -> list[Any]:
    """All parameters in the order of the live filter: symbols, and those that are held as numbers."""
    theta = [float(x) for x in plan.live.settings["x0"][MOTION:]]
    for at, j in enumerate(plan.free):
        theta[j] = belief.theta[at]
    return theta


def effects_of(
    plan: Program, belief: Belief, theta: list[Any], first: bool, fresh: bool
) -> tuple[Any, Any, Any, dict[str, Any]]:
    """Columns of the effects over a step, (3, m) and (m,), their slopes by the output, (m,), and the fields that they
    are evaluated from.

    Parameters
    ----------
    first : no output is before this one.
    fresh : nothing is remembered.
    """
    live, leaf = plan.live, plan.graph.leaf
    m = live._columns.shape[1]
    traced = object.__new__(LiveModel)
    traced.__dict__.update(live.__dict__)
    traced._signals = signals = copy.copy(live._signals)
    traced._filter = SimpleNamespace(samples=0 if first else 1)  # type: ignore[assignment]
    variances = [
        sum((u * u * d for u, d in zip(row, belief.D, strict=True)), start)
        for row, start in ((belief.up, belief.d[0] + belief.upv * belief.upv * belief.d[1]), (belief.uv, belief.d[1]))
    ]
    traced._x = symbols([belief.p, belief.v, *theta])
    traced._variances = symbols([*variances, *(0.0 for _ in theta)])
    traced._side = {name: leaf(f"side_{identifier(name)}") for name in plan.side}  # type: ignore[misc]
    signals.t = leaf("t", wide=True)  # type: ignore[assignment]
    fields = [[f"@{name}[{j}]" for j in range(m)] for name in ("before", "middle", "here")]
    rows = [[0.0 if first else plan.held[name] if name in plan.held else leaf(name) for name in row] for row in fields]
    traced._columns = symbols(x for row in rows for x in row).reshape(3, m)
    if not first:
        signals.outputs = (leaf("u2"), leaf("u1"), leaf("@u[0]"))  # type: ignore[assignment]
    if not fresh:
        signals.reached = symbols([leaf("@reached[0]"), leaf("@reached[1]")]).reshape(2, 1)
        signals.way = symbols([leaf("@way[0]"), leaf("@way[1]")])
        count = iter(range(sum(plan.memories)))
        traced._memories = [[leaf(f"@memory[{next(count)}]") for _ in range(n)] for n in plan.memories]  # type: ignore[misc]
    u = leaf("u")
    try:
        over_step, step, _ = traced.until(u)  # type: ignore[arg-type]
    except (NotTraceable, TypeError, ValueError, AttributeError, IndexError) as error:
        raise NotExportable(f"{untraceable(traced, u) or 'a signal of the model'} {error}") from error
    signals.advance(u, over_step)  # type: ignore[arg-type]
    plan.memories = tuple(len(held) for held in step.memories)
    ports: dict[str, Any] = {f"@memory[{i}]": narrow(x) for i, x in enumerate(chain.from_iterable(step.memories))}
    for k, name in ((0, "before"), (2, "here")):
        ports |= {f"@{name}[{j}]": narrow(step.columns[k, j]) for j in range(m)}
    ports |= {f"@reached[{j}]": narrow(x) for j, x in enumerate(signals.reached.ravel())}
    ports |= {f"@way[{j}]": narrow(x) for j, x in enumerate(signals.way)}
    return step.columns, step.position_columns, step.slopes, ports


def untraceable(live: LiveModel, u: Any) -> str:
    """The effect at which tracing ends."""
    for part, memory in zip(live._parts, live._memories, strict=True):
        alone = object.__new__(LiveModel)
        alone.__dict__.update(live.__dict__, _parts=[part], _memories=[memory])
        try:
            alone.until(u)
        except (NotTraceable, TypeError, ValueError, AttributeError, IndexError):
            return part.effect.name
    return ""


def push(plan: Program, belief: Belief, theta: list[Any], columns: Any) -> Push:
    """Predict over a step with the integrals of output and effects."""
    settings, leaf = plan.live.settings, plan.graph.leaf
    h, moving = settings["dt"], rate_and_density_of(plan.live)
    slope = over(1.0, 1.0 + theta[0])
    instants = [np.ones(3), *columns.T]  # of K0 and of the effects
    u2, u1, u0, u = leaf("u2"), leaf("u1"), leaf("@u[0]"), leaf("u")
    bend = (u - u0) - (u0 - u1)
    outputs = symbols([u, u - u0, bend, bend - ((u0 - u1) - (u1 - u2))])

    def gradient(j: int, start: float, lever: bool) -> Any:
        """Integral from `start` on, of what decays as parameter j does."""
        rate = moving[j][0]
        least, ratios = weights(
            w * (h - s if lever else 1.0) * np.exp(-rate * (s - start)) * parabola(s / h) for s, w in nodes(start, h)
        )
        return -least * slope * (ratios @ instants[j - 1])

    gradients, forces = [], []
    for lever in (True, False):
        least, ratios = weights(w * (h - s if lever else 1.0) * np.array(newton(s / h)) for s, w in nodes(0.0, h))
        g = [gradient(j, 0.0, lever) for j in range(1, len(theta))]
        force = least * slope * (ratios @ outputs) + sum(c * x for c, x in zip(theta[1:], g, strict=True))
        forces.append(force - settings["rest"] * (0.5 * h * h if lever else h))
        gradients.append([-force * slope, *g])
    to_p, to_v = ([g[j] for j in plan.free] for g in gradients)
    step = Push(
        forces[0],
        forces[1],
        to_p,
        to_v,
        settings["q"] * slope * slope,
        [float(np.exp(-moving[j][0] * h)) for j in plan.free],
    )
    belief.predict(h, step)
    belief.decay(step.left)
    for at, j in enumerate(plan.free):
        rate, density = moving[j]
        for s, w in nodes(0.0, h) if density > 0.0 else ():
            outer = [0.0] * at + [float(np.exp(-rate * (h - s)))]
            belief.add_outer(density * w, gradient(j, s, True), gradient(j, s, False), outer)
    return step


def waited(plan: Program) -> dict[str, Any]:
    """Fields of the random processes behind a gap, in which the motion is forgotten: all of it at once."""
    moving = [rate_and_density_of(plan.live)[j] for j in plan.free]
    if all(process == (0.0, 0.0) for process in moving):
        return {}
    m, gap = len(moving), plan.graph.leaf("gap")
    belief = Belief.of(lambda name: plan.graph.leaf(f"@{name}"), m)
    belief.upv, belief.up, belief.uv = 0.0, [0.0] * m, [0.0] * m
    belief.wait(
        [exponential(-rate * gap) if rate > 0.0 else 1.0 for rate, _ in moving],
        [density * gap * lost_share(2.0 * rate * gap) if density > 0.0 else 0.0 for rate, density in moving],
    )
    return {f"@{name}": x for name, x in belief.fields().items() if name.partition("[")[0] in ("theta", "U", "D")}


def lost_share(x: Any) -> Any:
    """(1 - exp(-x)) / x, by a series where the difference would lose digits."""
    if not isinstance(x, Symbol):
        return 1.0
    series: Any = 0.0
    for k in reversed(range(1, 12)):
        series = (1.0 - x * series) * (1.0 / k)
    return select(less(x, 0.25), series, over(1.0 - exponential(-x), x))


def read(plan: Program) -> None:
    """Take in a reading."""
    belief = Belief.of(lambda name: plan.graph.leaf(f"@{name}#"), len(plan.free))
    theta, settings = full(plan, belief), plan.live.settings
    tau = settings["tau"]
    b: list[Any] = [0.0] * len(theta)
    for j in range(2, len(theta)):
        if f"b{j - 2}" in plan.first | plan.next:
            b[j] = plan.graph.leaf(f"b{j - 2}")
            plan.first.setdefault(f"b{j - 2}", 0.0)
    beside = sum((x * c for x, c in zip(b, theta, strict=True)), belief.low + tau * belief.v)
    e = (plan.graph.leaf("z") - belief.p) - beside
    pp, pv, vv = belief.Pi
    noise = pp + tau * (2.0 * pv + tau * vv)
    b = [b[j] for j in plan.free]
    update, settled = belief.correct(tau, b, e, settings["r_position"])
    if settings["gate"] is not None:
        plan.distance = {"distance": e * e, "most": settings["gate"] * update.s}
    belief.read_noise(tau, settled.gains)
    share, leaf = noise * settled.inverse, plan.graph.leaf
    plan.reading = {f"@{name}": x for name, x in belief.fields().items()} | {"@e": e, "@s": update.s}
    plan.reading |= watching.read(plan, b, e, update, settled)
    plan.reading["@share"] = leaf("@share#") + share * leaf("@slope#")
    b = [narrow(plan.next[f"@mixed[{at}]"]) for at in range(len(plan.free))]
    gathered = [0.0 if not isinstance(x, Symbol) and x == 0.0 else leaf(f"@gathered[{at}]#") for at, x in enumerate(b)]
    for at, x in enumerate(gathered):
        if isinstance(x, Symbol):
            plan.reading[f"@gathered[{at}]"] = x + share * leaf(f"@mixed[{at}]#")
    belief = Belief.of(lambda name: leaf(f"@{name}#"), len(plan.free))
    p, v, moved = belief.columns(gathered)
    belief.move(p)
    belief.v = belief.v + v
    belief.learn(moved)
    belief.add_outer(over(1.0, leaf("@share#")), p, v, moved)
    plan.correction = {
        **{f"@{name}": x for name, x in belief.fields().items()},
        **{f"@gathered[{at}]": 0.0 for at, x in enumerate(gathered) if isinstance(x, Symbol)},
        "@share": 0.0,
        **watching.begun(plan, belief),
    }


KEPT = ("before", "here", "memory", "reached", "way", "mixed", "slope")
"""Fields that are there only where something reads them."""


def name_of(target: str) -> str:
    """Field or variable, without the mark of its time."""
    return target.removeprefix("@").removesuffix("#")


def reachable(values: Iterable[Any]) -> list[Symbol]:
    """What values are worked out from, in the order of its making."""
    reached: dict[int, Symbol] = {}
    waiting = [x for x in values if isinstance(x, Symbol)]
    while waiting:
        x = waiting.pop()
        if x.index not in reached:
            reached[x.index] = x
            waiting += [y for y in x.args if isinstance(y, Symbol)]
    return [reached[index] for index in sorted(reached)]


def pruned(plan: Program) -> list[dict[str, Any]]:
    """All stages without what nothing reads."""
    stages = [plan.first, plan.next, plan.reading, plan.correction, plan.again, plan.gap]

    def wanted(read: set[str]) -> list[dict[str, Any]]:
        return [
            {
                target: x
                for target, x in stage.items()
                if name_of(target) in read or not (target[0] == "b" or name_of(target).partition("[")[0] in KEPT)
            }
            for stage in stages
        ]

    read: set[str] = set()
    while True:
        needed = wanted(read)
        leaves = {name_of(x.args[0]) for stage in needed for x in reachable(stage.values()) if x.op == "leaf"}
        if leaves <= read:
            return needed
        read |= leaves


class Writer:
    """Statements of one language."""

    def __init__(self, language: Language, fmt: Format, name: str) -> None:
        self.language, self.format, self.name = language, fmt, name
        self.functions: set[tuple[str, bool]] = set()

    def kind(self, wide: bool) -> Format:
        """Number format of an expression."""
        return FORMATS["f64"] if wide else self.format

    def type(self, wide: bool = False) -> str:
        """Its name."""
        fmt = self.kind(wide)
        return fmt.c if self.language == "c" else fmt.rust

    def literal(self, x: float, wide: bool = False) -> str:
        """A number, exact in its format."""
        text = repr(float(x)) if self.kind(wide) is FORMATS["f64"] else str(np.float32(x))
        text = text if "." in text or "e" in text else f"{text}.0"
        return f"{text}f" if self.language == "c" and self.kind(wide) is not FORMATS["f64"] else text

    def place(self, target: str) -> str:
        """A field of the filter, or a variable."""
        inside = "f->" if self.language == "c" else "self."
        return f"{inside}{name_of(target)}" if target.startswith("@") else target

    def select(self, condition: str, x: str, y: str) -> str:
        """A choice between two values."""
        if self.language == "c":
            return f"{condition} ? {x} : {y}"
        return f"if {condition} {{ {x} }} else {{ {y} }}"

    def call(self, function: str, wide: bool, *arguments: str) -> str:
        """A call of a function that the program has."""
        self.functions.add((function, wide))
        return f"{self.function(function, wide)}({', '.join(arguments)})"

    def function(self, function: str, wide: bool) -> str:
        """Its name."""
        suffix = "_wide" if wide else ""
        return f"{self.name}_{function}{suffix}" if self.language == "c" else f"{function}{suffix}"

    def expression(self, x: Symbol, terms: Sequence[str]) -> str:
        """An operation on the texts of its operands."""
        if x.op in SIGNS:
            return f" {SIGNS[x.op]} ".join(terms)
        if x.op == "neg":
            return f"-{terms[0]}"
        if x.op == "select":
            return self.select(*map(bare, terms))
        if x.op == "narrow":
            return f"({self.type()}){terms[0]}" if self.language == "c" else f"{terms[0]} as {self.type()}"
        if x.op == "nearest":
            return f"({terms[0]} + {terms[1]}) - {terms[1]}"
        return self.call(x.op, x.wide, *map(bare, terms))

    def declared(self, x: Symbol, text: str) -> str:
        """A variable of that value."""
        if self.language == "rust":
            return f"let x{x.index} = {text};"
        kind = "int" if x.op in ("lt", "le") else self.type(x.wide)
        return f"const {kind} x{x.index} = {text};"

    def statements(self, targets: Mapping[str, Any], wide: bool = False) -> list[str]:
        """Statements that give every target its value, each target as soon as nothing needs what it held before."""
        live = reachable(targets.values())
        uses: dict[int, int] = {}
        for y in (*(y for x in live for y in x.args), *targets.values()):
            if isinstance(y, Symbol):
                uses[y.index] = uses.get(y.index, 0) + 1
        texts: dict[int, tuple[str, frozenset[str]]] = {}
        lines: list[tuple[float, str, frozenset[str], str]] = []

        def text_of(x: Any, wide: bool) -> tuple[str, frozenset[str]]:
            return texts[x.index] if isinstance(x, Symbol) else (self.literal(x, wide), frozenset())

        for x in live:
            if x.op == "leaf":
                texts[x.index] = self.place(x.args[0]), frozenset([self.place(x.args[0])])
                continue
            operands_wide = x.wide or (x.op in ("lt", "le") and any(isinstance(y, Symbol) and y.wide for y in x.args))
            operands = [text_of(y, operands_wide) for y in x.args]
            text = self.expression(x, [operand for operand, _ in operands])
            read = frozenset().union(*(fields for _, fields in operands))
            if uses[x.index] == 1 and len(text) < SHORT and x.op not in ("select", "lt", "le"):
                texts[x.index] = f"({text})" if " " in text or text.startswith(("-", "(")) else text, read
            else:
                lines.append((x.index, self.declared(x, text), read, ""))
                texts[x.index] = f"x{x.index}", frozenset()
        for target, x in targets.items():
            text, read = text_of(x, wide)
            place = self.place(target)
            if text != place:
                lines.append((x.index if isinstance(x, Symbol) else -1, f"{place} = {bare(text)};", read, place))
        return ordered(lines)


def bare(text: str) -> str:
    """An expression without the parentheses in which it stands among others."""
    return text[1:-1] if text.startswith("(") else text


SIGNS = {"add": "+", "sub": "-", "mul": "*", "div": "/", "lt": "<", "le": "<="}
SHORT = 48
"""Letters of an expression that stands where it is used."""


def ordered(lines: Sequence[tuple[float, str, frozenset[str], str]]) -> list[str]:
    """Lines in order, those that write a field behind those that read it."""
    at = [place for place, *_ in lines]
    moved = True
    while moved:
        moved = False
        last: dict[str, float] = {}
        for place, (_, _, read, target) in zip(at, lines, strict=True):
            for name in read - {target}:
                last[name] = max(last.get(name, -1.0), place)
        for i, (_, _, _, target) in enumerate(lines):
            if target and last.get(target, -2.0) >= at[i]:
                at[i], moved = last[target] + 2.0**-20, True
    return [lines[i][1] for i in sorted(range(len(lines)), key=lambda i: (at[i], i))]


def functions(writer: Writer) -> list[str]:
    """The program's own functions, those first that others call."""
    texts: dict[tuple[str, bool], list[str]] = {}
    while waiting := writer.functions - texts.keys():
        for name, wide in sorted(waiting):
            texts[name, wide] = primitive(writer, name, wide) or series(writer, name, wide)
    return [line for key in sorted(texts, key=lambda key: (key[0] not in PRIMITIVE, key)) for line in texts[key]]


PRIMITIVE = ("exponent", "guess", "two_to")
"""Functions of the bits of a number."""


def primitive(writer: Writer, name: str, wide: bool) -> list[str]:
    """A function of the bits of a number in its language; nothing where it is none."""
    if name not in PRIMITIVE:
        return []
    fmt, function = writer.kind(wide), writer.function(name, wide)
    size, excess = 1 + fmt.exponent + fmt.fraction, 2 ** (fmt.exponent - 1) - 1
    mask, shift = 2**fmt.exponent - 1, 1.5 * 2.0**fmt.fraction  # behind a sum a whole number is the last bits, NaN none
    if writer.language == "rust":
        if name == "exponent":
            power = f"(((x.to_bits() >> {fmt.fraction}) & {mask}) as i32 - {excess}) as {fmt.rust}"
            return [f"fn {function}(x: {fmt.rust}) -> {fmt.rust} {{", f"    {power}", "}", ""]
        bits = (
            f"{fmt.seed:#x}_u{size}.wrapping_sub(x.to_bits() >> 1)"
            if name == "guess"
            else f"(x + {shift:.1f}).to_bits().wrapping_add({excess}) << {fmt.fraction}"
        )
        return [f"fn {function}(x: {fmt.rust}) -> {fmt.rust} {{", f"    {fmt.rust}::from_bits({bits})", "}", ""]
    seed = f"UINT{size}_C({fmt.seed:#x}) - (w.u >> 1)"
    bits = seed if name == "guess" else f"(w.u + {excess}u) << {fmt.fraction}"
    suffix = f" + {shift:.1f}{'f' * (size == 32)}" if name == "two_to" else ""
    return [
        f"static {fmt.c} {function}({fmt.c} x)",
        "{",
        f"    union {{ {fmt.c} x; uint{size}_t u; }} w;",
        f"    w.x = x{suffix};",
        *(
            [f"    return ({fmt.c})((int32_t)((w.u >> {fmt.fraction}) & {mask}u) - {excess});"]
            if name == "exponent"
            else [f"    w.u = {bits};", "    return w.x;"]
        ),
        "}",
        "",
    ]


def series(writer: Writer, name: str, wide: bool) -> list[str]:
    """A function as a series, which `symbols.body` has."""
    fmt, function = writer.kind(wide), writer.function(name, wide)
    y = body(name, Graph(wide).leaf("x", wide=wide), fmt)
    inner = ["    " + line for line in writer.statements({"y": y}, wide)]
    if writer.language == "rust":
        return [f"fn {function}(x: {fmt.rust}) -> {fmt.rust} {{", "    let y;", *inner, "    y", "}", ""]
    return [f"static {fmt.c} {function}({fmt.c} x)", "{", f"    {fmt.c} y;", *inner, "    return y;", "}", ""]


FIELDS = {
    "p": "position along the input axis, m",
    "low": "what its rounding left out",
    "v": "velocity along it, m/s",
    "theta": "parameters, SI",
    "theta_low": "what their rounding left out",
    "upv": "U between p and v",
    "up": "U between p and the parameters",
    "uv": "U between v and the parameters",
    "U": "U among the parameters, column by column",
    "d": "D of p and v",
    "D": "D of the parameters",
    "u": "the last three outputs, newest first, m/s^2",
    "before": "effects at the beginning of the last step",
    "here": "effects at its end",
    "memory": "what effects with memory hold",
    "reached": "largest |a| and |v| so far",
    "way": "lowest and highest position so far, m",
    "Pi": "what noise of the output left in p and v",
    "cross": "its covariance with samples that still drive",
    "mixed": "how that noise is in the gradients",
    "slope": "and in the acceleration",
    "gathered": "information by noise since the last correction",
    "share": "its size",
    "e": "innovation of the newest reading, m",
    "s": "its variance, m^2",
    **watching.FIELDS,
}
"""Fields of the filter's state, beside the numbers of samples and of readings since the last correction."""
EVERY = 16
"""Readings between two corrections, as in `errors_in_variables.rs`."""
RECORD, CHECKS = 600, (300, 600)
"""Samples of the record that is replayed, and those after which estimates are compared."""
AGREEMENT = {"f32": 0.1, "f64": 1e-6}
"""Largest distance from the live filter of the model, standard deviations."""


@dataclass(slots=True)
class Text:
    """What every file of an export is written from."""

    plan: Program
    writer: Writer
    source: str
    stages: list[list[str]] = field(init=False)
    helpers: list[str] = field(init=False)
    sizes: dict[str, int] = field(init=False)
    """Of each field: 0 for a number, else the length of the array."""
    locals: list[str] = field(init=False)
    judged: list[str] = field(init=False)
    """Statements that work out how far off a reading is; none without a gate."""
    evidence: list[list[str]] = field(init=False)
    """Statements of a watch: from sums, and over both starts."""

    def __post_init__(self) -> None:
        stages = pruned(self.plan)
        self.stages = [self.writer.statements(stage) for stage in stages]
        self.judged = self.writer.statements(self.plan.distance)
        graph = self.plan.graph
        asked = (watching.posterior(graph), watching.evidence(graph)) if self.plan.suspects else ()
        self.evidence = [self.writer.statements(targets) for targets in asked]
        self.helpers = functions(self.writer)
        targets = [target for stage in stages for target in stage]
        self.locals = sorted({target for target in targets if target[0] == "b"})
        parts = [name_of(target).rstrip("]").partition("[") for target in targets if target[0] == "@"]
        m = {"U": len(self.plan.free) * (len(self.plan.free) - 1) // 2}
        counts = {
            name: max([m.get(name, 0), *(int(at or -1) + 1 for x, _, at in parts if x == name)]) for name in FIELDS
        }
        self.sizes = {name: counts[name] for name in FIELDS if any(x == name for x, _, _ in parts)}

    @property
    def bytes(self) -> int:
        """Of the filter's state."""
        size = 4 if self.plan.format is FORMATS["f32"] else 8
        return 16 + 4 * len(self.counters) + size * sum(max(1, count) for count in self.sizes.values())

    @property
    def counters(self) -> dict[str, str]:
        """Numbers that the filter keeps beside those that every one has, with what they count; a gap leaves them."""
        watched = {"begun": "samples before the newest start of the watch", "starts": "which one that is"}
        return (watched if self.plan.suspects else {}) | (
            {"rejected": "readings beyond the gate"} if self.plan.distance else {}
        )

    @property
    def operations(self) -> tuple[int, int, int]:
        """Arithmetic operations of a step without and with a reading, and of one with the correction."""
        counts = [
            sum(line.count(sign) for line in stage for sign in (" + ", " - ", " * ", " / ", " < "))
            for stage in self.stages
        ]
        return counts[1], counts[1] + counts[2], counts[1] + counts[2] + counts[3]

    @property
    def prior(self) -> dict[str, list[float]]:
        """First values of the fields that are not zero."""
        settings = self.plan.live.settings
        rows = [0, 1, *(MOTION + j for j in self.plan.free)]
        U, D = factorised(settings["P0"][np.ix_(rows, rows)])
        among = [U[2 + i, 2 + j] for j in range(len(self.plan.free)) for i in range(j)]
        return {
            "theta": settings["x0"][rows[2:]].tolist(),
            "upv": [float(U[0, 1])],
            "up": U[0, 2:].tolist(),
            "uv": U[1, 2:].tolist(),
            "U": [float(u) for u in among],
            "d": D[:2].tolist(),
            "D": D[2:].tolist(),
            "slope": [1.0],
        }

    @property
    def time(self) -> str:
        """Time from the model's origin, in double precision."""
        dt, origin = self.plan.live.settings["dt"], self.plan.live._signals.origins.t
        count = "(double){}" if self.writer.language == "c" else "f64::from({})"
        counts = (count.format(self.writer.place(f"@{name}")) for name in ("n", "earlier", "missing"))
        return f"{dt!r} * ({' + '.join(counts)}) - {origin!r}"

    def uses(self, name: str) -> bool:
        """Whether a step uses a variable."""
        stages = [*self.stages[:2], self.stages[4]]
        return any(re.search(rf"\b{name}\b", line) for stage in stages for line in stage)


def comment(text: Text) -> list[str]:
    """What the files say at their top, as lines without comment marks."""
    plan, settings = text.plan, text.plan.live.settings
    rig, origins = plan.live.rig, plan.live._signals.origins
    sign = "" if rig.polarity > 0 else "-"
    estimates = {t.name: t for t in plan.live.estimates}
    held = [name for j, name in enumerate(plan.live.names) if j not in plan.free]
    of_record = {t.name for t in plan.live.model.terms if t.effect.port != "process" and of_one_record(t.effect)}
    anew = [name for name in plan.names if name in of_record and estimates[name].value == 0.0]
    without, with_reading, most = text.operations
    noise = noise_in_band(settings["q"], settings["r_position"], settings["dt"], settings["dt"])
    least = math.sqrt(noise / MOST_SHARE)
    kind, sensor = plan.format.rust, rig.sensor
    raw = f"({sensor.scale_unit or 'V'} - {sensor.zero or 0.0:.10g}) / {sensor.scale or 1.0:.10g}"
    paragraphs = [
        f"Live filter of {text.source}, written by accelcal {__version__}: position, velocity and parameters of an "
        f"accelerometer from its output and an encoder, {1.0 / settings['dt']:.10g} outputs a second, in {kind}.",
        "Model, in forward sense (IEEE 1293): output = bias + (1 + scale_factor) f + sum of coefficient x effect, f "
        f"the specific force along the input axis = {sign}(acceleration of the stage + {rig.gravity:.6g} m/s^2). This "
        "is the sign of every report of accelcal. A paper's inverse form, f = (1 - k) w + K2 w^2 + K3 w^3 with w = "
        "output - K0, has k, K2 and K3 of the other sign to first order; this filter is not of that form.",
        f"A step takes the output (m/s^2{f', by the declared scale {raw}' * (sensor.scale is not None)}), the position "
        "(m; NaN or infinite where it was not read)"
        + "".join(
            f", {name} ({'degC' if name == 'temperature' else 'SI'}; parameters refer to {origins.of(name):.6g})"
            for name in plan.side
        )
        + ". Steps are one sample apart. An argument that is not finite, but for the position, is refused, and nothing "
        "is changed, not the time either: for a lost output pass the one before it. Behind a gap of more than 8 samples"
        " call resume with a position that was read, which begins the motion anew and keeps the parameters. What is "
        "finite counts, however far off: refuse what the sensors cannot have read, and ask once in a while whether all "
        "numbers of the filter are finite; one that is not stays, and the filter has to begin anew with its prior.",
        "States: p, v (along the input axis), then parameters: "
        + "; ".join(
            f"{i} {name} ({ascii_unit(estimates[name].unit) or '1'}), prior {estimates[name].value:.6g} with standard "
            f"deviation {estimates[name].std:.2g}"
            for i, name in enumerate(plan.names)
        )
        + ". Covariance as factors U D U'.",
        *([f"Effects of position count from {origins.p:.6g} m on."] if origins.p else []),
        *([f"Held, not estimated: {', '.join(held)}."] if held else []),
        *(watching.described(text) if plan.suspects else []),
        *([f"Of one record, estimated anew on the device: {', '.join(anew)}."] if anew else []),
        *(
            [
                "A reading is left out, and counted, where the square of its innovation is above "
                f"{settings['gate']:.6g} times its variance."
            ]
            if plan.distance
            else []
        ),
        f"Noise: density of the output {settings['q']:.6g} (m/s^2)^2/Hz, two-sided; variance of a reading "
        f"{settings['r_position']:.6g} m^2."
        + (f" The low-pass, {settings['tau']:.6g} s, is part of the model." if settings["tau"] else "")
        + f" On a stage with less than {least:.2g} m/s^2 rms of acceleration the noise of the output moves "
        "scale_factor by more than its standard deviation says.",
        f"Cost: {without} arithmetic operations a step, {with_reading} with a reading, {most} with every {EVERY}th, "
        "on a Cortex-M4F about one and a half instructions each (emulated, not measured); "
        f"{text.bytes} bytes of state; no allocation, no library.",
        "Bits are equal on every IEEE 754 machine as long as no multiplication is fused with an addition: in C compile "
        "with -ffp-contract=off and without -ffast-math; Rust never fuses.",
    ]
    return [line for part in paragraphs for line in ["", *textwrap.wrap(plain(part), WIDTH)]][1:]


LASTING = ("theta", "U", "D", "memory", "reached", "way", "suspects", "sums", "lost")
"""Fields that a gap leaves as they are, of suspects but for their part in the motion."""


def assigned(text: Text, lasting: bool) -> list[str]:
    """Fields of C at the beginning that a gap leaves as they are, or the others, but for the position."""
    rows = []
    for name, count in text.sizes.items():
        values = text.prior.get(name, [0.0] * max(1, count))
        for j, x in enumerate(values) if name != "p" and (name in LASTING) == lasting else ():
            rows.append(f"    f->{name}{f'[{j}]' if count else ''} = {text.writer.literal(x)};")
    return rows


def c_count(text: Text) -> str:
    """Definition of a sum of counts, which saturates as that of Rust does."""
    return f"""\
/* A number of samples with more of them, 2^32 - 1 at most. */
static uint32_t {text.writer.name}_count(uint32_t samples, uint32_t more)
{{
    return more > UINT32_MAX - samples ? UINT32_MAX : samples + more;
}}
"""


def c_resume(text: Text) -> str:
    """Definition of what goes on behind a gap."""
    name, kind, after = text.writer.name, text.writer.type(), [f"    {line}" for line in text.stages[5]]
    step, whole = map(text.writer.literal, (text.plan.live.settings["dt"], 1.0))
    length = f"    const {kind} gap = {step} * (({kind})missed + {whole}); /* up to the sample behind it, s */"
    zero = text.writer.literal(0.0)
    return f"""\
int {name}_resume({name}_filter *f, {kind} position, uint32_t missed)
{{
    if (!(position * {zero} == {zero})) {{
        return 1;
    }}
{chr(10).join([length, *after]) if after else ""}
    f->earlier = {name}_count(f->earlier, f->n);
    f->missing = {name}_count(f->missing, f->earlier > 0u ? missed : 0u);
{chr(10).join(watching.interrupted(text)) if text.plan.suspects else ""}
    {name}_begin(f, position);
    return 0;
}}
"""


def c_finite(text: Text) -> str:
    """Definition of whether the filter can go on."""
    name, kind, zero = text.writer.name, text.writer.type(), text.writer.literal(0.0)
    rows = [
        f"{name}_are_finite({f'f->{field}' if n else f'&f->{field}'}, {n or 1}u)" for field, n in text.sizes.items()
    ]
    return f"""\
/* Whether so many numbers are. */
static int {name}_are_finite(const {kind} *x, unsigned count)
{{
    unsigned i = 0u;
    while (i < count && x[i] * {zero} == {zero}) {{
        ++i;
    }}
    return i == count;
}}

int {name}_finite(const {name}_filter *f)
{{
    return {f"{chr(10)}        && ".join(rows)};
}}
"""


def rust_resume(text: Text) -> str:
    """Method that goes on behind a gap."""
    kind, step = text.writer.type(), text.writer.literal(text.plan.live.settings["dt"])
    length = f"let gap = {step} * (missed as {kind} + 1.0); // up to the sample behind it, s"
    wait = "".join(f"        {line}\n" for line in ([length, *text.stages[5]] if text.stages[5] else []))
    lasting = [*(name for name in text.sizes if name in LASTING), *text.counters]
    fields = "\n".join(f"            {name}: self.{name}," for name in lasting)
    interrupted = "\n".join(f"    {line}" for line in watching.interrupted(text)) if text.plan.suspects else ""
    return f"""\
    /// Behind a gap of so many missing samples: the motion begins anew at a position (m), the next reading will do.
    ///
    /// # Errors
    /// [`Refused`].
    pub fn resume(&mut self, position: {kind}, missed: u32) -> Result<(), Refused> {{
        if !position.is_finite() {{
            return Err(Refused);
        }}
{wait}        self.earlier = self.earlier.saturating_add(self.n);
        self.missing = self.missing.saturating_add(if self.earlier > 0 {{ missed }} else {{ 0 }});
{interrupted}
        *self = Self {{
            earlier: self.earlier,
            missing: self.missing,
{fields}
            ..Self::new(position)
        }};
        Ok(())
    }}
"""


def step(text: Text) -> list[str]:
    """Body of the step behind its checks."""
    c = text.writer.language == "c"
    kind, me, sign = text.writer.type(), "f->" if c else "self.", "" if text.plan.live.rig.polarity > 0 else "-"
    first, following, reading, correction, again, _ = ([f"        {line}" for line in stage] for stage in text.stages)
    if again != first:
        fresh = "(f->earlier == 0u)" if c else "self.earlier == 0"
        first, again = (["    " + line for line in stage] for stage in (first, again))
        first = [f"        if {fresh} {{", *first, "        } else {", *again, "        }"]
    before = [f"    const {kind} u = output;" if c else "    let u = output;"]
    if text.uses("t"):
        before.append(f"    const double t = {text.time};" if c else f"    let t = {text.time};")
    before += [f"    {kind} {name};" if c else f"    let {name}: {kind};" for name in text.locals]
    older = [
        f"        {kind + ' ' if c else 'let mut '}u1 = {me}u[1]{', ' if c else '; let mut '}u2 = {me}u[2];",
        f"        if {'(' if c else ''}{me}n < 3{'u' if c else ''}{')' if c else ''} {{",
        f"            u1 = {me}u[0] + ({me}u[0] - u);",
        f"            u2 = u1 + ({me}u[0] - u);",
        "        }",
    ]
    zero = text.writer.literal(0.0)
    inside = f"position * {zero} == {zero}"
    return [
        *before,
        f"    if {'(' if c else ''}{me}n == 0{'u' if c else ''}{')' if c else ''} {{",
        *first,
        "    } else {",
        *older,
        *following,
        "    }",
        f"    f->n = {text.writer.name}_count(f->n, 1u);" if c else "    self.n = self.n.saturating_add(1);",
        f"    if {f'({inside})' if c else inside} {{",
        f"        const {kind} z = {sign}position;" if c else f"        let z = {sign}position;",
        *gated(
            text,
            [
                *reading,
                f"        {me}readings = {me}readings + 1{'u' if c else ''};",
                f"        if {'(' if c else ''}{me}readings == {EVERY}{'u' if c else ''}{')' if c else ''} {{",
                *("    " + line for line in correction),
                f"            {me}readings = 0{'u' if c else ''};",
                "        }",
            ],
        ),
        "    }",
        *(watching.due(text) if text.plan.suspects else []),
    ]


def gated(text: Text, reading: list[str]) -> list[str]:
    """Statements that take in a reading, within the gate where there is one."""
    if not text.judged:
        return reading
    c, kind = text.writer.language == "c", text.writer.type()
    names = ("distance", "most")
    return [
        *(f"        {kind} {name};" if c else f"        let {name}: {kind};" for name in names),
        "        {",
        *(f"            {line}" for line in text.judged),
        "        }",
        f"        if {'(distance <= most)' if c else 'distance <= most'} {{",
        *(f"    {line}" for line in reading),
        "        } else {",
        f"            f->rejected = {text.writer.name}_count(f->rejected, 1u);"
        if c
        else "            self.rejected = self.rejected.saturating_add(1);",
        "        }",
    ]


def parameter_list(text: Text) -> str:
    """Arguments of a step."""
    kind = text.writer.type()
    names = ["output", "position", *(f"side_{identifier(name)}" for name in text.plan.side)]
    return ", ".join(f"{kind} {x}" if text.writer.language == "c" else f"{x}: {kind}" for x in names)


def c_header(text: Text) -> str:
    """Declarations."""
    name, kind, m = text.writer.name, text.writer.type(), len(text.plan.free)
    big = name.upper()
    about = "\n".join(f" * {line}".rstrip() for line in comment(text))
    fields = "\n".join(
        f"    {kind} {field}{f'[{count}]' if count else ''}; /* {FIELDS[field]} */"
        for field, count in text.sizes.items()
    )
    counters = "".join(f"    uint32_t {field}; /* {what} */\n" for field, what in text.counters.items())
    places = ",\n".join(f"    {big}_{identifier(plain(x)).upper()} = {i}" for i, x in enumerate(text.plan.names))
    return f"""\
/*
{about}
 *
 * As a static library:
 *   cc -std=c99 -O2 -ffp-contract=off -c {name}.c && ar rcs lib{name}.a {name}.o
 *   cc main.c -L. -l{name}
 * Replay against the live filter of the model; ends with 0 where all estimates agree:
 *   cc -std=c99 -ffp-contract=off {name}.c {name}_replay.c -o {name}_replay && ./{name}_replay
 */
#ifndef {big}_LIVE_FILTER_H
#define {big}_LIVE_FILTER_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

#define {big}_PARAMETERS {m}

/* Places of the parameters. */
enum {{
{places}
}};

typedef struct {{
    uint32_t n; /* samples since the beginning or the last gap */
    uint32_t readings; /* since the last correction */
    uint32_t earlier; /* samples before the last gap */
    uint32_t missing; /* in all gaps */
{counters}{fields}
}} {name}_filter;

/* To the prior of the model, the stage at rest at a position (m): the first reading will do. */
void {name}_init({name}_filter *f, {kind} position);
/* One sample on; 0, or 1 where an argument is not finite and nothing was changed. */
int {name}_step({name}_filter *f, {parameter_list(text)});
/* Behind a gap of so many missing samples: the motion begins anew at a position (m), the next reading will do; 0, or 1
 * where it is not finite and nothing was changed. */
int {name}_resume({name}_filter *f, {kind} position, uint32_t missed);
/* 1 while all numbers of the filter are finite; 0 when one is lost, for ever: only {name}_init helps. */
int {name}_finite(const {name}_filter *f);
/* Position of the stage, m. */
{kind} {name}_position(const {name}_filter *f);
/* Its velocity, m/s. */
{kind} {name}_velocity(const {name}_filter *f);
/* Estimate of a parameter, SI, and its variance. */
{kind} {name}_estimate(const {name}_filter *f, unsigned parameter);
{kind} {name}_variance(const {name}_filter *f, unsigned parameter);
{watching.c_declarations(text) if text.plan.suspects else ""}
#ifdef __cplusplus
}}
#endif

#endif
"""


def c_source(text: Text) -> str:
    """Definitions."""
    name, kind, m = text.writer.name, text.writer.type(), len(text.plan.free)
    tau, sign = text.plan.live.settings["tau"], "" if text.plan.live.rig.polarity > 0 else "-"
    lag = f" + {text.writer.literal(tau)} * f->v" if tau else ""
    sides = [f"side_{identifier(x)}" for x in text.plan.side]
    counters = "".join(f"    f->{field} = 0u;\n" for field in text.counters)
    zero = text.writer.literal(0.0)
    finite = " && ".join(f"{x} * {zero} == {zero}" for x in ["output", *sides])
    return f"""\
/* Live filter; {name}.h says what it does. */
#include "{name}.h"

{strict("bits and covariance")}
#if defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF
#endif

{chr(10).join(text.helpers)}
{c_count(text)}{watching.c_functions(text) if text.plan.suspects else ""}
/* The motion, at rest at a position. */
static void {name}_begin({name}_filter *f, {kind} position)
{{
    f->n = 0u;
    f->readings = 0u;
    f->p = {sign}position;
{chr(10).join(assigned(text, lasting=False))}
}}

void {name}_init({name}_filter *f, {kind} position)
{{
    f->earlier = 0u;
    f->missing = 0u;
{counters}{chr(10).join(assigned(text, lasting=True))}
    {name}_begin(f, position);
}}

int {name}_step({name}_filter *f, {parameter_list(text)})
{{
    if (!({finite})) {{
        return 1;
    }}
{chr(10).join(step(text))}
    return 0;
}}

{c_resume(text)}
{c_finite(text)}
{kind} {name}_position(const {name}_filter *f)
{{
    return {f"-(f->p{lag})" if sign and lag else f"{sign}f->p{lag}"};
}}

{kind} {name}_velocity(const {name}_filter *f)
{{
    return {sign}f->v;
}}

{kind} {name}_estimate(const {name}_filter *f, unsigned parameter)
{{
    return parameter < {m}u ? f->theta[parameter] : {zero};
}}

{kind} {name}_variance(const {name}_filter *f, unsigned parameter)
{{
    unsigned j;
    {kind} sum;
    if (parameter >= {m}u) {{
        return {zero};
    }}
    sum = f->D[parameter];
    for (j = parameter + 1u; j < {m}u; ++j) {{
        const {kind} u = f->U[j * (j - 1u) / 2u + parameter];
        sum = sum + u * u * f->D[j];
    }}
    return sum;
}}
"""


def rust_queries(text: Text) -> str:
    """Methods that read the filter."""
    kind = text.writer.type()
    tau, sign = text.plan.live.settings["tau"], "" if text.plan.live.rig.polarity > 0 else "-"
    lag = f" + {text.writer.literal(tau)} * self.v" if tau else ""
    stage = f"self.p{lag}"
    rows = [f"self.{x}.{'iter().all(|x| x.is_finite())' if n else 'is_finite()'}" for x, n in text.sizes.items()]
    return f"""\
    /// Whether all numbers of the filter are finite. One that is lost stays so: only [`Filter::new`] helps.
    #[must_use]
    pub fn is_finite(&self) -> bool {{
        {f"{chr(10)}            && ".join(rows)}
    }}

    /// Position of the stage, m.
    #[must_use]
    pub fn position(&self) -> {kind} {{
        {f"-({stage})" if sign and lag else f"{sign}{stage}"}
    }}

    /// Its velocity, m/s.
    #[must_use]
    pub fn velocity(&self) -> {kind} {{
        {sign}self.v
    }}

    /// Variance of a parameter, SI; 0 where there is none of that place.
    #[must_use]
    pub fn variance(&self, parameter: usize) -> {kind} {{
        let mut sum = 0.0;
        for (j, d) in self.D.iter().enumerate().skip(parameter) {{
            // `get`, so that the compiler sees that no index can panic
            let u = if j == parameter {{ 1.0 }} else {{ self.U.get(j * (j - 1) / 2 + parameter).map_or(0.0, |u| *u) }};
            sum = sum + u * u * *d;
        }}
        sum
    }}
"""


def rust_state(text: Text) -> str:
    """The type of a filter."""
    kind = text.writer.type()
    fields = "\n".join(
        f"    /// {sentence[0].upper()}{sentence[1:]}.\n    pub {name}: {f'[{kind}; {count}]' if count else kind},"
        for name, count in text.sizes.items()
        for sentence in [FIELDS[name]]
    )
    counters = "".join(
        f"    /// {what[0].upper()}{what[1:]}.\n    pub {field}: u32,\n" for field, what in text.counters.items()
    )
    return f"""\
/// Mean and factors of the covariance, and what a step needs of earlier ones.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Filter {{
    /// Samples since the beginning or the last gap.
    pub n: u32,
    /// Readings since the last correction.
    pub readings: u32,
    /// Samples before the last gap.
    pub earlier: u32,
    /// Samples missing in all gaps.
    pub missing: u32,
{counters}{fields}
}}
"""


def rust_module(text: Text) -> str:
    """The same as a module without the standard library."""
    kind, m = text.writer.type(), len(text.plan.free)
    sign = "" if text.plan.live.rig.polarity > 0 else "-"
    about = "\n".join(f"//! {line}".rstrip() for line in comment(text))
    counters = "".join(f"            {field}: 0,\n" for field in text.counters)
    prior = text.prior
    start = "\n".join(
        f"            {name}: {rust_value(text, prior.get(name, [0.0] * max(1, count)), count)},"
        for name, count in text.sizes.items()
        if name != "p"
    )
    places = "\n".join(
        f"/// Place of {x}.\npub const {identifier(plain(x)).upper()}: usize = {i};"
        for i, x in enumerate(text.plan.names)
    )
    finite = " && ".join(f"{x}.is_finite()" for x in ["output", *(f"side_{identifier(x)}" for x in text.plan.side)])
    return f"""\
{about}
//!
//! As a static library for C, with a panic handler and functions of a C name around `Filter`:
//!   rustc --edition 2021 --crate-type staticlib -C opt-level=3 -C panic=abort lib.rs

#![cfg_attr(rustfmt, rustfmt_skip)]
#![allow(dead_code, non_snake_case, clippy::all, clippy::pedantic)] // symbols of the paper; written by a program

/// Number of parameters.
pub const PARAMETERS: usize = {m};
{places}

/// An argument was not finite, and nothing was changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refused;

impl core::fmt::Display for Refused {{
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {{
        f.write_str("an argument is not finite; nothing was changed")
    }}
}}

impl core::error::Error for Refused {{}}

{rust_state(text)}
{chr(10).join(text.helpers)}
{watching.rust_places(text) if text.plan.suspects else ""}
impl Filter {{
    /// The prior of the model, the stage at rest at a position (m): the first reading will do.
    #[must_use]
    pub const fn new(position: {kind}) -> Self {{
        Self {{
            n: 0,
            readings: 0,
            earlier: 0,
            missing: 0,
{counters}            p: {sign}position,
{start}
        }}
    }}

    /// One sample on.
    ///
    /// # Errors
    /// [`Refused`].
    pub fn step(&mut self, {parameter_list(text)}) -> Result<(), Refused> {{
        if !({finite}) {{
            return Err(Refused);
        }}
{chr(10).join("    " + line for line in step(text))}
        Ok(())
    }}

{rust_resume(text)}
{rust_queries(text)}{watching.rust_methods(text) if text.plan.suspects else ""}}}
"""


def rust_value(text: Text, values: Sequence[float], count: int) -> str:
    """A field's first value."""
    row = ", ".join(text.writer.literal(x) for x in values)
    return f"[{row}]" if count else row


@dataclass(slots=True)
class Replay:
    """A record and what the live filter of the model makes of it."""

    arguments: Array
    """(n, 2 + c) output, position (NaN where it was not read), side channels."""
    values: Array
    """(checks, m) in the order of the program."""
    std: Array
    """Likewise."""
    watched: Array
    """(checks, suspects, 3) log_e, size and std of each."""


def replayed(plan: Program, seed: int = 1) -> Replay:
    """Two tones and noise through the model's own effects, and the live filter run over them, which ends its use."""
    live, settings = plan.live, plan.live.settings
    rng, dt, rig, origins = np.random.default_rng(seed), settings["dt"], live.rig, live._signals.origins
    t = dt * np.arange(RECORD)
    angles = 2.0 * np.pi * np.minimum([2.5, 1.0], 0.025 / dt)
    phases = np.outer(t, angles)
    size = np.array([0.04, 0.05])
    p, v, a, jerk = (
        y @ (size * angles**k)
        for k, y in enumerate([1 - np.cos(phases), np.sin(phases), np.cos(phases), -np.sin(phases)])
    )
    p = p + rig.polarity * settings["x0"][0]
    side = {name: 0.5 * np.sin(2.0 * t + k) for k, name in enumerate(plan.side)}
    k, K0, *others = settings["x0"][MOTION:]
    s = Signals(
        t=t - origins.t, p=p - origins.p, v=v, a=rig.polarity * (a + rig.gravity), jerk=rig.polarity * jerk,
        scale=1.0 + k, bias=K0, rig=rig, side=side,
    )  # fmt: skip
    terms = [term for term in live._terms if term.name in live.names[2:]]
    columns = dict(zip((term.name for term in terms), evaluate(terms, s), strict=True))
    added = {term.name: term.port for term in terms}
    u = K0 + (1.0 + k) * s.a + np.sqrt(settings["q"] / dt) * rng.standard_normal(RECORD)
    z = p + np.sqrt(settings["r_position"]) * rng.standard_normal(RECORD)
    for c, (name, y) in zip(others, columns.items(), strict=True):
        u, z = (u, z + c * y) if added[name] == "position" else (u + c * y, z)
    u = lagged(u, settings["tau"], dt, u[0]) if settings["tau"] else u
    z[1::2] = np.nan
    arguments = np.column_stack([u, z, *(y + origins.of(name) for name, y in side.items())])
    if plan.format is FORMATS["f32"]:
        arguments = arguments.astype(np.float32).astype(np.float64)
    values, std, watched = [], [], []
    for n, row in enumerate(arguments.tolist(), start=1):
        live.step(row[0], None if math.isnan(row[1]) else row[1], **dict(zip(plan.side, row[2:], strict=True)))
        if n in CHECKS:
            values.append(live.values[list(plan.free)])
            std.append(np.sqrt(np.diag(live.covariance))[list(plan.free)])
            watched.append([[suspicion.log_e, suspicion.size, suspicion.std] for suspicion in live.watched])
    return Replay(arguments, np.array(values), np.array(std), np.array(watched))


def table(text: Text, rows: Array, missing: str) -> str:
    """Rows of numbers as a nested array."""
    opening, closing = "{}" if text.writer.language == "c" else "[]"
    lines = []
    for row in rows.tolist():
        cells = ", ".join(missing if math.isnan(x) else text.writer.literal(x) for x in row)
        lines.append(f"    {opening}{cells}{closing}")
    return f"{opening}\n" + ",\n".join(lines) + f"\n{closing}"


def replay_program(text: Text, replay: Replay) -> str:
    """A program that ends with 0 where the exported filter gives the estimates of the live filter of the model."""
    name, kind, precision = text.writer.name, text.writer.type(), text.plan.format.rust
    width, m = replay.arguments.shape[1], len(text.plan.free)
    tolerance = AGREEMENT[precision] * replay.std
    start = text.writer.literal(text.plan.live.rig.polarity * text.plan.live.settings["x0"][0])
    tables, compared, checked = watching.compared(text, replay.watched, AGREEMENT[precision], table)
    count = f"{len(CHECKS)} * ({name}::PARAMETERS{checked})"
    count = count if text.writer.language == "rust" else f"{len(CHECKS)}u * ({m}u{checked})"
    if text.writer.language == "rust":
        arguments = ", ".join(f"row[{j}]" for j in range(width))
        return f"""\
//! Replays a record through the exported filter and compares with the live filter of the model; 0 where all agree.
mod {name};

const RECORD: [[{kind}; {width}]; {RECORD}] = {table(text, replay.arguments, f"{kind}::NAN")};
const AFTER: [usize; {len(CHECKS)}] = {list(CHECKS)};
const EXPECTED: [[{kind}; {m}]; {len(CHECKS)}] = {table(text, replay.values, "0.0")};
const TOLERANCE: [[{kind}; {m}]; {len(CHECKS)}] = {table(text, tolerance, "0.0")};
{tables}
fn main() {{
    let mut filter = {name}::Filter::new({start});
    let mut failed = 0;
    for (i, row) in RECORD.iter().enumerate() {{
        failed += i32::from(filter.step({arguments}).is_err() || !filter.is_finite());
        for (k, after) in AFTER.iter().enumerate() {{
            for j in 0..{name}::PARAMETERS {{
                let far = !((filter.theta[j] - EXPECTED[k][j]).abs() <= TOLERANCE[k][j]);
                failed += i32::from(i + 1 == *after && far);
            }}
{compared}        }}
    }}
    println!("{{failed}} of {{}} estimates disagree", {count});
    std::process::exit(i32::from(failed != 0));
}}
"""
    arguments = ", ".join(f"record[i][{j}]" for j in range(width))
    return f"""\
/* Replays a record through the exported filter and compares with the live filter of the model; 0 where all agree. */
#include <math.h>
#include <stdio.h>
#include "{name}.h"

static const {kind} record[{RECORD}][{width}] = {table(text, replay.arguments, "NAN")};
static const unsigned after[{len(CHECKS)}] = {{ {", ".join(f"{n}u" for n in CHECKS)} }};
static const {kind} expected[{len(CHECKS)}][{m}] = {table(text, replay.values, "0.0")};
static const {kind} tolerance[{len(CHECKS)}][{m}] = {table(text, tolerance, "0.0")};
{tables}
int main(void)
{{
    {name}_filter filter;
    unsigned i, j, k, failed = 0u;
    {name}_init(&filter, {start});
    for (i = 0u; i < {RECORD}u; ++i) {{
        if ({name}_step(&filter, {arguments}) != 0 || !{name}_finite(&filter)) {{
            ++failed;
        }}
        for (k = 0u; k < {len(CHECKS)}u; ++k) {{
            for (j = 0u; j < {m}u && i + 1u == after[k]; ++j) {{
                const {kind} error = {name}_estimate(&filter, j) - expected[k][j];
                if (!(error <= tolerance[k][j] && error >= -tolerance[k][j])) {{
                    ++failed;
                }}
            }}
{compared}        }}
    }}
    printf("%u of %u estimates disagree\\n", failed, {count});
    return failed != 0u;
}}
"""


def filter_files(
    live: LiveModel, name: str, language: Language, precision: Precision, source: str = ""
) -> dict[str, str]:
    """Files of an exported filter by name: the code, and the program that replays a record.

    Parameters
    ----------
    live : a filter that has received nothing yet; it is used up.
    name : of the files, and the beginning of what they define.
    source : name of the model file.

    Raises
    ------
    NotExportable
        Naming the effect that cannot be traced, or the setting that a device's filter has not.
    """
    plan = program(live, precision)
    stem = identifier(name)
    text = Text(plan, Writer(language, plan.format, stem), source or "a fit")
    code = (
        {f"{stem}.rs": rust_module(text)}
        if language == "rust"
        else {f"{stem}.h": c_header(text), f"{stem}.c": c_source(text)}
    )
    return code | {f"{stem}_replay.{'rs' if language == 'rust' else 'c'}": replay_program(text, replayed(plan))}
