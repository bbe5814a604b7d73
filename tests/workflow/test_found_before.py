"""What was found of a recording is found once, for as long as the recording lives and the question is the same."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from accelcal._support import found_before as module
from accelcal._support.found_before import found_before
from accelcal.data.recording import Recording


def recorded() -> Recording:
    t = np.arange(100.0)
    return Recording.from_arrays(t, np.sin(t), np.cos(t), units={"accel": "m/s^2", "position": "m"})


class Counted:
    """Finds an answer, and counts how often."""

    def __init__(self, answer: Callable[[], object] = list) -> None:
        self.answer, self.times = answer, 0

    def __call__(self) -> object:
        self.times += 1
        return self.answer()


def test_the_same_question_is_answered_once() -> None:
    one, find = recorded(), Counted()
    first = found_before(one, "rest", (1.0, "m"), find)
    assert found_before(one, "rest", (1.0, "m"), find) is first
    assert find.times == 1


def test_another_question_name_or_recording_is_found_anew() -> None:
    one, twin, find = recorded(), recorded(), Counted()
    answers = [
        found_before(one, "rest", 1.0, find),
        found_before(one, "rest", 2.0, find),
        found_before(one, "jumps", 2.0, find),
        found_before(twin, "rest", 2.0, find),
        found_before(one, "rest", 1.0, find),  # the last question of a name is kept, not all of them
    ]
    assert find.times == len({id(answer) for answer in answers}) == 5
    assert found_before(twin, "rest", 2.0, find) is answers[3]


def test_an_array_that_was_written_into_is_another_question() -> None:
    one, find = recorded(), Counted()
    first = found_before(one, "rest", one.sums, find)
    one.accel.y.flags.writeable = True
    one.accel.y[3] += 1.0
    assert found_before(one, "rest", one.sums, find) is not first


def test_none_is_an_answer_as_well() -> None:
    one, find = recorded(), Counted(lambda: None)
    assert [found_before(one, "break", 0, find) for _ in range(3)] == [None] * 3
    assert find.times == 1


def test_an_error_is_raised_each_time_and_not_kept() -> None:
    def fail() -> object:
        raise ValueError("no rest")

    one = recorded()
    for _ in range(2):
        with pytest.raises(ValueError, match="no rest"):
            found_before(one, "rest", 1.0, fail)
    find = Counted()
    found_before(one, "rest", 1.0, find)
    assert find.times == 1


def test_a_recording_that_is_freed_frees_what_was_found_of_it() -> None:
    class Answer:
        pass

    one = recorded()
    kept, number = weakref.ref(found_before(one, "rest", 0, Answer)), id(one)
    gc.collect()
    assert kept() is not None
    assert number in module._kept
    del one
    gc.collect()
    assert kept() is None
    assert number not in module._kept


def test_an_answer_that_refers_to_its_recording_is_never_freed() -> None:
    # The twin of the test above: why no answer may.
    one = recorded()
    alive = weakref.ref(one)
    found_before(one, "itself", 0, lambda: [alive()])
    number = id(one)
    del one
    gc.collect()
    assert alive() is not None
    module._kept[number].clear()
    gc.collect()
    assert alive() is None


def test_threads_that_ask_at_once_have_the_answer_to_their_own_question() -> None:
    one = recorded()

    def ask(number: int) -> bool:
        return found_before(one, "size", number % 3, lambda: number % 3) == number % 3

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(ask, range(3000)))
