"""The paper's claim of a simpler test (abstract, I): tumble, vibration test and motion by what they cost and reach.

A tumble of 24 dwells turns the sensor in gravity (IEEE 1293); its uncertainty is that of noise, bias and angles. A
vibration test takes the mean of the output under a sine, which K2 rectifies. Each is simulated for both sensors and
fitted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from accelcal.data.rig import Rig
from accelcal.effects import polynomial
from accelcal.estimation.estimate import Fit, estimate, estimate_dwells
from accelcal.experiment.drift_bandwidth import DWELL, DWELLS, TURN, tumble
from accelcal.model import Model
from accelcal.paper.rows import Item, Plan, Row
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, simulate

SECONDS = 60.0
"""Of the motion."""
LEVEL, HEAD = math.radians(0.05), math.radians(0.001)
"""Angles as the paper levels its rig, and of a dividing head of 3.6 arc seconds."""
TRUTH = {"bias": 0.05, "scale_factor": 0.01, **dict(zip(polynomial(3), (1e-4, 1e-5), strict=True))}
AMPLITUDE = 15.0
"""Of the vibration test, m/s²."""
SHAKEN = 60.0
"""Its length, s."""
LARGEST = 4.0
"""Standard deviations that an error of one of these fits may have."""
RIGS = {"ADXL105": ADXL105_RIG, "CXL02": CXL02_RIG}
SYMBOLS = dict(zip(TRUTH, ("K0", "k", "K2", "K3"), strict=True))


@dataclass(frozen=True, slots=True)
class Tests:
    """One sensor by every test."""

    rough: Fit
    """Tumble with angles as the paper levels its rig."""
    fine: Fit
    """Tumble on a dividing head."""
    motion: Fit
    both: Fit
    """The motion with the dividing head."""


def standard_tests_item(plan: Plan) -> Item:
    """What tumble, vibration test and motion need and reach."""
    rows: list[Row] = []
    for name, rig in RIGS.items():
        found = plan.repeat(f"standard tests {name}", 1, lambda rng, rig=rig: tested(rng, rig))[0]  # type: ignore[misc]
        rows += [parameter_row(name, found, each) for each in TRUTH]
        rows += [angle_row(name, rig, found), vibration_row(name, rig, found)]
    return Item(
        name="standard_tests",
        title=f"Tumble of {DWELLS} dwells of {DWELL:g} s, motion of {SECONDS:g} s, both in one fit",
        source="abstract, I",
        rows=tuple(rows),
    )


def tested(rng: np.random.Generator, rig: Rig) -> Tests:
    """One sensor through all tests."""
    plain = replace(rig, lowpass=None)
    run = simulate("tones", seconds=SECONDS, rig=plain, parameters=TRUTH, rng=rng).recording
    rough, fine = (tumble(TRUTH, plain, angle_std=angle, rng=rng) for angle in (LEVEL, HEAD))
    model = Model.cubic()
    return Tests(
        rough=estimate_dwells(model, rough),
        fine=estimate_dwells(model, fine),
        motion=estimate(model, run),
        both=estimate(model, run.with_dwells(fine)),
    )


def parameter_row(name: str, found: Tests, each: str) -> Row:
    """Uncertainty of one parameter by every test, and whether all of them hold the truth."""
    fits = (found.rough, found.fine, found.motion, found.both)
    std = [fit[each].std for fit in fits]
    worst = max(abs(fit[each].value - TRUTH[each]) / fit[each].std for fit in fits)
    minutes = DWELLS * (DWELL + TURN) / 60.0
    unit = found.motion[each].unit.removeprefix("1")
    return Row(
        by="us",
        claim=f"{name}, {SYMBOLS[each]}: a motion and a tumble together are as certain as the better of the two",
        expected=f"within {LARGEST:g} standard deviations of the truth",
        measured=(
            f"tumble {minutes:.0f} min: {std[0]:.2g} (angles 0.05 deg), {std[1]:.2g} (0.001 deg); motion "
            f"{SECONDS / 60.0:g} min: {std[2]:.2g}; both {std[3]:.2g} {unit}; largest error {worst:.1f} sigma"
        ),
        value=std[2] / std[1],
        n=len(fits),
        threshold=f"errors below {LARGEST:g} sigma; u(both) <= 1.05 of the less",
        holds=bool(worst < LARGEST and (std[3] <= 1.05 * min(std[1], std[2]) or each == "bias")),
        remark="a level motion shows K0 + g tilt, which the tumble separates" if each == "bias" else "",
    )


def angle_row(name: str, rig: Rig, found: Tests) -> Row:
    """The paper's claim for the scale factor: how exact the angles of a tumble must be to reach the motion."""
    wanted = found.motion["scale_factor"].std
    plain = replace(rig, lowpass=None)

    def missed(log_angle: float) -> float:
        dwells = tumble(TRUTH, plain, angle_std=math.exp(log_angle))
        return math.log(estimate_dwells(Model.cubic(), dwells)["scale_factor"].std / wanted)

    ends = math.log(math.radians(1e-5)), math.log(math.radians(5.0))
    possible = missed(ends[0]) < 0.0
    degrees = math.degrees(math.exp(scipy.optimize.brentq(missed, *ends, xtol=1e-3))) if possible else 0.0
    minutes = DWELLS * (DWELL + TURN) / 60.0
    return Row(
        by="paper",
        claim=f"{name}: a simpler alternative to tumble tests",
        expected=f"u(k) of a tumble in {SECONDS / 60.0:g} min without known angles",
        measured=f"u(k) = {wanted:.2g}; a tumble of {minutes:.0f} min needs angles to {degrees:.2g} deg for it",
        value=degrees,
        n=1,
        threshold="less time than the tumble, whose angles are better than 0.05 deg",
        holds=degrees < math.degrees(LEVEL),
        remark="one uncertainty for all angles, independent from dwell to dwell; the zero of the angles is estimated",
    )


def vibration_row(name: str, rig: Rig, found: Tests) -> Row:
    """K2 from the mean of a vibration test: mean = K0 + K2 A²/2."""
    noise = rig.sensor.noise or 0.0
    std = math.sqrt(2.0) * math.sqrt(0.5 * noise**2 / SHAKEN) * 2.0 / AMPLITUDE**2  # with and without vibration
    quadratic = polynomial(2)[0]
    motion = found.motion[quadratic].std
    rng = np.random.default_rng(1)
    t = np.arange(0.0, SHAKEN, 1e-3)
    a = AMPLITUDE * np.sin(2.0 * np.pi * 80.0 * t)
    K0, k, K2, K3 = TRUTH.values()
    white = noise * math.sqrt(0.5 / 1e-3)
    shaken = np.mean(K0 + (1.0 + k) * a + K2 * a**2 + K3 * a**3 + white * rng.standard_normal(len(t)))
    still = np.mean(K0 + white * rng.standard_normal(len(t)))
    estimated = 2.0 * float(shaken - still) / AMPLITUDE**2
    sigma = abs(estimated - K2) / std
    return Row(
        by="us",
        claim=f"{name}, K2: the mean of a vibration test, K0 + K2 A²/2",
        expected=f"K2 = {K2:g} within {LARGEST:g} standard deviations",
        measured=f"{estimated:.3g} ± {std:.1g} after 2 x {SHAKEN:g} s at {AMPLITUDE:g} m/s²; motion ± {motion:.1g}",
        value=estimated,
        n=1,
        threshold=f"below {LARGEST:g} sigma ({sigma:.1f})",
        holds=sigma < LARGEST,
        remark="it takes a bias that does not change between shaking and rest",
    )
