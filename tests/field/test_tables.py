"""Tables as loggers, motion capture, serial monitors and spreadsheets write them: read right, or refused.

The files are written here by analytic motion; nothing of the package makes them.
"""

import json
import os
import re
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest

import accelcal
from accelcal import io
from accelcal.data.recording import RecordingError
from tests.commands import accelcal as command
from tests.io.recorders import workbook

K, K0 = 0.013, 0.11
"""Planted error of the scale factor, and bias in m/s²."""
SECONDS = 30.0
CASES = Path(os.environ.get("ACCELCAL_FIELD_CASES", "/nowhere"))


class Motion:
    """Tones that swell and fade, from rest to rest; everything follows from the formula."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.f = 2.0 * np.pi * np.exp(self.rng.uniform(np.log(0.4), np.log(6.0), (8, 1)))
        self.phase = self.rng.uniform(0.0, 6.0, (8, 1))
        self.size = self.rng.uniform(0.3, 1.0, (8, 1)) / self.f**2
        self.long = SECONDS / 7.0

    def position(self, t):
        u = (t - 0.5 * SECONDS) / self.long
        swell = np.exp(-0.5 * u**2)
        return swell * (self.size * np.sin(self.f * t + self.phase)).sum(axis=0) + 2e-6 * self.noise(t)

    def output(self, t, k=K, bias=K0):
        u = (t - 0.5 * SECONDS) / self.long
        s, c = self.size * np.sin(self.f * t + self.phase), self.size * self.f * np.cos(self.f * t + self.phase)
        a = -(self.f**2) * s - 2.0 * u / self.long * c + (u**2 - 1.0) / self.long**2 * s
        return bias + (1.0 + k) * np.exp(-0.5 * u**2) * a.sum(axis=0) + 2e-3 * self.noise(t)

    def noise(self, t):
        return self.rng.standard_normal(len(t))


def stamps(rate, seconds=SECONDS):
    return np.arange(round(seconds * rate)) / rate


def write(path, lines, end="\n"):
    path.write_text(end.join(lines) + end, encoding="utf-8", newline="")
    return path


def sidecar(path, *channels, sensor=""):
    io.sidecar_of(path).write_text(sensor + "[channels]\n" + "\n".join(channels) + "\n")


def refused(*arguments, **settings):
    with pytest.raises(RecordingError) as error:
        io.load(*arguments, **settings)
    return str(error.value)


def follow(path, text):
    """Write the lines that a refusal shows below the sidecar that is there, in place of those of the same channel."""
    lines = [line.strip() for line in text.splitlines() if re.match(r"    \w+ *= ", line)]
    beside = io.sidecar_of(path)
    names = {line.split(" ", 1)[0] for line in lines}
    old = [line for line in beside.read_text().splitlines()] if beside.exists() else ["[channels]"]
    remaining = [line for line in old if line.split(" ", 1)[0] not in names]
    beside.write_text("\n".join([*remaining, *lines]) + "\n")


def assert_planted(fit, k=K, bias=K0):
    results = {name: fit[name] for name in ("scale_factor", "bias")}
    assert abs(results["scale_factor"].value - k) < 3.0 * results["scale_factor"].std
    assert abs(results["bias"].value - bias) < 3.0 * results["bias"].std


# Index brackets


INDEXED = {
    "px4": ("timestamp_us", "accel_m_s2[{}]", "position[{}]", 1e6),
    "matlab": ("t_ms", "acc ({}) [m/s^2]", "pos({})", 1e3),
}


@pytest.mark.parametrize("form", INDEXED.values(), ids=INDEXED.keys())
def test_a_number_in_brackets_is_an_index(tmp_path, form):
    time, accel, position, unit = form
    t, motion = stamps(50.0), Motion(1)
    y, p = motion.output(t), motion.position(t)
    accel = accel.replace("({}) [m/s^2]", "_m_s2({})")
    header = [time, *(accel.format(k) for k in range(1, 3)), *(position.format(k) for k in range(1, 3))]
    rows = [f"{unit * a:.0f},{b:.9g},{-b / 3:.9g},{c:.9g},{c / 7:.9g}" for a, b, c in zip(t, y, p, strict=True)]
    path = write(tmp_path / "run.csv", [",".join(header), *rows])
    text = io.init(path)
    assert re.search(r"^# pos(ition)?_1 = ", text, flags=re.MULTILINE)
    with pytest.raises(RecordingError, match="still to be filled in"):  # valid TOML, and what is asked for is told
        io.load(path)
    filled = text.replace(
        'accel = { column = "?", unit = "?" }', f'accel = {{ column = "{header[1]}", unit = "m/s^2" }}'
    )
    filled = filled.replace(
        'position = { column = "?", unit = "?" }', f'position = {{ column = "{header[3]}", unit = "m" }}'
    )
    io.sidecar_of(path).write_text(filled)
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.y, y, rtol=1e-8)
    np.testing.assert_allclose(recording.position.y, p, rtol=1e-8)


# Header rows


def capture(path, motion, delimiter=",", unit="Millimeters", kinds=True):
    """A motion capture of two bodies with a header of several rows; instants without the marker have empty cells."""
    t = stamps(100.0)
    p = {"Millimeters": 1e3, "Meters": 1.0}[unit] * motion.position(t)
    top = ["Format Version", "1.23", "Export Frame Rate", "100.000", "Length Units", unit]
    names = [*["Sled"] * 6, *["Base"] * 3]
    header = [
        delimiter.join(top),
        "",
        *([delimiter.join(["", "", *["Rigid Body"] * 6, *["Marker"] * 3])] if kinds else []),
        delimiter.join(["", "", *names]),
        delimiter.join(["", "", *["Rotation"] * 3, *["Position"] * 6]),
        delimiter.join(["Frame", "Time (Seconds)", *["X", "Y", "Z"] * 3]),
    ]
    rows = [
        delimiter.join([str(k), f"{a:.6f}", "0.1", "0.2", "0.3", f"{b:.6f}", "1.5", "2.5", "7", "8", "9"])
        if k % 50
        else delimiter.join([str(k), f"{a:.6f}", *[""] * 9])
        for k, (a, b) in enumerate(zip(t, p, strict=True))
    ]
    return write(path, [*header, *rows])


@pytest.mark.parametrize(
    "form", [{}, {"delimiter": ";", "unit": "Meters", "kinds": False}], ids=["comma, mm", "semicolon, m"]
)
def test_rows_of_a_header_are_joined_where_the_last_repeats(tmp_path, form):
    motion = Motion(2)
    take = capture(tmp_path / "take.csv", motion, **form)
    text = io.init(take)
    assert 'time = { column = "Time (Seconds)", unit = "Seconds" }' in text
    assert f'"Sled.Position.X" = {{ column = "Sled.Position.X", unit = "{form.get("unit", "Millimeters")}" }}' in text
    t = stamps(200.0, SECONDS + 4.0)
    lines = [f"{a + 51.2:.4f},{b / 9.80665:.7f}" for a, b in zip(t, motion.output(t - 2.0), strict=True)]
    imu = write(tmp_path / "imu.csv", ["time_s,accel_g", *lines])
    message = refused(imu, position=take)
    assert "still to be filled in; expected the name of a column. By its unit it may be" in message
    assert '"Sled.Position.X"' in message
    sidecar(take, 'position = { column = "Sled.Position.X", unit = "cm" }')
    assert 'says "cm"; correct one of the two' in refused(imu, position=take)
    sidecar(take, 'position = { column = "Sled.Position.X" }')
    recording = io.load(imu, position=take)
    assert len(recording.position) == round(100.0 * SECONDS) * 49 // 50
    assert_planted(accelcal.fit(recording))


# Two tables


def two_tables(path, motion, gap="", analog_first=True, seconds=SECONDS):
    """Analog channels and trajectories below each other, each with its rate."""
    t, s = stamps(200.0, seconds), stamps(100.0, seconds)
    volts = 2.5 + 0.03 * motion.output(t)
    analog = ["Devices", "200", ",,Accel,Accel", "Frame,Sub Frame,Ch1,Ch2", ",,V,V"]
    analog += [f"{1 + k // 2},{k % 2},{v:.7f},2.5" for k, v in enumerate(volts)]
    places = ["Trajectories", "100", ",,Sled:LED,,", "Frame,Sub Frame,X,Y,Z", ",,mm,mm,mm"]
    places += [f"{1 + k},0,{1e3 * p:.4f},299.9,80.1" for k, p in enumerate(motion.position(s))]
    both = (analog, places) if analog_first else (places, analog)
    write(path, [*both[0], *([gap] if gap is not None else []), *both[1]])
    sidecar(
        path,
        'rate = "200 Hz"',
        'accel = { column = "Ch1", unit = "V" }',
        sensor='[sensor]\nscale = "0.03 V/(m/s^2)"\nzero = "2.5 V"\n',
    )
    return path


@pytest.mark.parametrize("seconds", [SECONDS, 90.0], ids=["in the first lines", "beyond the first lines"])
@pytest.mark.parametrize("analog_first", [True, False])
def test_two_tables_in_a_file_are_read_each_with_its_rate(tmp_path, analog_first, seconds):
    path = two_tables(tmp_path / "trial.csv", Motion(3), analog_first=analog_first, seconds=seconds)
    message = refused(path)
    assert '"X" in mm, "Y" in mm, "Z" in mm' in message
    follow(path, message)
    recording = io.load(path)
    assert recording.accel.t[1] - recording.accel.t[0] == pytest.approx(1 / 200)
    assert recording.position.t[1] - recording.position.t[0] == pytest.approx(1 / 100)
    assert len(recording.position) == round(100 * seconds)
    if seconds == SECONDS:
        assert_planted(accelcal.fit(recording))
    if seconds == SECONDS and analog_first:
        assert_planted(accelcal.fit(io.load(path, position=path)))


@pytest.mark.parametrize("seconds", [SECONDS, 90.0], ids=["in the first lines", "beyond the first lines"])
def test_a_second_table_without_an_empty_line_is_named_with_its_row(tmp_path, seconds):
    path = two_tables(tmp_path / "trial.csv", Motion(4), gap=None, seconds=seconds)
    message = refused(path, need_position=False)
    row = int(re.search(r"a second table begins at row (\d+); put an empty line above that row", message)[1])
    lines = path.read_text().splitlines()
    assert lines[row - 1] == "Trajectories"
    write(path, [*lines[: row - 1], "", *lines[row - 1 :]])
    follow(path, refused(path))
    assert len(io.load(path).position) == round(100 * seconds)


# Rows of several sources


def test_a_column_that_tells_sensors_apart_is_offered(tmp_path):
    t, motion = stamps(50.0), Motion(5)
    level, other = motion.output(t), motion.output(t, -0.02, -0.2)
    rows = [f"{1e6 * a:.0f},{i},{y[k]:.6f}" for k, a in enumerate(t) for i, y in enumerate((level, other))]
    path = write(tmp_path / "imu.csv", ["TimeUS,I,AccX", *rows])
    rail = [f"{a:.3f},{b:.7f}" for a, b in zip(t, motion.position(t), strict=True)]
    write(tmp_path / "pos.csv", ["t_s,position_m", *rail])
    sidecar(path, 'time = { column = "TimeUS", unit = "us" }', 'accel = { column = "AccX", unit = "m/s^2" }')
    message = refused(path, need_position=False)
    assert 'with one value of column "I" (0, 1)' in message
    assert "rate" not in message
    follow(path, message)
    assert_planted(accelcal.fit(io.load(path, position=tmp_path / "pos.csv")))
    chosen = io.sidecar_of(path).read_text().replace("equals = 0", "equals = 1")
    io.sidecar_of(path).write_text(chosen)
    np.testing.assert_allclose(io.load(path, need_position=False).accel.y, other, atol=1e-6)
    io.sidecar_of(path).write_text(chosen.replace("equals = 1", "equals = 7"))
    assert 'no row has 7 in column "I"' in refused(path, need_position=False)


def test_a_text_that_tells_sensors_apart_is_offered(tmp_path):
    t, motion = stamps(80.0), Motion(15)
    level, other = motion.output(t), motion.output(t, -0.03, 0.4)
    both = (("arriba", level), ("abajo", other))
    rows = [f"{1e3 * a:.4f};{name};{y[k] / 9.80665:.8f}" for k, a in enumerate(t) for name, y in both]
    path = write(tmp_path / "sensores.csv", ["tiempo_ms;sensor;acel_g", *rows])
    rail = [f"{a:.4f},{1e3 * b:.5f}" for a, b in zip(t, motion.position(t), strict=True)]
    write(tmp_path / "regla.csv", ["t_s,position_mm", *rail])
    sidecar(path, 'time = { column = "tiempo_ms", unit = "ms" }', 'accel = { column = "acel_g", unit = "g" }')
    message = refused(path, need_position=False)
    assert 'with one value of column "sensor" ("abajo", "arriba")' in message
    follow(path, message.replace('equals = "abajo"', 'equals = "arriba"'))
    assert_planted(accelcal.fit(io.load(path, position=tmp_path / "regla.csv")))


@pytest.mark.parametrize("in_blocks", [False, True], ids=["in turn", "one after the other"])
def test_a_long_table_gives_each_channel_its_rows(tmp_path, in_blocks):
    t, motion = stamps(50.0), Motion(6)
    p, y = motion.position(t), motion.output(t)
    acc = [f"{a:.3f};acc;{b:.8f}" for a, b in zip(t, y, strict=True)]
    pos = [f"{a:.3f};Weg;{b:.8f}" for a, b in zip(t, p, strict=True)]
    rows = acc + pos if in_blocks else [row for pair in zip(acc, pos, strict=True) for row in pair]
    path = write(tmp_path / "run.csv", ["time_s;quantity;value", *rows])
    sidecar(path, 'accel = { column = "value", unit = "m/s^2" }')
    message = refused(path, need_position=False)
    assert 'one value of column "quantity" ("Weg", "acc")' in message
    follow(path, message.replace('equals = "Weg"', 'equals = "acc"'))
    sidecar(
        path,
        'accel = { column = "value", unit = "m/s^2", where = { column = "quantity", equals = "acc" } }',
        'position = { column = "value", unit = "m", where = { equals = "Weg", column = "quantity" } }',
    )
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.y, y, atol=1e-8)
    np.testing.assert_allclose(recording.position.y, p, atol=1e-8)


# Lines that are no readings


def monitor(prefix):
    """What a serial monitor shows: a cut line, words, the header, rows with messages between them, a cut line."""
    t, motion = stamps(50.0), Motion(7)
    y, p = motion.output(t), motion.position(t)
    rows = [f"{1e3 * a:.0f},{b / 9.80665:.6f},{1e3 * c:.3f}" for a, b, c in zip(t, y, p, strict=True)]
    lines = [*rows[:500], "I2C error", *rows[500:900], "bus timeout, reset", *rows[900:], rows[-1][:4]]
    marked = [f"{prefix(k)}{line}" for k, line in enumerate(["ready", "millis,ax_g,pos_mm", *lines])]
    return ["17,0.01,3.2", *marked] if prefix(0) else marked, y, p


@pytest.mark.parametrize(
    "prefix",
    [
        lambda k: "",
        lambda k: f"10:{k // 3000 % 60:02d}:{k // 50 % 60:02d}.{20 * (k % 50):03d} -> ",
        lambda k: f"[2024-05-01 10:00:{k // 50 % 60:02d}] ",
    ],
    ids=["plain", "monitor", "brackets"],
)
def test_messages_and_cut_lines_are_left_out_and_counted(tmp_path, prefix):
    lines, y, p = monitor(prefix)
    path = write(tmp_path / "run.txt", lines, end="\r\n")
    io.init(path)
    assert 'time = { column = "millis", unit = "ms" }' in io.sidecar_of(path).read_text()
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.y, y, atol=1e-4)
    np.testing.assert_allclose(recording.position.y, p, atol=1e-6)
    left_out = [finding for finding in recording.findings if finding.kind == "left_out_lines"]
    assert [finding.count for finding in left_out] == ([2, 3] if prefix(0) else [3])
    assert '"I2C error", "bus timeout, reset"' in left_out[-1].text
    shown = command("check", path)
    assert shown.returncode == 0
    assert "3 lines that are no readings are left out (rows 50" in shown.stdout.replace("\n", " ")


def test_summary_rows_at_the_end_are_left_out(tmp_path):
    t, motion = stamps(50.0), Motion(8)
    rows = [f"{a:.3f};{b:.5f};{1e3 * c:.4f}" for a, b, c in zip(t, motion.output(t), motion.position(t), strict=True)]
    content = ["Zeit [s];Beschleunigung [m/s²];Weg [mm]", *rows, "Max;9,1;80,2", "Mittelwert;0,1;0,0"]
    path = write(tmp_path / "run.csv", [line.replace(".", ",") for line in content])
    io.init(path)
    recording = io.load(path)
    assert len(recording.accel) == len(t)
    assert "2 lines that are no readings are left out (rows 1502, 1503)" in recording.findings[-1].text
    shown = command("fit", path)
    assert "2 lines that are no readings are left out" in " ".join(shown.stdout.split())


def test_rows_that_are_damaged_inside_are_listed(tmp_path):
    rows = [f"{k / 50},{k % 7},{k % 5}" for k in range(1000)]
    rows[300] = rows[400] = "6,1"
    path = write(tmp_path / "run.csv", ["t_s,accel_g,position_mm", *rows])
    message = refused(path)
    assert (
        "row 302 has 2 cells where the rows before have 3, as in 1 more: 402; complete or delete these rows" in message
    )
    write(path, ["t_s,accel_g,position_mm", *rows[:300], *rows[301:400], *rows[401:]])
    assert len(io.load(path).accel) == 998


def test_a_header_with_fewer_names_than_cells_is_refused(tmp_path):
    path = write(tmp_path / "run.csv", ["t_s,accel_g", *(f"{k / 50},{k % 7},{k % 5}" for k in range(100))])
    assert "the header has 2 columns but row 2 has 3; make them agree" in refused(path)


@pytest.mark.parametrize(("key", "stated"), [("Sampling rate [Hz];50", True), ("Baud rate;115200", False)])
def test_a_key_row_states_the_rate_where_no_column_has_the_time(tmp_path, key, stated):
    rows = [f"{k % 7};{k % 5}" for k in range(100)]
    path = write(tmp_path / "run.csv", ["Logger 7", "4711", key, "", "accel_g;position_mm", *rows])
    if stated:
        assert io.load(path).accel.t[1] == pytest.approx(0.02)
    else:
        assert "no column for time" in refused(path)


# Text files of LabVIEW


@pytest.mark.parametrize(("with_time", "decimal"), [(True, "."), (False, "."), (True, ","), (False, ",")])
def test_text_of_labview_has_units_and_a_clock(tmp_path, with_time, decimal):
    t, motion = stamps(100.0), Motion(9)
    y, p = motion.output(t), motion.position(t)
    head = ["LabVIEW Measurement", "Writer_Version\t2", "Separator\tTab", f"X_Columns\t{'One' if with_time else 'No'}"]
    head += ["Date\t2024/05/01", "Time\t10:15:01.5", "***End_of_Header***", "", "Channels\t2", "Samples\t3000\t3000"]
    head += ["Y_Unit_Label\tm/s^2\tmm", "X_Dimension\tTime\tTime", "X0\t0.0\t0.0", "Delta_X\t0.01\t0.01"]
    head += ["***End_of_Header***", "X_Value\tacc\tpos\tComment"]
    rows = [f"{f'{a:.6f}' if with_time else ''}\t{b:.8f}\t{1e3 * c:.6f}" for a, b, c in zip(t, y, p, strict=True)]
    path = write(tmp_path / "run.lvm", [line.replace(".", decimal) for line in [*head, *rows]], end="\r\n")
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.t, t, atol=1e-9)
    np.testing.assert_allclose(recording.accel.y, y, atol=1e-8)
    np.testing.assert_allclose(recording.position.y, p, atol=1e-8)


# Instants


def clock(seconds, form):
    """A time of day, past midnight again from 0."""
    day, rest = divmod(seconds, 86400.0)
    h, m, s = int(rest // 3600), int(rest // 60) % 60, rest % 60
    half = "AM" if h < 12 else "PM"
    return {
        "hms": f"{h:02d}:{m:02d}:{s:06.3f}",
        "comma": f"{h}:{m:02d}:{s:06.3f}".replace(".", ","),
        "half": f"{(h + 11) % 12 + 1}:{m:02d}:{s:06.3f} {half}",
        "dmy": f"{28 + int(day):02d}.06.2024 {h:02d}:{m:02d}:{s:06.3f}",
        "us": f"06/{28 + int(day):02d}/2024 {(h + 11) % 12 + 1:02d}:{m:02d}:{s:06.3f} {half}",
        "ymd": f"2024/06/{28 + int(day):02d} {h:02d}:{m:02d}:{s:06.3f}",
        "open": f"{6 + int(day):02d}/07/2024 {h:02d}:{m:02d}:{s:06.3f}",
    }[form]


def clocked(path, form, begin=86385.0):
    t, motion = stamps(50.0), Motion(10)
    y, p = motion.output(t), motion.position(t)
    rows = [f"{clock(begin + a, form)};{b:.7f};{1e3 * c:.5f}" for a, b, c in zip(t, y, p, strict=True)]
    return write(path, ["Time;acc [m/s²];pos [mm]", *rows]), t, y


@pytest.mark.parametrize("form", ["hms", "comma", "half", "dmy", "us", "ymd"])
def test_instants_pass_midnight(tmp_path, form):
    path, t, y = clocked(tmp_path / "run.csv", form)
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.t - recording.accel.t[0], t, atol=1e-9)
    np.testing.assert_allclose(recording.accel.y, y, atol=1e-6)
    io.init(path)
    assert len(io.load(path).accel) == len(t)


def test_the_order_of_day_and_month_is_asked_where_it_matters(tmp_path):
    path, t, _ = clocked(tmp_path / "within.csv", "open", begin=40000.0)
    assert len(io.load(path).accel) == len(t)
    path, t, _ = clocked(tmp_path / "run.csv", "open")
    message = refused(path)
    assert '"06/07/2024 23:59:45.000" and "07/07/2024 00:00:00.000": the order of day and month is open' in message
    sidecar(path, 'time = { column = "Time", order = "DMY" }')
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.t - recording.accel.t[0], t, atol=1e-9)
    sidecar(path, 'time = { column = "Time", order = "day first" }')
    assert 'expected "DMY" or "MDY"' in refused(path)


@pytest.mark.parametrize("fraction", ["us", "Milliseconds"])
def test_date_time_and_fraction_are_asked_for_and_added(tmp_path, fraction):
    t, motion = stamps(50.0), Motion(11)
    unit = {"us": 1e6, "Milliseconds": 1e3}[fraction]
    y = motion.output(t)
    rows = []
    for a, b, c in zip(t, y, motion.position(t), strict=True):
        second = int(np.floor(86385.0 + a + 1e-9))
        date, time = clock(second, "ymd").split(" ")
        rows.append(f"{date}\t{time[:8]}\t{unit * (86385.0 + a - second):.0f}\t{b:.7f}\t{1e3 * c:.5f}")
    path = write(tmp_path / "run.csv", [f"Date\tTime\t{fraction}\tacc [m/s²]\tpos [mm]", *rows])
    message = refused(path)
    assert f'the parts of an instant stand in several columns, "Date", "Time", "{fraction}"' in message
    follow(path, message)
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.t - recording.accel.t[0], t, atol=1e-9)
    np.testing.assert_allclose(recording.accel.y, y, atol=1e-6)
    io.sidecar_of(path).unlink()
    io.init(path)
    assert len(io.load(path).accel) == len(t)


LANGUAGES = {
    "french": ("Date;Heure;us;acc [m/s²];pos [mm]", ";", 1e6),
    "german": ("Uhrzeit,Datum,ms,acc [m/s²],pos [mm]", ",", 1e3),
}


@pytest.mark.parametrize("language", LANGUAGES)
def test_times_of_day_are_distinguished_by_their_form(tmp_path, language):
    header, mark, unit = LANGUAGES[language]
    t, motion = stamps(200.0), Motion(13)
    y = motion.output(t)
    rows = []
    for a, b, c in zip(t, y, motion.position(t), strict=True):
        second = int(np.floor(86385.0 + a + 1e-9))
        date, time = clock(second, "dmy").split(" ")
        instant = [date, time[:8]] if language == "french" else [time[:8], date]
        rows.append(mark.join([*instant, f"{unit * (86385.0 + a - second):.0f}", f"{b:.7f}", f"{1e3 * c:.5f}"]))
    path = write(tmp_path / "run.csv", [header, *rows])
    message = refused(path)
    assert "the parts of an instant stand in several columns" in message
    follow(path, message)
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.t - recording.accel.t[0], t, atol=1e-9)
    assert not recording.side  # what serves the clock is no channel
    assert_planted(accelcal.fit(recording))
    io.sidecar_of(path).unlink()
    assert "fraction = {" in io.init(path)
    assert len(io.load(path).accel) == len(t)
    alone = [mark.join(row.split(mark)[:2] + row.split(mark)[3:]) for row in [header, *rows]]
    message = refused(write(tmp_path / "coarse.csv", alone))
    assert f'time = {{ column = "{"Heure" if language == "french" else "Uhrzeit"}"' in message


@pytest.mark.parametrize("header", ["时间（ms）,加速度（m/s²）,位移（mm）", "時刻［ms］,加速度［m/s²］,変位［mm］"])
def test_full_width_brackets_hold_units(tmp_path, header):
    t, motion = stamps(200.0), Motion(14)
    y, p = motion.output(t), motion.position(t)
    rows = [f"{1e3 * a:.0f},{b:.7f},{1e3 * c:.5f}" for a, b, c in zip(t, y, p, strict=True)]
    path = write(tmp_path / "run.csv", [header, *rows])
    assert "FILL IN" not in io.init(path).split("[channels]")[1].split("[uncertainty]")[0]
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.t, t, atol=1e-9)
    assert_planted(accelcal.fit(recording))


# First sidecars


def test_a_first_sidecar_leaves_copies_out_and_check_lists_what_it_drops(tmp_path):
    t, motion = stamps(50.0), Motion(12)
    y, p = motion.output(t), motion.position(t)
    rows = [
        f"{a:.3f},{b:.7f},{1e3 * c:.4f},{1e3 * c:.4f},{k % 3}" for k, (a, b, c) in enumerate(zip(t, y, p, strict=True))
    ]
    path = write(tmp_path / "run.csv", ["Zeit [s],Signal [m/s^2],Weg [mm],Weg2 [mm],Zustand", *rows])
    text = io.init(path)
    assert "# Weg2 [mm] is a copy of Weg [mm]" in text
    assert 'position = { column = "Weg [mm]", unit = "mm" }  # by its unit alone: check that it is this one' in text
    shown = command("check", path)
    assert shown.returncode == 0
    assert "columns that run.toml does not name are not used: Weg2 [mm], Zustand" in shown.stdout


def test_names_that_repeat_have_keys_of_their_own(tmp_path):
    rows = [f"{k / 50},{k % 7},{k % 5},{k % 3},{k % 2}" for k in range(100)]
    path = write(tmp_path / "run.csv", ["t_s,accel_g,position_mm,rpm_Hz,rpm_Hz", *rows])
    io.init(path)
    message = refused(path)
    assert '2 columns are called "rpm_Hz"; rename all but one' in message


# Foreign files


MARKED = {
    "log.ulg": (b"ULog\x01\x12\x35" + bytes(50), "ulog2csv"),
    "flight.bbl": (b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n", "blackbox_decode"),
    "drop.ide": (b"\x1a\x45\xdf\xa3" + bytes(50), "enDAQ Lab"),
    "old.xls": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(50), "save it as .xlsx or CSV"),
    "run.csv.gz": (b"\x1f\x8b\x08" + bytes(50), "unpack it"),
    "00000001.bin": (b"\xa3\x95\x80" + bytes(50), "mavlogdump.py"),
}


@pytest.mark.parametrize(("name", "content"), MARKED.items(), ids=MARKED.keys())
def test_a_foreign_file_is_named_with_its_exporter(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content[0])
    assert content[1] in refused(path)


@pytest.mark.parametrize(("inside", "message"), [("run.csv", "ZIP archive; unpack it"), ("info.txt", "ActiLife")])
def test_an_archive_is_no_npz(tmp_path, inside, message):
    path = tmp_path / "run.bin"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(inside, "t_s,accel_g\n0,1\n")
    assert message in refused(path)


@pytest.mark.parametrize("unit_row", [False, True])
def test_a_workbook_is_read(tmp_path, unit_row):
    pytest.importorskip("python_calamine")
    t, motion = stamps(200.0), Motion(13)
    y, p = motion.output(t), motion.position(t)
    header = [["t", "accel", "position"], ["s", "m/s^2", "m"]] if unit_row else [["t_s", "accel [m/s^2]", "position_m"]]
    numbers = [[float(cell) for cell in row] for row in zip(t, y, p, strict=True)]
    path = workbook(tmp_path / "run.xlsx", [["Messung 7", "", ""], *header, *numbers])
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.y, y, rtol=1e-12)
    np.testing.assert_allclose(recording.position.y, p, rtol=1e-12)


def test_a_name_that_no_file_can_have_ends_in_a_sentence(tmp_path):
    rows = [f"{k / 50},{k % 7},{k % 5}" for k in range(100)]
    path = write(tmp_path / "run.csv", ["t_s,accel_g,position_mm", *rows])
    shown = command("fit", path, "-o", f"{'x' * 300}.json")
    assert "cannot be written (File name too long); write elsewhere" in " ".join(shown.stderr.split())


# Shared cases


SHARED = [
    ("05_indexed_columns", ["combined.csv"], {"rig": "by_hand.toml"}, {}, 0.01, 0.1),
    ("07_two_tables_in_one_file", ["trial.csv"], {"position": "trial.csv"}, {"trial": "trajectories"}, 0.012, 0.1),
    (
        "06_header_of_several_rows",
        ["imu.csv"],
        {"position": "take.csv"},
        {"take": '[channels]\nposition = { column = "Sled.Position.X" }\n'},
        0.018,
        0.12,
    ),
    ("12_two_sensors_interleaved", ["imu.csv"], {"position": "pos.csv"}, {"imu": "where"}, 0.01, 0.1),
    ("15_text_log", ["plain.txt"], {}, {}, 0.01, 0.1),
    ("15_text_log", ["footer.csv"], {}, {}, 0.01, 0.1),
    ("15_text_log", ["serial_monitor.txt"], {}, {"serial_monitor": "init"}, 0.01, 0.1),
    ("16_time_of_day", ["hms.csv"], {}, {}, 0.01, 0.1),
    ("16_time_of_day", ["dmy.csv"], {}, {"dmy": "init"}, 0.01, 0.1),
    ("16_time_of_day", ["us_format.csv"], {}, {}, 0.01, 0.1),
    ("16_time_of_day", ["three_columns.csv"], {}, {"three_columns": "init"}, 0.01, 0.1),
]


@pytest.mark.parametrize("case", SHARED, ids=[f"{case[0][:2]}-{case[1][0]}" for case in SHARED])
def test_shared_cases_give_what_was_planted(tmp_path, case):
    folder, files, settings, written, k, bias = case
    if not (CASES / folder).is_dir():
        pytest.skip("ACCELCAL_FIELD_CASES names no folder of shared cases")
    shutil.copytree(CASES / folder, tmp_path / "case")
    path = tmp_path / "case" / files[0]
    path.parent.chmod(0o755)
    settings = {key: path.parent / name for key, name in settings.items()}
    for stem, text in written.items():
        beside = path.parent / f"{stem}.toml"
        if text == "init":
            io.init(path)
        elif text in ("where", "trajectories"):
            beside.chmod(0o644)
            follow(path, refused(path, **settings))
        else:
            beside.write_text(text)
    assert_planted(accelcal.fit(io.load(path, settings.pop("rig", None), **settings)), k, bias)


def test_six_shared_faces_give_scale_and_zero(tmp_path):
    for name in ("six.csv", "six.toml"):
        if not (CASES / "17_six_positions" / name).exists():
            pytest.skip("ACCELCAL_FIELD_CASES names no folder of shared cases")
        shutil.copy(CASES / "17_six_positions" / name, tmp_path / name)
    done = command("dwells", tmp_path / "six.csv", "--yes", "--json")
    assert done.returncode == 0, done.stderr
    fit = json.loads(done.stdout)
    truth = dict(zip(("K_x", "K_y", "K_z"), 1.0 / np.array([1.01, 0.985, 1.02]), strict=True))
    truth |= dict(zip(("b_x", "b_y", "b_z"), 9.80665 * np.array([0.03, -0.05, 0.02]), strict=True))
    assert len(fit["std"]) == 6
    for name, std in fit["std"]:
        assert abs(fit["values"][name] - truth[name]) < 3.0 * std
    assert "Ten or more" in fit["sentence"]


@pytest.mark.parametrize("name", ["rest.csv", "warm_up.csv"])
def test_shared_records_at_rest_give_lines_of_the_sidecar(name):
    path = CASES / "20_rest_record" / name
    if not path.exists():
        pytest.skip("ACCELCAL_FIELD_CASES names no folder of shared cases")
    done = command("rest", path)
    assert done.returncode == 0, done.stderr
    assert 'noise = "19' in done.stdout  # 0.00195 (m/s²)/sqrt(Hz) in both
    assert "# random_walk is below" in done.stdout  # of the warm-up as well
    assert ("K0 over temperature" in done.stdout) == (name == "warm_up.csv")


@pytest.mark.parametrize("name", ["run_v7.mat", "table_v7.mat", "run_v73.mat"])
def test_tables_of_matlab_are_named_with_the_line_to_write(name):
    path = CASES / "19_matlab_timetable" / name
    if not path.exists():
        pytest.skip("ACCELCAL_FIELD_CASES names no folder of shared cases")
    message = refused(path)
    assert 'writetimetable(run, "run.csv")' in message
    assert "damaged" not in message


@pytest.mark.parametrize(("variable", "kind"), [("Messung", "timetable"), ("ensayo", "table")])
def test_an_object_of_matlab_73_is_named_with_the_line_to_write(variable, kind, tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "lauf.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_group("#refs#")["0b"] = np.arange(9.0)
        item = file.create_dataset(variable, data=np.array([[3707764736, 2, 1, 1, 1, 1]], dtype=np.uint32))
        item.attrs["MATLAB_class"], item.attrs["MATLAB_object_decode"] = np.bytes_(kind), np.int32(3)
    assert f'writetimetable({variable}, "run.csv")' in refused(path)
