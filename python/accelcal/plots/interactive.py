"""Figures of `accelcal.plots` for a notebook, as Figures of plotly; each takes `theme`, "light" or "dark"."""

from accelcal.plots import comparison, diagnosis, model, residuals, response, timeline as over_time
from accelcal.plots.plotly import moving

__all__ = [
    "accel_residual",
    "allan",
    "before_after",
    "coasting",
    "coasting_of_axes",
    "detectable_sizes",
    "drift_limits",
    "error_reduction",
    "fitted_curve",
    "linked",
    "live_tracks",
    "nonlinearity",
    "one_step",
    "overlay",
    "parameters",
    "paths",
    "quantile_plot",
    "ranking",
    "regions",
    "residual_of_axes",
    "sensitivity",
    "signatures",
    "simulated",
    "spectrum",
    "tiles",
    "timeline",
    "tracks",
    "whiteness_plot",
]

accel_residual, coasting = moving(comparison.accel_residual), moving(comparison.coasting)
coasting_of_axes, residual_of_axes = moving(comparison.coasting_of_axes), moving(comparison.residual_of_axes)
detectable_sizes, drift_limits = moving(diagnosis.detectable_sizes), moving(diagnosis.drift_limits)
error_reduction, ranking = moving(diagnosis.error_reduction), moving(diagnosis.ranking)
fitted_curve, live_tracks, paths, tracks = (
    moving(over_time.fitted_curve),
    moving(over_time.live_tracks),
    moving(over_time.paths),
    moving(over_time.tracks),
)
linked, overlay, timeline = moving(over_time.linked), moving(over_time.overlay), moving(over_time.timeline)
allan, nonlinearity, parameters = moving(model.allan), moving(model.nonlinearity), moving(model.parameters)
one_step, simulated = moving(comparison.one_step), moving(comparison.simulated)
quantile_plot, spectrum = moving(residuals.quantile_plot), moving(residuals.spectrum)
before_after, regions, tiles = moving(residuals.before_after), moving(residuals.regions), moving(residuals.tiles)
sensitivity, signatures = moving(response.sensitivity), moving(diagnosis.signatures)
whiteness_plot = moving(residuals.whiteness_plot)


def __dir__() -> list[str]:
    return __all__
