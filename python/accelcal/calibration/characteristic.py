"""The sensor's own static characteristic: what it says at one acceleration and temperature, and what is left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array
from accelcal.effects import HOUSE
from accelcal.estimation.estimate import Fit
from accelcal.model import Term

STATIC = ("bias", "scale_factor", "scale_asymmetry", "quadratic", "odd_quadratic", "cubic")
"""Effects that depend on the acceleration of the same instant alone."""
THERMAL = ("temperature_bias", "temperature_scale")
"""Effects that depend on the temperature of the same instant as well."""

PECULIAR = {
    "cross_axis_gravity": "depends on the acceleration across the input axis, which one axis does not know",
    "dead_zone": "makes one output stand for several accelerations",
}
OWNERS = {"mounting": "the mounting", "rig": "the rig", "encoder": "the encoder", "timing": "timing"}


@dataclass(frozen=True, slots=True)
class LeftOut:
    """An effect of the model that is no part of the characteristic."""

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

    def side(self, sign: float) -> tuple[float, float, float, float]:
        """Coefficients of 1, a, a², a³ on one side of a = 0, at the reference temperature."""
        c = self.coefficients
        return (
            c.get("bias", 0.0),
            self.scale + sign * c.get("scale_asymmetry", 0.0),
            c.get("quadratic", 0.0) + sign * c.get("odd_quadratic", 0.0),
            c.get("cubic", 0.0),
        )

    @property
    def thermal(self) -> tuple[float, float]:
        """c1, m/s²/K, and kT, 1/K."""
        return self.coefficients.get("temperature_bias", 0.0), self.coefficients.get("temperature_scale", 0.0)

    @property
    def needs_temperature(self) -> bool:
        """Whether the output depends on temperature."""
        return any(name in self.coefficients for name in THERMAL)

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
        size = {
            "bias": 1.0,
            "scale_factor": a,
            "scale_asymmetry": abs(a),
            "quadratic": a**2,
            "odd_quadratic": a * abs(a),
            "cubic": a**3,
            "temperature_bias": warmth,
            "temperature_scale": warmth * a,
        }
        J: Array = np.array([size[e.name] if e.name in self.coefficients else 0.0 for e in fit.free])
        return float(np.sqrt(J @ fit.covariance @ J)) / abs(self.slope(a, warmth))


def characteristic(fit: Fit) -> Characteristic:
    """Return the sensor's own part of a fitted model that holds for single readings.

    Parameters
    ----------
    fit : estimates in forward sense.
    """
    kept = {name: fit[name].value for name in (*STATIC, *THERMAL) if name in fit.model.effects}
    level = fit.model.shapes.get("saturation", {}).get("level")
    inside = {*kept, "saturation"}
    others = {term.effect.name: term for term in fit.model.terms if term.effect.name not in inside}
    return Characteristic(
        coefficients=kept,
        scale=fit.values().scale,
        reference=fit.origins.temperature,
        left_out=tuple(_left_out(term) for term in others.values()),
        clip=level,
    )


def _left_out(term: Term) -> LeftOut:
    effect = term.effect
    if effect.owner != "sensor":
        return LeftOut(effect.name, effect.owner, f"belongs to {OWNERS[effect.owner]}, not to the sensor", False)
    if effect.port == "noise":
        return LeftOut(effect.name, effect.owner, "is noise without a mean", False)
    if effect.port == "process":
        return LeftOut(effect.name, effect.owner, "wanders about a mean of zero", False)
    equation = effect.line("Equation").split(". ")[0].rstrip(".")
    told = f" ({equation})" if equation else ""
    if effect not in HOUSE:
        return LeftOut(effect.name, effect.owner, "is an effect of your own, whose inverse is not known", True)
    if effect.traits.memory:
        return LeftOut(effect.name, effect.owner, f"has a memory that one reading does not know{told}", True)
    if effect.name in PECULIAR:
        return LeftOut(effect.name, effect.owner, f"{PECULIAR[effect.name]}{told}", True)
    foreign = [name for name in effect.needs if name != "temperature"]
    if foreign:
        return LeftOut(effect.name, effect.owner, f"depends on the channel {' and '.join(foreign)}{told}", True)
    return LeftOut(
        effect.name,
        effect.owner,
        f"is no polynomial of acceleration and temperature at the same instant{told}",
        True,
    )
