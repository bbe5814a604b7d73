"""The export as plain values for JSON: the content of the code, every number exact."""

from __future__ import annotations

from typing import Any

from accelcal._core import __version__
from accelcal.calibration.electrical import electrical
from accelcal.calibration.export.calibration import Calibration, Code
from accelcal.calibration.export.words import equation
from accelcal.estimation.estimate import tied_sum

SCHEMA = "accelcal/export/1"


def to_dict(c: Calibration) -> dict[str, Any]:
    """Return everything that is exported.

    Parameters
    ----------
    c : what is exported.
    """
    sensor = c.fit.rig.sensor
    free = [e.name for e in c.fit.free if e.name in c.own.coefficients]
    return {
        "schema": SCHEMA,
        "version": __version__,
        "source": c.source,
        "sensor": {"model": sensor.model, "serial": sensor.serial},
        "reading": {
            "unit": c.unit,
            "scale": 1.0 if sensor.scale is None else sensor.scale,
            "zero": sensor.zero or 0.0,
        },
        "model": equation(c),
        "reference_degC": c.own.reference if c.own.needs_temperature else None,
        "parameters": [
            {
                "name": e.name,
                "symbol": e.symbol,
                "unit": e.unit,
                "value": e.value,
                "std": e.std,
                "stands_for": tied_sum(c.fit, e.name),
            }
            for e in c.estimates
        ],
        "covariance": {"names": free, "matrix": c.covariance.tolist()},
        "electrical": electrical(c.fit, c.fit.rig),
        "validity": {
            "acceleration_m_per_s2": list(c.domain.acceleration),
            "temperature_degC": None if c.domain.temperature is None else list(c.domain.temperature),
        },
        "std_m_per_s2": list(c.std),
        "left_out": [{"effect": e.effect, "owner": e.owner, "why": e.why} for e in c.left_out],
        "remarks": list(c.remarks),
        "double": code_to_dict(c.double),
        "float": code_to_dict(c.single),
        "data": [{"file": name, "sha256": digest} for name, digest in c.fit.sources],
    }


def code_to_dict(code: Code) -> dict[str, Any]:
    """One number format: polynomials, bounds, test vector."""
    inverse = code.inverse
    w = inverse.warmth
    return {
        "bound_m_per_s2": code.bound,
        "bound_of_polynomial_m_per_s2": code.proven.approximation,
        "bound_of_rounding_m_per_s2": code.proven.rounding,
        "tolerance_of_test_m_per_s2": code.tolerance,
        "temperature": None
        if w is None
        else {"centre": w.centre, "half": w.half, "per_half": w.per_half, "shift": w.shift},
        "segments": [
            {
                "low": s.low,
                "high": s.high,
                "centre": s.centre,
                "per_half": s.per_half,
                "coefficients": [list(row) for row in s.coefficients],
            }
            for s in inverse.segments
        ],
        "slopes_outside": list(inverse.slopes),
        "test_vector": [
            {"reading": e.reading, "temperature": e.temperature, "acceleration": e.acceleration, "outside": e.outside}
            for e in code.vector
        ],
    }
