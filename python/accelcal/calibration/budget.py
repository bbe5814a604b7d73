"""Uncertainty budget of the sensor's parameters: what the fit found, and what was declared (GUM, JCGM 100)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from accelcal._support.values import listing
from accelcal.data import STANDARD_GRAVITY
from accelcal.effects import find, static_terms
from accelcal.estimation.estimate import Fit
from accelcal.estimation.run_to_run import Spread
from accelcal.model import Estimate

COVERAGE_FACTOR = 2.0
"""Expanded uncertainty over standard uncertainty; about 95 % for a normal distribution."""
POWERS = {
    name: term.power
    for name, term in static_terms().items()
    if not term.thermal and (term.power > 1 or not term.mirrored)
}
"""Power of the true acceleration that a parameter multiplies: an encoder scale error enters that many times. The
coefficients of |a| and of temperature have no budget."""


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
    n e. What a joint fit has separated (tilt, misalignment, encoder_scale) is in the estimates already. Differences
    between mountings and between days are in it as far as the fitted runs differ.
    """
    declared, separated = fit.rig.uncertainty, _separated(fit)
    needed = {
        "encoder_scale": "encoder_scale" not in separated,
        "level": "level" not in separated,
        "misalignment": True,
    }
    missing = tuple(
        f"uncertainty.{key}" for key, required in needed.items() if required and getattr(declared, key) is None
    )
    if missing:
        return Budget((), missing)
    mine = [e for e in fit.estimates if e.name in POWERS and e.std > 0.0]
    return Budget(tuple(Line(e, _components(fit, e)) for e in mine), ())


def standard_uncertainty(found: Budget, e: Estimate) -> float:
    """Combined standard uncertainty of an estimate where it has a budget, else that of the fit."""
    return next((line.combined for line in found.lines if line.estimate == e), e.std)


def expanded_uncertainty(fit: Fit, found: Budget, e: Estimate) -> float:
    """Expanded uncertainty of an estimate, coverage factor 2, with its budget where it has one."""
    return max(fit.expanded(e, COVERAGE_FACTOR), COVERAGE_FACTOR * standard_uncertainty(found, e))


def _components(fit: Fit, e: Estimate) -> tuple[Component, ...]:
    declared, separated = fit.rig.uncertainty, _separated(fit)
    level, off, ruler = declared.level or 0.0, declared.misalignment or 0.0, declared.encoder_scale or 0.0
    found = [Component("fit: noise of output and encoder", "A", e.std, e.unit, e.std)]
    found += [
        Component("difference from run to run", "A", spread.value, e.unit, _of_next_run(spread, e))
        for spread in fit.spreads
        if spread.name == e.name and math.isfinite(spread.next_half)
    ]
    if e.name == "bias":
        if "level" not in separated:
            found.append(Component("level of the stage axis", "B", level, "rad", _gravity_share(fit, level)))
        if "misalignment" not in separated:
            found.append(Component("misalignment of the input axis", "B", off, "rad", _gravity_share(fit, off)))
        return tuple(found)
    size = fit.values().scale if e.name == "scale_factor" else e.value
    n = POWERS[e.name]
    if "encoder_scale" not in separated:
        found.append(Component("scale of the encoder", "B", ruler, "1", abs(n * size * ruler)))
    found.append(Component("misalignment of the input axis", "B", off, "rad", abs(n * size) * _second_order(off)))
    return tuple(found)


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
