"""Figures. Each takes finished results and draws them; matplotlib is imported when a figure is drawn, not before.

What a figure shows is defined once, as data (`figure`), in a module for each topic; every function here draws it by
matplotlib and takes `theme`, "light" or "dark". `interactive` has the same figures, and more, by plotly.
"""

from typing import Any

from accelcal._support.errors import MissingExtra
from accelcal._support.values import face
from accelcal.plots import comparison, diagnosis, model, residuals, response, timeline
from accelcal.plots.comparison import loop, overview, write
from accelcal.plots.matplotlib import still

__all__ = [
    "MissingExtra",
    "accel_residual",
    "added_variable",
    "allan",
    "autocorrelation",
    "before_after",
    "coasting",
    "coasting_of_axes",
    "error_reduction",
    "histogram",
    "loop",
    "nonlinearity",
    "one_step",
    "overlay",
    "overview",
    "parameters",
    "ranking",
    "regions",
    "residual_of_axes",
    "sensitivity",
    "simulated",
    "tiles",
    "write",
]

accel_residual, coasting = still(comparison.accel_residual), still(comparison.coasting)
coasting_of_axes, residual_of_axes = still(comparison.coasting_of_axes), still(comparison.residual_of_axes)
one_step, simulated = still(comparison.one_step), still(comparison.simulated)
added_variable, error_reduction = still(diagnosis.added_variable), still(diagnosis.error_reduction)
allan, nonlinearity, parameters = still(model.allan), still(model.nonlinearity), still(model.parameters)
autocorrelation, histogram = still(residuals.autocorrelation), still(residuals.histogram)
before_after, regions, tiles = still(residuals.before_after), still(residuals.regions), still(residuals.tiles)
overlay, ranking, sensitivity = still(timeline.overlay), still(diagnosis.ranking), still(response.sensitivity)


def __getattr__(name: str) -> Any:
    if name != "interactive":
        raise AttributeError(f"module 'accelcal.plots' has no attribute {name!r}; it has {', '.join(__all__)}")
    return face("plots.interactive")


def __dir__() -> list[str]:
    return sorted({*__all__, "interactive"})
