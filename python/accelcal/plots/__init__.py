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
    "sensitivity",
    "simulated",
    "tiles",
    "write",
]

accel_residual = still(comparison.accel_residual)
added_variable = still(diagnosis.added_variable)
allan = still(model.allan)
autocorrelation = still(residuals.autocorrelation)
before_after = still(residuals.before_after)
coasting = still(comparison.coasting)
error_reduction = still(diagnosis.error_reduction)
histogram = still(residuals.histogram)
nonlinearity = still(model.nonlinearity)
one_step = still(comparison.one_step)
overlay = still(timeline.overlay)
parameters = still(model.parameters)
ranking = still(diagnosis.ranking)
regions = still(residuals.regions)
sensitivity = still(response.sensitivity)
simulated = still(comparison.simulated)
tiles = still(residuals.tiles)


def __getattr__(name: str) -> Any:
    if name != "interactive":
        raise AttributeError(f"module 'accelcal.plots' has no attribute {name!r}; it has {', '.join(__all__)}")
    return face("plots.interactive")


def __dir__() -> list[str]:
    return sorted({*__all__, "interactive"})
