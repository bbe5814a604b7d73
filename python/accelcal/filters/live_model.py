"""A model tracked live: catalogue effects as parameters of a fixed-rate filter."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, NoReturn

import numpy as np

from accelcal._support.arguments import HOW_TO, kind_of
from accelcal._support.errors import AccelcalError
from accelcal.data import GRAVITY, Array, Rig, unsupported
from accelcal.data.arrays import copied
from accelcal.data.rig import MOST_POSITION
from accelcal.effects import BUILT_IN, Effect, find, is_local
from accelcal.effects.building_blocks import carried_on, lag_weights
from accelcal.effects.own import probe
from accelcal.filters.choice import GaussMarkov, rate_and_density
from accelcal.filters.stream import FACTORED, MOST_EFFECTS, fixed_rate_with_effects
from accelcal.model import Estimate, Model, Prior, Term, terms_of
from accelcal.signals.signals import Origins, Signals

INSTANTS = np.array([0.0, 0.5, 1.0])
"""Where effects are evaluated, shares of a step."""


def newton(x: float) -> list[float]:
    """Weights of the end and of the three backward differences there, in the cubic at a share of the step, (4,)."""
    return [1.0, x - 1.0, 0.5 * x * (x - 1.0), x * (x - 1.0) * (x + 1.0) / 6.0]


CUBIC = np.array(
    [
        [newton(x) for x in INSTANTS],
        [[0.0, 1.0, x - 0.5, 0.5 * x * x - 1.0 / 6.0] for x in INSTANTS],
        [[0.0, 0.0, 1.0, x] for x in INSTANTS],
    ]
)
"""(3, 3, 4): value and two derivatives by the share of the step, at the three instants, of end and differences."""


class CausalSignals:
    """Signals over one step from what a live filter knows then, with the fields that `smoothed_signals` fills offline.

    Position and velocity are predicted from the filter's state. The specific force is the output at the present
    estimates, a cubic through the last four samples, with all its noise and the low-pass undone; jerk is its
    derivative. Corners are rounded by the noise left and by the largest motion so far.
    """

    def __init__(self, rig: Rig, origins: Origins, step: float, q: float) -> None:
        self.rig, self.origins, self.step = rig, origins, step
        self.tau = rig.lowpass_tau
        self.a_std = math.sqrt(q / step)
        self.t = -origins.t
        self.outputs: tuple[float, ...] = ()
        self.reached = np.zeros((2, 1))
        self.way: Array = np.empty(0)
        """Lowest and highest position so far, m from the model's origin."""

    def over(self, u: float, added: Array, x: Array, variances: Array, side: Mapping[str, float]) -> Signals:
        """Signals (3,) at the sample before, half-way and at that of output `u` (m/s²); all here if none is before.

        Parameters
        ----------
        added : (2,) what the effects add to the output at the sample before, m/s², and how much more they add here.
        x, variances : state of the filter at the sample before, position, velocity, k and K0 first, SI.
        side : side channels; temperature in degC.
        """
        (p, v, k, K0), polarity = x[:4], self.rig.polarity
        h = self.step if self.outputs else 0.0
        output, slope, curvature = self._output_with_derivatives(u) / (1.0 + k)
        rise = added[1] / (1.0 + k)
        force = output - (K0 + added[0]) / (1.0 + k) - INSTANTS * rise
        slope = (slope - rise) / self.step
        curvature = curvature / self.step**2
        first, middle, last = moving = force - polarity * self.rig.gravity
        # The velocity of a parabola through the three, and the position that goes with it.
        speed = v + h / 24.0 * np.array([0.0, 5.0 * first + 8.0 * middle - last, 4.0 * (first + 4.0 * middle + last)])
        place = p + h * np.array([0.0, 0.25 * (speed[0] + speed[1]), (speed[0] + 4.0 * speed[1] + speed[2]) / 6.0])
        p, v, a = (
            polarity * (place + self.tau * speed) - self.origins.p,
            polarity * (speed + self.tau * moving),
            force + self.tau * slope,
        )
        signals_of = partial(
            Signals,
            t=self.t + h * (INSTANTS - 1.0),
            jerk=slope + self.tau * curvature,
            scale=1.0 + k,
            bias=K0,
            rig=self.rig,
            side={name: np.zeros(3) + (y - self.origins.of(name)) for name, y in side.items()},
            side_origins=self.origins.side,
            p_std=np.sqrt(variances[0]),
            v_std=np.sqrt(variances[1]),
            a_std=self.a_std,
        )
        reached = np.maximum(self.reached, np.max(np.abs(np.stack([a, v])), axis=1, keepdims=True))
        way = np.concatenate([self.way, p])
        whole = signals_of(p=np.stack([np.min(way), np.max(way)]), v=reached[1], a=reached[0])
        return signals_of(p=p, v=v, a=a, whole=whole)

    def advance(self, u: float, signals: Signals) -> None:
        """The sample of output `u`, whose signals these were, has been taken in."""
        assert signals.whole is not None
        self.reached, self.way = np.stack([signals.whole.a, signals.whole.v]), signals.whole.p
        self.t, self.outputs = self.t + self.step, (*self.outputs[-2:], u)

    def restart(self, t: float) -> float:
        """The next sample is `t` (s) after the first one, and none is before it; the time from the last one, s."""
        last = self.t - self.step if self.outputs else self.t
        self.t, self.outputs = t - self.origins.t, ()
        return max(0.0, self.t - last)

    def _output_with_derivatives(self, u: float) -> Array:
        """Output at the three instants and its first and second derivatives per step, (3, 3): the filter's own cubic
        through the last four samples, a line while there are fewer."""
        before = self.outputs[-1] if self.outputs else u
        differences = [u - before, 0.0, 0.0]
        if len(self.outputs) == 3:
            rise = before - self.outputs[1]
            bend = differences[0] - rise
            differences[1:] = bend, bend - (rise - (self.outputs[1] - self.outputs[0]))
        return np.asarray(CUBIC @ np.array([u, *differences]))


SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0
"""Weights of the three instants in a mean over the step."""
WIDE = 30.0
"""Standard deviation before the first sample where the model gives no prior, in typical sizes of the coefficient."""
DIFFUSE = 1e4
"""Variance of the first position over that of one reading."""
SENSOR = ("scale_factor", "bias")
"""Coefficients that the filter's sensor has by itself, in the filter's order."""
MOTION = 2
"""States before the coefficients: position and velocity."""


BETWEEN_STARTS = 10.0
"""Time between two starts of a watch at least, s; later on it is an eighth of the time that the watch has run."""
FALSE_NAMES = 0.005
"""Probability that a watch names anything, at whatever time, while the model holds."""
CLASS_WEIGHT = 0.95
"""Of the suspects that are named together, in all e-values."""


@dataclass(frozen=True, slots=True)
class Suspicion:
    """An effect that the model lacks, and how much the innovations say for it."""

    name: str
    unit: str
    """Of size and std."""
    size: float
    """Coefficient given the innovations `since` then, with a prior of 1, 10 or 100 typical sizes."""
    std: float
    log_e: float
    """Natural logarithm of the e-value: while the model holds, E exceeds 1/alpha at any time with probability alpha."""
    since: float
    """How long ago the likelier start is, s: the begin of the watch, or the newest."""


class LiveModel:
    """Bias, scale factor and every effect of a model, estimated from output and position as they arrive.

    ACI at a fixed rate: u = K0 + (1 + k) f + sum c_j e_j, the effects e_j by the functions that a fit uses, on causal
    signals (`CausalSignals`); how an effect leans on the state is left out of the gradient. `time_offset` is taken to
    first order, -(1 + k) t0 jerk, so it should be small against a period of the motion. Steps have no integration error
    and the covariance is kept in UD factors, so no variance falls below zero at any rate or prior.

    Coefficients of effects that the model holds fixed are no states: what they add is subtracted. The others start from
    the model's prior, or from zero with 30 typical sizes. A random process of the model (`scale_gauss_markov`, ...) is
    one more state: what it adds to its parameter at present, which the estimate under its name is. An effect with
    memory begins as after a long rest and goes on from step to step. One that acts on the noise is part of `q` and
    `r_position`.

    Parameters
    ----------
    model : base and effects.
    rig : mount, gravity and declared low-pass.
    rate : samples of the output per second, Hz.
    q : two-sided density of the output's noise, (m/s²)² s: N²/2 for a one-sided density N.
    r_position : variance of a position reading, m².
    position : position of the stage at the first sample, m: the first reading will do.
    speed : a speed that the stage surely does not exceed there, m/s.
    origins : zero points of time, position and side channels; the first sample is at time zero.
    covariance : (m, m) of the first coefficients as the filter begins, those in `names`; by default that of the priors.
    gauss_markov : coefficients that are not constant, by name.
    order : first- or second-order filter.
    gate : reject readings with e²/S above this; None for no gate.
    watch : suspects, effects that the model lacks, with one coefficient and no shape parameter each, or steps;
        `watched` is what the innovations say for each of them, `named` what is there.

    Raises
    ------
    ValueError
        For an effect that cannot be tracked live, by name, for more than 14 coefficients besides bias and scale that
        are not fixed, and for a rate that is not positive, or another setting that is negative or not finite.

    Examples
    --------
    >>> model = Model.linear().add("quadratic")
    >>> live = LiveModel(model, Rig(), rate=1000.0, q=1e-8, r_position=1e-12, position=0.0)
    >>> live.step(0.02, 0.0), live.step(0.02)
    (0.0, None)
    >>> live["quadratic"].unit
    '(m/s²)⁻¹'
    """

    def __init__(
        self,
        model: Model,
        rig: Rig,
        *,
        rate: float,
        q: float,
        r_position: float,
        position: float,
        speed: float = 1.0,
        origins: Origins | None = None,
        gauss_markov: Mapping[str, GaussMarkov] | None = None,
        covariance: Array | None = None,
        order: Literal[1, 2] = 1,
        gate: float | None = None,
        watch: Sequence[str] = (),
    ) -> None:
        _require_kinds(model, rig, watch)
        if not 0 < rate < math.inf:
            raise AccelcalError(f"LiveModel: rate = {rate:g} Hz; give the samples of the output per second.")
        _require_amounts(q=q, r_position=r_position, speed=speed, gate=math.inf if gate is None else gate)
        if not math.isfinite(position):
            raise AccelcalError(f"LiveModel: position = {position:g} m; give where the stage is at the first sample.")
        for name in model.effects:
            if (reason := refusal(find(name), model.shapes.get(name))) is not None:
                raise AccelcalError(f"{name} cannot be tracked live: {reason}.")
        terms, processes = live_terms(model)
        self.model, self.rig = model, rig
        self.names = state_names(model)
        """Coefficients in the order of `values` and `covariance`."""
        self._terms, states = tuple(terms.values()), {name: j for j, name in enumerate(self.names[len(SENSOR) :])}
        self._parts = [
            _Part.of([term for term in self._terms if term.effect is effect], states, model.fixed)
            for effect in {term.effect.name: term.effect for term in self._terms}.values()
            if effect.name not in SENSOR
        ]
        self._parts = [part for part in self._parts if part.states or np.any(part.values)]
        """Effects whose coefficients are states, or fixed at another value than zero."""
        self._suspects = suspects_of(model, watch)
        self._m = m = len(states)
        self._parts += [_Part.of([term], {term.name: m + j}, {}) for j, term in enumerate(self._suspects)]
        if m > MOST_EFFECTS:
            raise AccelcalError(
                f"a live filter has room for {MOST_EFFECTS} coefficients beside bias and scale_factor; "
                f"the model has {m}: drop some, or hold some at a value."
            )
        moving = {**processes, **(gauss_markov or {})}
        if unknown := sorted(set(moving) - set(self.names)):
            raise AccelcalError(f"gauss_markov: {', '.join(unknown)} not in the model; it has {', '.join(self.names)}.")
        if refused := unsupported(rig.filters, "a live filter"):
            raise AccelcalError(refused)
        beliefs = [belief(model, terms[name], processes) for name in self.names]
        spread = np.diag([prior.std**2 for prior in beliefs])
        if covariance is not None:
            spread[: len(covariance), : len(covariance)] = covariance
        self._tau = tau = rig.lowpass_tau
        self._motion = DIFFUSE * r_position * np.diag([1.0, 0.0]) + np.outer([-tau, 1.0], [-tau, 1.0]) * speed**2
        """Covariance of position and velocity where a filter begins: behind a low-pass tau v behind the stage."""
        self.settings: dict[str, Any] = {
            "dt": 1.0 / rate,
            "q": q,
            "r_position": r_position,
            "rest": rig.polarity * rig.gravity,
            "tau": tau,
            "parameters": [moving.get(name) for name in self.names],
            "choice": replace(FACTORED, order=order, scores=True),
            "gate": gate,
            "watch": ([term.effect.prior.typical for term in self._suspects], math.ceil(BETWEEN_STARTS * rate)),
        }
        """Those of `fixed_rate_with_effects`; the start is that of the last beginning."""
        self._prior_at(position, np.array([prior.mean for prior in beliefs]), spread)
        self._filter = fixed_rate_with_effects(**self.settings)
        self._signals = CausalSignals(rig, origins or Origins(), 1.0 / rate, q)
        self._lag = lag_weights(tau, 0.5 / rate) if tau > 0.0 else None
        self._x, self._variances = np.zeros((2, MOTION + 2 + m))
        self._columns, self._constant = np.zeros((3, m + len(self._suspects))), np.zeros(3)
        self._memories: list[list[float]] = [[] for _ in self._parts]
        self._side: dict[str, float] = {}
        self._steps, self._holes = 0, list[tuple[int, float]]()

    def _prior_at(self, position: float, values: Array, covariance: Array, velocity: float = 0.0) -> None:
        """Set the prior: nothing known of the motion but the place, and the likely velocity."""
        P0 = np.zeros((MOTION + len(values),) * 2)
        P0[:MOTION, :MOTION], P0[MOTION:, MOTION:] = self._motion, covariance
        p, v = self.rig.polarity * (position - self._tau * velocity), self.rig.polarity * velocity
        self.settings |= {"x0": np.array([p, v, *values]), "P0": P0}

    def __reduce__(self) -> NoReturn:
        raise TypeError("a LiveModel is a running filter and cannot be pickled or copied; make another one")

    def step(self, u: float, z: float | None = None, early: float = 0.0, **side: float) -> float | None:
        """Take in the next sample: output (m/s²), position (m) where it was read, side channels where they changed.

        Side channels are in SI, temperature in degC; the last value holds, NaN is none. Position that was read
        `early` (s) before the sample, by less than a step, is carried to it along the motion. Returns the innovation,
        m, or None.

        Raises
        ------
        ValueError
            If a side channel that an effect needs was never given.
        FilterError
            If the step fails; the filter is then as it was before it.
        """
        if GRAVITY in side:
            raise AccelcalError(
                f"{GRAVITY}: a live filter takes gravity along the axis as constant; give the rig's, and fit a record"
            )
        most, h = self.rig.sensor.most_output, self._signals.step
        if not (abs(u) <= most and abs(early) < h and (z is None or abs(z) <= MOST_POSITION)):
            raise AccelcalError(
                f"LiveModel.step: output {u!r}, position {z!r}, early {early!r}; expected an output of at most "
                f"±{most:g} m/s², a position of at most ±{MOST_POSITION:g} m, None where it was not read, and early "
                f"less than a step, {h:g} s. Leave this sample out"
            )
        self._side.update({name: value for name, value in side.items() if not math.isnan(value)})
        self._require_side()
        self._filter.read(self._x, self._variances)
        signals, step, way = self.until(u, early)
        polarity = self.rig.polarity
        z = None if z is None else polarity * (z + way - step.reading)
        e = self._filter.step_with_effects(u - step.constant[2], z, step.columns, step.position_columns, step.slopes)
        self._columns, self._constant, self._memories = step.columns, step.constant, step.memories
        self._signals.advance(u, signals)
        self._steps += 1
        return None if e is None else polarity * e

    def until(self, u: float, early: float = 0.0) -> tuple[Signals, Step, float]:
        """Signals over the step to output `u` (m/s²), what the effects add over it, and the way (m) from a reading that
        is `early` (s); nothing is changed."""
        before, _, here = self._columns[:, : self._m] @ self._x[MOTION + len(SENSOR) :] + self._constant
        added = np.stack([here, here - before])  # a line through the last step
        signals = self._signals.over(u, added, self._x, self._variances, self._side)
        reading, way = (signals, 0.0) if early == 0.0 else before_sample(signals, early)
        return signals, self._evaluate(signals, reading), way

    def restart(self, position: float, velocity: float, t: float) -> None:
        """Go on behind a hole of the output: coefficients and memories as they are, random processes as much later as
        the hole is long, the motion unknown but for the position (m) of the stage at the next sample and its likely
        velocity (m/s), `t` (s) after the first one."""
        gap = self._signals.restart(t)
        self._holes.append((self._steps, gap))
        self._prior_at(position, *waited(self.settings["parameters"], gap, self.values, self.covariance), velocity)
        self._filter.begin(self.settings["x0"], self.settings["P0"])
        self._columns, self._constant = np.zeros_like(self._columns), np.zeros_like(self._constant)

    def run(self, u: Array, z: Array, **side: Array) -> None:
        """Take a record in, (n,) each; NaN where position was not read."""
        if any(np.shape(y) != np.shape(u) or np.ndim(y) != 1 for y in (u, z, *side.values())):
            shapes = ", ".join(str(np.shape(y)) for y in (u, z, *side.values()))
            raise AccelcalError(
                f"LiveModel.run: arrays of shapes {shapes}; expected (n,) each, NaN where none was read"
            )
        u, z, side = copied(u), copied(z), {name: copied(y) for name, y in side.items()}
        for j in range(len(u)):
            read = float(z[j])
            here = {name: float(y[j]) for name, y in side.items()}
            self.step(float(u[j]), None if math.isnan(read) else read, **here)

    def __getitem__(self, name: str) -> Estimate:
        """The present estimate of a coefficient."""
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise KeyError(f"{name!r} is not in the model; it has {', '.join(self.names)}")

    @property
    def values(self) -> Array:
        """(m,) SI."""
        return self._filter.x[MOTION:]

    @property
    def covariance(self) -> Array:
        """(m, m) SI."""
        return self._filter.covariance[MOTION:, MOTION:]

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Every coefficient with its standard deviation, in the model's order."""
        values = {**self.model.fixed, **dict(zip(self.names, self.values.tolist(), strict=True))}
        std = dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))
        return tuple(
            Estimate(t.name, t.symbol, t.unit, values[t.name], std.get(t.name, 0.0), t.owner) for t in self._terms
        )

    @property
    def innovation_variance(self) -> float | None:
        """Variance of the newest innovation that the model expects, m²."""
        return self._filter.innovation_variance

    @property
    def nis(self) -> float | None:
        """Normalised square of the newest innovation, e²/S."""
        return self._filter.nis

    @property
    def score(self) -> tuple[float, ...] | None:
        """Of the newest innovation: what those before it do not predict (m), its variance, the share of the reading's
        noise in that, slopes of the log-likelihood by scale factor and bias, their variances and covariance; None at
        the start."""
        score = self._filter.score
        return None if score is None else tuple(score)

    @property
    def rejected(self) -> int:
        """Readings that the gate rejected."""
        return self._filter.rejected

    @property
    def noisy_names(self) -> set[str]:
        """Coefficients whose gradient follows from the output, which carries noise; the scale factor is one of them."""
        added = self.names[len(SENSOR) :]
        return {SENSOR[0], *(added[j] for part in self._parts if part.noisy for j in part.states if j < self._m)}

    @property
    def watched(self) -> tuple[Suspicion, ...]:
        """What the innovations so far say for each suspect, in the order of `watch`."""
        rows, rate = self._filter.evidence.tolist(), 1.0 / self.settings["dt"]

        def ago(since: float) -> float:
            return since + sum(gap for steps, gap in self._holes if steps > self._steps - since * rate)

        return tuple(
            Suspicion(term.name, term.unit, size, std, log_e, ago(since))
            for term, (log_e, size, std, since, *_) in zip(self._suspects, rows, strict=True)
        )

    def named(self, alpha: float = FALSE_NAMES) -> tuple[Suspicion, ...]:
        """Suspects of which one is there, the likeliest first; none while chance explains them.

        Parameters
        ----------
        alpha : probability that anything is named, at whatever time, while the model holds and the noise of the output
            is small beside the motion.
        """
        if not 0.0 < alpha < 1.0:
            raise AccelcalError(f"LiveModel.named: alpha = {alpha:g}; expected a probability between 0 and 1")
        watched = (suspicion for suspicion in self.watched if math.isfinite(suspicion.log_e))
        ordered = sorted(watched, key=lambda suspicion: -suspicion.log_e)
        if not ordered or ordered[0].log_e - math.log(len(self._suspects)) <= -math.log(alpha):
            return ()
        weights = np.exp([suspicion.log_e - ordered[0].log_e for suspicion in ordered])
        return tuple(ordered[: int(np.searchsorted(np.cumsum(weights), CLASS_WEIGHT * np.sum(weights))) + 1])

    def _require_side(self) -> None:
        for part in self._parts:
            for name in part.effect.needs:
                if name not in self._side:
                    raise AccelcalError(
                        f"{part.effect.name} needs the channel {name!r}, which was never given: "
                        f"call step(u, z, {name}=...) with the first sample."
                    )

    def _evaluate(self, s: Signals, reading_signals: Signals) -> Step:
        """What effects add over the step, and to a reading at the last of its signals; what those with memory hold."""
        columns = np.zeros_like(self._columns)
        position_columns, slopes = np.zeros_like(columns[0]), np.zeros_like(columns[0])
        constant, reading, memories = np.zeros_like(self._constant), 0.0, []
        for part, before in zip(self._parts, self._memories, strict=True):
            signals = reading_signals if part.position else s
            y, after = part.over(signals, before)
            memories.append(after)
            if part.position:
                position_columns[part.states] = self.rig.polarity * y[2, part.tracked]
                reading += y[2] @ part.values if part.values.any() else 0.0
                continue
            columns[:, part.states] = y[:, part.tracked]
            if part.values.any():
                constant = constant + y @ part.values
            if part.noisy and s.a_std > 0.0:
                up, down = (part.over(replace(s, a=s.a + way), before)[0] for way in (s.a_std, -s.a_std))
                slopes[part.states] = SIMPSON @ (up - down)[:, part.tracked] / (2.0 * s.a_std * s.scale)
        if self._lag is not None and self._filter.samples > 0:
            for behind, begun in ((columns, self._columns), (constant, self._constant)):
                decay, old, new = self._lag
                middle = decay * begun[2] + old * behind[0] + new * behind[1]
                behind[:] = np.stack([begun[2], middle, decay * middle + old * behind[1] + new * behind[2]])
        return Step(columns, position_columns, slopes, constant, reading, memories)


def waited(
    parameters: Sequence[GaussMarkov | None], gap: float, values: Array, covariance: Array
) -> tuple[Array, Array]:
    """Values (m,) and covariance (m, m) of parameters after a time without readings, s."""
    rates, q = np.array([rate_and_density(moves) for moves in parameters]).T
    stays = np.exp(-rates * gap)
    # The integral of q exp(-2 rate s) over the gap; of a walk q gap.
    grown = q * np.where(rates > 0.0, -np.expm1(-2.0 * rates * gap) / np.where(rates > 0.0, 2.0 * rates, 1.0), gap)
    return stays * values, np.outer(stays, stays) * covariance + np.diag(grown)


MOST_SHARE = 0.15
"""Power of the noise over that of the motion up to which the scale factor is within its uncertainty
(docs/measured.md)."""


def noise_in_band(q: float, r_position: float, step: float, apart: float) -> float:
    """Power of the output's noise in the band in which a filter believes the output, (m/s²)²."""
    crossover = math.sqrt(math.sqrt(q / (r_position * apart))) / (2.0 * math.pi)
    return 2.0 * q * min(crossover, 0.5 / step)


def before_sample(s: Signals, early: float) -> tuple[Signals, float]:
    """Signals whose last values are those `early` (s) before the last time, and the way from there, m."""
    t, p, v = s.t.copy(), s.p.copy(), s.v.copy()
    a = float(s.rig.polarity * s.a[-1] - s.rig.gravity)
    way = early * (float(v[-1]) - 0.5 * early * a)
    t[-1], p[-1], v[-1] = t[-1] - early, p[-1] - way, v[-1] - early * a
    return replace(s, t=t, p=p, v=v), way


@dataclass(frozen=True, slots=True)
class Step:
    """What effects add over one step."""

    columns: Array
    """(3, m) to the low-passed output per unit of each state, m/s²."""
    position_columns: Array
    """(m,) to a reading per unit of each state, m, along the filter's axis."""
    slopes: Array
    """(m,) to the output per unit of each state and of the output, 1."""
    constant: Array
    """(3,) to the low-passed output by coefficients that are fixed, m/s²."""
    reading: float
    """To a reading by those, m."""
    memories: list[list[float]]
    """What each effect holds at the end."""


@dataclass(frozen=True, slots=True)
class _Part:
    """One effect: which of its columns are states, and what the others are multiplied by."""

    effect: Effect
    shape: Mapping[str, float]
    """As after a long rest."""
    position: bool
    tracked: list[int]
    """Columns that are states."""
    states: list[int]
    """Which states."""
    values: Array
    """Fixed coefficient of each column; 0 for a state."""
    noisy: bool
    """Whether it follows from the acceleration at the same instant, which carries the noise of the output."""

    def over(self, s: Signals, before: list[float]) -> tuple[Array, list[float]]:
        """Its columns over a step, (3, width), and what it holds at the end, from what it held `before`."""
        y, after = carried_on(before, partial(self.effect.column, s, **self.shape))
        return y.reshape(len(y), -1), after

    @classmethod
    def of(cls, terms: list[Term], states: Mapping[str, int], fixed: Mapping[str, float]) -> _Part:
        """From all terms of one effect."""
        first = terms[0]
        tracked = [term.part for term in terms if term.name in states]
        values = np.array([0.0 if term.name in states else fixed[term.name] for term in terms])
        shape = first.effect.rested(first.shape)
        places, position = [states[terms[i].name] for i in tracked], first.port == "position"
        noisy = bool(places) and not position and follows_acceleration(first.effect, shape)
        return cls(first.effect, shape, position, tracked, places, values, noisy)


def suspects_of(model: Model, watch: Sequence[str]) -> tuple[Term, ...]:
    """Coefficients of effects that a model lacks, for a watch.

    Raises
    ------
    ValueError
        For an effect that the model has, that occurs twice, or that a watch cannot follow; the sentence says why.
    """
    terms: list[Term] = []
    for name in watch:
        effect = suspect_of(name)
        wrong = (
            "the model has it already"
            if effect.name in model.effects
            else "it is given twice"
            if effect.name in (term.name for term in terms)
            else unwatched(effect)
        )
        if wrong:
            raise AccelcalError(f"{effect.name} cannot be watched: {wrong}.")
        terms += terms_of(effect)
    return tuple(terms)


def suspect_of(name: str) -> Effect:
    """An effect as a watch follows it: a step is what steps, since each start of a watch is an instant."""
    effect = find(name)
    if tuple(effect.shapes) != ("instant",) or not effect.traits.changes:
        return effect
    steps = find(effect.traits.changes)
    return replace(steps, name=effect.name, symbol=effect.symbol, prior=effect.prior)


def watchable(model: Model, channels: Collection[str]) -> tuple[str, ...]:
    """Effects that a model lacks and a watch can follow, as far as these side channels go."""
    lacking = (effect for effect in BUILT_IN if effect.traits.visible and effect.name not in model.effects)
    return tuple(e.name for e in lacking if set(e.needs) <= set(channels) and not unwatched(suspect_of(e.name)))


def unwatched(effect: Effect) -> str:
    """Why a watch cannot follow an effect; empty where it can."""
    if effect.port not in ("output", "position"):
        return "it acts on the noise, and a watch follows the mean"
    if effect.shapes or effect.width > 1:
        return "it has shape parameters or several coefficients, and a watch follows one; fit it to a record"
    if refusal(effect) is None and follows_change(effect):
        return "it follows how fast the output changes, whose noise passes for it; fit it to a record"
    return refusal(effect) or ""


def state_names(model: Model) -> tuple[str, ...]:
    """Coefficients of a model that are states of a `LiveModel`, in its order."""
    return (*SENSOR, *(name for name in live_terms(model)[0] if name not in SENSOR and name not in model.fixed))


def refusal(effect: Effect, shape: Mapping[str, float] | None = None) -> str | None:
    """Why an effect cannot be tracked live; None where it can.

    Effects of the catalogue with memory go on from step to step by the blocks that they are made of. Of an effect of
    the user's own that is not known: it can be tracked where its values on parts of a motion are those on the whole.
    """
    changes = (
        effect.traits.changes if effect.port == "process" else effect.mechanism.carrier if effect.mechanism else ""
    )
    if changes:
        return refusal(find(changes), shape)
    given = {name: value for name, value in (shape or {}).items() if name in effect.shapes}
    if effect.port == "noise" or effect in BUILT_IN or is_local(effect) or _is_pointwise(effect, given):
        return None
    return "an effect of your own that looks at other times than the present; fit it to a record"


def follows_acceleration(effect: Effect, shape: Mapping[str, float]) -> bool:
    """Whether the values of an effect at some times change with the acceleration there."""
    s = probe(effect.needs)
    here, moved = (effect.column(signals, **shape) for signals in (s, replace(s, a=s.a + 1e-3)))
    return not np.array_equal(here, moved)


def follows_change(effect: Effect) -> bool:
    """Whether the values of an effect follow from changes of the acceleration, which live are mostly noise."""
    s = probe(effect.needs)
    moved = replace(s, jerk=s.jerk + 1.0) if not effect.traits.memory else replace(s, jerk=s.jerk + 1.0, a=2.0 * s.a)
    return not np.array_equal(effect.column(s), effect.column(moved))


def _is_pointwise(effect: Effect, shape: Mapping[str, float]) -> bool:
    """Whether the values of an effect at some times are the same when the times before and behind them are cut off."""
    whole = probe(effect.needs)
    y = effect.column(whole, **shape)
    cuts = [slice(k, k + 3) for k in range(0, len(whole.t) - 2, 3)]
    return all(np.allclose(y[cut], effect.column(whole.part(cut), **shape), rtol=1e-9, atol=0.0) for cut in cuts)


def live_terms(model: Model) -> tuple[dict[str, Term], dict[str, GaussMarkov]]:
    """Coefficients that a filter tracks, by name, and how those move that are random processes.

    A fit expands a process in cosines of the record; a filter has the process itself, one state, which multiplies what
    its parameter does.

    Raises
    ------
    ValueError
        If a process has no standard deviation yet.
    """
    terms: dict[str, Term] = {}
    processes: dict[str, GaussMarkov] = {}
    for term in model.terms:
        effect = term.effect
        if effect.port != "process":
            terms[term.name] = term
            continue
        if effect.name in terms:
            continue
        if term.name not in model.priors:
            raise AccelcalError(f"{effect.name} has no standard deviation; fit it to a record first.")
        parameter, std = find(effect.traits.changes), model.priors[term.name].std
        shape = {name: term.shape[name] for name in parameter.shapes}
        terms[effect.name] = Term(replace(parameter, name=effect.name, symbol=effect.symbol), 0, shape)
        tau = term.shape.get("tau", math.inf)
        processes[effect.name] = GaussMarkov(std**2 if tau == math.inf else 2.0 * std**2 / tau, tau)
    return terms, processes


def belief(model: Model, term: Term, processes: Mapping[str, GaussMarkov]) -> Prior:
    """What is believed of a coefficient before the first sample."""
    if term.name in processes:  # a walk starts at its parameter, a Gauss-Markov process anywhere
        moves = processes[term.name]
        return Prior(0.0, 0.0 if moves.tau == math.inf else math.sqrt(0.5 * moves.q * moves.tau))
    if term.name in model.fixed:
        return Prior(model.fixed[term.name], 0.0)
    return model.priors.get(term.name, Prior(0.0, WIDE * term.effect.prior.typical))


def _require_kinds(model: object, rig: object, watch: object) -> None:
    """Refuse arguments of `LiveModel` of another kind, with how to make the right one."""
    for argument, value, kind in (("model", model, Model), ("rig", rig, Rig)):
        if not isinstance(value, kind):
            raise TypeError(f"LiveModel: {argument} is {kind_of(value)}; {HOW_TO[kind.__name__]}")
    if isinstance(watch, str):
        raise TypeError(f"LiveModel: watch is {watch!r}; expected a list of names of effects, as [{watch!r}]")


def _require_amounts(*, gate: float, **amounts: float) -> None:
    """Refuse a setting that is no amount; the gate may be infinite."""
    for name, value in amounts.items():
        if not 0.0 <= value < math.inf:
            raise AccelcalError(f"LiveModel: {name} = {value:g}; expected a finite number, 0 or above.")
    if not gate > 0.0:
        raise AccelcalError(f"LiveModel: gate = {gate:g}; expected a number above 0, or None for no gate.")
