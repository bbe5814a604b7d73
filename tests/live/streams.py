"""Streams of a stage on two tones, made without the package: rows, and the lines that a device would send."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RATE = 2000.0
NOISE = 2e-3
"""One-sided density of the sensor, (m/s²)/sqrt(Hz)."""
RESOLUTION = 1e-6
"""Of the position, m."""
BIAS, SCALE = 0.05, 0.01
RIG = """
[sensor]
noise = "2e-3 m/s^2/Hz^0.5"
[channels]
time = { column = "t", unit = "s" }
accel = { column = "accel", unit = "m/s^2" }
position = { column = "position", unit = "mm", resolution = "1 um" }
"""
TONES = ((2.0, 12.0), (5.0, 31.0))
"""Amplitude, m/s², and angular frequency, rad/s."""


@dataclass(frozen=True)
class Stream:
    """What a device measures."""

    t: np.ndarray
    u: np.ndarray
    """m/s²"""
    z: np.ndarray
    """m, NaN where not read."""

    def lines(self) -> bytes:
        """In the units of `RIG`, an empty field where nothing was read."""
        rows = zip(self.t.tolist(), self.u.tolist(), self.z.tolist(), strict=True)
        return b"".join(b"%r,%r,%s\n" % (t, u, b"" if z != z else b"%r" % (1e3 * z)) for t, u, z in rows)


def stream(
    seconds: float, seed: int = 1, *, step: float = 0.0, at: float = 0.0, polarity: float = 1.0, gravity: float = 0.0
) -> Stream:
    """Position in every second row; from `at` (s) on the bias is larger by `step` (m/s²)."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    a = sum(amplitude * np.sin(w * t) for amplitude, w in TONES)
    p = -sum(amplitude / w**2 * np.sin(w * t) for amplitude, w in TONES)
    u = BIAS + step * (t >= at) + (1.0 + SCALE) * polarity * (a + gravity)
    u = u + NOISE * np.sqrt(RATE / 2.0) * rng.standard_normal(len(t))
    read = p + RESOLUTION * (rng.random(len(t)) - 0.5)  # as a rounding error that is white
    z = np.where(np.arange(len(t)) % 2 == 0, read, np.nan)
    return Stream(t, u, z)
