"""What is written is read back bit for bit, and a file appears whole or not at all."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from accelcal import io
from accelcal.cli import write_recording
from accelcal.data import units
from accelcal.data.recording import Channel, Recording, RecordingError
from accelcal.data.rig import LowPass, Rig, Sensor, Uncertainty
from accelcal.io.sidecar import Clock, Source, read_sidecar

WRITERS = {"csv": io.write_csv, "parquet": io.write_parquet}


def recording(n=200, rig=None, **side):
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(0, 1, n))
    return Recording(
        accel=Channel("accel", t, rng.standard_normal(n), "m/s^2"),
        position=Channel("position", t[::2] + 1e-5, 1e-3 * rng.standard_normal(n // 2), "m"),
        rig=rig or Rig(),
        side={name: Channel(name, t[::10], rng.standard_normal(n // 10), unit) for name, unit in side.items()},
    )


def same(a, b):
    return a.name == b.name and a.unit == b.unit and np.array_equal(a.t, b.t) and np.array_equal(a.y, b.y)


@pytest.mark.parametrize("kind", WRITERS)
def test_channels_survive_writing_and_reading(tmp_path, kind):
    run = recording(temperature="degC", a_y="m/s^2", Shaft="rad/s", force="kg*m/s^2", ratio="1")
    path = tmp_path / f"run.{kind}"
    WRITERS[kind](run, path)
    back = io.load(path)
    assert same(run.accel, back.accel)
    assert same(run.position, back.position)
    assert list(run.side) == list(back.side)
    assert all(same(run.side[name], back.side[name]) for name in run.side)


@pytest.mark.parametrize("kind", WRITERS)
def test_record_without_position_is_written_without_one(tmp_path, kind):
    run = recording()
    empty = Channel("position", np.empty(0), np.empty(0), "m")
    path = tmp_path / f"run.{kind}"
    WRITERS[kind](dataclasses.replace(run, position=empty), path)
    assert len(io.load(path, need_position=False).position) == 0


RIG = Rig(
    sensor=Sensor('ADXL "105"\n', "µ12", 2.2e-3, 49.03, 0.0255, "V", 2.5),
    axis="up",
    mount="reversed",
    gravity_along_axis=9.7,
    offset_tolerance=1e-5,
    lowpass=LowPass(159.1, 0.05),
    resolution=1e-6,
    uncertainty=Uncertainty(1e-5, 1e-3, 2e-3),
    tolerance=0.01,
)


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(
    "rig", [RIG, dataclasses.replace(RIG, sensor=Sensor(scale=-104.4, scale_unit="count", zero=-3.0, noise=1e-3))]
)
def test_declared_rig_survives_writing_and_reading(tmp_path, kind, rig):
    run = recording(rig=rig, temperature="degC")
    path = tmp_path / f"run.{kind}"
    io.write_sidecar(rig, WRITERS[kind](run, path), io.sidecar_of(path))
    back = io.load(path)
    assert dataclasses.replace(back.rig, assumptions=()) == rig
    assert same(run.accel, back.accel)


def test_sizes_of_effects_go_with_a_part(tmp_path):
    sizes = {"cubic": "100 ug/g^3", "odd effect": "0.001"}
    path = tmp_path / "run.csv"
    run = dataclasses.replace(recording(), prior_sizes=sizes)
    write_recording(run.part(0.0, 0.1), path)
    assert io.load(path).prior_sizes == sizes


def test_round_numbers_stand_in_the_units_of_data_sheets(tmp_path):
    (tmp_path / "run.toml").write_text('[sensor]\nnoise = "225 ug/sqrt(Hz)"\nrange = "5 g"\n')
    rig = read_sidecar(tmp_path / "run.toml").rig
    io.write_sidecar(rig, {"position": Source("p", "m")}, tmp_path / "made.toml")
    text = (tmp_path / "made.toml").read_text()
    assert 'noise = "225 ug/sqrt(Hz)"\nrange = "5 g"\n' in text


@settings(max_examples=50, deadline=None)
@given(noise=st.floats(1e-7, 1e-1), full=st.floats(1e-2, 1e4), step=st.floats(1e-10, 1e-3))
def test_every_number_of_a_sidecar_survives(tmp_path_factory, noise, full, step):
    path = tmp_path_factory.mktemp("sidecar") / "made.toml"
    rig = dataclasses.replace(RIG, sensor=Sensor(noise=noise, range=full), resolution=step, tolerance=step)
    io.write_sidecar(rig, {"accel": Source("a", "m/s^2"), "position": Source("p", "m")}, path)
    assert read_sidecar(path).rig.sensor == rig.sensor
    assert (read_sidecar(path).rig.resolution, read_sidecar(path).rig.tolerance) == (step, step)


def test_assumptions_survive_writing_and_reading(tmp_path):
    path = tmp_path / "run.csv"
    columns = io.write_csv(recording(), path)
    for text in ("", '[sensor]\nscale = "0.25 V/g"\n[rig]\naxis = "level"\n', '[clock]\noffset_tolerance = "0 s"\n'):
        io.sidecar_of(path).write_text(text)
        before = io.load(path).rig
        io.write_sidecar(before, columns, io.sidecar_of(path))
        assert io.load(path).rig == before


def test_clocks_and_odd_names_survive_in_a_sidecar(tmp_path):
    channels = {
        "time": Clock(rate=1667.5),
        "accel": Source('the "a"', "g"),
        "position": Source("p", None, Clock("pt", "ms")),
        "room air": Source("T\t1", "degC"),
    }
    io.write_sidecar(Rig(), channels, tmp_path / "run.toml")
    back = read_sidecar(tmp_path / "run.toml")
    assert {"time": back.time, **back.channels} == channels


@settings(max_examples=50, deadline=None)
@given(st.floats(-units.LARGEST, units.LARGEST).filter(lambda x: abs(x) > 1e-300), st.sampled_from(list(WRITERS)))
def test_every_double_survives(tmp_path_factory, value, kind):
    pair = np.array([0.0, 1.0])
    run = Recording(
        Channel("accel", pair, np.array([0.0, value]), "m/s^2"), Channel("position", pair, pair, "m"), Rig()
    )
    path = tmp_path_factory.mktemp("double") / f"run.{kind}"
    WRITERS[kind](run, path)
    assert io.load(path).accel.y[1] == value


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(("name", "unit"), [("shaft_mm", "1"), ("temp", "degC")])
def test_name_that_would_be_read_as_something_else_is_refused(tmp_path, kind, name, unit):
    with pytest.raises(RecordingError, match=f'channel "{name}" in {unit} would be read back as'):
        WRITERS[kind](recording(**{name: unit}), tmp_path / f"run.{kind}")
    assert not list(tmp_path.iterdir())


def test_atomic_write_replaces_the_whole_file(tmp_path):
    target = tmp_path / "note.txt"
    io.atomic_write(target, "old and long")
    io.atomic_write(target, b"new")
    assert target.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [target]


def test_nothing_is_left_half_written(tmp_path):
    target = tmp_path / "note.txt"
    target.write_text("old")

    def fail():
        with io.atomic(target) as part:
            part.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]
