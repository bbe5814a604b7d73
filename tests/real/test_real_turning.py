"""Bodies that turn: orientation from a reference or a gyroscope, against figures of an independent regression.

The recordings are not part of this repository: ACCELCAL_REAL_DATA names the folder that holds them.
"""

from __future__ import annotations

import pytest

import accelcal as ac
from accelcal import io

from .recordings import file_of, recording

PART = 45.0
"""Of the record of three minutes, that is fitted and then held out, s."""
MOST_LEFT = {"broad_trial10": 0.15, "broad_trial15": 0.70}
"""Of the held-out residual below 10 Hz, m/s²; the regression leaves 0.11 of the slow one."""


@pytest.mark.parametrize(("name", "axis"), [("broad_trial10", "y"), ("broad_trial15", "x"), ("broad_trial15", "z")])
def test_the_published_orientation_gives_the_sensor_back(name: str, axis: str) -> None:
    whole = recording(name, f"turning/broad_{axis}")
    fit = ac.fit(whole.part(0.0, PART))
    left = ac.compare(fit, whole.part(PART, 2.0 * PART), band=10.0)[0].accel_rms
    print(f"{name} {axis}: {fit}; held out below 10 Hz: {left:.3f} m/s²")
    assert fit.tilt == 0.0
    assert abs(fit["scale_factor"].value) < 0.02
    assert left <= MOST_LEFT[name]
    if fit["time_offset"].std < 2e-4:  # a band below the motion's own tells no delay
        assert fit["time_offset"].value == pytest.approx(2.5e-3, abs=0.7e-3)


def test_a_gyroscope_takes_the_road_out_of_the_scale_factor() -> None:
    whole = recording("drive", "turning/car_gyroscope")
    fit = ac.fit(whole.part(0.0, 40.0))
    left = ac.compare(fit, whole.part(40.0, 60.0), band=1.0)[0].accel_rms
    print(f"car: {fit}; held out below 1 Hz: {left:.3f} m/s²")
    assert fit.values().scale == pytest.approx(0.99, abs=0.02)
    tilt = fit["gyroscope_tilt.1"]
    assert tilt.std < 0.6  # m/s² per rad; gravity is 9.81
    assert abs(abs(tilt.value) - 9.81) < 3.0 * tilt.std
    assert left <= 0.10


def test_without_it_tilt_comes_first() -> None:
    whole = recording("drive", "turning/car")
    fitted = ac.fit(whole)
    assert fitted.remarks[0].code == "slow_residual"
    assert fitted["scale_factor"].std > 0.02  # it knows that it does not know: 0.006 with the gyroscope
    improvement = ac.improve(whole)
    assert improvement.sentence.startswith("A tilt of")
    assert improvement.effects == ()


LEGS = {
    ("Left", "x"): (0.034, -9.0e-3),
    ("Left", "y"): (0.002, -9.0e-3),
    ("Right", "x"): (0.036, -8.5e-3),
    ("Right", "y"): (0.084, -9.0e-3),
    ("Right", "z"): (0.019, -8.5e-3),
}
"""Scale factor and delay, s, of an independent regression; those of the halves of left z differ by 0.085."""


@pytest.mark.parametrize(("side", "axis"), LEGS)
def test_two_accelerometers_in_one_housing_show_no_tilt(side: str, axis: str) -> None:
    file = file_of(f"{side}_Lower_Leg")
    whole = io.load(file, rig=file.with_name(f"{side}_Lower_Leg_{axis}.toml"))
    fit = ac.fit(whole)
    for name, expected in zip(("scale_factor", "time_offset"), LEGS[side, axis], strict=True):
        assert abs(fit[name].value - expected) < 3.0 * fit[name].std
    assert fit.tilt == 0.0
    judged = ac.diagnose(fit, whole)
    assert not {"turning_sensor", "tilt_or_drift", "disturbed"} & {remark.code for remark in judged.remarks}
    assert "held_samples" not in judged.effects
