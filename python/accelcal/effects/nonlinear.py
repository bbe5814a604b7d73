"""Nonlinearity of the sensing element: what depends on the specific force alone, now or before."""

from __future__ import annotations

import numpy as np

from accelcal.data import Array, root_mean_square
from accelcal.effects.building_blocks import play
from accelcal.effects.mechanisms import product
from accelcal.effects.registry import Shape, SizePrior, Static, Traits, effect, enter
from accelcal.signals.signals import TINY, Signals

OUT_OF_LEVEL = 0.02
"""Gravity along the axis of a rig that is taken for level, m/s²: 0.1 degree."""


enter(
    {
        "quadratic": product("bias", "a2")
        | {
            "card": """Second-order nonlinearity (IEEE 1293 K2).

    Equation: e = K2 a².
    Looks like: second harmonic and a shift of the mean, both growing with the square of the amplitude.
    Easily confused with: scale_asymmetry, and velocity_squared when the motion has one frequency.
    Separate by: two frequencies at equal amplitude; a wider range of amplitudes; a vertical axis reversed.
    """,
            "symbol": "K2",
            "scale": 1e-4,
            "source": "0.1 % of ±2 g: ADXL358, IIS2ICLX",
            "traits": Traits(common=True, static=Static(2, "K2 a^2")),
        },
        "cubic": product("scale_factor", "a2")
        | {
            "card": """Third-order nonlinearity (IEEE 1293 K3).

    Equation: e = K3 a³.
    Looks like: third harmonic, growing with the cube of the amplitude.
    Easily confused with: scale_factor when there is one amplitude, odd_quadratic, the onset of saturation.
    Separate by: two amplitudes; the third harmonic of K3 grows with the cube, that of a|a| with the square.
    """,
            "symbol": "K3",
            "scale": 1e-5,
            "source": "0.1 % of ±2 g: ADXL358, IIS2ICLX",
            "traits": Traits(common=True, static=Static(3, "K3 a^3", odd=True)),
        },
        "odd_quadratic": product("scale_factor", "abs_a")
        | {
            "card": """Odd second-order nonlinearity (IEEE 1293 Koq).

    Equation: e = Koq a|a|.
    Looks like: third harmonic, growing with the square of the amplitude.
    Easily confused with: cubic, and scale_factor when there is one amplitude.
    Separate by: a sweep of the amplitude; the third harmonic of Koq grows with the square, that of K3 with the cube.
    """,
            "symbol": "Koq",
            "scale": 1e-4,
            "source": "no published figure; taken as K2",
            "traits": Traits(common=True, static=Static(2, "Koq a|a|", odd=True)),
        },
        "scale_asymmetry": product("bias", "abs_a")
        | {
            "function": lambda s: np.hypot(s.a, s.a_width),
            "card": """Scale factor that differs between the two directions (IEEE 1293 K1'/2).

    Equation: e = (K1'/2) |a|, the corner rounded: sqrt(a² + w²).
    Looks like: even harmonics and a shift of the mean, both growing in proportion to the amplitude.
    Easily confused with: quadratic.
    Separate by: a sweep of the amplitude; |a| grows with it, a² with its square.
    """,
            "symbol": "K1'/2",
            "scale": 1e-4,
            "source": "small in open-loop MEMS; no published figure",
            "traits": Traits(static=Static(1, "(K1'/2)|a|")),
        },
    }
)


def _thresholds(s: Signals) -> tuple[float, float]:
    rms = root_mean_square(s.a - s.rest)
    return s.a_width, max(2.0 * s.a_width, 0.3 * rms)


@effect(
    "dead_zone",
    unit="m/s²",
    symbol="K0'/2",
    scale=1e-3,
    source="no published figure; 0.1 mg",
    shapes={
        "width": Shape("m/s²", _thresholds, trials=3, spacing="log"),
        "centre": Shape("m/s²", (-OUT_OF_LEVEL, OUT_OF_LEVEL), trials=3),
    },
    traits=Traits(no_inverse="gives several accelerations the same output"),
)
def dead_zone(s: Signals, width: float, centre: float = 0.0) -> Array:
    """Bias that changes sign with the acceleration: dead zone if negative (IEEE 1293 K0'/2).

    Equation: e = (K0'/2) sgn(a - c), straight across c: clip((a - c)/w, -1, 1); a plain dead zone has w = |K0'/2|.
    The sensor's zero is that of the whole specific force: out of level, it lies at c, less gravity along the axis.
    Looks like: a step of the residual where the acceleration passes zero.
    Easily confused with: hysteresis, coulomb.
    Separate by: fast and slow motion; a dead zone does not depend on velocity and has no loop.
    """
    return np.clip((s.a - centre) / width, -1.0, 1.0)


def _levels(s: Signals) -> tuple[float, float]:
    largest = max(float(np.max(np.abs(s.scale * s.a + s.bias))), TINY)
    swing = max(largest - abs(s.scale * s.rest + s.bias), 0.01 * largest)
    return largest - 0.5 * swing, largest - 0.01 * swing


@effect(
    "saturation",
    unit="1",
    symbol="s",
    scale=SizePrior(0.3, "the output clips: ±2 g to ±5 g (paper)", (1.0,), mean=1.0),
    shapes={"level": Shape("m/s²", _levels, trials=5)},
    traits=Traits(positive=True, clips_at="level"),
)
def saturation(s: Signals, level: float) -> Array:
    """Saturation of the output at a level; a coefficient of 1 is a hard clip, less a soft one.

    Most clips are hard; where few readings reach one, its level and its softness trade places, and the prior decides.

    Equation: e = s (clip(u, -level, level) - u), u = (1 + k) a + K0: it is the output that has a range, bias included.
    Looks like: residuals at the largest outputs only, towards zero; on one side when there is a bias.
    Easily confused with: cubic with a negative coefficient, vibration_rectification.
    Separate by: the edge of the histogram of the output; a smaller amplitude, at which it vanishes.
    """
    output = s.scale * s.a + s.bias
    return np.clip(output, -level, level) - output


def _slacks(s: Signals) -> tuple[float, float]:
    rms = max(root_mean_square(s.a - s.rest), TINY)
    return 0.1 * rms, 2.0 * rms


@effect(
    "hysteresis",
    unit="1",
    symbol="h",
    scale=1e-3,
    source="no published figure",
    shapes={"width": Shape("m/s²", _slacks, trials=5, spacing="log")},
    traits=Traits(memory=True),
)
def hysteresis(s: Signals, width: float) -> Array:
    """Hysteresis: play (backlash) operator of full `width` between acceleration and output, independent of rate.

    Equation: e = h play(a, width); the scale factor takes the part in proportion to a, the loop remains.
    Looks like: a loop of the residual over acceleration that does not depend on how fast it is run through.
    Easily confused with: velocity, time_offset, dead_zone.
    Separate by: slow against fast loops; the loop of a delay grows with frequency. Rests after either direction.
    """
    return play(s.a, width, s.rest)
