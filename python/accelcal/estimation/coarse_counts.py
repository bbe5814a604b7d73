"""A resting coarse encoder: a run of equal counts is an interval, not a series of measurements."""

from __future__ import annotations

import math

import numpy as np

from accelcal.data.arrays import Array

FLIPS = 0.2
"""Changes of the count that the next one undoes, over repeated counts, above which noise dithers the counts.

White noise of a fifth of a count exceeds it at rest; the mean of such readings is no farther from the position than a
seventh of a count, and rounding errors are as good as white.
"""
MEMORIES = 1.0
"""Length from which a run of equal counts is long, in time constants of the filter, which averages over one."""


def distinct_readings(t: Array, z: Array, apart: int) -> tuple[Array, Array]:
    """Readings that a coarse encoder is worth: of each long run of equal counts a few, at a distance.

    Parameters
    ----------
    t, z : (n,) s and m, on a grid of counts.
    apart : readings from which a run is long; of it, one reading is left in as many.

    Returns
    -------
    Times and readings, (m,) each; `t` and `z` themselves where noise dithers the counts.

    Notes
    -----
    Rounding errors of an encoder whose noise is far below its count are those of the position. While it rests they are
    equal, and hundreds of readings say what one says: the position lies in an interval of one count, variance step²/12.
    Each stretch of such a run becomes one reading at its mean time. Shorter runs are kept: the filter takes their mean,
    and while the speed changes, the mean time of a run is not that of the middle of its count.
    """
    change = np.diff(z)
    rises = change[change != 0.0] > 0.0
    repeated = len(change) - len(rises)
    if repeated == 0 or int(np.sum(rises[1:] != rises[:-1])) > FLIPS * repeated:
        return t, z
    begins = np.concatenate([[0], np.flatnonzero(change) + 1])
    lengths = np.diff(begins, append=len(z))
    parts = np.where(lengths <= apart, lengths, -(-lengths // apart))
    first = np.repeat(np.cumsum(parts) - parts, lengths)
    place = np.arange(len(z)) - np.repeat(begins, lengths)
    stretch = first + place * np.repeat(parts, lengths) // np.repeat(lengths, lengths)
    count = np.bincount(stretch)
    times = t[0] + np.bincount(stretch, weights=t - t[0]) / count
    return np.asarray(times), np.ascontiguousarray(np.repeat(z[begins], parts))


def readings_apart(output: Array, accel_step: float, declared: float | None, reading_step: float, step: float) -> int:
    """Readings within the memory of the filter, for rounding errors of a count and the noise of an output.

    Parameters
    ----------
    output : (n,) m/s²; third differences give its noise, 20 times the variance of white samples.
    accel_step, reading_step : spacings, s.
    declared : one-sided noise density, (m/s²)/sqrt(Hz); the larger of the two counts, since a low-pass hides noise.
    step : one count, m.
    """
    third = np.diff(output, 3)
    spread = float(np.median(np.abs(third - np.median(third)))) / 0.6745
    q = max(spread**2 / 20.0 * accel_step, 0.5 * (declared or 0.0) ** 2, 1e-300)
    memory = (step**2 / 12.0 * reading_step / q) ** 0.25
    return max(1, math.ceil(min(MEMORIES * float(memory) / reading_step, 1e9)))
