"""Robust standard deviation of a series, over a moving stretch."""

from __future__ import annotations

import numpy as np

from accelcal.data.arrays import Array

LOCAL = 64
"""Readings over which a local spread is taken."""


def local_spread(y: Array) -> Array:
    """Robust standard deviation about each sample, (n,): the largest of its block and both neighbours, and no less
    than that of the whole."""
    whole = float(np.median(np.abs(y))) / 0.6745
    K = len(y) // LOCAL
    if K < 3:
        return np.full(len(y), max(whole, 1e-300))
    each = np.median(np.abs(y[: K * LOCAL].reshape(K, LOCAL)), axis=1) / 0.6745
    each = np.maximum(np.maximum(each, np.append(each[1:], 0.0)), np.append(0.0, each[:-1]))
    index = np.minimum(np.arange(len(y)) // LOCAL, K - 1)
    return np.asarray(np.maximum(each, max(whole, 1e-300))[index])
