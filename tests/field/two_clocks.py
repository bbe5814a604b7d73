"""Two recorders of one motion with clocks of their own, from analytic motion: shares nothing with the product."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Series = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """A sum of tones."""

    w: Series
    """rad/s"""
    size: Series
    """Of the acceleration, m/s²."""
    phase: Series

    @classmethod
    def of_tones(cls, rng: np.random.Generator, low: float, high: float, count: int, rms: float = 2.0) -> Motion:
        """Tones between two frequencies, Hz."""
        w = 2.0 * np.pi * np.exp(rng.uniform(np.log(low), np.log(high), count))
        size = rng.uniform(0.3, 1.0, count)
        return cls(w, size * rms / np.sqrt(0.5 * np.sum(size**2)), rng.uniform(0.0, 2.0 * np.pi, count))

    def acceleration(self, t: Series) -> Series:
        """m/s²"""
        total = np.zeros(len(t))
        for w, size, phase in zip(self.w, self.size, self.phase, strict=True):
            total += size * np.sin(w * t + phase)
        return total

    def position(self, t: Series) -> Series:
        """m"""
        total = np.zeros(len(t))
        for w, size, phase in zip(self.w, self.size, self.phase, strict=True):
            total -= size / w**2 * np.sin(w * t + phase)
        return total

    @property
    def fastest(self) -> float:
        """Hz"""
        return float(np.max(self.w)) / (2.0 * np.pi)


@dataclass(frozen=True)
class Pair:
    """What two loggers write of one motion."""

    accel_t: Series
    """By the clock of the sensor, s."""
    accel: Series
    """m/s²"""
    position_t: Series
    """s"""
    position: Series
    """m"""
    skew: float
    """By how much the clock of the sensor runs faster."""
    seconds: float
    fastest: float
    """Hz"""
    shift: float
    """Of the first instant of the position, behind that of the sensor, s of true time."""


def pair(
    seed: int,
    *,
    related: bool = True,
    skew: float | None = None,
    seconds: float | None = None,
    rates: tuple[float, float] | None = None,
    tones: bool | None = None,
    sign: float = 1.0,
) -> Pair:
    """A pair with k = 1 %, K0 = 0.1 m/s² and white noise; what is not given is drawn: skews log-uniform to 8 %, 20 s to
    20 min, few tones or a filled band, any shift within a tenth of the length."""
    rng = np.random.default_rng([35, seed])
    seconds = seconds or float(np.exp(rng.uniform(np.log(20.0), np.log(1200.0))))
    few = bool(rng.random() < 0.5) if tones is None else tones

    def drawn() -> Motion:
        if few:
            return Motion.of_tones(
                rng, 0.3, float(np.exp(rng.uniform(np.log(3.0), np.log(12.0)))), int(rng.integers(4, 9))
            )
        low = rng.uniform(0.2, 1.0)
        return Motion.of_tones(rng, low, low * rng.uniform(3.0, 12.0), int(min(400, max(40, 0.5 * seconds))))

    motion = drawn()
    fast = motion.fastest
    of_accel, of_position = rates or (
        min(1000.0, fast * rng.uniform(8.0, 40.0)),
        min(1000.0, fast * rng.uniform(6.0, 30.0)),
    )
    if skew is None:
        skew = float(np.exp(rng.uniform(np.log(1e-4), np.log(0.08))) * rng.choice([-1.0, 1.0]))
    shift = seconds * rng.uniform(-0.1, 0.1) if rates is None else 0.0
    t, read = np.arange(0.0, seconds, 1.0 / of_accel), np.arange(0.0, seconds, 1.0 / of_position)
    accel = sign * (0.1 + 1.01 * motion.acceleration(t)) + rng.uniform(0.003, 0.05) * rng.standard_normal(len(t))
    other = motion if related else drawn()
    noise = 10.0 ** rng.uniform(-6.0, -4.0)
    position = other.position(read + shift) + noise * rng.standard_normal(len(read))
    return Pair((1.0 + skew) * t, accel, read, position, skew, seconds, fast, shift)
