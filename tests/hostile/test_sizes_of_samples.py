"""Samples of any size in either channel: a fit, or a sentence that names the recording; never an error of accelcal."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal._support import errors
from accelcal.data.recording import Recording
from accelcal.simulation import CXL02_RIG

from .case import LONG

SIZES = [10.0**power for power in (range(-300, 308, 8) if LONG else (-300, -40, 20, 60, 99, 200, 308))]


@pytest.fixture(scope="module")
def recording() -> Recording:
    rng = np.random.default_rng(1)
    return ac.simulate("interleaved", seconds=6.0, rig=CXL02_RIG, parameters={"bias": 0.05}, rng=rng).recording


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("channel", ["accel", "position"])
@pytest.mark.parametrize("size", SIZES)
def test_samples_of_any_size_are_fitted_or_refused_with_a_sentence(
    recording: Recording, channel: str, size: float
) -> None:
    given = getattr(recording, channel)
    scaled = dataclasses.replace(given, y=given.y / float(np.max(np.abs(given.y))) * size)
    try:
        fit = ac.fit(dataclasses.replace(recording, **{channel: scaled}), reject_outliers=False)
    except Exception as error:
        if not errors.is_for_user(error):
            raise
    else:
        assert all(np.isfinite(estimate.value) for estimate in fit.estimates)
