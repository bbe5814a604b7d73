"""Where a command may write: refused in one sentence before any work, and never over what it reads."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal import io
from accelcal.cli import app, write_recording
from accelcal.estimation.estimate import estimate
from accelcal.results import model_file
from accelcal.simulation import ADXL105_RIG

PLAN = ["plan", "--effects", "cubic", "--stroke", "0.2 m", "--vmax", "0.1 m/s", "--amax", "9 m/s^2"]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    simulated = ac.simulate(
        "tones", seconds=10.0, rig=ADXL105_RIG, parameters={"bias": 0.05}, rng=np.random.default_rng(1)
    )
    write_recording(simulated.recording, folder / "run.csv")
    model_file.save(estimate(ac.Model.linear(), simulated.recording), folder / "m.json")
    return folder


@pytest.fixture
def here(files, tmp_path, monkeypatch):
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def refused(here, capsys):
    """Run a command that must fail with one line and leave every file as it was; return that line."""

    def run(*arguments: str, code: int = 2) -> str:
        before = contents(here)
        with pytest.raises(SystemExit) as ended:
            app(list(arguments))
        assert ended.value.code == code
        assert contents(here) == before
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.count("\n") == 1
        assert printed.err.startswith("accelcal: ")
        return printed.err

    return run


@pytest.mark.parametrize(
    "command",
    [
        ["fit", "run.csv", "-o"],
        ["compare", "m.json", "run.csv", "-o"],
        ["add", "m.json", "run.csv", "--effect", "cubic", "-o"],
        ["improve", "run.csv", "-o"],
        ["report", "m.json", "run.csv", "-o"],
        ["export", "m.json", "--rust", "a.rs", "--c"],
    ],
    ids=lambda words: words[0],
)
def test_a_place_without_a_folder_is_refused_before_any_work(refused, command, monkeypatch):
    monkeypatch.setattr(io, "load", lambda *_, **__: pytest.fail("work was done"))
    assert "there is no folder absent; create it first" in refused(*command, "absent/made.html")
    assert "folder: this is a folder; give a file name" in refused(*command, "folder")


def test_a_folder_that_may_not_be_written_to_is_named(refused, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert f"no permission to write to the folder {Path('folder').absolute()}" in refused(
        "fit", "run.csv", "-o", "folder/m"
    )


@pytest.mark.parametrize(
    "command",
    [["demo", "-o"], ["compare", "m.json", "run.csv", "--plots"]],
    ids=lambda words: words[0],
)
def test_a_file_is_no_folder(refused, command):
    assert "run.csv is a file; give a folder name" in refused(*command, "run.csv")
    assert "run.csv is a file; give a folder name" in refused(*command, "run.csv/deeper")


@pytest.mark.parametrize(
    ("command", "lost"),
    [
        (["fit", "run.csv", "-o", "run.csv"], "run.csv"),
        (["fit", "run.csv", "-o", "./run.toml"], "run.toml"),
        (["compare", "m.json", "run.csv", "-o", "run.csv"], "run.csv"),
        (["cut", "run.csv", "--only", "1:5", "-o", "run.csv"], "run.csv"),
        (["cut", "run.csv", "--only", "1:5", "-o", "run.parquet"], "run.toml"),
        (
            [
                "plan",
                "--effects",
                "cubic",
                *["--stroke", "0.2m", "--vmax", "0.1m/s", "--amax", "9m/s^2", "--rig", "run.toml", "-o", "run.csv"],
            ],
            "run.toml",
        ),
    ],
    ids=lambda words: words[0] if isinstance(words, list) else "",
)
def test_what_a_command_reads_is_never_written_over(refused, command, lost):
    assert f"{lost} is an input of this command and would be overwritten; give another name" in refused(*command)


@pytest.mark.parametrize("lost", ["run.csv", "run.toml"])
def test_a_link_to_what_a_command_reads_is_never_written_through(refused, here, lost):
    Path("near").symlink_to(lost)
    Path("folder/far").symlink_to("../near")
    for name in ("near", "folder/far", f"folder/../{lost}", str(here / lost)):
        assert "is an input of this command and would be overwritten" in refused("fit", "run.csv", "-o", name)
    Path("other.csv").symlink_to("run.csv")
    Path("other.toml").symlink_to("run.toml")
    assert "is an input of this command and would be overwritten" in refused("fit", "other.csv", "-o", lost)


@pytest.mark.parametrize("lost", ["run.csv", "run.toml"])
def test_a_hard_link_to_what_a_command_reads_leaves_the_other_name_as_it_was(here, lost):
    before = Path(lost).read_bytes()
    os.link(lost, "second")
    with pytest.raises(SystemExit):
        app(["fit", "run.csv", "-o", "second"])
    assert Path(lost).read_bytes() == before


def test_a_model_may_be_replaced_by_the_next_one(here):
    with pytest.raises(SystemExit) as ended:
        app(["freeze", "m.json", "run.csv", "--at", "time_offset=0", "-o", "m.json"])
    assert ended.value.code == 0
    assert model_file.load("m.json").model.fixed == {"time_offset": 0.0}


@pytest.mark.parametrize("place", ["absent/made.txt", "folder", "run.csv/made.txt"])
def test_a_file_that_cannot_be_written_is_named_and_leaves_nothing(here, place):
    before = contents(here)
    with pytest.raises(OSError, match=rf"^{place}: cannot be written \(.*\); write to a folder that exists"):
        io.atomic_write(place, "text")
    assert contents(here) == before


KEYS = ("method", "estimates", "runs", "spreads", "remarks", "model", "covariance", "rig", "origins", "validity")


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("value", [None, 3], ids=["null", "number"])
def test_a_damaged_model_is_refused_by_the_key_that_is_wrong(refused, key, value):
    content = json.loads(Path("m.json").read_text())
    content[key] = value
    Path("m.json").write_text(json.dumps(content))
    message = refused("compare", "m.json", "run.csv", code=3)
    assert f"m.json: {key}: found {'null' if value is None else '3'}, expected" in message
    del content[key]
    Path("m.json").write_text(json.dumps(content))
    message = refused("compare", "m.json", "run.csv", code=3)
    assert f"m.json: {key} is missing. The model file is damaged or incomplete: take a copy that is whole" in message


def test_a_covariance_that_belongs_to_another_model_is_refused(refused):
    content = json.loads(Path("m.json").read_text())
    content["covariance"] = np.eye(2).tolist()
    Path("m.json").write_text(json.dumps(content))
    message = refused("compare", "m.json", "run.csv", code=3)
    assert "shape (2, 2), expected a row and a column for each of bias, scale_factor, time_offset" in message


def test_json_that_is_no_model_is_reported(refused):
    Path("m.json").write_text("{}")
    assert 'the schema "accelcal/model/5", found none; make one with: accelcal fit' in refused(
        "export", "m.json", "--json", code=3
    )


def test_a_missing_recording_is_reported_and_not_a_missing_sidecar(refused):
    assert (
        refused("compare", "m.json", "absent.csv", code=3)
        == "accelcal: absent.csv: there is no such file; check the path.\n"
    )


def test_estimates_of_every_method_are_read_back(here):
    recording = ac.load("run.csv")
    held = estimate(
        ac.Model.linear().freeze(bias=0.05), [recording, dataclasses.replace(recording, digest="of another")]
    )
    model_file.save(held, "held.json")
    assert model_file.load("held.json").covariance.shape == (3, 3)  # scale factor, a delay of each run
    with pytest.raises(SystemExit) as ended:
        app(["fit", "run.csv", "--method", "cwpa", "-o", "cwpa.json"])
    assert ended.value.code == 0
    assert model_file.load("cwpa.json").method.startswith("cwpa")
