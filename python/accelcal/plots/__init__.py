"""Figures. Each takes finished results and draws them; matplotlib is imported when a figure is drawn, not before."""

from accelcal.plots.compare import (
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
from accelcal.plots.style import MissingExtra

__all__ = [
    "MissingExtra",
    "accel_residual",
    "autocorrelation",
    "coasting",
    "histogram",
    "one_step",
    "overview",
    "parameters",
    "regions",
    "simulated",
    "write",
]
