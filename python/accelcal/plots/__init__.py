"""Figures. Each takes finished results and draws them; matplotlib is imported when a figure is drawn, not before."""

from accelcal._support.extras import MissingExtra
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

__all__ = [
    "MissingExtra",
    "accel_residual",
    "autocorrelation",
    "coasting",
    "histogram",
    "nonlinearity",
    "one_step",
    "overview",
    "parameters",
    "regions",
    "simulated",
    "write",
]
