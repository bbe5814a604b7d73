"""Channels in volts or counts, and what was mistaken where 1 + k or a constant is no sensor's, on files of users."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.signal import bilinear, lfilter
from scipy.special import erf
from typer.testing import CliRunner

import accelcal as ac
from accelcal import io
from accelcal.calibration.characteristic import budget
from accelcal.cli import app
from accelcal.estimation.plausible import suspicion
from accelcal.live.tracker import declared_noise
from accelcal.response.measure import frequency_response

from .rigs import (
    ACCEL,
    GRAVITY,
    POSITION,
    TIME,
    UNITS,
    G,
    honest,
    moved,
    wrong_axis,
    wrong_gravity,
    wrong_range,
    wrong_sensitivity,
    wrong_sign,
    wrong_unit,
)

CASES = os.environ.get("ACCELCAL_FIELD_CASES", "")


def case(name: str, tmp_path: Path) -> Path:
    """A copy of one shared case."""
    if not CASES:
        pytest.skip("ACCELCAL_FIELD_CASES is not set: the shared cases are not at hand")
    return Path(shutil.copytree(Path(CASES) / name, tmp_path / name))


def off(fit: ac.Fit, name: str, truth: float) -> float:
    """Standard deviations from the truth."""
    return abs(fit[name].value - truth) / fit[name].std


def sentence(path: Path) -> str:
    """What a fit says, refused or not."""
    try:
        return " ".join(note.sentence for note in ac.fit(ac.load(path)).remarks)
    except ValueError as error:
        return str(error)


def written(path: Path, line: str) -> Path:
    """The sidecar with a line that was printed, in place of the one with its key."""
    key, text = line.split(" = ")[0], path.with_suffix(".toml").read_text(encoding="utf-8")
    table = "channels" if "column" in line else "sensor" if key == "scale" else "rig"
    text = re.sub(rf"^{key} = .*\n", "", text, flags=re.MULTILINE)
    text = text if f"[{table}]" in text else f"[{table}]\n{text}"
    path.with_suffix(".toml").write_text(text.replace(f"[{table}]\n", f"[{table}]\n{line}\n", 1), encoding="utf-8")
    return path


# ---- scale, zero, noise and uncertainty of every channel -------------------------------------------------------------

REFERENCES: dict[str, tuple[Callable[[object], np.ndarray], str]] = {
    "LVDT": (lambda r: 2.5 + 20.0 * r.p, 'position = { column = "ref", unit = "V", scale = "20 V/m", zero = "2.5 V" }'),
    "draw wire": (lambda r: 1e3 * 8.0 * r.p, 'position = { column = "ref", unit = "mV", scale = "125 mm/V" }'),
    "encoder": (
        lambda r: np.rint(2e7 * r.p),
        'position = { column = "ref", unit = "count", scale = "20000 count/mm" }',
    ),
    "grating": (lambda r: np.rint(1e8 * r.p), 'position = { column = "ref", unit = "count", scale = "0.01 um/count" }'),
    "geophone": (lambda r: -28.8 * r.v, 'velocity = { column = "ref", unit = "V", scale = "-28.8 V/(m/s)" }'),
    "vibrometer": (
        lambda r: 10.0 * r.v + 0.3,
        'velocity = { column = "ref", unit = "V", scale = "100 mm/s/V", zero = "0.3 V" }',
    ),
    "back to back": (
        lambda r: 0.1 * r.a / G,
        'reference_acceleration = { column = "ref", unit = "V", scale = "0.1 V/g" }',
    ),
    "counts of g": (
        lambda r: np.rint(65536 * r.a / G),
        'reference_acceleration = { column = "ref", unit = "LSB", scale = "65536 LSB/g" }',
    ),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_a_reference_in_volts_or_counts_is_read_through_its_scale(name, tmp_path):
    record = moved(11, "stage", k=0.02)
    read, line = REFERENCES[name]
    clean = read(record)
    record.columns = {"t": record.t, "ref": clean + record.noise(1e-5 * float(np.std(clean))), "acc": record.output()}
    record.declare(TIME, ACCEL, line)
    fit = ac.fit(ac.load(record.write(tmp_path)))
    assert off(fit, "scale_factor", 0.02) < 3.0
    assert off(fit, "bias", record.bias) < 3.0 or name in ("back to back", "counts of g")


def test_a_side_channel_in_volts_is_read_through_its_scale(tmp_path):
    record = honest(3, "stage", 0.0)
    record.columns |= {"lm35": 0.22 + 0.0 * record.t, "load": 1.0 + 0.5 * np.sin(record.t)}
    record.declare(
        TIME,
        ACCEL,
        POSITION,
        'temperature = { column = "lm35", unit = "V", scale = "10 mV/degC" }',
        'pressure = { column = "load", unit = "V", scale = "5 V/MPa", zero = "1 V" }',
    )
    recording = ac.load(record.write(tmp_path))
    assert recording.side["temperature"].unit == "degC"
    assert np.allclose(recording.side["temperature"].y, 22.0)
    assert np.allclose(recording.side["pressure"].y, 1e5 * np.sin(recording.side["pressure"].t), atol=1.0)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('position = { column = "pos", unit = "V" }', 'column "pos" is in V, but no scale is declared; write in'),
        ('position = { column = "pos", unit = "V", scale = "20 V/s" }', '"s" does not measure a length'),
        ('position = { column = "pos", unit = "V", scale = "0 V/m" }', "expected one that is not zero"),
        ('position = { column = "pos", unit = "V", zero = "1 V" }', "zero: needs a scale beside it"),
        ('position = { column = "pos", unit = "V", scale = "20 V/m", zero = "9 count" }', "but scale counts in V"),
        ('position = { column = "pos", unit = "count", scale = "20 V/m" }', "the declared scale is per V"),
    ],
)
def test_a_scale_that_does_not_fit_is_refused_with_what_fits(line, message, tmp_path):
    record = honest(4, "stage")
    record.declare(TIME, ACCEL, line)
    with pytest.raises(ac.RecordingError, match=re.escape(message)):
        ac.load(record.write(tmp_path))


@pytest.mark.parametrize("name", ["position", "velocity", "reference_acceleration"])
def test_uncertainty_of_a_reference_enters_the_budget(name, tmp_path):
    record, unit = moved(5, "shaker", k=0.01), {"position": "m", "velocity": "m/s"}.get(name, "m/s^2")
    y = {"position": record.p, "velocity": record.v}.get(name, record.a)
    record.columns = {"t": record.t, "ref": y + record.noise(1e-5 * float(np.std(y))), "acc": record.output()}
    zero = ', u_zero = "0.02 m/s^2"' if unit == "m/s^2" else ""
    record.declare(TIME, ACCEL, f'{name} = {{ column = "ref", unit = "{unit}", u_scale = 2e-3{zero} }}')
    record.lines["uncertainty"] = 'level = "0 deg"\nmisalignment = "0 deg"'
    fit = ac.fit(ac.load(record.write(tmp_path)))
    combined = {line.estimate.name: line.combined for line in budget(fit).lines}
    assert combined["scale_factor"] == pytest.approx(np.hypot(fit["scale_factor"].std, 2e-3 * 1.01), rel=1e-3)
    assert combined["bias"] == pytest.approx(np.hypot(fit["bias"].std, 0.02 * 1.01 * bool(zero)), rel=1e-3)


def test_what_a_reference_declares_survives_simulation_and_cut(tmp_path):
    run, part = tmp_path / "run.csv", tmp_path / "part.csv"
    assert CliRunner().invoke(app, ["simulate", "-o", str(run), "--seconds", "10"]).exit_code == 0
    assert 'noise = "1 um"' in run.with_suffix(".toml").read_text()
    assert CliRunner().invoke(app, ["cut", str(run), "--only", "1:9", "-o", str(part)]).exit_code == 0
    rig = ac.load(part).rig
    assert rig.reading_noise == 1e-6
    assert declared_noise(replace(rig, resolution=None))[1] == pytest.approx(1e-12)
    quieter = replace(ac.load(part), rig=replace(rig, reading_noise=1e-7, resolution=None))
    assert "times as noisy as declared" in " ".join(note.sentence for note in ac.fit(quieter).remarks)
    assert "as noisy" not in " ".join(note.sentence for note in ac.fit(ac.load(part)).remarks)


def test_init_asks_for_the_scale_of_a_position_in_volts(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t_s,accel_g,position_V\n0.0,0.1,0.2\n0.1,0.1,0.3\n0.2,0.1,0.4\n")
    assert 'unit = "V", scale = "?" }' in io.init(path)


@pytest.mark.parametrize("name", ["lvdt", "encoder", "geophone", "reference"])
def test_the_shared_references_in_volts(name, tmp_path):
    folder = case("08_reference_in_volts", tmp_path)
    assert off(ac.fit(ac.load(folder / "ref.csv", folder / f"{name}.toml")), "scale_factor", 0.01) < 3.0


# ---- a high-passed sensor behind a velocity, and drop-outs -----------------------------------------------------------


def vibrometer(seed: int, folder: Path, tau: float, drops: int = 0) -> tuple[Path, int]:
    """A record of a laser vibrometer beside a sensor behind an RC high-pass, and the stretches without signal."""
    record = moved(seed, "shaker", k=0.01)
    step = float(record.t[1] - record.t[0])
    u = record.output()
    if tau:
        c = 2.0 * tau / step
        u = lfilter([c / (c + 1.0), -c / (c + 1.0)], [1.0, (1.0 - c) / (1.0 + c)], u)
    v = record.v + record.noise(2e-5)
    places = np.sort(record.rng.choice(len(v) // 64 - 2, drops, replace=False)) * 64 + 64
    for at in places:
        v[at : at + record.rng.integers(1, 4)] += record.rng.choice([-1.0, 1.0]) * record.rng.uniform(0.1, 0.5)
    record.columns = {"time": record.t, "ldv": 1e3 * v, "iepe": u}
    high = f', highpass = {{ kind = "RC", tau = "{tau} s" }}' if tau else ""
    record.declare(
        TIME.replace('"t"', '"time"'),
        f'accel = {{ column = "iepe", unit = "m/s^2"{high} }}',
        'velocity = { column = "ldv", unit = "mm/s" }',
    )
    return record.write(folder), len(places)


@pytest.mark.parametrize(("seed", "tau"), [(1, 0.16), (2, 0.5)])
def test_a_high_passed_sensor_is_fitted_behind_a_velocity(seed, tau, tmp_path):
    recording = ac.load(vibrometer(seed, tmp_path, tau)[0])
    for method in ("auto", "replay"):
        fit = ac.fit(recording, method=method)
        assert off(fit, "scale_factor", 0.01) < 3.0
        assert abs(fit["time_offset"].value) < 3.0 * fit["time_offset"].std + 2e-6
        assert [note.code for note in fit.remarks] == ["not_observable"]


@pytest.mark.parametrize(("seed", "tau"), [(3, 0.0), (4, 0.2)])
def test_drop_outs_of_a_vibrometer_are_left_out(seed, tau, tmp_path):
    path, drops = vibrometer(seed, tmp_path, tau, drops=12)
    recording = ac.load(path)
    clean = ac.load(vibrometer(seed, tmp_path, tau)[0])
    fit, best = ac.fit(recording), ac.fit(clean)
    first = next(note for note in fit.remarks if note.code == "lost_signal")
    assert first.values["channel"] == "velocity"
    assert abs(int(first.values["stretches"]) - drops) <= 1
    assert off(fit, "scale_factor", 0.01) < 3.0
    assert fit["scale_factor"].std < 3.0 * best["scale_factor"].std
    assert not any(note.code == "lost_signal" for note in best.remarks)
    if not tau:
        wide, narrow = (frequency_response(r, method="broadband", check=False) for r in (recording, clean))
        at = {round(point.frequency, 3): point.std for point in narrow.points}
        ratio = [point.std / at[f] for point in wide.points if (f := round(point.frequency, 3)) in at]
        assert np.median(ratio) < 3.0


# ---- plausible before named ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mistake", UNITS)
@pytest.mark.parametrize("kind", ["stage", "lift"])
def test_a_wrong_unit_is_named_with_the_line_to_write(mistake, kind, tmp_path):
    record, line = wrong_unit(21, kind, mistake)
    path = record.write(tmp_path)
    message = suspicion(ac.load(path))
    assert line in message
    assert f"[channels] {line}" in message
    assert suspicion(ac.load(written(path, line))) == ""


MISTAKES: dict[str, Callable[[int, str], tuple[object, str]]] = {
    "half": lambda seed, kind: wrong_range(seed, kind, -1),
    "four times": lambda seed, kind: wrong_range(seed, kind, 2),
    "sensitivity": wrong_sensitivity,
    "sign": wrong_sign,
    "unit": lambda seed, kind: wrong_unit(seed, kind, "position mm"),
    **{name: lambda seed, kind, name=name: wrong_gravity(seed, kind, name) for name in GRAVITY},
}


@pytest.mark.parametrize(("name", "kind"), list(zip(MISTAKES, 5 * ["stage", "lift"], strict=True)))
def test_check_and_fit_name_a_mistake_and_the_line_cures_it(name, kind, tmp_path):
    record, line = MISTAKES[name](31, kind)
    path = record.write(tmp_path)
    assert line in suspicion(ac.load(path))
    assert line in sentence(path)
    fit = ac.fit(ac.load(written(path, line)))
    assert not any(note.code == "implausible_scale" for note in fit.remarks)
    assert off(fit, "scale_factor", record.k) < 4.0


@pytest.mark.parametrize(("sign", "declared"), [(1.0, False), (-1.0, True), (-1.0, False)])
def test_the_motion_is_in_another_column(sign, declared, tmp_path):
    record, line = wrong_axis(41, "stage", sign, declared)
    path = record.write(tmp_path)
    recording = ac.load(path)
    message = sentence(path)
    assert "the motion is in ay" in message
    assert line in message
    assert "the motion is in ay" in suspicion(recording)
    if sign > 0.0:
        improvement = ac.improve(recording)
        assert (improvement.effects, improvement.verdict) == ((), "unexplained")
        assert "the motion is in ay" in improvement.diagnosis.sentence
        written(path, line)
    else:
        assert 'mount = "reversed"' in message
        written(written(path, line), 'mount = "reversed"')
    assert off(ac.fit(ac.load(path)), "scale_factor", record.k) < 3.0


def test_an_impact_beyond_the_range_makes_no_scale_factor():
    """Readings that the range has cut off are left out; no line through their gap is taken for the output."""
    t, width, w = np.arange(0.0, 4.0, 5e-4), 5e-3, 2.0 * np.pi * np.array([3.0, 7.0, 17.0])
    x, tones = (t - 2.0) / width, np.sin(np.outer(t, w))
    impact = 400.0 * np.exp(-(x**2) / 2.0)
    once = np.sqrt(np.pi / 2.0) * x * (1.0 + erf(x / np.sqrt(2.0))) + np.exp(-(x**2) / 2.0)
    position = tones @ (0.5 / w**2) + 400.0 * width**2 * once
    output = impact - tones @ np.full(3, 0.5) + 0.01 * np.random.default_rng(5).standard_normal(len(t))
    inside = output < 100.0
    units = {"accel": "m/s^2", "position": "m"}
    recording = ac.Recording.from_arrays(t[inside], output[inside], position, position_t=t, units=units)
    assert suspicion(recording) == ""


def test_side_channels_of_arrays_are_tried_as_well():
    record = moved(43, "stage", k=0.02)
    y, x = record.output(), 0.01 * record.output() + record.noise(1e-3)
    recording = ac.Recording.from_arrays(
        record.t, x, record.read(), units={"accel": "m/s^2", "position": "m", "a_y": "m/s^2"}, side={"a_y": y}
    )
    assert "the motion is in a_y (correlation 1.00), not in accel" in suspicion(recording)


def test_weak_motion_with_another_sign_is_no_mount(tmp_path):
    record = honest(51, "stage")
    record.columns["acc"] = 0.1 - 0.1 * record.a + record.noise(1.0 * float(np.std(record.a)))
    message = sentence(record.write(tmp_path))
    assert "not one axis of one body" in message
    assert "mount =" not in message
    assert "unit of column" not in message


def test_one_line_accepts_a_ratio_that_the_rig_makes(tmp_path):
    record = honest(52, "stage", k=-0.773)
    path = record.write(tmp_path)
    line = re.search(r"\[rig\] (ratio = [\d.]+)", sentence(path))
    assert line is not None
    fit = ac.fit(ac.load(written(path, line[1])))
    assert not any(note.code == "implausible_scale" for note in fit.remarks)
    assert ac.diagnose(fit, ac.load(path)).verdict == "adequate"
    saved = tmp_path / "model.json"
    fit.save(saved)
    assert ac.load_model(saved).rig.ratio == fit.rig.ratio


def test_an_undeclared_sensitivity_is_shown_by_the_motion(tmp_path):
    record = honest(53, "shaker", k=0.0)
    record.columns["acc"] = 1.65 + 0.0102 * record.columns["acc"]
    record.declare(TIME, ACCEL.replace("m/s^2", "V"), POSITION)
    path = record.write(tmp_path)
    with pytest.raises(ac.RecordingError, match="no scale is declared") as refused:
        ac.load(path)
    line = re.search(
        r'by the motion of this recording it is about (scale = "[^"]*")', str(refused.value), re.IGNORECASE
    )
    assert line is not None
    fit = ac.fit(ac.load(written(path, line[1])))
    assert abs(fit["scale_factor"].value) < 0.01


def test_output_and_position_in_the_column_of_each_other_are_exchanged_by_the_line_that_is_printed(tmp_path):
    rig = honest(62, "shaker", 0.02)
    rig.declare(TIME, ACCEL.replace('"acc"', '"pos"'), POSITION.replace('"pos"', '"acc"'))
    assert f"write [channels] {ACCEL} and {POSITION}" in sentence(rig.write(tmp_path))


@pytest.mark.parametrize("kind", ["stage", "shaker", "lift"])
@pytest.mark.parametrize("k", [-0.25, 0.35])
def test_an_ordinary_sensor_is_not_accused(kind, k, tmp_path):
    recording = ac.load(honest(61, kind, k).write(tmp_path))
    assert suspicion(recording) == ""
    assert not any(note.code == "implausible_scale" for note in ac.fit(recording).remarks)


@pytest.mark.parametrize(
    ("name", "file", "message"),
    [
        (
            "13_wrong_axis",
            "run.csv",
            "the motion is in acc_y_g, with the other sign (correlation -1.00), not in acc_x_g",
        ),
        (
            "14_gravity_removed",
            "run.csv",
            "gravity seems to be removed; write in the sidecar\n[rig]\ngravity_along_axis",
        ),
        ("18_factors", "range.csv", "the range setting? The output is 0.5 times what it should be"),
        ("18_factors", "time_unit.csv", "the unit of column tow_ms: s, not ms?"),
    ],
)
def test_the_shared_mistakes_are_named(name, file, message, tmp_path):
    path = case(name, tmp_path) / file
    assert message in sentence(path)
    assert message in suspicion(ac.load(path))


@pytest.mark.parametrize(
    ("factor", "message"), [(10.0, "10 times what it should be, as where a gain"), (8.0, "8 times"), (0.1, "0.1 times")]
)
def test_a_gain_of_ten_is_no_doubling(factor, message):
    rng = np.random.default_rng(3)
    run = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters={}, rng=rng).recording
    scaled = replace(run, accel=replace(run.accel, y=factor * run.accel.y))
    assert message in suspicion(scaled).split(" is off")[0]


def test_a_ratio_of_masses_is_accepted_by_one_line(tmp_path):
    """The encoder of the impactor reads its nose against its body: 1 + k is the ratio of two masses."""
    folder = Path(os.environ.get("ACCELCAL_REAL_DATA", "")) / "cyberdiver"
    if not folder.is_dir():
        pytest.skip("ACCELCAL_REAL_DATA is not set: real recordings are not at hand")
    path = Path(shutil.copy(folder / "cyberdiver_ext_ret_trial1.csv", tmp_path / "run.csv"))
    path.with_suffix(".toml").write_text(
        f"[channels]\n{TIME}\n{ACCEL}\n{POSITION}\n".replace('"acc"', '"accel"').replace('"pos"', '"position"')
    )
    line = re.search(r"\[rig\] (ratio = [\d.]+)", sentence(path))
    assert line is not None
    assert float(line[1].split(" = ")[1]) == pytest.approx(0.227, abs=0.003)
    assert "implausible" not in sentence(written(path, line[1]))


@pytest.mark.parametrize("rings", [True, False])
def test_a_structure_that_rings_between_command_and_sensor_is_asked_for_its_response(
    tmp_path: Path, rings: bool
) -> None:
    rng, rate, every = np.random.default_rng(17), 8000.0, 10
    t = np.arange(0.0, 28.0, 1.0 / rate)
    a = np.zeros(len(t))  # moves at constant speed, with 50 ms of acceleration
    for begin in np.cumsum(rng.uniform(0.35, 0.9, 36)):
        way, lasts = rng.choice([-1.0, 1.0]) * rng.uniform(0.8, 1.8), rng.uniform(0.08, 0.2)
        a[(t >= begin) & (t < begin + 0.05)] += way
        a[(t >= begin + lasts) & (t < begin + lasts + 0.05)] -= way
    a = lfilter(*bilinear([1.0], [0.003, 1.0], rate), a)
    p = cumulative_trapezoid(cumulative_trapezoid(a, t, initial=0.0), t, initial=0.0)
    w, quality = 2.0 * np.pi * 48.0, 8.0
    belt = bilinear([w / quality, w**2], [1.0, w / quality, w**2], rate)
    sampled = slice(None, None, every)
    felt = lfilter(*belt, a)[sampled] if rings else a[sampled]
    output = 0.3 + 1.02 * felt + 0.05 * rng.standard_normal(len(felt))
    command = p[sampled] + 1e-6 * rng.standard_normal(len(felt))
    rows = np.column_stack([t[sampled], 1e3 * output, 1e3 * command])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,accel,command", comments="", fmt="%.7f")
    time = 'time = { column = "t", unit = "s" }'
    (tmp_path / "run.toml").write_text(
        f'[channels]\naccel = {{ column = "accel", unit = "mm/s^2", {time} }}\n'
        f'position = {{ column = "command", unit = "mm", {time} }}\n'
    )
    run = ac.load(tmp_path / "run.csv")
    diagnosis = ac.diagnose(ac.fit(run), run)
    assert ("accelcal response" in diagnosis.sentence) is rings
    assert not any(name.startswith("encoder") for name in diagnosis.effects)
