"""Rests in a long record: stretches in which every channel is as quiet as it is at its quietest."""

from __future__ import annotations

import numpy as np

from accelcal.data import Array

WINDOW = 1.0
"""Length of the moving window over which a channel is judged, s."""
LEAST_NOISY = 0.05
"""Share of the windows of a record that are taken to be at rest, whatever it is."""
WITHIN = 3.0
"""Standard deviation in a window, over that of the quietest, up to which the sensor rests."""
FEWEST = 8
"""Samples of a window at least."""


def rests(t: Array, outputs: Array, least: float = 2.0, *, factor: float = WITHIN) -> list[tuple[int, int]]:
    """First and last sample of each rest.

    Parameters
    ----------
    t : (n,) s, rising.
    outputs : (n, channels), any unit.
    least : shortest rest, s.
    factor : standard deviation in a window over that of the quietest windows up to which the sensor rests.

    Notes
    -----
    A window of 1 s moves over each channel; where its standard deviation is within `factor` of that of the quietest
    twentieth of all windows, in every channel, its middle is at rest. Slow motion moves the mean within a window and
    is none.
    """
    rate = 1.0 / float(np.median(np.diff(t)))
    half = max(FEWEST, int(WINDOW * rate)) // 2
    if len(t) <= 2 * half:
        return []
    quiet = np.ones(len(t) - 2 * half, dtype=np.bool_)
    for y in outputs.T:
        spread = moving_std(y - np.mean(y), 2 * half + 1)
        counts = np.unique(np.abs(np.diff(y)))
        step = float(counts[counts > 0.0][0]) if np.any(counts > 0.0) else 0.0
        floor = max(float(np.quantile(spread, LEAST_NOISY)), step / np.sqrt(12.0))
        quiet &= spread <= factor * floor
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]])))
    found = [(int(a) + half, int(b) - 1 + half) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [(a, b) for a, b in found if t[b] - t[a] >= least]


def moving_std(y: Array, width: int) -> Array:
    """Standard deviation over each window of `width` samples, (n - width + 1,)."""
    sums, squares = (np.concatenate([[0.0], np.cumsum(power)]) for power in (y, y**2))
    mean = (sums[width:] - sums[:-width]) / width
    return np.asarray(np.sqrt(np.maximum((squares[width:] - squares[:-width]) / width - mean**2, 0.0)))
