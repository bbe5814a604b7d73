"""One simulated recording for all tests of the search."""

from __future__ import annotations

import numpy as np
import pytest

import accelcal as ac
from accelcal.simulation import CXL02_RIG
from accelcal.simulation.sensor import Simulated

TRUTH = {"bias": 0.05, "scale_factor": 0.01}


@pytest.fixture(scope="module")
def plain() -> Simulated:
    rng = np.random.default_rng(5)
    return ac.simulate("interleaved", seconds=40.0, rig=CXL02_RIG, parameters=TRUTH, rng=rng)
