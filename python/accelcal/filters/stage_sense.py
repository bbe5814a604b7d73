"""Parameters of a sensor on its stage: as a filter sees them that is given polarity * output - gravity."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from accelcal.data.arrays import Array

POWER = {"K0": 0, "k": 1, "K2": 2, "K3": 3}
"""Power of the specific force that each parameter multiplies."""


def to_stage(names: Sequence[str], polarity: float, gravity: float) -> Array:
    """Matrix from the sensor's parameters to those of a level, normally mounted sensor, (m, m).

    The output is sum c_n f^n with f = polarity (a + gravity), so polarity * output - gravity is a polynomial of the
    acceleration a of the stage, whose coefficients are the binomial sums of polarity^(n+1) c_n gravity^(n-i).

    Parameters
    ----------
    names : of the parameters, of `POWER`.
    gravity : specific force at rest along the stage axis, m/s².
    """
    return np.array(
        [
            [_share(POWER[row], POWER[column], gravity) * polarity ** (POWER[column] + 1) for column in names]
            for row in names
        ]
    )


def _share(i: int, n: int, gravity: float) -> float:
    """Coefficient of a^i in (a + gravity)^n."""
    return math.comb(n, i) * gravity ** (n - i) if n >= i else 0.0
