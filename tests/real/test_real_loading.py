"""The real recordings load under their sidecars; figures come from the data's own description.

The recordings are not part of this repository: ACCELCAL_REAL_DATA names the folder that holds them.
"""

import numpy as np
import pytest

from accelcal.data.quality import describe, summarise

from .recordings import HERE, recording as real


@pytest.mark.parametrize("name", sorted(path.stem for path in HERE.glob("*.toml")))
def test_real_recording_loads_and_is_described(name):
    recording = real(name)
    assert len(recording.accel) > 1000
    assert len(recording.position) > 1000
    assert recording.rig.assumptions
    assert describe(recording)["channels"]["accel"]["rate_hz"] > 45  # the slowest, a seismic station, has 50 Hz
    print(summarise(recording))


@pytest.mark.parametrize(
    "name", ["cyberdiver_ext_ret_trial1", "cyberdiver_ext_ret_trial2", "cyberdiver_15npmm_6mps_trial1"]
)
def test_rate_of_the_sensor_is_recovered_from_held_repeats(name):
    recording = real(name)
    assert "held_repeats" in [finding.kind for finding in recording.findings if finding.channel == "accel"]
    rate = describe(recording)["channels"]["accel"]["rate_hz"]
    assert rate == pytest.approx(26_667, rel=0.015)  # ODR of the data sheet, which allows its clock a few percent
    assert describe(recording)["channels"]["position"]["rate_hz"] == pytest.approx(50_000, rel=1e-6)


@pytest.mark.parametrize("name", ["broad_trial10", "broad_trial15"])
def test_blanked_reference_samples_become_gaps(name):
    recording = real(name)
    assert len(recording.position) < len(recording.accel)
    kinds = [finding.kind for finding in recording.findings]
    assert [kind for kind in kinds if kind != "unused_columns"] == ["orientation", "gap"]
    assert 9.0 < np.median(recording.accel.y) < 10.5  # the sensor's z axis points up


@pytest.mark.parametrize("name", ["rocket_gw1_nosecone", "rocket_gw1_airbrakes_bay", "rocket_jackpot4"])
def test_height_of_a_rocket_is_warned_about_and_kept(name):
    recording = real(name)
    assert "implausible_travel" in [finding.kind for finding in recording.findings]
    assert recording.side["temperature"].unit == "degC"
    assert recording.rig.gravity == 9.80665
