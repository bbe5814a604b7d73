"""Arrays that other threads change while a filter reads them, and one filter in the hands of several threads.

A slice over the memory of an array is read while the interpreter is released, so another thread may write to it
meanwhile. That gives numbers that nobody asked for, but never a crash; a filter that is at work in one thread refuses
the others in a sentence. Each case runs in a process of its own, which must end by itself.
"""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from .case import LONG

WRITTEN, SHARED = (1_000, 36_000) if LONG else (60, 3_000)
"""Calls on arrays that change; calls of one filter."""

HEAD = """
import json, sys, threading
import numpy as np
from accelcal import filters
from tests.hostile.case import case_rng
from tests.twin.workloads import DT, WORKLOADS, record, settings

calls = int(sys.argv[1])
counted = {"answered": 0, "refused": 0, "busy": 0}
lock = threading.Lock()

def attempt(act):
    try:
        act()
        kind = "answered"
    except ValueError:
        kind = "refused"
    except RuntimeError as error:
        if "Already borrowed" not in str(error) and "Already mutably borrowed" not in str(error):
            raise
        kind = "busy"
    with lock:
        counted[kind] += 1

def in_threads(acts):
    threads = [threading.Thread(target=act) for act in acts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
"""
CHANGED = """
u, z = record(4000)
done = threading.Event()
seen = [0]

def write(number):
    rng = case_rng("arrays that change", number)
    broken = [np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324]
    while not done.is_set():
        array = (u, z)[int(rng.integers(2))]
        at = int(rng.integers(len(array)))
        if rng.random() < 0.01:
            array[at : at + 64] = broken[int(rng.integers(len(broken)))]
        array[at : at + 64] = rng.standard_normal()
        seen[0] += 1

def read():
    for number in range(calls):
        name = sorted(WORKLOADS)[number % 4]
        choice = WORKLOADS[name]
        given = settings(choice)
        made = filters.fixed_rate(choice, dt=DT, **given)
        n = len(choice.states())
        if number % 3:
            attempt(lambda: made.run(u, z, states=np.empty((len(u), n)), variances=np.empty((len(u), n))))
        else:
            attempt(lambda: filters.run_batch(choice, u.reshape(8, -1), z.reshape(8, -1), dt=DT, threads=2, **given))
    done.set()

try:
    in_threads([read, lambda: write(0), lambda: write(1)])
finally:
    done.set()
print(json.dumps(counted | {"changes": seen[0]}))
"""
ONE_FILTER = """
from accelcal.filters.stream import LiveFilter
u, z = record(256)
given = settings(WORKLOADS["W2"])
live = LiveFilter(WORKLOADS["W2"], **given)
filter = filters.fixed_rate(WORKLOADS["W2"], dt=DT, **given)
finite = np.nan_to_num(z)

def use(number):
    rng = case_rng("one filter", number)
    out = np.empty((len(u), 6))
    for call in range(calls // 3):
        what = int(rng.integers(6))
        at = int(rng.integers(len(u)))
        attempt([
            lambda: filter.run(u, z, states=out),
            lambda: filter.step(u[at], finite[at]),
            lambda: filter.covariance.sum(),
            lambda: live.step(1e-3 * call, accel=u[at], position=finite[at]),
            lambda: live.covariance.sum(),
            live.finish,
        ][what])

in_threads([lambda n=n: use(n) for n in range(3)])
assert filter.covariance.shape == (6, 6)
print(json.dumps(counted))
"""


def tally(code: str, calls: int) -> dict[str, int]:
    """Run a case in a process of its own, with frequent changes of thread; what became of its calls."""
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\nsys.setswitchinterval(1e-5)\n{HEAD}{code}", str(calls)],
        capture_output=True,
        text=True,
        timeout=3000,
        check=False,
    )
    assert done.returncode == 0, f"ended with {done.returncode}: {done.stderr[-2000:]}"
    assert "Traceback" not in done.stderr, done.stderr
    answer: dict[str, int] = json.loads(done.stdout)
    print(f"{calls} calls, {answer}: 0 crashes (none allowed)")
    return answer


def test_arrays_that_change_while_a_filter_reads_them_crash_nothing() -> None:
    result = tally(CHANGED, WRITTEN)
    assert result["answered"] + result["refused"] == WRITTEN
    assert result["changes"] > WRITTEN  # the writers did run meanwhile
    assert result["refused"] > 0  # and what they wrote was read


def test_one_filter_in_three_threads_answers_or_is_busy() -> None:
    result = tally(ONE_FILTER, SHARED)
    assert sum(result.values()) == SHARED
    assert result["answered"] > 0
    assert result["busy"] > 0


def test_a_thread_that_dies_is_seen() -> None:
    with pytest.raises(AssertionError, match="Traceback"):
        tally("in_threads([lambda: attempt(lambda: [][0])])\nprint(json.dumps(counted))", 1)
    with pytest.raises(AssertionError, match="ended with -6"):
        tally("import os; os.abort()", 1)
