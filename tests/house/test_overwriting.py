"""Nothing is replaced unasked: a command writes over what it has written, and over nothing else without --force."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.cli import write_recording
from accelcal.cli.overwriting import Writing, writing
from accelcal.io.write import writer_of
from accelcal.simulation import ADXL105_RIG
from tests import commands

TRUTH = {"bias": 0.05, "scale_factor": 0.01}


def accelcal(folder: Path, *words: str, code: int = 0) -> str:
    """What a command says on stderr; it ends with the code that is expected."""
    done = commands.accelcal(*words, cwd=folder)
    assert done.returncode == code, f"{words}: {done.stderr}"
    return done.stderr


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


def measured(path: Path, seed: int) -> None:
    """A recording and a sidecar of the user's own."""
    recording = ac.simulate(
        "tones", seconds=4.0, rig=ADXL105_RIG, parameters=TRUTH, rng=np.random.default_rng(seed)
    ).recording
    write_recording(recording, path)
    assert writer_of(path) == ""


SIMULATED = ("simulate", "-o", "run.csv", "--seconds", "4", "--seed", "8301")


def test_a_measurement_is_not_replaced_by_a_command(tmp_path: Path) -> None:
    measured(tmp_path / "run.csv", 8302)
    measured(tmp_path / "other.csv", 8303)
    before = contents(tmp_path)
    for words in (
        SIMULATED,
        ("cut", "other.csv", "-o", "run.csv"),
        ("fit", "other.csv", "-o", "run.csv"),
        ("fit", "other.csv", "-o", "run.toml"),
        ("plan", "--effects", "cubic", "--stroke", "0.2 m", "--vmax", "0.1 m/s", "--amax", "5 m/s^2", "-o", "run.csv"),
        ("response", "other.csv", "--csv", "run.csv"),
    ):
        message = accelcal(tmp_path, *words, code=2)
        assert f"accelcal {words[0]} did not write run." in message
        assert message.endswith("give another name, or --force to replace what is there\n")
        assert contents(tmp_path) == before
    accelcal(tmp_path, *SIMULATED, "--force")
    assert writer_of(tmp_path / "run.csv") == "simulate"


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_what_a_command_wrote_it_writes_again_until_somebody_changes_it(tmp_path: Path, suffix: str) -> None:
    words = ("simulate", "-o", f"run.{suffix}", "--seconds", "4", "--seed", "8304")
    accelcal(tmp_path, *words)
    once = contents(tmp_path)
    accelcal(tmp_path, *words)
    assert contents(tmp_path) == once
    accelcal(tmp_path, "cut", f"run.{suffix}", "--only", "0:2", "-o", f"part.{suffix}")
    accelcal(tmp_path, "cut", f"run.{suffix}", "--only", "0:3", "-o", f"part.{suffix}")
    assert "did not write" in accelcal(tmp_path, *words[:2], f"part.{suffix}", code=2)  # which is of another command
    changes: dict[str, Callable[[bytes], bytes]] = {
        "run.toml": lambda text: text + b'[run]\noperator = "me"\n',
        f"run.{suffix}": lambda content: content + (b"9.0,0.1,0.2\n" if suffix == "csv" else b""),
    }
    for name, change in changes.items():
        (tmp_path / name).write_bytes(change(once[name]))
        if change(once[name]) != once[name]:
            assert "or it has changed since" in accelcal(tmp_path, *words, code=2)
        (tmp_path / name).write_bytes(once[name])
    (tmp_path / "run.toml").unlink()
    assert "did not write" in accelcal(tmp_path, *words, code=2)


@pytest.mark.parametrize("there", ["run.npz", "run.parquet", "run.txt"])
def test_two_files_of_one_stem_share_no_sidecar(tmp_path: Path, there: str) -> None:
    (tmp_path / there).write_bytes(b"x")
    assert f"run.toml would be the sidecar of {there} as well" in accelcal(tmp_path, *SIMULATED, code=2)
    assert list(contents(tmp_path)) == [there]
    accelcal(tmp_path, *SIMULATED, "--force")


def test_a_model_is_replaced_by_one_of_the_same_recording_alone(tmp_path: Path) -> None:
    measured(tmp_path / "run.csv", 8305)
    measured(tmp_path / "other.csv", 8306)
    accelcal(tmp_path, "fit", "run.csv", "-o", "m.json")
    accelcal(tmp_path, "fit", "run.csv", "--from", "1", "-o", "m.json")
    accelcal(tmp_path, "add", "m.json", "run.csv", "--effect", "cubic", "-o", "m.json")
    before = contents(tmp_path)
    assert "m.json is a model of another recording" in accelcal(tmp_path, "fit", "other.csv", "-o", "m.json", code=2)
    assert "m.json is a model" in accelcal(tmp_path, "diagnose", "m.json", "run.csv", "-o", "m.json", code=2)
    (tmp_path / "notes.json").write_text('{"bias": 1}')
    assert "did not write notes.json" in accelcal(tmp_path, "fit", "run.csv", "-o", "notes.json", code=2)
    (tmp_path / "notes.json").unlink()
    assert contents(tmp_path) == before
    for _ in range(2):
        accelcal(tmp_path, "compare", "m.json", "other.csv", "-o", "c.json")
    assert "did not write c.json" in accelcal(tmp_path, "fit", "run.csv", "-o", "c.json", code=2)
    accelcal(tmp_path, "fit", "other.csv", "-o", "m.json", "--force")


def test_a_page_or_header_is_replaced_where_accelcal_made_it(tmp_path: Path) -> None:
    measured(tmp_path / "run.csv", 8307)
    accelcal(tmp_path, "fit", "run.csv", "-o", "m.json")
    for _ in range(2):
        accelcal(tmp_path, "export", "m.json", "--c", "sensor.h", "--rust", "sensor.rs")
    (tmp_path / "mine.h").write_text("#define RATE 1667\n")
    assert "did not write mine.h" in accelcal(tmp_path, "export", "m.json", "--c", "mine.h", code=2)


def test_the_demonstration_runs_again_in_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from accelcal.cli.overwriting import OverwriteError, require_replaceable

    token = writing.set(Writing("demo", force=False))
    try:
        runs = [tmp_path / "run1.csv", tmp_path / "run2.csv"]
        for number, path in enumerate(runs):
            rng = np.random.default_rng(8310 + number)
            write_recording(
                ac.simulate("tones", seconds=4.0, rig=ADXL105_RIG, parameters=TRUTH, rng=rng).recording,
                path,
            )
        ac.fit(ac.load(runs[0])).save(tmp_path / "m.json")
        for path in (*runs, tmp_path / "m.json"):
            require_replaceable(path, "", runs)
        runs[0].write_text("t,accel,position\n")
        with pytest.raises(OverwriteError, match="demo did not write"):
            require_replaceable(runs[0], "", runs)
    finally:
        writing.reset(token)
