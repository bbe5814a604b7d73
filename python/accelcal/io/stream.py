"""Lines `t,accel,position` of a running measurement: read by a thread from port, server or file, turned into rows."""

from __future__ import annotations

import csv
import math
import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from accelcal._support.errors import MissingExtra
from accelcal.data import Array, RecordingError
from accelcal.io.assign import Plan, assign, in_seconds, in_si
from accelcal.io.files import open_regular
from accelcal.io.sidecar import Clock, Sidecar
from accelcal.io.table import Column, Table

PATIENCE = 0.2
"""Longest wait for bytes before a source is asked whether it should end, s."""
CONNECT = 10.0
"""Longest wait for a TCP server to answer, s."""
CHUNK = 1 << 16
"""Most bytes of one read."""
MOST_WAITING = 1 << 26
"""Most bytes that wait to be processed; 10 kHz of 30 bytes a line for 3 min."""
MOST_KEPT_WAITING = 1 << 18
"""The same of a sender that is kept waiting beyond it."""


@dataclass(frozen=True, slots=True)
class ByteSource:
    """An open source of bytes."""

    name: str
    """As messages show it."""
    read: Callable[[], bytes | None]
    """Next bytes, b"" at the end, None where none came within `PATIENCE`; raises where the source breaks."""
    close: Callable[[], None]
    waits: bool
    """Whether the sender waits for a slow reader; else bytes that nobody reads are lost."""
    from_its_start: bool
    """Whether the first byte begins a line."""
    ends_lines: bool
    """Whether the last line is whole although no line end follows."""


def open_file(path: Path) -> ByteSource:
    """A recorded stream.

    Raises
    ------
    RecordingError
        If there is no such file, or it is none.
    """
    file = _opened(path)
    return ByteSource(str(path), lambda: file.read(CHUNK), file.close, waits=True, from_its_start=True, ends_lines=True)


def open_growing(path: Path) -> ByteSource:
    """A file that another program appends lines to; it has no end, but breaks off where it is cut or replaced.

    Raises
    ------
    RecordingError
        If there is no such file, or it is none.
    """
    file = _opened(path)

    def read() -> bytes | None:
        chunk = file.read(CHUNK)
        if chunk:
            return chunk
        require_growing(path, file)
        time.sleep(PATIENCE)
        return None

    return ByteSource(str(path), read, file.close, waits=True, from_its_start=True, ends_lines=False)


def _opened(path: Path) -> IO[bytes]:
    try:
        return open_regular(path, "a file of lines t,accel,position")
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such file; check the path.") from None


def require_growing(path: Path, file: IO[bytes]) -> None:
    """Refuse a file that has become shorter than what was read of it, or has another under its name now.

    Raises
    ------
    RecordingError
        Saying which.
    """
    status = os.fstat(file.fileno())
    if status.st_size < file.tell():
        raise RecordingError(f"{path} has become shorter")
    if not path.exists() or not os.path.samestat(status, path.stat()):
        raise RecordingError(f"{path} was removed or replaced")


def open_tcp(host: str, port: int) -> ByteSource:
    """A connection to a server that sends lines.

    Raises
    ------
    RecordingError
        If nobody answers within `CONNECT`.
    """
    name = f"{host}:{port}"
    try:
        connection = socket.create_connection((host, port), timeout=CONNECT)
    except OSError as error:
        raise RecordingError(
            f"{name}: no connection ({error.strerror or error}); start the server that sends the lines, and check host "
            "and port."
        ) from None
    connection.settimeout(PATIENCE)

    def read() -> bytes | None:
        try:
            return connection.recv(CHUNK)
        except TimeoutError:
            return None

    return ByteSource(name, read, connection.close, waits=True, from_its_start=True, ends_lines=False)


def open_serial(device: str, baud: int) -> ByteSource:
    """A serial port: 8 data bits, no parity, 1 stop bit.

    Raises
    ------
    MissingExtra
        Without pyserial.
    RecordingError
        If the port cannot be opened.
    """
    try:
        import serial
    except ImportError as error:
        raise MissingExtra('a serial port needs pyserial; install it with: pip install "accelcal[live]"') from error
    try:
        port: Any = serial.Serial(device, baud, timeout=PATIENCE)
    except (OSError, ValueError, OverflowError) as error:
        raise RecordingError(
            f"{device}: the serial port cannot be opened ({error}); check its name, the rate of {baud} baud, and that "
            "no other program uses it."
        ) from None

    return ByteSource(
        device,
        lambda: port.read(max(1, min(port.in_waiting, CHUNK))) or None,
        port.close,
        waits=False,
        from_its_start=False,
        ends_lines=False,
    )


class Intake:
    """Reads a source in a thread of its own, so that no work on earlier lines keeps it from reading.

    Parameters
    ----------
    source : whoever opened it closes it, after `stop`.
    most : bytes that may wait; beyond, a sender that waits is kept waiting, and bytes of any other are dropped.
    """

    def __init__(self, source: ByteSource, most: int | None = None) -> None:
        self.source = source
        self.most = most or (MOST_KEPT_WAITING if source.waits else MOST_WAITING)
        self.dropped = 0
        """Bytes that were read and thrown away, because too many waited."""
        self.error: Exception | None = None
        """Why the source ended, if it broke; a driver may raise anything."""
        self._chunks: deque[bytes | None] = deque()
        self._waiting = 0
        self._ended = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._read_all, name="intake", daemon=True)
        self._thread.start()

    def take(self, patience: float) -> list[bytes | None]:
        """All chunks that wait, None where bytes were dropped; none at the end, or after `patience`, s."""
        with self._changed:
            if not self._chunks and not self._ended:
                self._changed.wait(patience)
            taken = list(self._chunks)
            self._chunks.clear()
            self._waiting = 0
            self._changed.notify_all()
        return taken

    @property
    def ended(self) -> bool:
        """Whether nothing will come any more."""
        with self._changed:
            return self._ended and not self._chunks

    def stop(self) -> None:
        """Read no more; what waits can still be taken."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        self._thread.join(timeout=5.0 * PATIENCE)

    def _read_all(self) -> None:
        try:
            while not self._ended:
                chunk = self.source.read()
                if chunk == b"":
                    break
                if chunk is not None:
                    self._keep(chunk)
        except Exception as error:
            self.error = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _keep(self, chunk: bytes) -> None:
        with self._changed:
            while self.source.waits and self._waiting >= self.most and not self._ended:
                self._changed.wait(PATIENCE)
            if self._waiting >= self.most:
                self.dropped += len(chunk)
                if self._chunks[-1] is not None:
                    self._chunks.append(None)
                return
            self._chunks.append(chunk)
            self._waiting += len(chunk)
            self._changed.notify_all()


LONGEST = 1000
"""Bytes of a line; what is longer is no line."""
MOST_AHEAD = 60.0
"""A row waits for the next from this step on while the usual step is not known, s."""
MOST_TIME, MOST_ACCEL, MOST_POSITION = 1e12, 1e6, 1e6
"""What no clock shows and no stage does, s, m/s² and m: such a number is a line that was damaged on its way."""
MOST_RANGES = 2.0
"""The same of the output, in declared ranges of the sensor."""
CHANNELS = ("accel", "position")
USUAL = ("t", "accel", "position")
"""Names of the columns where neither a header nor the sidecar gives others."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Lines that were understood, in the order of their stamps."""

    t: Array
    """(n,) s, rising."""
    accel: Array
    """(n,) m/s², NaN where not sampled."""
    position: Array
    """(n,) m, NaN where not sampled."""

    def __len__(self) -> int:
        return len(self.t)


@dataclass(slots=True)
class LineCounts:
    """What became of the lines."""

    used: int = 0
    broken: int = 0
    """Not the fields of a row, a field that is no number or beyond reason, no measurement, too long, or not whole."""
    out_of_order: int = 0
    """Stamps that do not rise, or are far ahead of those after them."""
    missing: int = 0
    """Rows that gaps in evenly spaced stamps leave out."""


@dataclass
class LineReader:
    """Turns bytes as they come into rows.

    Parameters
    ----------
    declared : the sidecar: names of the columns, units, scale of the sensor.
    source : name of the source, for messages.
    from_its_start : whether the first byte begins a line; else the first line is skipped, unless it is a header.
    """

    declared: Sidecar
    source: str
    from_its_start: bool = True
    counts: LineCounts = field(default_factory=LineCounts)
    _rest: bytes = b""
    _skipping: bool = False
    """Inside a line that is no use: too long, or with bytes missing."""
    _begun: bool = False
    _header: bytes = b""
    _columns: _Columns | None = None
    _order: _Order = field(default_factory=lambda: _Order())

    @property
    def _most_accel(self) -> float:
        span = self.declared.rig.sensor.range
        return MOST_ACCEL if span is None else MOST_RANGES * span

    def feed(self, chunk: bytes | None) -> Rows:
        """Rows of the lines that end in these bytes; None where bytes of the stream were lost.

        Raises
        ------
        RecordingError
            If the columns have no names or units that are known; it says what to write into the sidecar.
        """
        if chunk is None:
            self._drop_line()
            return _NO_ROWS
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        if self._skipping and lines:
            del lines[0]
            self._skipping = False
        if len(self._rest) > LONGEST:
            self._drop_line()
        return self._rows(lines)

    def finish(self, *, whole: bool) -> Rows:
        """Rows of the last line, which no line end follows; one that may not be whole is broken."""
        line, self._rest = self._rest, b""
        last = _NO_ROWS
        if line.strip() and not self._skipping:
            if whole:
                last = self._rows([line])
            else:
                self.counts.broken += 1
        waited = self._ordered(np.empty((0, 3)), ended=True)
        names = ("t", "accel", "position")
        return Rows(*(np.concatenate([getattr(last, name), getattr(waited, name)]) for name in names))

    def _drop_line(self) -> None:
        """Skip everything up to the next line end."""
        if not self._skipping:
            self.counts.broken += 1
        self._rest, self._skipping = b"", True

    def _rows(self, lines: list[bytes]) -> Rows:
        if not self._begun:
            lines = self._begin(lines)
        if self._columns is None or not lines:
            return _NO_ROWS
        rows = self._columns.converted(self._numbers(lines, self._columns))
        most = (self._most_accel, MOST_POSITION)
        plausible = (np.abs(rows[:, 0]) <= MOST_TIME) & ~np.any(np.abs(rows[:, 1:]) > most, axis=1)
        self.counts.broken += len(rows) - int(plausible.sum())
        return self._ordered(rows[plausible])

    def _ordered(self, rows: Array, *, ended: bool = False) -> Rows:
        """Those of the rows (n, 3) that follow the rows before."""
        ordered = self._order.kept(rows, ended=ended)
        self.counts.out_of_order, self.counts.missing = self._order.late, self._order.missing
        self.counts.used += len(ordered)
        return Rows(ordered[:, 0], ordered[:, 1], ordered[:, 2])

    def _begin(self, lines: list[bytes]) -> list[bytes]:
        """Understand the first line: a header, the first row, or the end of a row that began before."""
        while lines and not lines[0].strip():
            del lines[0]
        if not lines:
            return lines
        self._begun = True
        first, named = lines[0], _names(lines[0])
        if named is not None:
            self._header = first.strip()
            self._columns = _Columns.of(self.declared, self.source, named)
            return lines[1:]
        self._columns = _Columns.of(self.declared, self.source, None)
        if self.from_its_start:
            return lines
        self.counts.broken += 1
        return lines[1:]

    def _numbers(self, lines: list[bytes], columns: _Columns) -> Array:
        """Time, output and position of the lines that have them, (n, 3) in their units; NaN where not sampled."""
        count, places, longest = columns.count, columns.places, LONGEST
        numbers: list[float] = []
        for line in lines:
            fields = line.split(b",")
            if len(fields) != count or len(line) > longest or b"_" in line:
                if line.strip() and line.strip() != self._header:
                    self.counts.broken += 1
                continue
            try:
                row = [float(cell) if (cell := fields[place].strip()) else math.nan for place in places]
            except ValueError:
                if line.strip() != self._header:
                    self.counts.broken += 1
                continue
            # A field that says nan is not empty, so it is broken, as infinity is.
            sampled = sum(map(math.isfinite, row))
            if not math.isfinite(row[0]) or sampled < 2 or sampled != sum(bool(fields[p].strip()) for p in places):
                self.counts.broken += 1
                continue
            numbers += row
        return np.array(numbers).reshape(-1, 3)


class _Order:
    """Which rows follow those before them, and how many are missing between them.

    A damaged stamp that is too large would make every honest one after it late. So a row that is far ahead waits for
    the next: it is believed if that one is later still.
    """

    def __init__(self) -> None:
        self.late = 0
        """Rows that were skipped."""
        self.missing = 0
        self._last = -math.inf
        self._waiting = np.empty((0, 3))
        self._steps: list[float] = []
        self._step = 0.0
        """Usual step of the stamps, s; 0 while it is not known."""

    def kept(self, rows: Array, *, ended: bool = False) -> Array:
        """The rows (n, 3) that follow, with the one that waited, without one that waits now; its stamp is first."""
        rows = np.concatenate([self._waiting, rows])
        self._waiting = rows[:0]
        stamps = rows[:, 0].tolist()
        follows, last = np.zeros(len(rows), dtype=bool), self._last
        for i, stamp in enumerate(stamps):
            if stamp > last and self._is_far(stamp - last):
                if i + 1 == len(stamps) and not ended:
                    self._waiting = rows[i:]
                    break
                if i + 1 < len(stamps) and stamps[i + 1] <= stamp:
                    continue
            if stamp > last:
                follows[i] = True
                self._learn(stamp - last)
                last = stamp
        self._last = last
        self.late += len(rows) - int(follows.sum()) - len(self._waiting)
        return rows[follows]

    def _is_far(self, step: float) -> bool:
        return step > (_FAR * self._step if self._step else MOST_AHEAD)

    def _learn(self, step: float) -> None:
        """Count rows that this step leaves out; the usual step is the median of the first hundred."""
        if len(self._steps) == _STEPS:
            self.missing += max(0, round(step / self._step) - 1)
        elif step < math.inf:
            self._steps.append(step)
            if len(self._steps) in (_STEPS // 5, _STEPS):
                self._step = float(np.median(self._steps))


_STEPS = 100
_FAR = 20.0
"""Usual steps from which on a row waits for the next."""


@dataclass(frozen=True)
class _Columns:
    """Which field is which, and their units."""

    count: int
    places: tuple[int, int, int]
    """Of time, output and position."""
    plan: Plan
    table: Table
    declared: Sidecar

    @classmethod
    def of(cls, declared: Sidecar, source: str, named: tuple[str, ...] | None) -> _Columns:
        """Find time, output and position as in a file with these columns."""
        _require_lines(declared, source)
        columns = named or _usual_names(declared)
        table = Table(Path(source), columns, read=lambda names: {}, row=lambda i: f"line {i + 1}")
        plan, _ = assign(table, declared, CHANNELS)
        clocks = {plan.sources[name].time for name in CHANNELS}
        clock = plan.sources["accel"].time
        if len(clocks) > 1 or clock is None or clock.column is None:
            raise RecordingError(f"{declared.path}: a line has one time for both channels; declare one [channels] time")
        names = (clock.column, *(plan.sources[name].column for name in CHANNELS))
        places = tuple(columns.index(name) for name in names)
        return cls(len(columns), (places[0], places[1], places[2]), plan, table, declared)

    def converted(self, rows: Array) -> Array:
        """Time, output and position in SI, (n, 3), of rows in the units of the lines."""
        stamps, *readings = (Column(column) for column in rows.T)
        t = in_seconds(self.table, self.plan, self._clock(), stamps, readings)[0].values
        accel, position = (
            in_si(self.table, self.plan, name, self.plan.sources[name], self.declared.rig, rows[:, i])[0]
            for i, name in enumerate(CHANNELS, 1)
        )
        return np.stack([t, accel, position], axis=1)

    def _clock(self) -> Clock:
        clock = self.plan.sources["accel"].time
        assert clock is not None  # `of` found it
        return clock


def _require_lines(declared: Sidecar, source: str) -> None:
    """Refuse what lines of three fields cannot be."""
    for count, what in (
        (declared.attitude is not None, "[channels.attitude]"),
        (declared.time is not None and declared.time.rate is not None, "[channels] rate"),
        (declared.time is not None and (declared.time.date or declared.time.fraction), "date and fraction of the time"),
        (any(source.where for source in declared.channels.values()), "where"),
        (bool(set(declared.channels) - set(CHANNELS)), ", ".join(sorted(set(declared.channels) - set(CHANNELS)))),
    ):
        if count:
            raise RecordingError(
                f"{declared.path}: {what}: lines of {source} hold time, output and position alone; leave it out of the "
                "sidecar of a live view"
            )


def _usual_names(declared: Sidecar) -> tuple[str, ...]:
    """Names of the columns without a header: those of the sidecar, in the order time, output, position."""
    time = declared.time.column if declared.time is not None else None
    given = (time, *(declared.channels[name].column if name in declared.channels else None for name in CHANNELS))
    return tuple(name or usual for name, usual in zip(given, USUAL, strict=True))


def _names(line: bytes) -> tuple[str, ...] | None:
    """Names of a header; None of a line that has a number, or is no text."""
    try:
        cells = [cell.strip() for row in csv.reader([line.decode("utf-8-sig")]) for cell in row]
    except (UnicodeDecodeError, csv.Error):
        return None
    named = all(cell and cell.isprintable() and not _is_number(cell) for cell in cells)
    if not named or len(cells) < len(USUAL) or len(line) > LONGEST:
        return None
    return tuple(cells)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


_NO_ROWS = Rows(np.empty(0), np.empty(0), np.empty(0))
