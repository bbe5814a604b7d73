"""Two files of two loggers: aligned by the motion that both recorded, or refused; the rest is left to the fit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import accelcal
from accelcal import io
from accelcal._support.errors import visible
from accelcal.cli import app
from accelcal.data import LowPass, Sensor, clocks
from accelcal.data.clocks import align
from accelcal.data.recording import Channel, RecordingError
from accelcal.estimation.plausible import suspicion
from accelcal.io.sidecar import no_sidecar, read_sidecar
from accelcal.io.two_clocks import completed
from accelcal.model import Model

OFFSET, SKEW = 37.2, 20e-6
SECONDS = 60.0


class Motion:
    """Tones of random frequency; the clock of the output shows OFFSET + (1 + SKEW) t."""

    def __init__(self, seed, tones=20):
        self.rng = np.random.default_rng(seed)
        self.f = 2.0 * np.pi * np.exp(self.rng.uniform(np.log(0.5), np.log(12.0), tones))[:, None]
        self.phase = self.rng.uniform(0.0, 2.0 * np.pi, tones)[:, None]
        self.size = self.rng.uniform(0.2, 1.0, tones)[:, None]

    def channels(self, noise=0.02, step=1e-6, rate=1000.0, position_rate=500.0, sign=1.0):
        clock = np.arange(OFFSET - 15.0, OFFSET + SECONDS + 10.0, 1.0 / rate)
        t = (clock - OFFSET) / (1.0 + SKEW)
        a = (self.size * np.sin(self.f * t + self.phase)).sum(axis=0)
        accel = sign * a + 0.05 + noise * self.rng.normal(size=len(t))
        read = 5.0 + np.arange(0.0, SECONDS, 1.0 / position_rate)
        x = -(self.size / self.f**2 * np.sin(self.f * read + self.phase)).sum(axis=0)
        return Channel("accel", clock, accel, "m/s^2"), Channel("position", read, np.round(x / step) * step, "m")


def true_shift(instant):
    """What takes the clock of the output to that of the position."""
    return instant - (OFFSET + (1.0 + SKEW) * instant)


def files(folder, accel, position):
    np.savetxt(folder / "accel.csv", np.c_[accel.t, accel.y], "%.9f", ",", header="t_s,accel_m_per_s2", comments="")
    np.savetxt(
        folder / "encoder.csv", np.c_[position.t, 1e6 * position.y], "%.6f", ",", header="t_s,position_um", comments=""
    )
    return folder / "accel.csv", folder / "encoder.csv"


def test_offset_and_skew_lie_within_what_is_stated():
    scores = []
    for seed in range(24):
        motion = Motion(seed)
        noise, step = 10.0 ** motion.rng.uniform(-3.0, 0.0), 10.0 ** motion.rng.uniform(-6.5, -4.5)
        result = align(*motion.channels(noise, step, *motion.rng.choice([333.0, 500.0, 1000.0], 2)))
        scores.append((result.shift - true_shift(result.middle)) / result.std)
        scores.append((result.skew - SKEW) / result.skew_std)
        assert not result.is_ambiguous
    print(f"largest {max(map(abs, scores)):.2f}, rms {np.sqrt(np.mean(np.square(scores))):.2f} standard deviations")
    assert max(map(abs, scores)) < 4.0
    assert np.sqrt(np.mean(np.square(scores))) < 1.2


def test_the_fit_takes_the_rest(tmp_path):
    accel, position = files(tmp_path, *Motion(3).channels())
    recording = accelcal.load(accel, position=position)
    (note,) = [finding for finding in recording.findings if finding.kind == "alignment"]
    assert "two clocks: the stamps of the output are shifted by -37.2" in note.text
    assert "the next-best alignment" in note.text
    fit = accelcal.fit(recording, Model.linear().add("clock_skew"))
    skew, late = fit["clock_skew"], fit["time_offset"]
    assert abs(skew.value - SKEW) < 4.0 * skew.std
    shift = recording.accel.t[0] - (OFFSET - 15.0)
    begin = recording.position.t[0]
    assert abs(shift - late.value - true_shift(begin)) < 4.0 * late.std
    assert abs(late.value) < recording.rig.offset_tolerance


def test_what_the_sidecar_of_the_encoder_declares_reaches_the_budget(tmp_path):
    output, motion = Motion(3).channels()
    accel, position = files(tmp_path, replace(output, y=output.y + 9.80665), motion)
    accel.with_suffix(".toml").write_text(
        '[sensor]\nmodel = "X"\n[rig]\nmount = "normal"\n[uncertainty]\nmisalignment = "0.1 deg"\n'
    )
    position.with_suffix(".toml").write_text(
        '[sensor]\nserial = "7"\n[rig]\naxis = "up"\n[clock]\ntrusted = "position"\n'
        '[uncertainty]\nlevel = "0.2 deg"\nmisalignment = "9 deg"\n'
        '[channels]\nposition = { column = "position_um", unit = "um", u_scale = 1e-5 }\n'
    )
    recording = accelcal.load(accel, position=position)
    checked = CliRunner().invoke(app, ["check", f"{accel}", "--position", f"{position}"])
    assert checked.exit_code == 0, checked.output
    assert "two clocks: the stamps of the output are shifted" in checked.stdout
    assert f"next: accelcal fit {accel} --position {position} -o accel.json" in checked.stderr
    done = CliRunner().invoke(app, ["cut", f"{accel}", "--position", f"{position}", "-o", f"{tmp_path / 'both.csv'}"])
    assert done.exit_code == 0, done.output
    for rig in (recording.rig, accelcal.load(tmp_path / "both.csv").rig):
        assert (rig.sensor.model, rig.sensor.serial, rig.axis, rig.trusted_clock) == ("X", "7", "up", "position")
        assert rig.uncertainty.encoder_scale == 1e-5
        assert np.degrees([rig.uncertainty.level, rig.uncertainty.misalignment]) == pytest.approx([0.2, 0.1])
        assert not any(text.startswith(("axis", "mount")) for text in rig.assumptions)
        assert any(text.startswith("encoder resolution") for text in rig.assumptions)


def test_what_the_sidecar_of_the_output_declares_holds_in_whole(tmp_path):
    accel, position = files(tmp_path, *Motion(3).channels())
    accel.with_suffix(".toml").write_text(
        '[sensor]\nmodel = "X"\n[rig]\nmount = "normal"\naxis = "level"\n[clock]\ntrusted = "position"\n'
        '[channels]\naccel = { column = "accel_m_per_s2", unit = "m/s^2", lowpass = { kind = "RC", fc = "200 Hz" } }\n'
    )
    position.with_suffix(".toml").write_text(
        '[sensor]\nmodel = "Y"\nserial = "7"\nnoise = "9 mg/sqrt(Hz)"\nscale = "0.1 V/g"\nzero = "2.5 V"\n'
        '[rig]\nmount = "reversed"\naxis = "up"\n[uncertainty]\nclock_rate = "9 ppm"\nlevel = "0.2 deg"\n'
        '[channels]\naccel = { column = "none", unit = "V", highpass = { kind = "RC", fc = "1 Hz" } }\n'
        'position = { column = "position_um", unit = "um", resolution = "1 um" }\n'
    )
    declared, further = (read_sidecar(path.with_suffix(".toml")).rig for path in (accel, position))
    rig = completed(declared, further)
    assert (rig.mount, rig.axis, rig.gravity) == ("normal", "level", 0.0)
    assert (rig.sensor, rig.lowpass, rig.output_filters) == (Sensor(model="X"), LowPass(200.0), ())
    assert (rig.trusted_clock, rig.uncertainty.clock_rate) == ("position", None)
    assert rig.resolution == pytest.approx(1e-6)
    assert np.degrees(rig.uncertainty.level) == pytest.approx(0.2)
    assert any(text.startswith("sensor noise") for text in rig.assumptions)
    alone = completed(no_sidecar().rig, further)
    assert (alone.mount, alone.gravity, alone.sensor.serial) == ("reversed", further.gravity, "7")
    assert (alone.sensor.scale, alone.sensor.zero, alone.output_filters) == (None, None, ())
    assert any(text.startswith("no low-pass") for text in alone.assumptions)


def test_a_motion_that_repeats_is_called_ambiguous():
    assert align(*Motion(1, tones=1).channels()).is_ambiguous


def test_a_peak_is_as_high_as_its_correlation():
    part, *others = np.random.default_rng(1).standard_normal((3, 4000))

    def peaks(*likes):
        noise = zip(likes, others, strict=True)
        return clocks._Peaks(np.concatenate([like * part + np.sqrt(1.0 - like**2) * y for like, y in noise]), part)

    assert (peaks(0.9, 0.81).next_lag, peaks(0.9, 0.81).next_height) == (4000, pytest.approx(0.9, abs=0.03))
    assert [peaks(0.8, -like).is_opposite for like in (0.86, 0.95)] == [False, True]  # by less than a tenth, by more


def test_a_longer_record_is_averaged_to_the_grid_of_the_slower():
    motion = Motion(5)
    result = align(*motion.channels(noise=0.2, rate=4000.0, position_rate=250.0))
    assert abs(result.shift - true_shift(result.middle)) < 4.0 * result.std


def test_a_larger_move_the_other_way_is_no_other_sign():
    rng, rate = np.random.default_rng(4), 1000.0
    t = np.arange(0.0, 60.0, 1.0 / rate)
    a = np.zeros(len(t))
    for k, (size, length) in enumerate(zip([4, -12, 9, -7, 11, -5], [0.5, 0.45, 0.6, 0.4, 0.55, 0.7], strict=True)):
        inside = (t >= 3.0 + 8.0 * k) & (t < 3.0 + 8.0 * k + length)
        a += inside * size * np.sin(2.0 * np.pi * (t - 3.0 - 8.0 * k) / length)
    x = np.cumsum(np.cumsum(a)) / rate**2
    output = Channel("accel", t + 37.2, a + 0.01 * rng.standard_normal(len(t)), "m/s^2")
    part = slice(2000, 5000)  # the encoder was stopped behind the first, smallest move
    alignment = align(output, Channel("position", t[part], np.round(x[part] / 1e-7) * 1e-7, "m"))
    assert alignment.is_ambiguous or abs(alignment.shift + 37.2) < 0.01


def test_what_is_not_one_motion_is_refused(tmp_path):
    accel, position = Motion(6).channels()[0], Motion(7).channels()[1]
    with pytest.raises(RecordingError, match="at no shift of the clocks"):
        align(accel, position, name="accel.csv")
    with pytest.raises(RecordingError, match=r'with the other sign; declare .* mount = "reversed"'):
        align(*Motion(6).channels(sign=-1.0))
    assert align(*Motion(6).channels(sign=-1.0), polarity=-1.0).correlation > 0.5
    with pytest.raises(RecordingError, match="has 63 samples, expected at least 64"):
        align(Channel("accel", accel.t[:63], accel.y[:63], "m/s^2"), position)
    still = Channel("position", position.t, np.zeros(len(position)), "m")
    with pytest.raises(RecordingError, match="at no shift of the clocks"):
        align(accel, still)
    output, encoder = files(tmp_path, accel, position)
    with pytest.raises(RecordingError, match=r"no column for accel"):
        io.load(encoder, position=output)
    both = tmp_path / "both.csv"
    both.write_text("t_s,accel_g,position_m\n" + "".join(f"{k / 100},{k % 7},{k}\n" for k in range(200)))
    with pytest.raises(RecordingError, match=r"both\.csv: this file has a position of its own"):
        io.load(both, position=encoder)
    with pytest.raises(RecordingError, match=r"both\.csv: this file has an output of its own"):
        io.load(output, position=both)


BODY = "t,e_m,n_m,u_m,q_w,q_x,q_y,q_z"
OUTPUTS = "".join(f'accel_{axis} = {{ column = "a{axis}", unit = "m/s^2" }}\n' for axis in "xyz")
RATES = "".join(f'gyr_{axis} = {{ column = "g{axis}", unit = "deg/s" }}\n' for axis in "xyz")
PLACES = "".join(f'position_{axis} = {{ column = "{axis}_m" }}\n' for axis in "enu")
ATTITUDE = '[channels.attitude]\ncolumns = ["q_w", "q_x", "q_y", "q_z"]\nmaps = "sensor to ENU"\n'
BIAS, SPIN = np.array([0.05, -0.03, 0.08]), np.array([0.5, -0.2, 0.1])
AHEAD, LATE = 812.3, 0.003
"""Clock of the sensor ahead of that of the cameras, and delay of its output, s."""


def swing(t, frequencies, size, phase):
    return sum(size / f * np.sin(2 * np.pi * f * t[:, None] + phase + [f, 2 * f + 1, 3 * f + 2]) for f in frequencies)


def body_files(folder, fast=0.0, phase=0.0, seconds=20.0):
    """Cameras and a sensor, gyroscope included, that ride on one body; the sensor's clock runs by `fast` too fast."""
    rng = np.random.default_rng(1)

    def motion(t):
        turns = Rotation.from_rotvec(swing(t, (0.11, 0.37, 0.9), 0.08, phase))
        return swing(t, (0.23, 0.61, 1.3), 0.05, phase), turns

    t, h = np.arange(0.0, seconds, 1 / 200), 1e-4
    place, turns = motion(t)
    table = np.c_[t, place + 1e-4 * rng.standard_normal(place.shape), turns.as_quat(scalar_first=True)]
    np.savetxt(folder / "cameras.csv", table, "%.7f", ",", header=BODY, comments="")
    stamps = np.arange(1.0, seconds - 1.0, 1 / 250)
    (before, from_), (at, now), (after, to) = (motion(stamps - LATE + step) for step in (-h, 0.0, h))
    force = now.inv().apply((after - 2.0 * at + before) / h**2 + [0.0, 0.0, 9.80665]) + BIAS
    rate = np.degrees((from_.inv() * to).as_rotvec() / (2.0 * h)) + SPIN
    noisy = np.c_[force + 0.01 * rng.standard_normal(force.shape), rate + 0.1 * rng.standard_normal(rate.shape)]
    table = np.c_[1e3 * ((1.0 + fast) * stamps + AHEAD), noisy]
    np.savetxt(folder / "imu.csv", table, "%.6f", ",", header="t_ms,ax,ay,az,gx,gy,gz", comments="")
    (folder / "imu.toml").write_text('[channels]\ntime = { column = "t_ms", unit = "ms" }\n' + OUTPUTS + RATES)
    (folder / "cameras.toml").write_text('[channels]\ntime = { column = "t", unit = "s" }\n' + PLACES + ATTITUDE)
    return folder / "imu.csv", folder / "cameras.csv"


def test_three_outputs_are_laid_upon_place_and_attitude_of_another_file(tmp_path):
    imu, cameras = (path.rename(path.with_suffix(".\x1b.csv")) for path in body_files(tmp_path))
    for path in (imu, cameras):
        path.with_suffix("").with_suffix(".toml").rename(path.with_suffix(".toml"))
    outputs = accelcal.load_axes(imu, position=cameras)
    shown = visible(f"{imu.name} with {cameras.name}")
    assert [recording.name for recording in outputs] == [f"{shown} {axis}" for axis in "xyz"]
    noted = [finding for finding in outputs[0].findings if finding.kind == "alignment"]
    assert len(noted) == 1
    shift = outputs[0].accel.t[0] - (1.0 + AHEAD)
    assert f"shifted by {shift:+.6f} s" in noted[0].text
    assert any(finding.kind == "carried" for finding in outputs[0].findings)  # its gyroscope is on the clock, too
    fit = accelcal.fit(outputs)
    assert abs(shift + AHEAD - (fit["time_offset"].value - LATE)) < 5.0 * fit["time_offset"].std + 1e-5
    for estimate, truth in zip((e for e in fit.estimates if e.name == "bias"), (0.05, -0.03, 0.08), strict=True):
        assert abs(estimate.value - truth) < 5.0 * estimate.std


def test_a_body_of_two_loggers_is_cut_into_one_file(tmp_path):
    imu, cameras = body_files(tmp_path, fast=0.015)
    runner, target = CliRunner(), tmp_path / "joined.csv"
    done = runner.invoke(app, ["cut", str(imu), "--position", str(cameras), "-o", str(target)])
    assert done.exit_code == 0, done.output
    assert "runs by 1.49" in done.output or "runs by 1.50" in done.output  # its clock, 1.5 % fast
    apart, joined = accelcal.load_axes(imu, position=cameras), accelcal.load_axes(target)
    for one_file, two_files in zip(joined, apart, strict=True):
        for name in ("accel", "position"):
            mine, other = getattr(one_file, name), getattr(two_files, name)
            assert np.allclose(mine.t, other.t, rtol=0.0, atol=1e-9)
            assert np.allclose(mine.y, other.y, rtol=1e-12, atol=1e-12)
        assert one_file.rig.uncertainty.clock_rate == pytest.approx(0.015, rel=0.01)
        assert one_file.rig.offset_tolerance > 0.0
        assert any(finding.kind == "alignment" for finding in one_file.findings)
    refused = runner.invoke(
        app, ["cut", str(imu), "--position", str(cameras), "-o", str(tmp_path / "p.csv"), "--only", "1:2"]
    )
    assert refused.exit_code == 2
    assert not (tmp_path / "p.csv").exists()


def test_an_output_with_a_scale_of_its_own_is_read_by_it(tmp_path):
    rows = [f"{0.01 * k:.2f},{1.65 + 0.02 * (k % 3)},0.2,9.8,0,0,{1e-4 * k * k:.4f},1,0,0,0" for k in range(100)]
    path = tmp_path / "board.csv"
    path.write_text("\n".join(["t,ax,ay,az,e_m,n_m,u_m,q_w,q_x,q_y,q_z", *rows]))
    outputs = OUTPUTS.replace('"ax", unit = "m/s^2"', '"ax", unit = "V", scale = "20 mV/(m/s^2)", zero = "1.65 V"')
    path.with_suffix(".toml").write_text(
        '[channels]\ntime = { column = "t", unit = "s" }\n' + outputs + PLACES + ATTITUDE
    )
    x, y, _ = accelcal.load_axes(path)
    assert np.allclose(x.accel.y[:3], [0.0, 1.0, 2.0])
    assert np.allclose(y.accel.y, 0.2)
    imu, cameras = body_files(tmp_path)
    whole = accelcal.load_axes(imu, position=cameras)
    declared = imu.with_suffix(".toml")
    in_volts = declared.read_text().replace('"ax", unit = "m/s^2"', '"ax", unit = "V", scale = "0.5 V/(m/s^2)"')
    declared.write_text(in_volts)
    assert np.allclose(accelcal.load_axes(imu, position=cameras)[0].accel.y, 2.0 * whole[0].accel.y)


def test_outputs_that_are_not_of_the_body_are_refused(tmp_path):
    imu, cameras = body_files(tmp_path)
    declared = cameras.with_suffix(".toml")
    declared.write_text(declared.read_text().replace("sensor to ENU", "ENU to sensor"))
    with pytest.raises(RecordingError, match=r'they are with maps = "sensor to ENU": write that in'):
        accelcal.load_axes(imu, position=cameras)
    (tmp_path / "other").mkdir()
    _, elsewhere = body_files(tmp_path / "other", phase=1.0)
    with pytest.raises(RecordingError, match="check that both files are of one run"):
        accelcal.load_axes(imu, position=elsewhere)
    with pytest.raises(RecordingError, match=r"expected accel_x, accel_y, accel_z in the first alone"):
        accelcal.load_axes(imu, position=imu)
    short = tmp_path / "short.csv"
    short.write_text("".join(imu.read_text().splitlines(keepends=True)[:50]))
    with pytest.raises(RecordingError, match=r"accel has 49 samples, expected at least 64 to align"):
        accelcal.load_axes(short, imu.with_suffix(".toml"), position=cameras)
    with pytest.raises(RecordingError, match=r"nothere\.toml: there is no such sidecar"):
        accelcal.load_axes(imu, position=tmp_path / "nothere.csv")
    declared.write_text("channels = 3\n")
    with pytest.raises(RecordingError, match=r"cameras\.toml: channels"):
        accelcal.load_axes(imu, position=cameras)


def test_the_clock_that_a_body_is_laid_upon_is_the_trusted_one(tmp_path):
    """As with one output: else k is off by twice the difference of the rates, 3 %, and no declaration cures that."""
    imu, cameras = body_files(tmp_path, fast=0.015)
    declared = cameras.with_suffix(".toml")
    declared.write_text('[clock]\ntrusted = "accel"\noffset_tolerance = "30 ms"\n' + declared.read_text())
    apart = accelcal.load_axes(imu, position=cameras)[0]
    assert apart.accel.t[0] == pytest.approx(1.015 + AHEAD, abs=1e-6)  # as it is in the file
    assert np.diff(apart.position.t) == pytest.approx(1.015 / 200, rel=1e-3)
    assert "the clock of accel is trusted; two clocks" in apart.findings[0].text
    assert apart.rig.uncertainty.clock_rate is None
    assert apart.rig.offset_tolerance >= 0.03
    target = tmp_path / "joined.parquet"
    done = CliRunner().invoke(app, ["cut", str(imu), "--position", str(cameras), "-o", str(target)])
    assert done.exit_code == 0, done.output
    assert accelcal.load_axes(target)[0].rig == apart.rig


def test_outputs_that_begin_apart_are_laid_upon_a_body_alike(tmp_path):
    imu, cameras = body_files(tmp_path, fast=0.015)
    whole = accelcal.load_axes(imu, position=cameras)
    lines = imu.read_text().splitlines()
    cells = [line.split(",") for line in lines[1:751]]
    # The output that tells the shift best is lost for 3 s, in which the clocks drift apart by 45 ms.
    lines[1:751] = [",".join([stamp, x, y, "", *rest]) for stamp, x, y, _, *rest in cells]
    imu.write_text("\n".join(lines) + "\n")
    for some, all_of_it in zip(accelcal.load_axes(imu, position=cameras), whole, strict=True):
        assert some.accel.t[-1] == pytest.approx(all_of_it.accel.t[-1], abs=5e-3)


def test_what_sidecars_of_a_body_declare_is_in_the_joined_one(tmp_path):
    imu, cameras = body_files(tmp_path)
    noticed = 'noticed = [{ kind = "gap", channel = "accel", count = 1, first = 0.0, text = "TEXT" }]\n'
    for file, text in ((imu, "of an earlier cut"), (cameras, "of the cameras")):
        declared = file.with_suffix(".toml")
        declared.write_text(f"[run]\n{noticed.replace('TEXT', text)}\n{declared.read_text()}")
    declared = imu.with_suffix(".toml")
    filtered = OUTPUTS.replace('" }', '", lowpass = { fc = "60 Hz" } }')
    declared.write_text('[prior]\ncubic = "1e-4 s^4/m^2"\n\n' + declared.read_text().replace(OUTPUTS, filtered))
    of_cameras = cameras.with_suffix(".toml")
    of_cameras.write_text('[sensor]\nscale = "3 V/g"\n\n' + of_cameras.read_text())
    target = tmp_path / "joined.csv"
    done = CliRunner().invoke(app, ["cut", str(imu), "--position", str(cameras), "-o", str(target)])
    assert done.exit_code == 0, done.output
    for recording in (accelcal.load_axes(imu, position=cameras)[2], accelcal.load_axes(target)[2]):
        messages = {finding.text for finding in recording.findings}
        assert {"of an earlier cut", "of the cameras"} <= messages
        assert recording.rig.lowpass.cutoff == pytest.approx(60.0)
        assert recording.rig.sensor.scale is None  # a scale is of an output
        assert recording.prior_sizes == {"cubic": "1e-4 s^4/m^2"}
    assert CliRunner().invoke(app, ["check", str(target)]).exit_code == 0


@pytest.mark.parametrize(
    ("file", "line", "message"),
    [
        (
            "cameras",
            'accel_x = { column = "e_m", unit = "m/s^2" }\n',
            r"expected accel_x, accel_y, accel_z in the first",
        ),
        ("imu", 'accel = { column = "ax", unit = "m/s^2" }\n', r"expected accel_x, accel_y, accel_z in the first"),
        ("imu", 'position = { column = "gx", unit = "m" }\n', r"imu\.toml: channels\.position: beside"),
        ("imu", '[rig]\ninput_axis = "x"\n', r"imu\.toml: rig\.input_axis beside accel_x, .* is one too many"),
    ],
    ids=["output of the cameras", "further output", "further position", "input axis"],
)
def test_a_channel_of_a_body_that_stands_in_the_wrong_file_is_refused(tmp_path, file, line, message):
    imu, cameras = body_files(tmp_path)
    declared = tmp_path / f"{file}.toml"
    text = declared.read_text().replace(ATTITUDE, line + ATTITUDE) if file == "cameras" else declared.read_text() + line
    declared.write_text(text)
    with pytest.raises(RecordingError, match=message):
        accelcal.load_axes(imu, position=cameras)
    target = tmp_path / "joined.csv"
    assert CliRunner().invoke(app, ["cut", str(imu), "--position", str(cameras), "-o", str(target)]).exit_code == 3
    assert not target.exists()


def test_a_wrong_unit_in_two_files_is_cured_by_a_line_of_a_sidecar(tmp_path):
    accel, position = files(tmp_path, *Motion(3).channels())
    position.write_text(position.read_text().replace("position_um", "position_mm"))
    message = suspicion(accelcal.load(accel, position=position))
    assert 'Write [channels] position = { column = "position_mm", unit = "um" }' in message
    assert "write [rig] ratio = " in message
