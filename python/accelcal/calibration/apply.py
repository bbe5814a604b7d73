"""Apply a calibration: from the sensor's output to acceleration, with its standard uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass

from accelcal._support.errors import AccelcalError
from accelcal._support.values import listing
from accelcal.calibration.characteristic import STATIC, characteristic
from accelcal.estimation.estimate import Fit

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
    left_out: tuple[tuple[str, str], ...]
    """Effects of the model that a single reading cannot correct, each with its owner."""

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
    own = characteristic(fit)
    if own.scale == 0.0:
        raise OutsideRange("1 + scale_factor is 0: no acceleration follows from an output")
    rounds = [(output - own.forward(0.0)) / own.scale]
    for _ in range(ROUNDS):
        slope = own.slope(rounds[-1])
        if not slope / own.scale > 0.0:
            raise OutsideRange(f"an output of {output:.6g} m/s² lies beyond the range in which the model is monotone")
        step = (output - own.forward(rounds[-1])) / slope
        if abs(step) <= CONVERGED * max(1.0, abs(rounds[-1])):
            break
        rounds.append(rounds[-1] + step)
    raw, unit = None, ""
    sensor = fit.rig.sensor
    if sensor.scale is not None:
        raw, unit = (sensor.zero or 0.0) + sensor.scale * output, sensor.scale_unit or "V"
    unused = [name for name in own.coefficients if STATIC[name].thermal] + [own.clipped_by] * (own.clip is not None)
    left_out = (*((name, "sensor") for name in unused), *((effect.effect, effect.owner) for effect in own.left_out))
    std = own.std(fit, rounds[-1])
    if not (math.isfinite(rounds[-1]) and math.isfinite(std)):
        raise OutsideRange(f"an output of {output:.6g} m/s² gives no finite acceleration with a finite uncertainty")
    return Application(raw, unit, output, tuple(rounds), std, left_out)


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


__dir__ = listing(globals())
