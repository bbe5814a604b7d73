"""Place, attitude, angle and gyroscope of a body that turns: from columns of a file to what a fit needs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from accelcal.data import (
    ANGLE,
    GRAVITY,
    GRAVITY_NOISE,
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
    units,
)
from accelcal.data.arrays import Unchanged, median_step, root_mean_square
from accelcal.data.orientation import (
    FASTEST_TURN,
    QUATERNION_TOLERANCE,
    Sense,
    attitude_scatter,
    carried,
    holes,
    leaps,
    left_open,
    on_arm,
    rotated,
    ties_of_arm,
    turned,
    turning,
    unwrapped,
    within,
)
from accelcal.io import naming
from accelcal.io.assign import (
    ATTITUDE,
    attitude_columns,
)
from accelcal.io.dwell_tables import local_gravity
from accelcal.io.sidecar import (
    Attitude,
    Sidecar,
    Source,
)
from accelcal.io.table import Table

MOST_GRAVITY = 1.5 * STANDARD_GRAVITY
"""Largest gravity along an axis that is one, m/s²: the acceleration of a turning axis may be part of it."""


def parts_of_orientation(declared: Sidecar) -> tuple[str, ...]:
    """Channels that are read as parts of an orientation, and are none of the recording."""
    return (*PLACE, *ATTITUDE) if declared.attitude is not None else (ANGLE,) if declared.turns else ()


def with_orientation(
    file: str, channels: Mapping[str, Channel], declared: Sidecar, unchanged: Unchanged | None = None
) -> tuple[dict[str, Channel], Rig, list[Finding]]:
    """The channels of a recording with what its orientation says of the input axis, the rig, and what was noticed.

    Parameters
    ----------
    file : its name, for messages.
    channels : what was read, by name.
    declared : its sidecar.
    unchanged : of another output of the same body, whose motion it holds.

    Raises
    ------
    RecordingError
        If a quaternion is not of length 1, a part of the orientation was never sampled, or gravity along the axis is
        none.
    """
    if declared.attitude is not None:
        return _of_attitude(file, dict(channels), declared, declared.attitude, unchanged or Unchanged())
    if declared.angle_zero is not None:
        return _of_angle(file, dict(channels), declared)
    if declared.input_axis is not None:  # beside it stands a gyroscope
        return _of_gyroscope(file, dict(channels), declared)
    if GRAVITY not in channels:
        return dict(channels), declared.rig, []
    level = channels[GRAVITY]
    turns = LEVERS[0] in channels
    if level.unit != "m/s^2" or (not turns and float(np.max(np.abs(level.y))) > MOST_GRAVITY):
        raise RecordingError(
            f"{file}: {GRAVITY}: between {np.min(level.y):.4g} and {np.max(level.y):.4g} {level.unit}; expected what "
            "an ideal accelerometer on the axis reads at rest, within ±9.81 m/s^2. Give g times the sine of the axis's "
            "elevation in place of an angle, and check the unit of the column"
        )
    return dict(channels), replace(declared.rig, gravity_along_axis=float(np.mean(level.y))), []


def undeclared_orientation(table: Table, declared: Sidecar) -> list[Finding]:
    """A note on columns that look like an orientation, where none is declared."""
    declared_axis = declared.attitude is not None or declared.input_axis is not None or GRAVITY in declared.channels
    roles = naming.orientation_roles(table.columns)
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


def _of_attitude(
    file: str, channels: dict[str, Channel], declared: Sidecar, attitude: Attitude, unchanged: Unchanged
) -> tuple[dict[str, Channel], Rig, list[Finding]]:
    columns = dict(attitude_columns(declared))
    for name in parts_of_orientation(declared):
        if name not in channels:
            column = columns.get(name) or declared.channels[name].column
            what = name if name in PLACE else f"the attitude ({name.removeprefix('attitude.')})"
            raise RecordingError(
                f'{file}: column "{column}": every cell is empty, expected numbers for {what}; give another '
                "column, or leave [channels.attitude] out"
            )
    place = [channels.pop(name) for name in PLACE]
    stamps, q = at_shared_instants([channels.pop(name) for name in ATTITUDE])
    _require_unit_length(file, stamps, q, columns)
    q = q / np.linalg.norm(q, axis=1)[:, None]
    noise: Array | float = attitude.noise or unchanged("scatter", (q,), lambda: attitude_scatter(q))
    sense, of_gyroscope = attitude.maps, list[Finding]()
    jumps = _leaps("attitude", stamps, 2.0 * np.arccos(np.minimum(1.0, np.abs(np.sum(q[1:] * q[:-1], axis=1)))))
    if all(name in channels for name in GYROSCOPE):
        stamps, q, noise, of_gyroscope = _between_readings(
            file, channels, declared, sense, (stamps, q, float(noise)), unchanged
        )
        sense = "sensor to ENU"
    else:
        noise = float(noise) ** 2 * median_step(stamps)
    t, r = at_shared_instants(place)
    near = np.pad(within(stamps), 1)[np.searchsorted(stamps, t)] | np.isin(t, stamps)
    if int(np.sum(near)) < 2:
        raise RecordingError(
            f"{file}: {', '.join(PLACE)} and the attitude share {int(np.sum(near))} instants; at least 2 are needed. "
            "Check the time columns of both"
        )
    axis = np.array(declared.input_axis)
    g = local_gravity(declared.dwell)
    directions = turning(t[near], r[near], (stamps, q), axis, sense, noise, unchanged, g)
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
    findings += [Finding("turning", "position", len(q), float(t[0]), text), *of_gyroscope]
    most = math.sqrt(2.0 * float(np.max(directions.side[GRAVITY_NOISE].y)))
    text = (
        f"noise of the attitude makes gravity along the axis uncertain by up to {most:.2g} (m/s^2)/sqrt(Hz), which is "
        "in the model beside the noise of the output"
    )
    findings.append(Finding("attitude_noise", "position", len(q), float(t[0]), text))
    findings += jumps
    ties = left_open(directions, rig.sensor.noise, triad=bool(declared.axis))
    findings += [Finding("tie", name, 1, float(t[0]), text) for name, text in ties]
    return {**channels, "position": position, **directions.side}, rig, findings


def _of_angle(
    file: str, channels: dict[str, Channel], declared: Sidecar
) -> tuple[dict[str, Channel], Rig, list[Finding]]:
    rig, column = declared.rig, declared.channels[ANGLE].column
    assert declared.angle_zero is not None
    assert rig.arm is not None
    assert rig.axle is not None
    if ANGLE not in channels or float(np.ptp(channels[ANGLE].y)) == 0.0:
        what = f"{channels[ANGLE].y[0]:.6g} rad throughout" if ANGLE in channels else "every cell is empty"
        raise RecordingError(
            f'{file}: column "{column}", {ANGLE}: {what}; expected the angle of an arm that turns. Give its column, or '
            "leave arm, axle and angle out and record a sensor at rest as a dwell ([dwell] angle)"
        )
    t, angle, findings = _unwrapped(file, channels.pop(ANGLE), declared.channels[ANGLE])
    steps = np.abs(np.diff(angle)) / (2.0 * math.pi) * within(t)
    if np.max(steps) > FASTEST_TURN:
        first = int(np.argmax(steps > FASTEST_TURN))
        text = (
            f"the angle changes by up to {np.max(steps):.2g} turns from one reading to the next (first at t = "
            f"{units.instant(t[first])} s): beyond half a turn the direction is unknown; read the encoder more often"
        )
        findings.append(
            Finding("fast_angle", "position", int(np.sum(steps > FASTEST_TURN)), float(t[first]), text, "warning")
        )
    findings += _leaps("angle", t, np.diff(angle))
    axis, count = np.array(declared.input_axis), quality.reading_step(angle, None)
    motion = on_arm(t, angle - declared.angle_zero, rig.arm, rig.axle, axis)
    turns, rate = float(np.ptp(angle)) / (2.0 * math.pi), np.abs(np.diff(angle) / np.diff(t))
    text = (
        f"the arm turns over {turns:.3g} turns, at up to {np.quantile(rate, 0.99):.3g} rad/s; position is the path "
        f"along the axis on the arm, and {GRAVITY} what the axis reads beside it: {np.min(motion.gravity.y):.3g} to "
        f"{np.max(motion.gravity.y):.3g} m/s^2"
    )
    findings.append(Finding("turning", "position", len(t), float(t[0]), text))
    rounded = STANDARD_GRAVITY * math.cos(rig.axle) * math.hypot(*axis[:2]) * count / math.sqrt(12.0)
    if rounded > 0.0:
        text = (
            f"counts of {math.degrees(count):.2g} degrees make gravity along the axis uncertain by up to {rounded:.2g} "
            "m/s^2 while the arm rests, which is in the model"
        )
        findings.append(Finding("attitude_noise", "position", len(t), float(t[0]), text))
    ties = ties_of_arm(motion, rig.arm, rig.axle)
    findings += [Finding("tie", name, 1, float(t[0]), text) for name, text in ties]
    rig = replace(rig, gravity_along_axis=float(np.mean(motion.gravity.y)))
    return {**channels, "position": motion.path, **motion.side}, rig, findings


def _leaps(what: str, t: Array, steps: Array) -> list[Finding]:
    """What is noticed of an orientation that changes from one reading to the next as nothing that moves does."""
    at = leaps(t, steps)
    if not len(at):
        return []
    text = (
        f"jumps of the {what} from one reading to the next: {len(at)}, the first at t = {units.instant(t[at[0]])} s by "
        f"{math.degrees(abs(steps[at[0] - 1])):.3g} degrees, of which the readings before and behind show nothing; "
        "empty the cells of wrong readings, or cut the part behind a jump (accelcal cut)"
    )
    return [Finding("leap", "position", len(at), float(t[at[0]]), text, "warning")]


def _unwrapped(file: str, channel: Channel, source: Source) -> tuple[Array, Array, list[Finding]]:
    """Times (n,) s and angles (n,) rad without jumps, and what was noticed of these."""
    counted = source.scale is not None and source.scale[1] == "count"
    behind = unwrapped(channel.t, channel.y, 1.0 / abs(source.scale[0]) if counted and source.scale else 0.0)
    t, turn, findings = channel.t[behind.valid], 2.0 * math.pi, list[Finding]()
    if len(behind.jumps):
        k = int(behind.jumps[0])
        jump = abs(channel.y[behind.valid][k] - channel.y[behind.valid][k - 1]) / turn
        raise RecordingError(
            f'{file}: column "{source.column}", {ANGLE}: jumps of more than half a turn: {len(behind.jumps)}, the '
            f"first at t = {units.instant(t[k])} s by {jump:.4g} turns; expected less than {FASTEST_TURN:g} turns "
            "between readings, or jumps by a whole turn, or by the range of a counter that overflows. Check unit and "
            "scale, read the encoder more often, or load a part without the jumps (--from, --to)"
        )
    wrong = np.flatnonzero(~behind.valid)
    if len(wrong):
        text = (
            f"readings of the angle that jump by more than half a turn and back are left out: {len(wrong)}, the first "
            f"at t = {units.instant(channel.t[wrong[0]])} s"
        )
        findings.append(Finding("wrong_angle", "position", len(wrong), float(channel.t[wrong[0]]), text, "warning"))
    if behind.modulus != turn:
        size = behind.modulus * abs(source.scale[0]) if counted and source.scale else behind.modulus / turn
        text = (
            f"the reading of the angle overflows after {size:.6g} {'counts' if counted else 'turns'}, which are "
            f"{behind.modulus / turn:.5g} turns; it is continued across the jumps"
        )
        findings.append(Finding("overflow", "position", 1, float(t[0]), text))
    return t, behind.angle, findings


def at_shared_instants(parts: Sequence[Channel]) -> tuple[Array, Array]:
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
    return root_mean_square(angle), float(np.max(angle))


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


def _rates(file: str, channels: dict[str, Channel], declared: Sidecar) -> tuple[Array, Array]:
    """Times (n,) s and rates (n, 3) rad/s of the gyroscope, which is no channel any more."""
    for name in GYROSCOPE:
        if name not in channels or channels[name].unit != "rad/s":
            what = "every cell is empty" if name not in channels else f"its unit is {channels[name].unit}"
            raise RecordingError(
                f'{file}: column "{declared.channels[name].column}", {name}: {what}; expected an angular rate, '
                'right-handed about the same axes as input_axis: unit = "rad/s"'
            )
    t, rates = at_shared_instants([channels.pop(name) for name in GYROSCOPE])
    if len(t) < 2:
        raise RecordingError(
            f"{file}: {', '.join(GYROSCOPE)} share {len(t)} instants; at least 2 are needed. Check their time columns"
        )
    return t, rates


def _between_readings(
    file: str,
    channels: dict[str, Channel],
    declared: Sidecar,
    sense: Sense,
    reference: tuple[Array, Array, float],
    unchanged: Unchanged,
) -> tuple[Array, Array, Array, list[Finding]]:
    """Times, quaternions from sensor to ENU and noise of an attitude that a gyroscope carries between its readings, and
    what to say; `reference` has times, quaternions of a `sense` and the standard deviation of a reading."""
    stamps, q, scatter = reference
    t, rates = _rates(file, channels, declared)
    if len(cuts := holes(t)):
        raise RecordingError(
            f"{file}: {', '.join(GYROSCOPE)}: {len(cuts)} holes, the first from t = {t[cuts[0] - 1]:.6g} s to "
            f"{t[cuts[0]]:.6g} s; expected rates without a hole. Load a part without one (--from, --to), or leave "
            "them out"
        )
    shared = stamps[(t[0] <= stamps) & (stamps <= t[-1])]
    if len(shared) < LEAST_ATTITUDES or shared[-1] - shared[0] < LEAST_SECONDS:
        raise RecordingError(
            f"{file}: {len(shared)} readings of the attitude lie between t = {t[0]:.6g} s and {t[-1]:.6g} s, where "
            f"{', '.join(GYROSCOPE)} were recorded; expected {LEAST_ATTITUDES} over {LEAST_SECONDS:g} s. Check the "
            "clocks of both, or leave these out"
        )
    attitude = scipy.spatial.transform.Rotation.from_quat(q, scalar_first=True)
    attitude = attitude if sense == "sensor to ENU" else attitude.inv()
    readings = stamps, q, t, rates, scatter
    body = unchanged("carried", readings, lambda: carried((stamps, attitude), (t, rates), scatter))
    if body.disagreement > MOST_DISAGREEMENT:
        raise RecordingError(
            f"{file}: {', '.join(GYROSCOPE)} turn otherwise than the attitude: over a second by "
            f"{body.disagreement:.3g} times what the noise of both explains. Check their unit, order and sense, the "
            "clock of both and maps of [channels.attitude], or leave them out"
        )
    bias = ", ".join(f"{math.degrees(b):.2g}" for b in body.bias)
    off = float(np.max(np.abs(body.matrix - np.eye(3))))
    axes = "; its axes are not those of the attitude, which is allowed for" * (off > OTHER_AXES)
    text = (
        f"a gyroscope carries the attitude between its readings from t = {body.t[0]:.6g} s to {body.t[-1]:.6g} s: bias "
        f"{bias} deg/s, matrix up to {off:.2g} from unity, {units.in_usual_unit(body.delay, 's')} behind the attitude, "
        f"a reading of which scatters by {units.in_usual_unit(scatter, 'rad', 2)}{axes}"
    )
    unused = np.count_nonzero((stamps < body.t[0]) | (stamps > body.t[-1]))
    if unused > 0.1 * len(stamps):
        text += f"; {unused} readings of the attitude beyond it are left out, as are the places beside them"
    finding = Finding("carried", "gyroscope", len(t), float(t[0]), text)
    return body.t, body.attitude.as_quat(scalar_first=True), body.noise, [finding]


LEAST_ATTITUDES, LEAST_SECONDS = 32, 5.0
"""Fewer readings of an attitude, or less time, determine no bias and matrix of a gyroscope."""
MOST_DISAGREEMENT = 10.0
"""Disagreement beyond which a gyroscope is another body's, or in another unit."""
OTHER_AXES = 0.2
"""Element of the matrix of a gyroscope that no tolerance of its axes explains."""


def _of_gyroscope(
    file: str, channels: dict[str, Channel], declared: Sidecar
) -> tuple[dict[str, Channel], Rig, list[Finding]]:
    t, rates = _rates(file, channels, declared)
    first, second = turned(t, rates, np.array(declared.input_axis))
    reach = [math.degrees(float(np.ptp(angle.y))) for angle in (first, second)]
    text = (
        f"the gyroscope sees the input axis turn by {reach[0]:.3g} and {reach[1]:.3g} degrees in all about two "
        "directions across it, drift included; every fit estimates gravity along it"
    )
    finding = Finding("turning", "gyroscope", len(t), float(t[0]), text)
    return {**channels, first.name: first, second.name: second}, declared.rig, [finding]
