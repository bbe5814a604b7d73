"""The process that does the long work of a workbench: it takes a task from its parent, tells progress, gives a result.

Started by `workers.py`; it ends when its parent does.
"""

from __future__ import annotations

import copyreg
import os
import pickle
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Thread
from types import MappingProxyType
from typing import Any, BinaryIO

from accelcal.app.known import Known

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
    known: Known


@dataclass(frozen=True, slots=True)
class Answer:
    """What a worker sends: progress while it works, then a result or an error."""

    share: float = 1.0
    final: bool = False
    found: Any = None
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
        with request.known.catalogue():
            answer = Answer(final=True, found=request.task(*request.args, progress=report))
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
    with suppress(ImportError, OSError, ValueError):
        import resource

        most = int(SHARE_OF_MEMORY * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    with suppress(AttributeError, OSError):
        os.nice(PATIENCE)
    with suppress(OSError), open("/proc/self/oom_score_adj", "w") as file:
        file.write(EXPENDABLE)
