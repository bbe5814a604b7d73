"""Jumps of the position that were found before the fit, and that the replay leaves out."""

from __future__ import annotations

import math

from accelcal.diagnosis.noise_tests.noise_test import POSITION_JUMPS, NoiseTest
from accelcal.diagnosis.noise_tests.residuals import Residuals


def position_jumps(residuals: Residuals) -> NoiseTest:
    """Report the position steps behind which the replay started anew; the innovations do not show them any more.

    The largest is reported with the p value of its detection (`accelcal.diagnosis.faults.position_steps`), which counts
    every reading of the record.
    """
    run = residuals.run
    steps = run.accounted_steps
    if not steps:
        return NoiseTest(POSITION_JUMPS, 0.0, 1.0, 0.0, "m", math.inf, "no jump of the position")
    largest = max(steps, key=lambda step: abs(step.size))
    more = f"; {len(steps)} such jumps in all" if len(steps) > 1 else ""
    return NoiseTest(
        POSITION_JUMPS,
        abs(largest.size),
        min(step.p_value for step in steps),
        abs(largest.size),
        "m",
        math.sqrt(run.reading_variance_guess),
        largest.sentence + more,
        {"count": float(len(steps))},
    )
