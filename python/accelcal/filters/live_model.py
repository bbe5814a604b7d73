"""A model tracked live: catalogue effects as parameters of a fixed-rate filter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, NoReturn

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.data import GRAVITY, Array, Rig, unsupported
from accelcal.effects import BUILT_IN, Effect, find, is_local
from accelcal.effects.building_blocks import lag_weights
from accelcal.filters.choice import GaussMarkov
from accelcal.filters.stream import FACTORED, MOST_EFFECTS, fixed_rate_with_effects
from accelcal.model import Estimate, Model, Prior, Term, evaluate
from accelcal.signals.signals import Origins, Signals

INSTANTS = np.array([0.0, 0.5, 1.0])
"""Where effects are evaluated, shares of a step."""
_POWERS = np.linalg.inv(np.vander([-2.0, -1.0, 0.0, 1.0], increasing=True))
CUBIC = np.stack(
    [
        np.stack([INSTANTS**0, INSTANTS, INSTANTS**2, INSTANTS**3], axis=1) @ _POWERS,
        np.stack([0 * INSTANTS, INSTANTS**0, 2 * INSTANTS, 3 * INSTANTS**2], axis=1) @ _POWERS,
        np.stack([0 * INSTANTS, 0 * INSTANTS, 2 * INSTANTS**0, 6 * INSTANTS], axis=1) @ _POWERS,
    ]
)
"""(3, 3, 4): value, first and second difference at the three instants of the cubic through four samples."""


class CausalSignals:
    """Signals over one step from what a live filter knows then, with the fields that `smoothed_signals` fills offline.

    Position and velocity are predicted from the filter's state. The specific force is the output at the present
    estimates, a cubic through the last four samples, with all its noise and the low-pass undone; jerk is its
    derivative. Corners are rounded by the noise left and by the largest motion so far.
    """

    def __init__(self, rig: Rig, origins: Origins, step: float, q: float) -> None:
        self.rig, self.origins, self.step = rig, origins, step
        self.tau = rig.lowpass.tau if rig.lowpass is not None else 0.0
        self.a_std = math.sqrt(q / step)
        self.t = -origins.t
        self.outputs: tuple[float, ...] = ()
        self.reached = np.zeros((2, 1))

    def over(self, u: float, added: Array, x: Array, variances: Array, side: Mapping[str, float]) -> Signals:
        """Signals (3,) at the sample before, half-way and at that of output `u` (m/s²); all here if none is before.

        Parameters
        ----------
        added : (2,) what the effects add to the output at either end, m/s².
        x, variances : state of the filter at the sample before, position, velocity, k and K0 first, SI.
        side : side channels; temperature in degC.
        """
        (p, v, k, K0), polarity = x[:4], self.rig.polarity
        h = self.step if self.outputs else 0.0
        output, slope, curvature = self._output_with_derivatives(u) / (1.0 + k)
        rise = (added[1] - added[0]) / (1.0 + k)
        force = output - (K0 + added[0]) / (1.0 + k) - INSTANTS * rise
        slope = (slope - rise) / self.step
        curvature = curvature / self.step**2
        first, middle, last = moving = force - polarity * self.rig.gravity
        # The velocity of a parabola through the three, and the position that goes with it.
        speed = v + h / 24.0 * np.array([0.0, 5.0 * first + 8.0 * middle - last, 4.0 * (first + 4.0 * middle + last)])
        place = p + h * np.array([0.0, 0.25 * (speed[0] + speed[1]), (speed[0] + 4.0 * speed[1] + speed[2]) / 6.0])
        signals = Signals(
            t=self.t + h * (INSTANTS - 1.0),
            p=polarity * (place + self.tau * speed) - self.origins.p,
            v=polarity * (speed + self.tau * moving),
            a=force + self.tau * slope,
            jerk=slope + self.tau * curvature,
            scale=float(1.0 + k),
            bias=float(K0),
            rig=self.rig,
            side={name: np.full(3, y - self.origins.of(name)) for name, y in side.items()},
            side_origins=self.origins.side,
            p_std=math.sqrt(variances[0]),
            v_std=math.sqrt(variances[1]),
            a_std=self.a_std,
        )
        a, v = np.maximum(self.reached, np.max(np.abs([signals.a, signals.v]), axis=1, keepdims=True))
        return replace(signals, whole=replace(signals, a=a, v=v))

    def advance(self, u: float, signals: Signals) -> None:
        """The sample of output `u`, whose signals these were, has been taken in."""
        assert signals.whole is not None
        self.reached = np.array([signals.whole.a, signals.whole.v])
        self.t, self.outputs = self.t + self.step, (*self.outputs[-2:], u)

    def _output_with_derivatives(self, u: float) -> Array:
        """Output at the three instants and its first and second derivatives per step, (3, 3): the filter's own cubic
        through the last four samples, a line while there are fewer."""
        if len(self.outputs) == 3:
            return np.asarray(CUBIC @ np.array([*self.outputs, u]))
        before = self.outputs[-1] if self.outputs else u
        return np.array([before + INSTANTS * (u - before), np.full(3, u - before), np.zeros(3)])


WIDE = 30.0
"""Standard deviation before the first sample where the model gives no prior, in typical sizes of the coefficient."""
DIFFUSE = 1e4
"""Variance of the first position over that of one reading."""
SENSOR = ("scale_factor", "bias")
"""Coefficients that the filter's sensor has by itself, in the filter's order."""
MOTION = 2
"""States before the coefficients: position and velocity."""


class LiveModel:
    """Bias, scale factor and every effect of a model, estimated from output and position as they arrive.

    ACI at a fixed rate: u = K0 + (1 + k) f + sum c_j e_j, the effects e_j by the functions that a fit uses, on causal
    signals (`CausalSignals`); how an effect leans on the state is left out of the gradient. `time_offset` is taken to
    first order, -(1 + k) t0 jerk, so it should be small against a period of the motion. Steps have no integration error
    and the covariance is kept in UD factors, so no variance falls below zero at any rate or prior.

    Coefficients that the model holds fixed keep their value; the others start from the model's prior, or from zero with
    30 typical sizes. A random process of the model (`scale_gauss_markov`, ...) is one more state: what it adds to its
    parameter at present, which the estimate under its name is.

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
    gauss_markov : coefficients that are not constant, by name.
    order : first- or second-order filter.
    gate : reject readings with e²/S above this; None for no gate.

    Raises
    ------
    ValueError
        For an effect that cannot be tracked live, by name, for more than 14 coefficients besides bias and scale, and
        for a rate that is not positive, or another setting that is negative or not finite.

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
        order: Literal[1, 2] = 1,
        gate: float | None = None,
    ) -> None:
        if not 0 < rate < math.inf:
            raise AccelcalError(f"LiveModel: rate = {rate:g} Hz; give the samples of the output per second.")
        _require_amounts(q=q, r_position=r_position, speed=speed, gate=math.inf if gate is None else gate)
        if not math.isfinite(position):
            raise AccelcalError(f"LiveModel: position = {position:g} m; give where the stage is at the first sample.")
        for name in model.effects:
            reason = refusal(find(name))
            if reason is not None:
                raise AccelcalError(f"{name} cannot be tracked live: {reason}.")
        terms, processes = live_terms(model)
        self.model, self.rig = model, rig
        self.names = (*SENSOR, *(name for name in terms if name not in SENSOR))
        """Coefficients in the order of `values` and `covariance`."""
        self._terms = tuple(terms.values())
        self._added = tuple(terms[name] for name in self.names[len(SENSOR) :])
        m = len(self._added)
        if m > MOST_EFFECTS:
            raise AccelcalError(
                f"a live filter has room for {MOST_EFFECTS} coefficients beside bias and scale_factor; "
                f"the model has {m}: drop some."
            )
        moving = {**processes, **(gauss_markov or {})}
        unknown = sorted(set(moving) - set(terms))
        if unknown:
            raise AccelcalError(f"gauss_markov: {', '.join(unknown)} not in the model; it has {', '.join(terms)}.")
        beliefs = [_belief(model, terms[name], processes) for name in self.names]
        refused = unsupported(rig.filters, "a live filter")
        if refused:
            raise AccelcalError(refused)
        tau = rig.lowpass.tau if rig.lowpass is not None else 0.0
        # Behind a low-pass the filter's motion lags: it begins tau v behind the stage.
        P0 = np.diag([DIFFUSE * r_position + (tau * speed) ** 2, speed**2, *(b.std**2 for b in beliefs)])
        P0[0, 1] = P0[1, 0] = -tau * speed**2
        self._filter = fixed_rate_with_effects(
            dt=1.0 / rate,
            q=q,
            r_position=r_position,
            x0=[rig.polarity * position, 0.0, *(b.mean for b in beliefs)],
            P0=P0,
            rest=rig.polarity * rig.gravity,
            tau=tau,
            parameters=[moving.get(name) for name in self.names],
            choice=replace(FACTORED, order=order),
            gate=gate,
        )
        self._signals = CausalSignals(rig, origins or Origins(), 1.0 / rate, q)
        self._lag = lag_weights(tau, 0.5 / rate) if tau > 0.0 else None
        self._x, self._variances = np.zeros(MOTION + 2 + m), np.zeros(MOTION + 2 + m)
        self._columns = np.zeros((3, m))
        self._side: dict[str, float] = {}

    def __reduce__(self) -> NoReturn:
        raise TypeError("a LiveModel is a running filter and cannot be pickled or copied; make another one")

    def step(self, u: float, z: float | None = None, **side: float) -> float | None:
        """Take in the next sample: output (m/s²), position (m) where it was read, side channels where they changed.

        Side channels are in SI, temperature in degC; the last value holds. Returns the innovation, m, or None.

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
        self._side.update(side)
        self._require_side()
        self._filter.read(self._x, self._variances)
        theta = self._x[MOTION + len(SENSOR) :]
        before, _, here = self._columns @ theta
        added = np.array([here, 2.0 * here - before])  # a line through the last step
        signals = self._signals.over(u, added, self._x, self._variances, self._side)
        columns, position_columns = self._evaluate(signals)
        polarity = self.rig.polarity
        e = self._filter.step_with_effects(u, None if z is None else polarity * z, columns, position_columns)
        self._columns = columns
        self._signals.advance(u, signals)
        return None if e is None else polarity * e

    def run(self, u: Array, z: Array, **side: Array) -> None:
        """Take a record in, (n,) each; NaN where position was not read."""
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
        values = dict(zip(self.names, self.values.tolist(), strict=True))
        std = dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))
        return tuple(Estimate(t.name, t.symbol, t.unit, values[t.name], std[t.name], t.owner) for t in self._terms)

    @property
    def nis(self) -> float | None:
        """Normalised square of the newest innovation, e²/S."""
        return self._filter.nis

    @property
    def rejected(self) -> int:
        """Readings that the gate rejected."""
        return self._filter.rejected

    def _require_side(self) -> None:
        for term in self._added:
            for name in term.effect.needs:
                if name not in self._side:
                    raise AccelcalError(
                        f"{term.effect.name} needs the channel {name!r}, which was never given: "
                        f"call step(u, z, {name}=...) with the first sample."
                    )

    def _evaluate(self, s: Signals) -> tuple[Array, Array]:
        """What effects add per unit over the step: (3, m) m/s² to the low-passed output, (m,) m to a reading."""
        columns, position_columns = np.zeros_like(self._columns), np.zeros(len(self._added))
        for j, (term, column) in enumerate(zip(self._added, evaluate(self._added, s), strict=True)):
            if term.port == "position":
                position_columns[j] = self.rig.polarity * column[2]
            else:
                columns[:, j] = column
        if self._lag is not None and self._filter.samples > 0:
            decay, old, new = self._lag
            start = self._columns[2]
            middle = decay * start + old * columns[0] + new * columns[1]
            columns[:] = start, middle, decay * middle + old * columns[1] + new * columns[2]
        return columns, position_columns


def refusal(effect: Effect) -> str | None:
    """Why an effect cannot be tracked live; None where it can."""
    if effect.port == "noise":
        return "it changes the noise, and a live filter follows means"
    if effect.port == "process":
        return refusal(find(effect.traits.changes))
    if is_local(effect):
        return None
    if effect in BUILT_IN:
        return "its value at one time depends on the signals at other times; fit it to a record"
    return "an effect of your own may look at other times than the present; fit it to a record"


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


def _belief(model: Model, term: Term, processes: Mapping[str, GaussMarkov]) -> Prior:
    """What is believed of a coefficient before the first sample."""
    if term.name in processes:  # a walk starts at its parameter, a Gauss-Markov process anywhere
        moves = processes[term.name]
        return Prior(0.0, 0.0 if moves.tau == math.inf else math.sqrt(0.5 * moves.q * moves.tau))
    if term.name in model.fixed:
        return Prior(model.fixed[term.name], 0.0)
    return model.priors.get(term.name, Prior(0.0, WIDE * term.effect.scale))


def _require_amounts(*, gate: float, **amounts: float) -> None:
    """Refuse a setting that is no amount; the gate may be infinite."""
    for name, value in amounts.items():
        if not 0.0 <= value < math.inf:
            raise AccelcalError(f"LiveModel: {name} = {value:g}; expected a finite number, 0 or above.")
    if not gate > 0.0:
        raise AccelcalError(f"LiveModel: gate = {gate:g}; expected a number above 0, or None for no gate.")
