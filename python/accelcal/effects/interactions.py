"""Nonparametric families of two variables: a response to one that changes with another, as no named effect does.

As in the families of one variable, the ends of a range are set by the record of the fit and kept by the model; beyond
them the response stays as it is there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from accelcal.data import Array
from accelcal.effects.curves import RECORD, legendre, over
from accelcal.effects.mechanisms import Driver, product
from accelcal.effects.registry import Search, Variable, enter

PROFILE = ("mean", "slope", "bend")
"""Columns of a profile along a range: Legendre's first polynomials."""


def profile(x: Array, low: float, high: float) -> Array:
    """Legendre polynomials of degree 0 to 2 over [low, high]; x is held at the ends; (n, 3)."""
    return legendre(x, low, high, len(PROFILE) - 1)


ALONG_RAIL = Driver(
    "h(p)", "1", lambda s, low, high: profile(s.p, low, high), shapes=over("m", lambda s: (s.p, s.p_std))
)
"""A profile along the rail, by which a coefficient is multiplied."""
INTERACTIONS: dict[str, dict[str, Any]] = {
    "shape_of_position_and_velocity": product("velocity", ALONG_RAIL)
    | {
        "card": """Viscous friction that varies along the rail.

    Equation: e = v (c0 + c1 u + c2 (3 u^2 - 1)/2), u = p over its range, -1 to 1.
    Looks like: a residual that grows with velocity, here more than there.
    Easily confused with: velocity, clock_skew, time_offset_step.
    Separate by: steady speed over the whole rail, forwards and backwards.
    """,
        "family": {"variable": Variable("position", "p", "m", per="v")},
        "symbol": "h(p) v",
        "scale": 1e-2,
        "source": "0.1 mg at 0.1 m/s",
        "parts": PROFILE,
        "search": Search(),
    },
    "shape_of_position_and_acceleration": product(
        "scale_factor", replace(ALONG_RAIL, of=lambda s, low, high: profile(s.p, low, high)[:, 1:])
    )
    | {
        "card": """Scale factor that varies along the rail.

    Equation: e = a (c1 u + c2 (3 u^2 - 1)/2), u = p over its range, -1 to 1.
    Looks like: a residual that follows acceleration, here more than there.
    Easily confused with: encoder_nonlinearity, rail_curve, scale_drift.
    Separate by: short fast strokes at several places of the rail.
    """,
        "family": {"variable": Variable("position", "p", "m", per="a")},
        "owner": "rig",
        "symbol": "h(p) a",
        "scale": 1e-3,
        "source": "a scale factor known to 0.1 %",
        "parts": PROFILE[1:],
    },
    "shape_of_temperature_and_velocity": product(
        "velocity",
        Driver(
            "h(T)",
            "1",
            lambda s, low, high: profile(s.temperature, low, high),
            needs=("temperature",),
            shapes=over("K", lambda s: (s.temperature, 0.0)),
        ),
    )
    | {
        "card": """Viscous friction that varies with temperature, as that of grease.

    Equation: e = v (c0 + c1 u + c2 (3 u^2 - 1)/2), u = T over its range, -1 to 1.
    Looks like: a residual that grows with velocity, warm less than cold.
    Easily confused with: velocity, shape_of_time_and_velocity.
    Separate by: the same motion at several temperatures that do not rise steadily.
    """,
        "family": {"variable": Variable("temperature", "temperature", "degC", per="v")},
        "symbol": "h(T) v",
        "scale": 1e-2,
        "source": "0.1 mg at 0.1 m/s",
        "parts": PROFILE,
        "search": Search(),
    },
    "shape_of_time_and_velocity": product(
        "velocity",
        Driver("h(t)", "1", lambda s, start, length: profile(s.t, start, start + length), shapes=RECORD),
    )
    | {
        "card": """Viscous friction that varies with time, as during run-in.

    Equation: e = v (c0 + c1 u + c2 (3 u^2 - 1)/2), u = t over the record, -1 to 1.
    Looks like: a residual that grows with velocity, at first more than later.
    Easily confused with: velocity, clock_skew, shape_of_temperature_and_velocity.
    Separate by: a second record right after the first.
    """,
        "family": {"variable": Variable("time", "t", "s", per="v")},
        "symbol": "h(t) v",
        "scale": 1e-2,
        "source": "0.1 mg at 0.1 m/s",
        "parts": PROFILE,
        "search": Search(),
    },
}
"""The interactions, in the order of the catalogue."""
enter(INTERACTIONS)
