"""The process that opens containers: limits for itself, then names and lengths, then the columns that are asked for.

A library of a binary format may crash, take all memory or never end on a damaged file. Here that ends this process and
no other. It imports nothing but the reader of one format, answers in JSON and raw numbers, and never runs what a file
says: what evaluates texts is not there, and `confine` refuses what reading never needs.
"""

from __future__ import annotations

import errno
import importlib
import importlib.util
import json
import os
import select
import signal
import sys
import tempfile
import types
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from accelcal.io.decoding.known_formats import BY_NAME
from accelcal.io.decoding.source import RefusedError, Source

MEMORY = 512_000_000
"""Bytes that a process may take beyond its libraries, and four times the size of the file."""
SECONDS = 5.0
"""Processor time for a file, and a second more for each 10 MB of it."""
IDLE = 10.0
"""Time after which a process that is asked nothing ends, s."""
WRITTEN = 64_000_000
"""Bytes of the longest file that a library may write into its scratch folder."""
_NEVER = (
    "_winapi.CreateProcess",
    "ctypes.",
    "os.exec",
    "os.fork",
    "os.kill",
    "os.link",
    "os.posix_spawn",
    "os.spawn",
    "os.startfile",
    "os.symlink",
    "os.system",
    "pickle.find_class",
    "pty.spawn",
    "resource.",
    "socket.",
    "sqlite3.enable_load_extension",
    "sqlite3.load_extension",
    "subprocess.",
)
"""Beginnings of audit events that no reader raises once its library is imported."""
_CHANGES = frozenset(
    f"os.{act}"
    for act in [
        "chflags",
        "chmod",
        "chown",
        "mkdir",
        "remove",
        "removexattr",
        "rename",
        "rmdir",
        "setxattr",
        "truncate",
        "utime",
    ]
)
"""Audit events that change what their paths name."""
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


def main(requests: IO[bytes], replies: IO[bytes]) -> None:
    """Serve one file: the first request names it, the second its columns."""
    asked = json.loads(requests.readline())
    try:
        source = _opened(asked["kind"], asked["file"], asked["scratch"])
        _reply(replies, {"entries": [[entry.name, entry.length, entry.unit, entry.clock] for entry in source.entries]})
        if not _waits(requests):
            return
        for name in json.loads(requests.readline() or b"[]"):
            _send(replies, source, name)
    except BrokenPipeError:  # nobody listens any more
        return
    except BaseException as error:
        _reply(replies, _fault(error))


def _opened(kind: str, path: str, scratch: str | None) -> Source:
    chosen = BY_NAME[kind]
    if importlib.util.find_spec(chosen.library) is None:
        raise ModuleNotFoundError(chosen.library, name=chosen.library)
    _take_evaluators_away()
    opened: Callable[[str], Source] = importlib.import_module(f"accelcal.io.decoding.{chosen.reader}").opened
    limit(os.stat(path).st_size)  # set after the library is loaded, so that it covers the file alone
    confine(scratch)
    return opened(path)


def _take_evaluators_away() -> None:
    """Import nothing that evaluates a text: SymPy is not installed here, and numexpr knows no expression.

    The library of MF4 computes by NumPy where numexpr has a TypeError.
    """

    def evaluate(*_: object, **__: object) -> None:
        raise TypeError("texts are not evaluated")

    blank = types.ModuleType("numexpr")
    vars(blank).update(evaluate=evaluate, __version__="0")
    sys.modules.update({"sympy": None, "numexpr": blank})  # type: ignore[dict-item]


def confine(scratch: str | None) -> None:
    """Refuse this process programs, connections, foreign functions, and writing outside of one folder, for good.

    Parameters
    ----------
    scratch : the folder that a library may write to; None = it may write nowhere.
    """
    tempfile.tempdir, sys.dont_write_bytecode = scratch, True
    folder = scratch and os.path.realpath(scratch)

    def inside(path: Any) -> bool:
        real = os.path.realpath(os.fsdecode(path))
        return folder is not None and (real == folder or real.startswith(folder + os.sep))

    def refuse(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            paths = arguments[:1] if arguments[2] & _WRITING else ()
        else:
            paths = arguments if event in _CHANGES else ()
        outside = [path for path in paths if isinstance(path, str | bytes | os.PathLike) and not inside(path)]
        if outside or event.startswith(_NEVER):
            raise ForbiddenError(
                f"its reader was stopped when it was about to do what no reading needs ({event}); do not use this file "
                "unless you trust who wrote it, and export it again, as CSV or Parquet with one column per channel"
            )

    sys.addaudithook(refuse)


class ForbiddenError(PermissionError):
    """What `confine` refuses; an error of the operating system for the library that is refused it."""


def limit(size: int) -> None:
    """Limit memory and processor time of this process for a file of `size` bytes, where the system can."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asked
    try:
        import resource
    except ImportError:  # not a POSIX system: the time that the other side waits is the only limit
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = int(used.ru_utime + used.ru_stime + SECONDS + size / 10_000_000) + 1
    limits = {
        resource.RLIMIT_AS: _address_space() + MEMORY + 4 * size,
        resource.RLIMIT_CPU: seconds,
        resource.RLIMIT_FSIZE: WRITTEN,
        resource.RLIMIT_NPROC: 0,  # of every user but root
        resource.RLIMIT_CORE: 0,
    }
    for which, most in limits.items():
        hard = resource.getrlimit(which)[1]
        with suppress(ValueError):  # macOS bounds no address space
            resource.setrlimit(which, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _address_space() -> int:
    """Bytes of address space that are in use; a guess where the system does not say."""
    statm = Path("/proc/self/statm")
    if not statm.exists():
        return 4_000_000_000
    return int(statm.read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")


def _waits(requests: IO[bytes]) -> bool:
    """Whether a second request comes in time; a system that cannot tell waits for it."""
    return os.name != "posix" or bool(select.select([requests], [], [], IDLE)[0])


def _send(replies: IO[bytes], source: Source, name: str) -> None:
    """Write the numbers of one column as they lie in memory, little-endian, and where they are present."""
    try:
        column = source.column(name)
    except RefusedError as error:
        raise RefusedError(f'column "{name}" {error}') from None
    heading = {"length": len(column.values), "missing": column.present is not None, "origin": column.origin}
    replies.write(json.dumps(heading).encode() + b"\n")
    replies.write(column.values.astype("<f8", copy=False).data)
    if column.present is not None:
        replies.write(column.present.tobytes())
    replies.flush()


def _reply(replies: IO[bytes], content: Mapping[str, Any]) -> None:
    replies.write(json.dumps(content, allow_nan=False).encode() + b"\n")
    replies.flush()


def _fault(error: BaseException) -> dict[str, str]:
    """What went wrong. Flipped bits make a library raise nearly anything, so everything is caught."""
    if isinstance(error, RefusedError | ForbiddenError):
        return {"fault": "refused", "text": str(error)}
    if isinstance(error, OSError) and error.errno == errno.EFBIG:
        text = f"its library asks for more than {WRITTEN // 1_000_000} MB of temporary files, expected no more"
        return {"fault": "refused", "text": f"{text}; save it again with the program that made it"}
    if isinstance(error, MemoryError):
        return {"fault": "memory", "text": ""}
    if isinstance(error, ModuleNotFoundError):
        return {"fault": "library", "text": str(error.name)}
    reason = str(error).strip().splitlines()
    return {"fault": "damaged", "text": (reason[0] if reason else type(error).__name__)[:200]}
