"""Aligning the input axis (II-A): the share of 0.05 degrees in the bias, and what turned and rolled runs separate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from accelcal.data.recording import Recording
from accelcal.data.rig import STANDARD_GRAVITY, Mount, Rig
from accelcal.estimation.estimate import Fit, estimate
from accelcal.model import Model
from accelcal.paper.rows import Item, Plan, Row
from accelcal.paper.tuning import PLAIN_ADXL105, PLAIN_CXL02
from accelcal.simulation.sensor import simulate

LEVEL = math.radians(0.05)
"""Accuracy of the paper's level, and the tilt of the rail here."""
AXIS_ANGLE = math.radians(0.03)
"""Angle of the input axis to the rail here."""
SENSOR = {"bias": 0.05, "scale_factor": 0.01, "misalignment": AXIS_ANGLE}
MOUNTS: tuple[Mount, ...] = ("normal", "reversed", "rolled")
SECONDS = 20.0
"""Of each run."""
LARGEST = 4.0
"""Standard deviations."""
RIGS = {"ADXL105": PLAIN_ADXL105, "CXL02": PLAIN_CXL02}


def alignment_item(plan: Plan) -> Item:
    """One run, a turned one, and a rolled one beside it."""
    rows: list[Row] = []
    for name, rig in RIGS.items():
        runs = plan.repeat(f"alignment {name}", 1, lambda rng, rig=rig: mounted(rng, rig))[0]  # type: ignore[misc]
        one, turned, all_three = (estimate(Model.linear(), runs[:count]) for count in (1, 2, 3))
        rows += [
            _bias_row(
                f"{name}, one run: the bias holds the tilt of the rail and the angle of the axis",
                one,
                LEVEL + AXIS_ANGLE,
            ),
            _bias_row(f"{name}, and one turned: the tilt is separated, the angle is not", turned, AXIS_ANGLE),
            _angle_row(name, all_three),
        ]
    return Item(
        name="alignment",
        title=f"Rail tilted by 0.05 deg, input axis off by 0.03 deg, runs of {SECONDS:g} s",
        source="II-A",
        rows=tuple(rows),
    )


def mounted(rng: np.random.Generator, rig: Rig) -> Sequence[Recording]:
    """A run in each mount, on a rail that is declared level and is not."""
    runs = []
    for mount in MOUNTS:
        declared = replace(rig, mount=mount)
        tilted = replace(declared, gravity_along_axis=STANDARD_GRAVITY * math.sin(LEVEL))
        made = simulate("tones", seconds=SECONDS, rig=tilted, parameters=SENSOR, rng=rng, a_rms=4.0)
        runs.append(replace(made.recording, rig=declared))
    return runs


def _bias_row(claim: str, fit: Fit, angle: float) -> Row:
    expected, error = STANDARD_GRAVITY * angle, fit["bias"].value - SENSOR["bias"]
    sigma = abs(error - expected) / fit["bias"].std
    return Row(
        by="us",
        claim=claim,
        expected=f"K0 off by {1e3 * expected:.2f} mm/s² = g0 {math.degrees(angle):.2g} deg",
        measured=f"{1e3 * error:.2f} ± {1e3 * fit['bias'].std:.1g} mm/s²",
        value=error,
        n=1,
        threshold=f"{LARGEST:g} sigma ({sigma:.1f})",
        holds=sigma < LARGEST,
        remark="0.05 deg of the level alone is 8.6 mm/s²" if angle > LEVEL else "",
    )


def _angle_row(name: str, fit: Fit) -> Row:
    truth = {"bias": SENSOR["bias"], "tilt": LEVEL, "misalignment": AXIS_ANGLE}
    worst = max(abs(fit[each].value - value) / fit[each].std for each, value in truth.items())
    tilt, axis = (
        f"{math.degrees(fit[each].value):.5f} ± {math.degrees(fit[each].std):.1g}" for each in list(truth)[1:]
    )
    return Row(
        by="us",
        claim=f"{name}, and one rolled: bias, tilt and angle of the axis are separate",
        expected="0.05 deg, 0.03 deg, K0 = 50 mm/s²",
        measured=f"{tilt} deg, {axis} deg, K0 {1e3 * fit['bias'].value:.3f} ± {1e3 * fit['bias'].std:.1g} mm/s²",
        value=worst,
        n=1,
        threshold=f"{LARGEST:g} sigma ({worst:.1f}), angles finer than a tenth of the level",
        holds=worst < LARGEST and max(fit["tilt"].std, fit["misalignment"].std) < 0.1 * LEVEL,
        remark="the rail must keep its tilt while the sensor is turned",
    )
