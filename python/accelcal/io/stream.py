"""Lines `t,accel,position` of a running measurement: read by a thread, turned into rows, false samples left out."""

from __future__ import annotations

import csv
import difflib
import math
import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from accelcal._support.errors import MissingExtra
from accelcal.data import Array, Flags, RecordingError
from accelcal.data.rig import MOST_POSITION
from accelcal.io import naming
from accelcal.io.assign import Plan, assign, in_si
from accelcal.io.files import open_regular
from accelcal.io.sidecar import Sidecar, Source
from accelcal.io.table import Table

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


def open_stdin() -> ByteSource:
    """What another program writes into this one."""
    return ByteSource(
        "stdin", lambda: os.read(0, CHUNK), lambda: None, waits=True, from_its_start=True, ends_lines=True
    )


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
        self.caught_up = True
        """Whether nothing waited when chunks were last asked for."""
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
            self.caught_up = not self._chunks
            if self.caught_up and not self._ended:
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
            last = self._chunks[-1] if self._chunks else None
            if last is not None and len(last) + len(chunk) <= CHUNK:  # a block of rows costs more than its rows
                self._chunks[-1] = last + chunk
            else:
                self._chunks.append(chunk)
            self._waiting += len(chunk)
            self._changed.notify_all()


LONGEST = 1000
"""Bytes of a line; what is longer is no line."""
FIRST_LINES = 20
"""Lines among which the header is sought."""
MOST_TIME = 1e12
"""What no clock shows, s: such a number is a line that was damaged on its way."""
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
    side: Mapping[str, Array] = field(default_factory=dict)
    """Side channels that were asked for, (n,) each, SI, temperature in degC; NaN where not sampled."""

    def __len__(self) -> int:
        return len(self.t)

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """Several in a row, at least one."""
        t, accel, position = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "accel", "position")
        )
        side = {name: np.concatenate([part.side[name] for part in parts]) for name in parts[0].side}
        return cls(t, accel, position, side)


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
    restarts: int = 0
    """Times that the clock began anew, or went on behind where it had been; the stamps then go on behind a hole."""


@dataclass
class LineReader:
    """Turns bytes as they come into rows.

    Parameters
    ----------
    declared : the sidecar: names of the columns, units, scale of the sensor.
    source : name of the source, for messages.
    from_its_start : whether the first byte begins a line; else the first line is skipped, unless it is a header.
    needed : side channels that are read beside those; all others that are declared are left out.
    channels : those that a line has anyway.
    """

    declared: Sidecar
    source: str
    from_its_start: bool = True
    needed: tuple[str, ...] = ()
    channels: tuple[str, ...] = CHANNELS
    counts: LineCounts = field(default_factory=LineCounts)
    _rest: bytes = b""
    _skipping: bool = False
    """Inside a line that is no use: too long, or with bytes missing."""
    _seen: int = 0
    """Lines before the first row."""
    _header: bytes = b""
    _columns: _Columns | None = None
    _misnamed: RecordingError | None = None
    """What is wrong with the header; the next lines may be a header that is whole."""
    _names: int = 0
    """How many names that header has: lines of another number of fields are not of it."""
    _order: _Order = field(init=False)

    def __post_init__(self) -> None:
        _require_lines(self.declared, self.source)
        self._order = _Order(self.counts)

    @property
    def units(self) -> dict[str, str]:
        """SI units of the side channels; empty before the first row."""
        return {} if self._columns is None else {name: self._columns.units[name] for name in self.needed}

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the sidecar declares and nobody needs: channels, and the attitude."""
        attitude = ("attitude",) if self.declared.attitude is not None else ()
        return (*(name for name in self.declared.channels if name not in (*self.channels, *self.needed)), *attitude)

    @property
    def _most(self) -> list[float]:
        most = self.declared.rig.sensor.most_output
        return [MOST_POSITION if name == "position" else most for name in self.channels]

    def feed(self, chunk: bytes | None) -> Rows:
        """Rows of the lines that end in these bytes; None where bytes of the stream were lost.

        Raises
        ------
        RecordingError
            If the columns have no names or units that are known; it says what to write into the sidecar.
        """
        if chunk is None:
            self._drop_line()
            return self._as_rows([])
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        if self._skipping and lines:
            del lines[0]
            self._skipping = False
        if len(self._rest) > LONGEST:
            self._drop_line()
        return self._rows(lines)

    def finish(self, *, whole: bool) -> Rows:
        """Rows of the last line, which no line end follows; one that may not be whole is broken.

        Raises
        ------
        RecordingError
            As `feed`.
        """
        line, self._rest = self._rest, b""
        last = []
        if line.strip() and not self._skipping:
            if whole:
                last = [line]
            else:
                self.counts.broken += 1
        rows = [self._rows(last)]
        if self._columns is None and self._misnamed is not None:
            raise self._misnamed
        return Rows.joined([*rows, self._ordered(np.empty((0, 1 + len(self.channels) + len(self.needed))), ended=True)])

    def _drop_line(self) -> None:
        """Skip everything up to the next line end."""
        if not self._skipping:
            self.counts.broken += 1
        self._rest, self._skipping = b"", True

    def _rows(self, lines: list[bytes]) -> Rows:
        if self._columns is None:
            lines = self._begin(lines)
        if self._columns is None or not lines:
            return self._as_rows([])
        rows = self._columns.converted(self._numbers(lines, self._columns))
        size = np.abs(rows[:, 1 : 1 + len(self.channels)])
        plausible = (np.abs(rows[:, 0]) <= MOST_TIME) & ~np.any(size > self._most, axis=1)
        self.counts.broken += len(rows) - int(plausible.sum())
        return self._ordered(rows[plausible])

    def _ordered(self, rows: Array, *, ended: bool = False) -> Rows:
        """Those of the rows (n, m) that follow the rows before."""
        ordered = self._order.in_order(rows, ended=ended)
        self.counts.used += len(ordered)
        return self._as_rows(ordered)

    def _as_rows(self, rows: ArrayLike) -> Rows:
        names = (*self.channels, *self.needed)
        t, *values = np.reshape(rows, (-1, 1 + len(names))).T
        side = dict(zip(names, values, strict=True))
        absent = np.full(len(t), np.nan)
        return Rows(t, side.pop("accel", absent), side.pop("position", absent), side)

    def _begin(self, lines: list[bytes]) -> list[bytes]:
        """Look for a header, or the first row that has none; return the lines behind it, or from it on.

        A header that was damaged on its way is as good as none where every name is all but the expected one; another
        one does not fit the sidecar, and is said if no header that fits is among the first lines.
        """
        for i, line in enumerate(lines):
            if not line.strip():
                continue
            self._seen += 1
            named = _names(line)
            if named is not None:
                try:
                    self._columns = _Columns.of(self.declared, self.source, named, self.channels, self.needed)
                except RecordingError as error:
                    expected = _usual_names(self.declared, self.channels, self.needed, len(named))
                    if not _nearly(named, expected):
                        self._misnamed, self._names = self._misnamed or error, len(named)
                else:
                    self._header = line.strip()
                    return lines[i + 1 :]
            elif self._names != line.count(b",") + 1 and (self._seen > 1 or self.from_its_start):
                expected = _usual_names(self.declared, self.channels, self.needed, line.count(b",") + 1)
                if len(expected) == line.count(b",") + 1:
                    self._columns = _Columns.of(self.declared, self.source, None, self.channels, self.needed, expected)
                    return lines[i:]
            if self._misnamed is not None and self._seen >= FIRST_LINES:
                raise self._misnamed
            self.counts.broken += 1
        return []

    def _numbers(self, lines: list[bytes], columns: _Columns) -> Array:
        """Time, output, position and side channels of the lines that have them, (n, m) in their units; NaN where not
        sampled."""
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
        return np.array(numbers).reshape(-1, len(places))


FIRST_ROWS = 8
"""Rows before the first of which is believed: their spacing is the usual step until more are known."""
STEPS = 100
"""Steps whose median is the usual one."""
AHEAD, FAR = 2.5, 20.0
"""Usual steps from which on a row waits for others, and beyond which two rows do not agree, or `SHORT`."""
SHORT = 0.4
"""A jump ahead of at most this needs `FEWEST` rows that agree, a longer one `SEVERAL` that last as long, s."""
FEWEST, SEVERAL = 3, 5
BEHIND = 0.9
"""How long rows behind the last must agree until the clock has begun anew, s."""
MOST_CHAINS = 50
"""Runs of waiting rows that are followed."""


class _Order:
    """Which rows follow those before them, and how many are missing between them.

    A damaged stamp that is too large would make every honest one after it late. So a row that does not follow the last
    waits, in a run of rows that agree with each other. A run that is long enough is believed, unless a row that follows
    the last comes first; then all that wait were damaged.
    """

    def __init__(self, counts: LineCounts) -> None:
        self._counts = counts
        self._last = -math.inf
        self._shift = 0.0
        """What is added to stamps since the clock began anew, s."""
        self._pool: Array | None = None
        """Rows that wait."""
        self._chains: list[list[int]] = []
        """Runs of those that agree."""
        self._steps: list[float] = []
        self._step = 0.0
        """Usual step of the stamps, s; 0 while it is not known."""

    def in_order(self, rows: Array, *, ended: bool = False) -> Array:
        """The rows (n, m) that follow, among them those that waited until now; the stamp is first."""
        waiting = 0 if self._pool is None else len(self._pool)
        rows = rows if self._pool is None else np.concatenate([self._pool, rows])
        self._pool = None
        if not self._step:
            if len(rows) < FIRST_ROWS and not ended:
                self._pool = rows
                return rows[:0]
            steps, waiting = np.diff(rows[:, 0]), 0
            self._step = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 1.0
        t, follows = rows[:, 0].tolist(), list[int]()
        for i in range(waiting, len(t)):
            if 0.0 < t[i] + self._shift - self._last <= AHEAD * self._step:
                self._take(rows, follows, [i])
            else:
                self._wait(rows, t, follows, i)
        if ended:
            for chain in sorted(self._chains, key=len, reverse=True)[:1]:
                if t[chain[0]] + self._shift > self._last and (len(chain) > 1 or self._last == -math.inf):
                    self._take(rows, follows, chain)
            self._skip()
        waits = sorted({i for chain in self._chains for i in chain})
        if waits:
            self._pool, place = rows[waits], {i: k for k, i in enumerate(waits)}
            self._chains = [[place[i] for i in chain] for chain in self._chains]
        return rows[follows]

    def _wait(self, rows: Array, t: list[float], follows: list[int], i: int) -> None:
        """Add row i to the run that it agrees with, which may then be long enough."""
        far, last = max(FAR * self._step, SHORT), self._last - self._shift

        def agrees(chain: list[int]) -> bool:
            return 0.0 < t[i] - t[chain[-1]] <= far and (t[chain[0]] > last) == (t[i] > last)

        chain = next(filter(agrees, self._chains), None)
        if chain is None:
            if len(self._chains) == MOST_CHAINS:
                self._chains.remove(shortest := min(self._chains, key=len))
                self._counts.out_of_order += len(shortest)
            self._chains.append(chain := [])
        chain.append(i)
        jump, lasts = t[chain[0]] - last, t[i] - t[chain[0]]
        if jump > 0.0:
            short = jump <= SHORT or jump == math.inf
            believed = len(chain) >= FEWEST if short else len(chain) >= SEVERAL and lasts >= SHORT
        else:
            believed = len(chain) >= SEVERAL and lasts >= BEHIND
            if believed:
                self._last += far  # what came between is unknown, as in a hole
                self._shift = self._last + self._step - t[chain[0]]
                self._counts.restarts += 1
        if believed:
            self._take(rows, follows, chain)

    def _take(self, rows: Array, follows: list[int], chain: list[int]) -> None:
        """Let the rows of a run follow; all others that wait were damaged."""
        for i in chain:
            rows[i, 0] = stamp = rows[i, 0] + self._shift
            self._learn(stamp - self._last)
            self._last = stamp
        follows += chain
        if self._chains:
            self._skip(-len(chain) if chain in self._chains else 0)

    def _skip(self, but: int = 0) -> None:
        """Nothing waits any more."""
        self._counts.out_of_order += sum(map(len, self._chains)) + but
        self._chains = []

    def _learn(self, step: float) -> None:
        """Count rows that this step leaves out; the usual step is the median of the first hundred."""
        if len(self._steps) == STEPS:
            if math.isfinite(left_out := step / self._step):
                self._counts.missing += max(0, round(left_out) - 1)
        elif step < math.inf:
            self._steps.append(step)
            if len(self._steps) in (STEPS // 5, STEPS):
                self._step = float(np.median(self._steps))


@dataclass(frozen=True)
class _Columns:
    """Which field is which, and their units."""

    count: int
    places: tuple[int, ...]
    """Of time, output, position and the side channels that are needed."""
    plan: Plan
    table: Table
    declared: Sidecar
    channels: tuple[str, ...]

    @classmethod
    def of(
        cls,
        declared: Sidecar,
        source: str,
        named: tuple[str, ...] | None,
        channels: tuple[str, ...],
        needed: tuple[str, ...],
        usual: tuple[str, ...] = USUAL,
    ) -> _Columns:
        """Find time, output, position and what else is needed as in a file with these columns, or the usual ones."""
        channels = (*channels, *needed)
        columns = named or usual
        table = Table(Path(source), columns, read=lambda names: {}, row=lambda i: f"line {i + 1}")
        read = {name: channel for name, channel in declared.channels.items() if name in channels}
        declared = replace(declared, channels=read, attitude=None)
        plan, _ = assign(table, declared, channels)
        absent = [name for name in channels if name not in plan.sources]
        if absent:
            otherwise = ", or drop the effect with accelcal drop" if needed else ""
            raise RecordingError(
                f"{source}: the channel {', '.join(absent)} is needed; send it in a column of the lines and declare "
                f"it in [channels] of {declared.path}{otherwise}"
            )
        clock = plan.sources[channels[0]].time
        if any(plan.sources[name].time != clock for name in channels) or clock is None or clock.column is None:
            raise RecordingError(f"{declared.path}: a line has one time for all channels; declare one [channels] time")
        names = (clock.column, *(plan.sources[name].column for name in channels))
        return cls(len(columns), tuple(map(columns.index, names)), plan, table, declared, channels)

    def converted(self, rows: Array) -> Array:
        """Time, output, position and side channels in SI, (n, m), of rows in the units of the lines."""
        return np.stack([values for values, _ in self._in_si(rows).values()], axis=1)

    @property
    def units(self) -> dict[str, str]:
        """SI units by channel."""
        return {name: unit for name, (_, unit) in self._in_si(np.empty((0, len(self.places)))).items()}

    def _in_si(self, rows: Array) -> dict[str, tuple[Array, str]]:
        clock = self.plan.sources[self.channels[0]].time
        assert clock is not None  # `of` found it
        assert clock.column is not None
        sources = {
            "time": Source(clock.column, clock.unit),
            **{name: self.plan.sources[name] for name in self.channels},
        }
        return {
            name: in_si(self.table, self.plan, name, source, self.declared.rig, rows[:, i])
            for i, (name, source) in enumerate(sources.items())
        }


def _require_lines(declared: Sidecar, source: str) -> None:
    """Refuse what lines of a few fields cannot be."""
    for count, what in (
        (declared.time is not None and declared.time.rate is not None, "[channels] rate"),
        (declared.time is not None and (declared.time.date or declared.time.fraction), "date and fraction of the time"),
        (any(declared.channels[name].where for name in CHANNELS if name in declared.channels), "where"),
    ):
        if count:
            raise RecordingError(
                f"{declared.path}: {what}: lines of {source} begin with their time in one field; declare that field "
                'as time = { column = "t", unit = "s" }'
            )


def _usual_names(declared: Sidecar, channels: tuple[str, ...], needed: tuple[str, ...], count: int) -> tuple[str, ...]:
    """Names of the columns without a header: those of the sidecar, in the order time, output, position; where lines
    have more fields, then those of the other channels as the sidecar lists them."""
    time = declared.time.column if declared.time is not None else None
    given = (time, *(declared.channels[name].column if name in declared.channels else None for name in channels))
    usual = tuple(name or usual for name, usual in zip(given, ("t", *channels), strict=True))
    if count == len(usual) and not needed:
        return usual
    return (*usual, *(source.column for name, source in declared.channels.items() if name not in channels))


SIMILAR = 0.6
"""Share of the letters of a name that are left of it where it was damaged."""


def _nearly(named: tuple[str, ...], expected: tuple[str, ...]) -> bool:
    """Whether a header is the expected one but for damage: names that are no other quantity and differ in little. One
    that names every quantity, and two in other words, is whole."""

    def role(name: str) -> str | None:
        return naming.role(naming.take_apart(name).base)

    def damaged(name: str, meant: str) -> bool:
        letters = difflib.SequenceMatcher(None, name, meant).ratio()
        return role(name) in (None, role(meant)) and (len(meant) == 1 or letters >= SIMILAR)

    pairs = list(zip(named, expected, strict=False))
    differing = [pair for pair in pairs if pair[0] != pair[1]]
    if len(named) != len(expected) or (len(differing) > 1 and all(role(name) is not None for name in named)):
        return False
    return all(damaged(name, meant) for name, meant in differing)


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


AROUND = 4
"""Samples on either side that one is compared with: a ringing at a quarter of the rate, which passes through its start
at every second sample, has three peaks among them."""
RATIO = 8.0
"""An excursion is this many times as high as the second largest of the samples around it."""
USUAL_BENDS = 12.0
"""The same over the usual bend; white noise has less than eight."""
MEMORY, STRIDE = 64, 16
"""Bends whose median is the usual one, and from how many to how many it is taken anew."""
SPARSE = 1.5
"""Time that the samples around may take, in usual steps: a sample between two holes is not judged."""
ROUNDING = 1e-12
"""What floating-point numbers bend, over their size."""


class Excursions:
    """Samples far off the curve through those around them, alone or beside one more that is not of the same pulse.

    Motion, ringing and noise have neighbours of their size; a step stays. A shock shorter than two samples has none,
    and its output is not the acceleration over a sample. How the stream is cut into blocks makes no difference.

    Examples
    --------
    >>> import numpy as np
    >>> u = np.sin(0.1 * np.arange(200.0))
    >>> u[100] += 5.0
    >>> excursions = Excursions()
    >>> rows = excursions.without(Rows(np.arange(200.0), u, np.full(200, np.nan)))
    >>> np.flatnonzero(np.isnan(rows.accel)).tolist(), len(rows), excursions.outputs
    ([100], 196, 1)
    """

    def __init__(self) -> None:
        self._output, self._position = _Channel("accel"), _Channel("position")

    @property
    def outputs(self) -> int:
        """Outputs that were left out."""
        return self._output.count

    @property
    def readings(self) -> int:
        """Readings of the position that were left out."""
        return self._position.count

    def without(self, rows: Rows) -> Rows:
        """Rows up to the newest that enough others follow, with lost samples in place of excursions."""
        return self._position.without(self._output.without(rows))

    def rest(self) -> Rows:
        """Rows that still wait at the end of a record."""
        return Rows.joined([self._position.without(self._output.rest()), self._position.rest()])


class _Channel:
    """Excursions of one channel."""

    def __init__(self, name: Literal["accel", "position"]) -> None:
        self.name = name
        self.count = 0
        self._rows: Rows | None = None
        """Rows that wait for the samples behind them."""
        self._t, self._y = np.empty(0), np.empty(0)
        """Samples before and among those rows."""
        self._before = 0
        """How many of them come before."""
        self._bends = np.empty(0)
        """The newest that are not zero."""
        self._number = 0
        """How many there were, those that were dropped included."""
        self._usual = 0, math.inf
        """The usual bend, and how many there were before it."""

    def without(self, rows: Rows) -> Rows:
        """Rows up to the newest sample that enough others follow, without excursions."""
        rows = rows if self._rows is None else Rows.joined([self._rows, rows])
        y, before = getattr(rows, self.name), self._before
        at = np.flatnonzero(np.isfinite(y))
        self._t = np.concatenate([self._t[:before], rows.t[at]])
        self._y = np.concatenate([self._y[:before], y[at]])
        decided = max(0, len(at) - AROUND)
        lost = at[:decided][self._judged(before, before + decided)] if decided else at[:0]
        while decided < len(at) and self._alone(before + decided, float(rows.t[-1])):
            decided += 1
        until = int(at[decided]) if decided < len(at) else len(rows)
        ready, self._rows = _cut(rows, 0, until), _cut(rows, until, len(rows))
        self._before = min(AROUND, before + decided)
        past = before + decided - self._before
        self._t, self._y = self._t[past:], self._y[past:]
        self.count += len(lost)
        if not len(lost):
            return ready
        y = y[:until].copy()
        y[lost] = np.nan
        return replace(ready, accel=y) if self.name == "accel" else replace(ready, position=y)

    def rest(self) -> Rows:
        """Rows that still wait."""
        rows, self._rows = self._rows, None
        return Rows(np.empty(0), np.empty(0), np.empty(0)) if rows is None else rows

    def _alone(self, i: int, now: float) -> bool:
        """Whether those behind a sample are so late that it will not be judged."""
        first = max(0, i - AROUND)
        before = float(self._t[i] - self._t[first])
        return i > first and (now - float(self._t[i])) * (i - first) > 2.0 * SPARSE * 2 * AROUND * before

    def _judged(self, begin: int, end: int) -> Flags:
        """Which of the samples from `begin` to `end` are excursions; their bends join those before."""
        lost = np.zeros(end - begin, dtype=np.bool_)
        first = max(begin, AROUND)
        if end <= first:
            return lost
        y = self._y
        # The fourth difference, in which a sample counts once: of it smooth motion has next to nothing.
        bend = np.abs(np.diff(y[first - 2 : end + 2], n=4)) / 6.0
        bend[bend < ROUNDING * (np.abs(y[first - 2 : end - 2]) + np.abs(y[first + 2 : end + 2]))] = 0.0
        # A bend of zero says nothing: a coarse channel repeats itself, and a jump by one count is not an excursion.
        bends = np.concatenate([self._bends, bend[bend > 0.0]])
        dropped = self._number - len(self._bends)
        number = self._number + np.cumsum(bend > 0.0) - (bend > 0.0)
        self._number += int(np.sum(bend > 0.0))
        ends = np.arange(number[0] // STRIDE, number[-1] // STRIDE + 1) * STRIDE
        usual = np.array([self._median(int(stop), bends, dropped) for stop in ends])
        self._bends = bends[-(MEMORY + STRIDE) :]
        near = np.flatnonzero(bend > 0.5 * USUAL_BENDS * usual[number // STRIDE - ends[0] // STRIDE])
        if len(near):
            least = USUAL_BENDS * usual[number[near] // STRIDE - ends[0] // STRIDE]
            lost[first - begin + near] = self._lonely(first + near, least)
        return lost

    def _median(self, stop: int, bends: Array, dropped: int) -> float:
        """The usual bend of those before number `stop`; no bend is unusual while few are known."""
        if stop != self._usual[0]:
            newest = bends[max(0, stop - MEMORY - dropped) : stop - dropped]
            self._usual = stop, float(np.median(newest))
        return self._usual[1]

    def _lonely(self, at: NDArray[np.intp], least: Array) -> Flags:
        """Which of some samples are off the curve through those around them, by `least` and as no other is."""
        places = at[:, None] + np.arange(-AROUND, AROUND + 1)
        y, t = self._y[places], self._t[places]
        lonely = np.zeros(len(at), dtype=np.bool_)
        for degree in (1, 2):  # a line suits noise, which bends a parabola, and a parabola suits what is smooth
            off = _off(y, degree)
            height = off[:, AROUND]
            second = np.sort(np.abs(np.delete(off, AROUND, axis=1)), axis=1)[:, -2]
            beside = off[:, [AROUND - 1, AROUND + 1]] / np.where(height == 0.0, 1.0, height)[:, None]
            pulse = np.any(beside > 1.0 / RATIO, axis=1)
            lonely |= (np.abs(height) > np.maximum(least, RATIO * second)) & ~pulse
        even = t[:, -1] - t[:, 0] <= SPARSE * 2 * AROUND * np.median(np.diff(t, axis=1), axis=1)
        return np.asarray(lonely & even)


def _off(y: Array, degree: int) -> Array:
    """What samples (n, 2 AROUND + 1) are off a line or parabola whose coefficients two of them do not change much."""
    x = np.arange(-AROUND, AROUND + 1.0)
    if degree == 2:
        y = y - 0.5 * np.median(np.diff(y, n=2, axis=1), axis=1, keepdims=True) * x**2
    y = y - np.median(np.diff(y, axis=1), axis=1, keepdims=True) * x
    return np.asarray(y - np.median(y, axis=1, keepdims=True))


def _cut(rows: Rows, begin: int, end: int) -> Rows:
    part = slice(begin, end)
    return Rows(rows.t[part], rows.accel[part], rows.position[part], {k: y[part] for k, y in rows.side.items()})
