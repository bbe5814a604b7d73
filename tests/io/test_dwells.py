"""Dwells from files: tables, recordings at rest, rests of a long record; errors name file, row and column."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import accelcal as ac
from accelcal.cli import app
from accelcal.io.dwells import rests
from accelcal.results.json import VERSION
from tests.schemas import require_published

TABLE = """attitude_deg,mean,std,duration_s,temperature_degC,samples,group
0,0.05,0.002,60,23.1,6000,1
90,9.9581,0.002,60,23.1,6000,1
180,0.05,0.002,60,23.2,6000,2
270,-9.8581,0.002,60,23.2,6000,2
"""
SIDECAR = """[sensor]
noise = "20 ug/sqrt(Hz)"
random_walk = "10 ug/sqrt(h)"
[channels]
accel = { column = "mean", unit = "m/s^2" }
[dwell]
angle_std = "0.1 deg"
gravity = "9.81 m/s^2"
"""


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "tumble.csv"
    path.write_text(TABLE)
    path.with_suffix(".toml").write_text(SIDECAR)
    return path


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_a_table_and_its_sidecar_are_read(table):
    dwells = ac.load_dwells(table)
    assert np.degrees(dwells.angle) == pytest.approx([0.0, 90.0, 180.0, 270.0])
    assert dwells.group == ("1", "1", "2", "2")
    assert dwells.gravity == 9.81
    assert dwells.angle_std == pytest.approx(np.radians(0.1))
    assert dwells.assumptions == ()
    walk = 10e-6 * 9.80665 / 60.0
    level = 9.81 * np.radians(0.1)
    assert dwells.variance[0] == pytest.approx(0.002**2 / 6000 + walk**2 * 20.0 + level**2, rel=1e-3)
    assert dwells.variance[1] < 1e-4 * dwells.variance[0]  # at +1 g an angle enters in second order


def test_a_mean_in_volts_goes_through_the_scale(table):
    table.write_text(TABLE.replace("9.9581,", "5.0,").replace("0.05,", "2.51,").replace("-9.8581,", "0.1,"))
    text = '[sensor]\nscale = "0.25 V/g"\nzero = "2.5 V"\n[channels]\naccel = { column = "mean", unit = "V" }\n'
    table.with_suffix(".toml").write_text(text)
    dwells = ac.load_dwells(table)
    assert dwells.mean[:2] == pytest.approx([0.01 / 0.25 * 9.80665, 10.0 * 9.80665])
    assert dwells.std == pytest.approx(0.002 / 0.25 * 9.80665)
    assert len(dwells.assumptions) == 2  # gravity, angle


def test_a_header_may_say_other_units(table):
    lines = TABLE.splitlines()
    rows = [[float(cell) for cell in line.split(",")] for line in lines[1:]]
    head = "Attitude [rad];mean [mg];std [mm/s^2];Duration [min];temperature [K];samples;group"
    cells = [
        f"{np.radians(a):.15g};{m / 9.80665e-3:.15g};{1e3 * s};{d / 60.0};{warm + 273.15:.15g};{n};{group}"
        for a, m, s, d, warm, n, group in rows
    ]
    plain = ac.load_dwells(table)
    table.write_text("\n".join([head, *cells]))
    table.with_suffix(".toml").write_text(SIDECAR.replace('"mean", unit = "m/s^2"', '"mean [mg]", unit = "mg"'))
    dwells = ac.load_dwells(table)
    for name in ("angle", "mean", "std", "duration", "temperature", "samples"):
        assert getattr(dwells, name) == pytest.approx(getattr(plain, name), rel=1e-12), name
    table.write_text("\n".join([head.replace("group", "mean [V]"), *cells]))
    with pytest.raises(ac.RecordingError, match=r'columns "mean \[mg\]", "mean \[V\]" may each be "mean"'):
        ac.load_dwells(table)
    table.write_text("\n".join([head.replace("[min]", "[mm]"), *cells]))
    with pytest.raises(ac.RecordingError, match=r'column "Duration \[mm\]" is in "mm"; expected s as in "duration_s"'):
        ac.load_dwells(table)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("90,9.9581,0.002", "90,9.9581,-0.002", r'row 3, column "std": found -0.002, expected a standard deviation'),
        ("90,9.9581,0.002,60", "90,9.9581,0.002,0", r'row 3, column "duration_s": found 0, expected a duration'),
        ("90,9.9", "900,9.9", r'row 3, column "attitude_deg": found 900, expected an angle'),
        ("90,9.9581", "90,", r'row 3, column "mean": expected a finite number'),
        (",6000,1\n90", ",1,1\n90", r'row 2, column "samples": found 1, expected a number of samples'),
        ("duration_s", "length_s", r'no column "duration_s"; a table of dwells has the header attitude_deg,mean'),
    ],
)
def test_what_is_wrong_in_a_table_is_reported(table, old, new, message):
    table.write_text(TABLE.replace(old, new, 1))
    with pytest.raises(ac.RecordingError, match=message):
        ac.load_dwells(table)


@pytest.mark.parametrize(("kelvin", "noticed"), [(273.15, True), (0.0, False)])
def test_temperatures_in_kelvin_are_noticed(table, kelvin, noticed):
    text = TABLE.replace("23.1", f"{23.1 + kelvin:.2f}").replace("23.2", f"{23.2 + kelvin:.2f}")
    table.write_text(text)
    messages = [sentence for sentence in ac.load_dwells(table).assumptions if "as if it were in kelvin" in sentence]
    assert bool(messages) is noticed
    assert not noticed or "296.25 to 296.35" in messages[0]


def test_a_table_without_a_unit_shows_what_to_write(table):
    table.with_suffix(".toml").unlink()
    with pytest.raises(ac.RecordingError, match=r'(?s)"mean" has no unit; write in .*tumble.toml.*accel = '):
        ac.load_dwells(table)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[dwell]\nattitude = "sideways"', r'dwell.attitude: found \'sideways\', expected "up"'),
        ('[dwell]\nattitude = "up"\nangle = "30 deg"', "dwell.angle: dwell.attitude is given as well"),
        ('[dwell]\nangle = "30"', 'dwell.angle: "30" has no unit; expected an angle'),
        ('[dwell]\nangel = "30 deg"', 'dwell.angel: unknown key; did you mean "angle"'),
    ],
)
def test_what_is_wrong_in_a_sidecar_is_reported(table, text, message):
    table.with_suffix(".toml").write_text(text)
    with pytest.raises(ac.RecordingError, match=message):
        ac.load_dwells(table)


def test_an_error_names_the_header_that_a_table_needs(table):
    table.write_text(TABLE.replace("attitude_deg,mean", "Winkel,U"))
    stderr = run("fit", table).stderr
    assert stderr.count("attitude_deg,mean,std,duration_s") == 1
    table.with_suffix(".toml").write_text("[channels]\naccel = { column = 'U', unit = 'm/s^2' }\n")
    assert "attitude_deg" not in run("fit", table).stderr


def test_groups_differ_in_every_digit(table):
    table.write_text(TABLE.replace("6000,2", "6000,20261104").replace("6000,1\n", "6000,20261103\n"))
    assert ac.load_dwells(table).group == ("20261103", "20261103", "20261104", "20261104")


def test_a_cut_keeps_when_how_and_by_whom_a_run_was_made(tmp_path):
    run("simulate", "-o", tmp_path / "run.csv", "--seconds", "10", "--seed", "2")
    sidecar = tmp_path / "run.toml"
    sidecar.write_text(sidecar.read_text() + '\n[run]\ndate = 2026-11-03T14:30:00\nmounting = "A"\noperator = "RS"\n')
    assert run("cut", tmp_path / "run.csv", "--only", "1:5", "-o", tmp_path / "part.csv").exit_code == 0
    whole, part = (ac.load(tmp_path / name).labels for name in ("run.csv", "part.csv"))
    assert (part.mounting, part.operator) == ("A", "RS")
    assert part.date == pytest.approx(whole.date, abs=1e-8)


def at_rest(folder, attitude, mean, seed):
    rng = np.random.default_rng(seed)
    t, path = np.arange(0.0, 20.0, 0.01), folder / f"{seed}.csv"
    rows = np.column_stack([t, mean + 0.002 * rng.standard_normal(len(t))])
    np.savetxt(path, rows, delimiter=",", header="t_s,accel_m_per_s2", comments="", fmt="%.9g")
    path.with_suffix(".toml").write_text(f'[dwell]\n{attitude}\ngravity = "9.81 m/s^2"\nangle_std = "0.01 deg"\n')
    return path


def test_recordings_at_rest_are_dwells_and_fit_together(tmp_path):
    paths = [
        at_rest(tmp_path, 'attitude = "up"', 9.91, 1),
        at_rest(tmp_path, 'attitude = "down"', -9.81, 2),
        at_rest(tmp_path, 'angle = "30 deg"', 4.98, 3),
    ]
    several = [ac.load_dwells(path) for path in paths]
    assert several[0].mean[0] == pytest.approx(9.91, abs=3e-4)
    assert several[0].duration[0] == pytest.approx(20.0)
    fit = ac.fit(several)
    assert fit["bias"].value == pytest.approx(0.05, abs=3e-4)
    assert 1.0 + fit["scale_factor"].value == pytest.approx(9.86 / 9.81, abs=1e-4)
    shown = run("fit", *paths)
    assert shown.exit_code == 0
    assert "scale_factor" in shown.output
    with pytest.raises(ac.RecordingError, match="is given twice"):
        ac.fit([several[0], several[0]])
    paths[0].with_suffix(".toml").unlink()
    with pytest.raises(ac.RecordingError, match=r"attitude of this dwell is not declared.*\n.*\[dwell\]"):
        ac.load_dwells(paths[0])


def test_the_sidecar_of_a_motion_names_its_table(table, tmp_path):
    assert run("simulate", "-o", tmp_path / "run.csv", "--seconds", "10", "--seed", "2").exit_code == 0
    sidecar = tmp_path / "run.toml"
    sidecar.write_text(sidecar.read_text() + '\n[dwell]\ntable = "tumble.csv"\n')
    recording = ac.load(tmp_path / "run.csv")
    assert recording.dwells is not None
    assert recording.dwells.name == "tumble.csv"
    assert ac.fit(recording).dwells.name == "tumble.csv"
    sidecar.write_text(sidecar.read_text().replace("tumble.csv", "other.csv"))
    with pytest.raises((ac.RecordingError, OSError), match=r"other\.csv"):
        ac.load(tmp_path / "run.csv")


def long_record(path):
    """A tumble by hand: 10 s at each of eight angles, 4 s of turning between them."""
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 8 * 14.0, 0.01)
    turns = np.floor(t / 14.0) + 0.5 - 0.5 * np.cos(np.pi * np.clip((t % 14.0 - 10.0) / 4.0, 0.0, 1.0))
    y = 0.05 + 1.004 * 9.80665 * np.sin(np.radians(45.0) * turns) + 0.002 * rng.standard_normal(len(t))
    np.savetxt(path, np.column_stack([t, y]), delimiter=",", header="t_s,accel_m_per_s2", comments="", fmt="%.9g")
    return t, y


def test_rests_of_a_long_record_become_a_table(tmp_path):
    path, out = tmp_path / "long.csv", tmp_path / "found.csv"
    t, y = long_record(path)
    result = rests(t, y[:, None])
    assert len(result) == 8
    for k, (a, b) in enumerate(result):
        assert 14.0 * k - 0.8 <= t[a] < 14.0 * k + 1.0  # at the top a turn begins and ends slowly
        assert 14.0 * k + 9.0 < t[b] < 14.0 * k + 10.8
    unasked = run("dwells", path, "-o", out)
    assert unasked.exit_code == 2
    assert not out.exists()
    written = run("dwells", path, "--attitudes", "0:45", "-o", out, "--figure", tmp_path / "rests.png", "--yes")
    assert written.exit_code == 0, written.output
    assert (tmp_path / "rests.png").stat().st_size > 10_000
    fit = ac.fit(ac.load_dwells(out))
    assert abs(fit["scale_factor"].value - 0.004) < 4.0 * fit["scale_factor"].std
    assert run("dwells", path, "--attitudes", "0,45", "-o", tmp_path / "b.csv", "--yes").exit_code == 2
    bare = tmp_path / "bare.csv"
    assert run("dwells", path, "-o", bare, "--yes").exit_code == 0
    with pytest.raises(ac.RecordingError, match=r'row 2, column "attitude_deg": expected a finite number'):
        ac.load_dwells(bare)
    again = run("dwells", path, "--attitudes", "0:45", "-o", out, "--yes")
    assert again.exit_code == 0, again.output  # what the same command wrote
    sidecar = out.with_suffix(".toml")
    sidecar.write_text(sidecar.read_text() + "# checked by hand\n")
    edited = run("dwells", path, "--attitudes", "0:45", "-o", out, "--yes")
    assert edited.exit_code == 2
    assert sidecar.read_text().endswith("# checked by hand\n")
    none = run("dwells", path, "--least", "20 s")
    assert none.exit_code == 3
    assert "no rest of 20 s" in none.output + none.stderr


def test_a_cut_says_that_dwells_are_not_written(table, tmp_path):
    run("simulate", "-o", tmp_path / "run.csv", "--seconds", "10", "--seed", "2")
    sidecar = tmp_path / "run.toml"
    sidecar.write_text(sidecar.read_text() + '\n[dwell]\ntable = "tumble.csv"\n')
    done = run("cut", tmp_path / "run.csv", "--only", "1:5", "-o", tmp_path / "part.csv")
    assert done.exit_code == 0
    assert "tumble.csv is not written" in done.output + done.stderr


def test_a_diagnosis_takes_dwells_alone_and_with_a_motion(table, tmp_path):
    run("simulate", "-o", tmp_path / "run.csv", "--seconds", "10", "--seed", "2")
    assert run("fit", table, "-o", tmp_path / "m.json").exit_code == 0
    alone = run("diagnose", tmp_path / "m.json", table, "--json")
    assert alone.exit_code == 0
    content = json.loads(alone.stdout)
    assert content["schema"] == f"accelcal/diagnosis-of-dwells/{VERSION}"
    require_published(content)
    assert run("fit", tmp_path / "run.csv", "-o", tmp_path / "r.json").exit_code == 0
    both = run("diagnose", tmp_path / "r.json", tmp_path / "run.csv", table)
    assert both.exit_code == 0, both.output


def test_what_a_diagnosis_of_dwells_names_is_added_by_the_command_it_prints(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng, header = np.random.default_rng(1), TABLE.splitlines()[0]
    rows = [
        f"{angle},{9.81 * np.sin(np.radians(angle)) + 1e-3 * t + 2e-5 * noise:.7f},2e-3,60,{t},6000,{t}"
        for t in (20, 45)
        for angle, noise in zip(range(0, 360, 30), rng.standard_normal(12), strict=True)
    ]
    (tmp_path / "tumble.csv").write_text("\n".join([header, *rows]) + "\n")
    (tmp_path / "tumble.toml").write_text(SIDECAR.replace("0.1 deg", "0.0003 deg"))
    assert run("fit", "tumble.csv", "-o", "m.json").exit_code == 0
    judged = run("diagnose", "m.json", "tumble.csv")
    command = judged.stderr.split("next: accelcal ")[1].split()
    assert command[:5] == ["add", "m.json", "tumble.csv", "--effect", "temperature_bias"]
    grown = run(*command)
    assert grown.exit_code == 0, grown.output
    assert grown.stderr.endswith(f"next: accelcal diagnose {command[-1]} tumble.csv\n")
    fit = ac.load_model(tmp_path / command[-1])
    assert abs(fit["temperature_bias"].value - 1e-3) < 4 * fit["temperature_bias"].std < 1e-5
    twice = run("add", command[-1], "tumble.csv", "--effect", "temperature_bias")
    assert twice.exit_code != 0
    assert "enter a model once" in twice.stderr
    left = run("drop", command[-1], "tumble.csv", "--effect", "temperature_bias", "-o", "left.json")
    assert left.exit_code == 0, left.output
    moving = run("add", "m.json", "tumble.csv", "--effect", "sensor_lag")
    assert moving.exit_code in (3, 4)
    assert "rest" in moving.stderr
