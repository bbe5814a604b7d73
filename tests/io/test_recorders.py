"""TDMS, UFF, MF4, miniSEED, C3D, MCAP and ROS bags: each written by its own library, read to the bit, or refused."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from accelcal import io
from accelcal.data.recording import RecordingError
from accelcal.io import decoding
from accelcal.io.decoding.known_formats import FORMATS
from accelcal.io.files import open_table
from tests.io.installed import leave_numpy_alone
from tests.io.recorders import IN_MESSAGES, NO_UNITS, RECORDERS, named

PAGE = Path(__file__).parents[2] / "docs" / "your-data.md"
STEP = 1.0 / 128.0
N = 60
ACCEL, POSITION = np.random.default_rng(5).normal(size=(2, N)).astype(np.float32).astype(np.float64)  # C3D: floats
COLUMNS = {"accel": ACCEL, "position": POSITION}
UNITS = {"accel": "m/s^2", "position": "m"}
DEFINED = {"bag", "db3"}
"""Formats whose message definitions state the units."""
OF_SUFFIX = {suffix.removeprefix("."): item for item in FORMATS for suffix in item.suffixes}


def declare(path, suffix, units):
    """A sidecar that maps both channels, with a unit where the format has none that fits."""
    lines = ["[channels]"]
    for channel in COLUMNS:
        unit = f', unit = "{units[channel]}"' if channel in units else ""
        lines.append(f'{channel} = {{ column = "{named(suffix, channel)}"{unit} }}')
    path.with_suffix(".toml").write_text("\n".join(lines))


def written(folder, suffix, units=UNITS):
    path = folder / f"run.{suffix}"
    RECORDERS[suffix](path, COLUMNS, units, STEP)
    return path


@pytest.mark.parametrize("suffix", RECORDERS)
def test_a_file_of_its_own_library_is_read_to_the_bit(tmp_path, suffix):
    path = written(tmp_path, suffix)
    content = open_table(path).read([named(suffix, channel) for channel in COLUMNS])
    for channel, values in COLUMNS.items():
        column = content[named(suffix, channel)]
        assert column.present is None
        np.testing.assert_array_equal(column.values, values)


@pytest.mark.parametrize("suffix", [suffix for suffix in RECORDERS if suffix not in DEFINED])
def test_stamps_and_units_come_from_the_file(tmp_path, suffix):
    path = written(tmp_path, suffix)
    if suffix in NO_UNITS or suffix in IN_MESSAGES:
        declare(path, suffix, UNITS if suffix in NO_UNITS else {})
    recording = io.load(path)
    np.testing.assert_array_equal(recording.accel.y, ACCEL)
    np.testing.assert_array_equal(recording.position.y, POSITION)
    for channel in (recording.accel, recording.position):
        np.testing.assert_allclose(channel.t, np.arange(N) * STEP, rtol=0.0, atol=2e-9)


@pytest.mark.parametrize("suffix", sorted(DEFINED))
def test_definitions_of_messages_state_the_unit_and_their_headers_the_stamps(tmp_path, suffix):
    path = written(tmp_path, suffix)
    table = open_table(path)
    column = named(suffix, "accel")
    assert table.units[column] == "m/s^2"
    assert table.clocks[column] == "/accel.t"
    np.testing.assert_allclose(table.read(["/accel.t"])["/accel.t"].values, np.arange(N) * STEP, rtol=0.0, atol=2e-9)
    declare(path, suffix, {})
    with pytest.raises(RecordingError, match="m/s"):  # the position is an acceleration in this bag
        io.load(path)


@pytest.mark.parametrize("suffix", [suffix for suffix in RECORDERS if suffix not in DEFINED])
def test_a_file_without_units_is_refused_with_the_lines_to_write(tmp_path, suffix):
    path = written(tmp_path, suffix, {})
    if suffix in IN_MESSAGES:
        declare(path, suffix, {})
    with pytest.raises(RecordingError, match=r"has no unit; write in .*run\.toml") as error:
        io.load(path)
    assert named(suffix, "accel") in str(error.value)
    declare(path, suffix, {"accel": "g", "position": "mm"})
    np.testing.assert_array_equal(io.load(path).accel.y, 9.80665 * ACCEL)


@pytest.mark.parametrize("suffix", RECORDERS)
def test_a_truncated_file_is_refused_in_one_sentence(tmp_path, suffix):
    path = written(tmp_path, suffix)
    declare(path, suffix, {} if suffix not in NO_UNITS else UNITS)
    whole = path.read_bytes()
    for remaining in (0.97, 0.4):
        path.write_bytes(whole[: int(remaining * len(whole))])
        with pytest.raises(RecordingError) as error:
            io.load(path)
        text = str(error.value)
        assert text.startswith(str(path))
        assert text.count("\n") == 0
        assert "truncated or damaged" in text or "cut off" in text or "begins with" in text
        assert "Traceback" not in text


@pytest.mark.parametrize("suffix", RECORDERS)
def test_init_offers_every_channel_with_what_the_file_knows_of_it(tmp_path, suffix):
    path = written(tmp_path, suffix)
    text = io.init(path)
    for channel in COLUMNS:
        assert f'column = "{named(suffix, channel)}"' in text
    if suffix not in IN_MESSAGES and suffix not in NO_UNITS:
        np.testing.assert_array_equal(io.load(path).accel.y, ACCEL)  # nothing is left to be filled in


@pytest.mark.parametrize("suffix", [suffix for suffix in RECORDERS if OF_SUFFIX[suffix].extra])
def test_a_missing_library_is_named_with_the_command(tmp_path, suffix, monkeypatch):
    path = written(tmp_path, suffix)
    chosen = OF_SUFFIX[suffix]
    assert importlib.util.find_spec(chosen.library)
    leave_numpy_alone(tmp_path / "alone", monkeypatch)
    with pytest.raises(RecordingError, match=rf"install it with: pip install 'accelcal\[{chosen.extra}\]'"):
        io.load(path)


@pytest.mark.parametrize("file_format", FORMATS, ids=lambda file_format: file_format.name)
def test_every_format_has_its_reader_and_its_row_on_the_page(file_format):
    source = (Path(decoding.__file__).parent / f"{file_format.reader}.py").read_text(encoding="utf-8")
    assert re.search(r"^def opened\(path: str\) -> Source:$", source, flags=re.MULTILINE)
    listed = re.findall(r"^\| [^|]+ \| (`\.[^|]+) \|", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    absent = {f"`{suffix}`" for suffix in file_format.suffixes} - {item for row in listed for item in row.split(", ")}
    assert not absent, f"no row of docs/your-data.md has {absent}"


def test_code_in_the_definition_of_a_message_is_never_run(tmp_path):
    from mcap.writer import Writer

    path, trace = tmp_path / "run.mcap", tmp_path / "trace"
    names = ("a/msg/b", f"a/msg/B:\n    open({str(trace)!r}, 'w')\nclass C")
    for name in names:
        with path.open("wb") as handle:
            file = Writer(handle)
            file.start()
            schema = file.register_schema(name, "ros2msg", f"float64 x\nstring S={trace}\n".encode())
            channel = file.register_channel("/a", "cdr", schema)
            file.add_message(channel, 1, b"\0\1\0\0" + np.float64(1.5).tobytes(), 1)
            file.finish()
        if name == names[0]:
            assert open_table(path).read(["/a.x"])["/a.x"].values.tolist() == [1.5]
        else:
            with pytest.raises(RecordingError, match="a message definition holds the name"):
                open_table(path)
    assert not trace.exists()


def test_a_unit_in_words_of_the_file_gives_way_to_the_sidecar(tmp_path):
    path = written(tmp_path, "tdms", {"accel": "as calibrated", "position": "mm"})
    with pytest.raises(RecordingError, match='"as calibrated"'):
        io.load(path)
    declare(path, "tdms", {"accel": "g"})
    np.testing.assert_array_equal(io.load(path).accel.y, 9.80665 * ACCEL)
    declare(path, "tdms", {"accel": "g", "position": "m"})
    with pytest.raises(RecordingError, match="the channel's properties says"):
        io.load(path)


def test_a_point_that_is_not_seen_is_not_sampled(tmp_path):
    path = written(tmp_path, "c3d")
    column = open_table(path).read(["mark.X"])["mark.X"]
    assert column.present is not None
    np.testing.assert_array_equal(column.present, np.arange(N // 2) % 3 != 2)
    np.testing.assert_array_equal(column.values[column.present], np.arange(N // 2.0)[column.present])


def test_a_gap_between_records_remains_one(tmp_path):
    from pymseed import DataEncoding, MS3TraceList

    path, traces = tmp_path / "run.mseed", MS3TraceList()
    for second in (0, 10):
        traces.add_data("FDSN:XX_A__H_N_Z", np.arange(5, dtype=np.int32), "i", 10.0, starttime=second * 10**9)
    traces.to_file(path, encoding=DataEncoding.STEIM2)
    content = open_table(path).read(["t", "XX_A__H_N_Z"])
    np.testing.assert_allclose(content["t"].values, [*np.arange(5) / 10, *(10 + np.arange(5) / 10)], rtol=1e-15)
    assert content["XX_A__H_N_Z"].values.tolist() == [0, 1, 2, 3, 4] * 2


def test_starts_of_waveforms_are_kept_apart(tmp_path):
    from nptdms import ChannelObject, TdmsWriter

    path, begin = tmp_path / "run.tdms", np.datetime64("2026-11-03T14:30:00.000000", "us")
    late = begin + np.timedelta64(250, "ms")
    with TdmsWriter(path) as file:
        for group, name, start, unit in (("a", "accel", begin, "g"), ("b", "position", late, "mm")):
            properties = {"wf_increment": 0.01, "wf_start_time": start, "unit_string": unit}
            file.write_segment([ChannelObject(group, name, COLUMNS[name], properties)])
    table = open_table(path)
    assert table.clocks == {"a/accel": "a/accel_t", "b/position": "b/position_t"}
    stamps = table.read(["a/accel_t", "b/position_t"])
    assert stamps["a/accel_t"].values[0] == 0.0
    assert stamps["b/position_t"].values[0] == 0.25
