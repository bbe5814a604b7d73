"""Channels of a body that turns: place, attitude and gyroscope become position, gravity and angles along one axis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from accelcal.data import (
    GRAVITY,
    GYROSCOPE,
    LEVERS,
    PLACE,
    QUATERNION,
    STANDARD_GRAVITY,
    Array,
    Channel,
    Finding,
    RecordingError,
    Rig,
    quality,
)
from accelcal.data.orientation import HOLE, QUATERNION_TOLERANCE, rotated, turned, turning
from accelcal.io import naming
from accelcal.io.assign import ATTITUDE, attitude_columns
from accelcal.io.sidecar import Sidecar
from accelcal.io.table import Table

MOST_GRAVITY = 1.5 * STANDARD_GRAVITY
"""Largest gravity along an axis that is one, m/s²: the acceleration of a turning axis may be part of it."""


def parts_of_orientation(declared: Sidecar) -> tuple[str, ...]:
    """Channels that are read as parts of an orientation, and are none of the recording."""
    return (*PLACE, *ATTITUDE) if declared.attitude is not None else ()


def with_orientation(
    file: str, channels: Mapping[str, Channel], declared: Sidecar
) -> tuple[dict[str, Channel], Rig, list[Finding]]:
    """The channels of a recording with what its orientation says of the input axis, the rig, and what was noticed.

    Parameters
    ----------
    file : its name, for messages.
    channels : what was read, by name.
    declared : its sidecar.

    Raises
    ------
    RecordingError
        If a quaternion is not of length 1, a part of the orientation was never sampled, or gravity along the axis is
        none.
    """
    if declared.attitude is not None:
        return _of_attitude(file, dict(channels), declared)
    gyroscope = declared.input_axis is not None
    if gyroscope:
        return _of_gyroscope(file, dict(channels), declared)
    if GRAVITY not in channels:
        return dict(channels), declared.rig, []
    level = channels[GRAVITY]
    if level.unit != "m/s^2" or float(np.max(np.abs(level.y))) > MOST_GRAVITY + _shaken(channels):
        raise RecordingError(
            f"{file}: {GRAVITY}: between {np.min(level.y):.4g} and {np.max(level.y):.4g} {level.unit}; expected what "
            "an ideal accelerometer on the axis reads at rest, within ±9.81 m/s^2. Give g times the sine of the axis's "
            "elevation in place of an angle, and check the unit of the column"
        )
    return dict(channels), replace(declared.rig, gravity_along_axis=float(np.mean(level.y))), []


def asked(table: Table, declared: Sidecar) -> list[Finding]:
    """A note on columns that look like an orientation, where none is declared."""
    declared_axis = declared.attitude is not None or declared.input_axis is not None or GRAVITY in declared.channels
    roles = {naming.orientation_role(naming.take_apart(column).base): column for column in table.columns}
    lines = []
    if not declared_axis and set(GYROSCOPE) <= set(roles):
        columns = ", ".join(roles[name] for name in GYROSCOPE)
        lines.append(f'a gyroscope ({columns}): map them as {", ".join(GYROSCOPE)} and write [rig] input_axis = "x"')
    if not declared_axis and set(QUATERNION) <= set(roles):
        columns = ", ".join(f'"{roles[name]}"' for name in QUATERNION)
        lines.append(
            f'an attitude: map {", ".join(PLACE)} and write [rig] input_axis = "x" and [channels.attitude] '
            f'columns = [{columns}], maps = "sensor to ENU"'
        )
    if not lines:
        return []
    text = f"orientation is not declared, though columns look like {'; or like '.join(lines)}, with your own axis"
    return [Finding("orientation", "", 1, 0.0, text)]


def _shaken(channels: Mapping[str, Channel]) -> float:
    """What the acceleration of a turning axis may add to gravity along it, m/s²; 0 where no body turns."""
    return math.inf if LEVERS[0] in channels else 0.0


def _of_attitude(
    file: str, channels: dict[str, Channel], declared: Sidecar
) -> tuple[dict[str, Channel], Rig, list[Finding]]:
    assert declared.attitude is not None
    assert declared.input_axis is not None
    columns = dict(attitude_columns(declared))
    for name in parts_of_orientation(declared):
        if name not in channels:
            column = columns.get(name) or declared.channels[name].column
            raise RecordingError(
                f'{file}: column "{column}": every cell is empty, expected numbers for {_in_words(name)}; give another '
                "column, or leave [channels.attitude] out"
            )
    place = [channels.pop(name) for name in PLACE]
    stamps, q = together([channels.pop(name) for name in ATTITUDE])
    _require_unit_length(file, stamps, q, columns)
    q = q / np.linalg.norm(q, axis=1)[:, None]
    t, r = together(place)
    near = np.abs(t - stamps[np.clip(np.searchsorted(stamps, t), 1, len(stamps) - 1)])
    near = np.minimum(near, np.abs(t - stamps[np.clip(np.searchsorted(stamps, t) - 1, 0, len(stamps) - 1)]))
    near = near <= HOLE * float(np.median(np.diff(stamps)))
    if int(np.sum(near)) < 2:
        raise RecordingError(
            f"{file}: {', '.join(PLACE)} and the attitude share {int(np.sum(near))} instants; at least 2 are needed. "
            "Check the time columns of both"
        )
    axis = np.array(declared.input_axis)
    directions = turning(t[near], r[near], (stamps, q), axis, declared.attitude.maps)
    position, findings = quality.clean(
        quality.Samples(file, "position", directions.path.t, directions.path.y, "m", lambda i: f"reading {i}"),
        declared.rig,
    )
    level = directions.gravity.y
    rig = replace(declared.rig, gravity_along_axis=float(np.mean(level)))
    rms, most = _turning_of(q, axis)
    text = (
        f"the input axis turns by {rms:.2g} degrees rms about its mean direction, at most {most:.2g}; position is the "
        f"path along that mean direction, and {GRAVITY} what the acceleration along the turning axis exceeds that of "
        f"the path by, gravity included: {np.min(level):.3g} to {np.max(level):.3g} m/s^2"
    )
    findings.append(Finding("turning", "position", len(q), float(t[0]), text))
    return {**channels, "position": position, **directions.side}, rig, findings


def together(parts: Sequence[Channel]) -> tuple[Array, Array]:
    """Channels at the instants at which all were sampled: (n,) s and (n, channels)."""
    t = parts[0].t
    for part in parts[1:]:
        if not np.array_equal(t, part.t):
            t = np.intersect1d(t, part.t)
    return t, np.column_stack([part.y[np.searchsorted(part.t, t)] for part in parts])


def _turning_of(q: Array, axis: Array) -> tuple[float, float]:
    """Angle of the axis from its mean direction, rms and largest, degrees; the sense of the quaternion is of no matter.

    The directions of an axis in the other frame are turned by the same angles.
    """
    e = rotated(q, axis, "sensor to ENU")
    mean = np.mean(e, axis=0)
    angle = np.degrees(np.arccos(np.clip(e @ (mean / np.linalg.norm(mean)), -1.0, 1.0)))
    return float(np.sqrt(np.mean(angle**2))), float(np.max(angle))


def _require_unit_length(file: str, t: Array, q: Array, columns: Mapping[str, str]) -> None:
    length = np.linalg.norm(q, axis=1)
    bad = np.abs(length - 1.0) > QUATERNION_TOLERANCE
    if bad.any():
        i = int(np.argmax(bad))
        raise RecordingError(
            f"{file}: columns {', '.join(columns.values())}: {int(np.sum(bad))} quaternions are not of length 1 (first "
            f"at t = {t[i]:.6g} s: {length[i]:.4g}); expected w, x, y, z of a unit quaternion. Check the order of the "
            "columns and their units, and leave the cells of bad samples empty"
        )


def _in_words(name: str) -> str:
    return name if name in PLACE else f"the attitude ({name.removeprefix('attitude.')})"


def _of_gyroscope(
    file: str, channels: dict[str, Channel], declared: Sidecar
) -> tuple[dict[str, Channel], Rig, list[Finding]]:
    assert declared.input_axis is not None
    for name in GYROSCOPE:
        if name not in channels or channels[name].unit != "rad/s":
            what = "every cell is empty" if name not in channels else f"its unit is {channels[name].unit}"
            raise RecordingError(
                f'{file}: column "{declared.channels[name].column}", {name}: {what}; expected an angular rate, '
                'right-handed about the same axes as input_axis: unit = "rad/s"'
            )
    t, rates = together([channels.pop(name) for name in GYROSCOPE])
    first, second = turned(t, rates, np.array(declared.input_axis))
    reach = [math.degrees(float(np.ptp(angle.y))) for angle in (first, second)]
    text = (
        f"the gyroscope sees the input axis turn by {reach[0]:.3g} and {reach[1]:.3g} degrees in all about two "
        "directions across it, drift included; every fit estimates gravity along it"
    )
    finding = Finding("turning", "gyroscope", len(t), float(t[0]), text)
    return {**channels, first.name: first, second.name: second}, declared.rig, [finding]
