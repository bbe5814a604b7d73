"""Processes that do the long work of a workbench, ended at once when it is cancelled, and threads that wait for them.

A worker takes a task, tells its progress and gives a result; it ends when its parent does.
"""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import copyreg
import logging
import os
import pickle
import queue
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from types import MappingProxyType
from typing import Any, BinaryIO, Protocol, TypeVar, cast

from accelcal._support import errors
from accelcal._support.errors import AccelcalError
from accelcal._support.process import OWN_GROUP, end, send
from accelcal.app.state import SessionEffects

SHARE_OF_MEMORY = 0.75
"""Part of the machine's memory that the work may take."""
PATIENCE = 5
"""By how much this process is nicer than the server: whoever looks at a page should not wait for another's fit."""
EXPENDABLE = "600"
"""Where memory is short, the system ends this process rather than the one with everybody's work (0 to 1000)."""


def _view(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


copyreg.pickle(MappingProxyType, lambda view: (_view, (dict(view),)))  # tables that nobody may change are sent, too


@dataclass(frozen=True, slots=True)
class Request:
    """One piece of work."""

    task: Callable[..., Any]
    """A function of `tasks.py`; it takes a keyword `report`."""
    args: tuple[Any, ...]
    effects: SessionEffects


@dataclass(frozen=True, slots=True)
class Answer:
    """What a worker sends: progress while it works, then a result or an error."""

    share: float = 1.0
    final: bool = False
    result: Any = None
    error: BaseException | None = None
    trace: str = ""
    """Where the error was raised, for the log."""


def main() -> None:
    """Work until the parent closes the pipe."""
    taking, giving = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not stand between the answers
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    _limit()
    requests: SimpleQueue[Request] = SimpleQueue()
    Thread(target=_listen, args=(taking, requests), daemon=True).start()
    with suppress(BrokenPipeError, KeyboardInterrupt):
        while True:
            _answer(requests.get(), giving)


def _listen(taking: BinaryIO, requests: SimpleQueue[Request]) -> None:
    """Pass requests on; end the process in the midst of its work where the parent has gone."""
    try:
        while True:
            requests.put(pickle.load(taking))
    finally:
        os._exit(0)


def _answer(request: Request, giving: BinaryIO) -> None:
    """Do one piece of work and send what came of it."""

    def report(share: float) -> None:
        pickle.dump(Answer(share), giving)
        giving.flush()

    try:
        with request.effects.catalogue():
            answer = Answer(final=True, result=request.task(*request.args, progress=report))
    except Exception as error:
        answer = Answer(final=True, error=_portable(error), trace=traceback.format_exc())
    try:
        content = pickle.dumps(answer, pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        content = pickle.dumps(Answer(final=True, error=_portable(error), trace=traceback.format_exc()))
    giving.write(content)
    giving.flush()


def _portable(error: Exception) -> Exception:
    """The error, or, where it cannot be sent, one that tells what it was."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _limit() -> None:
    """Bound the memory of this process, and let the server that answers pages go first, where the system can."""
    with suppress(ImportError, AttributeError, OSError, ValueError):
        import resource

        most = int(SHARE_OF_MEMORY * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    with suppress(AttributeError, OSError):
        os.nice(PATIENCE)
    with suppress(OSError), open("/proc/self/oom_score_adj", "w", encoding="ascii") as file:
        file.write(EXPENDABLE)


Result = TypeVar("Result")
_ACTIONS = ThreadPoolExecutor(64, "action")
"""They wait, mostly, and each of a session's pages may have one that does."""
_DRAWING = ThreadPoolExecutor(2, "drawing")
"""They hold the interpreter, so that many of them would keep it from answering pages."""


async def act(action: Callable[..., Result], *args: object) -> Result:
    """Run an action, which may wait for long."""
    return await asyncio.get_running_loop().run_in_executor(_ACTIONS, action, *args)


async def draw(make: Callable[[], Result]) -> Result:
    """Make figures, with the catalogue of effects that the caller has."""
    return await asyncio.get_running_loop().run_in_executor(_DRAWING, contextvars.copy_context().run, make)


MOST = 4
"""Workers at a time, at most; not more than processors."""
POLL = 0.1
"""Interval at which a waiting action looks whether it was cancelled, s."""
ENDED = 5.0
"""Time that a killed process has to vanish, s."""
Report = Callable[[float], None]


class WorkerLost(AccelcalError, ChildProcessError):
    """The process that did the work has ended before it. The text says why and what to do."""


class Compute(Protocol):
    """How a workbench has long work done: in another process, or here."""

    def __call__(self, task: Callable[..., Result], *args: Any, progress: Report, memory: SessionEffects) -> Result:
        """Return ``task(*args, progress=progress)``."""


def direct(task: Callable[..., Result], *args: Any, progress: Report, memory: SessionEffects) -> Result:
    """Do the work here."""
    with memory.catalogue():
        return task(*args, progress=progress)


class Workers:
    """Processes that are started when they are needed, and used again.

    Parameters
    ----------
    folder : where they run; nothing is imported from it that others may have written.
    most : number of processes.
    """

    def __init__(self, folder: Path, most: int | None = None) -> None:
        self.folder = folder
        self.most = min(MOST, os.cpu_count() or 1) if most is None else most
        self._idle: list[_Worker] = []
        self._all: list[_Worker] = []
        self._changed = threading.Condition()
        self._closed = False

    def __call__(self, task: Callable[..., Result], *args: Any, progress: Report, memory: SessionEffects) -> Result:
        """Have a task done by a free worker.

        Parameters
        ----------
        task : a function of a module; its arguments and its result can be pickled.
        progress : called with the progress, and at least every tenth of a second; the work is ended when it raises.
        memory : what the task must find in the catalogue.

        Raises
        ------
        WorkerLost
            If the process ends before its work does, or the work takes more memory than it may.
        """
        worker = self._take(progress)
        try:
            answer = worker.done(Request(task, args, memory), progress)
        except BaseException:
            worker.kill()
            self._release(worker, self._all.remove)
            raise
        self._release(worker, self._idle.append)
        if isinstance(answer.error, MemoryError):
            raise WorkerLost("this takes more memory than there is; use a shorter recording, or the command line")
        if answer.error is not None:
            logging.getLogger(__name__).debug("%s", answer.trace)
            raise answer.error from errors.RemoteTraceback(answer.trace)
        return cast("Result", answer.result)

    def start_one(self) -> None:
        """Start the first worker, so that the first user does not wait for its imports."""
        with self._changed:
            if not self._all and not self._closed:
                self._idle.append(self._started())

    def close(self) -> None:
        """End every worker and whatever it started."""
        with self._changed:
            self._closed = True
            ending, self._all, self._idle = self._all, [], []
            self._changed.notify_all()
        for worker in ending:
            worker.kill()

    def pids(self) -> list[int]:
        """Process numbers of the workers."""
        with self._changed:
            return [worker.process.pid for worker in self._all]

    def _take(self, progress: Report) -> _Worker:
        while True:
            with self._changed:
                if self._closed:
                    raise WorkerLost("the workbench is being ended")
                while self._idle:
                    worker = self._idle.pop()
                    if worker.process.poll() is None:
                        return worker
                    self._all.remove(worker)
                if len(self._all) < self.most:
                    return self._started()
                self._changed.wait(POLL)
            progress(0.0)

    def _started(self) -> _Worker:
        worker = _Worker(self.folder)
        self._all.append(worker)
        return worker

    def _release(self, worker: _Worker, settle: Callable[[_Worker], None]) -> None:
        """Settle what becomes of a worker whose work has ended, unless all have been ended."""
        with self._changed:
            if worker in self._all:
                settle(worker)
            self._changed.notify()


class _Worker:
    """One process, in a process group of its own, so that Ctrl-C in the terminal does not reach it.

    Not in a session of its own: Linux shares the processor between sessions first, and patience counts within one only.
    """

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", "from accelcal.app.workers import main; main()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder)},
            **OWN_GROUP,
        )
        self._answers: queue.SimpleQueue[Answer | None] = queue.SimpleQueue()
        threading.Thread(target=self._listen, daemon=True).start()

    def done(self, request: Request, progress: Report) -> Answer:
        """The last answer to a request."""
        try:
            send(self.process, pickle.dumps(request, pickle.HIGHEST_PROTOCOL))
        except BrokenPipeError:
            raise self._lost() from None
        share = 0.0
        while True:
            try:
                answer = self._answers.get(timeout=POLL)
            except queue.Empty:
                progress(share)
                continue
            if answer is None:
                raise self._lost()
            if answer.final:
                return answer
            share = answer.share
            progress(share)

    def kill(self) -> None:
        """End the process and whatever it started, at once."""
        end(self.process, os.getpid(), group=True, patience=ENDED)

    def _listen(self) -> None:
        assert self.process.stdout is not None
        try:
            while True:
                self._answers.put(pickle.load(self.process.stdout))
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            self._answers.put(None)

    def _lost(self) -> WorkerLost:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(ENDED)
        status = self.process.returncode
        how = f"signal {-status}" if status is not None and status < 0 else f"status {status}"
        return WorkerLost(
            f"the process that did this work has ended before it ({how}), perhaps because memory ran out or the file "
            "is damaged; nothing was changed. Try again, or with a shorter recording"
        )
