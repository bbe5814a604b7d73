"""What is true along a record before anyone measures: motion, temperature, lateral acceleration, vibration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from .motion import Motion, band_noise, curve, grid, knots_of, move
from .numerics import STEP, Array, lag, stream

G0 = 9.80665
REFERENCE_TEMPERATURE = 24.0
"""degC; the temperature at which the sensor has its nominal parameters."""
_THERMAL_LAG = 20.0
"""s"""


@dataclass(frozen=True, eq=False)
class Scene:
    """Truth on the fine grid; every array is (n,)."""

    motion: Motion
    seconds: float
    temperature: Array
    """Of the sensing element, degC."""
    a_y: Array
    """Lateral acceleration, m/s²."""
    ripple: Array
    """Vibration of constant envelope one between 200 and 300 Hz, the tone of the bearings."""

    @property
    def t(self) -> Array:
        return self.motion.t

    @property
    def p(self) -> Array:
        return self.motion.p

    @property
    def v(self) -> Array:
        return self.motion.v

    @property
    def a(self) -> Array:
        return self.motion.a

    @property
    def jerk(self) -> Array:
        return self.motion.jerk

    @cached_property
    def since_reversal(self) -> Array:
        """Time since the stage last began to move the other way, s; from the first sample on at the beginning."""
        speed = np.where(np.abs(self.v) > 1e-5, np.sign(self.v), 0.0)
        moving = np.flatnonzero(speed)
        turns = moving[1:][speed[moving[1:]] != speed[moving[:-1]]]
        marks = np.zeros(len(speed), dtype=np.int64)
        marks[turns] = turns
        return self.t - self.t[np.maximum.accumulate(marks)]

    def bearing(self, amplitude: float, exponent: float = 2.0) -> Array:
        """Return bearing vibration, m/s²: amplitude ~ |v|^exponent, `amplitude` at the fastest instant.

        Stakkeland et al. 2007, II-F: 200 to 300 Hz, proportional to v², up to 2 m/s².
        """
        speed = np.abs(self.v)
        return np.asarray(amplitude * (speed / speed.max()) ** exponent * self.ripple)


@lru_cache(maxsize=4)
def scene(motion: str, seed: int, seconds: float) -> Scene:
    """Return the scene of a motion; motion, weather, side motion and bearings draw from streams of their own."""
    t = grid(seconds)
    weather, sideways, bearing = (stream(seed, key) for key in (1, 2, 3))
    knots = knots_of(seconds)
    lateral = curve(0.7 * band_noise(knots, 0.4, 9.0, sideways), seconds, 1)[0]
    f = 250 + 45 * np.sin(2 * np.pi * bearing.uniform(0.7, 1.5) * t + bearing.uniform(0, 2 * np.pi))
    ripple = np.cos(2 * np.pi * (np.cumsum(f) * STEP + bearing.uniform()))
    return Scene(move(motion, seed, seconds), seconds, _warmth(t, weather), lateral, ripple)


def _warmth(t: Array, rng: np.random.Generator) -> Array:
    """Room air that wanders by 2 K or so; the element follows with 20 s, by about 1 K (Newton's law of cooling)."""
    element = np.full_like(t, REFERENCE_TEMPERATURE + rng.uniform(-2, 2))
    for size, shortest, longest in ((2.4, 50, 90), (1.0, 15, 25)):
        w = 2 * np.pi / rng.uniform(shortest, longest)
        slow = w * _THERMAL_LAG
        element += size * np.sin(w * t + rng.uniform(0, 2 * np.pi) - np.arctan(slow)) / np.hypot(1, slow)
    return element


def thermometer(truth: Scene, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return stamps (m,) and readings (m,) of a thermometer beside the element: 0.3 s lag, 10 Hz, 2 mK, own clock."""
    stamps = rng.uniform(0, 0.1) + np.arange(int(truth.seconds * 10.003)) / 10.003
    stamps = stamps[stamps < truth.seconds]
    reading = np.interp(stamps, truth.t, lag(truth.temperature, 0.3))
    return stamps, np.round(reading + 2e-3 * rng.standard_normal(len(stamps)), 3)
