"""Interactive figures: each draws finished results as a plotly Figure; plotly is imported when one is drawn."""

from accelcal.plots.interactive.distribution import quantile_plot
from accelcal.plots.interactive.drift import coasting
from accelcal.plots.interactive.error_reduction import falling
from accelcal.plots.interactive.linked import linked
from accelcal.plots.interactive.motion import simulated
from accelcal.plots.interactive.power import power_of
from accelcal.plots.interactive.ranking import ranking
from accelcal.plots.interactive.regions import regions
from accelcal.plots.interactive.residual import accel_side, one_step
from accelcal.plots.interactive.shape import shape
from accelcal.plots.interactive.signatures import signatures
from accelcal.plots.interactive.spectrum import spectrum
from accelcal.plots.interactive.tiles import tiles
from accelcal.plots.interactive.timeline import marks, timeline
from accelcal.plots.interactive.tracks import tracks
from accelcal.plots.interactive.whiteness import white

__all__ = [
    "accel_side",
    "coasting",
    "falling",
    "linked",
    "marks",
    "one_step",
    "power_of",
    "quantile_plot",
    "ranking",
    "regions",
    "shape",
    "signatures",
    "simulated",
    "spectrum",
    "tiles",
    "timeline",
    "tracks",
    "white",
]
