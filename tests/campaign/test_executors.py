"""Threads, processes and dask write the same file; a killed campaign goes on without computing anything again."""

from __future__ import annotations

import multiprocessing
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, InvalidStateError, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest
from distributed import Client, LocalCluster

from accelcal._support import process
from accelcal.fleet import campaign
from tests.campaign.child import SEED
from tests.campaign.contents import contents, counted, killed
from tests.campaign.tasks import w2

RUNS, SECONDS = 200, 2.0


@contextmanager
def threads() -> Iterator[Executor]:
    with ThreadPoolExecutor(2) as pool:
        yield pool


@contextmanager
def processes() -> Iterator[Executor]:
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


@contextmanager
def dask() -> Iterator[Executor]:
    cluster = LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None)
    with cluster, Client(cluster) as client, client.get_executor() as executor:
        yield executor


def whole(store: Path, executor: Executor | None = None) -> campaign.Count:
    seeds = campaign.seeds(SEED, RUNS)
    return campaign.run(w2, seeds, store=store, parameters={"seconds": SECONDS}, executor=executor)


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> str:
    """Contents that one thread after another would write."""
    store = tmp_path_factory.mktemp("reference") / "c.sqlite"
    with ThreadPoolExecutor(1) as pool:
        assert whole(store, pool) == campaign.Count(computed=RUNS, stored=0, failed=0)
    return contents(store)


@pytest.mark.parametrize("kind", [threads, processes, dask])
def test_the_answer_is_the_same_on_every_executor(tmp_path, reference, kind):
    with kind() as executor:
        assert whole(tmp_path / "c.sqlite", executor) == campaign.Count(computed=RUNS, stored=0, failed=0)
    assert contents(tmp_path / "c.sqlite") == reference


def test_killed_half_way_it_finishes_with_the_same_contents(tmp_path, reference, monkeypatch):
    store, calls = tmp_path / "c.sqlite", tmp_path / "calls"
    killed(store, calls, runs=RUNS, seconds=SECONDS, after=RUNS // 2)
    stored = campaign.load(store).items
    assert RUNS // 2 <= len(stored) < RUNS
    monkeypatch.setenv("ACCELCAL_CALLS", str(calls))
    assert whole(store) == campaign.Count(computed=RUNS - len(stored), stored=len(stored), failed=0)
    assert contents(store) == reference
    times = counted(calls)
    assert set(times) == set(campaign.load(store).items)
    assert {times[item] for item in stored} == {1}  # what stood in the file was not computed again


def test_runs_are_honest(tmp_path, reference):
    # The campaign is no better than its task: mean NEES of four parameters, 99.9 % of chi-square with 800 dof.
    whole(tmp_path / "c.sqlite")
    nees = campaign.load(tmp_path / "c.sqlite").values["nees"]
    assert 3.37 < nees.mean() < 4.69


class Stopped(Exception):
    pass


def end_with_cancelled_work() -> None:
    """Cancel what waits, end the only worker, and leave with an exception."""
    with process.processes(1) as pool:
        waiting: list[Future[None]] = [pool.submit(time.sleep, 60.0) for _ in range(5)]
        while not waiting[0].running():
            time.sleep(0.01)
        assert waiting[-1].cancel()
        for worker in pool._processes.values():
            worker.terminate()
        while any(not future.done() for future in waiting[:2]):
            time.sleep(0.01)
        raise Stopped


def thread_faults() -> list[type[BaseException]]:
    """What threads fail of meanwhile."""
    faults: list[type[BaseException]] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(threading, "excepthook", lambda thrown: faults.append(thrown.exc_type))
        with pytest.raises(Stopped):
            end_with_cancelled_work()
    return faults


def test_cancelled_work_of_a_worker_that_has_ended_is_no_fault() -> None:
    assert thread_faults() == []


@pytest.mark.skipif(sys.version_info >= (3, 12), reason="later Pythons pass over cancelled work")
def test_without_it_a_thread_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """The twin, which shows that the case above is the one that fails."""
    monkeypatch.setattr(process, "_cancelled_are_silent", nullcontext)
    assert thread_faults() == [InvalidStateError]
