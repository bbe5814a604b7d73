"""The mapping of columns to the parts of an orientation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal import io
from accelcal.app import mapping
from accelcal.app.mapping import Choice

UNITS = {"time": "s", "accel": "m/s^2", "position_e": "m", "position_n": "m", "position_u": "m"}
COLUMNS = ("t", "a", "e", "n", "u", "qw", "qx", "qy", "qz")


def chosen() -> list[Choice]:
    names = (*UNITS, "q_w", "q_x", "q_y", "q_z")
    return [Choice(column, name, UNITS.get(name, "")) for column, name in zip(COLUMNS, names, strict=True)]


def test_place_and_attitude_are_mapped_by_hand(tmp_path: Path) -> None:
    t = np.arange(0.0, 2.0, 0.01)
    still, along = np.zeros_like(t), 0.1 * np.sin(7.0 * t)
    rows = np.column_stack([t, -4.9 * np.sin(7.0 * t), along, still, still, 1.0 + still, still, still, still])
    path = tmp_path / "run.csv"
    lines = [",".join(COLUMNS), *(",".join(f"{x:.9g}" for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    text = mapping.sidecar_from(io.template(path), chosen(), "x", "sensor to ENU")
    path.with_suffix(".toml").write_text(text)
    recording = io.load(path)
    np.testing.assert_allclose(np.diff(recording.position.y), np.diff(along), atol=1e-6)
    assert [c.channel for c in mapping.choices(COLUMNS, text, io.template(path))] == [c.channel for c in chosen()]
    # Mapped again without a word on the axis, everything stays.
    assert mapping.sidecar_from(text, chosen()) == text


def test_a_part_of_a_quaternion_or_no_direction_is_refused() -> None:
    with pytest.raises(ac.RecordingError, match="no column is q_z; an attitude needs q_w, q_x, q_y, q_z"):
        mapping.sidecar_from("", chosen()[:-1])
    with pytest.raises(ac.RecordingError, match='input axis "0, up": expected x, y, z or three numbers'):
        mapping.sidecar_from("", chosen(), "0, up", "sensor to ENU")
    with pytest.raises(ac.RecordingError, match="say what the quaternion maps: sensor to ENU, or ENU to sensor"):
        mapping.sidecar_from("", chosen(), "x")
    sidecar = mapping.sidecar_from("", chosen(), "0, 0.6, 0.8", "sensor to ENU")
    assert "input_axis = [0.0, 0.6, 0.8]" in sidecar


def test_an_angle_takes_the_place_of_a_position_and_asks_for_its_arm() -> None:
    options = [Choice("t", "time", "s"), Choice("a", "accel", "g"), Choice("enc", "angle", "deg")]
    assert mapping.unknown(options, '[rig]\narm = "?"\naxle = [0, 0, 1]\n') == ["rig.arm", "rig.input_axis"]
    changes = {"rig.arm": "200 mm", "rig.input_axis": "radial"}
    text = mapping.sidecar_from('[rig]\narm = "?"\naxle = [0, 0, 1]\n', options, changes=changes)
    assert not mapping.unknown(options, text)
    assert mapping.channels(text)["angle"] == ("enc", "deg")


GERMAN = ("Zeit [s]", "Ausgang [V]", "Weg [mm]")


def german(tmp_path: Path, columns: tuple[str, ...] = GERMAN) -> str:
    path = tmp_path / "messung.csv"
    rows = "".join(f"{0.01 * i:.2f};2,5;{i % 7}{';1' * (len(columns) - 3)}\n".replace(".", ",") for i in range(50))
    path.write_text(";".join(columns) + "\n" + rows, encoding="utf-8")
    return io.template(path)


def test_a_column_that_is_alone_with_its_kind_of_unit_gets_a_role(tmp_path: Path) -> None:
    template = german(tmp_path)
    result = mapping.choices(GERMAN, template, template)
    assert [(c.channel, c.unit) for c in result] == [("time", "s"), ("accel", "V"), ("position", "mm")]
    assert mapping.unknown(result, template) == ["the scale of the sensor"]
    text = mapping.sidecar_from(template, result, changes={"sensor.scale": "1.2 V/g", "sensor.zero": "2.5 V"})
    assert [mapping.declared(text, f"sensor.{key}") for key in ("scale", "zero", "noise")] == ["1.2 V/g", "2.5 V", ""]
    assert mapping.unknown(result, text) == []
    path = tmp_path / "messung.csv"
    path.with_suffix(".toml").write_text(text, encoding="utf-8")
    np.testing.assert_allclose(io.load(path).accel.y, 0.0, atol=1e-9)


def test_a_position_in_counts_asks_for_its_scale(tmp_path: Path) -> None:
    columns = ("Zeit [s]", "Ausgang [m/s^2]", "Weg [Inkr.]")
    template = german(tmp_path, columns)
    roles = mapping.choices(columns, template, template)
    assert mapping.unknown(roles, template) == ["the scale of position"]
    text = mapping.sidecar_from(template, roles, changes={"channels.position.scale": "1 um/count"})
    assert mapping.unknown(roles, text) == []
    path = tmp_path / "messung.csv"
    path.with_suffix(".toml").write_text(text, encoding="utf-8")
    assert io.load(path).position.y[1] == 1e-6


def test_two_columns_of_one_kind_and_what_was_declared_are_left_to_the_user(tmp_path: Path) -> None:
    columns = (*GERMAN, "Hub [mm]")
    template = german(tmp_path, columns)
    result = mapping.choices(columns, template, template)
    assert [c.channel for c in result[:2]] == ["time", "accel"]
    assert mapping.unknown(result, template) == ["the column of position", "the scale of the sensor"]
    declared = 'channels = { accel = { column = "Ausgang [V]", unit = "V" } }'
    assert "position" not in [c.channel for c in mapping.choices(GERMAN, declared, template)]


def test_first_lines_are_those_of_text_files_and_short(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(b"\xef\xbb\xbf" + b"x" * 9000 + b"\n" + b"a;\xb0\n" * 99)
    assert mapping.first_lines(path) == ["x" * mapping.FIRST_WIDTH]
    path.write_text("a,b\n" * 99)
    assert mapping.first_lines(path) == ["a,b"] * mapping.FIRST_LINES
    assert mapping.first_lines(tmp_path / "run.parquet") == []


def test_the_first_lines_of_an_old_logger_are_read_as_the_reader_does(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("Zeit;Temp (°C)\n0;23\n", encoding="latin-1")
    assert mapping.first_lines(tmp_path / "run.csv") == ["Zeit;Temp (°C)", "0;23"]


def test_a_sidecar_that_is_no_toml_declares_nothing_of_the_sensor() -> None:
    assert mapping.declared("[sensor\n", "sensor.scale") == ""
    assert mapping.declared("sensor = 3", "sensor.scale") == ""
    text = '[sensor]\nscale = "?"\nserial = 12'
    assert [mapping.declared(text, f"sensor.{key}") for key in ("scale", "serial")] == ["", "12"]


def test_what_the_form_declares_of_filter_encoder_and_axis_reaches_the_recording(tmp_path: Path) -> None:
    template = german(tmp_path)
    columns_chosen = mapping.choices(GERMAN, template, template)
    rig = {"sensor.model": "ADXL105", "sensor.scale": "0.25 V/g", "sensor.zero": "2.5 V", "rig.axis": "up"}
    low_pass = mapping.LowPassEntry("RC", "500 Hz").changed(template)
    text = mapping.sidecar_from(template, columns_chosen, changes=rig | {mapping.RESOLUTION: "0.1 um"} | low_pass)

    def read(text: str) -> ac.Recording:
        (tmp_path / "messung.toml").write_text(text, encoding="utf-8")
        return io.load(tmp_path / "messung.csv")

    rig_read = read(text).rig
    assert (rig_read.sensor.model, rig_read.axis, rig_read.resolution) == ("ADXL105", "up", pytest.approx(1e-7))
    assert rig_read.lowpass == ac.LowPass(500.0)
    assert mapping.LowPassEntry.of(text) == mapping.LowPassEntry("RC", "500 Hz")
    # Another kind, and a field that is emptied; what is not named stays.
    better = mapping.LowPassEntry("bessel", "300 Hz", "4").changed(text)
    other = mapping.sidecar_from(text, columns_chosen, changes={mapping.RESOLUTION: "", "rig.axis": ""} | better)
    rig_read = read(other).rig
    assert (rig_read.axis, rig_read.resolution, rig_read.lowpass) == ("level", None, None)
    assert [(f.kind, f.cutoff, f.order) for f in rig_read.output_filters] == [("bessel", 300.0, 4)]
    cleared = mapping.sidecar_from(other, columns_chosen, changes=mapping.LowPassEntry().changed(other))
    assert read(cleared).rig.output_filters == ()
    assert "no column has this role" in refusal(template, columns_chosen[:2], {mapping.RESOLUTION: "0.1 um"})


def refusal(text: str, results: list[Choice], changes: dict[str, str]) -> str:
    with pytest.raises(ac.RecordingError) as refused:
        mapping.sidecar_from(text, results, changes=changes)
    return str(refused.value)


def test_the_form_leaves_a_filter_that_it_does_not_know_and_a_tolerance() -> None:
    line = '[channels]\naccel = {{ column = "a", unit = "g", lowpass = {} }}\n'.format
    entry = mapping.LowPassEntry.of
    for other in ('{ kind = "sinc", length = 16 }', '[{ fc = "9 Hz" }]', '{ tau = "1 ms" }', "{ fc = 9, rate = 99 }"):
        assert entry(line(other)) == mapping.LowPassEntry(mapping.OTHER_FILTER)
        assert entry(line(other)).changed(line(other)) == {}
    declared = line('{ fc = "159 Hz", tolerance = 0.02 }')
    assert entry(declared) == mapping.LowPassEntry("RC", "159 Hz")
    assert entry(declared).changed(declared) == {}
    assert mapping.LowPassEntry("RC", "160 Hz").changed(declared) == {
        mapping.LOW_PASS: {"kind": "RC", "fc": "160 Hz", "tolerance": 0.02}
    }
