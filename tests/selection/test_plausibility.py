"""No correction is larger than what it corrects: full scale at the output, a share of the travel at the encoder."""

import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel
from accelcal.diagnosis.findings import Size
from accelcal.diagnosis.select.collinearity import implausible, unconfirmed, undetermined
from accelcal.estimation.estimate import result, solve_runs
from accelcal.simulation import CXL02_RIG


@pytest.fixture(scope="module")
def recording():
    t = np.linspace(0.0, 10.0, 1001)
    position = Channel("position", t, 0.05 * np.sin(t), "m")  # 0.1 m of travel
    rig = CXL02_RIG
    return ac.Recording(Channel("accel", t, np.sin(t), "m/s²"), position, rig)


def test_a_contribution_beyond_the_declared_range_is_no_finding(recording):
    full = recording.rig.sensor.range
    assert implausible("bias_gauss_markov", Size(0.9 * full), [recording]) is None
    note = implausible("bias_gauss_markov", Size(1.1 * full), [recording])
    assert note is not None
    assert note.code == "implausible"
    assert "more than the declared range" in note.sentence


def test_without_a_declared_range_the_span_of_the_readings_counts(recording):
    sensor = dataclasses.replace(recording.rig.sensor, range=None)
    bare = dataclasses.replace(recording, rig=dataclasses.replace(recording.rig, sensor=sensor))
    assert implausible("rail_wave", Size(1.9), [bare]) is None
    assert implausible("rail_wave", Size(2.1), [bare]) is not None
    assert implausible("rail_wave", Size(2.1), [recording]) is None


def test_a_sensor_on_a_vertical_axis_reads_at_least_gravity(recording):
    sensor = dataclasses.replace(recording.rig.sensor, range=None)
    accel = dataclasses.replace(recording.accel, y=recording.accel.y + 9.8)
    upright = dataclasses.replace(recording, accel=accel, rig=dataclasses.replace(recording.rig, sensor=sensor))
    assert implausible("quadratic", Size(10.7), [upright]) is None  # the readings span 2 m/s²
    assert implausible("quadratic", Size(10.9), [upright]) is not None


@pytest.mark.parametrize("name", ["encoder_cyclic", "encoder_nonlinearity", "encoder_backlash"])
def test_an_error_of_the_scale_beyond_a_tenth_of_the_travel_is_no_finding(recording, name):
    assert implausible(name, Size(0.009, at_encoder=True), [recording]) is None
    assert implausible(name, Size(0.011, at_encoder=True), [recording]) is not None


@pytest.mark.parametrize("name", ["encoder_step", "encoder_lag"])
def test_a_lost_zero_and_a_lag_are_no_errors_of_the_scale(recording, name):
    assert implausible(name, Size(0.05, at_encoder=True), [recording]) is None


@pytest.fixture(scope="module")
def plain_and_curved():
    rng = np.random.default_rng(4)
    truth = {"bias": 0.05, "scale_factor": 0.01}
    plain = ac.simulate("interleaved", seconds=20.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording
    accel = plain.accel
    return plain, dataclasses.replace(plain, accel=dataclasses.replace(accel, y=accel.y + 4e-3 * accel.y**3))


def test_what_explains_no_more_than_chance_has_no_size(plain_and_curved):
    plain, curved = plain_and_curved
    model = ac.Model.linear().add("cubic")
    assert undetermined("cubic", solve_runs(model, [curved])) is None
    with_lag = ac.Model.linear().add("sensor_lag", shapes={"sensor_lag": {"tau": 1e-4}})
    note = undetermined("sensor_lag", solve_runs(with_lag, [plain]))
    assert note is not None
    assert note.code == "undetermined"
    assert "no more than chance" in note.sentence


def test_an_effect_that_its_own_fit_does_not_confirm_is_no_finding(plain_and_curved):
    """Significant means: over all that were examined, and by the uncertainty of the fit that has the effect."""
    plain, curved = plain_and_curved
    fitted = result(solve_runs(ac.Model.linear().add("cubic"), [curved]))
    assert unconfirmed("cubic", fitted, 200, 0.01) is None
    by_chance = result(solve_runs(ac.Model.linear().add("cubic"), [plain]))
    note = unconfirmed("cubic", by_chance, 200, 0.01)
    assert note is not None
    assert note.code == "unconfirmed"
    assert "among 200 candidates" in note.sentence
