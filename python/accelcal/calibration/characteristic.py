"""Static characteristic of a sensor: output at an acceleration and temperature, omissions, uncertainty budget."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal._support.values import listing
from accelcal.data import STANDARD_GRAVITY, Array
from accelcal.data.recording import ORDERS, POSITION_ORDER
from accelcal.effects import BUILT_IN, Effect, find, static_terms
from accelcal.estimation.estimate import DWELLS_ALONE, Fit
from accelcal.estimation.run_to_run import Spread
from accelcal.estimation.tracks import POINTS
from accelcal.model import Estimate

STATIC = static_terms()
"""Effects that depend on the acceleration of the same instant, the thermal ones on its temperature as well."""
OWNERS = {"mounting": "the mounting", "rig": "the rig", "encoder": "the encoder", "timing": "timing"}


@dataclass(frozen=True, slots=True)
class LeftOut:
    """An effect of the model that is not part of the characteristic."""

    effect: str
    owner: str
    why: str
    """Half a sentence with the effect as its subject."""
    needed: bool
    """Whether it belongs to the sensor and has a mean, so that nothing is right without it."""


@dataclass(frozen=True, slots=True)
class Characteristic:
    """u = K0 + c1 T + (1 + k + kT T) a + (K1'/2)|a| + K2 a² + Koq a|a| + K3 a³, T from the reference temperature.

    The corner at a = 0, which the fit rounds by the noise of its record, is sharp here.
    """

    coefficients: Mapping[str, float]
    """By effect, SI; those that the model has."""
    scale: float
    """1 + k."""
    reference: float
    """Temperature at which T is zero, degC."""
    left_out: tuple[LeftOut, ...]
    clip: float | None = None
    """Level at which (1 + k) a + K0 saturates, m/s²; None where the model has no such level."""
    clipped_by: str = ""
    """Effect that has this level."""

    def side(self, sign: float) -> tuple[float, float, float, float]:
        """Coefficients of 1, a, a², a³ on one side of a = 0, at the reference temperature."""
        plain, mirrored = self._powers(mirrored=False), self._powers(mirrored=True)
        return (
            plain[0],
            self.scale + sign * mirrored[1],
            plain[2] + sign * mirrored[2],
            plain[3],
        )

    def _powers(self, *, mirrored: bool = False, thermal: bool = False) -> list[float]:
        """Coefficients by the power of the acceleration, 0 to 3, of one kind of term; 0 where the model has none."""
        powers = [0.0] * 4
        for name, value in self.coefficients.items():
            term = STATIC[name]
            if (term.mirrored, term.thermal) == (mirrored, thermal):
                powers[term.power] = value
        return powers

    @property
    def thermal(self) -> tuple[float, float]:
        """c1, m/s²/K, and kT, 1/K."""
        bias, scale, *_ = self._powers(thermal=True)
        return bias, scale

    @property
    def needs_temperature(self) -> bool:
        """Whether the output depends on temperature."""
        return any(STATIC[name].thermal for name in self.coefficients)

    @property
    def has_corner(self) -> bool:
        """Whether the two sides of a = 0 are different polynomials."""
        return self.side(1.0) != self.side(-1.0)

    def forward(self, a: float, warmth: float = 0.0) -> float:
        """Output at acceleration `a`, m/s², `warmth` K above the reference."""
        b0, b1, b2, b3 = self.side(-1.0 if a < 0.0 else 1.0)
        c1, kT = self.thermal
        return b0 + c1 * warmth + (b1 + kT * warmth + (b2 + b3 * a) * a) * a

    def slope(self, a: float, warmth: float = 0.0) -> float:
        """d output / d acceleration."""
        _, b1, b2, b3 = self.side(-1.0 if a < 0.0 else 1.0)
        return b1 + self.thermal[1] * warmth + (2.0 * b2 + 3.0 * b3 * a) * a

    def std(self, fit: Fit, a: float, warmth: float = 0.0) -> float:
        """Standard uncertainty from the fit of an acceleration found by this characteristic, m/s²."""
        J: Array = np.array(
            [STATIC[e.name].per_unit(a, warmth) if e.name in self.coefficients else 0.0 for e in fit.free]
        )
        variance = max(0.0, float(J @ fit.covariance @ J))  # rounding may leave less than nothing
        return math.sqrt(variance) / abs(self.slope(a, warmth))


def characteristic(fit: Fit) -> Characteristic:
    """Return the sensor's own part of a fitted model that holds for single readings.

    Parameters
    ----------
    fit : estimates in forward sense.
    """
    coefficients = {name: fit[name].value for name in STATIC if name in fit.model.effects}
    clipping = next((effect for effect in BUILT_IN if clip_level(effect, fit) is not None), None)
    inside = {*coefficients, *([clipping.name] if clipping else [])}
    others = {term.effect.name: term for term in fit.model.terms if term.effect.name not in inside}
    return Characteristic(
        coefficients=coefficients,
        scale=fit.values().scale,
        reference=fit.origins.temperature,
        left_out=tuple(_left_out(e) for e in (*(term.effect for term in others.values()), *fit.model.noise_effects)),
        clip=clip_level(clipping, fit) if clipping else None,
        clipped_by=clipping.name if clipping else "",
    )


def clip_level(effect: Effect, fit: Fit) -> float | None:
    """Level at which an effect of the model clips the output, m/s²; None if it does not, or is not in the model."""
    shape = effect.traits.clips_at
    return fit.model.shapes.get(effect.name, {}).get(shape) if shape else None


def _left_out(effect: Effect) -> LeftOut:
    equation = effect.line("Equation").split(". ")[0].rstrip(".")
    stated = f" ({equation})" if equation else ""
    foreign = [name for name in effect.needs if name != "temperature"]
    reasons = (  # the first that holds; why, whether it is needed
        (effect.port == "noise", "is noise without a mean", False),
        (effect.owner != "sensor", f"belongs to {OWNERS.get(effect.owner)}, not to the sensor", False),
        (effect.port == "process", "is a random process with mean zero", False),
        (effect.traits.memory, f"depends on earlier readings{stated}", True),
        (bool(effect.traits.no_inverse), f"{effect.traits.no_inverse}{stated}", True),
        (bool(foreign), f"depends on the channel {' and '.join(foreign)}{stated}", True),
        (effect not in BUILT_IN, "is an effect of your own, whose inverse is not known", True),
        (True, f"is no polynomial of acceleration and temperature at the same instant{stated}", True),
    )
    why, needed = next((why, needed) for holds, why, needed in reasons if holds)
    return LeftOut(effect.name, effect.owner, why, needed)


@dataclass(frozen=True, slots=True)
class StraightLine:
    """Output over a range of acceleration, the best line through it, and what is left; m/s², n points."""

    a: Array
    """(n,) acceleration, equally spaced, rising."""
    output: Array
    """(n,) output of the characteristic at the reference temperature."""
    output_std: Array
    """(n,) its standard uncertainty from the fit."""
    offset: float
    slope: float
    """Of the line with the least sum of squares over `a`; slope 1."""
    deviation: Array
    """(n,) output less line."""
    deviation_std: Array
    """(n,) its standard uncertainty; below that of the output, since bias and scale factor have no part in it."""

    @property
    def largest(self) -> int:
        """Index of the largest deviation."""
        return int(np.argmax(np.abs(self.deviation)))

    @property
    def span(self) -> float:
        """Width of the range, m/s²."""
        return float(self.a[-1] - self.a[0])


def straight_line(fit: Fit, low: float | None = None, high: float | None = None) -> StraightLine:
    """Fit a line to the characteristic of a fit.

    The characteristic is linear in its coefficients, and so is its deviation from the line; both uncertainties are
    exact for the covariance of the fit. A level at which an effect clips is not part of it.

    Parameters
    ----------
    fit : estimates in forward sense.
    low, high : m/s² along the input axis, gravity included; the trained range by default.

    Raises
    ------
    ValueError
        If the range is empty: a fit to dwells at one acceleration.
    """
    trained = fit.validity["a"]
    low, high = trained[0] if low is None else low, trained[1] if high is None else high
    if not low < high:
        raise AccelcalError(f"straight_line: the range {low:g} to {high:g} m/s² is empty.")
    a = np.linspace(low, high, POINTS)
    terms = {name: np.array([term.per_unit(x, 0.0) for x in a]) for name, term in STATIC.items()}
    linear = [name for name in terms if name in fit.model.effects]
    values = np.array([fit[name].value for name in linear])
    columns = np.column_stack([terms[name] for name in linear])
    output = a + columns @ values
    lines = np.column_stack([np.ones(POINTS), a])
    offset, slope = np.linalg.lstsq(lines, output, rcond=None)[0].tolist()
    onto, _ = np.linalg.qr(lines)
    free = [e.name for e in fit.free]
    C = fit.covariance[np.ix_(*[[free.index(name) for name in linear if name in free]] * 2)]
    partials = columns[:, [name in free for name in linear]]
    return StraightLine(
        a=a,
        output=output,
        output_std=_std(partials, C),
        offset=offset,
        slope=slope,
        deviation=_left(columns, onto) @ values,
        deviation_std=_std(_left(partials, onto), C),
    )


def _left(y: Array, onto: Array) -> Array:
    """What a line does not explain of columns (n, m), zero where that is rounding; `onto` (n, 2) spans the lines."""
    left = y - onto @ (onto.T @ y)
    return np.asarray(np.where(np.abs(left) < 1e-12 * np.abs(y).max(axis=0, initial=0.0), 0.0, left))


def _std(partials: Array, covariance: Array) -> Array:
    """Standard deviations (n,) for partial derivatives (n, m)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", partials, covariance, partials), 0.0)))


ROUNDS = 20
CONVERGED = 1e-15
"""Relative change of the acceleration below which Newton's steps end."""


class OutsideRange(AccelcalError):
    """An output that no acceleration near zero gives. The text states it."""


@dataclass(frozen=True, slots=True)
class Application:
    """One reading and the acceleration found from it."""

    raw: float | None
    """V or counts; None where the channel is in m/s² already."""
    raw_unit: str
    output: float
    """Under the declared scale and zero, m/s²."""
    rounds: tuple[float, ...]
    """Newton's iterates of the acceleration, m/s²; the last is the result."""
    std: float
    """Standard uncertainty from the fit, m/s²."""
    declared: float
    """Standard uncertainty from the budget beside the fit, m/s²; 0 where there is no budget."""
    left_out: tuple[tuple[str, str], ...]
    """Effects of the model that a single reading cannot correct, each with its owner."""

    @property
    def combined(self) -> float:
        """Combined standard uncertainty, m/s²."""
        return math.hypot(self.std, self.declared)

    @property
    def acceleration(self) -> float:
        """Specific force along the input axis, m/s²."""
        return self.rounds[-1]


def apply(fit: Fit, output: float) -> Application:
    """Solve output = (1 + k) a + K0 + (K1'/2)|a| + K2 a² + Koq a|a| + K3 a³ for a, at the reference temperature.

    Parameters
    ----------
    fit : estimates in forward sense.
    output : under the declared scale and zero, m/s².

    Raises
    ------
    OutsideRange
        If the model is not invertible there.
    """
    sensor_curve = characteristic(fit)
    if sensor_curve.scale == 0.0:
        raise OutsideRange("1 + scale_factor is 0: no acceleration follows from an output")
    rounds = [(output - sensor_curve.forward(0.0)) / sensor_curve.scale]
    for _ in range(ROUNDS):
        slope = sensor_curve.slope(rounds[-1])
        if not slope / sensor_curve.scale > 0.0:
            raise OutsideRange(f"an output of {output:.6g} m/s² lies beyond the range in which the model is monotone")
        step = (output - sensor_curve.forward(rounds[-1])) / slope
        if abs(step) <= CONVERGED * max(1.0, abs(rounds[-1])):
            break
        rounds.append(rounds[-1] + step)
    raw, unit = None, ""
    sensor = fit.rig.sensor
    if sensor.scale is not None:
        raw, unit = (sensor.zero or 0.0) + sensor.scale * output, sensor.scale_unit or "V"
    unused = [name for name in sensor_curve.coefficients if STATIC[name].thermal] + [sensor_curve.clipped_by] * (
        sensor_curve.clip is not None
    )
    left_out = (
        *((name, "sensor") for name in unused),
        *((effect.effect, effect.owner) for effect in sensor_curve.left_out),
    )
    std = sensor_curve.std(fit, rounds[-1])
    if not (math.isfinite(rounds[-1]) and math.isfinite(std)):
        raise OutsideRange(f"an output of {output:.6g} m/s² gives no finite acceleration with a finite uncertainty")
    declared = _declared_std(fit, sensor_curve, rounds[-1])
    return Application(raw, unit, output, tuple(rounds), std, declared, left_out)


def _declared_std(fit: Fit, sensor_curve: Characteristic, a: float) -> float:
    """Standard uncertainty of an acceleration by all that a budget has beside the fit, m/s².

    What a declared source does to several parameters is added; sources, and the scatter of each parameter, are
    independent.
    """
    by_source: dict[tuple[str, str], float] = {}
    for line in budget(fit).lines:
        name = line.estimate.name
        weight = abs(STATIC[name].per_unit(a, 0.0)) if name in sensor_curve.coefficients else 0.0
        for component in line.components[1:]:
            source = component.source, name if component.kind == "A" else ""
            by_source[source] = by_source.get(source, 0.0) + weight * component.contribution
    return math.hypot(*by_source.values()) / abs(sensor_curve.slope(a))


def example(fit: Fit) -> Application:
    """A reading of about half the largest acceleration of the trained range, as an instrument would show it."""
    low, high = fit.validity.get("a", (-1.0, 1.0))
    output = fit["bias"].value + fit.values().scale * 0.5 * (high if high >= -low else low)
    sensor = fit.rig.sensor
    if sensor.scale is None:
        return apply(fit, _digits(output, 4))
    raw = (sensor.zero or 0.0) + sensor.scale * output
    return apply(fit, (_digits(raw, 5) - (sensor.zero or 0.0)) / sensor.scale)


def _digits(value: float, count: int) -> float:
    return float(f"{value:.{count}g}")


COVERAGE_FACTOR = 2.0
"""Expanded uncertainty over standard uncertainty; about 95 % for a normal distribution."""


@dataclass(frozen=True, slots=True)
class Component:
    """One source of uncertainty of one parameter."""

    source: str
    kind: str
    """"A": from the scatter of the data, "B": declared."""
    input_std: float
    """Standard uncertainty of the input, in `input_unit`."""
    input_unit: str
    contribution: float
    """To the standard uncertainty of the parameter, in the parameter's unit."""


@dataclass(frozen=True, slots=True)
class Line:
    """The budget of one parameter."""

    estimate: Estimate
    components: tuple[Component, ...]

    @property
    def combined(self) -> float:
        """Combined standard uncertainty, unit of the parameter."""
        return math.sqrt(sum(c.contribution**2 for c in self.components))

    @property
    def expanded(self) -> float:
        """Expanded uncertainty, coverage factor 2."""
        return COVERAGE_FACTOR * self.combined


@dataclass(frozen=True, slots=True)
class Budget:
    """Budget of all parameters of the sensor, or what has to be declared before there can be one."""

    lines: tuple[Line, ...]
    """Empty while something is missing."""
    missing: tuple[str, ...]
    """Keys of the sidecar that are not declared and are needed."""


def budget(fit: Fit) -> Budget:
    """Combine the fit's standard uncertainties with the declared ones.

    Parameters
    ----------
    fit : with the declared uncertainties of its rig.

    Notes
    -----
    With G the gravity along the stage axis, a level error d changes it by sqrt(g0² - G²) d - G d²/2; an input axis that
    is off by d has that share too, and cos d of the motion. An encoder scale error e enters a coefficient of a^n as
    n e, and one of the rate of the clock as 2 n e (of a velocity n e, of an acceleration not at all). What a joint fit
    has separated (tilt, misalignment, encoder_scale) is in the estimates already. Dwells alone have no encoder and no
    stage: angles and their zero are in the fit, gravity is taken as declared. Differences between mountings and
    between days are in it as far as the fitted runs differ. The thermometer is taken as exact.
    """
    declared, separated, moved = fit.rig.uncertainty, _separated(fit), fit.method != DWELLS_ALONE
    needed = {
        "encoder_scale": moved and "encoder_scale" not in separated,
        "level": moved and "level" not in separated,
        "misalignment": True,
    }
    missing = tuple(
        f"uncertainty.{key}" for key, required in needed.items() if required and getattr(declared, key) is None
    )
    if missing:
        return Budget((), missing)
    mine = [e for e in fit.estimates if e.name in STATIC and e.std > 0.0]
    return Budget(tuple(Line(e, _components(fit, e)) for e in mine), ())


def standard_uncertainty(uncertainty: Budget, e: Estimate) -> float:
    """Combined standard uncertainty of an estimate where it has a budget, else that of the fit."""
    return next((line.combined for line in uncertainty.lines if line.estimate == e), e.std)


def expanded_uncertainty(fit: Fit, uncertainty: Budget, e: Estimate) -> float:
    """Expanded uncertainty of an estimate, coverage factor 2, with its budget where it has one."""
    return max(fit.expanded(e, COVERAGE_FACTOR), COVERAGE_FACTOR * standard_uncertainty(uncertainty, e))


def _components(fit: Fit, e: Estimate) -> tuple[Component, ...]:
    declared, separated = fit.rig.uncertainty, _separated(fit)
    level, off, ruler = declared.level or 0.0, declared.misalignment or 0.0, declared.encoder_scale or 0.0
    moved = fit.method != DWELLS_ALONE
    source = "noise of output and encoder" if moved else "noise within dwells, their scatter and angles"
    components = [Component(f"fit: {source}", "A", e.std, e.unit, e.std)]
    components += [
        Component("difference from run to run", "A", spread.value, e.unit, _of_next_run(spread, e))
        for spread in fit.spreads
        if spread.name == e.name and math.isfinite(spread.next_half)
    ]
    if e.name == "bias":
        if not moved:
            return tuple(components)
        if "level" not in separated:
            components.append(Component("level of the stage axis", "B", level, "rad", _gravity_share(fit, level)))
        if "misalignment" not in separated:
            components.append(Component("misalignment of the input axis", "B", off, "rad", _gravity_share(fit, off)))
        if declared.reference_zero:
            zero, scale = declared.reference_zero, abs(fit.values().scale)
            components.append(Component("zero of the reference", "B", zero, "m/s²", scale * zero))
        return tuple(components)
    size = fit.values().scale if e.name == "scale_factor" else e.value
    n = STATIC[e.name].power  # an encoder scale error enters that many times
    if n == 0:
        return tuple(components)
    if moved and "encoder_scale" not in separated:
        components.append(Component("scale of the encoder", "B", ruler, "1", abs(n * size * ruler)))
    components.append(Component("misalignment of the input axis", "B", off, "rad", abs(n * size) * _second_order(off)))
    if moved and (clock := _clock_rate(fit)) and (order := _order(fit)):
        components.append(Component("rate of the clock", "B", clock, "1", abs(order * n * size * clock)))
    return tuple(components)


def _clock_rate(fit: Fit) -> float:
    """Relative standard uncertainty of the clock's rate: as declared, else by how much two clocks differ where nothing
    says which of them is right."""
    rig, skew = fit.rig, next((e.value for e in fit.estimates if e.name == "clock_skew"), 0.0)
    if rig.uncertainty.clock_rate is not None:
        return rig.uncertainty.clock_rate
    return abs(skew) if rig.trusted_clock is None else 0.0


def _order(fit: Fit) -> int:
    """How many derivatives make an acceleration of the reference, and so how often the clock's rate enters it."""
    references = [run.noise.reference for run in fit.runs]
    return max((ORDERS[name][0] if name in ORDERS else POSITION_ORDER for name in references), default=POSITION_ORDER)


def _of_next_run(spread: Spread, e: Estimate) -> float:
    """What the next run adds to the uncertainty of the mean: as much as gives its 95 % interval, few runs or many."""
    return math.sqrt(max((spread.next_half / COVERAGE_FACTOR) ** 2 - e.std**2, spread.value**2))


def _separated(fit: Fit) -> set[str]:
    """Keys of the declared uncertainties that a joint fit has made superfluous."""
    return {find(name).traits.uncertainty for name in fit.model.effects}


def _gravity_share(fit: Fit, angle: float) -> float:
    """Standard uncertainty of gravity along an axis whose direction has a standard uncertainty, m/s²."""
    along = max(-STANDARD_GRAVITY, min(STANDARD_GRAVITY, fit.rig.gravity))
    across = math.sqrt(STANDARD_GRAVITY**2 - along**2)
    return math.hypot(across * angle, along * _second_order(angle))


def _second_order(angle: float) -> float:
    """Standard deviation of d²/2 for a normal angle d."""
    return angle**2 / math.sqrt(2.0)


__dir__ = listing(globals())
