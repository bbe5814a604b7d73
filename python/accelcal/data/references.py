"""References that are no position, a velocity or an acceleration, and the position that each integrates to."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal

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

    A cubic spline through the readings is integrated, once or twice.

    Raises
    ------
    RecordingError
        If it is called otherwise, is in another unit, or has fewer than two readings.
    """
    order, _ = require_reference(reference)
    if len(reference) < 2:
        raise RecordingError(f"{reference.name}: {len(reference)} readings, expected at least 2")
    spline = scipy.interpolate.CubicSpline(reference.t, reference.y)
    return Channel("position", reference.t, spline.antiderivative(POSITION_ORDER - order)(reference.t), "m")


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
