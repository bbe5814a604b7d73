"""Records whose low-pass is off by a draw from its tolerance, and what a fit makes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from accelcal import Model, simulate
from accelcal.data.recording import Recording
from accelcal.data.rig import LowPass
from accelcal.estimation.estimate import estimate
from accelcal.simulation import CXL02_RIG

NAMES = ("bias", "scale_factor", "time_offset")
TRUTH = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 1e-4}
DECLARED = CXL02_RIG.lowpass
assert DECLARED is not None


def record(seed: int, motion: str, tolerance: float, *, declared: bool, seconds: float = 20.0) -> Recording:
    """A record behind an RC whose time constant is normally distributed about the declared one.

    Parameters
    ----------
    tolerance : relative standard deviation of the time constant.
    declared : whether the sidecar says so.
    """
    rng = np.random.default_rng([159, seed])
    assert DECLARED is not None
    slower = 1.0 + tolerance * float(rng.standard_normal())
    built = replace(CXL02_RIG, lowpass=LowPass(DECLARED.cutoff / slower))
    simulation = simulate(motion, seconds=seconds, rig=built, parameters=TRUTH, rng=rng)
    rig = replace(CXL02_RIG, lowpass=LowPass(DECLARED.cutoff, tolerance if declared else None))
    return replace(simulation.recording, rig=rig)


def normalised(seed: int, motion: str, tolerance: float, *, declared: bool = True) -> list[float]:
    """Error over reported standard deviation of each of `NAMES`."""
    fit = estimate(Model.linear(), record(seed, motion, tolerance, declared=declared))
    return [(fit[name].value - TRUTH[name]) / fit[name].std for name in NAMES]
