"""The process that opens containers: limits for itself, then names and lengths, then the columns that are asked for.

A library of a binary format may crash, take all memory or never end on a damaged file. Here that ends this process and
no other. It imports nothing but the reader of one format, answers in JSON and raw numbers, and never runs what a file
says.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import select
import signal
from collections.abc import Callable, Mapping
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


def main(requests: IO[bytes], replies: IO[bytes]) -> None:
    """Serve one file: the first request names it, the second its columns."""
    asked = json.loads(requests.readline())
    try:
        source = _opened(asked["kind"], asked["file"])
        entries = [[entry.name, entry.length, entry.unit, entry.clock] for entry in source.entries]
        _reply(replies, {"entries": entries})
        if not _waits(requests):
            return
        for name in json.loads(requests.readline() or b"[]"):
            _send(replies, source, name)
    except BrokenPipeError:  # nobody listens any more
        return
    except BaseException as error:
        _reply(replies, _fault(error))


def _opened(kind: str, path: str) -> Source:
    chosen = BY_NAME[kind]
    if importlib.util.find_spec(chosen.library) is None:
        raise ModuleNotFoundError(chosen.library, name=chosen.library)
    opened: Callable[[str], Source] = importlib.import_module(f"accelcal.io.decoding.{chosen.reader}").opened
    limit(os.stat(path).st_size)  # for the file, not for its library
    return opened(path)


def limit(size: int) -> None:
    """Limit memory and processor time of this process for a file of `size` bytes, where the system can."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asked
    try:
        import resource
    except ImportError:  # not a POSIX system: the time that the other side waits is the only limit
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = int(used.ru_utime + used.ru_stime + SECONDS + size / 10_000_000) + 1
    limits = {resource.RLIMIT_AS: _address_space() + MEMORY + 4 * size, resource.RLIMIT_CPU: seconds}
    for which, most in {**limits, resource.RLIMIT_CORE: 0}.items():
        hard = resource.getrlimit(which)[1]
        resource.setrlimit(which, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _address_space() -> int:
    """Bytes of address space that are in use; a guess where the system does not say."""
    statm = Path("/proc/self/statm")
    if not statm.exists():
        return 4_000_000_000
    return int(statm.read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")


def _waits(requests: IO[bytes]) -> bool:
    """Whether a second request comes in time; a system that cannot tell waits for it."""
    return os.name != "posix" or bool(select.select([requests], [], [], IDLE)[0])


def _send(replies: IO[bytes], source: Source, name: str) -> None:
    """Write the numbers of one column as they lie in memory, little-endian, and where they are present."""
    try:
        column = source.column(name)
    except RefusedError as error:
        raise RefusedError(f'column "{name}" {error}') from None
    replies.write(json.dumps({"length": len(column.values), "missing": column.present is not None}).encode() + b"\n")
    replies.write(column.values.astype("<f8", copy=False).data)
    if column.present is not None:
        replies.write(column.present.tobytes())
    replies.flush()


def _reply(replies: IO[bytes], content: Mapping[str, Any]) -> None:
    replies.write(json.dumps(content, allow_nan=False).encode() + b"\n")
    replies.flush()


def _fault(error: BaseException) -> dict[str, str]:
    """What went wrong. Flipped bits make a library raise nearly anything, so everything is caught."""
    if isinstance(error, RefusedError):
        return {"fault": "refused", "text": str(error)}
    if isinstance(error, MemoryError):
        return {"fault": "memory", "text": ""}
    if isinstance(error, ModuleNotFoundError):
        return {"fault": "library", "text": str(error.name)}
    reason = str(error).strip().splitlines()
    return {"fault": "damaged", "text": (reason[0] if reason else type(error).__name__)[:200]}
