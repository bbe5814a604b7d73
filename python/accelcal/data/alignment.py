"""Two loggers: the offset of their clocks, by cross-correlation of the output with the position's second derivative.

Both signals pass a filter that keeps what they share. The shift of the highest peak aligns them; the next-best peak
says how ambiguous it is. Stretches of the aligned record then give the offset, its standard deviation and the skew.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from accelcal.data import units
from accelcal.data.arrays import Array, stretch_about
from accelcal.data.recording import Channel, RecordingError

MOST = 1 << 22
"""Instants of the common grid of a channel: a longer record is averaged to a coarser grid."""
LEAST_OVERLAP = 0.1
"""Share of the shorter record that the two must have in common."""
FEWEST = 64
"""Instants that they must have in common."""
ALIKE = 0.3
"""Least correlation of two records of one motion."""
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

    @property
    def is_ambiguous(self) -> bool:
        """Whether another alignment is nearly as good."""
        return self.next_height > AMBIGUOUS

    @property
    def sentence(self) -> str:
        """For people."""
        text = (
            f"two loggers: the stamps of the output are shifted by {self.shift:+.6f} s (standard deviation "
            f"{self.std:.1g} s at {units.instant(self.middle)} s) onto the clock of the position, correlation "
            f"{self.correlation:.3f} over {self.overlap:.4g} s in common, skew {self.skew * 1e6:+.1f} ppm (standard "
            f"deviation {self.skew_std * 1e6:.1g} ppm); the next-best alignment, {self.next_shift:+.4f} s, reaches "
            f"{self.next_height:.2f} of its height"
        )
        if self.is_ambiguous:
            text += ": the motion repeats, and another alignment is nearly as good; record a motion that does not"
        return text


def align(accel: Channel, position: Channel, *, polarity: float = 1.0, delay: float = 0.0, name: str = "") -> Alignment:
    """Find the shift of the stamps of `accel` that lays it upon `position`.

    Parameters
    ----------
    polarity : -1 where the sensor is reversed on its stage.
    delay : of the declared filter of the output, s.
    name : for messages.

    Raises
    ------
    RecordingError
        If one of the two is too short, or no shift makes them alike.
    """
    for channel in (accel, position):
        if len(channel) < FEWEST:
            raise RecordingError(
                f"{name}: {channel.name} has {len(channel)} samples, expected at least {FEWEST} to align two loggers; "
                "record longer"
            )
    step = max(spacing(accel), spacing(position), *((c.t[-1] - c.t[0]) / MOST for c in (accel, position)))
    a = polarity * _on_grid(accel, step)
    x = _on_grid(position, step)
    if min(len(a), len(x)) < FEWEST:
        raise RecordingError(f"{name}: fewer than {FEWEST} instants of both loggers; record a longer motion")
    second = np.zeros(len(x))
    second[1:-1] = (x[2:] - 2.0 * x[1:-1] + x[:-2]) / step**2
    a = a - np.mean(a)
    peaks = _Peaks(*_shared(a, second, step), name)
    to_shift = position.t[0] - accel.t[0] + delay
    late = _Stretches(*_coherent(a, second, step, peaks.lag), peaks)
    return Alignment(
        shift=float(to_shift - late.lag * step),
        std=float(late.lag_std * step),
        middle=float(position.t[0] + late.middle * step),
        skew=float(late.slope),
        skew_std=float(late.slope_std),
        correlation=peaks.correlation,
        overlap=float(peaks.overlap * step),
        next_shift=float(to_shift - peaks.next_lag * step),
        next_height=peaks.next_height,
    )


def shifted(channel: Channel, by: float) -> Channel:
    """A channel with its stamps moved, s."""
    return Channel(channel.name, channel.t + by, channel.y, channel.unit)


def spacing(channel: Channel) -> float:
    """Usual time from one sample to the next, s."""
    return float(np.median(np.diff(channel.t)))


def _on_grid(channel: Channel, step: float) -> Array:
    """Values at `channel.t[0]` + k `step`; averages of about one step where the channel is faster."""
    t, y = channel.t - channel.t[0], channel.y
    instants = np.arange(int(t[-1] / step) + 1) * step
    if spacing(channel) > 0.75 * step:
        return np.asarray(np.interp(instants, t, y))
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(t))])
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
    found = np.asarray(np.fft.irfft(spectrum, size)[: len(y)])
    return np.asarray(found / max(float(np.std(found)), _TINY))


_SEGMENT = 4096
"""Most instants of a segment of which a spectrum is made."""
_COHERENT = 0.3
"""Coherence below which a frequency counts as noise: with few segments chance reaches it."""
_TINY = float(np.finfo(float).tiny)


class _Peaks:
    """The best lag of `a` behind `b`, in steps, and the next-best."""

    def __init__(self, a: Array, b: Array, name: str) -> None:
        size = 1 << (len(a) + len(b)).bit_length()
        product = np.fft.irfft(np.conj(np.fft.rfft(b, size)) * np.fft.rfft(a, size), size)
        self.lags = np.arange(-len(b) + 1, len(a))
        heights = product[self.lags]
        common = np.minimum(len(b), len(a) - self.lags) - np.maximum(0, -self.lags)
        allowed = common >= max(FEWEST, LEAST_OVERLAP * min(len(a), len(b)))
        heights = np.where(allowed, heights, 0.0)
        best = int(np.argmax(heights))
        self.lag, self.overlap = int(self.lags[best]), int(common[best])
        inner = slice(max(0, -self.lag), max(0, -self.lag) + self.overlap)
        outer = slice(max(0, self.lag), max(0, self.lag) + self.overlap)
        energy = float(np.sqrt(np.sum(b[inner] ** 2) * np.sum(a[outer] ** 2)))
        self.correlation = float(heights[best] / energy) if energy > 0.0 else 0.0
        if -float(heights.min()) > 1.1 * float(heights[best]):
            raise RecordingError(
                f"{name}: the output is like the second derivative of the position with the other sign; declare in its "
                'sidecar [rig] mount = "reversed" (or "normal"), or check the sense of the encoder'
            )
        if not self.correlation >= ALIKE:
            raise RecordingError(
                f"{name}: at no shift of the clocks is the output like the second derivative of the position "
                f"(correlation {self.correlation:.2f}, expected at least {ALIKE}); check that both files are of one run"
            )
        begin, end = stretch_about(heights > 0.0, best)
        self.reach = max(2, min(best - begin, end - best))
        outside = heights.copy()
        outside[begin : end + 1] = 0.0
        second = int(np.argmax(outside))
        self.next_lag = int(self.lags[second])
        self.next_height = float(max(0.0, outside[second]) / heights[best])


class _Stretches:
    """The lag, in steps, in the middle of the record and its slope, by a line through the lags of stretches of it."""

    def __init__(self, a: Array, b: Array, peaks: _Peaks) -> None:
        first = max(0, -peaks.lag)
        count = max(4, min(STRETCHES, peaks.overlap // (8 * peaks.reach + FEWEST)))
        edges = np.linspace(first, first + peaks.overlap, count + 1).astype(int)
        found = [_lag(a, b, i, j, peaks) for i, j in pairwise(edges)]
        places = (edges[:-1] + edges[1:]) / 2.0
        kept = [(place, *lag) for place, lag in zip(places, found, strict=True) if lag is not None]
        self.middle, self.lag = first + peaks.overlap / 2.0, float(peaks.lag)
        self.lag_std, self.slope, self.slope_std = 0.5, 0.0, 0.5 / peaks.overlap
        if len(kept) < 4:
            return
        place, lag, weight = np.array(kept).T
        self.middle = float(np.average(place, weights=weight))
        away = place - self.middle
        moment = float(np.sum(weight * away**2))
        mean = float(np.average(lag, weights=weight))
        self.slope = float(np.sum(weight * away * lag) / moment)
        left = lag - mean - self.slope * away
        variance = float(np.sum(weight * left**2) / (len(lag) - 2))
        self.lag = mean
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
