"""Workers that are killed, cancelled, out of memory or left alone: a sentence each, and the session works on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from accelcal._support import errors
from accelcal.app.state import Cancelled, Formula, SessionEffects, State
from accelcal.app.workbench import Workbench
from accelcal.app.workers import WorkerLost, Workers

from . import workbench_tasks as work
from .case import LONG
from .workbench import has_ended, write

NOTHING = SessionEffects()
SIGNALS = [signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV, signal.SIGABRT] if LONG else [signal.SIGSEGV]


def ignore(share: float) -> None:
    """No progress is shown."""


@pytest.fixture
def workers(tmp_path: Path) -> Iterator[Workers]:
    workers_here = Workers(tmp_path, 2)
    yield workers_here
    workers_here.close()


@pytest.fixture(autouse=True)
def tests_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let workers import the tasks of this folder."""
    root = str(Path(__file__).parents[2])
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([root, os.environ.get("PYTHONPATH", "")]))


@pytest.mark.parametrize("number", SIGNALS)
def test_a_worker_that_dies_is_reported_and_replaced(workers: Workers, number: int) -> None:
    with pytest.raises(WorkerLost, match=f"ended before it \\(signal {int(number)}\\).*nothing was changed"):
        workers(work.die, int(number), progress=ignore, memory=NOTHING)
    assert workers(work.speak, progress=ignore, memory=NOTHING) == "heard"


@pytest.mark.skipif(not hasattr(os, "getsid"), reason="needs process groups")
def test_a_worker_waits_for_the_server_and_not_for_the_terminal(workers: Workers) -> None:
    workers(work.speak, progress=ignore, memory=NOTHING)
    (pid,) = workers.pids()
    # Linux weighs processes by their patience within one session only.
    assert os.getsid(pid) == os.getsid(0)
    assert os.getpgid(pid) == pid != os.getpgid(0)
    assert os.getpriority(os.PRIO_PROCESS, pid) > os.getpriority(os.PRIO_PROCESS, 0)


def test_what_goes_wrong_in_a_worker_is_an_error_here(workers: Workers) -> None:
    with pytest.raises(ValueError, match="row 3"):
        workers(work.fail, "row 3", progress=ignore, memory=NOTHING)
    first = workers.pids()
    with pytest.raises(RuntimeError, match="Odd: 1 and 2"):
        workers(work.oddly, progress=ignore, memory=NOTHING)
    with pytest.raises(TypeError, match="pickle"):
        workers(work.unsendable, progress=ignore, memory=NOTHING)
    with pytest.raises(WorkerLost, match="more memory than there is"):
        workers(work.swallow, progress=ignore, memory=NOTHING)
    assert workers.pids() == first  # none of these cost the process
    with pytest.raises(WorkerLost, match="status 3"):
        workers(work.leave, 3, progress=ignore, memory=NOTHING)


def test_what_a_worker_raised_is_judged_by_where_it_was_raised(workers: Workers, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="math domain error") as caught:
        workers(work.foreign, progress=ignore, memory=NOTHING)
    assert not errors.is_for_user(caught.value)
    message = errors.sentence(caught.value, ["accelcal", "app"])
    report = Path(message.partition("please send ")[2].partition(" to its authors")[0])
    assert "workbench_tasks.py" in report.read_text()  # the place in the worker, not that of its messenger
    report.unlink()
    with pytest.raises((ValueError, OSError)) as caught:
        workers(work.absent_file, progress=ignore, memory=NOTHING)
    assert errors.is_for_user(caught.value)


def test_cancelling_ends_the_process_and_what_it_started(workers: Workers, tmp_path: Path) -> None:
    note, shares = tmp_path / "note", []

    def report(share: float) -> None:
        shares.append(share)
        if note.exists():
            raise Cancelled

    with pytest.raises(Cancelled):
        workers(work.sleep, note, progress=report, memory=NOTHING)
    assert all(has_ended(int(pid)) for pid in note.read_text().split())
    assert workers.pids() == []


def test_who_waits_for_a_worker_can_be_cancelled(tmp_path: Path) -> None:
    workers = Workers(tmp_path, 1)
    note, ended = tmp_path / "note", threading.Event()

    def long() -> None:
        with pytest.raises(WorkerLost):
            workers(work.sleep, note, progress=ignore, memory=NOTHING)
        ended.set()

    threading.Thread(target=long).start()
    while not note.exists():
        time.sleep(0.01)

    def report(share: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        workers(work.speak, progress=report, memory=NOTHING)
    workers.close()
    assert ended.wait(30.0)
    with pytest.raises(WorkerLost, match="being ended"):
        workers(work.speak, progress=ignore, memory=NOTHING)


def test_a_session_knows_its_own_effects_alone(workers: Workers) -> None:
    mine = SessionEffects(
        (Formula(name="my_drag", expression="v * abs(v)", unit="1/m", port="output"),), (("supply", "V"),)
    )
    yours = SessionEffects(
        (Formula(name="my_drag", expression="v**3", unit="s/m²", port="output"),)
    )  # the same name for another effect
    workers.most = 1
    assert workers(work.names, progress=ignore, memory=mine) == ["my_drag", "supply", "supply_scale"]
    assert workers(work.names, progress=ignore, memory=yours) == ["my_drag"]
    assert workers(work.names, progress=ignore, memory=NOTHING) == []


def test_workers_end_with_a_server_that_was_killed(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from accelcal.app.workers import Workers;"
        "from accelcal.app.state import SessionEffects; from tests.hostile import workbench_tasks as work;"
        "Workers(Path(sys.argv[1]), 1)("
        "work.sleep, Path(sys.argv[1], 'note'), progress=lambda s: None, memory=SessionEffects())"
    )
    server = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)])
    while not (tmp_path / "note").exists():
        assert server.poll() is None
        time.sleep(0.01)
    server.kill()
    server.wait(30)
    assert has_ended(int((tmp_path / "note").read_text().split()[0]))
    subprocess.run(["kill", (tmp_path / "note").read_text().split()[1]], check=False)


def test_a_session_outlives_its_worker(workers: Workers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "home").mkdir()
    bench = Workbench(tmp_path / "home", workers)
    bench.load(write(tmp_path / "run.csv", 1))
    before = bench.state

    def lost(state: State, progress: object) -> State:
        workers(work.die, int(signal.SIGKILL), progress=ignore, memory=NOTHING)
        return State()

    bench._perform("a long fit", lost)
    assert "the process that did this work has ended" in bench.sentence
    assert bench.state is before
    bench.fit()
    assert bench.sentence == ""
    assert bench.state.step is not None
