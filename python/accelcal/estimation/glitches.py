"""Glitches of the encoder: readings that jump away and come back."""

from __future__ import annotations

import numpy as np

from accelcal.data.arrays import Array, Flags

MIN_READINGS = 16
"""A record has at least this many encoder readings."""


SPIKE_SPEED = 10.0
"""A step this many times faster than 98 % of all steps may not belong to the motion."""
SPIKE_READINGS = 64
"""A spike is at most this many readings long."""
SPIKE_JUMP = 0.25
"""A spike covers at least this share of its height in one step; motion takes many."""
SPIKE_SHARE = 0.01
"""A spike longer than this share of the record is not a spike."""


def spikes(t: Array, z: Array) -> Flags:
    """Readings that jump away and come back: glitches of the encoder, not motion, (n,)."""
    found = np.zeros(len(z), dtype=np.bool_)
    known = int(np.sum(np.isfinite(z)))
    t, z = t[:known], z[:known]
    if known < MIN_READINGS:
        return found
    steps = np.diff(z)
    speed = np.abs(steps) / np.diff(t)
    usual = float(np.quantile(speed, 0.98))
    fast = np.flatnonzero(speed > SPIKE_SPEED * usual) if usual > 0.0 else np.empty(0, dtype=np.intp)
    longest = min(max(1, int(SPIKE_SHARE * len(z))), SPIKE_READINGS)
    if len(fast) > 0.02 * len(z):
        return found
    k = 0
    while k < len(fast):
        out = fast[k]
        near = fast[k + 1 : np.searchsorted(fast, out + longest, side="right")]
        back = [int(b) for b in near if _jumps_back(z[out : b + 2])]
        if not back:
            k += 1
            continue
        found[out + 1 : back[-1] + 1] = True
        k = int(np.searchsorted(fast, back[-1], side="right"))
    return found


def _jumps_back(z: Array) -> bool:
    """Whether readings leave their first value in few steps and return to it with the last."""
    height = float(np.max(np.abs(z - z[0])))
    return bool(abs(z[-1] - z[0]) < 0.2 * height and np.max(np.abs(np.diff(z))) > SPIKE_JUMP * height)
