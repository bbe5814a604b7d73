"""A sensor on a body that turns: what a gyroscope or a tracked attitude says of it."""

from __future__ import annotations

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.orientation import ANGULAR_ACCELERATION, LEVERS, RATES, TURNED
from accelcal.effects.registry import Search, Traits, effect
from accelcal.signals.signals import Signals

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
