"""Interactive figures: each draws finished results as a plotly Figure; plotly is imported when one is drawn."""

from accelcal._support.listing import listing
from accelcal.plots.interactive.distribution import quantile_plot
from accelcal.plots.interactive.drift import coasting
from accelcal.plots.interactive.drift_limits import drift_limits
from accelcal.plots.interactive.error_reduction import error_reduction
from accelcal.plots.interactive.linked import linked
from accelcal.plots.interactive.live_tracks import live_tracks
from accelcal.plots.interactive.motion import simulated
from accelcal.plots.interactive.overlay import overlay
from accelcal.plots.interactive.ranking import ranking
from accelcal.plots.interactive.regions import regions
from accelcal.plots.interactive.residual import accel_residual, one_step
from accelcal.plots.interactive.sensitivity import sensitivity
from accelcal.plots.interactive.shape import fitted_curve
from accelcal.plots.interactive.signatures import signatures
from accelcal.plots.interactive.smallest_sizes import detectable_sizes
from accelcal.plots.interactive.spectrum import spectrum
from accelcal.plots.interactive.tiles import tiles
from accelcal.plots.interactive.timeline import marks, timeline
from accelcal.plots.interactive.tracks import tracks
from accelcal.plots.interactive.whiteness import whiteness_plot

__all__ = [
    "accel_residual",
    "coasting",
    "detectable_sizes",
    "drift_limits",
    "error_reduction",
    "fitted_curve",
    "linked",
    "live_tracks",
    "marks",
    "one_step",
    "overlay",
    "quantile_plot",
    "ranking",
    "regions",
    "sensitivity",
    "signatures",
    "simulated",
    "spectrum",
    "tiles",
    "timeline",
    "tracks",
    "whiteness_plot",
]


__dir__ = listing(globals())
