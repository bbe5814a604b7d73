"""A tumble test: static dwells of a polynomial sensor, evenly turned in gravity (IEEE 1293)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from accelcal.data.dwells import Dwells
from accelcal.data.rig import STANDARD_GRAVITY, Rig
from accelcal.effects import static_terms

DWELLS, DWELL, TURN = 24, 60.0, 15.0
"""Number of dwells, length of each and time to turn to the next, s."""
SAMPLES = 1e4
"""Samples of each, which give the deviation of one from that of their mean."""


def tumble(
    parameters: Mapping[str, float], rig: Rig, *, angle_std: float, rng: np.random.Generator | None = None
) -> Dwells:
    """24 dwells of a minute each.

    Parameters
    ----------
    parameters : coefficients of the sensor's static characteristic by effect, SI; 0 where not given.
    rig : its sensor's noise density is that of the dwells.
    angle_std : declared standard deviation of an angle, rad.
    rng : draws noise and angles; without it the dwells have neither, both are still declared.
    """
    drawn = np.zeros((2, DWELLS)) if rng is None else rng.standard_normal((2, DWELLS))
    angle = np.arange(DWELLS) * 2.0 * np.pi / DWELLS
    white = math.sqrt(0.5 * (rig.sensor.noise or 0.0) ** 2 / DWELL)
    a = STANDARD_GRAVITY * np.sin(angle + angle_std * drawn[0])
    mean = a + white * drawn[1]
    for name, term in static_terms().items():
        if not term.thermal:
            mean += parameters.get(name, 0.0) * np.array([term.per_unit(float(each), 0.0) for each in a])
    return Dwells(
        angle=angle,
        mean=mean,
        std=np.full(DWELLS, white * math.sqrt(SAMPLES)),
        duration=np.full(DWELLS, DWELL),
        samples=np.full(DWELLS, SAMPLES),
        group=("0",) * DWELLS,
        rig=rig,
        angle_std=angle_std,
        name="tumble",
    )
