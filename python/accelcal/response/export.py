"""A frequency response as a draft certificate: the table by frequency, the parametric fit, amplitude linearity."""

from __future__ import annotations

import csv
import io
import math
from typing import Any

from accelcal.calibration.export.certificate import (
    Column,
    Draft,
    Laboratory,
    Measurement,
    Quantity,
    Result,
    certificate,
)
from accelcal.data import Sensor, units
from accelcal.response.linearity import Term
from accelcal.response.measure import FrequencyResponse
from accelcal.response.parametric import Parameter
from accelcal.response.sine import Point

METHOD = (
    "Output and reference are fitted by least squares to sines over the steady part of each step (sine "
    "approximation of ISO 16063-11 and -41), or compared segment by segment for other motions."
)
OF_TERMS = (
    "Expanded uncertainties are of type A, from the noise beside each line and the scatter between steps. The "
    "uncertainty of the reference is not contained: a relative error e of its acceleration changes K2 by 2 e and K3 by "
    "3 e of its value."
)


def draft_response(answer: FrequencyResponse, sensor: Sensor, laboratory: Laboratory) -> Draft:
    """Write a certificate of the sensitivity by frequency.

    Parameters
    ----------
    answer : from `accelcal.response.frequency_response`.
    sensor : what was measured; with an electrical scale the table has the sensitivity in its unit, too.
    laboratory : administrative data; what is missing is marked and listed.
    """
    points, model, basis = answer.points, answer.model, answer.basis
    sines = [abs(p.acceleration) for p in points if p.method == "sine"]
    conditions = [("frequency", (points[0].frequency, points[-1].frequency), "Hz")]
    conditions += [("amplitude of the acceleration", (min(sines), max(sines)), "m/s²")] if sines else []
    results = [
        Result("Frequency response of the sensitivity", f"{basis} A lag is negative.", table=_table(answer, sensor))
    ]
    if model is not None:
        quantities = tuple(_quantity(p.name, p) for p in model.best.parameters)
        results.append(
            Result(
                "Parametric fit of the frequency response",
                f"{basis} {'. '.join(text.rstrip('.') for text in model.sentences)}.",
                quantities,
            )
        )
    if answer.terms:
        quantities = tuple(_quantity(f"{t.name} from {t.source}", t) for t in answer.terms)
        results.append(Result("Amplitude linearity", OF_TERMS, quantities))
    measurement = Measurement(
        name="Sensitivity of an accelerometer by frequency",
        method="Sine approximation" if sines else "Spectral estimation",
        description=METHOD,
        conditions=tuple(conditions),
        results=tuple(results),
    )
    return certificate(measurement, sensor, laboratory)


def _table(answer: FrequencyResponse, sensor: Sensor) -> tuple[Column, ...]:
    points = answer.points
    factors = [p.coverage_factor for p in points]
    magnitude, expanded = [p.magnitude for p in points], [p.expanded for p in points]
    phase, spread = [math.degrees(p.phase) for p in points], [math.degrees(p.expanded_phase) for p in points]
    columns = [
        Column("frequency", [p.frequency for p in points], "Hz"),
        Column("magnitude of output over acceleration", magnitude, "1", expanded, factors),
        Column("phase of output over acceleration", phase, "°", spread, [p.phase_factor for p in points]),
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


def _quantity(name: str, parameter: Parameter | Term) -> Quantity:
    return Quantity(
        name,
        parameter.value,
        parameter.unit,
        parameter.expanded,
        parameter.expanded / parameter.std if parameter.std > 0.0 else None,
    )


COLUMNS = (
    "frequency_hz",
    "magnitude",
    "magnitude_expanded",
    "phase_deg",
    "phase_expanded_deg",
    "degrees_of_freedom",
    "acceleration_m_per_s2",
    "method",
    "start_s",
    "end_s",
)
"""Of a row. Expanded uncertainties have k = 2; the acceleration of a broadband row is per square root of Hz."""


def row(point: Point) -> dict[str, Any]:
    """One point, by column."""
    values = (
        point.frequency,
        point.magnitude,
        point.expanded,
        math.degrees(point.phase),
        math.degrees(point.expanded_phase),
        point.degrees,
        abs(point.acceleration),
        point.method,
        point.start,
        point.end,
    )
    return dict(zip(COLUMNS, values, strict=True))


def to_csv(answer: FrequencyResponse) -> str:
    """The points as CSV, one a line."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(row(p) for p in answer.points)
    return text.getvalue()


def lines(answer: FrequencyResponse, sensor: Sensor | None = None) -> list[str]:
    """The table, then what was concluded from it, for a terminal.

    Parameters
    ----------
    answer : from `accelcal.response.frequency_response`.
    sensor : what was measured; with an electrical scale the table has the sensitivity in its unit, too.
    """
    scale, unit = (sensor.scale, sensor.scale_unit) if sensor is not None else (None, None)
    size, unit = (1e3, "mV") if unit == "V" else (1.0, unit)
    sensitivity = f"S, {unit}/(m/s²)" if scale is not None else ""
    head = f"{'f, Hz':>10} {'|H|':>10} {'U (k=2)':>9} {'phase, deg':>11} {'U (k=2)':>9}  {'a, m/s²':>9}  {sensitivity}"
    out = [head.rstrip()]
    for p in answer.points:
        amplitude = f"{abs(p.acceleration):9.4g}" if p.method == "sine" else " " * 9
        times = size * abs(scale or 0.0)
        shown = units.decimal(times * p.magnitude, times * p.expanded) if sensitivity else ""
        out.append(
            f"{p.frequency:10.5g} {p.magnitude:10.6f} {p.expanded:9.2g} {math.degrees(p.phase):11.4f} "
            f"{math.degrees(p.expanded_phase):9.2g}  {amplitude}  {shown}".rstrip()
        )
    legend = "|H| is output over acceleration, both in m/s²; U is expanded, k = 2; a lag is negative."
    out += ["", f"{legend}{' S is |H| times the declared scale, ± U.' * bool(sensitivity)}", answer.basis]
    if answer.model is not None:
        out += answer.model.sentences
    out += [
        f"{t.name} from {t.source}: {t.value:.4g} ± {t.expanded:.2g} {t.unit} (U, k = 2; {t.count} steps)"
        for t in answer.terms
    ]
    if answer.check is not None:
        out.append(answer.check if isinstance(answer.check, str) else answer.check.sentence)
    return out
