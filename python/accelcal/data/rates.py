"""Rates of two clocks: by how much that of the output runs faster than that of the position, up to 8 %.

Two records of one motion whose clocks run at different rates slip against one another, and beyond half a period of the
fastest motion they look unrelated at any shift. So stretches of the output are laid upon the position at every rate, in
steps of half such a period, and the best of them grow, rate and shift corrected by least squares, until they span what
both recorded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from accelcal.data.arrays import Array, Places

MOST_SKEW = 0.08
"""Largest difference of two rates that is sought: sensors run up to 7 % beside their data sheet."""
LEAST_LIKE, MOST_LIKE = 0.6, 0.85
"""Correlation that two records of one motion reach at the right rate: at least the first, and above what chance gives
among all rates and shifts as far as that is below the second. Unrelated motions stay below 0.45 in `benches/rates`."""
OPPOSITE = 1.1
"""By how much a relation with the other sign must be closer to be the one that is taken."""
BY_CHANCE = 1e-4
"""Probability of an unrelated record that is taken for one of the same motion."""
SLIP = 0.25
"""Periods of the fastest motion by which clocks slip over a record, from which on the rates are corrected."""
ABOVE_NOISE = 3.0
"""Power of a frequency over the floor of its channel, from which on it holds motion."""
FLOOR = 0.1
"""Share of the frequencies that hold noise alone."""
POWER = 0.99
"""Share of the power of the motion up to its fastest frequency."""
PER_PERIOD = 8.0
"""Instants of the common grid in a period of the fastest motion."""
LINES = (300.0, 150.0)
"""Frequencies, as many as one would count if all were alike, of the whole record and of a stretch that is laid upon it:
chance reaches a correlation of 0.3 among all rates and shifts."""
MOST_RATES = 400
"""Rates that are tried for a stretch."""
PLACES = 3
"""Stretches that are laid upon the position."""
CANDIDATES = 12
"""Rates that may grow."""
ROUNDS = 4
"""Corrections of rate and shift at each length."""
ENDS = 0.3
"""Share of a record over which its ends fade in and out: a filter rings there."""
SMOOTH = 1
"""Frequencies to either side over which the power of what is left is averaged."""
LEAST_FREE = 0.1
"""Share of a frequency that the columns leave, least, from which its noise is taken."""
TONE = 0.98
"""Share of the power within one line beyond which a motion is one tone."""
FEWEST_INSTANTS = 32


@dataclass(frozen=True, slots=True)
class Rate:
    """How the clock of the output runs beside that of the position."""

    skew: float
    """By how much it runs faster."""
    std: float
    """Standard deviation of `skew`."""
    correlation: float
    """Of both over what they share, in the band of the motion; negative where they have opposite signs."""
    overlap: float
    """s"""
    lag: float = 0.0
    """Time of the output, once its rate is that of the position, at the first instant of the position, s; from its own
    first."""


@dataclass(frozen=True, slots=True)
class Search:
    """Outcome of a search over rates."""

    rate: Rate | None
    """None where the two are alike at no rate."""
    sentence: str
    """Description of the trial, as part of a sentence."""
    slips: bool = False
    """Whether the clocks slip by more than the motion forgives."""


def search_rates(a: Array, b: Array, step: float) -> Search:
    """Search the rate at which an output is like a second derivative of position.

    Parameters
    ----------
    a, b : (n,), (m,) output and second derivative on one grid, every `step` s by its own clock.
    """
    motion = _Motion(a, b, step)
    if motion.is_one_tone:
        return Search(None, f"the motion is one tone, {motion.tone:.3g} Hz, which tells no rate of a clock")
    if not motion.top:
        return Search(None, "no frequency at which both move above their noise is left to compare rates by")
    enough = int(np.searchsorted(motion.lines[: motion.top], LINES[0]))
    slow = motion.below(min(motion.top, max(1, enough)))
    shortest = min(len(slow.a), len(slow.b))
    of_lines = LINES[1] / float(motion.lines[min(motion.top, enough)])
    length = min(0.5, of_lines) * shortest, 0.25 * MOST_RATES / (MOST_SKEW * slow.per_instant)
    first, tried = slow.candidates(max(int(min(length)), min(FEWEST_INSTANTS, shortest // 2)))
    text = f"{tried} rates from {-MOST_SKEW:+.0%} to {MOST_SKEW:+.0%} were tried"
    rates = [rate for candidate in first if (rate := slow.grown(*candidate)) is not None]
    if not rates:
        return Search(None, text)
    rate = min(  # the likeliest
        rates, key=lambda r: r.overlap * math.log1p(1e-12 - max(r.correlation, -r.correlation / OPPOSITE) ** 2)
    )
    rate = motion.refined(rate, a, b) or rate
    trials = tried * 2.0 * slow.per_instant * (len(slow.a) + len(slow.b))
    chance = math.sqrt(1.0 - (BY_CHANCE / trials) ** (1.0 / max(1.0, float(motion.lines[motion.top]))))
    least = max(LEAST_LIKE, min(MOST_LIKE, chance))
    text = f"{text}; the best, {rate.skew:+.2%}, reaches a correlation of {abs(rate.correlation):.2f}"
    if abs(rate.correlation) < least:
        return Search(None, f"{text}, expected {least:.2f}")
    return Search(rate, text, bool(abs(rate.skew) * rate.overlap * motion.f[motion.top] > SLIP))


class _Motion:
    """Spectra of output and second derivative, and the band in which both stand above their noise."""

    def __init__(self, a: Array, b: Array, step: float) -> None:
        self.step, self.lengths = step, (len(a), len(b))
        self.size = scipy.fft.next_fast_len(len(a) + len(b), real=True)
        self.f = np.fft.rfftfreq(self.size, step)
        self.spectra = [scipy.fft.rfft(y - np.mean(y), self.size) for y in (a, b)]
        powers = [_smoothed(np.abs(spectrum) ** 2) for spectrum in self.spectra]
        shapes = np.ones(len(self.f)), np.maximum((2.0 * np.sin(np.pi * self.f * step)) ** 4, 1e-300)
        inside = self.f > 0.0
        for power, shape in zip(powers, shapes, strict=True):
            inside &= power > ABOVE_NOISE * shape * float(np.quantile(power[1:] / shape[1:], FLOOR))
        self.gain = inside / np.maximum(powers[0] * powers[1], 1e-300) ** 0.125
        held = np.abs(self.spectra[0]) ** 2 * self.gain**2
        power = np.cumsum(held)
        self.lines = power**2 / np.maximum(np.cumsum(held**2), 1e-300) * len(a) / self.size
        """How many frequencies up to each hold the motion, (bins,)."""
        self.top = int(np.searchsorted(power, POWER * power[-1]))
        """The fastest of them; 0 where there is none."""
        line = np.abs(scipy.fft.rfft((a - np.mean(a)) * np.hanning(len(a)), self.size)) ** 2 * inside
        best, width = int(np.argmax(line)), 4 * self.size // len(a)
        near = float(np.sum(line[max(0, best - width) : best + width + 1]))
        self.is_one_tone = near > TONE * float(np.sum(line)) > 0.0
        self.tone = float(self.f[best])

    def refined(self, rate: Rate, a: Array, b: Array) -> Rate | None:
        """A rate by the whole band of what both recorded, once they are at it: then the same frequencies pass for both,
        and their ends ring alike."""
        lag, last = rate.lag / self.step, (len(a) - 1) / (1.0 + rate.skew)
        at = np.arange(math.ceil(max(0.0, -lag)), int(min(len(b) - 1.0, last - lag)) + 1)
        spline, fade = scipy.interpolate.CubicSpline(np.arange(len(a)), a), scipy.signal.windows.tukey(len(at), ENDS)
        again = _Motion(fade * spline((at + lag) * (1.0 + rate.skew)), fade * b[at], self.step)
        fast = again.below(again.top)
        finer = fast.grown(0.0, 0.0, 0.0, len(fast.b) - 1.0)
        if finer is None:
            return None
        lag = (rate.lag - finer.skew * float(at[0]) * self.step) / (1.0 + finer.skew) + finer.lag
        return replace(finer, skew=(1.0 + rate.skew) * (1.0 + finer.skew) - 1.0, lag=lag)

    def below(self, top: int) -> _Pair:
        """Both without what is faster than a frequency, on a grid that suits it."""
        wanted = PER_PERIOD * self.f[top] * self.size * self.step
        count = min(self.size, scipy.fft.next_fast_len(int(wanted) + 2 * FEWEST_INSTANTS, real=True))
        bins = min(count // 2, top + max(4, top // 8)) + 1
        fade = np.clip((bins - np.arange(bins)) / max(1, bins - 1 - top), 0.0, 1.0) * self.gain[:bins]
        step = self.step * self.size / count
        a, b = (spectrum[:bins] * fade for spectrum in self.spectra)
        slope = 2j * np.pi * self.f[:bins] * step * b
        sizes = self.lengths[0], self.lengths[1], self.lengths[1]
        y = [
            scipy.fft.irfft(spectrum, count)[: int((size - 1) * self.step / step) + 1]
            for spectrum, size in zip((a, b, slope), sizes, strict=True)
        ]
        return _Pair(y[0] / np.std(y[0]), y[1] / np.std(y[1]), y[2] / np.std(y[1]), step, float(self.f[top]) * step)


def _smoothed(power: Array) -> Array:
    """Mean power of the frequencies within the largest skew of each: lines of two clocks do not lie alike."""
    k = np.arange(len(power))
    return _means(power, np.floor(k / (1.0 + MOST_SKEW)), np.ceil(k * (1.0 + MOST_SKEW)) + 1.0)


def _means(y: Array, low: Array | Places, high: Array | Places) -> Array:
    """Means of y[low:high], (n,)."""
    total = np.concatenate([[0.0], np.cumsum(y)])
    begin, end = (np.clip(edge, 0, len(y)).astype(np.intp) for edge in (low, high))
    return np.asarray((total[end] - total[begin]) / (end - begin))


Candidate = tuple[float, float, float, float]
"""Skew, shift, and the stretch of the position, in instants, on which they hold."""


@dataclass(frozen=True)
class _Pair:
    """Both channels on one grid, of variance 1; time is counted in its steps."""

    a: Array
    b: Array
    slope: Array
    """Derivative of `b`."""
    step: float
    """s"""
    per_instant: float
    """Periods of the fastest motion in a step."""

    @cached_property
    def output(self) -> scipy.interpolate.CubicSpline:
        """The output between its instants."""
        return scipy.interpolate.CubicSpline(np.arange(len(self.a)), self.a)

    def candidates(self, length: int) -> tuple[list[Candidate], int]:
        """The best of the shifts at each rate of stretches of `length` instants, and how many rates were tried."""
        b, n = self.b, scipy.fft.next_fast_len(len(self.b) + int(length * (1.0 + 2.0 * MOST_SKEW)), real=True)
        spectrum, energy = scipy.fft.rfft(b, n), np.concatenate([[0.0], np.cumsum(b**2)])
        half = 0.5 / (self.per_instant * length)
        each_way = math.ceil(MOST_SKEW / half)
        skews = half * np.arange(-each_way, each_way + 1)
        heights = []
        for place in np.linspace(0, len(self.a) - length - 1, PLACES).astype(int):
            for skew in skews:
                count = int(length / (1.0 + skew))
                if count >= len(b):
                    continue
                part = np.interp(np.arange(count) * (1.0 + skew), np.arange(length + 1), self.a[place:][: length + 1])
                window = energy[count:] - energy[:-count]
                product = scipy.fft.irfft(np.conj(scipy.fft.rfft(part, n)) * spectrum, n)[: len(window)]
                like = np.abs(product) / np.sqrt(np.maximum(window, 0.1 * np.max(window)) * max(part @ part, 1e-300))
                lag = int(np.argmax(like))
                stretch = float(skew), float(place - (1.0 + skew) * lag), float(lag), float(lag + count)
                heights.append((float(like[lag]), stretch))
        return [stretch for _, stretch in sorted(heights, reverse=True)[:CANDIDATES]], len(skews)

    def grown(self, skew: float, shift: float, begin: float, end: float) -> Rate | None:
        """Rate and lag of a stretch, corrected while it grows to what both recorded; None where it breaks."""
        while True:
            for _ in range(ROUNDS):
                at = np.arange(math.ceil(max(0.0, begin)), int(min(end, len(self.b) - 1.0)) + 1)
                at = at[((1.0 + skew) * at + shift >= 0.0) & ((1.0 + skew) * at + shift <= len(self.a) - 1.0)]
                if len(at) < FEWEST_INSTANTS:
                    return None
                y, x, slope = self.output((1.0 + skew) * at + shift), self.b[at], self.slope[at]
                middle, fade = float(np.mean(at)), scipy.signal.windows.tukey(len(at), ENDS)
                columns = np.column_stack([x, slope, (at - middle) * slope])
                faded = (fade[:, None] * columns).T
                gram = np.linalg.pinv(faded @ columns)
                size, late, slip = gram @ (faded @ y)
                like = float(x @ y) / math.sqrt(max(float(x @ x) * float(y @ y), 1e-300))
                if not abs(slip) < MOST_SKEW * abs(size):
                    return None
                most = 0.25 / self.per_instant
                rate = (1.0 + skew) / (1.0 + slip / size)
                shift += (1.0 + skew) * middle - rate * (middle + min(max(late / size, -most), most))
                skew = rate - 1.0
            if abs(like) < 0.5 * LEAST_LIKE or abs(skew) > 1.1 * MOST_SKEW:
                return None
            first = max(0.0, -shift / (1.0 + skew))
            last = min(len(self.b) - 1.0, (len(self.a) - 1.0 - shift) / (1.0 + skew))
            if begin <= first + 1.0 and end >= last - 1.0:
                # A gain that changes with frequency, as interpolation has it, moves neither rate nor lag. The noise of
                # what else is left is as coloured as its own spectrum, but for what the columns take away.
                second = np.gradient(slope)
                both = np.column_stack([columns, second, np.gradient(np.gradient(second))])
                basis, left = scipy.linalg.orth(fade[:, None] * both), fade * y
                power = np.abs(scipy.fft.rfft(left - basis @ (basis.T @ left))) ** 2 / float(np.mean(fade**2))
                taken = np.sum(np.abs(scipy.fft.rfft(basis, axis=0)) ** 2, axis=1) / len(at)
                k = np.arange(len(power))
                power, free = (_means(part, k - SMOOTH, k + SMOOTH + 1) for part in (power, 1.0 - taken))
                row = np.abs(scipy.fft.rfft(gram[2] @ faded / size)) ** 2 * np.where(k > 0, 2.0, 1.0)
                std = math.sqrt(float(row @ (power / np.maximum(free, LEAST_FREE)))) / len(at) * (1.0 + skew)
                return Rate(skew, std, like, len(at) * self.step, shift * self.step / (1.0 + skew))
            middle, length = 0.5 * (begin + end), end - begin
            begin, end = max(first, middle - length), min(last, middle + length)
