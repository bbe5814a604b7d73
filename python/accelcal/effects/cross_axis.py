"""The transverse axis, where its acceleration was recorded as channel `a_y`, m/s²."""

from __future__ import annotations

from accelcal.data.arrays import Array
from accelcal.effects.registry import Search, effect
from accelcal.signals.signals import Signals


@effect(
    "cross_axis",
    unit="1",
    symbol="do",
    scale=1e-2,
    source="1 %: ADXL358, ADXL313; 3 % to 5 % (paper)",
    needs=("a_y",),
    search=Search(includes=("bias",)),
)
def cross_axis(s: Signals) -> Array:
    """Linear response to transverse acceleration (IEEE 1293 do, dp).

    Equation: e = do a_y.
    Looks like: a residual proportional to the transverse acceleration.
    Easily confused with: scale_factor when a_y follows a.
    Separate by: transverse motion that does not follow the stage; turning the sensor about its input axis.
    """
    return s.side["a_y"]


@effect(
    "cross_axis_quadratic",
    unit="(m/s²)⁻¹",
    symbol="Koo",
    scale=1e-4,
    source="no published figure; taken as K2",
    needs=("a_y",),
    search=Search(includes=("cross_axis", "bias")),
)
def cross_axis_quadratic(s: Signals) -> Array:
    """Response to the square of transverse acceleration (IEEE 1293 Koo, Kpp).

    Equation: e = Koo a_y².
    Looks like: a shift of the mean while the stage shakes sideways.
    Easily confused with: vibration_rectification, quadratic when a_y follows a.
    Separate by: transverse shaking with the stage at rest.
    """
    return s.side["a_y"] ** 2


@effect(
    "cross_coupling",
    unit="(m/s²)⁻¹",
    symbol="Kio",
    scale=1e-3,
    source="no published figure",
    needs=("a_y",),
    search=Search(includes=("scale_factor",)),
)
def cross_coupling(s: Signals) -> Array:
    """Product of both accelerations: k changes with the transverse one (IEEE 1293 Kio, Kip; paper, eq. 7).

    Equation: e = Kio a a_y.
    Looks like: a residual proportional to acceleration, its size following the transverse acceleration.
    Easily confused with: quadratic when a_y follows a; cross_axis_gravity for the vertical axis.
    Separate by: motion at several constant transverse accelerations; a roll in gravity.
    """
    return s.a * s.side["a_y"]
