"""How a command ends: by itself, by a signal, or because nobody reads its output; always with its exit code.

A signal becomes an exception, so that every block cleans up behind itself. Imported before anything else, since a
signal may arrive while the rest is being imported; it imports nothing but what Python itself has.
"""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TextIO

SIGNALS = {
    name: words
    for name, words in {
        "SIGINT": "interrupted; no file was left half-written",
        "SIGTERM": "terminated; no file was left half-written",
        "SIGHUP": "the terminal was closed; no file was left half-written",
        "SIGPIPE": "",
    }.items()
    if hasattr(signal, name)
}
"""Signals that end a command, with what is said; the exit code is 128 and the number of the signal."""
AGAIN = 1.0
"""A second signal within this time, s, is the first one once more: shells and `timeout` send it to a whole group."""
UNWRITABLE = 3
"""Exit code where the standard output takes nothing."""


class Stopped(SystemExit):
    """A signal asks the command to end; event loops and thread pools let the class pass."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.number = number


class HasEnded(SystemExit):
    """The command has ended in another process, which has said what there was to say."""


class _Pipe(io.FileIO):
    """A standard stream; that nobody reads it any more is the end of the command."""

    def write(self, content: io.ReadableBuffer) -> int:  # type: ignore[name-defined]
        try:
            return super().write(content)
        except BrokenPipeError:
            _silence(self.fileno())
            raise Stopped(signal.SIGPIPE) from None


class _Signals:
    """Signals of this process while a command runs."""

    def __init__(self) -> None:
        self.first: Stopped | None = None
        """The signal that asked the command to end."""
        self._when = 0.0
        self._dropping = False
        """Whether what is raised now would be dropped."""
        self.in_child = False
        """Whether this process is a child that does the work of the command."""

    def catch(self) -> None:
        """Turn signals into exceptions; one that whoever started the command ignores stays ignored."""
        for number in _obeyed():
            signal.signal(number, self._stop)
        sys.unraisablehook = self._again

    def _again(self, lost: sys.UnraisableHookArgs) -> None:
        """A signal that came in a finaliser or a callback of a weak reference, where Python drops what is raised, comes
        again until it is obeyed: one that comes just before a call that waits, such as a sleep, does not end it."""
        if isinstance(lost.exc_value, Stopped):
            self.first, self._dropping = None, True
            to_main = getattr(signal, "pthread_kill", None)  # wakes it, where there is such a call
            arguments = (threading.main_thread().ident, lost.exc_value.number) if to_main else (lost.exc_value.number,)

            def insist() -> None:
                while self.first is None:
                    time.sleep(0.01)
                    (to_main or signal.raise_signal)(*arguments)

            threading.Thread(target=insist, daemon=True).start()
            self._dropping = False
        else:
            sys.__unraisablehook__(lost)

    def release(self) -> None:
        """Let signals end the process at once: the command has ended, Python still takes itself apart."""
        for name in SIGNALS:
            if signal.getsignal(getattr(signal, name)) == self._stop:
                signal.signal(getattr(signal, name), signal.SIG_DFL)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if self._dropping:
            return
        if self.first is None:
            self.first, self._when = Stopped(number), now
            raise self.first
        if now - self._when > AGAIN:  # cleaning up lasts too long
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)


def _obeyed() -> list[int]:
    """Numbers of the signals that end a command, without those that whoever started it ignores."""
    numbers = [getattr(signal, name) for name in SIGNALS if name != "SIGPIPE"]
    return [number for number in numbers if signal.getsignal(number) not in (signal.SIG_IGN, None)]


running: _Signals | None = None
"""Signals of the command that is running here; None where a program uses the package."""


@contextmanager
def deferred() -> Iterator[Callable[[], bool]]:
    """In this block a signal waits: the function given tells whether one has come, and the end of the block obeys it.

    A second one, `AGAIN` later or more, is obeyed at once. Outside the main thread, where signals do not arrive, there
    is never one.
    """
    came: list[tuple[int, float]] = []
    before: dict[int, signal._HANDLER] = {}

    def wait(number: int, frame: FrameType | None) -> None:
        if came and time.monotonic() - came[0][1] > AGAIN:
            restore()
            signal.raise_signal(number)
        elif not came:
            came.append((number, time.monotonic()))

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)
        before.clear()

    if threading.current_thread() is threading.main_thread():
        for number in _obeyed():
            before[number] = signal.signal(number, wait)
    try:
        yield lambda: bool(came)
    finally:
        restore()
    if came:
        signal.raise_signal(came[0][0])


def asked_to_end() -> bool:
    """Whether a signal has asked the command that runs here to end: what fails from then on is no error of its own."""
    return running is not None and running.first is not None


def run(command: Callable[[], None]) -> int:
    """Run a command to its end, of whatever kind; return its exit code.

    Only signals and broken pipes end here: the command itself turns exceptions into sentences and `SystemExit`.
    """
    global running
    signals = running = _Signals()
    code = 0
    try:
        signals.catch()
        _watch_streams()
        code = _code_of(command)
    except HasEnded as ended:
        return int(str(ended.code))
    except BaseException as error:  # whatever a library made of the signal that it was interrupted by
        stopped = error if isinstance(error, Stopped) else signals.first
        if stopped is None and not isinstance(error, KeyboardInterrupt | BrokenPipeError):
            raise
        number = stopped.number if stopped else signal.SIGINT if isinstance(error, KeyboardInterrupt) else SIGPIPE
        return _report_end(number)
    finally:
        running = None
        signals.release()
    return _report_end(signals.first.number) if signals.first is not None else code


def _code_of(command: Callable[[], None]) -> int:
    """Exit code of a command whose output was written to the end."""
    try:
        command()
        code: object = 0
    except (Stopped, HasEnded):
        raise
    except SystemExit as error:
        code = error.code
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:
        _silence(1)
        print(f"accelcal: the standard output cannot be written ({error.strerror})", file=sys.stderr)
        return UNWRITABLE
    if isinstance(code, str):
        print(code, file=sys.stderr)
        return 1
    return code if isinstance(code, int) else 0


SIGPIPE: int = getattr(signal, "SIGPIPE", 13)


def _report_end(number: int) -> int:
    """Say why the command ends, to whoever still reads; return the exit code."""
    words = next((word for name, word in SIGNALS.items() if getattr(signal, name) == number), "")
    try:
        if words and sys.stderr is not None:
            print(f"accelcal: {words}", file=sys.stderr)
    except (OSError, Stopped):
        pass
    for stream in (1, 2):
        _flush(stream)
    return 128 + number


def _flush(number: int) -> None:
    """Write what waits in a standard stream, or forget it."""
    stream = (None, sys.stdout, sys.stderr)[number]
    try:
        if stream is not None:
            stream.flush()
    except (OSError, ValueError, Stopped):
        _silence(number)


def _silence(number: int) -> None:
    """Let what is still written to a stream vanish, such as its last lines when Python ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, number)
    os.close(nowhere)


def _watch_streams() -> None:
    """Notice a broken pipe where it happens, before a library makes something else of it.

    A character that the encoding of a stream does not have, such as ², is written as its number.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if not hasattr(signal, "SIGPIPE"):
        return
    if sys.stdout is not None:
        sys.stdout = _watched(sys.stdout, 1)
    if sys.stderr is not None:
        sys.stderr = _watched(sys.stderr, 2)


def _watched(stream: TextIO, number: int) -> TextIO:
    """The same stream, that raises `Stopped` on a broken pipe."""
    stream.flush()
    raw = _Pipe(number, "wb", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=bool(getattr(stream, "line_buffering", False)),
        write_through=bool(getattr(stream, "write_through", False)),
    )
