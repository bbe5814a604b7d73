"""Binary containers as tables, each opened in a process of its own; which there are: `decoding.known_formats`."""

from __future__ import annotations

import os
from pathlib import Path
from threading import Lock

from accelcal.data.recording import RecordingError
from accelcal.io.decoding.known_formats import BY_NAME
from accelcal.io.reader_process import ReaderProcess
from accelcal.io.table import Table


class _Waiting:
    """The process that has opened the last container and was asked for no column yet: a file that is looked at and then
    read, or looked at twice, is opened once."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._kept: tuple[tuple[object, ...], ReaderProcess] | None = None

    def take(self, path: Path, kind: str) -> ReaderProcess:
        """The kept process if it has this file, as it is now, open; else another one."""
        with self._lock:
            kept, self._kept = self._kept, None
        if kept is not None and kept[0] == _identity(path, kind) and kept[1].waits:
            return kept[1]
        return ReaderProcess(path, kind)

    def keep(self, process: ReaderProcess) -> None:
        """Keep a process, in place of the one before."""
        with self._lock:
            self._kept = (_identity(process.path, process.kind), process)


def _identity(path: Path, kind: str) -> tuple[object, ...]:
    """What tells a file from every other and from itself after a change, in one process."""
    found = path.stat()
    return (os.getpid(), kind, str(path), found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns)


_WAITING = _Waiting()


def open_container(path: Path, kind: str) -> Table:
    """Open a container: its names and lengths now, the numbers on request.

    Parameters
    ----------
    kind : name of a format, as "Parquet" (null means not sampled) or "HDF5" (MATLAB 7.3 as well; NaN means not sampled
        in all others). Each numeric vector is a column, named by its path (``run/accel``, ``run.X.Data``).

    Raises
    ------
    RecordingError
        If the file is damaged, larger than is allowed, or holds no numeric vector, or its library is not installed.
    """
    process = _WAITING.take(path, kind)
    entries = process.entries
    _WAITING.keep(process)
    if not entries:
        raise RecordingError(f"{path}: the file holds no vector of numbers; expected one per channel.")

    return Table(
        path,
        tuple(entry.name for entry in entries),
        lambda names: _WAITING.take(path, kind).columns(names),
        lambda i: f"sample {i + 1}",
        {entry.name: entry.unit for entry in entries if entry.unit},
        BY_NAME[kind].units_from,
        {entry.name: entry.clock for entry in entries if entry.clock},
    )
