"""Sine approximation (ISO 16063-11, -41) on the stamps as they are, and the steps of a record with steady sines.

The strongest line of the spectrum is demodulated; the stretch over which its envelope is level is a step. That is
then silenced (or, where other sines share it, the sine subtracted), and the search goes on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np
import scipy

from accelcal._support.errors import AccelcalError
from accelcal._support.result import Storable
from accelcal.data import Array, Channel
from accelcal.data.arrays import stretch_about
from accelcal.signals.processing import Response, Spectrum

DRIFT = 3
"""Terms of the drift: constant, slope, curvature."""
ROUNDS = 8
"""Gauss-Newton steps that refine a frequency."""


@dataclass(frozen=True, slots=True)
class SineFit:
    """Amplitudes of one channel: y = mean + drift + sum of Re(amplitude exp(i w (t - centre)))."""

    amplitudes: Spectrum
    """(m,) complex, unit of the channel."""
    mean: float
    """Mean over the stretch beside the sines, unit of the channel."""
    t: Array
    """(n,) s, from the centre."""
    residual: Array
    """(n,) unit of the channel."""

    def lines(self, frequencies: Array) -> Spectrum:
        """Amplitudes (k,) that the residual has at other frequencies (k,) Hz."""
        turns = np.exp(-2j * math.pi * np.outer(frequencies, self.t))
        return np.asarray(2.0 / len(self.t) * (turns @ self.residual))


def within(channel: Channel, start: float, end: float) -> Channel:
    """The samples of a channel from `start` to `end`, s."""
    first, last = np.searchsorted(channel.t, (start, end))
    return Channel(channel.name, channel.t[first:last], channel.y[first:last], channel.unit)


def fit_sines(channel: Channel, frequencies: Sequence[float] | Array, centre: float) -> SineFit:
    """Fit sines of known frequencies and a drift to all samples of a channel.

    Parameters
    ----------
    channel : the samples of one stretch.
    frequencies : (m,) Hz.
    centre : instant to which phases refer, s.

    Raises
    ------
    ValueError
        If there are fewer samples than unknowns.
    """
    t = channel.t - centre
    unknowns = DRIFT + 2 * len(frequencies)
    if len(t) <= unknowns:
        raise AccelcalError(f"{channel.name}: {len(t)} samples in this stretch, expected more than {unknowns}")
    columns = _columns(t, np.asarray(frequencies, dtype=np.float64))
    coefficients = np.linalg.lstsq(columns, channel.y, rcond=None)[0]
    waves = coefficients[DRIFT:]
    drift = columns[:, :DRIFT] @ coefficients[:DRIFT]
    return SineFit(waves[::2] - 1j * waves[1::2], float(np.mean(drift)), t, channel.y - columns @ coefficients)


def refined_frequency(channel: Channel, frequency: float) -> float:
    """Frequency of the sine in a channel, Hz, from a first value that errs by less than one period over its length."""
    length = float(channel.t[-1] - channel.t[0])
    centre = float(channel.t[0]) + 0.5 * length
    t = channel.t - centre
    for _ in range(ROUNDS):
        columns = _columns(t, np.array([frequency]))
        coefficients = np.linalg.lstsq(columns, channel.y, rcond=None)[0]
        c, s = coefficients[DRIFT:]
        slope = 2.0 * math.pi * t * (s * columns[:, DRIFT] - c * columns[:, DRIFT + 1])
        full = np.column_stack([columns, slope])
        step = float(np.linalg.lstsq(full, channel.y, rcond=None)[0][-1])
        frequency += float(np.clip(step, -0.5 / length, 0.5 / length))
        if abs(step) * length < 1e-9:
            break
    return frequency


def _columns(t: Array, frequencies: Array) -> Array:
    """Constant, slope, curvature, then cosine and sine of each frequency; (n, 3 + 2 m)."""
    scaled = t / float(np.max(np.abs(t)))
    waves = np.exp(2j * math.pi * np.outer(t, frequencies))
    both = np.stack([waves.real, waves.imag], axis=2).reshape(len(t), -1)
    return np.column_stack([np.vander(scaled, DRIFT, increasing=True), both])


Method = Literal["sine", "broadband"]
COVERAGE = 0.9545
"""Probability of the expanded uncertainty, that of two standard deviations of a normal distribution."""


def _unfiltered(f: Array) -> Spectrum:
    return np.ones(np.shape(f), dtype=np.complex128)


@dataclass(frozen=True, slots=True)
class Reference:
    """What the output is compared with: a channel of the motion, and which derivative of it is the acceleration."""

    channel: Channel
    order: Literal[0, 1, 2]
    """Derivatives from the channel to the acceleration: 0 acceleration, 1 velocity, 2 position."""
    polarity: float = 1.0
    """Sign of the acceleration along the sensor's axis."""
    filters: Response = field(default=_unfiltered)
    """Response of the declared filters of the channel, which is undone."""

    def to_acceleration(self, frequency: Array) -> Spectrum:
        """Factor (n,) from amplitudes of the channel at frequencies (n,) Hz to those of the acceleration."""
        f = np.asarray(frequency, dtype=np.float64)
        return np.asarray(self.polarity * (2j * math.pi * f) ** self.order / self.filters(f))


@dataclass(frozen=True, slots=True)
class Point(Storable):
    """Sensitivity at one frequency: output over acceleration, in the sense of exp(+i w t): a lag is negative."""

    derived: ClassVar[tuple[str, ...]] = ("magnitude", "expanded", "phase", "expanded_phase")

    frequency: float
    """Hz"""
    value: complex
    """Output over acceleration, both in m/s²: 1 for a perfect sensor."""
    std: float
    """Standard uncertainty of the real and of the imaginary part each: the noise is circular."""
    degrees: float
    """Degrees of freedom of `std`."""
    acceleration: complex
    """Amplitude of the reference's acceleration, m/s²; of a broadband motion its rms in the band, real."""
    method: Method
    start: float
    """s, of the stretch that was used."""
    end: float
    """s"""
    reference_std: float = 0.0
    """Declared relative standard uncertainty of the reference's acceleration, which all points share."""

    @property
    def magnitude(self) -> float:
        """Magnitude of the sensitivity."""
        return abs(self.value)

    @property
    def combined(self) -> float:
        """Combined standard uncertainty of the magnitude: of noise and of what is declared of the reference."""
        return math.hypot(self.std, self.reference_std * self.magnitude)

    @property
    def phase(self) -> float:
        """Phase, rad, between -pi and pi."""
        return math.atan2(self.value.imag, self.value.real)

    @property
    def coverage_factor(self) -> float:
        """Student's factor of the magnitude, by effective degrees of freedom (Welch and Satterthwaite)."""
        noise = self.std / self.combined if self.combined > 0.0 else 1.0
        return student(self.degrees / max(noise, 1e-6) ** 4)

    @property
    def phase_factor(self) -> float:
        """Student's factor of the phase, to which noise alone contributes."""
        return student(self.degrees)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty of the magnitude (k = 2)."""
        return self.coverage_factor * self.combined

    @property
    def expanded_phase(self) -> float:
        """Expanded uncertainty of the phase, rad (k = 2); at most pi."""
        return min(self.phase_factor * self.std / self.magnitude, math.pi) if self.magnitude > 0.0 else math.pi


def student(degrees: float) -> float:
    """Student's factor for `COVERAGE`; 2 where there are many degrees of freedom."""
    return float(scipy.special.stdtrit(degrees, 0.5 + 0.5 * COVERAGE))


LEAST_CYCLES = 6.0
"""Periods that the steady part of a step must last."""
SMOOTHED_CYCLES = 4.0
"""Periods over which the envelope is averaged."""
LEVEL = 0.8
"""Share of the envelope's top that belongs to a step: amplitudes that differ by a quarter are two steps."""
FADED, VANISHED = 0.1, 0.01
"""Share of a step's amplitude below which its fading no longer counts as part of it: a fast one, a slow one."""
FALLING = 0.8
"""Share of the envelope that is left one rise time further where it is still fading."""
SIGNIFICANT = 60.0
"""Power of a line over the median of the spectrum; whether it is steady is decided on its envelope."""
ALONE = 0.8
"""Share of the variance that one sine explains where no other shares its stretch."""
FIRST_LOOK = 3
"""Strongest lines that are looked at before a whole search,"""
CLEAR = 0.9
"""and the share of the power within their steps that their sines explain where steps are many: a sweep leaves more."""
MOST_STEPS = 300
MOST_FAILURES = 20
"""Lines in succession that are no step, after which the search ends."""


@dataclass(frozen=True, slots=True)
class SineStep:
    """One or several steady sines over one stretch."""

    frequencies: tuple[float, ...]
    """Hz"""
    start: float
    """s"""
    end: float
    """s"""

    @property
    def centre(self) -> float:
        """Middle of the stretch, s."""
        return 0.5 * (self.start + self.end)


def find_steps(channel: Channel, highest: float, *, lines: int | None = None) -> list[SineStep]:
    """Steady sines of a channel below a frequency in Hz, in the order of time; empty where there is none.

    With `lines` only so many of the strongest lines are looked at.
    """
    t, x = _uniform(channel)
    step = float(t[1] - t[0])
    steps: list[SineStep] = []
    failures = looked_at = 0
    while len(steps) < MOST_STEPS and failures < MOST_FAILURES and looked_at != lines:
        looked_at += 1
        frequency = _strongest(x, step, highest)
        if frequency is None:
            break
        first, last, begin, stop = _stretch(x, step, frequency)
        part = within(channel, t[first], t[last])
        if (t[last] - t[first]) * frequency < LEAST_CYCLES or len(part) < 4 * LEAST_CYCLES:
            failures += 1
            x[begin:stop] = 0.0
            continue
        failures = 0
        sine = SineStep((float(refined_frequency(part, frequency)),), float(t[first]), float(t[last]))
        fitted = fit_sines(part, sine.frequencies, sine.centre)
        remains = float(np.var(fitted.residual))
        power = 0.5 * abs(fitted.amplitudes[0]) ** 2
        if power > ALONE * (power + remains):
            x[begin:stop] = 0.0
        else:
            turns = np.exp(2j * math.pi * sine.frequencies[0] * (t[begin:stop] - sine.centre))
            x[begin:stop] -= np.real(fitted.amplitudes[0] * turns)
        steps.append(sine)
    return _joined(steps)


def may_be_stepped(channel: Channel, highest: float) -> bool:
    """Whether most of the strongest lines are steady sines; where they are not, a whole search would be in vain."""
    steps = find_steps(channel, highest, lines=FIRST_LOOK)
    return 2 * sum(len(s.frequencies) for s in steps) > FIRST_LOOK and explained(channel, steps)[1] >= CLEAR


def explained(channel: Channel, steps: Sequence[SineStep]) -> tuple[float, float]:
    """Share of the channel's power that lies within the steps, and share of that which their sines explain."""
    about = float(np.median(channel.y))
    whole = float(np.sum((channel.y - about) ** 2))
    inside = sines = 0.0
    for step in steps:
        part = within(channel, step.start, step.end)
        amplitudes = fit_sines(part, step.frequencies, step.centre).amplitudes
        inside += float(np.sum((part.y - about) ** 2))
        sines += 0.5 * len(part) * float(np.sum(np.abs(amplitudes) ** 2))
    return (inside / whole, sines / inside) if inside > 0.0 else (0.0, 0.0)


def _uniform(channel: Channel) -> tuple[Array, Array]:
    """The channel on even stamps, without its mean: for the search alone."""
    n = len(channel)
    t = np.linspace(channel.t[0], channel.t[-1], n)
    x = np.interp(t, channel.t, channel.y)
    return t, x - np.mean(x)


def _strongest(x: Array, step: float, highest: float) -> float | None:
    """Frequency of the strongest line, Hz, refined between its bins; None where none stands out."""
    length = scipy.fft.next_fast_len(len(x), real=True)
    power = np.abs(scipy.fft.rfft(x, length)) ** 2
    spacing = 1.0 / (length * step)
    last = min(len(power) - 1, math.ceil(highest / spacing))
    if last < 8:
        return None
    at = 3 + int(np.argmax(power[3:last]))
    if not power[at] > SIGNIFICANT * float(np.median(power[3:last])):
        return None
    left, mid, right = np.sqrt(power[at - 1 : at + 2])
    curvature = left - 2.0 * mid + right
    return float(spacing * (at + (0.5 * (left - right) / curvature if curvature < 0.0 else 0.0)))


def _stretch(x: Array, step: float, frequency: float) -> tuple[int, int, int, int]:
    """First and last sample of the steady part around the top of the envelope, then those of all that belongs to it."""
    window = max(1, round(0.5 * SMOOTHED_CYCLES / (frequency * step)))
    turns = np.exp(-2j * math.pi * frequency * step * np.arange(len(x)))
    demodulated = 2.0 * x * turns
    for _ in range(2):  # a triangle, whose response to other lines falls with the square of their distance
        demodulated = scipy.ndimage.uniform_filter1d(demodulated, window, mode="constant")
    envelope = np.abs(demodulated)
    peak = int(np.argmax(envelope))
    first, last = stretch_about(envelope >= LEVEL * envelope[peak], peak)
    inner = envelope[first : last + 1]
    plateau = float(np.median(inner))
    middle = inner[len(inner) // 4 : max(len(inner) // 4 + 1, 3 * len(inner) // 4)]
    slack = max(0.01, 4.0 * float(np.std(middle)) / plateau if plateau > 0.0 else 0.0)
    steady = np.flatnonzero(inner >= (1.0 - slack) * plateau)
    rise, fall = int(steady[0]), len(inner) - 1 - int(steady[-1])
    near, far = (stretch_about(envelope >= share * plateau, peak) for share in (FADED, VANISHED))
    begin = _faded(envelope, first, -(rise + window), near[0], far[0])
    stop = _faded(envelope, last, fall + window, near[1], far[1]) + 1
    begin += int(np.argmin(envelope[begin : first + 1]))  # where it rises again stands another step
    stop = last + int(np.argmin(envelope[last:stop])) + 1
    start, end = first + rise + window, last - fall - window
    return (start, end, begin, stop) if end > start else (first, first, begin, stop)


def _faded(envelope: Array, edge: int, length: int, near: int, far: int) -> int:
    """Where the fading of a step ends: at `near` where that is soon, else where the envelope falls no more from one
    `length` to the next, at `far` at most."""
    toward = min if length > 0 else max
    at = edge + 2 * length
    if toward(at, near) == near:
        return near
    while (far - at) * length > 0 and envelope[min(max(at + length, 0), len(envelope) - 1)] < FALLING * envelope[at]:
        at += length
    return toward(at, far)


def _joined(steps: list[SineStep]) -> list[SineStep]:
    """Steps that share most of their stretch as one step of several sines over the stretch that they share."""
    joined: list[SineStep] = []
    for step in sorted(steps, key=lambda item: (item.start, item.end)):
        for i, other in enumerate(joined):
            start, end = max(step.start, other.start), min(step.end, other.end)
            if end - start > 0.5 * max(step.end - step.start, other.end - other.start):
                together = tuple(sorted({*other.frequencies, *step.frequencies}))
                joined[i] = replace(other, frequencies=together, start=start, end=end)
                break
        else:
            joined.append(step)
    return sorted(joined, key=lambda item: item.start)
