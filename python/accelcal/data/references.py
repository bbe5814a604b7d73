"""References that are no position, a velocity or an acceleration, and the position that each integrates to."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal

import numpy as np
import scipy

from accelcal.data import units
from accelcal.data.recording import Channel, RecordingError

Reference = Literal["position", "velocity", "reference_acceleration"]
"""What tells the motion of the stage."""
VELOCITY: Final = "velocity"
ACCELERATION: Final = "reference_acceleration"
POSITION_ORDER: Final = 2
"""Derivatives of a position that make an acceleration."""
Order = Literal[0, 1, 2]
"""Derivatives of a reference that make an acceleration."""
ORDERS: Final[dict[str, tuple[Order, str]]] = {ACCELERATION: (0, "m/s^2"), VELOCITY: (1, "m/s")}
"""By channel name: how many derivatives of it make an acceleration, and its unit."""
DEGREE = 5
"""Of the splines through a reference that are integrated."""
PIECE, BESIDE = 200_000, 64
"""Readings of one spline, so that memory is bounded, and further ones on either side, which its ends do not reach."""
UNITS = {"position": "m", **{name: unit for name, (_, unit) in ORDERS.items()}}
"""SI unit of the readings, by reference."""


def reference_among(channels: Iterable[str]) -> str | None:
    """The channel that tells the motion where no position does; None where one does, or nothing.

    Beside a position a velocity or an acceleration is a further channel like any other.
    """
    names = {*channels}
    return None if "position" in names else next((name for name in (VELOCITY, ACCELERATION) if name in names), None)


def integrated(reference: Channel) -> Channel:
    """The position that a velocity or an acceleration integrates to, zero at its first reading, at rest there.

    A spline of the fifth degree through the readings is integrated, once or twice: where a few were lost in a row a
    cubic one would be off by more than their noise.

    Raises
    ------
    RecordingError
        If it is called otherwise, is in another unit, or has fewer than two readings.
    """
    order, _ = require_reference(reference)
    if len(reference) < 2:
        raise RecordingError(f"{reference.name}: {len(reference)} readings, expected at least 2")
    t, y = reference.t, reference.y
    p, speed = np.zeros(len(t)), 0.0
    for begin in range(0, len(t) - 1, PIECE):
        end = min(begin + PIECE, len(t) - 1)
        near = slice(max(0, begin - BESIDE), min(len(t), end + BESIDE + 1))
        known, rows = t[near] - t[begin], slice(begin, end + 1)
        at = t[rows] - t[begin]
        curve = scipy.interpolate.make_interp_spline(known, y[near], k=degree(len(known)))
        once = curve.antiderivative(1)
        p[rows] = p[begin] + speed * at
        if order == 1:
            p[rows] += once(at) - once(0.0)
        else:
            twice = curve.antiderivative(2)
            p[rows] += twice(at) - twice(0.0) - once(0.0) * at
            speed += float(once(at[-1]) - once(0.0))
    return Channel("position", t, p, "m")


def degree(readings: int) -> int:
    """Of a spline through so many readings, odd."""
    most = min(DEGREE, readings - 1)
    return most - 1 + most % 2


def require_reference(channel: Channel) -> tuple[Order, str]:
    """How many derivatives of a reference make an acceleration, and its unit.

    Raises
    ------
    RecordingError
        If it is no velocity or acceleration.
    """
    known = ORDERS.get(channel.name)
    if known is None:
        raise RecordingError(f"{channel.name}: no reference; expected {' or '.join(ORDERS)}")
    if not units.same_unit(channel.unit, known[1]):
        raise RecordingError(
            f"{channel.name} is in {channel.unit}; expected {known[1]}, or a unit that converts to it: the reference "
            "moves along one axis, and turning tables are not calibrated"
        )
    return known
