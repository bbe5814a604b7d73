"""Time stamps that are coarser than the clock of their samples: the grid on which they lie, and the clock behind them.

A logger that rounds its stamps, or that asks a slower sensor at ticks of its own, moves each stamp by less than one
step of a grid. Where one uniform clock explains every stamp of a channel within that step, the instants of the clock
are known far better than any stamp, and take their place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import units
from accelcal.data.arrays import Array, median_step, running_integral, runs_of, stretch_about
from accelcal.data.rates import MOST_SKEW, OPPOSITE, Rate, Search, search_rates
from accelcal.data.recording import Channel, RecordingError

FEWEST_STAMPS = 100
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
    if len(t) < FEWEST_STAMPS:
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
    solution = scipy.optimize.linprog([0.0, 0.0, 1.0], left, -sign * error[rows] / size, bounds=[(None, None)] * 3)
    if solution.success:
        middle += size * float(solution.x[0])
        slope += size * float(solution.x[1]) / length
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


MOST = 1 << 22
"""Instants of the common grid of a channel: a longer record is averaged to a coarser grid."""
LEAST_OVERLAP = 0.1
"""Share of the shorter record that the two must have in common."""
FEWEST = 64
"""Instants that they must have in common."""
BETTER = 0.5
"""Share of what is missing to a correlation of one that another rate, or shift, must gain to be the better one: noise
costs the same at any."""
ALIKE = 0.3
"""Least correlation of two records of one motion."""
SEARCHED = 0.7
"""The same where the two are alike at no rate: the best of many shifts is more than one."""
NEAR = 0.9
"""Correlation at one rate of both clocks beyond which no other rate is tried."""
AMBIGUOUS = 0.8
"""Height of the next-best peak, as a share of the best, beyond which a warning is due."""
STRETCHES = 16
"""Most stretches whose own offsets are compared."""
_FINEST = 0.01
"""What is left of one step of the grid by interpolation between its instants, as a standard deviation."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """How the clock of the output was laid upon that of the position."""

    shift: float
    """What was added to the stamps of the output, s."""
    std: float
    """Standard deviation of `shift`, s, in the middle of what both recorded."""
    middle: float
    """That middle, s on the clock of the position."""
    skew: float
    """By how much the clock of the output runs faster; left to the effect clock_skew."""
    skew_std: float
    correlation: float
    """Of output and second derivative, aligned, in the band that they share."""
    overlap: float
    """s"""
    next_shift: float
    """The next-best alignment, s."""
    next_height: float
    """Height of its peak as a share of the best one."""
    rate: Rate | None = None
    """How the rates of the two differ, where that was corrected before; `skew` is what it left."""

    def instants(self, t: Array, first: float) -> Array:
        """Stamps of the output, (n,) s, on the clock of the position; `first` is that of its first sample."""
        return t + self.shift if self.rate is None else first + (t - first) / (1.0 + self.rate.skew) + self.shift

    @property
    def is_ambiguous(self) -> bool:
        """Whether another alignment is nearly as good: as high, and the best one explains no more of what it misses."""
        return self.next_height > AMBIGUOUS and (
            1.0 - self.correlation > (1.0 - BETTER) * (1.0 - self.next_height * self.correlation)
        )

    @property
    def sentence(self) -> str:
        """For people."""
        text = (
            f"two clocks: the stamps of the output are shifted by {self.shift:+.6f} s (standard deviation "
            f"{self.std:.1g} s at {units.instant(self.middle)} s) onto the clock of the position, correlation "
            f"{self.correlation:.3f} over {self.overlap:.4g} s in common, skew {self.skew * 1e6:+.1f} ppm (standard "
            f"deviation {self.skew_std * 1e6:.1g} ppm); the next-best alignment, {self.next_shift:+.4f} s, reaches "
            f"{self.next_height:.2f} of its height"
        )
        if self.is_ambiguous:
            text += ": the motion repeats, and another alignment is nearly as good; record a motion that does not"
        return text


def align(
    accel: Channel,
    position: Channel,
    *,
    polarity: float = 1.0,
    delay: float = 0.0,
    name: str = "",
    gravity: Channel | None = None,
    search: Search | None = None,
) -> Alignment:
    """Find the shift of the stamps of `accel` that lays it upon `position`, and their rate where no shift does.

    Parameters
    ----------
    polarity : -1 where the sensor is reversed on its stage.
    delay : of the declared filter of the output, s.
    name : for messages.
    gravity : what an axis that turns reads beside the acceleration of the position, by the clock of the position.
    search : over the rates of the two, where it was made before.

    Raises
    ------
    RecordingError
        If one of the two is too short, or no shift and no rate makes them alike.
    """
    for channel in (accel, position):
        if len(channel) < FEWEST:
            raise RecordingError(
                f"{name}: {channel.name} has {len(channel)} samples, expected at least {FEWEST} to align two loggers; "
                "record longer"
            )
    step = max(median_step(accel.t), median_step(position.t), *((c.t[-1] - c.t[0]) / MOST for c in (accel, position)))
    x = _on_grid(position, step)
    second = np.zeros(len(x))
    second[1:-1] = (x[2:] - 2.0 * x[1:-1] + x[:-2]) / step**2
    if gravity is not None:
        pull = np.interp(position.t[0] + step * np.arange(len(x)), gravity.t, gravity.y)
        second += pull - np.mean(pull)
    if search is not None and search.rate is not None and search.slips:
        accel = replace(accel, t=accel.t[0] + (accel.t - accel.t[0]) / (1.0 + search.rate.skew))
    a = polarity * _on_grid(accel, step)
    if min(len(a), len(x)) < FEWEST:
        raise RecordingError(f"{name}: fewer than {FEWEST} instants of both loggers; record a longer motion")
    a = a - np.mean(a)
    about = search.rate if search is not None else None
    lag = None if about is None or about.correlation < 0.0 else about.lag / step
    peaks = _Peaks(*(_shared(a, second, step) if lag is None else _coherent(a, second, step, round(lag))), lag)
    if search is None and not peaks.correlation > NEAR:
        search = search_rates(a, second, step)
        least = peaks.correlation + BETTER * (1.0 - peaks.correlation)
        if search.rate is not None and abs(search.rate.correlation) > least:
            return align(accel, position, polarity=polarity, delay=delay, name=name, gravity=gravity, search=search)
        search = replace(search, rate=None)
    if about is None or about.correlation < 0.0:
        peaks.require_alike(name, search)
    to_shift = position.t[0] - accel.t[0] + delay
    late = _Stretches(*_coherent(a, second, step, peaks.lag), peaks)
    alignment = Alignment(
        shift=float(to_shift - late.lag * step),
        std=float(late.lag_std * step),
        middle=float(position.t[0] + late.middle * step),
        skew=float(late.slope),
        skew_std=float(late.slope_std),
        correlation=max(peaks.correlation, about.correlation) if about is not None else peaks.correlation,
        overlap=float(peaks.overlap * step),
        next_shift=float(to_shift - peaks.next_lag * step),
        next_height=peaks.next_height,
        rate=search.rate if search is not None and search.slips else None,
    )
    if alignment.rate is not None and alignment.is_ambiguous:
        raise RecordingError(
            f"{name}: the motion repeats, so that more than one rate and shift lay the output upon the position "
            f"(correlation {alignment.correlation:.2f} at {alignment.rate.skew:+.2%}); record a motion that does not "
            "repeat, or give both channels stamps of one clock"
        )
    return alignment


def restamped(channel: Channel, instants: Callable[[Array], Array]) -> Channel:
    """A channel with other stamps, s."""
    return replace(channel, t=instants(channel.t))


def _on_grid(channel: Channel, step: float) -> Array:
    """Values at `channel.t[0]` + k `step`; averages of about one step where the channel is faster."""
    t, y = channel.t - channel.t[0], channel.y
    instants = np.arange(int(t[-1] / step) + 1) * step
    if median_step(channel.t) > 0.75 * step:
        return np.asarray(np.interp(instants, t, y))
    sums = running_integral(y, np.diff(t))
    ends = np.clip(instants[:, None] + 0.5 * step * np.array([-1.0, 1.0]), 0.0, t[-1])
    low, high = np.interp(ends, t, sums).T
    width = ends[:, 1] - ends[:, 0]
    return np.asarray((high - low) / np.where(width > 0.0, width, 1.0))


def _shared(a: Array, b: Array, step: float) -> tuple[Array, Array]:
    """Both signals, with the frequencies at which one has far more power than the other turned down."""
    length = min(len(a), len(b), _SEGMENT)
    frequency, of_a = scipy.signal.welch(a, 1.0 / step, nperseg=length)
    _, of_b = scipy.signal.welch(b, 1.0 / step, nperseg=length)
    share = np.minimum(of_a, of_b) / np.maximum(np.maximum(of_a, of_b), _TINY)
    gain = np.sqrt(share) / np.maximum(of_a * of_b, _TINY) ** 0.125  # some of the way to a white spectrum: sharp peaks
    return _filtered(a, step, frequency, gain), _filtered(b, step, frequency, gain)


def _coherent(a: Array, b: Array, step: float, lag: int) -> tuple[Array, Array]:
    """Both signals, once they are aligned, at the frequencies at which they are coherent."""
    first, last = max(0, -lag), min(len(b), len(a) - lag)
    length = min(last - first, max(FEWEST, min(_SEGMENT, (last - first) // 8)))
    frequency, of_a = scipy.signal.welch(a[first + lag : last + lag], 1.0 / step, nperseg=length)
    _, of_b = scipy.signal.welch(b[first:last], 1.0 / step, nperseg=length)
    _, cross = scipy.signal.csd(b[first:last], a[first + lag : last + lag], 1.0 / step, nperseg=length)
    coherence = np.abs(cross) ** 2 / np.maximum(of_a * of_b, _TINY)
    gain = np.sqrt(np.where(coherence > _COHERENT, coherence, 0.0))
    return _filtered(a, step, frequency, gain), _filtered(b, step, frequency, gain)


def _filtered(y: Array, step: float, frequency: Array, gain: Array) -> Array:
    """A signal with each frequency turned down by a gain, of variance 1."""
    size = 1 << (2 * len(y) - 1).bit_length()
    spectrum = np.fft.rfft(y, size) * np.interp(np.fft.rfftfreq(size, step), frequency, gain)
    filtered = np.asarray(np.fft.irfft(spectrum, size)[: len(y)])
    return np.asarray(filtered / max(float(np.std(filtered)), _TINY))


_SEGMENT = 4096
"""Most instants of a segment of which a spectrum is made."""
_COHERENT = 0.3
"""Coherence below which a frequency counts as noise: with few segments chance reaches it."""
_TINY = float(np.finfo(float).tiny)


class _Peaks:
    """The best lag of `a` behind `b`, in steps, and the next-best; the best one `about` a lag where that is known."""

    def __init__(self, a: Array, b: Array, about: float | None = None) -> None:
        size = 1 << (len(a) + len(b)).bit_length()
        product = np.fft.irfft(np.conj(np.fft.rfft(b, size)) * np.fft.rfft(a, size), size)
        self.lags = np.arange(-len(b) + 1, len(a))
        common = np.minimum(len(b), len(a) - self.lags) - np.maximum(0, -self.lags)
        allowed = common >= max(FEWEST, LEAST_OVERLAP * min(len(a), len(b)))
        inside = [_energies(y, np.maximum(0, side * self.lags), common) for y, side in ((a, 1), (b, -1))]
        squares = [np.sum(y**2) + _TINY for y in (a, b)]
        covered = np.maximum(inside[0] / squares[0], inside[1] / squares[1])  # of one of them; the other may be longer
        alike = np.clip(product[self.lags] / np.sqrt(inside[0] * inside[1] + _TINY), -1.0, 1.0)
        heights = np.where(allowed, covered * alike * np.abs(alike), 0.0)  # squares
        best = int(np.argmax(heights if about is None else -np.abs(self.lags - about)))
        self.lag, self.overlap = int(self.lags[best]), int(common[best])
        self.correlation = float(alike[best])
        self.is_opposite = about is None and -float(heights.min()) > OPPOSITE**2 * float(heights[best])
        begin, end = stretch_about(heights > 0.0, best)
        self.reach = max(2, min(best - begin, end - best))
        outside = heights.copy()
        outside[begin : end + 1] = 0.0
        second = int(np.argmax(outside))
        self.next_lag = int(self.lags[second])
        height = float(outside[second] / max(heights[best], _TINY))
        # about a lag that the rate gave, how much is covered is no evidence
        self.next_height = float(np.sqrt(height)) if about is None else height * float(common[best] / common[second])

    def require_alike(self, name: str, search: Search | None) -> None:
        """Refuse two channels that are not alike, or that are with the other sign; rates may have been searched.

        Raises
        ------
        RecordingError
            With the correlation.
        """
        least = ALIKE if search is None or search.rate else SEARCHED
        if not (self.correlation >= least or (self.is_opposite and (search is None or search.rate))):
            raise RecordingError(
                f"{name}: at no shift of the clocks is the output like the second derivative of the position "
                f"(correlation {self.correlation:.2f}, expected at least {least})"
                f"{'' if search is None else f', and at no other rate: {search.sentence}'}; check that both files are "
                "of one run, or record a longer motion that does not repeat"
            )
        if self.is_opposite:
            raise RecordingError(
                f"{name}: the output is like the second derivative of the position with the other sign; declare in its "
                'sidecar [rig] mount = "reversed" (or "normal"), or check the sense of the encoder'
            )


def _energies(y: Array, begins: NDArray[np.intp], lengths: NDArray[np.intp]) -> Array:
    """Sums of squares over stretches, none below what rounding leaves of the whole."""
    total = np.concatenate([[0.0], np.cumsum(y**2)])
    return np.asarray(np.maximum(total[begins + lengths] - total[begins], 1e-9 * total[-1]))


class _Stretches:
    """The lag, in steps, in the middle of the record and its slope, by a line through the lags of stretches of it."""

    def __init__(self, a: Array, b: Array, peaks: _Peaks) -> None:
        first = max(0, -peaks.lag)
        count = max(4, min(STRETCHES, peaks.overlap // (8 * peaks.reach + FEWEST)))
        edges = np.linspace(first, first + peaks.overlap, count + 1).astype(int)
        lags = [_lag(a, b, i, j, peaks) for i, j in pairwise(edges)]
        places = (edges[:-1] + edges[1:]) / 2.0
        places_lags = [(place, *lag) for place, lag in zip(places, lags, strict=True) if lag is not None]
        self.middle, self.lag = first + peaks.overlap / 2.0, float(peaks.lag)
        self.lag_std, self.slope, self.slope_std = 0.5, 0.0, 0.5 / peaks.overlap
        if len(places_lags) < 4:
            return
        place, lag, weight = np.array(places_lags).T
        middle = float(np.average(place, weights=weight))
        away = place - middle
        moment = float(np.sum(weight * away**2))
        mean = float(np.average(lag, weights=weight))
        slope = float(np.sum(weight * away * lag) / moment)
        if abs(slope) > MOST_SKEW:  # no pair of clocks: stretches of constant speed have no peak of their own
            return
        self.slope = slope
        left = lag - mean - self.slope * away
        variance = float(np.sum(weight * left**2) / (len(lag) - 2))
        self.middle, self.lag = middle, mean
        self.lag_std = float(np.hypot(np.sqrt(variance / np.sum(weight)), _FINEST))
        self.slope_std = float(np.hypot(np.sqrt(variance / moment), _FINEST / np.sqrt(np.mean(away**2))))


def _lag(a: Array, b: Array, begin: int, end: int, peaks: _Peaks) -> tuple[float, float] | None:
    """Lag of one stretch of `b`, in steps, near the common one, and its weight; None without a peak there."""
    reach = peaks.reach
    lags = np.arange(peaks.lag - reach, peaks.lag + reach + 1)
    begin, end = max(begin, reach - peaks.lag), min(end, len(a) - peaks.lag - reach)
    if end - begin < FEWEST // 2:
        return None
    heights = np.array([b[begin:end] @ a[begin + lag : end + lag] for lag in lags])
    top = int(np.argmax(heights))
    if not 0 < top < len(lags) - 1 or heights[top] <= 0.0:
        return None
    left, middle, right = heights[top - 1 : top + 2]
    curvature = left - 2.0 * middle + right
    return float(lags[top] + 0.5 * (left - right) / curvature), float(-curvature)


BITS = (16, 24, 31, 32)
"""Widths of counters, signed and unsigned."""
FRAME_BITS = (8, *BITS)
"""The same of a counter of frames."""
TICK_DECIMALS = 10
"""Decimals with which ticks may be written in a larger unit: microseconds as seconds, say."""
LEAST_TURN = 4.0
"""Usual spacings that a counter counts at least."""
NEAR_TOP = 20.0
"""Usual spacings from either end of a counter within which it wraps, whatever was lost there."""


def unwrapped(stamps: Array, bits: tuple[int, ...] = BITS) -> tuple[Array, NDArray[np.intp]]:
    """Stamps (n,) of a counter that wraps, as if it did not, and the first index behind each wrap.

    A jump back by 2^k ticks with the usual spacing behind it is a wrap. So is one from one end of the counter to the
    other, beside such a wrap or in whole ticks; alone, and back to the first stamp of all, it may be a new start.
    """
    spacing = np.diff(stamps)
    back = np.flatnonzero(spacing < 0.0)
    if not len(back) or not np.any(spacing > 0.0):
        return stamps, back
    usual = float(np.median(spacing[spacing > 0.0]))
    before, behind = stamps[back], stamps[back + 1]
    best, size = np.zeros(len(back), dtype=np.bool_), 0.0
    is_whole = np.array_equal(stamps, np.rint(stamps))
    for ticks, in_ticks in ((2.0**k / 10.0**m, is_whole and m == 0) for k in bits for m in range(TICK_DECIMALS)):
        if ticks < LEAST_TURN * usual:
            continue
        after = behind - before + ticks
        near = min(NEAR_TOP * usual, 0.1 * ticks)
        ends = [(before > top - near) & (behind < top - ticks + near) for top in (ticks, 0.5 * ticks)]
        wraps = np.abs(after - usual) < 0.5 * usual
        trusted = np.any(wraps) | (in_ticks & (behind != stamps[0]))
        wraps |= (after > 0.0) & (ends[0] | ends[1]) & trusted
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
PACKET_STRETCHES = 24
"""Parts of a record of each of which the earliest arrival counts."""
AHEAD = 8
"""Packets behind a late one by which the clock has caught up; where it has not, some were lost."""
WIDEST = 16
"""Most readings of a line on either side of the beginning of a packet."""
BROKEN_AT, BROKEN = 0.9, 1.5
"""Quantile of the steps between two such lines, and by how much those between packets are larger than those within one
where readings are missing between them."""
MISSED = 4.0
"""Mean product of step and slope, in its standard deviations, beyond which readings are missing there."""
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


@np.errstate(over="ignore")  # of cells that are no stamps, which are refused later with their row
def packets(t: Array, readings: Sequence[Array] = ()) -> Packets | None:
    """The clock behind stamps (n,) of packets; None where the stamps are not those of packets.

    Within a packet spacings are equal, and from one packet to the next they scatter. No packet comes early, so the
    clock runs through the earliest arrival of each stretch of the record: offset, rate, and slow drift. Readings, (n,)
    each, go on from packet to packet as they do within one; a logger that stops between true stamps misses some.
    """
    spacing = np.diff(t)
    if len(t) < FEWEST_PACKETS * SMALLEST or np.array_equal(spacing[1:], spacing[:-1]):
        return None
    usual = float(np.median(spacing))
    apart = np.flatnonzero(np.abs(spacing - usual) > EVEN * abs(usual)) + 1  # the first sample behind each
    even = np.flatnonzero(np.abs(np.diff(spacing)) > EVEN * float(np.median(np.abs(spacing)))) + 2  # up to its arrival
    jumps = next((j for j in (apart, even) if FEWEST_PACKETS <= len(j) <= len(t) / (SMALLEST - 0.5)), None)
    return None if jumps is None else _clock_behind(t, jumps, readings)


def _clock_behind(t: Array, jumps: NDArray[np.intp], readings: Sequence[Array]) -> Packets | None:
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
    begins = ends[:-1][lost == 0.0] + 1
    if any(_is_broken(y, begins, n) for y in readings):
        return None
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


def _is_broken(y: Array, begins: NDArray[np.intp], n: int) -> bool:
    """Whether readings (n,) step where packets begin, by more than they do in the middle of packets."""
    width = min(n // 2, WIDEST)
    rows = begins[:, None] + np.arange(-width, width)
    steps, slopes = (np.array([y[rows + k] @ w for k in (0, n // 2)]) for w in _across(width, min(2, width)))
    between, within = np.quantile(np.abs(steps), BROKEN_AT, axis=1)
    missed = np.subtract(*(steps * slopes))  # of noise, and of what is alike at both places, the mean is 0
    clear = float(np.mean(missed)) * math.sqrt(len(missed)) > MISSED * float(np.std(missed))
    return bool(between > BROKEN * within > 0.0 or clear)


def steady_clock(t: Array) -> Array:
    """Instants (n,) s of the uniform clock about which stamps scatter: through all of them, or through the earliest
    where those scatter less, for a host is late and never early."""
    index, late = np.arange(float(len(t))), t - t[0]
    clock = np.polynomial.Polynomial.fit(index, late, 1)
    begins = np.arange(0, len(t), -(-len(t) // PACKET_STRETCHES))
    first = np.array([begin + int(np.argmin(part)) for begin, part in _parts(late - clock(index), begins)])
    early = np.polynomial.Polynomial.fit(first, late[first], 1)
    scatters = (
        np.std((late - early(index))[first]) / math.sqrt(len(first)),
        np.std(late - clock(index)) / math.sqrt(len(t)),
    )
    return np.asarray(t[0] + (early if scatters[0] < scatters[1] else clock)(index))


SLEWED, MOST_SLEWED, ONE_SIZE = 5e-5, 0.02, 0.1
"""Change of rate of a clock that is set right by a network: less is a crystal's, more another rate of the samples; and
its range, as a share of it: what drifts has no one size."""
MOST_PARTS, STEADY_PARTS = 64, 8
"""Parts of a record whose rates are compared, most and least; one of them is apart beyond as many of their scatters."""


def slewed(t: Array) -> tuple[list[tuple[int, int]], Array, float]:
    """Stretches, first and last sample, in which the clock of stamps (n,) s runs at another rate, by one size, s/s; the
    instants, (n,) s, of the samples by the rate elsewhere; and that size. No stretch where there is none.

    Samples are paced by a crystal, which drifts and does not jump.
    """
    count = min(MOST_PARTS, len(t) // FEWEST_STAMPS)
    if count < STEADY_PARTS:
        return [], t, 0.0
    edges = np.linspace(0, len(t) - 1, count + 1).astype(int)
    pace = np.diff(t[edges]) / np.diff(edges)
    skew = pace / np.median(pace) - 1.0
    apart = np.abs(skew) > max(SLEWED, STEADY_PARTS * float(np.median(np.abs(skew))))
    runs = runs_of(apart)
    sizes = [skew[a + 1 : b - 1] for a, b in runs] or [skew[:0]]
    size = float(np.median(np.concatenate(sizes))) if min(map(len, sizes)) > 0 else math.inf
    steady = np.convolve(apart, np.ones(3), "same") == 0.0
    if (
        2 * np.count_nonzero(apart) > count
        or not abs(size) < MOST_SLEWED
        or np.ptp(np.concatenate(sizes)) > ONE_SIZE * abs(size)
        or np.max(np.diff(t)) > 1.5 * float(np.median(pace))
    ):
        return [], t, 0.0
    return (
        [(int(edges[a]), int(edges[b])) for a, b in runs],
        t[0] + float(np.mean(pace[steady])) * np.arange(len(t)),
        size,
    )


def _across(width: int, terms: int) -> tuple[Array, Array]:
    """Weights of `width` readings on either side of a place for the step between the polynomials through them there,
    and for their mean slope, per row; (2 width,) each. Such a polynomial has so many terms."""
    fit = np.linalg.pinv(np.vander(np.arange(width) + 0.5, terms))
    value, slope = fit[-1], 0.5 * fit[-2] if terms > 1 else 0.0 * fit[-1]
    return np.concatenate([-value[::-1], value]), np.concatenate([-slope[::-1], slope])


LOST_WIDTHS, THINNED = (4, 8, 16), 8
"""Rows on either side of a place that are asked whether some are missing there; one in so many tells the noise."""
CLEAR_STEP, LOST_GAIN = 5.0, 8.0
"""Step, in its standard deviations, that noise does not make; gain of log-likelihood from which on rows are missing in
a place once it is clear that some are somewhere."""
FEWEST_LOST, LOST_SHARE, WAY_OFF = 8, 0.9, 0.2
"""Clear steps, least, and share of them, that are the way of whole rows, and of their gain that one row in so many has;
departure from that way, as a share of it, beside noise: the speed is not quite steady."""
MOST_LOST, LONGEST_PERIOD = 8, 1024
"""Rows lost in one place, beyond which a polynomial does not tell their number; rows from one that is lost to the next,
where they are lost in step with a buffer."""


def lost_rows(columns: Sequence[Array]) -> NDArray[np.intp] | None:
    """How many rows are missing before each row of columns, (n,) each, that have no stamps; None where none is.

    The readings of a motion step there by what they change by over so many rows, however fast that is; missed counts
    have one size, a shock has any. Rows that are lost one in so many are filled in where the motion hides them, too.
    """
    n = len(columns[0])
    if n < FEWEST_STAMPS:
        return None
    tried = [np.array([_steps(y, width) for y in columns]) for width in LOST_WIDTHS]
    best = int(np.argmax([np.mean(parts[:, 1] ** 2) for parts in tried]))
    parts, reach = tried[best], 2 * LOST_WIDTHS[best] + 1
    (power, both), (_, way) = np.einsum("cin,cjn->ijn", parts, parts)
    clear = np.flatnonzero(power > CLEAR_STEP**2)
    if len(clear) < FEWEST_LOST:
        return None
    clear = clear[power[clear] == scipy.ndimage.maximum_filter1d(power, reach)[clear]]
    count = np.clip(np.rint(both / np.maximum(way, _TINY)), 1.0, MOST_LOST)
    gain = count * both - 0.5 * count**2 * way
    left = np.sqrt(np.maximum(power - 2.0 * gain, 0.0))
    whole = left[clear] < CLEAR_STEP + WAY_OFF * (count * np.sqrt(way))[clear]
    if np.count_nonzero(whole) < max(FEWEST_LOST, LOST_SHARE * len(clear)):
        return None
    rows = np.flatnonzero((gain == scipy.ndimage.maximum_filter1d(gain, reach)) & (gain > LOST_GAIN))
    single, periods = both - 0.5 * way, range(max(LOST_WIDTHS), min(LONGEST_PERIOD, n // 8))
    combs = [single[: n - n % period].reshape(-1, period).sum(axis=0) for period in periods]
    best = int(np.argmax([np.max(comb) for comb in combs]))
    if np.max(combs[best]) > LOST_SHARE * np.sum(gain[rows]):
        rows, count = np.arange(int(np.argmax(combs[best])) or periods[best], n, periods[best]), np.ones(n)
    lost = np.zeros(n, dtype=np.intp)
    lost[rows] = count[rows]
    return lost


def _steps(y: Array, width: int) -> Array:
    """Step and mean slope of readings (n,) before each of them, (2, n), over the noise of the step where they move; 0
    where they have none."""
    pair = np.array([np.convolve(y, weights[::-1], "valid") for weights in _across(width, 3)])
    size = np.abs(pair[:, ::THINNED])
    noise = float(np.median(size[0][size[1] >= 0.3 * math.sqrt(np.mean(size[1] ** 2))])) / 0.6745
    return np.pad(pair / (noise or math.inf), ((0, 0), (width, width - 1)))


def _earliest(x: Array, y: Array, most: float) -> tuple[Array, int]:
    """A slowly drifting clock through the earliest arrivals, at each packet, (m,), and of how many pieces it is."""
    edges = np.linspace(0, len(x), max(2, min(PACKET_STRETCHES, len(x) // 4)) + 1).astype(int)
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


SEGMENTS, SHORTEST = 8, 32
"""Segments of the record, before they overlap by half, and samples of one, least."""
EDGES = 8
"""Edges of the bands that are tried, from two periods in a segment to a quarter of the rate."""
THE_OUTPUT = 0.9
"""Correlation with the second derivative of a position from which a column is the output."""


GAP = 8.0
"""Interval between samples, over the usual one of the slower channel, from which on nothing is interpolated in it."""


def between_samples(t: Array, at: Array, longest: float) -> NDArray[np.bool_]:
    """Whether each instant, (n,) s, lies between two samples that are no farther apart than the longest interval, s."""
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    return t[after] - t[after - 1] <= longest


def relation(output: Channel, position: Channel) -> tuple[float, float]:
    """Slope and correlation of an output, (n,), and the second derivative of a position, (m,) m, in the band in which
    they are most alike; 0 and 0 where they are too short to tell. What lies in a gap of either is left out of both: a
    line through what a range has cut off is no output.

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
    window, powers = np.hanning(segment), np.zeros((3, segment // 2 + 1))
    for begin in range(0, count - 1 - segment, segment // 2):
        at = first + step * np.arange(begin, begin + segment + 2)
        y, z = (np.interp(at, channel.t, channel.y) for channel in (output, position))
        inside = between_samples(output.t, at, GAP * step) & between_samples(position.t, at, GAP * step)
        inside = inside[:-2] & inside[1:-1] & inside[2:]
        if not inside.any():
            continue
        u, a = (np.fft.rfft((x - x[inside].mean()) * inside * window) for x in (y[1:-1], np.diff(z, 2) / step**2))
        powers += (u * a.conj()).real, np.abs(u) ** 2, np.abs(a) ** 2
    tried = [(0.0, 0.0)]
    for low, high in combinations(np.unique(np.geomspace(2, segment // 4, EDGES).astype(int)).tolist(), 2):
        cross, of_output, of_motion = powers[:, low:high].sum(axis=1).tolist()
        if of_output > 0.0 and of_motion > 0.0:
            tried.append((cross / of_motion, cross / (of_output * of_motion) ** 0.5))
    return max(tried, key=lambda pair: abs(pair[1]))
