"""How often an effect that was put into simulated records is found, beside how often it should be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

import accelcal as ac
from accelcal.diagnose import scan
from accelcal.fit import solve_runs
from accelcal.motion import Motion, motion
from accelcal.power import Power, power_of_motion
from accelcal.rig import Rig

RIGS = {"ADXL105": ac.ADXL105_RIG, "CXL02": ac.CXL02_RIG}


@dataclass(frozen=True, slots=True)
class Pair:
    """An effect on a motion, so large that it stands `d` standard deviations from nothing."""

    effect: str
    motion: str
    sensor: str
    d: float
    seconds: float = 20.0

    @property
    def rig(self) -> Rig:
        return RIGS[self.sensor]

    @property
    def planned(self) -> Motion:
        return motion(self.motion, self.seconds, np.random.default_rng(11))


@cache
def predicted(pair: Pair) -> Power:
    """From the motion and the data sheet alone."""
    return power_of_motion(pair.planned, pair.rig)


def found(pair: Pair, seed: int) -> bool:
    """Whether anything enters when the effect is hidden in a record."""
    size = pair.d / predicted(pair)[pair.effect].d[0]
    rng = np.random.default_rng([seed, 2007])
    truth = {"bias": 0.05, "scale_factor": 0.01, pair.effect: size}
    made = ac.simulate(pair.planned, seconds=pair.seconds, rig=pair.rig, parameters=truth, rng=rng)
    model = ac.Model.linear()
    return bool(scan(solve_runs(model, [made.recording]).passes, model).found)


def count(pair: Pair, seeds: Sequence[int]) -> int:
    """Records in which something was found."""
    return sum(found(pair, seed) for seed in seeds)
