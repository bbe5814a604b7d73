"""Time stamps that are coarser than the clock of their samples: the grid on which they lie, and the clock behind them.

A logger that rounds its stamps, or that asks a slower sensor at ticks of its own, moves each stamp by less than one
step of a grid. Where one uniform clock explains every stamp of a channel within that step, the instants of the clock
are known far better than any stamp, and take their place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data.arrays import Array

FEWEST = 100
"""Samples below which a clock is not told from chance."""
FINEST = 0.01
"""Least step of a grid over the usual spacing: rounding below moves a sample by 0.3 % of what it changes by."""
MOST_SPACINGS = 300
"""Different spacings at most: twice the usual spacing on the finest grid, and what holes add."""
EQUAL = 1e-4
"""Spacings that differ by less than this share of the usual one are equal."""
WITHIN = 1.05
"""Range of the stamps' errors, in steps, within which one clock explains them: 1, and the drift of a crystal."""
SPANNED = 0.5
"""Least range of the errors, in steps: a clock whose period is a multiple of the step shows no rounding."""
RUNS = (1.75, 2.5, math.inf)
"""Spacings up to these multiples of the usual one are tried as those without a missing sample."""
BLOCKS = 512
"""Stretches of which the earliest and the latest stamp bound the clock."""
CLEARLY = 0.1
"""Coherence with the mean spacing beyond that with the median one from which on the mean one is the period."""
DECIMALS = tuple(10.0**-k for k in range(13))
"""Steps of stamps that are written with so many decimals, s."""
SQRT12 = math.sqrt(12.0)


@dataclass(frozen=True, slots=True)
class UniformClock:
    """The uniform clock nearest to stamps, whose largest error is as small as it can be."""

    period: float
    """s"""
    instants: Array
    """(n,) s, in the middle between the earliest and the latest stamp."""
    spread: float
    """Range of the stamps about them, s."""
    bounds: tuple[Array, Array, Array]
    """Stamps that bound the clock: +1 for a latest and -1 for an earliest one, place from -1 to 1, error, s, (m,)."""

    def explains(self, step: float) -> bool:
        """Whether errors of one `step`, s, and no other, lie between the clock and the stamps."""
        return SPANNED * step < self.spread < WITHIN * step

    def common_std(self, step: float) -> float:
        """Standard deviation of the error that all instants share, s: the middle of the clock may lie anywhere in what
        stamps within half a `step` on either side allow. Periods close to a fraction of the step leave much of it."""
        sign, place, error = self.bounds
        left = np.column_stack([-sign, -sign * place])
        ends = [
            scipy.optimize.linprog([way, 0.0], left, 0.5 - sign * error / step, bounds=[(None, None)] * 2)
            for way in (1.0, -1.0)
        ]
        range_of_middle = -sum(float(end.fun) for end in ends) if all(end.success for end in ends) else 0.0
        return rounding_std(step * max(0.0, range_of_middle))


def stamp_grid(t: Array) -> float:
    """Step of the grid on which stamps (n,) lie, s; 0 where they lie on none that matters.

    The spacings of rounded stamps take few values, whole multiples of one step.
    """
    if len(t) < FEWEST:
        return 0.0
    spacing = np.diff(t)
    usual = float(np.median(spacing))
    fine = max(EQUAL * usual, 16.0 * float(np.spacing(np.max(np.abs(t)))))
    levels = fine * np.unique(np.rint(spacing / fine))
    if len(levels) > MOST_SPACINGS:
        return 0.0
    gaps = np.diff(levels)
    step = float(np.min(gaps[gaps > 2.5 * fine], initial=math.inf))
    if not FINEST * usual < step < 1.5 * usual:
        return 0.0
    for _ in range(2):
        count = np.rint(spacing / step)
        step = float(spacing @ count) / float(count @ count)
    return step if float(np.max(np.abs(spacing - count * step))) < 2.0 * fine else 0.0


def decimal_step(t: Array) -> float:
    """Largest power of ten of a second of which all stamps (n,) are multiples, s: a clock that is written with so many
    decimals; 0 where it is written with all that a double holds."""
    last = float(np.spacing(np.max(np.abs(t), initial=0.0)))
    for step in DECIMALS:
        if step <= 16.0 * last:
            return 0.0
        if float(np.max(np.abs(t - np.rint(t / step) * step), initial=0.0)) <= 2.0 * last:
            return step
    return 0.0


def uniform_clock(t: Array) -> UniformClock:
    """The uniform clock nearest to stamps (n,), s; samples may be missing.

    Rounded stamps bound the clock on either side, sample by sample: the line with the least largest error lies in the
    middle of what all of them allow, and is far better known than the line of least squares.
    """
    spacing = np.diff(t)
    usual = float(np.median(spacing))
    periods = {float(np.mean(spacing[spacing < share * usual])) for share in RUNS}
    return min((_nearest_clock(t, spacing, period) for period in sorted(periods)), key=lambda clock: clock.spread)


def _nearest_clock(t: Array, spacing: Array, period: float) -> UniformClock:
    """The uniform clock nearest to stamps, whose period is about `period`."""
    place = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(spacing / period), 1.0))])
    middle, centre = float(np.mean(t)), float(np.mean(place))
    place -= centre
    slope = float(place @ (t - middle)) / float(place @ place)
    error = t - middle - slope * place
    begins = np.arange(0, len(t), max(1, len(t) // BLOCKS))
    latest = np.array([begin + int(np.argmax(part)) for begin, part in _parts(error, begins)])
    earliest = np.array([begin + int(np.argmin(part)) for begin, part in _parts(error, begins)])
    # Least h with |error - c - d place| <= h at the extremes of all blocks, in units of the range and of the length.
    size, length = max(float(np.ptp(error)), 1e-300), float(np.max(np.abs(place)))
    rows = np.concatenate([latest, earliest])
    sign = np.repeat([1.0, -1.0], [len(latest), len(earliest)])
    left = np.column_stack([-sign, -sign * place[rows] / length, -np.ones(len(rows))])
    found = scipy.optimize.linprog([0.0, 0.0, 1.0], left, -sign * error[rows] / size, bounds=[(None, None)] * 3)
    if found.success:
        middle += size * float(found.x[0])
        slope += size * float(found.x[1]) / length
    instants = middle + slope * place
    error = t - instants
    return UniformClock(slope, instants, float(np.ptp(error)), (sign, place[rows] / length, error[rows]))


def _parts(y: Array, begins: NDArray[np.intp]) -> Iterator[tuple[int, Array]]:
    """Each block of a series with the index at which it begins."""
    return zip(begins.tolist(), np.split(y, begins[1:]), strict=True)


def usual_step(t: Array) -> float:
    """Period with which stamps (n,) s come: the median spacing, or the mean one where stamps keep step with that only.

    The median spacing of an uneven clock is off by a fraction of its scatter, and a grid of that period would slip by
    samples over a record; where samples are missing, the mean spacing is none at all. Periods between which no stamp
    changes its phase by as much as `CLEARLY`, rad, are not told apart.
    """
    spacing = np.diff(t)
    median, mean = float(np.median(spacing)), float(np.mean(spacing))
    if 2.0 * np.pi * float(t[-1] - t[0]) * abs(1.0 / mean - 1.0 / median) < CLEARLY:
        return median
    return mean if _coherence(t, mean) > _coherence(t, median) + CLEARLY else median


def _coherence(t: Array, period: float) -> float:
    """1 where all stamps lie on a grid of this period, 0 where they keep no step with it."""
    return float(np.abs(np.mean(np.exp((2j * np.pi / period) * (t - t[0])))))


def rounding_std(step: float) -> float:
    """Standard deviation of a stamp that is rounded to a grid of `step`, both in s."""
    return step / SQRT12
