"""Temperature, recorded or acting through the time since power-on, and rotation of the body."""

from __future__ import annotations

import numpy as np

from accelcal.data import (
    ACROSS,
    ANGULAR_ACCELERATION,
    BENDING,
    ECCENTRICITY,
    LEVELS,
    LEVERS,
    RATES,
    TILTS,
    TURNED,
    WOBBLE,
    Array,
)
from accelcal.effects.building_blocks import slow
from accelcal.effects.mechanisms import DRIVERS, POWER_ON, mechanism, product, state_of
from accelcal.effects.registry import Search, Shape, Static, Traits, effect, enter
from accelcal.signals.signals import Signals

enter(
    {
        "temperature_bias": product("bias", "temperature")
        | {
            "card": """Bias grows in proportion to temperature, from the model's own reference temperature.

    Equation: e = c1 T.
    Looks like: a residual that follows temperature, moving or at rest.
    Easily confused with: bias_drift and warm_up while temperature changes steadily; bias_random_walk.
    Separate by: a temperature cycle that is not monotone in time, at least 1 K wide.
    """,
            "symbol": "c1",
            "scale": 1e-3,
            "source": "typical 0.02 mg/K: IIS2ICLX; at most 0.2 mg/K: ADXL358; 0.5 mg/K: LIS3DH",
            "traits": Traits(common=True, static=Static(0, "c1 T", thermal=True)),
        },
        "temperature_scale": product("scale_factor", "temperature")
        | {
            "card": """Scale factor changes in proportion to temperature.

    Equation: e = kT T a.
    Looks like: a residual proportional to acceleration, its size following temperature.
    Easily confused with: scale_drift while temperature changes steadily.
    Separate by: a temperature ramp up and down while moving.
    """,
            "symbol": "kT",
            "scale": 1e-4,
            "source": "0.01 %/K: LIS3DH, IIS2ICLX; 0.02 %/K: ADXL358",
            "traits": Traits(common=True, static=Static(1, "kT T a", odd=True, thermal=True)),
        },
        "temperature_rate": product("bias", "temperature_rate")
        | {
            "card": """Bias from a temperature gradient across the sensor, in proportion to the rate of change.

    Equation: e = cg dT/dt, dT/dt taken over one second to either side.
    Looks like: a loop of the residual over temperature.
    Easily confused with: temperature_bias with a lag between case and element, warm_up.
    Separate by: ramps at two rates.
    """,
            "symbol": "cg",
            "scale": 1e-2,
            "source": "no published figure; 0.1 K/min then gives 0.002 mg",
            "search": Search(),
        },
        "warm_up": product("bias", POWER_ON)
        | {
            "card": """Bias that dies away after power-on, which is the model's origin of time.

    Equation: e = b exp(-t/tau), t >= 0.
    Looks like: a residual that moves fast at first and then settles.
    Easily confused with: bias_drift, temperature_bias, bias_random_walk, creep.
    Separate by: a record from cold and one after an hour of soak.
    """,
            "symbol": "b",
            "scale": 1e-2,
            "source": "no published figure; minutes after power-on",
            "traits": Traits(changes="bias"),
        },
    }
)


DRIFT_RATE = 1e-3
"""Drift of a gyroscope per unit of its coefficient, rad/s."""


@effect(
    "gyroscope_tilt",
    unit="m/s²/rad",
    owner="rig",
    symbol="g_t",
    scale=1.0,
    source="g0 where the axis turns about a level direction across it",
    needs=TURNED,
    parts=("1", "2", "drift"),
    traits=Traits(visible=False),
    search=Search(includes=("bias",)),
)
def gyroscope_tilt(s: Signals) -> Array:
    """Gravity along an axis whose turning a gyroscope records (derivations 7.9).

    A fit has it where a gyroscope and the input axis are declared. The direction of gravity across the axis is unknown
    and constant, so that the coefficients come out as its components: of g0 together on an axis that is nearly level.

    Equation: e = g_t.1 angle_1 + g_t.2 angle_2 + g_t.drift t rad/(1000 s), the angles integrated from the gyroscope
    about two directions across the axis; its bias makes them drift at a steady rate.
    Looks like: a slow residual that no motion along the axis explains, and a scale factor far from 1.
    Easily confused with: bias_drift, bias_random_walk, bias_gauss_markov.
    Separate by: an attitude from a reference; rests, where the angle returns.
    """
    return np.column_stack([*(s.side[name] for name in TURNED), DRIFT_RATE * s.t])


@effect(
    "lever_arm",
    unit="m",
    owner="mounting",
    symbol="r",
    scale=0.01,
    source="half the width of a tracked board",
    needs=LEVERS,
    parts=("x", "y", "z"),
    traits=Traits(visible=False),
)
def lever_arm(s: Signals) -> Array:
    """The sensor sits at a distance from the point whose position is tracked (derivations 7.9).

    A fit has it where place and attitude are recorded.

    Equation: e = (1 + k)(r_x l_x + r_y l_y + r_z l_z), l_j the acceleration along the input axis of a point 1 m from
    the tracked one along axis j of the sensor; r from the tracked point to the sensor, in its axes.
    Looks like: a residual where the body turns fast, at the frequency of the turning and at twice that.
    Easily confused with: time_offset and scale_factor where the body turns as it moves.
    Separate by: turning about each axis with the tracked point at rest; a ruler.
    """
    return s.scale * np.column_stack([s.side[name] for name in LEVERS])


@effect(
    "body_misalignment",
    unit="rad",
    owner="mounting",
    symbol="M",
    scale=0.01,
    source="an axis of a triad against its case, and the case against the markers on it, set by hand",
    needs=ACROSS,
    parts=("1", "2"),
    traits=Traits(visible=False),
)
def body_misalignment(s: Signals) -> Array:
    """The input axis points aside from where the attitude says (derivations 7.9).

    A fit of three outputs has it for each: the six elements of a sensor matrix beside its diagonal.

    Equation: e = M.1 f_1 + M.2 f_2, f the specific force at the sensor along two directions of the body across the
    input axis: y and z of x, z and x of y, x and y of z.
    Looks like: gravity that shows on an axis as the body turns about it.
    Easily confused with: bias where the body hardly turns; an error of the attitude.
    Separate by: turning about two axes, each face up once.
    """
    weights = [1.0, *(s.coefficients.get(f"{effect}.{part}", 0.0) for effect, parts in _AT_POINT for part in parts)]
    sides = np.split(np.stack([s.side[name] for name in ACROSS]), 2)
    return np.column_stack([np.tensordot(weights, side, axes=1) for side in sides])


_AT_POINT = (("lever_arm", ("x", "y", "z")), ("world_tilt", ("e", "n")))
"""What the force at the sensor differs from that at the tracked point by."""


@effect(
    "world_tilt",
    unit="rad",
    owner="rig",
    symbol="up",
    scale=3e-3,
    source="the plane that a camera system calls level, set by a wand on the floor",
    needs=LEVELS,
    parts=("e", "n"),
    traits=Traits(visible=False),
)
def world_tilt(s: Signals) -> Array:
    """The plumb line leans to the east and to the north of what the reference calls up (derivations 7.9).

    A fit of three outputs has it, one for all axes.

    Equation: e = (1 + k) g0 (up.e e_e + up.n e_n), e_e and e_n the components of the input axis to the east and north.
    Looks like: a bias that changes as the body turns about the vertical.
    Easily confused with: bias and misalignment where the body does not turn about the vertical.
    Separate by: turning about the vertical by half a turn.
    """
    return s.scale * np.column_stack([s.side[name] for name in LEVELS])


@effect(
    "axle_tilt",
    unit="rad",
    owner="rig",
    symbol="th",
    scale=1e-3,
    source="1 mm over 1 m by a spirit level",
    needs=TILTS,
    parts=("sin", "cos"),
    traits=Traits(visible=False),
)
def axle_tilt(s: Signals) -> Array:
    """The axle of an arm leans, or the arm is level at another reading of the angle (derivations 7.9).

    A fit has it where an angle is the reference: about a horizontal axle the cosine alone, which is the error of the
    angle zero.

    Equation: e = (1 + k) g0 (th.sin (i_r sin angle + i_t cos angle) + th.cos (i_r cos angle - i_t sin angle)), i_r and
    i_t the components of the input axis outward along the arm and in the direction in which the angle grows.
    Looks like: a wave once per turn of one size at all speeds.
    Easily confused with: bias where the arm hardly turns; scale_factor about a horizontal axle.
    Separate by: whole turns at several speeds; a level on the axle.
    """
    return s.scale * np.column_stack([s.side[name] for name in TILTS])


@effect(
    "angle_eccentricity",
    unit="rad",
    owner="encoder",
    symbol="ae",
    scale=1e-4,
    source="5 µm between disk and axle at a radius of 50 mm",
    needs=ECCENTRICITY,
    parts=("sin", "cos"),
)
def angle_eccentricity(s: Signals) -> Array:
    """The disk of the angle encoder sits beside the axle: an error of the angle once per turn (derivations 7.9).

    Equation: the true angle is the reading plus d = ae.sin sin angle + ae.cos cos angle; e = (1 + k)(i_r (-2 r rate d'
    + g_h cos angle d) + i_t (r d'' - g_h sin angle d)), g_h = g0 cos(elevation of the axle), i_r and i_t as in
    axle_tilt.
    Looks like: a wave once per turn that grows with the square of the rate.
    Easily confused with: axle_tilt at one speed.
    Separate by: several speeds; a second reading head across the disk.
    """
    return s.scale * np.column_stack([s.side[name] for name in ECCENTRICITY])


@effect(
    "axle_wobble",
    unit="rad",
    owner="rig",
    symbol="aw",
    scale=1e-4,
    source="5 µm of run-out between bearings 50 mm apart",
    needs=WOBBLE,
    parts=("sin", "cos"),
)
def axle_wobble(s: Signals) -> Array:
    """The axle of an arm cones once per turn, against the turn; with it is a constant on every axis across (7.9).

    Nodding along one direction is half of each.

    Equation: e = (1 + k)(g0 sin b (i_r d + i_t d_t) + i_a (r (rate' d_t - 3 rate² d) - g0 cos b l)), b the elevation of
    the axle, d = aw.sin sin 2 angle + aw.cos cos 2 angle, d_t = aw.sin cos 2 angle - aw.cos sin 2 angle, l = aw.sin
    cos angle - aw.cos sin angle; i_r and i_t as in axle_tilt, i_a along the axle.
    Looks like: a wave twice per turn of one size at all speeds; nothing across a horizontal axle.
    Easily confused with: angle_eccentricity about an oblique axle at one speed, whose gravity is twice per turn, too.
    Separate by: several speeds; a dial gauge on the axle.
    """
    return s.scale * np.column_stack([s.side[name] for name in WOBBLE])


@effect(
    "arm_bending",
    unit="s²",
    owner="rig",
    symbol="ab",
    scale=1e-6,
    source="0.01 % at 10 rad/s: an arm of plastics of 0.2 m that holds 50 g",
    needs=(BENDING,),
)
def arm_bending(s: Signals) -> Array:
    """The arm lengthens as it turns: r = r0 (1 + ab rate²) (derivations 7.9).

    Equation: e = (1 + k) r0 ab (i_r ((rate²)'' - rate⁴) + 5 i_t rate² rate'), i_r and i_t as in axle_tilt.
    Looks like: a residual with the fourth power of the rate.
    Easily confused with: quadratic on a radial axis, whose a² is r² rate⁴: the same about a vertical axle.
    Separate by: the sensor turned by 180 degrees on the arm, where a² keeps its sign; arms of two lengths; gravity
    along the axis about a horizontal axle.
    """
    return s.scale * s.side[BENDING]


@effect(
    "spin",
    unit="m",
    symbol="Kspin",
    scale=1e-4,
    source="no published figure",
    needs=RATES,
    search=Search(includes=("bias",)),
)
def spin(s: Signals) -> Array:
    """Anisoinertia of the pendulum: product of the rates about input and pendulous axis (IEEE 1293 Kspin).

    Equation: e = Kspin rate_i rate_p.
    Looks like: a residual while the body turns about both axes at once.
    Easily confused with: lever_arm, cross_axis where the turning also shakes the sensor sideways.
    Separate by: turning about each axis by itself; turning about an axis through the sensor.
    """
    return s.side[RATES[0]] * s.side[RATES[1]]


@effect(
    "angular_acceleration",
    unit="m",
    symbol="Kang",
    scale=1e-3,
    source="distance of the pendulum's mass from its hinge",
    needs=(ANGULAR_ACCELERATION,),
    search=Search(includes=("bias",)),
)
def angular_acceleration(s: Signals) -> Array:
    """Angular acceleration about the output axis turns the case under the pendulum (IEEE 1293 Kang).

    Equation: e = Kang alpha_o.
    Looks like: a residual where turning about the output axis starts and stops.
    Easily confused with: lever_arm.
    Separate by: turning about the output axis with the sensor at two distances from it.
    """
    return s.side[ANGULAR_ACCELERATION]


enter(
    {
        "self_heating": mechanism("bias", "a2")
        | {
            "card": """Bias from heat that motion makes in the sensor.

    Equation: e = ch x, tau x' = a² - x.
    Looks like: a slow residual that follows the intensity of the motion.
    Easily confused with: bias_step where rest turns into motion, quadratic, bias_random_walk.
    Separate by: several changes between rest and motion, each longer than tau.
    """,
            "symbol": "ch",
            "scale": 1e-4,
            "source": "no published figure; taken as K2",
            "shapes": {
                "tau": Shape("s", slow(0.015, 0.5), trials=5, spacing="log"),
                "start": state_of(DRIVERS["a2"]),
            },
        }
    }
)
