"""The transverse axes, where their accelerations were recorded as channels `a_y` and `a_z`, m/s².

`a_y` is the output axis o of IEEE 1293, `a_z` the pendulous axis p; of a sensor without a pendulum any two axes across
the input axis."""

from __future__ import annotations

from typing import Any

from accelcal.effects.registry import Search, enter

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
