"""The static effects: bias, scale factor, time offset, what a turned sensor separates from them, and transverse axes.

Transverse accelerations, m/s², are the recorded channels `a_y`, the output axis o of IEEE 1293, and `a_z`, the
pendulous axis p; of a sensor without a pendulum any two axes across the input axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from accelcal.data import STANDARD_GRAVITY, Array
from accelcal.effects.registry import Lumped, Search, Static, Traits, effect, enter
from accelcal.signals.signals import Signals


@effect(
    "bias",
    unit="m/s²",
    symbol="K0",
    scale=0.1,
    source="IIS2ICLX: ±8 mg; LIS3DH: ±40 mg; ADXL105: up to ±2.5 g",
    traits=Traits(
        static=Static(0, "K0"),
        lumped=Lumped(
            ("tilt", "misalignment"),
            "turn the sensor by 180 degrees about the vertical axis and fit both runs together; "
            "roll it for misalignment",
        ),
        summand="K0",
    ),
)
def bias(s: Signals) -> Array:
    """Constant output without acceleration (IEEE 1293 K0).

    Equation: e = K0.
    Looks like: a constant residual.
    Easily confused with: level error g0 sin(theta), misalignment times gravity, ADC offset.
    Separate by: turning the sensor by 180 degrees about the vertical axis; K0 stays, tilt changes sign.
    """
    return np.ones_like(s.t)


@effect(
    "scale_factor",
    unit="1",
    symbol="k",
    scale=0.01,
    source="IIS2ICLX: ±2 %",
    traits=Traits(
        static=Static(1, "(1 + k) a", odd=True),
        lumped=Lumped(
            ("encoder_scale", "cross_axis_gravity"),
            "roll the sensor by 180 degrees about its input axis; "
            "check the encoder by interferometer or tumble in gravity",
        ),
        summand="k",
    ),
)
def scale_factor(s: Signals) -> Array:
    """Scale error: output = (1 + k) a + K0.

    Equation: e = k a.
    Looks like: a residual proportional to acceleration.
    Easily confused with: encoder scale, cos(misalignment), cross-axis product with gravity.
    Separate by: tumble in gravity, roll by 180 degrees, interferometer on the encoder.
    """
    return s.a


@effect(
    "time_offset",
    unit="s",
    owner="timing",
    symbol="t0",
    scale=1e-4,
    source="hold of samples: half a period",
    traits=Traits(
        lumped=Lumped(("sensor_lag", "lowpass_error", "encoder_lag")), summand="clock offset", delay_class=True
    ),
)
def time_offset(s: Signals) -> Array:
    """Accelerometer output late by t0 (derivations 7.1): output(t) = f(a(t - t0)).

    Equation: e = -(1 + k) t0 jerk.
    Looks like: a residual proportional to jerk.
    Easily confused with: sensor lag, tolerance of a known low-pass, resonance.
    Separate by: a common trigger on both channels; several frequencies.
    """
    return -s.scale * s.jerk


@effect(
    "tilt",
    unit="rad",
    owner="rig",
    symbol="theta",
    scale=1e-3,
    source="level instrument: 0.05 degrees (paper)",
    traits=Traits(visible=False, summand="g0 tilt", separated_by="turning", uncertainty="level"),
)
def tilt(s: Signals) -> Array:
    """The stage is not level: gravity adds g0 sin(theta) along the stage axis.

    Equation: e = (1 + k) theta g0, with the sign of the mount.
    Looks like: a bias.
    Easily confused with: bias; on a level rig with one mount they are one number.
    Separate by: turning the sensor by 180 degrees about the vertical axis.
    """
    return np.full_like(s.t, s.scale * s.rig.polarity * STANDARD_GRAVITY)


@effect(
    "misalignment",
    unit="rad",
    owner="mounting",
    symbol="delta",
    scale=2e-3,
    source="inter-axis 0.1 degrees: ADXL203",
    traits=Traits(visible=False, summand="g0 misalignment", separated_by="rolling", uncertainty="misalignment"),
)
def misalignment(s: Signals) -> Array:
    """The input axis leans by delta towards the vertical: gravity adds delta g0.

    Equation: e = delta g0, with the sign of the roll.
    Looks like: a bias.
    Easily confused with: bias and tilt.
    Separate by: rolling the sensor by 180 degrees about its input axis; the bias changes by 2 delta g0.
    """
    return np.full_like(s.t, s.rig.roll * STANDARD_GRAVITY)


@effect(
    "cross_axis_gravity",
    unit="(m/s²)⁻¹",
    symbol="Kin",
    scale=1e-3,
    source="paper, eq. 7",
    traits=Traits(
        visible=False,
        no_inverse="depends on the acceleration across the input axis, which one axis does not know",
        summand="g0 Kin",
        separated_by="rolling",
    ),
)
def cross_axis_gravity(s: Signals) -> Array:
    """Product of acceleration and gravity on the vertical axis: Kin g0 a.

    Equation: e = Kin g0 a, with the sign of the roll.
    Looks like: a scale error.
    Easily confused with: scale_factor; on a level rig with one roll angle they are one number.
    Separate by: rolling the sensor by 180 degrees about its input axis; k changes by 2 g0 Kin.
    """
    return s.rig.roll * STANDARD_GRAVITY * s.a


TRANSVERSE: dict[str, dict[str, Any]] = {
    "cross_axis": {
        "function": lambda s: s.side["a_y"],
        "card": """Linear response to transverse acceleration (IEEE 1293 do).

    Equation: e = do a_y.
    Looks like: a residual proportional to the transverse acceleration.
    Easily confused with: scale_factor when a_y follows a.
    Separate by: transverse motion that does not follow the stage; turning the sensor about its input axis.
    """,
        "unit": "1",
        "symbol": "do",
        "scale": 1e-2,
        "source": "1 %: ADXL358, ADXL313; 3 % to 5 % (paper)",
        "needs": ("a_y",),
        "search": Search(includes=("bias",)),
    },
    "cross_axis_quadratic": {
        "function": lambda s: s.side["a_y"] ** 2,
        "card": """Response to the square of transverse acceleration (IEEE 1293 Koo).

    Equation: e = Koo a_y².
    Looks like: a shift of the mean while the stage shakes sideways.
    Easily confused with: vibration_rectification, quadratic when a_y follows a.
    Separate by: transverse shaking with the stage at rest.
    """,
        "unit": "(m/s²)⁻¹",
        "symbol": "Koo",
        "scale": 1e-4,
        "source": "no published figure; taken as K2",
        "needs": ("a_y",),
        "search": Search(includes=("cross_axis", "bias")),
    },
    "cross_coupling": {
        "function": lambda s: s.a * s.side["a_y"],
        "card": """Product of both accelerations: k changes with the transverse one (IEEE 1293 Kio).

    Equation: e = Kio a a_y.
    Looks like: a residual proportional to acceleration, its size following the transverse acceleration.
    Easily confused with: quadratic when a_y follows a; cross_axis_gravity for the vertical axis.
    Separate by: motion at several constant transverse accelerations; a roll in gravity.
    """,
        "unit": "(m/s²)⁻¹",
        "symbol": "Kio",
        "scale": 1e-3,
        "source": "no published figure",
        "needs": ("a_y",),
        "search": Search(includes=("scale_factor",)),
    },
    "cross_axis_z": {
        "function": lambda s: s.side["a_z"],
        "card": """Linear response to acceleration along the pendulous axis (IEEE 1293 dp).

    Equation: e = dp a_z.
    Looks like: a residual proportional to the acceleration along the pendulous axis.
    Easily confused with: scale_factor when a_z follows a; cross_axis when a_z follows a_y.
    Separate by: transverse motion that does not follow the stage; turning the sensor about its input axis.
    """,
        "unit": "1",
        "symbol": "dp",
        "scale": 1e-2,
        "source": "1 %: ADXL358, ADXL313; 3 % to 5 % (paper)",
        "needs": ("a_z",),
        "search": Search(includes=("bias",)),
    },
    "cross_axis_quadratic_z": {
        "function": lambda s: s.side["a_z"] ** 2,
        "card": """Response to the square of acceleration along the pendulous axis (IEEE 1293 Kpp).

    Equation: e = Kpp a_z².
    Looks like: a shift of the mean while the stage shakes along the pendulous axis.
    Easily confused with: vibration_rectification, cross_axis_quadratic, quadratic when a_z follows a.
    Separate by: transverse shaking with the stage at rest.
    """,
        "unit": "(m/s²)⁻¹",
        "symbol": "Kpp",
        "scale": 1e-4,
        "source": "no published figure; taken as K2",
        "needs": ("a_z",),
        "search": Search(includes=("cross_axis_z", "bias")),
    },
    "cross_coupling_z": {
        "function": lambda s: s.a * s.side["a_z"],
        "card": """Product of input and pendulous acceleration: k changes with the latter (IEEE 1293 Kip).

    Equation: e = Kip a a_z.
    Looks like: a residual proportional to acceleration, its size following the one along the pendulous axis.
    Easily confused with: quadratic when a_z follows a; cross_axis_gravity where the pendulous axis is vertical.
    Separate by: motion at several constant transverse accelerations; a roll in gravity.
    """,
        "unit": "(m/s²)⁻¹",
        "symbol": "Kip",
        "scale": 1e-3,
        "source": "no published figure",
        "needs": ("a_z",),
        "search": Search(includes=("scale_factor",)),
    },
    "cross_axis_product": {
        "function": lambda s: s.side["a_y"] * s.side["a_z"],
        "card": """Product of the accelerations along output and pendulous axis (IEEE 1293 Kop).

    Equation: e = Kop a_y a_z.
    Looks like: a shift of the mean while both transverse axes shake together.
    Easily confused with: cross_axis_quadratic and cross_axis_quadratic_z where one axis follows the other.
    Separate by: shaking along each transverse axis by itself, and along the direction between them.
    """,
        "unit": "(m/s²)⁻¹",
        "symbol": "Kop",
        "scale": 1e-4,
        "source": "no published figure; taken as Koo",
        "needs": ("a_y", "a_z"),
        "search": Search(includes=("cross_axis", "cross_axis_z", "bias")),
    },
}
"""The effects of the transverse axes, in the order of the catalogue."""
enter(TRANSVERSE)
