"""Threads of the work: one for linear algebra, whose products are small."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import current_thread, main_thread
from typing import ParamSpec, TypeVar

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
