"""Process noise of intervals whose motion the samples do not hold: jumps that sampling hides, and holes."""

from __future__ import annotations

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.recording import Channel
from accelcal.signals.jumps import Jumps, lost_velocity
from accelcal.signals.series import FilledSeries, interpolation_spread

JUMP_WINDOW = 1.5
"""Samples to either side of a jump over which its error is spread."""
CURVATURE = 1.0 / 64.0
"""Error of a cubic over a hole, as a share of the third difference of samples a hole apart, which bounds it."""


def extra_density(t: Array, accel: Channel, step: float, jumps: Jumps, filled: FilledSeries) -> Array:
    """Density of process noise, beyond that of the record, over the interval before each reading, (n,) (m/s²)²/Hz.

    Derivations 6.6. A jump of the motion between two samples, and the motion over a hole, move the velocity by an
    amount that no interpolation knows.

    Parameters
    ----------
    t : (n,) times of the readings, s.
    accel, step : the output, m/s², and the usual spacing of its samples, s.
    jumps, filled : what its samples do not resolve, and what was filled in.
    """
    spans = [jump_variances(jumps, step)] if len(jumps.t) else []
    spans += [hole_variances(accel, step, filled)] if len(filled.begin) else []
    h = np.diff(t, prepend=t[0])
    gained = np.zeros_like(t)
    for begin, end, variance in spans:
        edges = np.column_stack([begin, end]).ravel()
        total = np.cumsum(variance)
        reached = np.column_stack([np.append(0.0, total[:-1]), total]).ravel()
        gained += np.diff(np.interp(t, edges, reached, left=0.0), prepend=0.0)
    return np.asarray(np.where(h > 0.0, np.maximum(gained, 0.0) / np.where(h > 0.0, h, step), 0.0))


def jump_variances(jumps: Jumps, step: float) -> tuple[Array, Array, Array]:
    """Spans about the jumps of the motion, s, and variance of the velocity that is lost in each, (m/s)²."""
    window = JUMP_WINDOW * step
    return jumps.t - window, jumps.t + window, lost_velocity(jumps, step) ** 2


def hole_variances(accel: Channel, step: float, filled: FilledSeries) -> tuple[Array, Array, Array]:
    """Spans without samples, s, and variance of the velocity that is lost in each beyond the usual, (m/s)²."""
    sigma = interpolation_spread(accel.t, accel.y)
    length = filled.end - filled.begin
    nodes = filled.begin[:, None] + length[:, None] * np.array([-1.0, 0.0, 1.0, 2.0])
    curved = np.abs(np.interp(nodes, filled.t, filled.y) @ np.array([1.0, -3.0, 3.0, -1.0])) * CURVATURE * length
    motion = np.where(filled.filled, 0.0, curved)
    return filled.begin, filled.end, filled.noise * (sigma * step) ** 2 + motion**2
