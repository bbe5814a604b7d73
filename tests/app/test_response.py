"""The frequency response in the workbench: on demand, in the script, and in Chromium with its downloads."""

from __future__ import annotations

import csv
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import accelcal as ac
from accelcal import io
from accelcal.app import script
from accelcal.app.workbench import Workbench
from accelcal.cli import app as command_line
from accelcal.response import frequency_response
from accelcal.simulation import ADXL105_RIG
from accelcal.simulation.motion import sine_steps
from tests.calibration.export.order import require_order
from tests.commands import python

from .test_server import HOST, server  # noqa: F401  (the fixture that runs the workbench)
from .user import LONG, arrives

STEPS = (8.0, 15.0, 30.0, 60.0)
"""Hz"""


@pytest.fixture(scope="module")
def shaken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Steps of sines, with their sidecar."""
    motion = sine_steps(list(STEPS), 5.0, 3.0)
    rig = ac.Rig(sensor=ac.Sensor(model="x", range=50.0, noise=1e-3))
    truth = {"scale_factor": 0.01, "quadratic": 1e-3, "time_offset": 1e-4}
    rng = np.random.default_rng(3)
    recording = ac.simulate(
        motion, seconds=motion.seconds, rig=rig, parameters=truth, rng=rng, position_noise=1e-8
    ).recording
    return written(recording, tmp_path_factory.mktemp("shaken") / "shaker.csv")


def written(recording: ac.Recording, path: Path) -> Path:
    """A recording as a file with its sidecar."""
    io.write_sidecar(recording.rig, io.write_csv(recording, path), io.sidecar_of(path))
    return path


def test_it_is_computed_once_and_undone(shaken: Path, tmp_path: Path) -> None:
    bench = Workbench(tmp_path)
    bench.load(shaken)
    assert bench.response is None
    bench.respond()
    response = bench.response
    assert response is not None, bench.sentence
    assert response.points == frequency_response(ac.load(shaken)).points
    bench.respond()
    assert bench.response is response
    bench.exclude(0.0, 3.2)
    assert bench.response is None  # that was of other data
    bench.respond()
    assert bench.response is not None
    assert [round(p.frequency) for p in bench.response.points] == [15, 30, 60]
    bench.undo()
    bench.undo()
    assert bench.response is response
    bench.undo()
    assert bench.response is None


def test_what_has_none_is_said_in_the_sentence_of_the_command_line(tmp_path: Path) -> None:
    recording = ac.simulate(
        "rest", seconds=10.0, rig=ADXL105_RIG, parameters={}, rng=np.random.default_rng(1)
    ).recording
    path = written(recording, tmp_path / "rest.csv")
    bench = Workbench(tmp_path / "bench")
    bench.load(path)
    bench.respond()
    assert bench.response is None
    assert "rest.csv: output and reference have no frequency in common" in bench.sentence


def test_script_and_commands_repeat_it(shaken: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Workbench(tmp_path / "bench")
    bench.load(shaken)
    assert "response" not in script.python(bench.state) + script.command_line(bench.state)
    bench.exclude(0.0, 3.2)
    bench.respond()
    assert bench.response is not None, bench.sentence
    monkeypatch.chdir(tmp_path)
    for file in (shaken, io.sidecar_of(shaken)):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    ran = python("-c", script.python(bench.state))
    assert ran.returncode == 0, ran.stderr
    rows = [line.split() for line in ran.stdout.splitlines()[: len(bench.response.points)]]
    assert [float(row[1]) for row in rows] == [p.magnitude for p in bench.response.points]
    runner = CliRunner()
    for line in script.command_line(bench.state).splitlines():
        words = shlex.split(line)
        if words[1] in ("cut", "response") and "train.csv" not in words and "unseen.csv" not in words:
            result = runner.invoke(command_line, words[1:])
            assert result.exit_code == 0, result.output
    with (tmp_path / "shaker_response.csv").open() as text:
        written = [float(row["magnitude"]) for row in csv.DictReader(text)]
    np.testing.assert_allclose(written, [p.magnitude for p in bench.response.points], rtol=1e-6)
    require_order((tmp_path / "shaker_response.xml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_figure_table_and_downloads(
    browser: Any,
    server: Any,  # noqa: F811
    shaken: Path,
    tmp_path: Path,
    width: int,
    scheme: str,
) -> None:
    user = arrives(browser, f"http://{HOST}:{server[0]}", f"response-{width}-{scheme}", width, scheme)
    user.load(shaken)
    user.click("Residuals", "tab")
    user.sees("Fit a model first")
    user.click("Compute the frequency response")
    user.sees("Time-domain fit: 1 + k = 1.0")
    user.settles(figures=1)
    user.look("computed")
    user.page.get_by_text("Table by frequency").click()
    user.settles()
    rows = user.page.get_by_role("table", name="Frequency response").locator("tbody tr")
    assert rows.count() == len(STEPS)
    user.look("table")
    saved = {}
    for name in ("Response (.csv)", "Draft certificate of the response (.xml)"):
        with user.page.expect_download(timeout=LONG) as download:
            user.click(name)
        saved[name] = tmp_path / download.value.suggested_filename
        download.value.save_as(saved[name])
    assert [path.name for path in saved.values()] == ["shaker_response.csv", "shaker_response.xml"]
    with saved["Response (.csv)"].open() as text:
        magnitudes = [float(row["magnitude"]) for row in csv.DictReader(text)]
    assert magnitudes == [p.magnitude for p in frequency_response(ac.load(shaken)).points]
    require_order(saved["Draft certificate of the response (.xml)"].read_text(encoding="utf-8"))
    user.click("Export", "tab")
    user.sees("accelcal response shaker.csv")
    assert (user.outside, user.complaints) == ([], [])
    user.page.context.close()
