"""The dialects of text tables; each is compared to the same numbers written plainly."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from accelcal import io
from accelcal.data.recording import RecordingError

T = [0.0, 0.1, 0.2]
ACCEL = [0.5, -1.5, 2.25]
POSITION = {0.0: 0.001, 0.2: 0.003}


def load(tmp_path, content, need_position=True):
    path = tmp_path / "run.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return io.load(path, need_position=need_position)


PLAIN = "t_s,accel_m_per_s2,position_m\n0.0,0.5,0.001\n0.1,-1.5,\n0.2,2.25,0.003\n"
LONG = "t_s,accel_m_per_s2,position_m\n" + "".join(f"{k / 8},{k % 7},{k % 5}\n" for k in range(40_000))
DIALECTS = {
    "plain": PLAIN,
    "no line end at the end": PLAIN.rstrip("\n"),
    "windows line ends": PLAIN.replace("\n", "\r\n"),
    "empty lines at the end": PLAIN + "\n\r\n\n",
    "tab": PLAIN.replace(",", "\t"),
    "bar": PLAIN.replace(",", "|"),
    "semicolon": PLAIN.replace(",", ";"),
    "decimal comma": PLAIN.replace(",", ";").replace(".", ","),
    "decimal comma and tab": PLAIN.replace(",", "\t").replace(".", ","),
    "quoted": "\n".join(",".join(f'"{cell}"' for cell in row.split(",")) for row in PLAIN.splitlines()),
    "padded": PLAIN.replace(",", " , "),
    "trailing delimiter": PLAIN.replace("\n", ",\n"),
    "trailing delimiter in the rows alone": PLAIN.replace("\n", ",\n").replace("_m,\n", "_m\n"),
    "byte-order mark": b"\xef\xbb\xbf" + PLAIN.encode(),
    "UTF-16 little endian": b"\xff\xfe" + PLAIN.encode("utf-16-le"),
    "UTF-16 big endian": b"\xfe\xff" + PLAIN.encode("utf-16-be"),
    "comments": "# made by a logger\n% 2, 3, 4\n" + PLAIN.replace("0.1,", "# resumed\n0.1,"),
    "row without readings above": PLAIN.replace("_m\n", "_m\n,,\n"),
    "separator line": "sep=,\n" + PLAIN,
    "preamble": "Logger 7\nSerial,12\nRate,1667,Hz\n\n" + PLAIN,
    "header in a comment": "# " + PLAIN,
    "unit row": "t,accel,position\ns,m/s^2,m\n" + PLAIN.split("\n", 1)[1],
    "unit row in brackets": "t,accel,position\n[s],[m/s²],[m]\n" + PLAIN.split("\n", 1)[1],
    "units in brackets": "t [s],accel [m/s^2],position (m)\n" + PLAIN.split("\n", 1)[1],
    "Latin-1": "Prüfstand\nt [s],accel [m/s²],position [m]\n".encode("latin-1") + PLAIN.split("\n", 1)[1].encode(),
    "capitals": "Time_s,Acceleration_m_per_s2,Pos_m\n" + PLAIN.split("\n", 1)[1],
    "signs and exponents": "t_s,accel_m_per_s2,position_m\n0,+5e-1,1E-3\n1e-1,-1.5,\n.2,2.25,+.003\n",
    "text column": PLAIN.replace("_m\n", "_m,state\n").replace("0.001\n", "0.001,S\n").replace(",\n", ",,\n")[:-1]
    + ",M\n",
    "ISO stamps": "time,accel_m_per_s2,position_m\n2026-11-20T10:00:00.0,0.5,0.001\n2026-11-20T10:00:00.1,-1.5,\n"
    "2026-11-20T10:00:00.2,2.25,0.003\n",
    "zoned stamps": "time,accel_m_per_s2,position_m\n2026-11-20 10:00:00.0Z,0.5,0.001\n"
    "2026-11-20 11:00:00.1+01:00,-1.5,\n2026-11-20 10:00:00.2Z,2.25,0.003\n",
    "stamps and decimal comma": "time;accel_m_per_s2;position_m\n2026-11-20 10:00:00,0;0,5;0,001\n"
    "2026-11-20 10:00:00,1;-1,5;\n2026-11-20 10:00:00,2;2,25;0,003\n",
}


@pytest.mark.parametrize("content", DIALECTS.values(), ids=DIALECTS.keys())
def test_every_dialect_gives_the_same_channels(tmp_path, content):
    recording = load(tmp_path, content)
    np.testing.assert_allclose(recording.accel.t, T, rtol=0, atol=1e-15)  # stamps count whole nanoseconds
    assert recording.accel.y.tolist() == ACCEL
    assert recording.position.y.tolist() == list(POSITION.values())


def test_row_without_header_is_named_by_column_numbers(tmp_path):
    (tmp_path / "run.toml").write_text(
        '[channels]\ntime = { column = "1", unit = "s" }\naccel = { column = "2", unit = "g" }\n'
        'position = { column = "3", unit = "mm" }\n'
    )
    recording = load(tmp_path, "0.0,1,1\n0.1,2,2\n0.2,1,4\n")
    assert recording.position.y.tolist() == [0.001, 0.002, 0.004]


def test_single_column_with_a_rate_keeps_empty_lines_as_missing_samples(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("accel_g\n1\n2\n\n4\n")
    (tmp_path / "run.toml").write_text('[channels]\nrate = "10 Hz"\n')
    accel = io.load(path, need_position=False).accel
    np.testing.assert_allclose(accel.t, [0.0, 0.1, 0.3], rtol=1e-15)


@settings(max_examples=50, deadline=None)
@given(
    values=st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=20),
    delimiter=st.sampled_from([",", ";", "\t", "|"]),
    comma=st.booleans(),
    end=st.sampled_from(["\n", "\r\n"]),
    preamble=st.sampled_from(["", "Logger X\n", "# a, b\n\n", "Serial;12\n"]),
)
def test_numbers_survive_any_dialect(tmp_path_factory, values, delimiter, comma, end, preamble):
    decimal = "," if comma and delimiter != "," else "."
    rows = [[f"{k / 8!r}", f"{value!r}"] for k, value in enumerate(values)]
    body = "".join(delimiter.join(row).replace(".", decimal) + end for row in rows)
    path = tmp_path_factory.mktemp("dialect") / "run.csv"
    path.write_bytes((preamble + delimiter.join(["t_s", "accel_m_per_s2"]) + end + body).encode())
    recording = io.load(path, need_position=False)
    assert recording.accel.y.tolist() == values


FAULTS = [
    (PLAIN.replace("-1.5", "ERR"), 'row 3, column "accel_m_per_s2": found "ERR", expected a number'),
    (PLAIN.replace("-1.5,", "-1.5,7,"), "row 3 has 4 cells where"),
    (
        PLAIN.replace("0.5,", "0.5,7,"),
        'row 2 is neither a header nor like the rows of numbers below it: found "0.0,0',
    ),
    (PLAIN.replace("0.0,0.5,", "ERR,ERR,"), "row 2 is neither a header nor like the rows of numbers below it"),
    (PLAIN + "0.3,1\n0.4,1,\n", "row 5 has 2 cells where"),
    ("# one\n\n" + PLAIN.replace("-1.5", "1.5.2"), 'row 5, column "accel_m_per_s2": found "1.5.2"'),
    (PLAIN.split("\n")[0] + "\n", "no row of numbers among the first 1 lines"),
    ("hello\nworld\n", "no row of numbers among the first 2 lines"),
    ("t_s,accel_g,a,b\n0,1\n1,2\n2,3\n", "the header has 4 columns but row 2 has 2"),
    ("t_s,accel_g\n0.0,1\n2026-11-20,2\n", 'found "2026-11-20", expected a number'),
    (
        "time,accel_g\n2026-11-20T10:00,1\n2026-11-20T10:01,2\n10:02,2\n",
        'found "10:02", expected an ISO 8601 date and time',
    ),
    (LONG + "9999," + "1" * 5_000_000 + ",2\n", "row 40002 is longer than 65536 characters"),
    (LONG + "9999,ERR,2\n", 'row 40002, column "accel_m_per_s2": found "ERR"'),
    (PLAIN + "0.3," + "1" * 100_000 + ",2\n", "row 5 is longer than 65536 characters"),
    (PLAIN + "0.3," + "1" * 5_000_000 + ",2\n", "row 5 is longer than 65536 characters"),
    ("time,accel_g\n2026-13-45,1\n2026-13-46,2\n", 'row 2, column "time": found "2026-13-45"'),
    ("time,accel_g\n2026-11-20T10:00Z,1\n2026-11-20T10:01,2\n", "expected a zone offset"),
    (b"\x7fELF\x02\x01\x01\x00" + bytes(range(256)) * 20, "not text but binary data"),
    (bytes(range(1, 9)) * 500, "not text but binary data"),
    (PLAIN.encode("utf-16-le"), "not text but binary data"),
]


@pytest.mark.parametrize(("content", "message"), FAULTS, ids=[message for _, message in FAULTS])
def test_fault_is_named_with_its_row_and_column(tmp_path, content, message):
    with pytest.raises(RecordingError) as error:
        load(tmp_path, content, need_position=False)
    assert str(tmp_path / "run.csv") in str(error.value)
    assert message in str(error.value)


def test_ten_megabytes_in_one_line_fail_fast_and_small(tmp_path):
    import time
    import tracemalloc

    path = tmp_path / "run.csv"
    path.write_bytes(b"1234567,8" * 1_200_000)
    tracemalloc.start()
    begin = time.perf_counter()
    with pytest.raises(RecordingError, match="row 1 is longer than 65536 characters"):
        io.load(path)
    spent, peak = time.perf_counter() - begin, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert spent < 0.5
    assert peak < 5e6  # bytes: the head and a few copies of it


@settings(max_examples=200, deadline=None)
@given(
    st.one_of(
        st.binary(max_size=300),
        st.text(max_size=300).map(str.encode),
        st.text(alphabet='0123456789.,;\t\n\r"#+-eT:Z naif', max_size=300).map(
            lambda text: b"t_s,accel_g\n" + text.encode()
        ),
    )
)
def test_any_bytes_are_either_a_recording_or_a_recording_error(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("bytes") / "run.csv"
    path.write_bytes(content)
    try:
        samples = len(io.load(path, need_position=False).accel)
    except RecordingError:
        samples = 2
    assert samples >= 2
