"""Sine approximation (ISO 16063-11, -41): least squares of sines with a drift, on the stamps as they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np
import scipy

from accelcal._support.errors import AccelcalError
from accelcal._support.result import Storable
from accelcal.data import Array, Channel
from accelcal.signals.transfer import Response, Spectrum

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

    @property
    def magnitude(self) -> float:
        """Magnitude of the sensitivity."""
        return abs(self.value)

    @property
    def phase(self) -> float:
        """Phase, rad, between -pi and pi."""
        return math.atan2(self.value.imag, self.value.real)

    @property
    def coverage_factor(self) -> float:
        """Student's factor for `COVERAGE`; 2 where there are many degrees of freedom."""
        return float(scipy.special.stdtrit(self.degrees, 0.5 + 0.5 * COVERAGE))

    @property
    def expanded(self) -> float:
        """Expanded uncertainty of the magnitude (k = 2)."""
        return self.coverage_factor * self.std

    @property
    def expanded_phase(self) -> float:
        """Expanded uncertainty of the phase, rad (k = 2); at most pi."""
        return min(self.expanded / self.magnitude, math.pi) if self.magnitude > 0.0 else math.pi
