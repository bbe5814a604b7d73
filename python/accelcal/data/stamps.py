"""Stamps of a counter: one that wraps goes on, any other restart begins another part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array

BITS = (16, 24, 31, 32)
"""Widths of counters, signed and unsigned."""
FRAME_BITS = (8, *BITS)
"""The same of a counter of frames."""
DECIMALS = 10
"""Decimals with which ticks may be written in a larger unit: microseconds as seconds, say."""
LEAST_TURN = 4.0
"""Usual spacings that a counter counts at least."""
NEAR_TOP = 20.0
"""Usual spacings from either end of a counter within which it wraps, whatever was lost there."""


def unwrapped(stamps: Array, bits: tuple[int, ...] = BITS) -> tuple[Array, NDArray[np.intp]]:
    """Stamps (n,) of a counter that wraps, as if it did not, and the first index behind each wrap.

    A jump back by 2^k ticks, with the usual spacing behind it, or from one end of the counter to the other, is a wrap.
    """
    spacing = np.diff(stamps)
    back = np.flatnonzero(spacing < 0.0)
    if not len(back) or not np.any(spacing > 0.0):
        return stamps, back
    usual = float(np.median(spacing[spacing > 0.0]))
    before, behind = stamps[back], stamps[back + 1]
    best, size = np.zeros(len(back), dtype=np.bool_), 0.0
    for ticks in (2.0**k / 10.0**m for k in bits for m in range(DECIMALS)):
        if ticks < LEAST_TURN * usual:
            continue
        after = behind - before + ticks
        near = min(NEAR_TOP * usual, 0.1 * ticks)
        ends = [(before > top - near) & (behind < top - ticks + near) for top in (ticks, 0.5 * ticks)]
        wraps = (np.abs(after - usual) < 0.5 * usual) | ((after > 0.0) & (ends[0] | ends[1]))
        if np.count_nonzero(wraps) > np.count_nonzero(best):
            best, size = wraps, ticks
    rows = back[best] + 1
    if not len(rows):
        return stamps, rows
    turns = np.zeros(len(stamps))
    turns[rows] = size
    return stamps + np.cumsum(turns), rows
