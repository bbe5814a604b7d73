"""Fig. 3: output against acceleration as a fit has it, and its deviation from a straight line against the truth."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from accelcal.calibration.straight_line import straight_line
from accelcal.data.arrays import Array
from accelcal.effects import polynomial
from accelcal.estimation.estimate import Fit, estimate
from accelcal.model import Model
from accelcal.paper.rows import ALPHA, Item, Plan, Row
from accelcal.paper.tracks import CUBIC_SENSOR, LINEAR_SENSOR
from accelcal.simulation.sensor import ADXL105_RIG, simulate

SECONDS = 60.0
AMPLITUDE = 10.0
"""Range of the line, ± m/s²."""
WITHIN = math.sqrt(-2.0 * math.log(ALPHA))
"""Half-width in sigma of a band that holds a whole curve of two coefficients (Scheffé): chi-square of 2 is 2 ln 1/p."""


def mapping_item(plan: Plan) -> tuple[Item, Fit]:
    """The curve of a curved and of a straight sensor; the fit of the curved one for the figure."""
    curved, straight = (
        fitted(plan, name, sensor) for name, sensor in (("curved", CUBIC_SENSOR), ("straight", LINEAR_SENSOR))
    )
    item = Item(
        name="mapping",
        title=f"Deviation of the output from a straight line within ±{AMPLITUDE:g} m/s², ADXL105, {SECONDS:g} s",
        source="Fig. 3",
        rows=(
            curve_row("the fitted curve is that of a sensor with K2 = -1e-3, K3 = 1e-4", curved, CUBIC_SENSOR),
            curve_row("a straight sensor has a straight curve", straight, LINEAR_SENSOR),
        ),
    )
    return item, curved


def fitted(plan: Plan, name: str, sensor: Mapping[str, float]) -> Fit:
    """A cubic model on one record of a sensor."""
    rng = plan.repeat(f"mapping {name}", 1, lambda rng: rng)[0]
    made = simulate("tones", seconds=SECONDS, rig=ADXL105_RIG, parameters=sensor, rng=rng, a_rms=4.0)
    return estimate(Model.cubic(), made.recording)


def true_deviation(sensor: Mapping[str, float], a: Array) -> Array:
    """What a line leaves of K2 a² + K3 a³ at equally spaced accelerations (n,) m/s²."""
    y = sum((sensor.get(name, 0.0) * a**power for power, name in enumerate(polynomial(3), 2)), np.zeros(len(a)))
    return np.asarray(y - np.polynomial.Polynomial.fit(a, y, 1)(a))


def curve_row(claim: str, fit: Fit, sensor: Mapping[str, float]) -> Row:
    """Whether the curve of a fit is that of a sensor."""
    line = straight_line(fit, -AMPLITUDE, AMPLITUDE)
    truth = true_deviation(sensor, line.a)
    at = line.largest
    worst = float(np.max(np.abs(line.deviation - truth) / line.deviation_std))
    return Row(
        by="us",
        claim=claim,
        expected=f"{1e3 * truth[at]:+.3g} mm/s² at {line.a[at]:+.3g} m/s²",
        measured=f"{1e3 * line.deviation[at]:+.3g} ± {2e3 * line.deviation_std[at]:.2g} mm/s²; worst {worst:.1f} sigma",
        value=worst,
        n=1,
        threshold=f"the whole curve within {WITHIN:.2f} sigma",
        holds=worst < WITHIN,
        remark="band of 2 sigma",
    )
