"""The calibration applied: from what the sensor says to acceleration, with its standard uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from accelcal.fit import Fit

POLYNOMIAL = ("quadratic", "odd_quadratic", "cubic")
"""Effects that depend on the acceleration of the same instant alone; temperature effects vanish at the reference."""
ROUNDS = 20
CONVERGED = 1e-15
"""Relative change at which the solution has come to rest."""


class OutsideRange(ValueError):
    """An output that no acceleration near zero explains. The text says which."""


@dataclass(frozen=True, slots=True)
class Application:
    """One reading on its way to acceleration."""

    raw: float | None
    """V or counts; None where the channel is in m/s² already."""
    raw_unit: str
    output: float
    """Under the declared scale and zero, m/s²."""
    rounds: tuple[float, ...]
    """Newton's steps towards the acceleration, m/s²; the last one is it."""
    std: float
    """Standard uncertainty from the fit, m/s²."""
    left_out: tuple[tuple[str, str], ...]
    """Effects of the model that a single reading cannot correct, each with its owner."""

    @property
    def acceleration(self) -> float:
        """Specific force along the input axis, m/s²."""
        return self.rounds[-1]


def apply(fit: Fit, output: float) -> Application:
    """Solve output = (1 + k) a + K0 + K2 a² + K2o a|a| + K3 a³ for a.

    Parameters
    ----------
    fit : estimates in forward sense.
    output : under the declared scale and zero, m/s².

    Raises
    ------
    OutsideRange
        If the model is not invertible there.
    """
    c = {name: fit[name].value if name in fit.model.effects else 0.0 for name in POLYNOMIAL}
    s, bias = fit.values().scale, fit["bias"].value

    def forward(a: float) -> tuple[float, float]:
        bend = c["quadratic"] * a**2 + c["odd_quadratic"] * a * abs(a) + c["cubic"] * a**3
        slope = s + 2.0 * c["quadratic"] * a + 2.0 * c["odd_quadratic"] * abs(a) + 3.0 * c["cubic"] * a**2
        return s * a + bias + bend, slope

    rounds = [(output - bias) / s]
    for _ in range(ROUNDS):
        reached, slope = forward(rounds[-1])
        if not slope / s > 0.0:
            raise OutsideRange(f"an output of {output:.6g} m/s² lies beyond the range in which the model is monotone")
        step = (output - reached) / slope
        if abs(step) <= CONVERGED * max(1.0, abs(rounds[-1])):
            break
        rounds.append(rounds[-1] + step)
    a = rounds[-1]
    gradient = {"bias": 1.0, "scale_factor": a, "quadratic": a**2, "odd_quadratic": a * abs(a), "cubic": a**3}
    J = np.array([gradient.get(e.name, 0.0) for e in fit.free]) / forward(a)[1]
    raw, unit = None, ""
    sensor = fit.rig.sensor
    if sensor.scale is not None:
        raw, unit = (sensor.zero or 0.0) + sensor.scale * output, sensor.scale_unit or "V"
    used = {"bias", "scale_factor", *POLYNOMIAL}
    others = {term.effect.name: str(term.owner) for term in fit.model.terms if term.effect.name not in used}
    return Application(
        raw, unit, output, tuple(rounds), math.sqrt(float(J @ fit.covariance @ J)), tuple(others.items())
    )


def example(fit: Fit) -> Application:
    """A reading of about half the largest acceleration that the fit has seen, as an instrument would show it."""
    low, high = fit.validity.get("a", (-1.0, 1.0))
    output = fit["bias"].value + fit.values().scale * 0.5 * (high if high >= -low else low)
    sensor = fit.rig.sensor
    if sensor.scale is None:
        return apply(fit, _digits(output, 4))
    raw = (sensor.zero or 0.0) + sensor.scale * output
    return apply(fit, (_digits(raw, 5) - (sensor.zero or 0.0)) / sensor.scale)


def _digits(value: float, count: int) -> float:
    return float(f"{value:.{count}g}")
