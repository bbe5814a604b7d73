"""A frequency response as a draft certificate: the table by frequency, the parametric fit, amplitude linearity."""

from __future__ import annotations

import math

from accelcal.calibration.export.document import Column, Draft, Measurement, Quantity, Result, certificate
from accelcal.calibration.export.laboratory import Laboratory
from accelcal.data.rig import Sensor
from accelcal.response.linearity import Term
from accelcal.response.measure import FrequencyResponse
from accelcal.response.parametric import Parameter, ResponseModel

METHOD = (
    "Output and reference are fitted by least squares to sines over the steady part of each step (sine "
    "approximation of ISO 16063-11 and -41), or compared segment by segment for other motions."
)
TYPE_A = (
    "Expanded uncertainties are of type A, from the noise beside each line: no contribution of the calibration of the "
    "reference is contained."
)


def draft_response(found: FrequencyResponse, sensor: Sensor, laboratory: Laboratory) -> Draft:
    """Write a certificate of the sensitivity by frequency.

    Parameters
    ----------
    found : from `accelcal.response.frequency_response`.
    sensor : what was measured; with an electrical scale the table has the sensitivity in its unit, too.
    laboratory : administrative data; what is missing is marked and listed.
    """
    points, model = found.points, found.model
    sines = [abs(p.acceleration) for p in points if p.method == "sine"]
    conditions = [("frequency", (points[0].frequency, points[-1].frequency), "Hz")]
    conditions += [("amplitude of the acceleration", (min(sines), max(sines)), "m/s²")] if sines else []
    results = [
        Result("Frequency response of the sensitivity", f"{TYPE_A} A lag is negative.", table=_table(found, sensor))
    ]
    if model is not None:
        quantities = tuple(_quantity(p.name, p) for p in model.best.parameters)
        results.append(Result("Parametric fit of the frequency response", _described(model), quantities))
    if found.terms:
        quantities = tuple(_quantity(f"{t.name} from {t.source}", t) for t in found.terms)
        results.append(Result("Amplitude linearity", TYPE_A, quantities))
    measurement = Measurement(
        name="Sensitivity of an accelerometer by frequency",
        method="Sine approximation" if sines else "Spectral estimation",
        description=METHOD,
        conditions=tuple(conditions),
        results=tuple(results),
    )
    return certificate(measurement, sensor, laboratory)


def _table(found: FrequencyResponse, sensor: Sensor) -> tuple[Column, ...]:
    points = found.points
    factors = [p.coverage_factor for p in points]
    magnitude, expanded = [p.magnitude for p in points], [p.expanded for p in points]
    phase, spread = [math.degrees(p.phase) for p in points], [math.degrees(p.expanded_phase) for p in points]
    columns = [
        Column("frequency", [p.frequency for p in points], "Hz"),
        Column("magnitude of output over acceleration", magnitude, "1", expanded, factors),
        Column("phase of output over acceleration", phase, "°", spread, factors),
    ]
    if sensor.scale is not None and sensor.scale_unit:
        size, unit = abs(sensor.scale), f"{sensor.scale_unit}/(m/s²)"
        columns.append(
            Column(
                "magnitude of the sensitivity",
                [size * m for m in magnitude],
                unit,
                [size * u for u in expanded],
                factors,
            )
        )
    if all(p.method == "sine" for p in points):
        columns.append(Column("amplitude of the acceleration", [abs(p.acceleration) for p in points], "m/s²"))
    return tuple(columns)


def _quantity(name: str, found: Parameter | Term) -> Quantity:
    return Quantity(
        name, found.value, found.unit, found.expanded, found.expanded / found.std if found.std > 0.0 else None
    )


def _described(model: ResponseModel) -> str:
    """What was fitted, how well, and what it cannot be told from."""
    return f"{TYPE_A} {'. '.join(text.rstrip('.') for text in model.sentences)}."
