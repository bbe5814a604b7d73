"""Nonparametric families: smooth functions of one variable, for what no physical effect explains.

The ends of their range are set by the record of the fit and kept by the model, so that equal coefficients give one
function on every record; beyond the range the function is held. They do not contain what the base model explains: a
constant, and the straight line where that is the scale factor or a delay.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from accelcal.data import Array
from accelcal.effects.building_blocks import direction, since_reversal, wave
from accelcal.effects.registry import Search, Shape, Traits, Variable, enter
from accelcal.signals.signals import TINY, Signals

PIECES = 7
"""Pieces of a cubic spline."""
CURVE = ("p1", "p2", "p3", "s3", "s4", "s5", "s6", "s7", "s8")
"""Columns of a curve: Legendre polynomials by their degree, then the inner splines. The constant is the bias."""
CURVATURE = CURVE[1:]
"""Curve columns orthogonal to the line that the base model already has."""
CUBIC = 3
"""Degree of the polynomials, which by themselves are a coarse curve: fewer coefficients are detected sooner."""
KNOT_NOISE = 6.0
"""Least distance of knots in standard deviations of the variable, whose noise would otherwise blur the pieces."""
INNER_MEANS = np.array([23.0, *(24.0,) * (PIECES - 3), 23.0]) / (24.0 * PIECES)
"""Mean of each inner spline over the range; 1/24 of the first and the last lies outside."""
COSINES = tuple(f"c{j}" for j in range(1, 13))
AGES = (0.02, 0.1, 0.5, 2.5)
"""Times since a reversal at which the response has a knot, s."""


def cosines(t: Array, start: float, length: float, weights: Array) -> Array:
    """Columns weights_j cos(pi j (t - start)/length), j = 1.., held beyond both ends; (n, len(weights))."""
    share = np.clip((t - start) / length, 0.0, 1.0)
    first = np.cos(np.pi * share)
    rows = np.empty((len(weights) + 1, len(t)), dtype=first.dtype)
    rows[0] = 1.0
    rows[1] = first
    twice = 2.0 * first
    for j in range(2, len(rows)):  # cos(j x) = 2 cos x cos((j - 1) x) - cos((j - 2) x)
        np.multiply(twice, rows[j - 1], out=rows[j])
        rows[j] -= rows[j - 2]
    return (rows[1:] * weights[:, None]).T


def splines(x: Array, low: float, high: float) -> Array:
    """Uniform cubic B-splines on [low, high], which sum to 1, x held at the ends, NaN where x is; (n, PIECES + 3)."""
    u = np.clip((x - low) * (PIECES / (high - low)), 0.0, PIECES)
    if u.dtype == object:  # symbols of an export, which are no index: the same as truncated cubes
        away = np.abs(u[:, None] - np.arange(-1.0, PIECES + 2.0))
        outer, inner = np.maximum(2.0 - away, 0.0), np.maximum(1.0 - away, 0.0)
        return np.asanyarray((outer**3 - 4.0 * inner**3) / 6.0)
    piece = np.minimum(np.nan_to_num(u).astype(np.intp), PIECES - 1)
    f = u - piece
    g = 1.0 - f
    n = len(x)
    flat, at = np.zeros((PIECES + 3) * n), piece * n + np.arange(n)  # each column in one piece of memory
    f2, g2 = f * f, g * g  # products: a power of 3 costs forty of them
    flat[at] = g2 * g / 6.0
    flat[at + n] = (4.0 - 6.0 * f2 + 3.0 * f2 * f) / 6.0
    flat[at + 2 * n] = (4.0 - 6.0 * g2 + 3.0 * g2 * g) / 6.0
    flat[at + 3 * n] = f2 * f / 6.0
    return flat.reshape(PIECES + 3, n).T


def curve(x: Array, low: float, high: float, first: int = 1) -> Array:
    """Basis of the cubic splines on [low, high] without degrees below `first`: Legendre polynomials up to the cubic,
    then the inner splines less their means, so that no sum of columns holds a constant; x is held at the ends;
    (n, 10 - first)."""
    inner = splines(x, low, high)[:, 2:-2] - INNER_MEANS
    return np.column_stack([legendre(x, low, high, CUBIC)[:, first:], inner])


def rippled(x: Array, low: float, high: float, period: float) -> Array:
    """A smooth curve over [low, high] and a ripple: Legendre polynomials of degree 2 and up, then sine and cosine; as
    many columns as a curve without its straight line, (n, 8)."""
    return np.column_stack([legendre(x, low, high, len(CURVATURE) - 1)[:, 2:], wave(x, period, low, high)])


def bumped(x: Array, low: float, high: float, centre: float, width: float) -> Array:
    """A smooth curve over [low, high] and something local: Legendre polynomials of degree 1 and up, then a Gaussian
    bump and its slope; as many columns as a curve, (n, 9)."""
    u = (x - centre) / width
    bump = np.exp(-0.5 * u * u)
    ends = (np.array([low, high]) - centre) / width
    area, edge = (
        np.diff(np.sqrt(np.pi / 2.0) * scipy.special.erf(ends / np.sqrt(2.0))),
        -np.diff(np.exp(-0.5 * ends**2)),
    )
    means = np.concatenate([area, edge]) * width / (high - low)  # of bump and slope over the range
    return np.column_stack([legendre(x, low, high, len(CURVE) - 2)[:, 1:], bump - means[0], u * bump - means[1]])


def legendre(x: Array, low: float, high: float, degree: int) -> Array:
    """Legendre polynomials of degree 0 and up over [low, high]; x is held at the ends; (n, degree + 1)."""
    u = np.clip((2.0 * x - low - high) / (high - low), -1.0, 1.0)
    return np.asarray(np.polynomial.legendre.legvander(u, degree))


def over(unit: str, variable: Callable[[Signals], tuple[Array, float]]) -> dict[str, Shape]:
    """The range of a variable with a given noise, as shapes that the record sets."""

    def ends(s: Signals) -> tuple[float, float]:
        y, std = variable(s)
        low, high = float(np.min(y)), float(np.max(y))
        middle = 0.5 * (low + high)
        width = max(high - low, KNOT_NOISE * std * PIECES, TINY, 1e-9 * abs(middle))
        return middle - 0.5 * width, middle + 0.5 * width

    return {
        "low": Shape(unit, lambda s: (ends(s)[0],) * 2, trials=1),
        "high": Shape(unit, lambda s: (ends(s)[1],) * 2, trials=1),
    }


RECORD = {
    "start": Shape("s", lambda s: (float(s.t[0]),) * 2, trials=1),
    "length": Shape("s", lambda s: (s.length,) * 2, trials=1),
}
"""Start and length of the cosines' half period: set by the record of the fit and kept by the model."""


def shape_since_reversal(s: Signals) -> Array:
    """A response to reversals of the stage: some function of the time since the last, even or odd in direction.

    Equation: e = sum_j (c_j + d_j sgn v) h_j(r), h_j hats over log r, r the time since the last reversal.
    Looks like: a transient after each reversal.
    Easily confused with: coulomb, hysteresis, creep, encoder_backlash.
    Separate by: rests of several lengths between moves.
    """
    heading = direction(s)
    age = since_reversal(s, heading)
    turned = np.isfinite(age)
    age = np.where(turned, age, AGES[-1])  # before the first it is long ago
    u = np.interp(np.log(np.maximum(age, AGES[0])), np.log(AGES), np.arange(len(AGES), dtype=np.float64))
    way = heading * turned
    columns = np.empty((2 * len(AGES), len(u)))  # each in one piece of memory
    for k in range(len(AGES)):
        hat = s.rig.polarity * np.maximum(1.0 - np.abs(u - k), 0.0)
        columns[k], columns[len(AGES) + k] = hat, hat * way
    return columns.T


CURVES: dict[str, dict[str, Any]] = {
    "shape_of_time": {
        "function": lambda s, start, length: cosines(s.t, start, length, np.ones(len(COSINES))),
        "card": """A bias that is some slow function of time.

    Equation: e = sum_j c_j cos(pi j (t - start)/length).
    Looks like: a residual that depends on time only.
    Easily confused with: bias_drift, warm_up, bias_step, bias_random_walk, temperature_bias.
    Separate by: logging what else changes with time; a second record.
    """,
        "family": {
            "variable": Variable("time", "t", "s"),
            "covers": ("bias_drift", "bias_step", "warm_up"),
            "basis": "cosines",
        },
        "unit": "m/s²",
        "symbol": "f(t)",
        "scale": 1e-3,
        "source": "0.1 mg",
        "shapes": RECORD,
        "parts": COSINES,
        "search": Search(includes=("bias",)),
    },
    "shape_of_position": {
        "function": lambda s, low, high, centre=0.0, width=0.0: (
            s.rig.polarity * (bumped(s.p, low, high, centre, width) if width else curve(s.p, low, high))
        ),
        "card": """An acceleration that is some function of the place on the rail.

    Equation: e = sum_j c_j B_j(p), polynomials of degree 1 to 3, then cubic splines; something local: polynomials of
    degree 1 to 7, then a Gaussian bump of a width at a centre, and its slope.
    Looks like: a residual that depends on position only, at any speed.
    Easily confused with: rail_slope, rail_curve, rail_wave, encoder_shape_of_position.
    Separate by: a very slow traverse; two speeds.
    """,
        "family": {
            "variable": Variable("position", "p", "m"),
            "covers": ("rail_slope", "rail_curve", "rail_wave", "rail_second_wave"),
            "groups": (("rail_wave", "rail_second_wave"),),
            "coarse": CUBIC,
        },
        "unit": "m/s²",
        "owner": "rig",
        "symbol": "f(p)",
        "scale": 1e-3,
        "source": "0.1 mg",
        "shapes": over("m", lambda s: (s.p, s.p_std))
        | {"centre": Shape("m", (0.0, 0.0), trials=1, picked="bumps"), "width": Shape("m", (0.0, 0.0), trials=1)},
        "parts": CURVE,
        "search": Search(includes=("bias",)),
    },
    "shape_of_velocity": {
        "function": lambda s, low, high: s.rig.polarity * curve(s.v, low, high),
        "card": """An acceleration that is some function of velocity.

    Equation: e = sum_j c_j B_j(v), polynomials of degree 1 to 3, then cubic splines.
    Looks like: a residual that depends on velocity only.
    Easily confused with: velocity, velocity_squared, velocity_odd, coulomb, vibration_rectification.
    Separate by: several steady speeds in both directions.
    """,
        "family": {
            "variable": Variable("velocity", "v", "m/s"),
            "covers": ("velocity", "velocity_squared", "velocity_odd", "coulomb"),
            "coarse": CUBIC,
        },
        "unit": "m/s²",
        "owner": "rig",
        "symbol": "f(v)",
        "scale": 1e-3,
        "source": "0.1 mg",
        "shapes": over("m/s", lambda s: (s.v, s.v_std)),
        "parts": CURVE,
        "search": Search(includes=("bias",)),
    },
    "shape_of_acceleration": {
        "function": lambda s, low, high, ripple=0.0: (
            rippled(s.a, low, high, ripple) if ripple else curve(s.a, low, high, first=2)
        ),
        "card": """A characteristic of the sensor that is some function of acceleration.

    Equation: e = sum_j c_j B_j(a), polynomials of degree 2 and 3, then cubic splines; a ripple: 2 to 7, a sine.
    Looks like: a residual that depends on acceleration only.
    Easily confused with: quadratic, cubic, odd_quadratic, scale_asymmetry, dead_zone, saturation.
    Separate by: several amplitudes at several frequencies.
    """,
        "family": {
            "variable": Variable("acceleration", "a", "m/s²"),
            "covers": ("quadratic", "cubic", "odd_quadratic", "scale_asymmetry", "dead_zone", "saturation"),
            "groups": (("cubic", "odd_quadratic", "dead_zone", "saturation"), ("quadratic", "scale_asymmetry")),
            "coarse": CUBIC - 1,
        },
        "unit": "m/s²",
        "symbol": "f(a)",
        "scale": 1e-3,
        "source": "0.1 mg",
        "shapes": over("m/s²", lambda s: (s.a, s.a_std))
        | {"ripple": Shape("m/s²", (0.0, 0.0), trials=1, picked="ripples")},
        "parts": CURVATURE,
        "search": Search(includes=("bias", "scale_factor")),
    },
    "shape_of_jerk": {
        "function": lambda s, low, high: curve(s.jerk, low, high, first=2),
        "card": """An error that is some function of the rate of change of acceleration.

    Equation: e = sum_j c_j B_j(jerk), polynomials of degree 2 and 3, then cubic splines.
    Looks like: a residual that depends on jerk only.
    Easily confused with: hysteresis, time_offset, a slew-rate limit.
    Separate by: rests after either direction; several amplitudes.
    """,
        "family": {"variable": Variable("jerk", "jerk", "m/s³"), "coarse": CUBIC - 1},
        "unit": "m/s²",
        "owner": "timing",
        "symbol": "f(j)",
        "scale": 1e-3,
        "source": "0.1 mg",
        "shapes": over("m/s³", lambda s: (s.jerk, s.jerk_std)),
        "parts": CURVATURE,
        "search": Search(includes=("bias", "time_offset")),
    },
    "shape_of_temperature": {
        "function": lambda s, low, high: curve(s.temperature, low, high),
        "card": """A bias that is some function of temperature.

    Equation: e = sum_j c_j B_j(T), polynomials of degree 1 to 3, then cubic splines.
    Looks like: a residual that depends on temperature only.
    Easily confused with: temperature_bias, shape_of_time while temperature changes steadily.
    Separate by: a temperature cycle that is not monotone in time.
    """,
        "family": {
            "variable": Variable("temperature", "temperature", "degC"),
            "covers": ("temperature_bias",),
            "coarse": CUBIC,
        },
        "unit": "m/s²",
        "symbol": "f(T)",
        "scale": 1e-3,
        "source": "0.1 mg",
        "shapes": over("K", lambda s: (s.temperature, 0.0)),
        "needs": ("temperature",),
        "parts": CURVE,
        "search": Search(includes=("bias",)),
    },
    "shape_of_a_y": {
        "function": lambda s, low, high: curve(s.side["a_y"], low, high),
        "card": """A response that is some function of the lateral acceleration.

    Equation: e = sum_j c_j B_j(a_y), polynomials of degree 1 to 3, then cubic splines.
    Looks like: a residual that depends on the lateral acceleration only.
    Easily confused with: cross_axis, cross_axis_quadratic.
    Separate by: lateral motion of two sizes; turning the sensor about its input axis.
    """,
        "family": {
            "variable": Variable("lateral acceleration", "a_y", "m/s²"),
            "covers": ("cross_axis", "cross_axis_quadratic"),
            "coarse": CUBIC,
        },
        "unit": "m/s²",
        "owner": "mounting",
        "symbol": "f(a_y)",
        "scale": 1e-3,
        "source": "0.1 mg",
        "shapes": over("m/s²", lambda s: (s.side["a_y"], 0.0)),
        "needs": ("a_y",),
        "parts": CURVE,
        "search": Search(includes=("bias",)),
    },
    "shape_since_reversal": {
        "function": shape_since_reversal,
        "family": {"variable": Variable("time since reversal", "reversal", "s")},
        "unit": "m/s²",
        "owner": "rig",
        "symbol": "f(r)",
        "scale": 1e-3,
        "source": "0.1 mg",
        "parts": tuple(f"{kind} {age:g} s" for kind in ("both", "odd") for age in AGES),
        "traits": Traits(memory=True),
        "search": Search(includes=("bias",)),
    },
    "encoder_shape_of_position": {
        "function": lambda s, low, high: curve(s.p, low, high, first=2),
        "card": """An error of the encoder that is some function of position; its straight part is encoder_scale.

    Equation: b = sum_j c_j B_j(p), polynomials of degree 2 and 3, then cubic splines.
    Looks like: a residual that depends on position and grows with the square of speed.
    Easily confused with: encoder_nonlinearity, encoder_cyclic, shape_of_position.
    Separate by: two speeds; a shifted start position.
    """,
        "family": {"variable": Variable("position", "p", "m"), "covers": ("encoder_nonlinearity", "encoder_cyclic")},
        "unit": "m",
        "port": "position",
        "owner": "encoder",
        "symbol": "b(p)",
        "scale": 1e-6,
        "source": "at most 10 µm (paper)",
        "shapes": over("m", lambda s: (s.p, s.p_std)),
        "parts": CURVATURE,
    },
}
"""The curves, in the order of the catalogue."""
enter(CURVES)
