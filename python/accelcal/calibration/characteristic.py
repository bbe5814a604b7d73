"""The sensor's own static characteristic: its output at one acceleration and temperature, and what is left out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from accelcal._support.values import listing
from accelcal.data.arrays import Array
from accelcal.effects import BUILT_IN, Effect, static_terms
from accelcal.estimation.estimate import Fit

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
        found = [0.0] * 4
        for name, value in self.coefficients.items():
            term = STATIC[name]
            if (term.mirrored, term.thermal) == (mirrored, thermal):
                found[term.power] = value
        return found

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
    kept = {name: fit[name].value for name in STATIC if name in fit.model.effects}
    clipping = next((effect for effect in BUILT_IN if clip_level(effect, fit) is not None), None)
    inside = {*kept, *([clipping.name] if clipping else [])}
    others = {term.effect.name: term for term in fit.model.terms if term.effect.name not in inside}
    return Characteristic(
        coefficients=kept,
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
    if effect.port == "noise":
        return LeftOut(effect.name, effect.owner, "is noise without a mean", False)
    if effect.owner != "sensor":
        return LeftOut(effect.name, effect.owner, f"belongs to {OWNERS[effect.owner]}, not to the sensor", False)
    if effect.port == "process":
        return LeftOut(effect.name, effect.owner, "is a random process with mean zero", False)
    equation = effect.line("Equation").split(". ")[0].rstrip(".")
    stated = f" ({equation})" if equation else ""
    if effect not in BUILT_IN:
        return LeftOut(effect.name, effect.owner, "is an effect of your own, whose inverse is not known", True)
    if effect.traits.memory:
        return LeftOut(effect.name, effect.owner, f"depends on earlier readings{stated}", True)
    if effect.traits.no_inverse:
        return LeftOut(effect.name, effect.owner, f"{effect.traits.no_inverse}{stated}", True)
    foreign = [name for name in effect.needs if name != "temperature"]
    if foreign:
        return LeftOut(effect.name, effect.owner, f"depends on the channel {' and '.join(foreign)}{stated}", True)
    return LeftOut(
        effect.name,
        effect.owner,
        f"is no polynomial of acceleration and temperature at the same instant{stated}",
        True,
    )


__dir__ = listing(globals())
