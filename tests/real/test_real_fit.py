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


def figures(found: Fit) -> str:
    return ", ".join(f"{e.name} {e.value:.6g} +- {e.std:.2g}" for e in found.estimates)


@pytest.mark.parametrize("trial", [1, 2])
def test_mass_ratio_and_delay_of_the_impactor(trial: int) -> None:
    found = impactor(trial, None)
    print(f"trial {trial}: {figures(found)}; {found.remarks}")
    assert found.values().scale == pytest.approx(0.227, abs=0.004)
    assert abs(found["time_offset"].value) == pytest.approx(0.27e-3, abs=0.03e-3)
    assert any("not white" in remark.sentence for remark in found.remarks)  # a sensor on a shaken body


@pytest.mark.parametrize("trial", [1, 2])
def test_mass_ratio_in_the_band_of_the_motion(trial: int) -> None:
    found = impactor(trial, BAND)
    print(f"trial {trial}, {BAND:g} Hz: {figures(found)}")
    assert found.values().scale == pytest.approx(0.2268, abs=0.001)
    assert abs(found["time_offset"].value) == pytest.approx(0.27e-3, abs=0.03e-3)


def test_one_trial_predicts_the_other() -> None:
    first, second = impactor(1, BAND), recording("cyberdiver_ext_ret_trial2")
    found = compare(first, second, band=BAND, **BEFORE_IMPACT)
    print(f"trial 1 on trial 2, {found.band:g} Hz: residual {found.accel_rms:.3f} m/s²")
    assert found.band == BAND
    assert found.accel_rms <= 0.30  # independent regression: 0.265


def test_without_its_delay_the_prediction_is_five_times_worse() -> None:
    blind = estimate(
        Model.linear().freeze(time_offset=0.0), recording("cyberdiver_ext_ret_trial1"), band=BAND, **BEFORE_IMPACT
    )
    found = compare(blind, recording("cyberdiver_ext_ret_trial2"), band=BAND, **BEFORE_IMPACT)
    print(f"without time_offset: residual {found.accel_rms:.3f} m/s²")
    assert found.accel_rms == pytest.approx(1.49, rel=0.1)  # independent regression with scale and bias alone


@pytest.mark.parametrize(
    "name", ["rocket_gw1_nosecone", "rocket_gw1_airbrakes_bay", "rocket_jackpot4", "broad_trial15"]
)
def test_hard_recordings_fit_and_say_what_was_assumed(name: str) -> None:
    found = estimate(Model.linear(), recording(name))
    print(f"{name}: {figures(found)}")
    for sentence in (*found.rig.assumptions, *(one.sentence for one in found.remarks)):
        print(f"  {sentence}")
    assert all(math.isfinite(e.value) and e.std > 0.0 for e in found.estimates)
    assert np.all(np.linalg.eigvalsh(found.covariance / np.outer(*[np.sqrt(np.diag(found.covariance))] * 2)) > 0.0)
    assert found.rig.assumptions
    assert found.remarks  # neither barometer nor hand-held board is what the model describes
    assert 0.5 < found.values().scale < 1.5
