"""Relation of an output to the second derivative of a position: how much of it, and how alike both are."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from accelcal.data.clocks import usual_step
from accelcal.data.recording import Channel

SEGMENTS, SHORTEST = 8, 32
"""Segments of the record, before they overlap by half, and samples of one, least."""
EDGES = 8
"""Edges of the bands that are tried, from two periods in a segment to a quarter of the rate."""
ALIKE = 0.9
"""Correlation with the second derivative of a position from which a column is the output."""


def relation(output: Channel, position: Channel) -> tuple[float, float]:
    """Slope and correlation of an output, (n,), and the second derivative of a position, (m,) m, in the band in which
    they are most alike; 0 and 0 where they are too short to tell.

    Examples
    --------
    >>> t = np.arange(0.0, 20.0, 0.01)
    >>> p, a = np.sin(3.0 * t), -9.0 * np.sin(3.0 * t)
    >>> slope, correlation = relation(Channel("accel", t, a, "m/s^2"), Channel("position", t, p, "m"))
    >>> round(slope, 3), round(correlation, 3)
    (1.0, 1.0)
    """
    step = max(usual_step(output.t), usual_step(position.t))
    first, last = max(output.t[0], position.t[0]), min(output.t[-1], position.t[-1])
    count = int((last - first) / step)
    segment = max(count // SEGMENTS, SHORTEST)
    if count < 2 * segment:
        return 0.0, 0.0
    y, z = (np.interp(first + step * np.arange(count), channel.t, channel.y) for channel in (output, position))
    parts = np.lib.stride_tricks.sliding_window_view([y[1:-1], np.diff(z, 2) / step**2], segment, axis=1)
    parts = parts[:, :: segment // 2]
    u, a = np.fft.rfft((parts - parts.mean(axis=2, keepdims=True)) * np.hanning(segment), axis=2)
    powers = np.array([(u * a.conj()).real, np.abs(u) ** 2, np.abs(a) ** 2]).sum(axis=1)
    tried = [(0.0, 0.0)]
    for low, high in combinations(np.unique(np.geomspace(2, segment // 4, EDGES).astype(int)).tolist(), 2):
        cross, of_output, of_motion = powers[:, low:high].sum(axis=1).tolist()
        if of_output > 0.0 and of_motion > 0.0:
            tried.append((cross / of_motion, cross / (of_output * of_motion) ** 0.5))
    return max(tried, key=lambda pair: abs(pair[1]))
