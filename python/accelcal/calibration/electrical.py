"""Electrical calibration: sensitivity and zero-g output of a fitted model."""

from __future__ import annotations

from typing import Any

from accelcal.data.rig import STANDARD_GRAVITY, Rig
from accelcal.estimation.estimate import Fit


def electrical(fit: Fit, rig: Rig) -> dict[str, Any] | None:
    """Sensitivity and zero-g output with standard uncertainties where an electrical scale is declared, else None."""
    sensor = rig.sensor
    if sensor.scale is None:
        return None
    unit = sensor.scale_unit or "V"
    k, bias = fit["scale_factor"], fit["bias"]
    return {
        "sensitivity": {
            "value": sensor.scale * (1.0 + k.value) * STANDARD_GRAVITY,
            "std": abs(sensor.scale) * k.std * STANDARD_GRAVITY,
            "unit": f"{unit}/g",
        },
        "zero_g_output": {
            "value": (sensor.zero or 0.0) + sensor.scale * bias.value,
            "std": abs(sensor.scale) * bias.std,
            "unit": unit,
        },
    }
