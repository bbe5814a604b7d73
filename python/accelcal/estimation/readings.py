"""Glitches of the encoder: readings that jump away and come back while the output sees no motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelcal.data import Array, Channel, Flags, running_integral, runs_of, white_variance
from accelcal.signals.series import grid_step

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
AROUND = 8
"""Least number of readings on either side of a spike that are compared with the output."""
SEEN = 0.8
"""Share of the power of its fast steps that the output explains where it saw an excursion. What the output holds is
smooth, so it explains next to nothing of a jump."""


def spikes(t: Array, z: Array, output: Channel) -> Flags:
    """Readings that jump away and come back: glitches of the encoder, not motion, (n,).

    Parameters
    ----------
    t, z : instants (n,) s and readings (n,) m; readings that are not known are NaN, at the end.
    output : of the accelerometer, m/s²; an excursion that it saw is motion, however rare.
    """
    spiky = np.zeros(len(z), dtype=np.bool_)
    finite = int(np.sum(np.isfinite(z)))
    t, z = t[:finite], z[:finite]
    if finite < MIN_READINGS:
        return spiky
    speed = np.abs(np.diff(z)) / np.diff(t)
    usual = float(np.quantile(speed, 0.98))
    fast = np.flatnonzero(speed > SPIKE_SPEED * usual) if usual > 0.0 else np.empty(0, dtype=np.intp)
    longest = min(max(1, int(SPIKE_SHARE * len(z))), SPIKE_READINGS)
    if len(fast) > 0.02 * len(z):
        return spiky
    constant = float(np.median(output.y)) if len(fast) else 0.0
    k = 0
    while k < len(fast):
        out = fast[k]
        near = fast[k + 1 : np.searchsorted(fast, out + longest, side="right")]
        back = [int(b) for b in near if _jumps_back(z[out : b + 2])]
        if not back:
            k += 1
            continue
        around = max(AROUND, back[-1] - int(out))
        rows = slice(max(0, out - around), back[-1] + 2 + around)
        jumps = fast[(fast >= out) & (fast <= back[-1])] - rows.start
        if not _seen(t[rows], z[rows], jumps, output, constant):
            spiky[out + 1 : back[-1] + 1] = True
        k = int(np.searchsorted(fast, back[-1], side="right"))
    return spiky


def _jumps_back(z: Array) -> bool:
    """Whether readings leave their first value in few steps and return to it with the last."""
    height = float(np.max(np.abs(z - z[0])))
    return bool(abs(z[-1] - z[0]) < 0.2 * height and np.max(np.abs(np.diff(z))) > SPIKE_JUMP * height)


def _seen(t: Array, z: Array, jumps: NDArray[np.intp], output: Channel, constant: float) -> bool:
    """Whether the output, integrated twice, explains the steps of the readings at `jumps`.

    Its scale is free, and its first integral stands for a delay; `constant` is its value at rest.
    """
    covered = slice(*np.searchsorted(output.t, [t[0], t[-1]]))
    at, u = output.t[covered], output.y[covered] - constant
    if len(at) < AROUND:
        return False
    step = np.diff(at)
    velocity = running_integral(u, step)
    position = np.concatenate([[0.0], np.cumsum(step * (velocity[:-1] + step * (2.0 * u[:-1] + u[1:]) / 6.0))])
    x = (t - t[0]) / (t[-1] - t[0])
    line = np.column_stack([np.ones_like(x), x])
    motion = np.column_stack([np.interp(t, at, position), np.interp(t, at, velocity)])
    beyond, motion = _without(line, z), _without(line, motion)
    size = np.sqrt(np.einsum("ik,ik->k", motion, motion))
    left = _without(motion / np.where(size > 0.0, size, 1.0), beyond)
    unexplained, step_before = np.diff(left)[jumps], np.diff(beyond)[jumps]
    return bool(unexplained @ unexplained < (1.0 - SEEN) * (step_before @ step_before))


def _without(columns: Array, y: Array) -> Array:
    """What columns do not explain, by least squares."""
    return np.asarray(y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0])


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
    begins, lengths = runs_of_one_count(z)
    parts = np.where(lengths <= apart, lengths, -(-lengths // apart))
    first = np.repeat(np.cumsum(parts) - parts, lengths)
    place = np.arange(len(z)) - np.repeat(begins, lengths)
    stretch = first + place * np.repeat(parts, lengths) // np.repeat(lengths, lengths)
    count = np.bincount(stretch)
    times = t[0] + np.bincount(stretch, weights=t - t[0]) / count
    return np.asarray(times), np.ascontiguousarray(np.repeat(z[begins], parts))


def runs_of_one_count(z: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First reading and number of readings of each run of equal readings (n,)."""
    begins = np.concatenate([[0], np.flatnonzero(np.diff(z)) + 1])
    return begins, np.diff(begins, append=len(z))


HELD = 16
"""Readings over which an angle is averaged before it is asked whether the arm rests. Noise that dithers half of them to
the next count changes that mean by 0.18 counts. [readings; tests/estimation/test_arms.py]"""

AT_REST = 0.75
"""Change of that mean to the next below which the arm rests: four times what dither makes of it. [counts;
tests/estimation/test_arms.py]"""


MOST_RESTS = 100
"""Rests whose rounding error has a column of its own; of more, the time of a fit grows by the square. [rests;
tests/estimation/test_arms.py]"""


@dataclass(frozen=True, slots=True)
class AngleError:
    """What rounding to counts, and the noise that dithers them, make of an angle: all as for an arm that is level."""

    spans: Array
    """Begin and end of each rest, (rests, 2) s."""
    apart: Flags
    """Rests that have a column each, the longest, (rests,); in the others noise leaves the mean as uncertain."""
    shared: float
    """Standard deviation of the error that all readings of a rest share, rad."""
    resting: float
    """Variance of what they do not share, rad²."""
    moving: float
    """Variance of a reading while the arm turns, rad²."""

    @classmethod
    def of(cls, t: Array, angle: Array) -> AngleError | None:
        """Of readings (n,) s and rad; None where they do not lie on a grid.

        Notes
        -----
        With noise σ the mean reading at x is off by a Fourier series in x/count, whose k-th harmonic is count/(π k)
        exp(-2 π² k² σ²/count²). While σ is below a count, the variance of readings is σ count/√π in the mean over x.
        """
        count = grid_step(angle)
        if count == 0.0:
            return None
        mean = np.convolve(angle - angle[0], np.full(HELD, 1.0 / HELD), "valid")
        spans = runs_of(np.abs(mean[HELD:] - mean[:-HELD]) < AT_REST * count) + np.array([0, 2 * HELD - 2])
        spans = np.array([[a, b] for a, b in spans if np.ptp(mean[a : b - HELD + 2]) <= 2.0 * count], dtype=np.intp)
        spans = spans.reshape(-1, 2)
        spans[:-1, 1] = np.minimum(spans[:-1, 1], spans[1:, 0] - 1)
        inside = HELD // 2  # at its ends the arm still moves a little
        scatter = [(np.var(angle[a + inside : b - inside + 1]), b - a) for a, b in spans if b - a > HELD]
        spread = sum(v * n for v, n in scatter) / sum(n for _, n in scatter) if scatter else 0.0
        k, sigma = np.arange(1.0, 100.0), math.sqrt(math.pi) * spread / count
        shared = float(np.sum(np.exp(-((2.0 * np.pi * k * sigma / count) ** 2)) / k**2)) * count**2 / (2.0 * np.pi**2)
        apart = np.argsort(np.argsort(spans[:, 0] - spans[:, 1], kind="stable")) < MOST_RESTS
        return cls(t[spans], apart, math.sqrt(shared), spread, sigma**2 + count**2 / 12.0)

    def variance_at(self, t: Array, step: float) -> Array:
        """Variance of what readings at these times, `step` s apart, do not share, (n,) rad²."""
        place = np.searchsorted(self.spans[:, 0], t, side="right") - 1
        resting = (place >= 0) & (t <= np.append(self.spans[:, 1], -np.inf)[place])
        alone = np.where(self.apart, 0.0, self.shared**2 * np.ptp(self.spans, axis=1) / step)
        return np.where(resting, self.resting + np.append(alone, 0.0)[place], self.moving)


def readings_apart(output: Array, accel_step: float, declared: float | None, reading_step: float, step: float) -> int:
    """Readings within the memory of the filter, for rounding errors of a count and the noise of an output.

    Parameters
    ----------
    output : (n,) m/s²; third differences give its noise, 20 times the variance of white samples.
    accel_step, reading_step : spacings, s.
    declared : one-sided noise density, (m/s²)/sqrt(Hz); the larger of the two counts, since a low-pass hides noise.
    step : one count, m.
    """
    q = max(white_variance(output) * accel_step, 0.5 * (declared or 0.0) ** 2, 1e-300)
    memory = (step**2 / 12.0 * reading_step / q) ** 0.25
    return max(1, math.ceil(min(MEMORIES * float(memory) / reading_step, 1e9)))
