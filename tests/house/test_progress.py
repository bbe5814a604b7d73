"""Long work says how far it is and what is left; what a signal ends leaves behind what there was."""

from __future__ import annotations

import io
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import accelcal as ac
from accelcal._support.process import within
from accelcal._support.stopping import Stopped
from accelcal.cli.common import bar
from accelcal.cli.diagnosis import kept_on_the_way
from accelcal.estimation.estimate import Fit
from accelcal.simulation.sensor import CXL02_RIG

CLI = Path(ac.__file__).parent / "cli"
QUICK = {"init", "effects", "export", "live", "app", "doctor", "schema"}
"""Commands that end within 2 s whatever the recording, or show what they do in another way."""


class Record:
    """A short recording with a hidden cubic, and what improve told on its way."""

    def __init__(self) -> None:
        truth = {"bias": 0.05, "scale_factor": 0.01, "cubic": 4e-3}
        rng = np.random.default_rng(1)
        self.run = ac.simulate("interleaved", seconds=12.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording
        self.steps: list[Fit] = []
        self.shares: list[float] = []
        self.improvement = ac.improve(self.run, most=1, progress=self.shares.append, on_step=self.steps.append)


@pytest.fixture(scope="module")
def record() -> Record:
    return Record()


def test_a_bar_tells_what_is_left() -> None:
    screen = io.StringIO()
    with bar("fit", Console(file=screen, force_terminal=True, width=80)) as report:
        report(0.4)
        report(0.2)
    assert re.search(r"fit .*s so far", screen.getvalue())


def test_every_command_on_recordings_shows_a_bar() -> None:
    source = "".join(path.read_text() for path in sorted(CLI.glob("*.py")))
    commands = dict(
        re.findall(r"@app\.command\(\)\n@with_exit_codes\ndef (\w+)\((.*?)(?=\n@app\.command|\Z)", source, re.DOTALL)
    )
    assert "with progress(writing.get().command)" in commands["freeze"]  # by which add, drop and freeze are done
    shown = {name for name, body in commands.items() if f'progress("{name}")' in body or "    refit(" in body}
    assert set(commands) - shown - QUICK == {"demo"}  # which shows those of the commands that it runs


def test_each_model_is_passed_on_as_it_is_found(record: Record) -> None:
    assert [fit.model.added for fit in record.steps] == [(), ("cubic",)]
    assert record.shares == sorted(record.shares)


@pytest.mark.parametrize("verb", ["compare", "compare several", "formulas"])
def test_progress_rises_to_no_more_than_the_whole(record: Record, verb: str) -> None:
    shares: list[float] = []
    base, grown = record.steps
    if verb == "compare":
        ac.compare(base, record.run, progress=shares.append)
    elif verb == "compare several":
        ac.compare([base, grown], [record.run, record.run], progress=shares.append)
    else:
        ac.formulas(base, record.run, "shape_of_acceleration", progress=shares.append)
    assert len(shares) > 1
    assert shares == sorted(shares)
    assert shares[0] >= 0.0
    assert 0.5 < shares[-1] <= 1.0


def test_a_search_that_is_ended_leaves_its_newest_model(record: Record, tmp_path: Path) -> None:
    path = tmp_path / "best.json"
    with pytest.raises(Stopped), kept_on_the_way(record.steps, path):
        raise Stopped(signal.SIGINT)
    assert ac.load_model(path).model.added == ("cubic",)
    path.unlink()
    with pytest.raises(Stopped), kept_on_the_way([], path):
        raise Stopped(signal.SIGINT)
    with pytest.raises(ValueError, match="other"), kept_on_the_way(record.steps, path):
        raise ValueError("other")
    assert not path.exists()


def test_a_part_of_the_work_is_a_part_of_the_whole() -> None:
    shares: list[float] = []
    within(shares.append, 0.2, 0.6)(0.5)
    assert shares == pytest.approx([0.4])
