"""What a user gives by mistake: one sentence that names it, an exit code, nothing written, no traceback."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.cli import app, write_recording
from accelcal.estimation.estimate import estimate
from accelcal.io import sidecar_of
from accelcal.results import model_file
from accelcal.simulation import ADXL105_RIG, CXL02_RIG


def record(path: Path, rig: ac.Rig, seed: int) -> None:
    rng = np.random.default_rng(seed)
    simulation = ac.simulate("tones", seconds=12.0, rig=rig, parameters={"bias": 0.05}, rng=rng)
    write_recording(simulation.recording, path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    here = tmp_path_factory.mktemp("runs")
    record(here / "run.csv", ADXL105_RIG, 1)
    record(here / "same.csv", ADXL105_RIG, 2)
    record(here / "other.csv", CXL02_RIG, 3)
    (here / "copy.csv").write_bytes((here / "run.csv").read_bytes())
    (here / "copy.toml").write_bytes((here / "run.toml").read_bytes())
    model_file.save(estimate(ac.Model.linear(), ac.load(here / "run.csv")), here / "m.json")
    return here


@pytest.fixture
def ended(folder, monkeypatch, capsys):
    """Run a command to its end; return its exit code, what it printed and what it said."""
    monkeypatch.chdir(folder)

    def run(*arguments: str) -> tuple[int, str, str]:
        before = {path: path.read_bytes() for path in folder.iterdir()}
        with pytest.raises(SystemExit) as done:
            app(list(arguments))
        assert {path: path.read_bytes() for path in folder.iterdir()} == before
        return done.value.code, *capsys.readouterr()

    return run


@pytest.mark.parametrize(
    "command",
    [
        ["fit", "run.csv", "other.csv"],
        ["improve", "run.csv", "--holdout", "other.csv"],
        ["compare", "m.json", "other.csv"],
        ["diagnose", "m.json", "run.csv", "--holdout", "other.csv"],
        ["add", "m.json", "other.csv", "--effect", "cubic", "-o", "made.json"],
        ["report", "m.json", "run.csv", "--holdout", "other.csv", "-o", "made.html"],
    ],
    ids=lambda words: words[0],
)
def test_a_recording_of_another_sensor_is_refused(ended, command):
    code, printed, message = ended(*command)
    assert (code, printed) == (3, "")
    assert 'other.csv: sensor.model is "CXL02TG3" but that of ' in message
    assert 'is "ADXL105"; expected one sensor' in message


def test_a_sensor_that_is_declared_on_one_side_only_is_not_compared(ended, folder):
    sidecar = sidecar_of(folder / "same.csv")
    sidecar.write_text(sidecar.read_text().replace('model = "ADXL105"', 'serial = "7"'))
    assert ended("compare", "m.json", "same.csv")[0] == 0


@pytest.mark.parametrize("command", [["fit", "run.csv", "copy.csv"], ["improve", "run.csv", "--holdout", "copy.csv"]])
def test_the_same_recording_twice_is_refused(ended, command):
    code, printed, message = ended(*command)
    assert (code, printed) == (3, "")
    assert message == "accelcal: copy.csv is run.csv once more: its readings would count twice. Give it once\n"


@pytest.mark.parametrize(
    ("command", "code", "expected"),
    [
        (["fit", "run.csv", "--band", "-3 Hz"], 3, "run.csv: a band of -3 Hz; expected more than 0 and less than half"),
        (["fit", "run.csv", "--band", "1e9 Hz"], 3, "half the rate of the encoder readings, 416.7 Hz"),
        (["compare", "m.json", "run.csv", "--band", "0 Hz"], 3, "run.csv: a band of 0 Hz; expected more than 0"),
        (["fit", "run.csv", "--from", "nan"], 2, "--from 'nan': expected a finite time"),
        (["fit", "run.csv", "--form", "inverse"], 2, "--form is an option of the recursive filters; add --method aci"),
        (["freeze", "m.json", "run.csv"], 2, "name the parameters to hold or to estimate again"),
        (["freeze", "m.json", "run.csv", "--at", "bias=nan"], 2, "expected NAME=VALUE with a number"),
        (["simulate", "-o", "made.csv", "--a-rms", "-1"], 3, "'interleaved' is to be scaled to -1; give a positive"),
        (["simulate", "-o", "run.csv/made.csv"], 3, "run.csv: file exists; check the path"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_value_that_makes_no_sense_is_named(ended, command, code, expected):
    result, printed, message = ended(*command)
    assert (result, printed) == (code, "")
    assert expected in message
    assert message.count("\n") == 1


def test_a_fit_repeats_what_reading_warned_of(ended, folder):
    rows = (folder / "run.csv").read_text().splitlines()
    when = rows[50].split(",")[0]
    rows[51] = ",".join([when, *rows[51].split(",")[1:]])
    (folder / "doubled.csv").write_text("\n".join(rows) + "\n")
    (folder / "doubled.toml").write_bytes((folder / "run.toml").read_bytes())
    code, printed, _ = ended("fit", "doubled.csv")
    assert code == 0
    assert "warning: doubled.csv: accel: 1 sample repeats the time stamp before" in " ".join(printed.split())
