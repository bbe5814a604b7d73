"""A sensor that turns is noticed by its slow residual; what another effect explains, or a bias may do, is not.

A stretch that something disturbed is named as such, and a drift of the bias beside the tilt that looks like it.
"""

import ast
import dataclasses
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal import io
from accelcal.data.rig import STANDARD_GRAVITY, Rig, Sensor
from accelcal.diagnosis.checks import output_noise, stretches_of, tilt
from accelcal.io.sidecar import read_sidecar
from accelcal.io.write import write_sidecar
from accelcal.simulation import ADXL105_RIG, CXL02_RIG

from ..real.recordings import file_of

ROOT = Path(__file__).parents[2]


def record(seed=5, seconds=16.0, rig=CXL02_RIG, **more):
    rng = np.random.default_rng(seed)
    truth = {"bias": 0.05, "scale_factor": 0.01, **more}
    return ac.simulate("interleaved", seconds=seconds, rig=rig, parameters=truth, rng=rng).recording


def turned(recording, degrees, seed=6, slow=0.3, fast=1.5):
    """The output of a sensor that turns by so many degrees rms about level, between two frequencies."""
    rng, accel = np.random.default_rng(seed), recording.accel
    t = np.arange(accel.t[0], accel.t[-1] + 0.01, 0.01)
    f = np.fft.rfftfreq(len(t), 0.01)
    angle = np.fft.irfft(np.where((f > slow) & (f < fast), np.fft.rfft(rng.standard_normal(len(t))), 0.0), len(t))
    angle *= np.radians(degrees) / np.std(angle)
    y = accel.y + STANDARD_GRAVITY * np.sin(np.interp(accel.t, t, angle))
    return dataclasses.replace(recording, accel=dataclasses.replace(accel, y=y))


def codes(result):
    return [remark.code for remark in result.diagnosis.remarks]


@pytest.mark.parametrize("degrees", [0.4, 3.0])
def test_a_turning_sensor_is_said_with_its_tilt_and_nothing_is_named(degrees):
    improvement = ac.improve(turned(record(), degrees))
    assert (improvement.verdict, improvement.diagnosis.verdict) == ("unexplained", "unexplained")
    assert (improvement.effects, improvement.detected) == ((), ())
    note = improvement.diagnosis.remarks[0]
    assert note.code == "turning_sensor"
    # Ten seconds of 0.3 to 1.5 Hz have twenty-five independent angles: 16 % of scatter.
    assert note.values["tilt_deg"] == pytest.approx(degrees, rel=0.6)
    assert improvement.sentence.startswith("A tilt of ")
    assert (
        "degrees rms or a slow drift of either channel would explain all of it; orientation is not"
        in improvement.sentence
    )


def test_a_tilt_below_the_bias_instability_is_none():
    tilted = turned(record(), 0.4)  # 0.07 m/s² rms
    lax = dataclasses.replace(tilted.rig, sensor=dataclasses.replace(tilted.rig.sensor, bias_instability=0.2))
    assert "turning_sensor" not in codes(ac.improve(dataclasses.replace(tilted, rig=lax), most=0))
    assert "turning_sensor" not in codes(ac.improve(turned(record(), 0.02), most=0))


@pytest.mark.parametrize("recorded", [True, False], ids=["of the sensor", "of another place"])
def test_a_drift_that_follows_a_recorded_temperature_is_no_tilt(recorded):
    # 14 K move bias and scale factor by more than the noise by far, on a motion to 13 Hz.
    rng, t = np.random.default_rng([3, 34]), np.arange(0.0, 60.0, 2e-3)
    w, size = 2.0 * np.pi * np.array([0.31, 0.87, 3.1, 8.3, 13.1]), np.array([0.11, 0.24, 3.0, 6.0, 8.0])
    sines = np.sin(np.outer(w, t) + rng.uniform(0.0, 6.0, (5, 1)))
    p, a, T = (size / w**2) @ sines, -size @ sines, 14.0 * (1.0 - np.exp(-t / 25.0))
    u = 0.1 + (1.01 + 2.5e-4 * T) * a + 6e-3 * T + 2e-3 * rng.standard_normal(len(t))
    z, thermometer = p + 2e-7 * rng.standard_normal(len(t)), 23.0 + 0.02 * rng.standard_normal(len(t))
    thermometer += T if recorded else 7.0 + 7.0 * np.sin(0.3 * t)
    units, rig = {"accel": "m/s^2", "position": "m", "temperature": "degC"}, Rig(axis="level")
    recording = ac.Recording.from_arrays(t, u, z, units=units, rig=rig, side={"temperature": thermometer})
    improvement = ac.improve(recording)
    members = {name for group in improvement.classes for name in group.members}
    assert ({"temperature_bias", "temperature_scale"} <= members) == recorded
    assert ("turning_sensor" in codes(improvement)) != recorded


def test_what_an_effect_of_the_motion_explains_is_named_as_ever():
    improvement = ac.improve(record(quadratic=0.02))  # far above the bias instability below 2 Hz
    assert improvement.effects[0] == "quadratic"
    assert "turning_sensor" not in codes(improvement)


def test_the_noise_of_a_poor_sensor_is_no_tilt():
    rig = dataclasses.replace(ADXL105_RIG, sensor=Sensor(noise=0.05))
    assert codes(ac.improve(record(rig=rig), most=0)) == []


def test_tilt_by_hand():
    assert tilt(STANDARD_GRAVITY * np.sin(np.radians(3.3)), Rig()) == pytest.approx(3.3)
    assert tilt(STANDARD_GRAVITY * (1 - np.cos(np.radians(20.0))), Rig(axis="up")) == pytest.approx(20.0)
    assert tilt(100.0, Rig()) == pytest.approx(90.0)
    t = np.arange(20_000) / 500.0
    y = 0.01 * np.random.default_rng(1).standard_normal(len(t))
    assert output_noise(Rig(), t, y) == pytest.approx(0.01 * np.sqrt(2.0 / 500.0), rel=0.05)


def test_the_key_is_read_and_written(tmp_path):
    path = tmp_path / "run.toml"
    path.write_text('[sensor]\nbias_instability = "100 ug"\n')
    rig = read_sidecar(path).rig
    assert rig.sensor.bias_instability == pytest.approx(100e-6 * STANDARD_GRAVITY)
    write_sidecar(rig, {}, tmp_path / "again.toml")
    assert read_sidecar(tmp_path / "again.toml").rig.sensor.bias_instability == rig.sensor.bias_instability


def rig_of_tones(seed, disturbed=lambda t: 0.0, *, reference="position", seconds=40.0):
    """One axis in five tones, with a term of time in the output; the reference is a position or an acceleration."""
    rng, t = np.random.default_rng([seed, 34]), np.arange(0.0, seconds, 1.0 / 250.0)
    size, w = np.array([30e-3, 8e-3, 3e-3, 1e-3, 5e-4]), 2.0 * np.pi * np.array([0.31, 0.87, 1.9, 3.7, 5.3])
    sines = np.sin(np.outer(w, t) + rng.uniform(0.0, 6.0, (5, 1)))
    p, a = size @ sines, -(size * w**2) @ sines
    u = 0.1 + 1.01 * a + disturbed(t) + 1e-3 * rng.standard_normal(len(t))
    channel = {"position": (p, 1e-6, "m"), "reference_acceleration": (a, 1e-3, "m/s^2")}[reference]
    z = channel[0] + channel[1] * rng.standard_normal(len(t))
    units = {"accel": "m/s^2", reference: channel[2]}
    return ac.Recording.from_arrays(t, u, z, units=units, reference=reference, rig=Rig(axis="level"), name="run.csv")


def touched(*instants):
    """What a cable leaves in the output that is touched at these instants, m/s²."""
    return lambda t: sum(0.7 * np.exp(-0.5 * ((t - at) / 0.2) ** 2) for at in instants)


def test_a_reference_that_feels_gravity_too_leaves_no_tilt():
    recording = rig_of_tones(1, lambda t: 0.06 * np.sin(0.2 * np.pi * t), reference="reference_acceleration")
    fit = ac.fit(recording)
    assert fit.tilt == 0.0
    assert not any("tilt" in note.sentence for note in fit.remarks)
    judged = ac.diagnose(fit, recording)
    assert not {"turning_sensor", "tilt_or_drift"} & {remark.code for remark in judged.remarks}
    assert judged.verdict != "adequate"
    same = ac.fit(rig_of_tones(1, lambda t: 0.06 * np.sin(0.2 * np.pi * t)))
    assert same.tilt > 0.0  # a position does not feel it


@pytest.mark.parametrize("instants", [(14.0,), (29.5,)])
def test_a_touched_cable_is_a_stretch_and_no_tilt(instants):
    recording = rig_of_tones(2, touched(*instants))
    result = ac.fit(recording)
    assert result.tilt == 0.0
    assert result.remarks[0].sentence.startswith("run.csv: something disturbed the record between ")
    judged = ac.improve(recording, holdout=recording)
    assert (judged.verdict, judged.effects) == ("adequate", ())
    note = next(remark for remark in judged.diagnosis.remarks if remark.code == "disturbed")
    assert note.sentence in judged.diagnosis.suspect
    ((begin, end),) = stretches_of(note)
    assert begin < instants[0] < end < begin + 2.5
    for name, truth in (("bias", 0.1), ("scale_factor", 0.01)):
        for fit in (result, judged.steps[-1].fit):
            assert abs(fit[name].value - truth) < 4.5 * fit[name].std
    # The call of the sentence works, and what it leaves is judged without it.
    stretches = note.sentence.partition("; without that: recording.without")[2]
    rest = recording.without(*ast.literal_eval(f"[{stretches[1:-1]}]"))
    assert ac.fit(rest)["bias"].value == pytest.approx(result["bias"].value, abs=1e-4)


def test_a_disturbance_that_lasts_or_recurs_is_none_of_a_few_stretches():
    for disturbed in (touched(3.0, 11.0, 19.0, 27.0, 35.0), lambda t: 0.1 * (np.abs(t - 20.0) < 5.0)):
        fit = ac.fit(rig_of_tones(3, disturbed))
        assert fit.remarks[0].sentence.startswith("A tilt of ")


@pytest.mark.parametrize(
    ("name", "drift"),
    [
        ("bias_drift", lambda t: 3e-3 * t),
        ("warm_up", lambda t: 0.3 * np.exp(-t / 5.0)),
    ],
)
def test_a_drift_of_the_bias_is_named_with_a_tilt_in_its_class(name, drift):
    recording = rig_of_tones(4, drift)
    judged = ac.diagnose(ac.fit(recording), recording)
    assert judged.effects[0] == name
    assert {name, "tilt"} <= set(judged.classes[0].members)
    assert "tilt_or_drift" in {remark.code for remark in judged.remarks}


def real(name, rig):
    return io.load(file_of(name), rig=rig)


def test_a_board_in_a_hand_turns(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(
        '[rig]\naxis = "level"\n[channels]\ntime = { column = "t", unit = "s" }\n'
        'accel = { column = "accel_y", unit = "m/s^2" }\n'
        'position = { column = "position_y", unit = "m" }\n'
    )
    whole = real("broad_trial15", path)
    improvement = ac.improve(whole.part(whole.position.t[0], float(np.mean(whole.position.t[[0, -1]]))))
    assert (improvement.verdict, improvement.effects) == ("unexplained", ())
    assert codes(improvement)[0] == "turning_sensor"


@pytest.mark.parametrize("name", ["15npmm_6mps_trial1", "ext_ret_trial1", "ext_ret_trial2"])
def test_an_impactor_is_late_and_its_relation_breaks(name):
    """The encoder reads the compression of a spring, a quarter of the way: no name stands beside such a scale."""
    rig = ROOT / "tests" / "real" / f"cyberdiver_{name}.toml"
    improvement = ac.improve(real(f"cyberdiver_{name}", rig))
    assert (improvement.verdict, improvement.effects) == ("unexplained", ())
    assert codes(improvement)[0] == "implausible_scale"
    assert len(improvement.diagnosis.breaks) == 1
    delay = improvement.best["time_offset"]
    assert 2e-4 < delay.value < 3.5e-4
    assert delay.value > 20.0 * delay.std


@pytest.mark.parametrize("name", ["rocket_gw1_airbrakes_bay", "rocket_gw1_nosecone", "rocket_jackpot4"])
def test_a_rocket_shows_no_effect_of_the_sensor(name):
    improvement = ac.improve(real(name, ROOT / "tests" / "real" / f"{name}.toml"))
    assert improvement.effects == ()
    assert improvement.verdict == "too_short" or improvement.diagnosis.suspect
