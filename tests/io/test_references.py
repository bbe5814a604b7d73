"""Files whose motion is told by a velocity or an acceleration."""

import numpy as np
import pytest

import accelcal as ac
from accelcal import io
from accelcal.simulation import CXL02_RIG


def table(path, *columns):
    names, values = zip(*columns, strict=True)
    rows = np.column_stack(values)
    path.write_text(",".join(names) + "\n" + "\n".join(",".join(f"{y!r}" for y in row) for row in rows.tolist()) + "\n")
    return path


@pytest.fixture
def moved():
    t = np.arange(0.0, 2.0, 1e-3)
    return t, 0.1 * np.sin(10.0 * t), np.cos(10.0 * t), -10.0 * np.sin(10.0 * t)


@pytest.mark.parametrize(
    ("name", "place", "factor"), [("velocity [mm/s]", 2, 1e3), ("reference_acceleration_g", 3, 1 / 9.80665)]
)
def test_the_position_is_the_integral_of_the_reference(tmp_path, moved, name, place, factor):
    t, p, v, a = moved
    run = io.load(table(tmp_path / "run.csv", ("t_s", t), ("accel_m_per_s2", a), (name, factor * moved[place])))
    assert run.reference is not None
    assert np.allclose(run.reference.y, moved[place], rtol=1e-12)
    start = v[0] if place == 3 else 0.0  # an acceleration does not tell the speed at the start
    assert np.allclose(run.position.y + start * t, p, atol=1e-9)
    assert any(finding.kind == "integrated" for finding in run.findings)


def test_beside_a_position_a_velocity_is_a_side_channel(tmp_path, moved):
    t, p, v, a = moved
    run = io.load(
        table(tmp_path / "run.csv", ("t_s", t), ("accel_m_per_s2", a), ("position_m", p), ("velocity_m_per_s", v))
    )
    assert run.reference is None
    assert "velocity" in run.side


def test_what_a_sidecar_declares_is_the_reference_though_a_position_is_there(tmp_path, moved):
    t, p, v, a = moved
    path = table(tmp_path / "run.csv", ("t_s", t), ("accel_m_per_s2", a), ("position_m", p), ("lv", v))
    (tmp_path / "run.toml").write_text('[channels]\nvelocity = { column = "lv", unit = "m/s" }\n')
    assert io.load(path).reference is not None


def test_an_angle_is_refused_in_a_sentence(tmp_path, moved):
    t, _, v, a = moved
    path = table(tmp_path / "run.csv", ("t_s", t), ("accel_m_per_s2", a), ("lv", v))
    (tmp_path / "run.toml").write_text('[channels]\nvelocity = { column = "lv", unit = "rad/s" }\n')
    with pytest.raises(ac.RecordingError, match=r"velocity is in rad/s; expected m/s"):
        io.load(path)


def test_a_reference_is_written_and_read_back(tmp_path):
    settings = {"seconds": 4.0, "rig": CXL02_RIG, "parameters": {}, "rng": np.random.default_rng(3)}
    recording = ac.simulate("tones", reference="velocity", **settings).recording
    path = tmp_path / "run.csv"
    io.write_sidecar(recording.rig, io.write_csv(recording, path), io.sidecar_of(path))
    again = io.load(path)
    assert np.array_equal(again.reference.y, recording.reference.y)
    assert np.allclose(again.position.y, recording.position.y, rtol=0.0, atol=1e-15)


def test_arrays_may_be_a_velocity(moved):
    t, p, v, a = moved
    run = ac.Recording.from_arrays(t, a, v, units={"accel": "m/s^2", "velocity": "m/s"}, reference="velocity")
    assert np.allclose(run.position.y, p, atol=1e-9)
    with pytest.raises(ac.RecordingError, match="no unit"):
        ac.Recording.from_arrays(t, a, v, units={"accel": "m/s^2"}, reference="velocity")


def test_a_live_filter_refuses_what_it_would_take_for_a_position():
    settings = {"seconds": 4.0, "rig": CXL02_RIG, "parameters": {}, "rng": np.random.default_rng(3)}
    recording = ac.simulate("tones", reference="velocity", **settings).recording
    with pytest.raises(ac.RecordingError, match="reads positions, and here is velocity"):
        ac.fit(recording, method=ac.FilterChoice("aci", "linear"))


def test_two_loggers_keep_the_reference(tmp_path):
    settings = {"seconds": 20.0, "rig": CXL02_RIG, "parameters": {}, "rng": np.random.default_rng(3)}
    recording = ac.simulate("interleaved", reference="velocity", **settings).recording
    t, v = recording.reference.t, recording.reference.y
    output = table(tmp_path / "output.csv", ("t_s", recording.accel.t), ("accel_m_per_s2", recording.accel.y))
    motion = table(tmp_path / "motion.csv", ("t_s", t + 3.0), ("velocity_m_per_s", v))
    run = io.load(output, position=motion)
    assert np.array_equal(run.reference.y, v)
    assert run.accel.t[0] == pytest.approx(3.0 + recording.accel.t[0], abs=2e-3)
