"""A command that runs code of the user's own does so in a child process: that code may never return.

It may hold the interpreter, or catch whatever a signal raises in it; the parent ends it all the same, and says so.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from accelcal._support import stopping

GRACE = 2.0
"""Time that the child has to clean up and to end by itself, s; a second signal ends it at once."""
POLL = 0.02
"""Interval at which its end is looked for meanwhile, s."""
_END_WITH_PARENT = 1
"""Of Linux: PR_SET_PDEATHSIG."""


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
    with _held_back() as let_come:
        child = os.fork()
        if child == 0:
            os.close(held)
            signals.in_child = True
            _follow(watched)
            return
        os.close(watched)
        raise stopping.HasEnded(_code_of(child, let_come))


@contextmanager
def _held_back() -> Iterator[Callable[[], object]]:
    """Let signals wait that ask the command to end; yields what lets them come before the block ends."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {getattr(signal, name) for name in stopping.SIGNALS})
    try:
        yield lambda: signal.pthread_sigmask(signal.SIG_SETMASK, before)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _follow(watched: int) -> None:
    """End this process as soon as nobody holds the other end of a pipe any more, the parent having been killed.

    Where the system can, it does so itself: a thread waits for the interpreter, which the user's code may hold.
    """
    from threading import Thread

    with suppress(ImportError, OSError, AttributeError):
        import ctypes

        ctypes.CDLL(None).prctl(_END_WITH_PARENT, signal.SIGKILL)

    def end() -> None:
        os.read(watched, 1)
        os._exit(1)

    Thread(target=end, daemon=True).start()


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
            found, status = os.waitpid(child, os.WNOHANG)
        except ChildProcessError:  # the signal came when its end had just been seen; what it was is lost
            return -number
        if found:
            return os.waitstatus_to_exitcode(status)
        if max(again, default=began) > began + stopping.AGAIN or time.monotonic() > began + GRACE:
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        time.sleep(POLL)
