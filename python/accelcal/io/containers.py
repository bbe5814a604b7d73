"""Binary containers as tables, each opened in a process of its own that `decoding.child` runs.

A fresh interpreter and two pipes: this works from scripts, notebooks, threads and daemons alike, on every system.
Nothing that comes back is executed; it is JSON and numbers, whose count is known before.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import weakref
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from threading import Event, Lock, Timer
from typing import IO, Any

import numpy as np

import accelcal
from accelcal._support.locks import scratch_folder
from accelcal._support.process import end, send
from accelcal.data import RecordingError
from accelcal.io.decoding.child import MEMORY, SECONDS
from accelcal.io.decoding.known_formats import BY_NAME
from accelcal.io.decoding.source import Entry
from accelcal.io.table import FREE_NUMBERS, MOST_SAMPLES, Column, Table

PATIENCE = 20.0
"""Times the allowed processor time that an answer may take: a machine that is busy is waited for."""
_LINE = 64_000_000
"""Bytes of the longest answer that is no number."""
_START = """
import json, sys, types
begin = json.loads(sys.stdin.buffer.readline())
sys.path[:] = begin["path"]
for name, folder in begin["packages"].items():
    sys.modules[name] = package = types.ModuleType(name)
    package.__path__ = [folder]
from accelcal.io.decoding.child import main
main(sys.stdin.buffer, sys.stdout.buffer)
"""
"""The packages are bound by hand, since what they import at their start is not needed here and takes half a second."""


class ReaderProcess:
    """One process with one file open; it ends when it has served its columns, is dropped, or is idle for long."""

    def __init__(self, path: Path, kind: str) -> None:
        self.path = path
        self.kind = kind
        self.size = path.stat().st_size
        self._late = Event()
        left = ExitStack()
        scratch = left.enter_context(scratch_folder()) if BY_NAME[kind].scratch else None
        self._process = start()
        self._close = weakref.finalize(self, _end, self._process, left, os.getpid())
        with self._ended_in_words():
            self._ask({"kind": kind, "file": str(path), "scratch": scratch and str(scratch)})
            self.entries = tuple(
                Entry(str(name), int(length), unit, clock) for name, length, unit, clock in self._answer()["entries"]
            )

    def columns(self, names: Sequence[str]) -> dict[str, Column]:
        """Read columns by name, and end.

        Raises
        ------
        RecordingError
            If they hold more numbers than is allowed, or cannot be read.
        """
        lengths = {entry.name: entry.length for entry in self.entries}
        self._require_room(names, lengths)
        with self._ended_in_words():
            self._ask(list(names))
            columns = {name: self._column(lengths[name]) for name in names}
        self._close()
        return columns

    @property
    def waits(self) -> bool:
        """Whether it can still be asked for columns."""
        return self._process.poll() is None

    def _require_room(self, names: Sequence[str], lengths: dict[str, int]) -> None:
        for name in names:
            if lengths[name] > MOST_SAMPLES:
                raise RecordingError(
                    f'{self.path}: column "{name}" holds {lengths[name]} samples, expected at most {MOST_SAMPLES}; '
                    "cut the recording into parts."
                )
        total, most = sum(lengths[name] for name in names), FREE_NUMBERS + self.size
        if total > most:
            raise RecordingError(
                f"{self.path}: its columns hold {total} numbers in {self.size} bytes, expected at most {most}; export "
                "the recording again, or cut it into parts."
            )

    def _ask(self, content: Any) -> None:
        send(self._process, json.dumps(content, allow_nan=False).encode() + b"\n")

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline(_LINE)
        if not line.endswith(b"\n"):
            raise EOFError
        answer: dict[str, Any] = json.loads(line)
        if "fault" in answer:
            raise RecordingError(f"{self.path}: {self._fault(answer['fault'], str(answer['text']))}")
        return answer

    def _column(self, length: int) -> Column:
        answer = self._answer()
        if answer["length"] != length:
            lengths = f"{answer['length']} numbers where {length} are declared"
            raise RecordingError(f"{self.path}: {self._damage(lengths)}")
        assert self._process.stdout is not None
        values = _filled(self._process.stdout, np.empty(length, dtype="<f8")).astype(np.float64, copy=False)
        origin = None if answer["origin"] is None else int(answer["origin"])
        if not answer["missing"]:
            return Column(values, None, origin)
        present = _filled(self._process.stdout, np.empty(length, dtype=np.uint8)) != 0
        return Column(values, present, origin)

    @contextmanager
    def _ended_in_words(self) -> Iterator[None]:
        """Wait no longer than is allowed; a process that is gone without an answer is a fault of the file."""
        timer = Timer(PATIENCE * (SECONDS + self.size / 10_000_000), _stop, (self._process, self._late))
        timer.daemon = True
        timer.start()
        try:
            yield
        except (EOFError, BrokenPipeError, ConnectionResetError):
            code = self._process.wait()
            self._close()
            raise RecordingError(f"{self.path}: {self._end_in_words(code)}") from None
        except BaseException as error:
            self._close()
            if isinstance(error, RecordingError | MemoryError) or not isinstance(error, Exception):
                raise
            raise RecordingError(f"{self.path}: {self._damage('its reader does not answer as it should')}") from None
        finally:
            timer.cancel()

    def _end_in_words(self, code: int) -> str:
        if self._late.is_set() or code == -int(getattr(signal, "SIGXCPU", 0)):
            return (
                f"reading this {self.kind} file takes longer than its size explains, so it was stopped; export it "
                "again, as CSV or Parquet with one column per channel."
            )
        name = signal.Signals(-code).name if code < 0 else f"code {code}"
        return self._damage(f"its reader ended with {name}")

    def _damage(self, reason: str) -> str:
        return f"this {self.kind} file is truncated or damaged ({reason}); copy or export it again."

    def _fault(self, fault: str, text: str) -> str:
        """The sentence of a fault that the process found."""
        if fault == "refused":
            return f"{text}."
        if fault == "memory":
            return (
                f"reading this {self.kind} file takes more than {(MEMORY + 4 * self.size) // 1_000_000} MB, far beyond "
                "its size; export it again, as CSV or Parquet with one column per channel."
            )
        if fault == "library":
            return library_missing(self.kind, text)
        return self._damage(text)


def library_missing(kind: str, library: str) -> str:
    """Say what is to be installed for a format."""
    chosen = BY_NAME[kind]
    package = f"'accelcal[{chosen.extra}]'" if chosen.extra else library
    return f"this is {chosen.title or kind}, which needs {library}; install it with: pip install {package}"


def start() -> subprocess.Popen[bytes]:
    """Start a process that waits for the name of a file."""
    top = Path(accelcal.__path__[0])
    packages = {"accelcal": str(top), "accelcal.data": str(top / "data"), "accelcal.io": str(top / "io")}
    process = subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", _START],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **_ENVIRONMENT},
    )
    begin = {"path": [p for p in sys.path if p], "packages": packages}
    with suppress(BrokenPipeError):  # found when it does not answer
        send(process, json.dumps(begin, allow_nan=False).encode() + b"\n")
    return process


_ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMEXPR_MAX_THREADS": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",
    "HDF5_PLUGIN_PRELOAD": "::",
}
"""One thread, memory that is given back, and no filters that a file may ask HDF5 to load."""


def _stop(process: subprocess.Popen[bytes], late: Event) -> None:
    late.set()
    process.kill()


def _end(process: subprocess.Popen[bytes], left: ExitStack, owner: int) -> None:
    """End a process, and remove what it has left."""
    end(process, owner)
    if os.getpid() == owner:
        left.close()


def _filled(pipe: IO[bytes], values: Any) -> Any:
    """An array filled with the bytes that come next."""
    left = memoryview(values).cast("B") if len(values) else memoryview(b"")
    while left:
        count = pipe.readinto(left)  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        left = left[count:]
    return values


class _Waiting:
    """The process that has opened the last container and was asked for no column yet: a file that is looked at and then
    read, or looked at twice, is opened once."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._kept: tuple[tuple[object, ...], ReaderProcess] | None = None

    def take(self, path: Path, kind: str) -> ReaderProcess:
        """The kept process if it has this file, as it is now, open; else another one."""
        with self._lock:
            waiting, self._kept = self._kept, None
        if waiting is not None and waiting[0] == _identity(path, kind) and waiting[1].waits:
            return waiting[1]
        return ReaderProcess(path, kind)

    def keep(self, process: ReaderProcess) -> None:
        """Keep a process, in place of the one before."""
        with self._lock:
            self._kept = (_identity(process.path, process.kind), process)


def _identity(path: Path, kind: str) -> tuple[object, ...]:
    """What tells a file from every other and from itself after a change, in one process."""
    status = path.stat()
    return (os.getpid(), kind, str(path), status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)


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
