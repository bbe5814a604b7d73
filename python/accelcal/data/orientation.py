"""A body that turns: path along the axis of a sensor, gravity along it, and angles from a gyroscope."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data.arrays import Array, Unchanged, median_step, root_mean_square, running_integral
from accelcal.data.recording import Channel
from accelcal.data.rig import STANDARD_GRAVITY

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

GRAVITY = "gravity_along_axis"
"""Side channel: what an ideal accelerometer on the axis reads while the position does not accelerate, m/s²."""
GRAVITY_NOISE = "gravity_noise"
"""Side channel: two-sided density of what noise of the attitude adds to gravity along the axis, (m/s²)²/Hz."""
LEVERS = ("lever_x", "lever_y", "lever_z")
"""Side channels: acceleration along the axis of a point 1 m from the tracked one, for each axis of the sensor, s⁻²."""
LEVELS = ("level_e", "level_n")
"""Side channels: gravity along the axis for each radian by which the plumb line leans east or north, m/s²."""
TURNED = ("turned_1", "turned_2")
"""Side channels: angles about two directions across the input axis, from a gyroscope, rad."""
OF_DIRECTION = ("across", *LEVERS, *LEVELS)
"""What is known of a direction of a tracked body: specific force along it, m/s², levers and levels of it."""
ACROSS = tuple(f"{name}_{number}" for number in (1, 2) for name in OF_DIRECTION)
"""Side channels: the same of two directions across the input axis."""
GYROSCOPE = ("gyr_x", "gyr_y", "gyr_z")
"""Side channels: angular rate about the axes of the sensor, right-handed, rad/s."""
RATES = ("rate_i", "rate_p")
"""Side channels: angular rate about the input and the pendulous axis of the sensor, rad/s."""
ANGULAR_ACCELERATION = "alpha_o"
"""Side channel: angular acceleration about the output axis, rad/s²."""
OUTPUTS = {"x": "accel_x", "y": "accel_y", "z": "accel_z"}
"""Channel of each axis of a sensor with three outputs."""
PLACE = ("position_e", "position_n", "position_u")
"""Channels: place to the east, to the north and up, m."""
QUATERNION = ("q_w", "q_x", "q_y", "q_z")
"""Columns of an attitude, in this order."""
ANGLE = "angle"
"""Channel: angle of an arm about its axle, rad; at 0 the arm is level, and it rises as the angle grows."""
TILTS = ("axle_tilt_sin", "axle_tilt_cos")
"""Side channels: gravity along the axis of a sensor on an arm for each radian by which the axle leans, m/s²."""
ECCENTRICITY = ("eccentricity_sin", "eccentricity_cos")
"""Side channels: acceleration along the axis for each radian of an error of the angle once per turn, m/s²."""
WOBBLE = ("wobble_sin", "wobble_cos")
"""Side channels: acceleration along the axis for each radian by which the axle cones against the turn, m/s²."""
BENDING = "arm_bending"
"""Side channel: acceleration along the axis of an arm that lengthens by itself times the rate squared, m/s⁴."""
ARM_ANGLE = "arm_angle"
"""Side channel: the angle as the encoder reads it, without the jumps of its range, rad."""
OF_ARM = (*TILTS, *ECCENTRICITY, *WOBBLE, BENDING, ARM_ANGLE)
"""Side channels of a sensor on an arm alone."""
DERIVED = (GRAVITY, GRAVITY_NOISE, *LEVERS, *ACROSS, *LEVELS, *TURNED, *OF_ARM)
"""Side channels that are part of the model of a turning body, and no effects by themselves."""
HOLE = 8.0
"""Spacing beyond this many usual ones that is a hole: across it the path of a turning body is unknown; behind it the
replay restarts."""
KNOT_READINGS = 8
"""Readings from one knot to the next of the spline that divides motion between path and gravity; the sum of both does
not depend on it."""
QUATERNION_TOLERANCE = 0.02
"""Difference of a quaternion's norm from 1 that rounding of its columns explains."""

SCATTER_ORDER = 8
"""Order of the differences of an attitude that its noise is taken from: motion leaves less in each higher one."""

Sense = Literal["sensor to ENU", "ENU to sensor"]


@dataclass(frozen=True, slots=True)
class Turning:
    """What place and attitude of a body say of one axis of it."""

    path: Channel
    """Place along the mean direction of the axis, but for what changes within a few readings; n readings, m."""
    gravity: Channel
    """What the acceleration along the turning axis, gravity included, exceeds that of the path by, m/s²."""
    levers: tuple[Channel, Channel, Channel]
    further: tuple[Channel, ...] = ()
    """What errors of the mounting and of the reference do along the axis."""
    force: Array | None = None
    """Specific force along the axis of a tracked body, (n,) m/s²; None on an arm."""

    @property
    def side(self) -> dict[str, Channel]:
        """The side channels, by name."""
        return {channel.name: channel for channel in (self.gravity, *self.levers, *self.further)}


def rotated(q: Array, v: Array, sense: Sense) -> Array:
    """Directions v, given in axes of the sensor, in ENU.

    Parameters
    ----------
    q : (n, 4) unit quaternions w, x, y, z.
    v : (3,).
    sense : what the quaternion turns into what.

    Returns
    -------
    (n, 3)

    Examples
    --------
    >>> half = np.sqrt(0.5)  # a quarter turn about up takes the sensor's x to north
    >>> rotated(np.array([[half, 0.0, 0.0, half]]), np.array([1.0, 0.0, 0.0]), "sensor to ENU").round(9) + 0.0
    array([[0., 1., 0.]])
    """
    w, u = q[:, :1], q[:, 1:] if sense == "sensor to ENU" else -q[:, 1:]
    across = 2.0 * np.cross(u, v)
    return np.asarray(v + w * across + np.cross(u, across))


def attitude_scatter(q: Array) -> float:
    """Standard deviation of one reading of an attitude about each axis, by differences of high order, rad.

    That of a filtered attitude, and of one with readings that repeat, comes out too small.

    Parameters
    ----------
    q : (n, 4) unit quaternions w, x, y, z.
    """
    return scatter(np.column_stack([rotated(q, v, "sensor to ENU") for v in np.eye(3)])) / math.sqrt(2.0)


def scatter(y: Array) -> float:
    """Standard deviation of one reading of a series of numbers (n, 1), or of vectors in each of three directions."""
    differences = np.diff(y, SCATTER_ORDER, axis=0)
    usual = float(np.median(np.sum(differences**2, axis=1))) if len(differences) else 0.0
    median = float(scipy.special.chdtri(min(y.shape[1], 3), 0.5))
    return math.sqrt(usual / (math.comb(2 * SCATTER_ORDER, SCATTER_ORDER) * median))


def turning(
    t: Array,
    place: Array,
    attitude: tuple[Array, Array],
    axis: Array,
    sense: Sense,
    noise: Array | float = 0.0,
    unchanged: Unchanged | None = None,
    g: float = STANDARD_GRAVITY,
) -> Turning:
    """Path and gravity along an axis of a body that turns (derivations 7.9).

    Parameters
    ----------
    t : (n,) s, times of the places.
    place : (n, 3) m, east, north, up.
    attitude : times (m,) s and unit quaternions (m, 4).
    axis : (3,) input axis in axes of the sensor, of length 1.
    sense : what the quaternions turn into what.
    noise : density of the noise of the attitude about each axis, two-sided, of all or of each of its readings, rad²/Hz.
    unchanged : of another axis of the same body, whose motion it holds.
    g : local gravity, m/s².
    """
    stamps, q = attitude
    body = (unchanged or Unchanged())("body", (t, place, stamps, q, sense), lambda: moving(t, place, attitude, sense))
    mean, grid = body.mean.T @ axis, body.grid
    path, apart = np.zeros(len(t)), []
    for rows, at_place, inside in body.stretches:
        turned_path = path_along(t[rows], place[rows], at_place @ np.kron(axis, np.eye(3)).T)
        between = place[rows] @ (mean / np.linalg.norm(mean)) - turned_path
        spline = smooth_spline(t[rows], between, KNOT_READINGS)
        path[rows] = turned_path + spline(t[rows])
        apart.append(spline(grid[inside], 2))
    within_body = (axis, *perpendicular(axis))
    directions = [body.axes @ np.kron(v, np.eye(3)).T for v in within_body]
    gravity, second = g * directions[0][:, 2] - np.concatenate(apart), body.second.copy()
    second[:, 0, 2] += g
    columns = []
    for v, direction in zip(within_body, directions, strict=True):
        force, *levers = np.einsum("nk,njk->jn", direction, second)
        shown = out_of_noise(np.array(levers), np.einsum("iajb,a,b->ij", body.noise, v, v))
        columns += [force, *shown, *(g * direction[:, :2].T)]
    names = (*OF_DIRECTION, *ACROSS)
    units = ("m/s^2", *("rad/s^2" for _ in LEVERS), *("m/s^2" for _ in LEVELS))
    _, x, y, z, *further = (
        Channel(name, grid, column, unit) for name, column, unit in zip(names, columns, 3 * units, strict=True)
    )
    path_along_mean, pull = Channel("position", t, path, "m"), Channel(GRAVITY, grid, gravity, "m/s^2")
    density = np.interp(grid, stamps, np.broadcast_to(noise, stamps.shape))
    density *= g**2 * np.maximum(0.0, 1.0 - directions[0][:, 2] ** 2)
    of_noise = Channel(GRAVITY_NOISE, grid, density, "m^2/s^4/Hz")
    force = np.interp(t, grid, columns[0])
    return Turning(path_along_mean, pull, (x, y, z), (*further, of_noise), force)


@dataclass(frozen=True, slots=True)
class Moving:
    """Motion of a tracked body, whatever the axis: on a grid as fine as the finer of place and attitude."""

    grid: Array
    """(k,) s, without what lies in holes of the places."""
    axes: Array
    """Axes of the sensor in ENU, (k, 9): x, y, z."""
    second: Array
    """Specific force and second derivatives of x, y and z, in ENU, (k, 4, 3)."""
    noise: Array
    """Mean `curvature_noise`, (3, 3, 3, 3) s⁻⁴."""
    mean: Array
    """Mean of the axes over all attitudes, (3, 3)."""
    stretches: list[tuple[slice, Array, slice]]
    """Without a hole: places, axes at them, and rows of the grid."""


def moving(t: Array, place: Array, attitude: tuple[Array, Array], sense: Sense) -> Moving:
    """The motion of a body; parameters are those of `turning`."""
    stamps, q = attitude
    grid = stamps[(t[0] <= stamps) & (stamps <= t[-1])]
    grid = grid if len(grid) > len(t) else t
    axes = np.column_stack([rotated(q, v, sense) for v in np.eye(3)])
    stretches, body, places, curvatures, count = [], [], [], [], 0
    of_noise = np.zeros((3, 3, 3, 3))
    for rows in unbroken(t):
        first, last = t[rows][[0, -1]]
        near = slice(max(0, int(np.searchsorted(stamps, first, "right")) - 1), int(np.searchsorted(stamps, last)) + 1)
        if rows.stop - rows.start < 2 or len(stamps[near]) < 2:  # of no use, like all readings beside which are none
            continue
        of_body = resolving_spline(stamps[near], axes[near])[0]
        inside = slice(int(np.searchsorted(grid, first)), int(np.searchsorted(grid, last, side="right")))
        at_grid, at_place = (
            axes[near] if np.array_equal(stamps[near], instants) else of_body(instants)
            for instants in (grid[inside], t[rows])
        )
        of_noise += (inside.stop - inside.start) * curvature_noise(of_body, stamps[near], axes[near])
        of_place = resolving_spline(t[rows], place[rows])[0]
        places.append(grid[inside])
        body.append(at_grid)
        curvatures.append(np.column_stack([series(grid[inside], 2) for series in (of_place, of_body)]))
        stretches.append((rows, at_place, slice(count, count + len(at_grid))))
        count += len(at_grid)
    second = np.concatenate(curvatures).reshape(-1, 4, 3)
    mean = np.mean(axes, axis=0).reshape(3, 3)
    return Moving(np.concatenate(places), np.concatenate(body), second, of_noise / max(1, count), mean, stretches)


TURNED_BEYOND_NOISE = 100.0
"""Power of a lever over what noise of the attitude makes of it, below which it shows nothing of the lever arm. Gravity
has the same noise: that would pass for a lever arm of g over the square of its angular frequency, decimetres, over
this."""


def curvature_noise(spline: scipy.interpolate.BSpline, t: Array, axes: Array) -> Array:
    """Products of what noise of the attitude makes of the second derivatives of x, y and z by a spline, each along x,
    y and z, (3, 3, 3, 3) s⁻⁴.

    Parameters
    ----------
    spline : through the axes.
    t : (n,) s.
    axes : (n, 9), x, y and z in ENU; their eighth differences are those of white noise.
    """
    if len(t) <= 8:
        return np.zeros((3, 3, 3, 3))
    rest, along = np.diff(axes, n=8, axis=0).reshape(-1, 3, 3), axes[4:-4].reshape(-1, 3, 3)
    rest = np.einsum("nik,nak->nia", rest, along)
    white = np.random.default_rng(0).standard_normal(len(t))
    of_white = scipy.interpolate.make_lsq_spline(t, white, spline.t, k=spline.k, method="norm-eq")(t, 2)
    of_one = float(np.mean(of_white**2)) / (math.comb(16, 8) * len(rest))
    return np.asarray(np.einsum("nia,njb->iajb", rest, rest, optimize=True) * of_one)


def out_of_noise(levers: Array, noise: Array) -> Array:
    """Levers of a direction, (3, k), without those along which noise of the attitude feigns the turning.

    Parameters
    ----------
    levers : (3, k) s⁻².
    noise : mean products of what noise makes of them, (3, 3) s⁻⁴.
    """
    power = levers @ levers.T / max(1, levers.shape[1])
    noise = noise + ROUNDING * max(float(np.trace(power)), 1.0) * np.eye(3)

    def hidden(v: Array) -> NDArray[np.bool_]:
        return np.asarray(np.sum(v * (power @ v), axis=0) < TURNED_BEYOND_NOISE * np.sum(v * (noise @ v), axis=0))

    still = scipy.linalg.eigh(power, noise)[1]
    still = still[:, hidden(still)]
    if still.shape[1] == 0:
        return levers
    # Noise also leans the direction: through a lever arm that is open a small part of it would widen the others.
    parts = np.abs(still) * np.sqrt(np.diag(noise))[:, None]
    upright = np.where(parts < LEAST_COMPONENT * np.max(parts, axis=0), 0.0, still)
    still = np.where(hidden(upright), upright, still)
    return levers - noise @ still @ np.linalg.solve(still.T @ noise @ still, still.T @ levers)


LEAST_COMPONENT = 0.1
"""Part of the noise along a direction below which a component of it is left out, where noise hides the rest as well."""
ROUNDING = 1e-15
"""Share of the power of levers that is taken for rounding."""
SPAN = 1.0
"""Time over which the turning of a gyroscope is compared with that of a reference, s."""
SOLUTIONS = 5
"""Solutions for bias, matrix and delay of a gyroscope, each from the turning by the one before."""
USUAL_GYROSCOPE = np.array([0.1, *(9 * [0.3]), *(3 * [1.0])])
"""Standard deviations of its delay, s, of the elements of its matrix, and of its bias, rad/s, before it is read."""


@dataclass(frozen=True, slots=True)
class Strapdown:
    """An attitude that a gyroscope carries from one reading of a reference to the next."""

    t: Array
    """Of the samples of the gyroscope on the clock of the reference, which reaches beyond both ends, (n,) s."""
    attitude: Rotation
    """Sensor to ENU, n."""
    bias: Array
    """Of the gyroscope, (3,) rad/s."""
    matrix: Array
    """What its readings less the bias are multiplied by, (3, 3)."""
    delay: float
    """By which the gyroscope is behind the reference, s."""
    noise: Array
    """Density of the noise of the attitude about each axis, two-sided, (n,) rad²/Hz."""
    disagreement: float
    """Of the turning over a second from that of the reference, over what noise of both explains, rms."""


def carried(reference: tuple[Array, Rotation], gyroscope: tuple[Array, Array], noise: float) -> Strapdown:
    """The attitude at the samples of a gyroscope, which a reference holds (derivations 7.9).

    Bias, matrix and delay of the gyroscope are those with which it turns over a second as the reference does. What is
    left of their difference walks at random: its smoothed path, straight across holes of the reference, corrects it.

    Parameters
    ----------
    reference : times (m,) s and attitudes, sensor to ENU.
    gyroscope : times (n,) s and rates (n, 3), rad/s, without a hole, with some seconds of the reference in reach.
    noise : standard deviation of one reading of the reference about each axis, rad.
    """
    t, rates = gyroscope
    within_reach = (t[0] <= reference[0]) & (reference[0] <= t[-1])
    stamps, attitude = reference[0][within_reach], reference[1][within_reach]
    step, rotation = median_step(stamps), scipy.spatial.transform.Rotation  # loaded for this alone
    span = min(len(stamps) - 1, max(1, round(SPAN / step)))
    h, bias, matrix, delay = np.diff(t)[:, None], np.zeros(3), np.eye(3), 0.0
    for _ in range(SOLUTIONS):
        late = stamps + delay
        begins = np.clip(np.searchsorted(t, late, side="right") - 1, 0, len(t) - 2)
        share = ((late - t[begins]) / h[begins, 0])[:, None]
        turns = (rates - bias) @ matrix.T
        steps = 0.5 * h * (turns[1:] + turns[:-1])
        strapdown = products(rotation.from_rotvec(steps))
        turned_by = strapdown[begins] * rotation.from_rotvec(share * steps[begins])
        turn = turned_by[:-span].inv() * turned_by[span:]
        rate_at = turns[begins] + share * np.diff(turns, axis=0)[begins]
        apart = ((attitude[:-span].inv() * attitude[span:]).inv() * turn).as_rotvec()
        walk = scatter(turns) ** 2 * float(np.median(h))
        expected = math.sqrt(2.0 * noise**2 + walk * span * step)
        columns = [(rate_at[span:] - turn.inv().apply(rate_at[:-span])).ravel()]
        for rate in (*(rates - bias).T, np.ones(len(t))):
            for axis in np.eye(3):
                total = running_integral(strapdown.apply(rate[:, None] * axis), h)
                over = total[begins] + share * np.diff(total, axis=0)[begins]
                columns.append(turned_by[span:].inv().apply(over[span:] - over[:-span]).ravel())
        usual = max(expected, TINY_TURN) / USUAL_GYROSCOPE
        from_usual = usual * np.concatenate([[-delay], (np.eye(3) - matrix.T).ravel(), matrix @ bias])
        X, y = np.vstack([np.column_stack(columns), np.diag(usual)]), np.concatenate([-apart.ravel(), from_usual])
        later, *of_rates = np.linalg.lstsq(X, y, rcond=None)[0]
        change, delay = np.reshape(of_rates, (4, 3)), delay + float(later)
        matrix = matrix + change[:3].T
        bias = bias - np.linalg.solve(matrix, change[3])
    drift = attitude * turned_by.inv()
    middle = drift[len(drift) // 2]
    away, white = (drift * middle.inv()).as_rotvec(), noise**2 * step
    walk += 1e-3 * white / SPAN**2
    at_stamps, instants = smoothed_random_process(stamps, away, noise**2 / walk if noise > 0.0 else 0.0), t - delay
    correction = np.column_stack([np.interp(instants, stamps, series) for series in at_stamps.T])
    covered = (stamps[0] <= instants) & (instants <= stamps[-1])
    between = np.diff(stamps)[np.clip(np.searchsorted(stamps, instants) - 1, 0, len(stamps) - 2)]
    density = white + walk * between**2 / 12.0  # held at both ends, a walk over T gains T^3/12 in the integral
    attitude = (rotation.from_rotvec(correction) * middle * strapdown)[covered]
    disagreement = root_mean_square(apart) / max(expected, TINY_TURN)
    return Strapdown(instants[covered], attitude, bias, matrix, delay, density[covered], disagreement)


def smoothed_random_process(t: Array, y: Array, ratio: float) -> Array:
    """Return the smoothed path of random walks whose readings are noisy: that of a Kalman smoother, (n, k).

    Parameters
    ----------
    t : (n,) s, rising.
    y : (n, k) readings.
    ratio : variance of a reading over what the walk gains per second, s.
    """
    steps = ratio / np.diff(t)
    bands = np.zeros((2, len(t)))
    bands[0, 1:] = -steps
    bands[1] = 1.0 + np.pad(steps, (0, 1)) + np.pad(steps, (1, 0))
    return np.asarray(scipy.linalg.solveh_banded(bands, y))


TINY_TURN = 1e-3
"""Turn over a second that clocks and the axes of a gyroscope explain whatever the noise, rad."""


def products(steps: Rotation) -> Rotation:
    """Products of rotations from the left end up to each, one more than there are, the first by no angle."""
    rotation, count = scipy.spatial.transform.Rotation, len(steps)
    if count <= FEW_STEPS:
        total = [rotation.identity()]
        for step in steps:
            total.append(total[-1] * step)
        return rotation.concatenate(total)
    width = math.isqrt(count)  # in blocks of so many, all blocks at once
    blocks = -(-count // width)
    q = np.vstack([steps.as_quat(), np.tile([0.0, 0.0, 0.0, 1.0], (blocks * width - count, 1))])
    within_block = [rotation.from_quat(q[::width])]
    for k in range(1, width):
        within_block.append(within_block[-1] * rotation.from_quat(q[k::width]))
    starts = products(within_block[-1])[:blocks]
    whole = np.stack([(starts * block).as_quat() for block in within_block], axis=1).reshape(-1, 4)
    return rotation.from_quat(np.vstack([[0.0, 0.0, 0.0, 1.0], whole[:count]]))


FEW_STEPS = 32
"""Rotations that are multiplied one by one."""


def perpendicular(axis: Array) -> tuple[Array, Array]:
    """Two directions across an axis, (3,) each, with which it is a right-handed triad: y and z of x, z and x of y.

    Examples
    --------
    >>> [direction.tolist() for direction in perpendicular(np.array([1.0, 0.0, 0.0]))]
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    first = np.roll(np.eye(3)[int(np.argmax(np.abs(axis)))], 1)
    first = first - (first @ axis) * axis
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first) + 0.0


def on_arm(t: Array, angle: Array, arm: float, axle: float, axis: Array) -> Turning:
    """Path and gravity along an axis of a sensor on an arm that turns about a fixed axle (derivations 7.9).

    Parameters
    ----------
    t : (n,) s.
    angle : (n,) rad, 0 where the arm is level, growing as it rises; unwrapped.
    arm : distance from the axle to the sensor, m.
    axle : elevation of the axle, rad: 0 is horizontal.
    axis : (3,) input axis, of length 1: outward along the arm, in the direction in which the angle grows, along the
        axle.
    """
    outward, forward, along = axis
    level, g = np.cos(axle), STANDARD_GRAVITY
    path, gravity = np.zeros((2, len(t)))
    columns = np.zeros((len(LEVERS) + len(OF_ARM), len(t)))
    for rows in unbroken(t):
        at = t[rows]
        if len(at) < 2:
            continue
        spline, rest = resolving_spline(at, angle[rows])
        theta, rate, alpha, jerk = (np.asarray(spline(at, n)) for n in range(4))
        sine, cosine = np.sin(theta), np.cos(theta)
        pull = level * g * (outward * sine + forward * cosine) - outward * arm * rate**2
        knots = max(KNOT_READINGS, int(len(at) * PATH_KNOTS / max(np.ptp(at), PATH_KNOTS)))
        quick = without_ends(at, pull - smooth_spline(at, pull, knots)(at))
        pulled = scipy.interpolate.CubicSpline(at, quick).antiderivative(2)(at)
        swept = running_integral(rate, np.diff(rest))
        slipped = -2.0 * outward * arm * scipy.integrate.cumulative_trapezoid(swept, at, initial=0.0)
        path[rows] = forward * arm * angle[rows] + pulled + slipped
        gravity[rows] = pull - quick + g * along * np.sin(axle)
        turn = [
            (sine, cosine * rate, cosine * alpha - sine * rate**2),
            (cosine, -sine * rate, -sine * alpha - cosine * rate**2),
        ]
        twice, once = np.sin(2.0 * theta), np.cos(2.0 * theta)
        cones = [(twice, once, cosine), (once, -twice, -sine)]
        stretch, stretched = 2.0 * rate * alpha, 2.0 * (alpha**2 + rate * jerk)
        columns[:, rows] = [
            forward * alpha - outward * rate**2,
            -outward * alpha - forward * rate**2,
            np.zeros_like(at),
            g * (outward * sine + forward * cosine),
            g * (outward * cosine - forward * sine),
            *(
                outward * (-2.0 * arm * rate * first + g * level * cosine * error)
                + forward * (arm * second - g * level * sine * error)
                for error, first, second in turn
            ),
            *(
                g * np.sin(axle) * (outward * out + forward * ahead)
                + along * (arm * (alpha * ahead - 3.0 * rate**2 * out) - g * level * lean)
                for out, ahead, lean in cones
            ),
            arm * (outward * (stretched - rate**4) + forward * (alpha * rate**2 + 2.0 * stretch * rate)),
            angle[rows],
        ]
    units = dict.fromkeys(LEVERS, "rad/s^2") | dict.fromkeys(OF_ARM, "m/s^2") | {BENDING: "m/s^4", ARM_ANGLE: "rad"}
    x, y, z, *further = (Channel(name, t, y, unit) for (name, unit), y in zip(units.items(), columns, strict=True))
    return Turning(Channel("position", t, path, "m"), Channel(GRAVITY, t, gravity, "m/s^2"), (x, y, z), tuple(further))


FASTEST_TURN = 0.35
"""Turns from one reading to the next beyond which it is not sure in which direction an arm turned."""
HALF_TURN = 0.5
"""Turns between two readings beyond which the reading jumped."""
ISOLATED = 0.01
"""Share of the readings of an angle that may be wrong, each alone between right ones."""


@dataclass(frozen=True, slots=True)
class Unwrapped:
    """An angle without the jumps of its readings at the end of their range."""

    angle: Array
    """(n,) rad, of the readings that are valid."""
    valid: NDArray[np.bool_]
    """(m,) False for isolated readings that jump by more than half a turn and back."""
    modulus: float
    """What the reading jumps by, rad; a turn where it never does, NaN where its jumps agree on nothing."""
    jumps: NDArray[np.intp]
    """Indices, among the valid readings, of those that nothing of this explains."""


def unwrapped(t: Array, read: Array, step: float = 0.0) -> Unwrapped:
    """The angle behind readings that jump at a whole turn, or where their counter runs over.

    Parameters
    ----------
    t : (m,) s. Jumps are judged within stretches without a hole.
    read : (m,) rad.
    step : one count, rad; 0 = not counted.
    """
    turns, inside = read / (2.0 * np.pi), within(t)
    modulus = jumps_by(turns, inside, step / (2.0 * np.pi))

    def wrong(d: Array) -> NDArray[np.bool_]:
        return (np.abs(d) > HALF_TURN) & ~(np.abs(np.abs(d) - modulus) <= FASTEST_TURN)

    bad = wrong(np.diff(turns)) & inside
    count = np.pad(bad, (1, 0)).astype(int) + np.pad(bad, (0, 1))  # bad steps on both sides
    bridges = np.pad(~wrong(turns[2:] - turns[:-2]), 1)
    if len(bad) > 1:
        bridges[[0, -1]] = ~bad[[1, -2]]
    valid = np.ones(len(t), dtype=np.bool_)
    for most in (2, 1):
        for k in np.flatnonzero((count == most) & bridges):
            valid[k] = not np.all(valid[max(0, k - 1) : k + 2])
    if np.count_nonzero(~valid) > max(1.0, ISOLATED * len(t)):
        valid[:] = True
    turns, inside = turns[valid], within(t[valid])
    d = np.diff(turns)
    wraps = np.where((np.abs(d) > HALF_TURN) & (np.abs(np.abs(d) - modulus) < 0.5 * modulus), -np.sign(d), 0.0)
    bad = wrong(d) & inside
    bad[1:] |= (wraps[1:] * wraps[:-1] > 0.0) & inside[1:] & inside[:-1]  # none turns that fast
    angle = turns + np.concatenate([[0.0], np.cumsum(wraps)]) * (modulus if np.isfinite(modulus) else 0.0)
    return Unwrapped(2.0 * np.pi * angle, valid, 2.0 * np.pi * modulus, np.flatnonzero(bad) + 1)


def jumps_by(turns: Array, inside: NDArray[np.bool_], step: float) -> float:
    """What the readings of an angle jump by, turns: 1, or the range of a counter that runs over; NaN if neither.

    The range is the median jump plus the motion meanwhile, which a cubic through the steps on either side gives; a
    counter's is a whole number of counts.

    Parameters
    ----------
    turns : (m,)
    inside : (m - 1,) whether no hole is between two readings.
    step : one count, turns; 0 = not counted.
    """
    d = np.diff(turns)
    large = (np.abs(d) > HALF_TURN) & inside
    spikes = large[1:] & large[:-1] & (d[1:] * d[:-1] < 0.0)
    alone = np.concatenate([[True], ~spikes, [True]])
    steady = np.where(large | ~inside, np.nan, d)
    padded = np.pad(steady, 2, constant_values=np.nan)
    near, far = (np.array([np.roll(padded, k)[2:-2] for k in (-n, n)]) for n in (1, 2))
    cubic = np.sum(4.0 * near - far, axis=0) / 6.0
    one_sided = np.nan_to_num(near).sum(axis=0) / np.maximum(1, np.isfinite(near).sum(axis=0))
    meanwhile = np.where(np.isfinite(cubic), cubic, one_sided)
    large &= alone[1:] & alone[:-1]
    if not large.any():
        return 1.0
    modulus = float(np.median(np.abs(d[large]) - np.sign(d[large]) * meanwhile[large]))
    span, fastest = float(np.ptp(turns[alone])), float(np.nanmax(np.abs(steady), initial=0.0))
    if abs(modulus - 1.0) <= (0.001 if span > 1.001 else 0.02 + 0.1 * fastest):
        return 1.0
    if abs(modulus - span) > 0.001 + 2.0 * fastest:
        return np.nan
    return round(modulus / step) * step if step else modulus


def within(t: Array) -> NDArray[np.bool_]:
    """Whether no hole lies between each time and the next, (n - 1,)."""
    inside = np.ones(max(0, len(t) - 1), dtype=np.bool_)
    inside[[k - 1 for k in holes(t)]] = False
    return inside


LEAP = 0.05
"""Step from one reading to the next up to which an orientation may simply move, rad."""


def leaps(t: Array, steps: Array) -> NDArray[np.intp]:
    """Indices of the readings behind a step, in either sense, that is far beyond those two before and behind it.

    What moves speeds up before it is fast; where one reading is wrong, two steps in a row are.

    Parameters
    ----------
    t : (n,) s, rising; n at least 2. Steps across a hole are none.
    steps : (n - 1,) rad.
    """
    size = np.where(within(t), np.abs(steps) / np.diff(t), 0.0) * median_step(t)
    beside = np.pad(size, 2)
    noise = 12.0 * float(np.median(np.abs(np.diff(size, prepend=0.0))))
    count = 3.0 * float(np.min(size, where=size > 0.0, initial=np.inf)) if np.count_nonzero(size) > 2 else 0.0
    return np.flatnonzero(size > LEAP + noise + count + 4.0 * np.maximum(beside[:-4], beside[4:])) + 1


TURNS_THAT_TELL = {
    "scale_factor": "turn the arm about a level axle, where gravity along it is known",
    "bias": "turn farther, at best whole turns, and at several rates, or declare [uncertainty] level",
    "time_offset": "change the rate while you record",
    "quadratic": "turn the arm about a level axle",
}
"""Coefficients that an arm is for, and the motion that determines each."""
TIED = 1e-3
"""Share of the power of a column that the others leave, below which the record does not tell it from them."""
LEAST_CHANGE = 1e-9
"""Root mean square of a column below which the axis reads a constant; that of the largest acceleration is above 1."""


def ties_of_arm(motion: Turning, arm: float, axle: float) -> list[tuple[str, str]]:
    """Coefficients that the motion of an arm leaves open, each with a sentence: what it is one with, and what to do.

    Parameters
    ----------
    motion : what the angle says of the axis.
    arm : m.
    axle : elevation of the axle, rad.
    """
    side = {name: channel.y for name, channel in motion.side.items()}
    a = arm * side[LEVERS[0]] + np.cos(axle) * side[TILTS[0]]
    columns = {
        **{"bias": np.ones_like(a), "scale_factor": a, "time_offset": np.gradient(a, motion.path.t), "quadratic": a**2},
        **{
            "the length of the arm": side[LEVERS[0]],
            "the tilt of the axle": side[TILTS[0]],
            "the angle zero": side[TILTS[1]],
        },
        **{"the distance across the arm": side[LEVERS[1]], BENDING: side[BENDING]},
    }
    if np.cos(axle) > np.cos(LEVEL_AXLE):
        columns.pop("the tilt of the axle")
    sizes = {name: float(np.linalg.norm(y)) for name, y in columns.items()}
    least = LEAST_CHANGE * np.sqrt(len(a))
    columns = {name: y / sizes[name] for name, y in columns.items() if sizes[name] > least}

    def left(name: str, others: Sequence[str]) -> float:
        if not others:
            return 1.0
        matrix = np.column_stack([columns[other] for other in others])
        return float(np.sum((columns[name] - matrix @ np.linalg.lstsq(matrix, columns[name], rcond=None)[0]) ** 2))

    listed = []
    for name, remedy in TURNS_THAT_TELL.items():
        others = [n for n in columns if n not in (name, "quadratic") and (n != BENDING or name == "quadratic")]
        if name not in columns:
            text = f"the axis reads a constant however the arm turns, so it shows nothing of {name}"
            listed.append((name, f"{text}; point it across the axle, radial or tangential, and the axle level"))
        elif left(name, others) < TIED:
            without = {n: left(name, [other for other in others if other != n]) for n in others}
            other = max(without, key=without.__getitem__).replace("_", " ")
            listed.append((name, f"this turning does not tell {name} from {other}; {remedy}"))
    return listed


MOTIONS_THAT_TELL = {
    "bias": (0.05, "m/s^2", "point each axis up and down"),
    "scale_factor": (0.01, "1", "point each axis up and down, or move faster"),
    "time_offset": (1e-3, "s", "turn or move faster"),
    **{f"lever_arm.{axis}": (0.01, "m", f"turn faster, about an axis across {axis}") for axis in "xyz"},
    "the direction of the axis": (0.01, "rad", "turn about two axes, by a right angle or more"),
    "the tilt of the reference": (0.01, "rad", "turn by half a turn about the vertical"),
}
"""What a tracked body is turned for: a usual size of each, its unit, and the motion that determines it."""
USUAL_DENSITY = 200e-6 * STANDARD_GRAVITY
"""Noise density of a sensor whose noise is not declared, (m/s²)/sqrt(Hz)."""


def left_open(motion: Turning, density: float | None, *, triad: bool) -> list[tuple[str, str]]:
    """Coefficients that the turning of a body leaves more uncertain than they usually are, each with a sentence: its
    standard uncertainty by the noise of the output alone, and what to do.

    Parameters
    ----------
    motion : what place and attitude say of the axis, with its force.
    density : of the noise of the output, (m/s²)/sqrt(Hz); None = not declared.
    triad : whether the direction of the axis and the tilt of the reference are estimated as well.
    """
    t, side = motion.path.t, {name: np.interp(motion.path.t, c.t, c.y) for name, c in motion.side.items()}
    stretches = [rows for rows in unbroken(t) if rows.stop - rows.start > 1]
    inside = np.concatenate([np.arange(len(t))[rows] for rows in stretches])
    side = {name: y[inside] for name, y in side.items()}
    assert motion.force is not None
    a = motion.force[inside]
    jerk = np.concatenate([np.gradient(a[at], t[inside][at]) for at in unbroken(t[inside])])
    columns = {"bias": [np.ones_like(a)], "scale_factor": [a], "time_offset": [jerk]}
    columns |= {name.replace("lever_", "lever_arm."): [side[name]] for name in LEVERS}
    if triad:
        columns["the direction of the axis"] = [side[f"across_{k}"] for k in (1, 2)]
        columns["the tilt of the reference"] = [side[name] for name in LEVELS]
    names = [name for name, several in columns.items() for _ in several]
    size = np.array([MOTIONS_THAT_TELL[name][0] for name in names])
    X = np.column_stack([column for several in columns.values() for column in several]) * size
    white = 0.5 * (density or USUAL_DENSITY) ** 2 / median_step(t)
    std = size * np.sqrt(np.diag(np.linalg.inv(X.T @ X / white + FAINT * np.eye(len(size)))))
    listed = []
    for name, (usual, unit, remedy) in MOTIONS_THAT_TELL.items():
        worst = max((float(s) for n, s in zip(names, std, strict=True) if n == name), default=0.0)
        if worst > usual:
            listed.append(
                (name, f"this turning leaves {name} uncertain by {min(worst, usual / FAINT**0.5):.2g} {unit}; {remedy}")
            )
    return listed


FAINT = 1e-4
"""Information of a hundred times the usual size, in inverse squares of it."""
LEVEL_AXLE = 0.02
"""Elevation below which gravity across an axle hardly depends on it, rad."""
PATH_KNOTS = 3.0
"""Spacing of the knots of the spline that keeps what is slow of the pull of a turning arm out of the path, s."""
ENDS = 4.0
"""Time next to either end of a stretch over which a steady pull is kept out of the path, s."""


def without_ends(t: Array, y: Array) -> Array:
    """A series without the straight lines through its ends, (n,), which fade out away from them.

    Next to an end no position tells an acceleration: what is steady there would seem to be a jerk.
    """
    left, width = y.copy(), min(ENDS, 0.3 * float(np.ptp(t)))
    for distance in (t - t[0], t[-1] - t):
        near = distance <= width
        if np.count_nonzero(near) > 2:
            far = distance[near] / width
            line = np.polynomial.Polynomial.fit(t[near], y[near], 1)(t[near])
            left[near] -= (1.0 - far**3 * (10.0 - 15.0 * far + 6.0 * far**2)) * line
    return left


def path_along(t: Array, r: Array, e: Array) -> Array:
    """The path s with s'' = e . r'', from 0 at rest at the first time on, (n,).

    Each change of velocity is projected on the axis at its instant, and the projections are summed up twice. Summed by
    parts this is e . r less terms in e' and e'': white noise of r stays white noise of the same size, and what it adds
    at low frequencies is smaller than itself by the turning of e between samples.

    Parameters
    ----------
    t : (n,) s, rising.
    r : (n, 3) place.
    e : (n, 3) direction of the axis.
    """
    h = np.diff(t)
    v = np.diff(r, axis=0) / h[:, None]
    along = np.concatenate([[e[0] @ v[0]], np.einsum("ki,ki->k", e[1:-1], np.diff(v, axis=0))]) if len(h) else h
    return np.concatenate([[0.0], np.cumsum(h * np.cumsum(along))])


def smooth_spline(t: Array, y: Array, readings: int) -> scipy.interpolate.BSpline:
    """A spline of degree 5 through a series of (n,) with a knot at every so many readings; a lower one where few are.

    Parameters
    ----------
    t : (n,) rising; at least 2.
    readings : from one knot to the next.
    """
    degree = min(5, len(t) - 1)
    inner = t[readings : len(t) - readings : readings] if len(t) > 3 * readings else t[:0]
    knots = np.concatenate([np.full(degree + 1, t[0]), inner, np.full(degree + 1, t[-1])])
    return scipy.interpolate.make_lsq_spline(t, y, knots, k=degree, method="norm-eq")  # in linear time


SPACINGS = (4, 6, 8, 12, 16, 24, 32, 48, 64)
"""Readings from knot to knot of the splines that are tried; the widest whose rest is no larger is taken."""


def resolving_spline(t: Array, y: Array) -> tuple[scipy.interpolate.BSpline, Array]:
    """The smoothest spline that holds the motion of a series, and what it leaves of the motion, (n,) or (n, m).

    A wider spacing of the knots is taken as long as the variance of the rest stays within four standard deviations of
    that of the narrowest. Then the rest is noise, and 0 is returned in its place; of motion that even the narrowest
    does not resolve, the rest itself.

    Parameters
    ----------
    t : (n,) rising; at least 2.
    y : (n,) or (n, m), m of one scale.
    """
    best = smooth_spline(t, y, SPACINGS[0])
    motion = y - best(t)
    least = float(np.sum(motion**2)) / max(1, len(t) - len(best.c))
    for readings in SPACINGS[1:]:
        spline = smooth_spline(t, y, readings)
        rest = y - spline(t)
        if float(np.sum(rest**2)) > (1.0 + 4.0 * np.sqrt(2.0 / y.size)) * least * max(1, len(t) - len(spline.c)):
            break
        best, motion = spline, np.zeros_like(y)
    return best, motion


def unbroken(t: Array) -> list[slice]:
    """Stretches of times without a hole."""
    return [slice(a, b) for a, b in pairwise([0, *holes(t), len(t)])]


def holes(t: Array) -> list[int]:
    """Indices of the times that end a hole."""
    spacing = np.diff(t)
    return [] if len(spacing) < 2 else [int(k) + 1 for k in np.flatnonzero(spacing > HOLE * np.median(spacing))]


def turned(t: Array, rates: Array, axis: Array) -> tuple[Channel, Channel]:
    """Angles about the two directions across an axis, integrated from a gyroscope, (n,) rad each.

    Parameters
    ----------
    t : (n,) s.
    rates : (n, 3) rad/s about the axes of the sensor.
    axis : (3,) input axis, of length 1.
    """
    h = np.diff(t)
    first, second = (
        Channel(name, t, running_integral(rates @ direction, h), "rad")
        for name, direction in zip(TURNED, perpendicular(axis), strict=True)
    )
    return first, second
