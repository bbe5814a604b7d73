"""Which work makes room for other work: none that a page shows, none that is under way, none that is fresh."""

from __future__ import annotations

from pathlib import Path

import pytest

from accelcal.app import sessions
from accelcal.app.session_file import Keeper
from accelcal.app.sessions import MOST, Full, Workbenches
from accelcal.app.state import Job, Run, State


@pytest.fixture
def workbenches(tmp_path: Path) -> Workbenches:
    return Workbenches(tmp_path, Keeper(tmp_path / "state"))


def filled(workbenches: Workbenches, tmp_path: Path) -> list[str]:
    """Names of as many sessions as there can be, each with work."""
    names = [workbenches.new() for _ in range(MOST)]
    for name in names:
        workbenches.find(name).state = State(runs=(Run(tmp_path / "run.csv"),))  # type: ignore[union-attr]
    return names


def test_work_is_never_evicted_while_a_page_shows_it_or_it_runs(
    workbenches: Workbenches, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "IDLE", -1.0)
    names = filled(workbenches, tmp_path)
    shown = {name: True for name in names}
    for name in names:
        workbenches.show(name, lambda name=name: shown[name])  # type: ignore[misc]
    with pytest.raises(Full, match=f"{MOST} sessions are open.*Close a tab"):
        workbenches.new()
    shown[names[3]] = shown[names[5]] = False
    workbenches.find(names[3]).job = Job("fitting")  # type: ignore[union-attr]
    workbenches.new()
    assert workbenches.find(names[5]) is None
    assert not (tmp_path / names[5]).exists()
    assert all(workbenches.find(name) is not None for name in names if name != names[5])


def test_fresh_work_stays_and_empty_workbenches_go(workbenches: Workbenches, tmp_path: Path) -> None:
    names = filled(workbenches, tmp_path)
    with pytest.raises(Full):
        workbenches.new()
    workbenches.find(names[7]).state = State()  # type: ignore[union-attr]
    workbenches.new()
    assert [name for name in names if workbenches.find(name) is None] == [names[7]]


def test_a_name_that_was_kept_is_used_again_once(workbenches: Workbenches) -> None:
    assert workbenches.new("AAAAAAAAAAAAAAAA") == workbenches.new("AAAAAAAAAAAAAAAA") == "AAAAAAAAAAAAAAAA"
    assert workbenches.find("AAAAAAAAAAAAAAAA") is not None
