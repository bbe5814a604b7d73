"""Stamps of a counter: one that wraps goes on, any other restart begins another part."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array
from accelcal.data.clocks import stamp_grid

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


FEWEST_PACKETS = 16
"""Packets from which on a clock is seen behind their arrivals."""
SMALLEST, LARGEST = 3, 4096
"""Samples of a packet."""
REGULAR = 0.9
"""Share of the jumps between stamps that lie a whole number of packets apart."""
EVEN = 2e-3
"""Share of a spacing by which those within a packet differ."""
LATE = 0.02
"""Least scatter of the spacings from packet to packet, in periods of a sample: fewer samples lost, or rounding, has
none."""
STRETCHES = 24
"""Parts of a record of each of which the earliest arrival counts."""
AHEAD = 8
"""Packets behind a late one by which the clock has caught up; where it has not, some were lost."""
STEADY = 3.0
"""Departure of an earliest arrival from a slowly drifting clock, in scatters of an arrival, beyond which the rate has
steps."""


@dataclass(frozen=True, slots=True)
class Packets:
    """One clock behind stamps that samples got when their packet arrived."""

    samples: int
    """Of a packet."""
    instants: Array
    """(n,) s"""
    rate: float
    """Hz, mean."""
    scatter: float
    """Standard deviation of the arrivals about the clock, s."""
    pieces: int
    """Of the clock, one more than its rate has steps."""


def packets(t: Array) -> Packets | None:
    """The clock behind stamps (n,) of packets; None where the stamps are not those of packets.

    Within a packet spacings are equal, and from one packet to the next they scatter. No packet comes early, so the
    clock runs through the earliest arrival of each stretch of the record: offset, rate, and slow drift.
    """
    spacing = np.diff(t)
    if len(t) < FEWEST_PACKETS * SMALLEST or np.array_equal(spacing[1:], spacing[:-1]):
        return None
    usual = float(np.median(spacing))
    jumps = np.flatnonzero(np.abs(spacing - usual) > EVEN * abs(usual)) + 1  # the first sample behind each
    if not FEWEST_PACKETS <= len(jumps) <= len(t) / (SMALLEST - 0.5):
        return _spread_packets(t, spacing)
    return _clock_behind(t, jumps)


def _spread_packets(t: Array, spacing: Array) -> Packets | None:
    """The same where the samples of each packet were spread evenly up to its arrival."""
    changes = np.flatnonzero(np.abs(np.diff(spacing)) > EVEN * float(np.median(np.abs(spacing)))) + 1
    return _clock_behind(t, changes + 1) if FEWEST_PACKETS <= len(changes) <= len(t) / (SMALLEST - 0.5) else None


def _clock_behind(t: Array, jumps: NDArray[np.intp]) -> Packets | None:
    """The clock behind packets, of which some begin at `jumps`."""
    sizes, counts = np.unique(np.diff(jumps), return_counts=True)
    n = int(sizes[np.argmax(counts)])
    regular = np.mean((jumps - jumps[0]) % n == 0)
    if not SMALLEST <= n <= LARGEST or regular < REGULAR or len(jumps) < 0.5 * len(t) / n:
        return None
    ends = np.arange(int(jumps[0]) % n + n - 1, len(t), n)
    arrival, between = t[ends], np.diff(t[ends])
    period = float(np.median(between))
    jitter = float(np.std(between[between < 1.5 * period])) / math.sqrt(2.0) if period > 0.0 else 0.0
    if not jitter > max(LATE * period / n, stamp_grid(t)):
        return None
    ahead = np.pad(arrival, (0, AHEAD), constant_values=math.inf) - period * np.arange(len(arrival) + AHEAD)
    ahead = np.lib.stride_tricks.sliding_window_view(ahead, AHEAD + 1).min(axis=1) + period * np.arange(len(arrival))
    lost = np.maximum(np.rint((ahead[1:] - arrival[:-1]) / period) - 1.0, 0.0) * (between > 1.5 * period)
    number = (
        np.arange(len(t))
        + n * np.concatenate([[0.0], np.cumsum(lost)])[np.searchsorted(ends, np.arange(len(t))).clip(0, len(lost))]
    )
    x = number - number[ends[0]]
    y, pieces = _earliest(x[ends], arrival - arrival[0], STEADY * jitter)
    # beyond the last arrivals the clock goes on as it is there
    slopes = (y[1] - y[0]) / (x[ends[1]] - x[ends[0]]), (y[-1] - y[-2]) / (x[ends[-1]] - x[ends[-2]])
    beyond = slopes[0] * np.minimum(x, 0.0) + slopes[1] * np.maximum(x - x[ends[-1]], 0.0)
    instants = arrival[0] + np.interp(x, x[ends], y) + beyond
    mean = float(x[ends[-1]] / (y[-1] - y[0]))
    return Packets(n, instants, mean, float(np.std(arrival - arrival[0] - y)), pieces)


def _earliest(x: Array, y: Array, most: float) -> tuple[Array, int]:
    """A slowly drifting clock through the earliest arrivals, at each packet, (m,), and of how many pieces it is."""
    edges = np.linspace(0, len(x), max(2, min(STRETCHES, len(x) // 4)) + 1).astype(int)
    line = clock = np.polynomial.Polynomial.fit(x, y, 1)
    for degree in (1, 2):
        left = y - clock(x)
        first = np.array([a + int(np.argmin(left[a:b])) for a, b in pairwise(edges)])
        clock = np.polynomial.Polynomial.fit(x[first], y[first], degree)
    if len(x) <= 2 * FEWEST_PACKETS or float(np.max(np.abs(y - clock(x))[first])) < most:
        return clock(x), 1
    kink = int(np.argmax(np.abs(y - line(x))[FEWEST_PACKETS:-FEWEST_PACKETS])) + FEWEST_PACKETS
    (before, some), (behind, more) = _earliest(x[:kink], y[:kink], most), _earliest(x[kink:], y[kink:], most)
    return np.concatenate([before, behind]), some + more
