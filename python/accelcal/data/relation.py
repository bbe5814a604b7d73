"""Relation of an output to the second derivative of a position: how much of it, and how alike both are."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from accelcal.data.clocks import usual_step
from accelcal.data.recording import Channel

SEGMENTS = 8
"""Segments of the record, before they overlap by half."""
SHORTEST = 32
"""Samples of a segment, least."""
EDGES = 8
"""Edges of the bands that are tried, from two periods in a segment to a quarter of the rate."""
ALIKE = 0.9
"""Correlation with the second derivative of a position from which a column is the output."""


@dataclass(frozen=True, slots=True)
class Relation:
    """How an output follows the acceleration of a position in the band in which both are most alike."""

    slope: float
    """Output per acceleration."""
    correlation: float
    """-1 to 1; 0 where the channels are too short to tell."""


def relation(output: Channel, position: Channel) -> Relation:
    """Slope and correlation of an output, (n,) in any unit, and the second derivative of a position, (m,) m.

    Examples
    --------
    >>> t = np.arange(0.0, 20.0, 0.01)
    >>> p, a = np.sin(3.0 * t), -9.0 * np.sin(3.0 * t)
    >>> alike = relation(Channel("accel", t, a, "m/s^2"), Channel("position", t, p, "m"))
    >>> round(alike.slope, 3), round(alike.correlation, 3)
    (1.0, 1.0)
    """
    step = max(usual_step(output.t), usual_step(position.t))
    first, last = max(output.t[0], position.t[0]), min(output.t[-1], position.t[-1])
    count = int((last - first) / step)
    segment = max(count // SEGMENTS, SHORTEST)
    if count < 2 * segment:
        return Relation(0.0, 0.0)
    at = first + step * np.arange(count)
    u, z = (np.interp(at, channel.t, channel.y) for channel in (output, position))
    both = u[1:-1], np.diff(z, 2) / step**2
    window = np.hanning(segment)
    spectra = []
    for y in both:
        parts = np.lib.stride_tricks.sliding_window_view(y, segment)[:: segment // 2]
        spectra.append(np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * window, axis=1))
    u, a = spectra
    sums = [
        np.concatenate([[0.0], np.cumsum(np.sum(power, axis=0))])
        for power in ((u * a.conj()).real, abs(u) ** 2, abs(a) ** 2)
    ]
    best = Relation(0.0, 0.0)
    for low, high in combinations(np.unique(np.geomspace(2, segment // 4, EDGES).astype(int)).tolist(), 2):
        cross, of_output, of_motion = (float(total[high + 1] - total[low]) for total in sums)
        if of_output > 0.0 and of_motion > 0.0:
            alike = cross / (of_output * of_motion) ** 0.5
            best = max(best, Relation(cross / of_motion, alike), key=lambda tried: abs(tried.correlation))
    return best
