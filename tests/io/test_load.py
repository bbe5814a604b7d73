"""From columns to channels: units, roles, clocks; and every kind of bad input with the sentence that it earns."""

import hashlib

import numpy as np
import pytest

from accelcal import io
from accelcal.data.recording import RecordingError
from accelcal.data.rig import Rig, Sensor

G0 = 9.80665
ROWS = "0.0,1,0\n0.1,2,1\n0.2,1,3\n"


@pytest.fixture
def write(tmp_path):
    """Write run.csv and, if given, its sidecar; return the path of the recording."""

    def write(content, sidecar=None, name="run.csv"):
        path = tmp_path / name
        path.write_text(content, encoding="utf-8")
        if sidecar is not None:
            path.with_suffix(".toml").write_text(sidecar, encoding="utf-8")
        return path

    return write


def channels(time="s", accel="m/s^2", position="m", extra=""):
    return (
        f'[channels]\ntime = {{ column = "t", unit = "{time}" }}\naccel = {{ column = "accel", unit = "{accel}" }}\n'
        f'position = {{ column = "position", unit = "{position}" }}\n{extra}'
    )


def refused(path, message, **options):
    with pytest.raises(RecordingError) as error:
        io.load(path, **options)
    assert message in str(error.value)


# What works


def test_units_come_from_the_sidecar(write):
    recording = io.load(write("t,accel,position\n" + ROWS, channels("ms", "g", "mm")))
    np.testing.assert_allclose(recording.accel.t, [0.0, 1e-4, 2e-4], rtol=1e-15)
    np.testing.assert_allclose(recording.accel.y, [G0, 2 * G0, G0], rtol=1e-15)
    np.testing.assert_allclose(recording.position.y, [0.0, 1e-3, 3e-3], rtol=1e-15)


def test_empty_cell_is_not_sampled_and_each_channel_keeps_its_own_clock(write):
    recording = io.load(write("t_s,accel_g,position_m,temperature_degC\n0.0,1,0,\n0.1,2,,24.9\n0.2,,1,\n,,,\n"))
    assert recording.accel.t.tolist() == [0.0, 0.1]
    assert recording.position.t.tolist() == [0.0, 0.2]
    assert recording.side["temperature"].t.tolist() == [0.1]


def test_position_may_have_its_own_clock(write):
    by_sidecar = write(
        "t,accel,pt,position\n0.0,1,10,0\n0.1,2,110,1\n0.2,1,,\n",
        '[channels]\ntime = { column = "t", unit = "s" }\naccel = { column = "accel", unit = "g" }\n'
        'position = { column = "position", unit = "m", time = { column = "pt", unit = "ms" } }\n',
    )
    by_name = write("t_s,accel_g,pos_t_ms,pos_m\n0.0,1,10,0\n0.1,2,110,1\n0.2,1,,\n", name="named.csv")
    for path in (by_sidecar, by_name):
        np.testing.assert_allclose(io.load(path).position.t, [0.01, 0.11], rtol=1e-15)


def test_rate_takes_the_place_of_a_time_column(write):
    lines = 'accel = { column = "accel", unit = "g" }\nposition = { column = "position", unit = "m" }\n'
    for declared in ('rate = "1667 Hz"\n', 'time = { rate = "1667 Hz" }\n'):
        recording = io.load(write("accel,position\n1,0\n2,1\n1,1\n", "[channels]\n" + declared + lines))
        np.testing.assert_allclose(recording.accel.t, np.arange(3) / 1667, rtol=1e-15)


@pytest.mark.parametrize(
    ("unit", "scale", "zero"),
    [("V", "0.25 V/g", "2.5 V"), ("mV", "0.25 V/g", "2500 mV"), ("LSB", "250 count/g", "2500 LSB")],
)
def test_electrical_output_goes_through_scale_and_zero(write, unit, scale, zero):
    reading = {"V": "2.75", "mV": "2750", "LSB": "2750"}[unit]
    sidecar = f'[sensor]\nscale = "{scale}"\nzero = "{zero}"\n' + channels(accel=unit)
    recording = io.load(write(f"t,accel,position\n0,{reading},0\n1,{reading},1\n", sidecar))
    np.testing.assert_allclose(recording.accel.y, G0, rtol=1e-12)  # 2.75 - 2.5 loses a digit
    assert recording.accel.unit == "m/s^2"


def test_undeclared_zero_is_an_assumption_that_is_said(write):
    sidecar = '[sensor]\nscale = "0.25 V/g"\n' + channels(accel="V")
    assert any(
        "zero is not declared" in text for text in io.load(write("t,accel,position\n" + ROWS, sidecar)).rig.assumptions
    )


def test_side_channels_are_those_of_the_sidecar(write):
    sidecar = channels(extra='a_y = { column = "lateral", unit = "mg" }\n')
    recording = io.load(write("t,accel,position,lateral,room_degC\n0,1,0,1000,20\n1,2,1,2000,21\n", sidecar))
    assert list(recording.side) == ["a_y"]
    np.testing.assert_allclose(recording.side["a_y"].y, [G0, 2 * G0], rtol=1e-15)


def test_without_a_sidecar_every_column_with_a_unit_is_a_channel(write):
    recording = io.load(write("t_s,accel_g,position_m,a_y_g,temp_K,state\n0,1,0,1,300,S\n1,2,1,2,301,M\n"))
    assert list(recording.side) == ["a_y", "temperature"]
    np.testing.assert_allclose(recording.side["temperature"].y, [26.85, 27.85], rtol=1e-12)
    assert "columns without a known unit are not used: state" in recording.findings[0].text


def test_sidecar_that_maps_nothing_leaves_the_columns_to_their_names(write):
    recording = io.load(
        write("t_s,accel_g,position_m,temp_degC\n" + ROWS.replace("\n", ",20\n"), '[rig]\naxis = "up"\n')
    )
    assert recording.rig.axis == "up"
    assert "temperature" in recording.side


def test_rig_argument_replaces_the_sidecar_and_says_so(write, tmp_path):
    path = write("t_s,accel_g,position_m\n" + ROWS, '[rig]\naxis = "down"\n')
    other = tmp_path / "bench.toml"
    other.write_text('[rig]\naxis = "up"\n')
    recording = io.load(path, rig=other)
    assert recording.rig.axis == "up"
    assert (
        recording.findings[0].text
        == "run.toml beside the recording is not read, because bench.toml was given in its place"
    )
    assert not io.load(path, rig=path.with_suffix(".toml")).findings
    rig = Rig(sensor=Sensor(model="X"))
    recording = io.load(path, rig=rig)
    assert recording.rig is rig
    assert recording.findings[0].text.endswith("is not read, because a rig was given in its place")


def test_recording_carries_name_and_digest_of_its_file(write):
    path = write("t_s,accel_g,position_m\n" + ROWS)
    recording = io.load(path)
    assert recording.name == "run.csv"
    assert recording.digest == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    "header", ["t_s,accel_g\n0,1\n1,2\n", "t_s,accel_g,position_m\n0,1,\n1,2,\n"], ids=["no column", "empty column"]
)
def test_position_may_be_absent_when_it_is_not_needed(write, header):
    assert len(io.load(write(header), need_position=False).position) == 0


def test_mapped_position_may_be_absent_when_it_is_not_needed(write):
    path = write("t,accel\n0,1\n1,2\n", channels())
    assert len(io.load(path, need_position=False).position) == 0
    refused(path, 'there is no column "position"')


def test_column_that_is_always_empty_is_left_out_and_said(write):
    recording = io.load(write("t_s,accel_g,position_m,temp_degC\n0,1,0,\n1,2,1,\n"))
    assert not recording.side
    assert recording.findings[0].text == "temperature: every cell is empty; the channel is left out"


# Where the unit comes from, in this order


def test_units_that_agree_may_be_said_twice(write):
    path = write("t_s,accel_m_per_s2,position [mm]\ns,m/s²,mm\n" + ROWS)
    assert io.load(path).position.y.tolist() == [0.0, 0.001, 0.003]


@pytest.mark.parametrize(
    ("content", "unit", "message"),
    [
        ("t,accel_g,position\ns,mg,m\n" + ROWS, "g", 'the unit row says "mg" but run.toml says "g"'),
        (
            "t,accel_g [mg],position\n" + ROWS,
            None,
            'suffix of the column name says "g" but the bracket in the column name says "mg"',
        ),
    ],
)
def test_contradiction_names_both_sources(write, content, unit, message):
    declared = f', unit = "{unit}"' if unit else ""
    sidecar = (
        '[channels]\ntime = { column = "t", unit = "s" }\nposition = { column = "position", unit = "m" }\n'
        f'accel = {{ column = "{content.split(",")[1]}"{declared} }}\n'
    )
    refused(write(content, sidecar), message)


@pytest.mark.parametrize("column", ["accel_g", "accel [g]"])
def test_a_declaration_wins_over_the_name_of_the_column(write, column):
    sidecar = channels().replace('"accel"', f'"{column}"')
    recording = io.load(write(f"t,{column},position\n" + ROWS, sidecar))
    assert recording.accel.y.tolist() == [1.0, 2.0, 1.0]
    assert f'column "{column}" is read in m/s^2, as declared, though its name says g' in recording.findings[0].text


# Bad input


def test_missing_column_is_named_with_the_nearest(write):
    path = write("t,acel,position\n" + ROWS, channels())
    refused(
        path, 'there is no column "accel", which run.toml names for accel; did you mean "acel"? columns are: t, acel'
    )


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (
            "t_s,x_g,position_m",
            'columns are: t_s, x_g, position_m. By its unit it may be "x_g" in g. Name it like accel_m_per_s2, or',
        ),
        ("t_s,accel_g,x_m", "no column for position"),
        ("x_s,accel_g,position_m", '# or, without a time column: rate = "1667 Hz"'),
    ],
)
def test_missing_channel_shows_the_lines_to_write(write, header, message):
    refused(write(f"{header}\n{ROWS}"), message)


def test_misspelt_channel_is_recognised(write):
    path = write(
        "t,accel,position\n" + ROWS, channels().replace("position =", "positon =").replace('"position"', '"p"')
    )
    path.write_text("t,accel,p\n" + ROWS)
    refused(path, 'the sidecar has "positon"; did you mean "position"?')


@pytest.mark.parametrize("channel", ["time", "accel", "position"])
def test_missing_unit_shows_the_line_to_write(write, channel):
    names = {"time": "t_s", "accel": "accel_g", "position": "position_m"}
    bare = {"time": "t", "accel": "accel", "position": "position"}[channel]
    header = ",".join((names | {channel: bare}).values())
    unit = {"time": "s", "accel": "m/s^2", "position": "m"}[channel]
    refused(write(f"{header}\n{ROWS}"), f'column "{bare}" has no unit; write in')
    refused(write(f"{header}\n{ROWS}"), f'[channels]\n    {channel} = {{ column = "{bare}", unit = "{unit}" }}')


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ({"accel": "furlong"}, 'column "accel": unknown unit "furlong"'),
        (
            {"accel": "m/s^3"},
            '"m/s^3" does not measure an acceleration; expected a unit as in "5 g", or "V" or "count" with a scale',
        ),
        ({"position": "kg"}, 'column "position": "kg" does not measure a length'),
        ({"time": "m"}, 'column "t": "m" does not measure a time'),
        ({"accel": "?"}, 'channels.accel.unit: still to be filled in; expected the unit of column "accel"'),
        ({"accel": "V"}, 'column "accel" is in V, but no scale is declared; write in'),
        ({"accel": "V"}, '[sensor]\n    scale = "0.25 V/g"\n    zero  = "2.5 V"'),
        ({"accel": "count"}, '[sensor]\n    scale = "1024 count/g"'),
    ],
)
def test_unit_that_cannot_serve_is_explained(write, units, message):
    refused(write("t,accel,position\n" + ROWS, channels(**units)), message)


def test_scale_in_counts_does_not_serve_a_channel_in_volts(write):
    sidecar = '[sensor]\nscale = "1024 count/g"\n' + channels(accel="V")
    refused(write("t,accel,position\n" + ROWS, sidecar), "but the declared scale is per count")


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("t_s,accel_g,acc_g", 'columns "accel_g" and "acc_g" can both be accel; write in'),
        ("t_s,time_ms,accel_g", 'columns "t_s" and "time_ms" can both be time; write in'),
    ],
)
def test_ambiguous_names_are_not_guessed(write, header, message):
    refused(write(f"{header}\n{ROWS}"), message, need_position=False)


def test_column_name_used_twice_is_refused(write):
    refused(
        write("t,accel,accel\n" + ROWS, channels()),
        '2 columns are called "accel"; rename all but one',
        need_position=False,
    )


def test_reading_without_time_is_named(write):
    refused(write("t_s,accel_g,position_m\n0,1,0\n1,2,1\n,3,\n"), "row 4 has a value of accel but no time")
    refused(write("t_s,accel_g,position_m\n0,1,0\n1,,1\n,3,\n"), "row 4 has a value of accel but no time")


@pytest.mark.parametrize("text", ["nan", "inf", "-Infinity"])
def test_non_finite_reading_is_named_with_the_cure(write, text):
    rows = f"# logger\n0.0,1,0\n\n0.1,{text},1\n0.2,1,3\n0.3,{text},4\n"
    refused(
        write("t_s,accel_g,position_m\n" + rows),
        "run.csv: accel: 2 samples are not finite (first at t = 0.1 s, row 5). "
        "Drop them or mark them missing with an empty cell.",
    )


def test_non_finite_time_is_named(write):
    refused(write("t_s,accel_g,position_m\n0,1,0\nnan,2,1\n"), "time of accel: 1 sample is not finite (first at row 3)")


def test_time_that_runs_backward_is_named_with_row_and_time(write):
    rows = "0.0,1,0\n0.2,1,0\n0.1,2,1\n0.3,1,3\n0.25,1,3\n"
    refused(
        write("t_s,accel_g,position_m\n" + rows),
        "1 row is out of order: row 4 (0.1 s after 0.2 s); its place is not known; correct or delete it",
    )
    refused(
        write("t_s,accel_g,position_m\n" + rows.replace("0.1,2,1\n", "")),
        "the clock starts again at row 5: 0.25 s after 0.3 s. The file holds 2 runs: part 1, row 2 to row 4 (0 s to "
        "0.3 s); part 2, row 5 to row 5",
    )


def test_row_is_counted_among_all_rows_when_cells_are_empty(write):
    refused(write("t_s,accel_g,position_m\n0.0,,0\n0.2,1,0\n0.15,,\n0.1,2,1\n"), "starts again at row 5")


def test_single_sample_is_refused(write):
    refused(write("t_s,accel_g,position_m\n0,1,0\n"), "accel: 1 sample; at least 2 are needed")
    refused(write("t_s,accel_g,position_m\n0,1,0\n0,1,0\n"), "accel: 1 sample; at least 2 are needed")
    refused(write("t_s,accel_g,position_m\n0,1,\n1,2,\n"), "position: no sample; at least 2 are needed")


def test_channels_that_share_no_time_are_refused(write):
    rows = "0,1,\n1,2,\n5,,0\n6,,1\n"
    refused(
        write("t_s,accel_g,position_m\n" + rows),
        "accel (0 s to 1 s) and position (5 s to 6 s) share no stretch of time; check the two time columns",
    )


def test_millimetres_declared_as_metres_are_warned_about(write):
    recording = io.load(write("t_s,accel_g,position_m\n0.0,1,0\n0.1,2,60\n0.2,1,140\n"))
    warnings = [finding.text for finding in recording.findings if finding.severity == "warning"]
    assert warnings == ["position spans 140 m, more than 100 m: check its unit (mm read as m?)"]


def test_empty_file_missing_file_and_directory_are_refused(write, tmp_path):
    refused(write(""), "the file is empty (0 bytes)")
    refused(tmp_path / "none.csv", "there is no such file")
    refused(tmp_path, "this is a directory; give one recording file")


def test_unreadable_file_is_refused(write, monkeypatch):
    path = write("t_s,accel_g,position_m\n" + ROWS)

    def denied(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.open", denied)
    refused(path, "cannot be read (Permission denied)")


@pytest.mark.parametrize("column", ["accel_mps2", "accel_g", "out_g"])
def test_text_in_the_output_is_named_where_a_plan_would_do_as_well(write, column):
    refused(write(f"t_s,{column},position_m\n0,1,0\n1,x,1\n2,3,2\n"), f'"{column}": found "x"', need_accel=False)


def test_a_column_that_nobody_understands_makes_no_planned_motion(write):
    path = write(f"t_s,out,position_m\n{ROWS}")
    refused(path, "no column for accel; columns are: t_s, out, position_m", need_accel=False)
    refused(path, "A planned motion has columns for time and position alone", need_accel=False)
    assert len(io.load(write("t_s,position_m\n0,0\n1,1\n2,2\n"), need_accel=False).accel) == 0


def test_a_sidecar_that_names_another_output_makes_no_planned_motion(write):
    lines = '[channels]\naccel = { column = "ai0", unit = "g" }\nposition = { column = "enc", unit = "m" }\n'
    path = write(f"t_s,ai1,enc\n{ROWS}", lines)
    refused(path, 'no column "ai0", which run.toml names for accel; did you mean "ai1"?', need_accel=False)
    assert len(io.load(write("t_s,enc\n0,0\n1,1\n2,2\n", lines), need_accel=False).accel) == 0


def test_an_output_without_any_sample_makes_no_planned_motion(write):
    path = write("t_s,accel_g,position_m\n0,,0\n1,,1\n2,,2\n")
    refused(path, 'column "accel_g": every cell is empty', need_accel=False)
