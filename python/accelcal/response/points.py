"""Values of a frequency response: one frequency with its uncertainty, and the reference."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np
import scipy

from accelcal._support.result import Storable
from accelcal.data.arrays import Array
from accelcal.data.recording import Channel
from accelcal.signals.transfer import Response, Spectrum

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
