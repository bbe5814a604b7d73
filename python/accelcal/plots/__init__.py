"""Figures. Each takes finished results and draws them; matplotlib is imported when a figure is drawn, not before."""

from typing import Any

from accelcal._support.extras import MissingExtra
from accelcal._support.faces import face
from accelcal.plots.static.comparison import (
    accel_residual,
    autocorrelation,
    coasting,
    histogram,
    one_step,
    overview,
    parameters,
    regions,
    simulated,
    write,
)
from accelcal.plots.static.nonlinearity import nonlinearity
from accelcal.plots.static.overlay import overlay
from accelcal.plots.static.sensitivity import sensitivity

__all__ = [
    "MissingExtra",
    "accel_residual",
    "autocorrelation",
    "coasting",
    "histogram",
    "nonlinearity",
    "one_step",
    "overlay",
    "overview",
    "parameters",
    "regions",
    "sensitivity",
    "simulated",
    "write",
]


PACKAGES = ("interactive", "static")
"""Packages that are reached as attributes, imported on first use."""


def __getattr__(name: str) -> Any:
    if name not in PACKAGES:
        raise AttributeError(f"module 'accelcal.plots' has no attribute {name!r}; it has {', '.join(__all__)}")
    return face(f"plots.{name}")


def __dir__() -> list[str]:
    return sorted({*__all__, *PACKAGES})
