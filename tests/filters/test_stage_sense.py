"""Parameters as a filter sees them on its stage, and back: for every mount, also of the powers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.estimation.estimate import estimate
from accelcal.filters.choice import FilterChoice, to_stage
from accelcal.model import Model
from accelcal.simulation import ADXL105_RIG


def test_the_sense_of_the_stage_is_that_of_the_polynomial() -> None:
    names, rng = ("k", "K0", "K2", "K3"), np.random.default_rng(1)
    theta, polarity, gravity = rng.normal(size=4), -1.0, 9.8
    k, K0, K2, K3 = theta
    a = rng.normal(size=50)
    f = polarity * (a + gravity)
    output = polarity * (K0 + (1 + k) * f + K2 * f**2 + K3 * f**3) - gravity
    kk, KK0, KK2, KK3 = to_stage(names, polarity, gravity) @ theta
    assert output == pytest.approx(KK0 + (1 + kk) * a + KK2 * a**2 + KK3 * a**3)


@pytest.mark.parametrize("placed", [{}, {"mount": "reversed"}, {"axis": "up"}, {"axis": "down", "mount": "reversed"}])
def test_a_cubic_filter_agrees_with_the_replay_however_the_sensor_is_mounted(placed: dict[str, str]) -> None:
    rig = replace(ADXL105_RIG, **placed)  # type: ignore[arg-type]
    truth = {"bias": 0.05, "scale_factor": 0.01, "quadratic": 2e-3, "cubic": 1e-4}
    rng = np.random.default_rng(1)
    recording = ac.simulate("tones", seconds=20.0, rig=rig, parameters=truth, rng=rng).recording
    replayed = estimate(Model.cubic(), recording)
    filtered = ac.fit(recording, method=FilterChoice("aci", "cubic", interpolation="cubic"))
    for name in truth:
        apart = (filtered[name].value - replayed[name].value) / replayed[name].std
        print(f"{placed} {name}: {filtered[name].value:.5g}, replay {replayed[name].value:.5g}, {apart:.2f} std")
        # Both see the same record; they differ by what the noisy regressor and the start cost.
        assert abs(apart) < 2.0, name
