"""The stage: what velocity and place on the rail add to the acceleration that the sensor feels.

These are accelerations along the stage; a sensor that is reversed on it measures them with the other sign.
"""

from __future__ import annotations

import numpy as np

from accelcal.data import Array
from accelcal.effects.building_blocks import direction, distances, lagged_at, slack, stroke, travelled, wave, waves
from accelcal.effects.mechanisms import VELOCITY, product
from accelcal.effects.registry import Search, Shape, Traits, effect, enter
from accelcal.signals.signals import TINY, Signals


@effect("velocity", unit="s⁻¹", owner="rig", symbol="cv", scale=1e-3, source="1e-4 m/s² at 0.1 m/s")
def velocity(s: Signals) -> Array:
    """Viscous damping, in proportion to velocity: eddy currents, cable drag, an amplifier's high-pass.

    Equation: e = cv v.
    Looks like: a residual proportional to velocity.
    Easily confused with: time_offset when the motion has one frequency, velocity_odd, coulomb.
    Separate by: a sweep of frequency: cv v stays, t0 jerk grows with its square; several speeds.
    """
    return s.rig.polarity * s.v


enter(
    {
        "velocity_squared": product("bias", "v2")
        | {
            "function": lambda s: s.rig.polarity * s.v**2,
            "card": "Even quadratic dependence on velocity, v²: centripetal acceleration on a curved rail, "
            """pitch of the carriage.

    Equation: e = cvv v².
    Looks like: a shift of the mean that grows with speed, equal in both directions.
    Easily confused with: quadratic when the motion has one frequency, vibration_rectification.
    Separate by: a sweep of frequency at equal amplitude of acceleration.
    """,
            "unit": "m⁻¹",
            "owner": "rig",
            "symbol": "cvv",
            "scale": 1e-3,
            "source": "1e-5 m/s² at 0.1 m/s",
        },
        "velocity_odd": product("velocity", "abs_v")
        | {
            "card": """Quadratic drag, v|v|: resistance of air or fluid.

    Equation: e = cvo v|v|.
    Looks like: a residual that changes sign with direction and grows with the square of speed.
    Easily confused with: velocity, coulomb.
    Separate by: several speeds over a ratio of 4 or more.
    """,
            "unit": "m⁻¹",
            "symbol": "cvo",
            "scale": 1e-2,
            "source": "1e-4 m/s² at 0.1 m/s",
        },
    }
)


@effect("coulomb", unit="m/s²", owner="rig", symbol="cf", scale=1e-3, source="no published figure; 0.1 mg")
def coulomb(s: Signals) -> Array:
    """Coulomb friction, with the sign of the velocity: dry friction that tips the carriage, drive current picked up.

    Equation: e = cf sgn v, the corner rounded: tanh(v/w).
    Looks like: two levels of the residual, one for either direction.
    Easily confused with: velocity, velocity_odd, hysteresis, encoder_backlash, presliding.
    Separate by: several speeds; rests, in which it vanishes and hysteresis stays.
    """
    return s.rig.polarity * np.tanh(s.v / s.v_width)


@effect(
    "presliding",
    unit="m/s²",
    owner="rig",
    symbol="fd",
    scale=1e-3,
    source="Dahl (1968); cable chains and guides: 1 mm to 10 mm",
    shapes={"length": Shape("m", distances, trials=6, spacing="log")},
    traits=Traits(memory=True),
)
def presliding(s: Signals, length: float) -> Array:
    """Friction that builds up over a distance after each reversal (Dahl): cable chains, guides, elastic seals.

    Equation: e = fd z, length dz = dp - |dp| z; z is kept through rests and 0 before the first move.
    Looks like: a loop of the residual over position after each reversal, at any speed.
    Easily confused with: coulomb, of which it is the slow form, velocity, rail_slope, hysteresis.
    Separate by: strokes of several lengths about one place; the same stroke at several speeds.
    """
    width = slack(s)
    way = travelled(s, width)
    distance = np.cumsum(np.abs(np.diff(way, prepend=way[0]))) + TINY * np.arange(len(way))
    return s.rig.polarity * lagged_at(distance, direction(s, width), length, 0.0)


enter(
    {
        "acceleration_velocity": product("scale_factor", VELOCITY)
        | {
            "card": """Product of acceleration and velocity: a scale factor that depends on speed.

    Equation: e = cav a v.
    Looks like: a residual proportional to acceleration with opposite sign in either direction.
    Easily confused with: encoder_nonlinearity, clock_skew.
    Separate by: the same acceleration at several speeds; a shifted centre of the stroke.
    """,
            "unit": "s/m",
            "owner": "rig",
            "symbol": "cav",
            "scale": 1e-3,
            "source": "no published figure",
        },
        "rail_slope": product("bias", "position")
        | {
            "function": lambda s: s.rig.polarity * s.p,
            "card": """Sag of the rail: its angle to level, and with it gravity along the stage, is linear in position.

    Equation: e = c1 p.
    Looks like: a residual proportional to position, at any speed.
    Easily confused with: scale_factor when the motion has one frequency, rail_curve.
    Separate by: a very slow traverse; equal motion at another centre of the stroke.
    """,
            "unit": "s⁻²",
            "owner": "rig",
            "symbol": "c1",
            "scale": 9.8e-3,
            "source": "bow of 1 km radius: g0 per km",
        },
    }
)


enter(
    {
        "rail_curve": product("rail_slope", "position")
        | {
            "card": """Uneven sag of the rail: gravity along the stage is quadratic in position.

    Equation: e = c2 p².
    Looks like: a residual that is a parabola over position, at any speed.
    Easily confused with: quadratic and velocity_squared when the motion has one frequency.
    Separate by: a very slow traverse over the full travel.
    """,
            "unit": "m⁻¹ s⁻²",
            "symbol": "c2",
            "scale": 0.1,
            "source": "no published figure; 1e-3 m/s² at 0.1 m",
        },
    }
)


@effect(
    "rail_wave",
    unit="m/s²",
    owner="rig",
    symbol="cw",
    scale=1e-3,
    source="no published figure; 0.1 mrad of waviness",
    shapes={"period": Shape("m", waves, trials=8, spacing="log", picked="waves")} | stroke(),
    parts=("sin", "cos"),
)
def rail_wave(s: Signals, period: float, low: float = 0.0, high: float = 0.0) -> Array:
    """Periodic waviness of the rail: gravity along the stage changes periodically with position.

    Equation: e = c sin(2 pi p/period) + d cos(2 pi p/period), less its mean over the stroke, which is bias.
    Looks like: a residual periodic in position, the same in both directions and at any speed.
    Easily confused with: encoder_cyclic, rail_curve, bias_step.
    Separate by: two speeds: a wave of the rail stays, a wave of the encoder grows with the square of speed.
    """
    return s.rig.polarity * wave(s.p, period, low, high)


@effect(
    "rail_second_wave",
    unit="m/s²",
    owner="rig",
    symbol="c2",
    scale=1e-3,
    source="as rail_wave; linear motors: Gieras, Piech, Tomczuk 2011, Linear Synchronous Motors, section 3.6",
    shapes={"period": Shape("m", waves, trials=8, spacing="log", picked="waves")} | stroke(),
    parts=("sin", "cos"),
    search=Search(beside="rail_wave"),
)
def rail_second_wave(s: Signals, period: float, low: float = 0.0, high: float = 0.0) -> Array:
    """Second periodic waviness of the rail, of another period: cogging of poles beside that of slots.

    Equation: e = c sin(2 pi p/period) + d cos(2 pi p/period), less its mean over the stroke, which is bias.
    Looks like: a residual periodic in position once a wave of the rail is in the model.
    Easily confused with: encoder_cyclic, shape_of_position.
    Separate by: two speeds; a stroke of many periods.
    """
    return s.rig.polarity * wave(s.p, period, low, high)
