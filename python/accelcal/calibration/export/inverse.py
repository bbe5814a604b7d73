"""The exported function: a piecewise polynomial from reading and temperature to acceleration, evaluated step by step.

Every language of the export runs these steps in this order, so that double gives the same bits everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from accelcal.calibration.export.numbers import Format

READING_OUTSIDE = 1
"""Flag: the reading lies beyond the range in which the bound holds; continued in a straight line."""
TEMPERATURE_OUTSIDE = 2
"""Flag: the temperature does; the bias is extrapolated in a straight line, the scale factor is held."""


@dataclass(frozen=True, slots=True)
class Segment:
    """One polynomial in x = (y - centre) per_half and tau, both within -1 and 1."""

    low: float
    """First y that belongs to it."""
    high: float
    """Last one."""
    centre: float
    per_half: float
    coefficients: tuple[tuple[float, ...], ...]
    """Row i, column j multiply x^i tau^j."""


@dataclass(frozen=True, slots=True)
class Warmth:
    """How temperature enters: y = reading - shift (T - centre), tau = (T - centre) per_half."""

    centre: float
    """degC"""
    half: float
    """K"""
    per_half: float
    """1/K"""
    shift: float
    """Unit of the reading per K."""


@dataclass(frozen=True, slots=True)
class Inverse:
    """Reading to acceleration in one number format; every number in it is one of that format."""

    format: Format
    segments: tuple[Segment, ...]
    """By rising y."""
    slopes: tuple[float, float]
    """d acceleration / d y with which it goes on below the first and above the last segment."""
    warmth: Warmth | None
    """None where temperature does not matter."""

    @property
    def low(self) -> float:
        """Least y of the validity range."""
        return self.segments[0].low

    @property
    def high(self) -> float:
        """Largest y of the validity range."""
        return self.segments[-1].high


def horner(values: Sequence[Any], x: Any) -> Any:
    """Sum of values[i] x^i."""
    total = values[-1]
    for value in values[-2::-1]:
        total = total * x + value
    return total


def polynomial(coefficients: Sequence[Sequence[Any]], x: Any, tau: Any) -> Any:
    """Sum of coefficients[i][j] x^i tau^j: rows in tau, then their values in x."""
    return horner([row[0] if len(row) == 1 else horner(row, tau) for row in coefficients], x)


def evaluate(inverse: Inverse, reading: Any, temperature: Any = 0.0) -> tuple[Any, Any]:
    """Acceleration and flags, bit by bit as the exported code computes them.

    Parameters
    ----------
    inverse : in either format.
    reading : (n,) V, counts or m/s²; taken in the format of the inverse.
    temperature : (n,) degC; not looked at where it does not matter.

    Returns
    -------
    Acceleration (n,), m/s², in the format of the inverse, and the sum of the flags (n,).
    """
    number = inverse.format.kind
    y = inverse.format.array(reading)
    outside = np.zeros(y.shape, dtype=np.uint8)
    tau: Any = number(0.0)
    if inverse.warmth is not None:
        w = inverse.warmth
        t = inverse.format.array(temperature) - number(w.centre)
        y = y - number(w.shift) * t
        held = np.where(t >= number(-w.half), np.where(t <= number(w.half), t, number(w.half)), number(-w.half))
        outside |= np.where((t >= number(-w.half)) & (t <= number(w.half)), 0, TEMPERATURE_OUTSIDE).astype(np.uint8)
        tau = held * number(w.per_half)
    low, high = number(inverse.low), number(inverse.high)
    beyond = ~((y >= low) & (y <= high))
    outside |= np.where(beyond, READING_OUTSIDE, 0).astype(np.uint8)
    inside = np.where(y >= low, np.where(y <= high, y, high), low)
    starts = inverse.format.array([segment.low for segment in inverse.segments[1:]])
    chosen = np.searchsorted(starts, inside, side="right")
    a = np.zeros_like(inside)
    for index, segment in enumerate(inverse.segments):
        x = (inside - number(segment.centre)) * number(segment.per_half)
        rows = [[number(c) for c in row] for row in segment.coefficients]
        a = np.where(chosen == index, polynomial(rows, x, tau), a)
    slope = np.where(y >= low, number(inverse.slopes[1]), number(inverse.slopes[0]))
    return np.where(beyond, a + slope * (y - inside), a), outside
