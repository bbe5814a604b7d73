"""Clocks of a user's own files: rates that differ, counters that wrap, restarts, packets, frames, losses."""

import json
import os
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

import accelcal
from accelcal import io
from accelcal.calibration.characteristic import budget
from accelcal.data import clocks
from accelcal.data.recording import Channel, RecordingError
from accelcal.model import Model
from accelcal.validation.evaluation import compare
from tests.commands import accelcal as command
from tests.field.two_clocks import Motion, pair

K, BIAS = 0.01, 0.1


def table(path, header, *columns, text=""):
    """A CSV file; NaN is an empty cell."""
    rows = zip(*(["" if np.isnan(y) else f"{y:.9f}".rstrip("0") for y in column] for column in columns), strict=True)
    path.write_text(header + "\n" + "".join(",".join(row) + "\n" for row in rows))
    path.with_suffix(".toml").write_text(text)
    return path


def within(fit, k=K, bias=BIAS):
    e = {estimate.name: estimate for estimate in fit.estimates}
    assert abs(e["scale_factor"].value - k) < 3.0 * e["scale_factor"].std
    assert abs(e["bias"].value - bias) < 3.0 * e["bias"].std


def note(recording, kind):
    return "".join(finding.text for finding in recording.findings if finding.kind == kind)


def fields(folder, tmp_path):
    """A copy of a shared case."""
    shared = os.environ.get("ACCELCAL_FIELD_CASES")
    if not shared:
        pytest.skip("ACCELCAL_FIELD_CASES does not name the folder of the shared cases")
    return Path(shutil.copytree(Path(shared) / folder, tmp_path / folder))


def shared_rates(both, path, rate):
    """One file whose sensor has no stamps, only a declared rate, in other units and words."""
    rows = max(len(both.accel), len(both.position))
    padded = [
        np.concatenate([y, np.full(rows - len(y), np.nan)])
        for y in (both.accel / 9.80665 * 1e3, both.position_t, both.position * 1e6)
    ]
    return table(
        path,
        "Beschleunigung;Zeit;Weg".replace(";", ","),
        *padded,
        text=f'[channels]\naccel = {{ column = "Beschleunigung", unit = "mg", time = {{ rate = "{rate} Hz" }} }}\n'
        'position = { column = "Weg", unit = "um", time = { column = "Zeit", unit = "s" } }\n',
    )


@pytest.mark.parametrize(("seed", "skew", "seconds", "sign"), [(1, -0.021, 60.0, 1.0), (2, 0.064, 45.0, 1.0)])
def test_a_sensor_that_is_not_at_its_declared_rate(tmp_path, seed, skew, seconds, sign):
    true = 400.0
    both = pair(seed, skew=0.0, seconds=seconds, rates=(true, 250.0), tones=True, sign=sign)
    path = shared_rates(both, tmp_path / "lauf.csv", true / (1.0 + skew))
    recording = io.load(path)
    message = note(recording, "alignment")
    match = re.match(r"the sensor runs at ([0-9.]+) Hz, not ([0-9.]+) \(skew ([-+0-9.]+) ppm", message)
    assert match, message
    assert float(match[1]) == pytest.approx(true, rel=2e-4)
    assert "the clock of position is trusted" in message
    fit = accelcal.fit(recording, Model.linear().add("clock_skew"))
    within(fit)
    assert recording.accel.t[-1] == pytest.approx(both.accel_t[-1], abs=0.02)
    assert fit.rig.uncertainty.clock_rate == pytest.approx(abs(float(match[3])) * 1e-6, rel=1e-3)


@pytest.mark.parametrize(("seed", "true"), [(1, 102.0), (2, 97.0)])
def test_a_file_given_as_both_loggers_says_which_declared_rate_is_wrong(tmp_path, seed, true):
    both = pair(seed, skew=0.0, seconds=60.0, rates=(true, 100.0), tones=True)
    rows = min(len(both.accel), len(both.position))
    declared = (
        f'{name} = {{ column = "{column}", unit = "{unit}", time = {{ rate = "100 Hz" }} }}\n'
        for name, column, unit in (("accel", "u", "m/s^2"), ("position", "z", "m"))
    )
    path = table(
        tmp_path / "run.csv", "u,z", both.accel[:rows], both.position[:rows], text="[channels]\n" + "".join(declared)
    )
    recording = io.load(path, position=path)
    (rate,) = re.findall(r"the sensor runs at ([0-9.]+) Hz, not 100 ", note(recording, "alignment"))
    assert float(rate) == pytest.approx(true, rel=1e-4)
    within(accelcal.fit(recording, Model.linear().add("clock_skew")))
    other = shared_rates(both, tmp_path / "lauf.csv", 100)
    recording = io.load(other, position=other)
    assert note(recording, "alignment") == note(io.load(other), "alignment")  # aligned once


def test_the_other_clock_may_be_trusted(tmp_path):
    skew, true = 0.03, 300.0
    both = pair(4, skew=0.0, seconds=40.0, rates=(true, 200.0), tones=True)
    path = shared_rates(both, tmp_path / "run.csv", true / (1.0 + skew))
    message = note(io.load(path), "alignment")
    (line,) = re.findall(r"\[clock\] trusted = \"accel\"", message)[:1]
    table_name, key = line.split("] ")
    path.with_suffix(".toml").write_text(
        path.with_suffix(".toml").read_text()
        + f'{table_name}]\n{key}\n[uncertainty]\nclock_rate = "50 ppm"\nencoder_scale = 0\nlevel = "0 deg"\n'
        + 'misalignment = "0 deg"\n'
    )
    recording = io.load(path)
    assert "the clock of accel is trusted;" in note(recording, "alignment")
    fit = accelcal.fit(recording, Model.linear().add("clock_skew"))
    within(fit, k=(1.0 + K) * (1.0 + skew) ** 2 - 1.0)
    (line,) = [line for line in budget(fit).lines if line.estimate.name == "scale_factor"]
    (clock,) = [component for component in line.components if component.source == "rate of the clock"]
    assert clock.contribution == pytest.approx(2.0 * 50e-6 * fit.values().scale)


@pytest.mark.parametrize(("seed", "skew", "sign"), [(11, -0.0083, 1.0), (12, 0.047, 1.0), (13, 0.035, -1.0)])
def test_two_loggers_at_different_rates(tmp_path, seed, skew, sign):
    both = pair(seed, skew=skew, seconds=90.0, rates=(250.0, 125.0), tones=seed != 12, sign=sign)
    output = table(tmp_path / "imu.csv", "t_s,accel_m_per_s2", 1e3 + both.accel_t, both.accel)
    encoder = table(tmp_path / "encoder.csv", "t_s,position_mm", both.position_t, 1e3 * both.position)
    if sign < 0.0:
        with pytest.raises(RecordingError, match=r'with the other sign; declare .* mount = "reversed"'):
            io.load(output, position=encoder)
        output.with_suffix(".toml").write_text('[rig]\nmount = "reversed"\n')
    recording = io.load(output, position=encoder)
    assert "the clock of the output runs by" in note(recording, "alignment")
    within(accelcal.fit(recording, Model.linear().add("clock_skew")), bias=sign * BIAS)


@pytest.mark.parametrize("seed", [6011, 6019, 6041, 8035])
def test_a_motion_of_few_tones_has_one_rate_and_one_shift(seed):
    both = pair(seed)
    alignment = aligned(both)
    assert alignment.rate is not None
    middle = 0.5 * both.seconds
    late = alignment.instants(np.array([(1.0 + both.skew) * (both.shift + middle)]), 0.0)[0] - middle
    assert abs(late) * both.fastest < 0.05
    assert abs(alignment.rate.skew - both.skew) * both.seconds * both.fastest < 0.05


def aligned(both):
    return clocks.align(
        Channel("accel", both.accel_t, both.accel, "m/s^2"), Channel("position", both.position_t, both.position, "m")
    )


def test_a_rate_is_off_by_its_standard_deviation():
    pairs = [pair(5000 + seed, skew=(-1.0) ** seed * 0.004 * (seed + 1), seconds=40.0) for seed in range(16)]
    rates = [aligned(both).rate for both in pairs]
    z = [(rate.skew - both.skew) / rate.std for rate, both in zip(rates, pairs, strict=True)]
    assert 0.65 < np.sqrt(np.mean(np.square(z))) < 1.5


def test_what_is_alike_at_no_rate_says_which_were_tried(tmp_path):
    both = pair(21, related=False, skew=0.0, seconds=60.0, rates=(200.0, 100.0), tones=False)
    output = table(tmp_path / "a.csv", "t_s,accel_m_per_s2", both.accel_t, both.accel)
    encoder = table(tmp_path / "b.csv", "t_s,position_m", both.position_t, both.position)
    with pytest.raises(RecordingError, match=r"at no other rate: [0-9]+ rates from -8% to \+8% were tried"):
        io.load(output, position=encoder)
    t = np.arange(0.0, 60.0, 0.005)
    tone = 2.0 * np.pi * 1.3
    table(output, "t_s,accel_m_per_s2", 1.03 * t, np.sin(tone * t))
    rng = np.random.default_rng(1)
    table(encoder, "t_s,position_m", t, -np.sin(tone * t) / tone**2 + 1e-6 * rng.standard_normal(len(t)))
    with pytest.raises(RecordingError, match=r"the motion is one tone, 1\.[23][0-9]* Hz"):
        io.load(output, position=encoder)


def test_equal_rates_are_left_alone():
    both = pair(31, skew=0.0, seconds=40.0, rates=(200.0, 100.0), tones=True)
    columns = {"units": {"accel": "m/s^2", "position": "m"}, "position_t": both.position_t}
    recording = accelcal.Recording.from_arrays(both.accel_t, both.accel, both.position, **columns)
    assert not note(recording, "alignment")
    np.testing.assert_array_equal(recording.accel.t, both.accel_t)


def moving(seed, seconds, rate, noise=1e-5):
    """Stamps, output and position on one clock."""
    rng = np.random.default_rng(seed)
    motion, t = Motion.of_tones(rng, 0.4, 4.0, 6), np.arange(0.0, seconds, 1.0 / rate)
    u = BIAS + (1.0 + K) * motion.acceleration(t) + 0.005 * rng.standard_normal(len(t))
    return t, u, motion.position(t) + noise * rng.standard_normal(len(t))


TICKS = (
    '[channels]\ntime = {{ column = "{name}", unit = "{unit}" }}\naccel = {{ column = "u", unit = "m/s^2" }}\n'
    'position = {{ column = "z", unit = "m" }}\n'
)


@pytest.mark.parametrize(
    ("bits", "signed", "tick", "unit", "seconds"),
    [
        (32, False, 1e-6, "us", 40.0),
        (32, True, 1e-6, "us", 40.0),
        (31, False, 1e-3, "ms", 40.0),
        (24, False, 1e-6, "us", 60.0),
        (16, False, 1e-3, "ms", 150.0),
        (24, False, 1e-6, "s", 60.0),
    ],
)
def test_a_counter_that_wraps(tmp_path, bits, signed, tick, unit, seconds):
    t, u, z = moving(bits, seconds, 100.0)
    count = np.rint(t / tick) + 2.0**bits - round(0.3 * seconds / tick)
    count = np.mod(count, 2.0**bits)
    if signed:
        count = np.where(count >= 2.0 ** (bits - 1), count - 2.0**bits, count)
        count = np.mod(count + 2.0**bits + 2.0 ** (bits - 1), 2.0**bits) - 2.0 ** (bits - 1)
    written = count * tick if unit == "s" else count
    path = table(tmp_path / "run.csv", "zaehler,u,z", written, u, z, text=TICKS.format(name="zaehler", unit=unit))
    recording = io.load(path)
    assert recording.accel.t[-1] - recording.accel.t[0] == pytest.approx(t[-1], rel=1e-9)
    if np.any(np.diff(count) < 0.0):
        assert 'column "zaehler" counts to its end and starts anew' in note(recording, "counter_wraps")
    within(accelcal.fit(recording))


def test_a_clock_that_restarts_is_cut_as_the_sentence_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    t, u, z = moving(5, 60.0, 100.0)
    stamps = np.where(t < 23.0, t + 5.0, t - 23.0 + 5.0)
    table(Path("run.csv"), "time_s,u,z", stamps, u, z, text=TICKS.format(name="time_s", unit="s"))
    refused = command("check", "run.csv")
    assert refused.returncode == 3
    assert (
        "starts again at row 2302: 5 s after 27.99 s. The file holds 2 runs: part 1, row 2 to row 2301"
        in refused.stderr
    )
    assert "sort" not in refused.stderr.lower()
    (printed,) = re.findall(r"accelcal (cut run\.csv --part 1 -o \S+)", refused.stderr)
    for advice in (printed, printed.replace("part 1", "part 2").replace("_1", "_2")):
        assert command(*advice.split()).returncode == 0
        within(accelcal.fit(io.load(Path(advice.split()[-1]))))
    absent = command("cut", "run.csv", "--part", "3", "-o", "c.csv")
    assert absent.returncode == 3
    assert "the file has 2 parts" in absent.stderr


@pytest.mark.parametrize(("again", "seed"), [("output", 3), ("position", 4)])
def test_one_of_two_loggers_that_restarts_is_cut_as_the_sentence_says(tmp_path, monkeypatch, again, seed):
    monkeypatch.chdir(tmp_path)
    motion, rng = Motion.of_tones(np.random.default_rng(seed), 0.4, 6.0, 12), np.random.default_rng(seed)
    ta, tp = np.arange(0.0, 60.0, 0.01), np.arange(0.0, 58.0, 0.01)
    u = BIAS + (1.0 + K) * motion.acceleration(ta) + 5e-3 * rng.standard_normal(len(ta))
    z = motion.position(tp) + 1e-5 * rng.standard_normal(len(tp))
    restarted = {"output": ta, "position": tp}[again]
    restarted[restarted > 49.99] -= 49.0
    Path("two runs").mkdir()
    files = {"output": Path("two runs/a b.csv"), "position": Path("two runs/p q.csv")}
    table(files["output"], "time_s,accel_m_per_s2", ta, u)
    table(files["position"], "time_s,position_m", tp, z)
    Path("my lab.toml").write_text('[rig]\naxis = "level"\n')
    refused = command("fit", files["output"], "--position", files["position"], "--rig", "my lab.toml")
    assert refused.returncode == 3
    (printed,) = re.findall(r"accelcal (cut .* --part 1 -o .*)", refused.stderr)
    assert ("--rig 'my lab.toml'" in printed) == (again == "output")
    assert command(*shlex.split(printed)).returncode == 0
    files[again] = Path(shlex.split(printed)[-1])
    within(accelcal.fit(io.load(files["output"], position=files["position"]), Model.linear().add("clock_skew")))


def test_two_loggers_written_as_one_file_still_have_two_clocks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    motion, rng = Motion.of_tones(np.random.default_rng(8), 0.4, 6.0, 12), np.random.default_rng(8)
    ta, tp, skew = np.arange(0.0, 30.0, 0.01), np.arange(0.0, 29.0, 0.01), 400e-6
    u = BIAS + (1.0 + K) * motion.acceleration(ta) + 5e-3 * rng.standard_normal(len(ta))
    z = motion.position(tp) + 1e-5 * rng.standard_normal(len(tp))
    output = table(Path("output.csv"), "time_s,accel_m/s^2", ta * (1.0 + skew), u)
    position = table(Path("position.csv"), "time_s,position_m", tp, z)
    assert command("cut", output, "--position", position, "-o", "joined.csv").returncode == 0
    of_two = json.loads(command("fit", output, "--position", position, "--json").stdout)["estimates"]
    joined = json.loads(command("fit", "joined.csv", "--json").stdout)["estimates"]
    assert [row["name"] for row in joined] == ["bias", "scale_factor", "time_offset", "clock_skew"]
    for row, same in zip(joined, of_two, strict=True):
        assert abs(row["value"] - same["value"]) < 1e-3 * same["std"]
        assert row["std"] == pytest.approx(same["std"], rel=1e-3)


def test_a_part_without_output_and_position_is_refused(tmp_path):
    t, u, z = moving(6, 20.0, 50.0)
    path = table(tmp_path / "run.csv", "time_s,signal_g,weg_mm", np.mod(t, 10.0), u, z)
    refused = command("cut", path, "--part", "1", "-o", tmp_path / "a.csv")
    assert refused.returncode == 3
    assert "no column for accel" in refused.stderr


@pytest.mark.parametrize(("seconds", "unit", "scale"), [(65.3, "s", 1.0), (65.4, "ms", 1e3), (16.7, "us", 1e6)])
def test_two_runs_that_end_where_a_counter_would_are_no_wrap(tmp_path, seconds, unit, scale):
    t, u, z = moving(6, seconds, 50.0)
    stamps = np.rint(1e6 * np.concatenate([t, t])) / 1e6 * scale
    u, z = np.concatenate([u, u[::-1]]), np.concatenate([z, z[::-1]])
    path = table(tmp_path / "run.csv", "t,u,z", stamps, u, z, text=TICKS.format(name="t", unit=unit))
    with pytest.raises(RecordingError, match=rf"starts again at row {len(t) + 2}: .* The file holds 2 runs"):
        io.load(path)


@pytest.mark.parametrize(("bits", "step"), [(16, 20.0), (24, 4000.0)])
def test_samples_are_lost_where_a_counter_wraps(bits, step):
    count = np.delete(3.0 + step * np.arange(1.5 * 2.0**bits // step), int(2.0**bits / step) + np.arange(-3, 4))
    straight, wraps = clocks.unwrapped(np.mod(count, 2.0**bits))
    assert len(wraps) == 1
    np.testing.assert_array_equal(straight, count)


@pytest.mark.parametrize(("rate", "moves"), [(200.0, ((1000, 1), (3000, 1), (4000, 1))), (50.0, ((700, 5),))])
def test_rows_out_of_order_are_named_and_may_be_deleted(tmp_path, rate, moves):
    t, u, z = moving(14, 40.0, rate)
    order = np.arange(len(t))
    for row, later in moves:
        order[row : row + later + 1] = np.roll(order[row : row + later + 1], 1)
    stray = np.flatnonzero(order < np.maximum.accumulate(order))
    text = TICKS.format(name="t", unit="s")
    path = table(tmp_path / "run.csv", "t,u,z", t[order], u[order], z[order], text=text)
    with pytest.raises(RecordingError, match=rf"{len(stray)} rows are out of order: row {stray[0] + 2} \(") as refused:
        io.load(path)
    assert f"row {stray[-1] + 2} (" in str(refused.value)
    assert "runs" not in str(refused.value)
    rest = np.delete(order, stray)
    within(accelcal.fit(io.load(table(path, "t,u,z", t[rest], u[rest], z[rest], text=text))))


def arrivals(t, n, rng, late, within_packet):
    """Stamps of packets of n samples that arrive late."""
    last = t[n - 1 :: n]
    at = np.repeat(last + rng.exponential(late, len(last)), n)
    return at + np.tile(within_packet * np.arange(n), len(last)), len(last) * n


@pytest.mark.parametrize(("n", "rate", "late"), [(5, 100.0, 1e-3), (8, 250.0, 2e-3)])
def test_packets_with_stamps_of_arrival(tmp_path, n, rate, late):
    t, u, z = moving(n, 60.0, rate)
    stamps, count = arrivals(t, n, np.random.default_rng(n), late, 1e-4)
    path = table(
        tmp_path / "usb.csv", "arrival,u,z", stamps, u[:count], z[:count], text=TICKS.format(name="arrival", unit="s")
    )
    recording = io.load(path)
    message = note(recording, "burst_stamps")
    assert f"times of arrival, of {n} samples at a time" in message
    assert recording.stamp_std == 0.0  # both channels have this clock
    true = recording.accel.t - t[:count]
    assert float(np.std(true)) < 0.1 * late
    within(accelcal.fit(recording))


def test_a_fifo_that_is_spread_or_dated_back_over_steps_of_the_rate(tmp_path):
    rng, n = np.random.default_rng(3), 16
    t = np.cumsum(np.where(np.arange(16_000) < 8_000, 1.0 / 320.0, 1.0 / 324.0))
    motion = Motion.of_tones(rng, 0.4, 4.0, 6)
    u = BIAS + (1.0 + K) * motion.acceleration(t) + 0.005 * rng.standard_normal(len(t))
    z = motion.position(t) + 1e-5 * rng.standard_normal(len(t))
    last = t[n - 1 :: n] + rng.normal(0.0, 2.5e-4, len(t) // n)
    late = t[n - 1 :: n] + rng.exponential(2e-3, len(t) // n)
    back = np.repeat(late, n) - np.tile(np.arange(n - 1, -1, -1) / 320.0, len(late))
    assert np.any(np.diff(back) < 0.0)
    spread = np.interp(np.arange(len(t)), np.arange(n - 1, len(t), n), last)
    spread[: n - 1] = last[0] - np.arange(n - 1, 0, -1) / 320.0
    for number, (stamps, most) in enumerate(((back, 5e-4), (spread, 2.5e-4))):
        path = table(tmp_path / f"{number}.csv", "t,u,z", stamps, u, z, text=TICKS.format(name="t", unit="s"))
        recording = io.load(path)
        assert "whose rate steps 1 times" in note(recording, "burst_stamps")
        assert float(np.std(recording.accel.t - t)) < most
        within(accelcal.fit(recording))


def test_lost_samples_and_rounded_stamps_are_no_packets(tmp_path):
    t, u, z = moving(7, 30.0, 500.0)
    there = np.arange(len(t)) % 64 != 63
    for stamps, rows in ((t, there), (np.round(1.005 * t, 3), slice(None))):
        path = table(
            tmp_path / "run.csv", "t,u,z", stamps[rows], u[rows], z[rows], text=TICKS.format(name="t", unit="s")
        )
        assert not note(io.load(path), "burst_stamps")


@pytest.mark.parametrize(
    ("n", "rate", "packets", "gap", "spread", "adds_up"),
    [
        (256, 1000.0, 120, 0.03, 0.01, True),
        (512, 2000.0, 100, 0.002, 0.0003, True),
        (100, 50.0, 40, 58.0, 0.5, False),
    ],
)
def test_a_logger_that_stops_to_write_has_true_stamps(tmp_path, n, rate, packets, gap, spread, adds_up):
    rng = np.random.default_rng(n)
    pauses = rng.uniform(-spread, spread, packets)
    begins = np.arange(packets) * (n / rate + gap) + (np.cumsum(pauses) if adds_up else pauses)
    t = np.round(np.repeat(begins - begins[0], n) + np.tile(np.arange(n) / rate, packets), 6)
    motion = Motion.of_tones(rng, 0.4, min(4.0, rate / 30.0), 6)
    u = BIAS + (1.0 + K) * motion.acceleration(t) + 0.005 * rng.standard_normal(len(t))
    z = motion.position(t) + 1e-5 * rng.standard_normal(len(t))
    recording = io.load(table(tmp_path / "run.csv", "t,u,z", t, u, z, text=TICKS.format(name="t", unit="s")))
    assert not note(recording, "burst_stamps")
    np.testing.assert_allclose(recording.accel.t, t, atol=1e-6)
    within(accelcal.fit(recording))


def test_a_counter_of_frames_is_a_clock(tmp_path):
    t, u, z = moving(8, 40.0, 100.0)
    frames, rng = np.mod(np.arange(len(t)) + 200.0, 2.0**16), np.random.default_rng(8)
    there = rng.random(len(t)) > 0.03
    host = t + rng.exponential(0.02, len(t))
    path = table(
        tmp_path / "cam.csv",
        "host,FrameNumber,u,z",
        *(y[there] for y in (np.sort(host), frames, u, z)),
        text=TICKS.format(name="host", unit="s").replace(
            '{ column = "host", unit = "s" }', '{ counter = "FrameNumber", rate = "100 Hz" }'
        ),
    )
    recording = io.load(path)
    assert recording.accel.t[-1] - recording.accel.t[0] == pytest.approx(t[there][-1] - t[there][0])
    assert "gap" in {finding.kind for finding in recording.findings}
    within(accelcal.fit(recording))
    path.with_suffix(".toml").write_text('[channels]\ntime = { counter = "FrameNumber" }\n')
    with pytest.raises(RecordingError, match=r'rate = "1667 Hz", with counter = "\.\.\."'):
        io.load(path)


def test_one_step_across_a_gap_is_no_one_step_error(tmp_path):
    t, u, z = moving(9, 60.0, 500.0, noise=1e-6)
    there = (t < 48.0) | (t > 48.03)
    errors = []
    for rows in (slice(None), there):
        path = table(tmp_path / "run.csv", "t,u,z", t[rows], u[rows], z[rows], text=TICKS.format(name="t", unit="s"))
        recording = io.load(path)
        errors.append(compare(accelcal.fit(recording), recording).one_step_rms)
    assert errors[1] == pytest.approx(errors[0], rel=0.05)


def test_a_declared_unit_of_time_wins_over_the_name(tmp_path):
    t, u, z = moving(10, 20.0, 100.0)
    recording = io.load(table(tmp_path / "h.csv", "t_h,u,z", t, u, z, text=TICKS.format(name="t_h", unit="s")))
    assert 'column "t_h" is read in s, as declared, though its name says h' in note(recording, "declared_unit")
    within(accelcal.fit(recording))


@pytest.mark.parametrize(
    ("folder", "output", "position", "k", "bias"),
    [
        ("01_sensor_clock_one_file", "off_1_3_percent.csv", None, 0.01, 0.1),
        ("01_sensor_clock_one_file", "off_6_8_percent.csv", None, 0.01, 0.1),
        ("02_two_loggers_rate", "wrist.csv", "mocap.csv", -0.008, 0.15),
        ("02_two_loggers_rate", "imu.csv", "enc.csv", 0.012, 0.2),
        ("04_counter_wrap", "signed.csv", None, 0.015, None),
        ("04_counter_wrap", "unsigned.csv", None, 0.015, None),
        ("04_counter_wrap", "millis16.csv", None, 0.015, None),
        ("11_stamps_of_arrival", "imu.csv", "track.csv", 0.01, 0.1),
    ],
)
def test_shared_cases(tmp_path, folder, output, position, k, bias):
    case = fields(folder, tmp_path)
    recording = io.load(case / output, position=position and case / position)
    aligned = bool(note(recording, "alignment"))
    assert aligned == (folder[:2] != "04")
    fit = accelcal.fit(recording, Model.linear().add("clock_skew") if aligned else Model.linear())
    within(fit, k, fit["bias"].value if bias is None else bias)


def test_the_shared_restart(tmp_path, monkeypatch):
    monkeypatch.chdir(fields("03_clock_restart", tmp_path))
    assert command("cut", "run.csv", "--part", "1", "-o", "a.csv").returncode == 0
    assert len(io.load(Path("a.csv")).accel) == 2300
