"""What everybody sees first: the file that was written, a next step that is right, no text that a terminal lacks."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import accelcal as ac
from accelcal.cli import common, write_recording
from accelcal.diagnosis.noise.residuals import power_fit
from accelcal.signals.series import interpolation_spread, local_spread
from accelcal.simulation import ADXL105_RIG
from tests import commands

TRUTH = {"bias": 0.05, "scale_factor": 0.01}
HASHED = "from pathlib import Path; from accelcal.app.state import digest_at; print(digest_at(Path({!r})))"
WARNED = """import numpy as np
import typer
from accelcal import cli
app = typer.Typer()
app.command("divide")(lambda: np.ones(1) / np.zeros(1))
cli.__getattr__ = lambda _: app
cli.main()"""


def accelcal(folder: Path, *words: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    return commands.accelcal(*words, cwd=folder, text=False, env={**os.environ, **environment})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings, and a model of the first."""
    place = tmp_path_factory.mktemp("first")
    for name, seed in (("run", 8101), ("held", 8102)):
        rng = np.random.default_rng(seed)
        recording = ac.simulate("tones", seconds=5.0, rig=ADXL105_RIG, parameters=TRUTH, rng=rng).recording
        write_recording(recording, place / f"{name}.csv")
    ac.fit(ac.load(place / "run.csv")).save(place / "m.json")
    return place


def test_init_names_the_file_that_it_wrote(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t_s,accel_g,position_mm,spare\n0,0.1,0,1\n0.1,0.2,1,2\n")
    done = accelcal(tmp_path, "init", "run.csv")
    complete = "check what it takes each column for"
    assert done.stderr.decode() == f"wrote run.toml: {complete}, then run: accelcal check run.csv\n"
    assert (tmp_path / "run.toml").exists()
    (tmp_path / "odd.csv").write_text("a,b,c\n0,0.1,0\n0.1,0.2,1\n")
    done = accelcal(tmp_path, "init", "odd.csv")
    assert done.stderr.decode() == "wrote odd.toml: fill in the marked lines, then run: accelcal check odd.csv\n"


@pytest.mark.parametrize(
    ("words", "step"),
    [
        (["compare", "m.json", "held.csv"], "diagnose m.json run.csv --holdout held.csv"),
        (["compare", "m.json", "run.csv"], "diagnose m.json run.csv"),
        (
            ["improve", "run.csv", "--holdout", "held.csv", "--max-effects", "0", "-o", "best.json"],
            "report best.json run.csv --holdout held.csv -o run.html",
        ),
        (["diagnose", "m.json", "run.csv", "--holdout", "held.csv"], "m.json run.csv"),
    ],
)
def test_a_held_out_recording_stays_held_out_in_the_next_step(folder: Path, words: Sequence[str], step: str) -> None:
    last = accelcal(folder, *words).stderr.decode().splitlines()[-1]
    assert last.startswith("next: accelcal ")
    assert step in last


@pytest.mark.parametrize(
    ("words", "step"),
    [
        (["check", "held.csv", "--rig", "other.toml"], "fit held.csv --rig other.toml -o held.json"),
        (["fit", "held.csv", "--rig", "other.toml", "-o", "n.json"], "diagnose n.json held.csv --rig other.toml"),
        (
            ["improve", "run.csv", "--holdout", "held.csv", "--from", "0.5", "--max-effects", "0", "-o", "late.json"],
            "report late.json run.csv --holdout held.csv -o run.html",  # `report` takes the part from the model
        ),
    ],
)
def test_the_next_step_reads_what_this_one_read(folder: Path, words: Sequence[str], step: str) -> None:
    (folder / "other.toml").write_bytes((folder / "held.toml").read_bytes())
    assert accelcal(folder, *words).stderr.decode().splitlines()[-1] == f"next: accelcal {step}"


def test_a_mistake_is_corrected_before_anything_is_fitted(tmp_path: Path) -> None:
    t = np.arange(0.0, 20.0, 0.005)
    size, w = np.array([0.03, 0.01, 0.004]), 2.0 * np.pi * np.array([0.7, 1.9, 3.1])
    waves = np.sin(w[:, None] * t)
    output = (size * w**2) @ waves + np.random.default_rng(1).normal(0.0, 0.01, len(t))  # it points backwards
    rows = np.column_stack([t, output, size @ waves])
    np.savetxt(tmp_path / "run.csv", rows, fmt="%.9g", delimiter=",", header="t_s,accel_g,position_m", comments="")
    unit, rig = '[channels]\naccel = { column = "accel_g", unit = "m/s^2" }\n', '[rig]\nmount = "reversed"\n'
    corrected = "next: correct that in run.toml, then: accelcal check run.csv"
    for sidecar, step in (("", corrected), (unit, corrected), (unit + rig, "next: accelcal fit run.csv -o run.json")):
        (tmp_path / "run.toml").write_text(sidecar)
        assert accelcal(tmp_path, "check", "run.csv").stderr.decode().splitlines()[-1] == step


OWN_EFFECT = '''from accelcal.effects import effect
@effect("cable_pull", unit="s⁻²", owner="rig", symbol="cp", scale=1e-2, source="spring balance")
def cable_pull(s):
    """The cable pulls.

    Equation: e = cp p.
    Looks like: a residual that grows along the rail.
    Easily confused with: rail_slope.
    Separate by: removing the cable.
    """
    return s.p
'''


def test_check_refuses_the_size_of_an_effect_that_nobody_has_defined(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_bytes((folder / "run.csv").read_bytes())
    sidecar = (folder / "run.toml").read_text(encoding="utf-8")
    (tmp_path / "run.toml").write_text(f'{sidecar}\n[prior]\ncable_pull = "0.01 1/s^2"\n', encoding="utf-8")
    (tmp_path / "mine.py").write_text(OWN_EFFECT, encoding="utf-8")
    refused = accelcal(tmp_path, "check", "run.csv")
    assert refused.returncode == 3
    assert "run.toml: prior.cable_pull: there is no effect called 'cable_pull'" in refused.stderr.decode()
    last = accelcal(tmp_path, "check", "run.csv", "--effects-file", "mine.py").stderr.decode().splitlines()[-1]
    assert last.startswith("next: accelcal fit run.csv")


def test_a_file_of_the_same_name_elsewhere_is_not_what_was_fitted(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_bytes((folder / "held.csv").read_bytes())
    (tmp_path / "run.toml").write_bytes((folder / "held.toml").read_bytes())
    (tmp_path / "m.json").write_bytes((folder / "m.json").read_bytes())
    assert "next:" not in accelcal(tmp_path, "compare", "m.json", "run.csv").stderr.decode()


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        (("time_offset", "cubic"), "next: accelcal add m.json run.csv --effect cubic -o m_cubic.json\n"),
        (("time_offset", "bias"), ""),
        (("cubic", "quadratic"), "next: accelcal add m.json run.csv --effect cubic -o m_cubic.json\n"),
    ],
)
def test_the_step_after_a_diagnosis_adds_what_the_model_lacks(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], effects: object, expected: str
) -> None:
    monkeypatch.chdir(folder)
    result = SimpleNamespace(effects=effects, verdict="named")
    common.after_diagnosis(ac.load_model("m.json"), result, Path("m.json"), [Path("run.csv")])  # type: ignore[arg-type]
    assert capsys.readouterr().err == expected


ENCODINGS: list[Mapping[str, str]] = [
    {"PYTHONIOENCODING": "ascii"},
    {"PYTHONIOENCODING": "cp1252"},
    {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
]


@pytest.mark.parametrize(
    ("words", "encoding"),
    [
        *((["check", "run.csv"], encoding) for encoding in ENCODINGS),
        (["fit", "run.csv"], ENCODINGS[0]),
        (["effects"], ENCODINGS[1]),
        (["live", "--file", "run.csv", "--rig", "run.toml"], ENCODINGS[0]),
        (["live", "--file", "run.csv", "--rig", "run.toml"], ENCODINGS[2]),
    ],
    ids=["check-ascii", "check-cp1252", "check-C", "fit-ascii", "effects-cp1252", "live-ascii", "live-C"],
)
def test_an_encoding_that_lacks_characters_ends_no_command(
    folder: Path, words: Sequence[str], encoding: Mapping[str, str]
) -> None:
    done = accelcal(folder, *words, **encoding)
    assert done.returncode == 0, done.stderr
    assert b"Error" not in done.stderr
    done.stdout.decode("cp1252" if encoding.get("PYTHONIOENCODING") == "cp1252" else "ascii")


def test_json_is_the_same_in_every_encoding(folder: Path) -> None:
    texts = [accelcal(folder, "fit", "run.csv", "--json", **encoding).stdout for encoding in ({}, ENCODINGS[0])]
    assert json.loads(texts[0].decode()) == json.loads(texts[1].decode("ascii"))
    assert not texts[0].isascii()


@pytest.mark.parametrize("name", ["/proc/self/pagemap", "/proc/kmsg"])
def test_a_session_file_hashes_no_file_that_never_ends(name: str) -> None:
    if not Path(name).is_file():
        pytest.skip(f"there is no {name}")
    script = [sys.executable, "-c", HASHED.format(name)]
    done = subprocess.run(script, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert len(done.stdout.strip()) in (0, 64)  # none, or that of what it says to hold: nothing


def test_what_numpy_warns_of_is_not_for_the_terminal() -> None:
    done = subprocess.run([sys.executable, "-c", WARNED], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    outcome = subprocess.run([sys.executable, "-W", "always", "-c", WARNED], capture_output=True, text=True, timeout=60)
    assert "divide by zero" in outcome.stderr  # the sister: whoever asks for warnings gets them


def test_exact_and_empty_series_are_no_reason_to_warn() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isfinite(power_fit(np.zeros(32), np.ones((32, 2)))[0]).all()
        assert len(local_spread(np.empty(0))) == 0
        assert np.isnan(interpolation_spread(np.empty(0), np.empty(0)))


def test_a_command_that_ends_before_its_number_is_read_has_an_answer(tmp_path):
    parent = commands.Parent()
    parent.socket, other = socket.socketpair()
    with parent.socket, other:
        other.send(b"12\n")
        other.send(b"[3, 0.5]")
        assert parent.run(["-c", ""], str(tmp_path), {}, 10.0) == (3, b"", b"")
        assert parent.spent == 0.5
