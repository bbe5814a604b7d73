"""Threads of the work: one for linear algebra, whose products are small, two for independent pieces."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextvars import copy_context
from functools import wraps
from threading import current_thread, main_thread
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

Given = ParamSpec("Given")
Found = TypeVar("Found")


def one_thread(function: Callable[Given, Found]) -> Callable[Given, Found]:
    """A function during which linear algebra runs in one thread; afterwards in as many as before.

    Called in the main thread alone: the limit is one for the whole process, and threads that overlap would not restore
    the former limit.
    """

    @wraps(function)
    def limited(*args: Given.args, **options: Given.kwargs) -> Found:
        if current_thread() is not main_thread():
            return function(*args, **options)
        with threadpool_limits(1, "blas"):
            return function(*args, **options)

    return limited


MOST_THREADS = 2
"""Beyond two the steps that hold the interpreter wait for each other, and memory grows with each."""
LOOK = 0.1
"""Interval at which progress is told, s."""
Report = Callable[[float], None]
Work = Callable[[Report], Any]
"""Takes what its progress is told to, returns its result."""


def on_two_threads(works: Sequence[Work], progress: Report, *, at_once: bool = True) -> list[Any]:
    """Results of pieces of work, in their order; they are those of one after the other.

    Parameters
    ----------
    works : independent of each other, the longest first.
    progress : told the share of all, from the calling thread alone; what it raises ends the waiting.
    at_once : if False, one after the other: where memory counts.

    Raises
    ------
    Exception
        What a piece of work raises, the first in their order.

    Examples
    --------
    >>> on_two_threads([lambda report: 1, lambda report: 2], print, at_once=False)
    0.5
    1.0
    [1, 2]
    """
    shares = [0.0] * len(works)
    if not at_once or len(works) < 2 or (os.cpu_count() or 1) < MOST_THREADS:
        return [_alone(work, number, len(works), progress) for number, work in enumerate(works)]
    from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait  # not needed at start

    with ThreadPoolExecutor(MOST_THREADS) as pool:
        running = [
            pool.submit(copy_context().run, work, lambda share, number=number: shares.__setitem__(number, share))
            for number, work in enumerate(works)
        ]
        try:
            left = set(running)
            while left:
                _, left = wait(left, LOOK, FIRST_COMPLETED)
                progress(sum(shares) / len(works))
            return [future.result() for future in running]
        finally:
            for job in running:
                job.cancel()


def _alone(work: Work, number: int, count: int, progress: Report) -> Any:
    """One piece of several, in the calling thread."""
    result = work(lambda share: progress((number + share) / count))
    progress((number + 1) / count)
    return result
