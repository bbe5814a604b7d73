"""Linear algebra runs in one thread while a fit or a diagnosis is made, and in as many as before once it is."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import accelcal as ac
from accelcal._support.process import one_thread
from accelcal.estimation.estimate import estimate
from accelcal.simulation import CXL02_RIG
from accelcal.verbs import diagnose


def threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def limit(number: int) -> None:
    """In a thread that ends: a living one that has set the limit is the only one that may set it again."""
    setting = threading.Thread(target=threadpool_limits, args=(number, "blas"))
    setting.start()
    setting.join()


@pytest.fixture(autouse=True)
def two_threads():
    np.linalg.eigh(np.eye(2))
    before = min(threads())
    limit(2)
    if threads() != {2}:
        pytest.skip("this linear algebra has one thread only")
    yield
    limit(before)


def test_an_inner_one_does_not_lift_what_the_outer_one_asked_for():
    within = []
    inner = one_thread(lambda: within.append(threads()))
    outer = one_thread(lambda: (inner(), within.append(threads())))
    outer()
    assert within == [{1}, {1}]
    assert threads() == {2}


def test_an_error_lifts_it():
    @one_thread
    def wrong() -> None:
        raise ValueError("mistake")

    with pytest.raises(ValueError, match="mistake"):
        wrong()
    assert threads() == {2}


def test_in_another_thread_it_holds_and_is_lifted():
    within: list[set[int]] = []
    other = threading.Thread(target=one_thread(lambda: within.append(threads())))
    other.start()
    other.join()
    assert within == [{1}]
    assert threads() == {2}


def test_of_threads_that_overlap_the_first_one_lifts_it():
    begun, ended = threading.Event(), threading.Event()
    other = threading.Thread(target=one_thread(lambda: (begun.set(), ended.wait())))

    @one_thread
    def first() -> None:
        other.start()
        begun.wait()

    first()
    assert threads() == {2}
    ended.set()
    other.join()
    assert threads() == {2}


def test_a_fit_and_a_diagnosis_ask_for_it():
    run = ac.simulate("tones", seconds=10.0, rig=CXL02_RIG, parameters={}, rng=np.random.default_rng(1)).recording
    within: list[set[int]] = []
    fit = estimate(ac.Model.linear(), run)
    diagnose(fit, run, progress=lambda share: within.append(threads()))
    assert within
    assert all(counts == {1} for counts in within)
    assert threads() == {2}
