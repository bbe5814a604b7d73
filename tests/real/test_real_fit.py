"""Fits on real recordings, against figures found by an independent regression.

The recordings are not part of this repository: ACCELCAL_REAL_DATA names the folder that holds them.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from accelcal.estimation.estimate import Fit, estimate
from accelcal.model import Model
from accelcal.validation.evaluation import compare

from .recordings import recording

BEFORE_IMPACT = {"start": 0.005, "end": 0.185}
"""Extension, then retraction, before the water is touched, s."""
BAND = 300.0


@cache
def impactor(trial: int, band: float | None) -> Fit:
    return estimate(Model.linear(), recording(f"cyberdiver_ext_ret_trial{trial}"), band=band, **BEFORE_IMPACT)


def figures(fit: Fit) -> str:
    return ", ".join(f"{e.name} {e.value:.6g} +- {e.std:.2g}" for e in fit.estimates)


@pytest.mark.parametrize("trial", [1, 2])
def test_mass_ratio_and_delay_of_the_impactor(trial: int) -> None:
    result = impactor(trial, None)
    print(f"trial {trial}: {figures(result)}; {result.remarks}")
    assert result.values().scale == pytest.approx(0.227, abs=0.004)
    assert abs(result["time_offset"].value) == pytest.approx(0.27e-3, abs=0.03e-3)
    assert any("not white" in remark.sentence for remark in result.remarks)  # a sensor on a shaken body


@pytest.mark.parametrize("trial", [1, 2])
def test_mass_ratio_in_the_band_of_the_motion(trial: int) -> None:
    result = impactor(trial, BAND)
    print(f"trial {trial}, {BAND:g} Hz: {figures(result)}")
    assert result.values().scale == pytest.approx(0.2268, abs=0.001)
    assert abs(result["time_offset"].value) == pytest.approx(0.27e-3, abs=0.03e-3)


def test_one_trial_predicts_the_other() -> None:
    first, second = impactor(1, BAND), recording("cyberdiver_ext_ret_trial2")
    comparison = compare(first, second, band=BAND, **BEFORE_IMPACT)
    print(f"trial 1 on trial 2, {comparison.band:g} Hz: residual {comparison.accel_rms:.3f} m/s²")
    assert comparison.band == BAND
    assert comparison.accel_rms <= 0.30  # independent regression: 0.265


def test_without_its_delay_the_prediction_is_five_times_worse() -> None:
    blind = estimate(
        Model.linear().freeze(time_offset=0.0), recording("cyberdiver_ext_ret_trial1"), band=BAND, **BEFORE_IMPACT
    )
    comparison = compare(blind, recording("cyberdiver_ext_ret_trial2"), band=BAND, **BEFORE_IMPACT)
    print(f"without time_offset: residual {comparison.accel_rms:.3f} m/s²")
    assert comparison.accel_rms == pytest.approx(1.49, rel=0.1)  # independent regression with scale and bias alone


@pytest.mark.parametrize(
    "name", ["rocket_gw1_nosecone", "rocket_gw1_airbrakes_bay", "rocket_jackpot4", "broad_trial15"]
)
def test_hard_recordings_fit_and_say_what_was_assumed(name: str) -> None:
    fit = estimate(Model.linear(), recording(name))
    print(f"{name}: {figures(fit)}")
    for sentence in (*fit.rig.assumptions, *(remark.sentence for remark in fit.remarks)):
        print(f"  {sentence}")
    assert all(math.isfinite(e.value) and e.std > 0.0 for e in fit.estimates)
    assert np.all(np.linalg.eigvalsh(fit.covariance / np.outer(*[np.sqrt(np.diag(fit.covariance))] * 2)) > 0.0)
    assert fit.rig.assumptions
    assert fit.remarks  # neither barometer nor hand-held board is what the model describes
    assert 0.5 < fit.values().scale < 1.5
