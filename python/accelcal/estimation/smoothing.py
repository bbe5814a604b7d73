"""Smoothed motion at the accelerometer's rate, thinned to what its bandwidth needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array
from accelcal.signals.processing import GRID_PER_CUTOFF


@dataclass(frozen=True, slots=True)
class Thinning:
    """As few of the uniform times as a bandwidth needs, one step beyond the last."""

    t: Array
    """Times that are kept, s."""
    every: int

    @classmethod
    def of(cls, t: Array, step: float, cutoff: float) -> Thinning:
        """Thin times `t`, `step` s apart, for signals up to `cutoff` Hz."""
        every = max(1, int(1.0 / (step * GRID_PER_CUTOFF * cutoff)))
        return cls(np.arange(0, len(t) + every, every) * step + t[0], every)

    def thin(self, y: Array) -> Array:
        """Values at the kept times; the last one is held beyond the end."""
        y = y[:: self.every]
        return np.concatenate([y, np.full(len(self.t) - len(y), y[-1])])


@dataclass(frozen=True, slots=True)
class SmoothedMotion:
    """Motion of the stage at uniform times, (n,) each: m, m/s, m/s², m/s³."""

    p: Array
    v: Array
    a: Array
    jerk: Array
