"""Pieces of work on two threads: results in their order, errors and progress as of one after the other."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextvars import ContextVar

import pytest

from accelcal._support import threads
from accelcal._support.threads import LOOK, Report, Work, on_two_threads

WAIT = 20.0
"""s; a test that waits longer has failed."""


@pytest.fixture(autouse=True)
def two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads.os, "cpu_count", lambda: 2)


def after(seconds: float, answer: object) -> Work:
    def work(progress: Report) -> object:
        time.sleep(seconds)
        return answer

    return work


def meeting() -> tuple[Work, Work]:
    """Two pieces of work of which neither ends without the other."""
    barrier = threading.Barrier(2)

    def work(progress: Report) -> int:
        return barrier.wait(1.0)

    return work, work


@pytest.mark.parametrize("at_once", [True, False])
def test_results_have_the_order_of_their_work(at_once: bool) -> None:
    works = [after(0.05 * (3 - number), number) for number in range(4)]
    assert on_two_threads(works, lambda share: None, at_once=at_once) == [0, 1, 2, 3]


def test_two_run_at_the_same_time() -> None:
    assert sorted(on_two_threads(meeting(), lambda share: None)) == [0, 1]


@pytest.mark.parametrize("processors", [1, 2])
def test_one_after_the_other_where_memory_counts_or_there_is_one_processor(
    processors: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threads.os, "cpu_count", lambda: processors)
    with pytest.raises(threading.BrokenBarrierError):
        on_two_threads(meeting(), lambda share: None, at_once=processors == 1)


@pytest.mark.parametrize("at_once", [True, False])
def test_the_first_error_in_the_order_of_the_work_is_raised(at_once: bool) -> None:
    def fail(text: str, seconds: float) -> Work:
        def work(progress: Report) -> object:
            time.sleep(seconds)
            raise ValueError(text)

        return work

    works = [after(0.0, 1), fail("first", 0.2), fail("second", 0.0)]
    with pytest.raises(ValueError, match="first"):
        on_two_threads(works, lambda share: None, at_once=at_once)


def test_what_progress_raises_ends_the_waiting_and_what_has_not_begun() -> None:
    class Cancelled(Exception):
        pass

    begun: list[int] = []
    told = threading.Event()

    def work(number: int) -> Work:
        def begin(progress: Report) -> None:
            begun.append(number)
            told.wait(WAIT)

        return begin

    def cancel(share: float) -> None:
        told.set()
        raise Cancelled

    with pytest.raises(Cancelled):
        on_two_threads([work(number) for number in range(40)], cancel)
    assert len(begun) < 40


@pytest.mark.parametrize("at_once", [True, False])
def test_progress_is_reported_by_the_calling_thread_and_rises_to_one(at_once: bool) -> None:
    shares: list[tuple[float, int]] = []

    def work(progress: Callable[[float], None]) -> None:
        for share in (0.5, 1.0):
            time.sleep(LOOK)
            progress(share)

    on_two_threads([work, work], lambda share: shares.append((share, threading.get_ident())), at_once=at_once)
    told = [share for share, _ in shares]
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0)
    assert any(0.0 < share < 1.0 for share in told)
    assert {thread for _, thread in shares} == {threading.get_ident()}


def test_work_sees_what_its_caller_has_set() -> None:
    # The catalogue of a session is in such a variable.
    known: ContextVar[str] = ContextVar("known", default="nothing")
    mark = known.set("of the session")
    try:
        assert on_two_threads([lambda progress: known.get()] * 3, lambda share: None) == ["of the session"] * 3
    finally:
        known.reset(mark)


def test_no_work_has_no_result() -> None:
    assert on_two_threads([], lambda share: None) == []
