"""Processes that work for this one and end with it, however it ends; how far long work is.

A command that runs code of the user's own does so in a child process: that code may never return. It may hold the
interpreter, or catch whatever a signal raises in it; the parent ends it all the same, and says so.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from accelcal._support import stopping

if TYPE_CHECKING:  # a command starts without them
    import subprocess
    from concurrent.futures import ProcessPoolExecutor

Given = ParamSpec("Given")
Found = TypeVar("Found")

GRACE = 2.0
"""Time that the child has to clean up and to end by itself, s; a second signal ends it at once."""
POLL = 0.02
"""Interval at which its end is looked for meanwhile, s."""
_END_WITH_PARENT = 1
"""Of Linux: PR_SET_PDEATHSIG."""
OWN_GROUP: dict[str, Any] = {"process_group": 0} if os.name == "posix" else {"creationflags": 0x200}
"""Of `Popen`: Ctrl-C in the terminal is for this process, which ends that one in order."""


def continue_in_child() -> None:
    """Let a child of this process go on from here; this one waits, and ends as the child does.

    Nothing happens where signals are left alone (not the command line), or processes cannot be split.

    Raises
    ------
    HasEnded
        In the parent, when the child has ended.
    """
    signals = stopping.running
    if signals is None or signals.in_child or not hasattr(os, "fork"):
        return
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    watched, held = os.pipe()
    with _held_back(*stopping.SIGNALS) as let_come:
        child = os.fork()
        if child == 0:
            os.close(held)
            signals.in_child = True
            with suppress(ImportError, OSError, AttributeError):  # a thread waits for what the user's code may hold
                import ctypes

                ctypes.CDLL(None).prctl(_END_WITH_PARENT, signal.SIGKILL)
            _end_after(lambda: os.read(watched, 1))
            return
        os.close(watched)
        raise stopping.HasEnded(_code_of(child, let_come))


def give_back_memory() -> None:
    """Give freed memory back to the system, where the C library does so when asked: what a long record used at its peak
    would stay with the process."""
    with suppress(ImportError, AttributeError, OSError, TypeError):
        import ctypes

        ctypes.CDLL(None).malloc_trim(0)


@contextmanager
def _held_back(*names: str) -> Iterator[Callable[[], object]]:
    """Let signals wait, which a process that starts meanwhile inherits; yields what lets them come before the end."""
    if not hasattr(signal, "pthread_sigmask"):
        yield lambda: None
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {getattr(signal, name) for name in names})
    try:
        yield lambda: signal.pthread_sigmask(signal.SIG_SETMASK, before)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_after(wait: Callable[[], object]) -> None:
    """End this process as soon as `wait` returns, in the midst of whatever it does: its parent has ended."""

    def end() -> None:
        wait()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def _code_of(child: int, let_come: Callable[[], object]) -> int:
    """Exit code of the child; a signal is passed on to it, and it is ended where it does not obey.

    Signals wait until `let_come` is called, so that none of them comes where it would not be passed on.

    Raises
    ------
    Stopped
        If the child did not end by itself, so that nothing has been said.
    """
    try:
        let_come()
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    except stopping.Stopped as stopped:
        code = _ended(child, stopped.number)
        if code < 0:
            raise
    if code >= 0:
        return code
    name = signal.Signals(-code).name
    print(
        f"accelcal: ended by the signal {name} while effects of your own were in use; run it without them, or look for "
        "compiled code and large arrays in them",
        file=sys.stderr,
    )
    return 128 - code


def _ended(child: int, number: int) -> int:
    """Exit code of a child that a signal was passed on to; negative if it was ended by one."""
    again: list[float] = []
    began = time.monotonic()
    for name in stopping.SIGNALS:
        signal.signal(getattr(signal, name), lambda number, frame: again.append(time.monotonic()))
    with suppress(ProcessLookupError):
        os.kill(child, number)
    while True:
        try:
            ended, status = os.waitpid(child, os.WNOHANG)
        except ChildProcessError:  # the signal came when its end had just been seen; what it was is lost
            return -number
        if ended:
            return os.waitstatus_to_exitcode(status)
        if max(again, default=began) > began + stopping.AGAIN or time.monotonic() > began + GRACE:
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        time.sleep(POLL)


@contextmanager
def processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """Start worker processes; an exception, such as that of a signal, ends them without waiting for what they do.

    A Ctrl-C, which a terminal sends to all processes of a command, is left to the process that started them.

    Parameters
    ----------
    count : number of processes.
    """
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    pool = ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_follow_parent)
    with _held_back("SIGINT"):
        for _ in range(count):
            pool.submit(int)  # each starts a process
    with _cancelled_are_silent():
        try:
            yield pool
        except BaseException:
            workers = list((pool._processes or {}).values())
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.terminate()
            raise
        finally:
            pool.shutdown()


@contextmanager
def _cancelled_are_silent() -> Iterator[None]:
    """Let the thread of a pool whose worker has ended fail at a cancelled future without a word, as in Python 3.11."""
    from concurrent.futures import InvalidStateError

    before = threading.excepthook

    def hook(thrown: threading.ExceptHookArgs) -> None:
        if not issubclass(thrown.exc_type, InvalidStateError):
            before(thrown)

    threading.excepthook = hook
    try:
        yield
    finally:
        threading.excepthook = before


def _follow_parent() -> None:
    """In a worker: ignore Ctrl-C, which is for the parent, and end when the parent has ended."""
    from multiprocessing import parent_process

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        _end_after(parent.join)


def send(process: subprocess.Popen[bytes], content: bytes) -> None:
    """Write to the standard input of a process."""
    assert process.stdin is not None
    process.stdin.write(content)
    process.stdin.flush()


def end(process: subprocess.Popen[bytes], owner: int, *, group: bool = False, patience: float | None = None) -> None:
    """End a process at once, and close the pipes to it.

    Parameters
    ----------
    owner : process number of who started it; a fork of that one leaves it alone.
    group : whether whatever it started ends with it, where the system can.
    patience : time that it has to vanish, s; None waits for it.
    """
    from subprocess import TimeoutExpired

    if os.getpid() != owner:
        return
    with suppress(OSError):
        if group and hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):
            if pipe is not None:
                pipe.close()
    with suppress(TimeoutExpired):
        process.wait(patience) if patience else process.wait()


_ONE_THREAD = threading.Lock()
"""Of the call that has set the limit and lifts it again."""


def one_thread(function: Callable[Given, Found]) -> Callable[Given, Found]:
    """A function during which linear algebra runs in one thread; afterwards in as many as before.

    The limit is one for the whole process: of calls that overlap, one inside another or in several threads, the first
    sets it and lifts it.
    """

    @wraps(function)
    def limited(*args: Given.args, **options: Given.kwargs) -> Found:
        if not _ONE_THREAD.acquire(blocking=False):
            return function(*args, **options)
        try:
            from threadpoolctl import threadpool_limits  # a command starts without it

            with threadpool_limits(1, "blas"):
                return function(*args, **options)
        finally:
            _ONE_THREAD.release()

    return limited


LEAST_SHARE, LEAST_TIME = 0.02, 1.0
"""From which on the time that is left is estimated; s."""


def within(progress: Callable[[float], None], low: float, high: float) -> Callable[[float], None]:
    """Report progress of one part of the work as progress of the whole."""
    return lambda share: progress(low + share * (high - low))


def parts_of(
    progress: Callable[[float], None], count: int, low: float = 0.0, high: float = 1.0
) -> list[Callable[[float], None]]:
    """Report progress of equal parts of the work between two shares, in their order, as progress of the whole."""
    ends = [low + (high - low) * number / max(count, 1) for number in range(count + 1)]
    return [within(progress, *pair) for pair in pairwise(ends)]


def time_left(elapsed: float, share: float) -> str:
    """What is left of work of which a share was done in some time, s; before that is known, how long it has taken.

    Examples
    --------
    >>> time_left(3.2, 0.0), time_left(4.0, 0.4), time_left(60.0, 0.1), time_left(60.0, 1.0)
    ('3 s so far', 'about 6 s left', 'about 9 min left', 'about 1 s left')
    """
    if share < LEAST_SHARE or elapsed < LEAST_TIME:
        return f"{elapsed:.0f} s so far"
    left = max(1.0, elapsed * (1.0 - share) / share)
    if left < 10.0:
        return f"about {left:.0f} s left"
    return f"about {5.0 * round(left / 5.0):.0f} s left" if left < 90.0 else f"about {left / 60.0:.0f} min left"
