"""Live filters: the paper's nonlinear Kalman filters over a record, a stream, or at a fixed rate."""

from accelcal._support.values import listing
from accelcal.filters.choice import MOTION, PARAMETERS, FilterChoice, GaussMarkov
from accelcal.filters.record import BatchRun, FilterRun, ForwardParameters, forward_parameters, run, run_batch
from accelcal.filters.stream import MOST_EFFECTS, LiveFilter, fixed_rate, fixed_rate_with_effects

__all__ = [
    "MOST_EFFECTS",
    "MOTION",
    "PARAMETERS",
    "BatchRun",
    "FilterChoice",
    "FilterRun",
    "ForwardParameters",
    "GaussMarkov",
    "LiveFilter",
    "fixed_rate",
    "fixed_rate_with_effects",
    "forward_parameters",
    "run",
    "run_batch",
]


__dir__ = listing(globals())
