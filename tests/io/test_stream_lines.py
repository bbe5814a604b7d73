"""Lines of a running measurement: what is understood, what is counted and skipped, and that nothing is fatal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from accelcal.data.recording import RecordingError
from accelcal.data.rig import STANDARD_GRAVITY
from accelcal.io import load, read_sidecar
from accelcal.io.sidecar import Sidecar
from accelcal.io.stream import LONGEST, LineReader, Rows

SIDECAR = """
[channels]
time = { column = "t", unit = "ms" }
accel = { column = "acc", unit = "g" }
position = { column = "enc", unit = "mm" }
"""


@pytest.fixture
def declared(tmp_path: Path) -> Sidecar:
    return sidecar(tmp_path, SIDECAR)


def sidecar(folder: Path, text: str) -> Sidecar:
    (folder / "rig.toml").write_text(text)
    return read_sidecar(folder / "rig.toml")


def read(reader: LineReader, content: bytes, size: int = 7) -> Rows:
    """Fed in pieces of `size` bytes."""
    parts = [reader.feed(content[i : i + size]) for i in range(0, len(content), size)]
    parts.append(reader.finish(whole=True))
    return Rows.joined(parts)


@pytest.mark.parametrize("size", [1, 2, 3, 7, 64, 10_000])
def test_rows_are_those_of_the_file_whatever_the_pieces(declared: Sidecar, tmp_path: Path, size: int) -> None:
    rng = np.random.default_rng(1)
    lines = [f"{i},{rng.normal():.17g},{'' if i % 3 else f'{rng.normal():.17g}'}" for i in range(500)]
    content = "\n".join(["t,acc,enc", *lines]).encode()
    rows = read(LineReader(declared, "device"), content, size)
    (tmp_path / "run.csv").write_bytes(content)
    recording = load(tmp_path / "run.csv", tmp_path / "rig.toml")
    assert np.array_equal(rows.t, recording.accel.t)
    assert np.array_equal(rows.accel, recording.accel.y)
    assert np.array_equal(rows.position[~np.isnan(rows.position)], recording.position.y)


def test_units_and_order_of_the_columns_come_from_header_and_sidecar(declared: Sidecar) -> None:
    plain = read(LineReader(declared, "device"), b"1,0.5,2\n2,,3\n")
    named = read(LineReader(declared, "device"), b"enc,other,t,acc\r\n2,9,1,0.5\r\n3,9,2,\r\n")
    for rows in (plain, named):
        assert rows.t.tolist() == [0.001, 0.002]
        assert rows.accel[0] == 0.5 * STANDARD_GRAVITY
        assert np.isnan(rows.accel[1])
        assert rows.position.tolist() == [0.002, 0.003]


def test_a_header_may_carry_the_units(tmp_path: Path) -> None:
    rows = read(LineReader(sidecar(tmp_path, ""), "device"), b"t_s,accel_g,position_um\n1,1,5\n")
    assert (rows.t[0], rows.accel[0], rows.position[0]) == (1.0, STANDARD_GRAVITY, pytest.approx(5e-6))


def test_an_electrical_output_goes_through_the_declared_scale(tmp_path: Path) -> None:
    text = SIDECAR.replace('unit = "g"', 'unit = "V"') + '[sensor]\nscale = "0.25 V/g"\nzero = "2.5 V"\n'
    rows = read(LineReader(sidecar(tmp_path, text), "device"), b"1,2.75,5\n")
    assert rows.accel[0] == pytest.approx(STANDARD_GRAVITY)


BROKEN = {
    "a word": b"3,abc,1",
    "two fields": b"3,1",
    "four fields": b"3,1,1,1",
    "no time": b",1,1",
    "nothing measured": b"3,,",
    "not a number": b"3,nan,1",
    "infinite": b"3,inf,1",
    "infinite time": b"inf,1,1",
    "beyond a double": b"3,1e400,1",
    "beyond all reason": b"3,1e200,1",
    "a time beyond all reason": b"1e200,1,1",
    "a time before all reason": b"-1e200,1,1",
    "underscores": b"3,1_0,1",
    "other digits": "3,٣,1".encode(),
    "not text": b"3,\xff\xfe,1",
    "zeros": b"3,\0\0,1",
    "other separator": b"3;1;1",
    "quotes": b'3,"1",1',
    "long": b"3," + b"1" * LONGEST + b",1",
    "without end": b"3," + b"1" * 100_000,
    "commas": b"," * 500,
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_line_is_counted_and_skipped(declared: Sidecar, name: str) -> None:
    reader = LineReader(declared, "device")
    rows = read(reader, b"1,1,1\n2,1,1\n" + BROKEN[name] + b"\n4,1,1\n\n5,1,1\n", size=50)
    assert rows.t.tolist() == [0.001, 0.002, 0.004, 0.005]
    assert (reader.counts.used, reader.counts.broken, reader.counts.out_of_order) == (4, 1, 0)


def test_an_endless_line_is_not_kept(declared: Sidecar) -> None:
    reader = LineReader(declared, "device")
    for _ in range(100):
        reader.feed(b"9" * 10_000)
        assert len(reader._rest) <= LONGEST
    assert reader.counts.broken == 1
    assert read(reader, b"9,9,9\n1,1,1\n2,1,1\n3,1,1\n").t.tolist() == [0.001, 0.002, 0.003]


@pytest.mark.parametrize("seed", range(20))
def test_noise_is_never_fatal(declared: Sidecar, seed: int) -> None:
    rng = np.random.default_rng(seed)
    lines = [b"%d,0.5,%s" % (i, b"1" if i % 2 else b"") for i in range(200)]
    content = bytearray(b"\n".join(lines))
    for place in rng.integers(10, len(content), 60):
        content[place] = int(rng.integers(256))
    reader = LineReader(declared, "device")
    rows = read(reader, bytes(content), size=int(rng.integers(1, 100)))
    counts = reader.counts
    assert np.all(np.diff(rows.t) > 0.0)
    assert counts.used == len(rows) > 120
    print(counts)


def test_stamps_that_do_not_rise_are_counted_and_skipped(declared: Sidecar) -> None:
    reader = LineReader(declared, "device")
    rows = read(reader, b"1,1,1\n2,1,1\n2,1,1\n1.5,1,1\n3,1,1\n9e9,1,1\n4,1,1\n5,1,1\n")
    assert (1e3 * rows.t).tolist() == pytest.approx([1, 2, 3, 4, 5])
    assert reader.counts.out_of_order == 3  # 9e9 ms is months ahead, and no line confirms it


def test_a_pause_is_believed_when_the_next_lines_agree_with_it(declared: Sidecar) -> None:
    reader = LineReader(declared, "device")
    stamps = [*range(1, 10), *range(900_000, 901_000), *range(1_900_002, 1_900_500)]
    rows = read(reader, b"".join(b"%d,1,1\n" % stamp for stamp in stamps))
    assert (1e3 * rows.t).tolist() == pytest.approx(stamps)
    assert reader.counts.out_of_order == 0


def test_a_damaged_stamp_costs_one_row(declared: Sidecar) -> None:
    lines = [b"%d,1,1\n" % i for i in range(300)]
    for place, stamp in ((0, b"9000"), (150, b"950"), (250, b"99999999")):
        lines[place] = stamp + b",1,1\n"
    reader = LineReader(declared, "device")
    assert len(read(reader, b"".join(lines))) == 297
    assert reader.counts.out_of_order == 3


def test_missing_rows_show_in_the_stamps(declared: Sidecar) -> None:
    remaining = [i for i in range(1000) if i < 500 or i % 10]
    reader = LineReader(declared, "device")
    read(reader, b"".join(b"%d,1,1\n" % i for i in remaining))
    assert reader.counts.missing == 50


def test_the_first_line_of_a_port_is_skipped_but_for_a_header(declared: Sidecar) -> None:
    for content in (b"5,1,1\n6,1,1\n", b"t,acc,enc\n6,1,1\n"):
        reader = LineReader(declared, "port", from_its_start=False)
        assert read(reader, content).t.tolist() == [0.006]


def test_bytes_that_were_lost_break_the_lines_around_them(declared: Sidecar) -> None:
    reader = LineReader(declared, "device")
    assert len(reader.feed(b"".join(b"%d,1,1\n" % i for i in range(-8, 2)) + b"2,1,0.12")) == 10
    assert len(reader.feed(None)) == 0
    assert reader.feed(b"34,0.5,0.5\n3,1,1\n").t.tolist() == [0.003]
    assert reader.counts.broken == 1


def test_the_last_line_counts_where_it_is_whole(declared: Sidecar) -> None:
    for whole in (True, False):
        reader = LineReader(declared, "device")
        assert len(reader.feed(b"".join(b"%d,1,1\n" % i for i in range(9)) + b"9,1,1")) == 9
        assert len(reader.finish(whole=whole)) == whole
        assert reader.counts.broken == (not whole)


@pytest.mark.parametrize(
    ("text", "content", "message"),
    [
        ("", b"1,1,1\n", "has no unit; write in .*rig.toml"),
        (SIDECAR, b"t,acc,angle\n1,1,1\n", 'there is no column "enc"'),
        (SIDECAR.replace('"mm"', '"kg"'), b"1,1,1\n", "position|length"),
        (
            SIDECAR.replace('time = { column = "t", unit = "ms" }', 'rate = "1 kHz"'),
            b"1,1,1\n",
            "rate: lines of device begin",
        ),
    ],
    ids=["no unit", "no column", "wrong unit", "rate"],
)
def test_columns_that_are_not_understood_are_refused_at_once(
    tmp_path: Path, text: str, content: bytes, message: str
) -> None:
    with pytest.raises(RecordingError, match=message):
        read(LineReader(sidecar(tmp_path, text), "device"), content)


TEMPERATURE = SIDECAR + 'temperature = { column = "T", unit = "degC" }\n'
"""A sidecar as of a recording: one more channel than a live view needs."""


def test_a_channel_that_is_not_needed_is_left_out(tmp_path: Path) -> None:
    for content in (b"1,0.5,2\n2,,3\n", b"t,acc,T,enc\n1,0.5,20,2\n2,,20,3\n"):
        reader = LineReader(sidecar(tmp_path, TEMPERATURE), "device")
        rows = read(reader, content)
        assert reader.left_out == ("temperature",)
        assert (rows.t.tolist(), rows.position.tolist(), rows.side) == ([0.001, 0.002], [0.002, 0.003], {})


def test_a_channel_that_is_needed_is_read(tmp_path: Path) -> None:
    for content in (b"1,0.5,2,68\n2,,3,\n", b"T,t,acc,enc\n68,1,0.5,2\n,2,,3\n"):
        text = TEMPERATURE.replace("degC", "degF")
        reader = LineReader(sidecar(tmp_path, text), "device", needed=("temperature",))
        rows = read(reader, content)
        assert reader.left_out == ()
        assert rows.t.tolist() == [0.001, 0.002]
        assert rows.side["temperature"][0] == pytest.approx(20.0)
        assert np.isnan(rows.side["temperature"][1])


def test_a_channel_that_no_column_holds_is_asked_for(tmp_path: Path) -> None:
    reader = LineReader(sidecar(tmp_path, SIDECAR), "device", needed=("temperature",))
    with pytest.raises(RecordingError, match="the channel temperature is needed; send it in a column"):
        read(reader, b"1,1,1\n2,1,1\n")


@pytest.mark.parametrize(
    "content",
    [
        b"t,a\x80c,enc\n1,1,1\n",
        b"t,acc,exc\n1,1,1\n",
        b"t acc,enc\n1,1,1\n",
        b"q,acc,enc\n1,1,1\n",
        b"t,a,c,enc\n1,1,1\n",
        b"c,enc\nt,acc,enc\n1,1,1\n",
        b"\xff\xfe\n# device 7\nready\nt,acc,enc\n1,1,1\n",
    ],
)
def test_a_header_is_sought_in_the_first_lines_or_counts_as_damaged(declared: Sidecar, content: bytes) -> None:
    rows = read(LineReader(declared, "device"), content)
    assert rows.t.tolist() == [0.001]


def test_a_whole_header_in_other_words_than_the_sidecar_is_no_damaged_one(tmp_path: Path) -> None:
    """Read as damaged it would count for nothing, and its units with it."""
    declared = sidecar(tmp_path, '[channels]\naccel = { column = "accel" }\nposition = { column = "position" }\n')
    with pytest.raises(RecordingError, match=r'no column "accel".*did you mean "accel_m/s\^2"'):
        read(LineReader(declared, "device"), b"t_s,accel_m/s^2,position_m\n1,1,1\n" + b"2,1,1\n" * 30)


def rows_of(stamps: list[float]) -> bytes:
    return b"".join(b"%r,1,1\n" % stamp for stamp in stamps)


@pytest.mark.parametrize("damaged", [1, 2, 3, 20, 300])
def test_damaged_rows_with_later_stamps_cost_those_rows(declared: Sidecar, damaged: int) -> None:
    """They agree among themselves, as if the clock had jumped ahead, and yet the stream goes on as before."""
    stamps = [float(i) for i in range(4000)]
    for i in range(1000, 1000 + damaged):
        stamps[i] += 7e5
    reader = LineReader(declared, "device")
    assert len(read(reader, rows_of(stamps))) == 4000 - damaged
    assert (reader.counts.out_of_order, reader.counts.restarts) == (damaged, 0)


def test_a_clock_that_begins_anew_is_followed(declared: Sidecar) -> None:
    stamps = [float(i % 2500) for i in range(5000)]
    reader = LineReader(declared, "device")
    rows = read(reader, rows_of(stamps))
    assert len(rows) == 5000
    assert sorted(np.diff(rows.t)) == pytest.approx([*[1e-3] * 4998, 0.401])  # a hole, as nobody knows how long it was
    assert (reader.counts.out_of_order, reader.counts.restarts, reader.counts.missing) == (0, 1, 0)


def test_lines_that_are_sent_twice_are_no_new_clock(declared: Sidecar) -> None:
    stamps = [float(i) for i in (*range(2000), *range(1300, 2000), *range(2000, 4000))]
    reader = LineReader(declared, "device")
    assert len(read(reader, rows_of(stamps))) == 4000
    assert (reader.counts.out_of_order, reader.counts.restarts) == (700, 0)


def test_no_step_is_too_small_for_a_measurement(declared: Sidecar) -> None:
    content = rows_of([k * 1e-310 for k in range(130)]) + b"9e11,1,1\n9e11,1,1\n9.1e11,1,1\n"
    reader = LineReader(declared, "device")
    assert len(read(reader, content)) >= 130
