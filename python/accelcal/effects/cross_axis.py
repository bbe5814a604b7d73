"""The transverse axes, where their accelerations were recorded as channels `a_y` and `a_z`, m/s².

`a_y` is the output axis o of IEEE 1293, `a_z` the pendulous axis p; of a sensor without a pendulum any two axes across
the input axis."""

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
    """Linear response to transverse acceleration (IEEE 1293 do).

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
    """Response to the square of transverse acceleration (IEEE 1293 Koo).

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
    """Product of both accelerations: k changes with the transverse one (IEEE 1293 Kio).

    Equation: e = Kio a a_y.
    Looks like: a residual proportional to acceleration, its size following the transverse acceleration.
    Easily confused with: quadratic when a_y follows a; cross_axis_gravity for the vertical axis.
    Separate by: motion at several constant transverse accelerations; a roll in gravity.
    """
    return s.a * s.side["a_y"]


@effect(
    "cross_axis_z",
    unit="1",
    symbol="dp",
    scale=1e-2,
    source="1 %: ADXL358, ADXL313; 3 % to 5 % (paper)",
    needs=("a_z",),
    search=Search(includes=("bias",)),
)
def cross_axis_z(s: Signals) -> Array:
    """Linear response to acceleration along the pendulous axis (IEEE 1293 dp).

    Equation: e = dp a_z.
    Looks like: a residual proportional to the acceleration along the pendulous axis.
    Easily confused with: scale_factor when a_z follows a; cross_axis when a_z follows a_y.
    Separate by: transverse motion that does not follow the stage; turning the sensor about its input axis.
    """
    return s.side["a_z"]


@effect(
    "cross_axis_quadratic_z",
    unit="(m/s²)⁻¹",
    symbol="Kpp",
    scale=1e-4,
    source="no published figure; taken as K2",
    needs=("a_z",),
    search=Search(includes=("cross_axis_z", "bias")),
)
def cross_axis_quadratic_z(s: Signals) -> Array:
    """Response to the square of acceleration along the pendulous axis (IEEE 1293 Kpp).

    Equation: e = Kpp a_z².
    Looks like: a shift of the mean while the stage shakes along the pendulous axis.
    Easily confused with: vibration_rectification, cross_axis_quadratic, quadratic when a_z follows a.
    Separate by: transverse shaking with the stage at rest.
    """
    return s.side["a_z"] ** 2


@effect(
    "cross_coupling_z",
    unit="(m/s²)⁻¹",
    symbol="Kip",
    scale=1e-3,
    source="no published figure",
    needs=("a_z",),
    search=Search(includes=("scale_factor",)),
)
def cross_coupling_z(s: Signals) -> Array:
    """Product of input and pendulous acceleration: k changes with the latter (IEEE 1293 Kip).

    Equation: e = Kip a a_z.
    Looks like: a residual proportional to acceleration, its size following the one along the pendulous axis.
    Easily confused with: quadratic when a_z follows a; cross_axis_gravity where the pendulous axis is vertical.
    Separate by: motion at several constant transverse accelerations; a roll in gravity.
    """
    return s.a * s.side["a_z"]


@effect(
    "cross_axis_product",
    unit="(m/s²)⁻¹",
    symbol="Kop",
    scale=1e-4,
    source="no published figure; taken as Koo",
    needs=("a_y", "a_z"),
    search=Search(includes=("cross_axis", "cross_axis_z", "bias")),
)
def cross_axis_product(s: Signals) -> Array:
    """Product of the accelerations along output and pendulous axis (IEEE 1293 Kop).

    Equation: e = Kop a_y a_z.
    Looks like: a shift of the mean while both transverse axes shake together.
    Easily confused with: cross_axis_quadratic and cross_axis_quadratic_z where one axis follows the other.
    Separate by: shaking along each transverse axis by itself, and along the direction between them.
    """
    return s.side["a_y"] * s.side["a_z"]
