"""The certificate of a calibration: the sensor's own parameters, with the expanded uncertainties of the budget."""

from __future__ import annotations

from accelcal.calibration.budget import budget
from accelcal.calibration.export.calibration import Calibration
from accelcal.calibration.export.document import Draft, Measurement, Quantity, Result, certificate
from accelcal.calibration.export.laboratory import Laboratory
from accelcal.calibration.export.words import equation, left_out, reading

METHOD = (
    "The accelerometer moves along one axis with an encoder. Output and position are compared through a filter for "
    "position and velocity; parameters are estimated by weighted least squares on its innovations, with the noise of "
    "both channels found by likelihood."
)


def draft(c: Calibration, laboratory: Laboratory) -> Draft:
    """Write a certificate of the sensor's own parameters.

    Parameters
    ----------
    c : what is certified; only effects that the sensor owns.
    laboratory : administrative data; what is missing is marked and listed.

    Notes
    -----
    Expanded uncertainties are those of the budget. While it is withheld because declarations are missing, values stand
    without uncertainty, and the declarations are listed.
    """
    undeclared = budget(c.fit).missing
    temperature = c.fit.validity.get("temperature")
    ranges = [("acceleration", c.domain.acceleration, "m/s²")]
    ranges += [("temperature", temperature, "degC")] if temperature else []
    notes = [f"Model in forward sense (IEEE 1293): {equation(c)}; {reading(c)}."]
    if c.own.needs_temperature:
        notes.append(f"T counts from {c.own.reference:.6g} degC.")
    notes += [f"{text}." for text in c.remarks]
    notes.append(f"Not certified: {'; '.join(left_out(c))}.")
    if undeclared:
        notes.append(f"Uncertainties are withheld until these are declared: {', '.join(undeclared)}.")
    measurement = Measurement(
        name="Calibration of an accelerometer against position",
        method="Replay of output and position",
        description=METHOD,
        conditions=tuple(ranges),
        results=(Result("Parameters of the sensor", " ".join(notes), tuple(quantities(c))),),
    )
    return certificate(measurement, c.fit.rig.sensor, laboratory, undeclared)


def quantities(c: Calibration) -> list[Quantity]:
    """Parameters of the sensor, then sensitivity and zero-g output where an electrical scale is declared."""
    expanded = {line.estimate.name: line.expanded for line in budget(c.fit).lines}
    found = [Quantity(f"{e.name} ({e.symbol})", e.value, e.unit, expanded.get(e.name)) for e in c.estimates]
    sensor = c.fit.rig.sensor
    if sensor.scale is not None:
        zero = (sensor.zero or 0.0) + sensor.scale * c.fit["bias"].value
        size = abs(sensor.scale)
        spread = {name: size * value for name, value in expanded.items()}
        found += [
            Quantity("sensitivity", sensor.scale * c.own.scale, f"{c.unit}/(m/s²)", spread.get("scale_factor")),
            Quantity("zero-g output", zero, c.unit, spread.get("bias")),
        ]
    return found
