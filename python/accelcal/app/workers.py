"""A few processes that do the long work, so that no page waits for another's; ended at once when work is cancelled."""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from accelcal._support import internal_error
from accelcal._support.errors import AccelcalError
from accelcal._support.process import end, send
from accelcal.app.known import Known
from accelcal.app.worker import Answer, Request

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

    def __call__(self, task: Callable[..., Any], *args: Any, progress: Report, known: Known) -> Any:
        """Return ``task(*args, progress=progress)``."""


def direct(task: Callable[..., Any], *args: Any, progress: Report, known: Known) -> Any:
    """Do the work here."""
    with known.catalogue():
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

    def __call__(self, task: Callable[..., Any], *args: Any, progress: Report, known: Known) -> Any:
        """Have a task done by a free worker.

        Parameters
        ----------
        task : a function of a module; its arguments and its result can be pickled.
        progress : called with the progress, and at least every tenth of a second; the work is ended when it raises.
        known : what the task must find in the catalogue.

        Raises
        ------
        WorkerLost
            If the process ends before its work does, or the work takes more memory than it may.
        """
        worker = self._take(progress)
        try:
            answer = worker.done(Request(task, args, known), progress)
        except BaseException:
            worker.kill()
            self._release(worker, self._all.remove)
            raise
        self._release(worker, self._idle.append)
        if isinstance(answer.error, MemoryError):
            raise WorkerLost("this takes more memory than there is; use a shorter recording, or the command line")
        if answer.error is not None:
            logging.getLogger(__name__).debug("%s", answer.trace)
            raise answer.error from internal_error.RemoteTraceback(answer.trace)
        return answer.found

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
            [sys.executable, "-c", "from accelcal.app.worker import main; main()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder)},
            process_group=0,
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
