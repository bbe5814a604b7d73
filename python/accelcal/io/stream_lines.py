"""Lines `t,accel,position` of a running measurement to rows in SI; what is broken is counted and skipped."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.recording import RecordingError
from accelcal.io.assign import Plan, assign
from accelcal.io.convert import in_seconds, in_si
from accelcal.io.sidecar import Clock, Sidecar
from accelcal.io.table import Column, Table

LONGEST = 1000
"""Bytes of a line; what is longer is no line."""
MOST_AHEAD = 60.0
"""Steps of the stamps beyond this are believed when the next line confirms them, s."""
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
    """Not the fields of a row, a field that is no finite number, no measurement at all, too long, or not whole."""
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
        if not line.strip() or self._skipping:
            return _NO_ROWS
        if whole:
            return self._rows([line])
        self.counts.broken += 1
        return _NO_ROWS

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
        t, accel, position = self._columns.converted(self._numbers(lines, self._columns))
        known = np.isfinite(t) & ~np.isinf(accel) & ~np.isinf(position)  # a unit may lead beyond the largest double
        self.counts.broken += len(t) - int(known.sum())
        kept = self._order.kept(t, known)
        self.counts.out_of_order += int(known.sum()) - int(kept.sum())
        self.counts.missing += self._order.missing(t[kept])
        self.counts.used += int(kept.sum())
        return Rows(t[kept], accel[kept], position[kept])

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
        found: list[float] = []
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
            found += row
        return np.array(found).reshape(-1, 3)


class _Order:
    """Which stamps rise, and how many rows are missing between them."""

    def __init__(self) -> None:
        self._last = -math.inf
        self._ahead: float | None = None
        """A stamp far ahead that nothing has confirmed yet."""
        self._steps: list[float] = []
        self._step = 0.0
        self._newest: float | None = None

    def kept(self, t: Array, known: np.ndarray) -> np.ndarray:
        """(n,) true where a row follows those before it."""
        kept = np.zeros(len(t), dtype=bool)
        last = self._last
        for i, (stamp, fine) in enumerate(zip(t.tolist(), known.tolist(), strict=True)):
            if not fine or stamp <= last:
                continue
            if stamp - last > MOST_AHEAD and last > -math.inf:
                confirmed = self._ahead is not None and 0.0 < stamp - self._ahead <= MOST_AHEAD
                self._ahead = stamp
                if not confirmed:
                    continue
            self._ahead = None
            kept[i], last = True, stamp
        self._last = last
        return kept

    def missing(self, t: Array) -> int:
        """Rows between these stamps and since the last, where the step is known from the first hundred."""
        if not len(t):
            return 0
        steps = np.diff(t, prepend=t[0] if self._newest is None else self._newest)
        self._newest = float(t[-1])
        if len(self._steps) < _STEPS:
            self._steps += steps[steps > 0.0][: _STEPS - len(self._steps)].tolist()
            self._step = float(np.median(self._steps)) if len(self._steps) == _STEPS else 0.0
            return 0
        return int(np.sum(np.maximum(0.0, np.rint(steps / self._step) - 1.0)))


_STEPS = 100


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

    def converted(self, rows: Array) -> tuple[Array, Array, Array]:
        """Time, output and position in SI, (n,) each, of rows (n, 3)."""
        t = in_seconds(self.table, self.plan, self._clock(), Column(rows[:, 0])).values
        accel, position = (
            in_si(self.table, self.plan, name, self.plan.sources[name], self.declared.rig, rows[:, i])[0]
            for i, name in enumerate(CHANNELS, 1)
        )
        return t, accel, position

    def _clock(self) -> Clock:
        clock = self.plan.sources["accel"].time
        assert clock is not None  # `of` found it
        return clock


def _require_lines(declared: Sidecar, source: str) -> None:
    """Refuse what lines of three fields cannot be."""
    for found, what in (
        (declared.attitude is not None, "[channels.attitude]"),
        (declared.time is not None and declared.time.rate is not None, "[channels] rate"),
        (bool(set(declared.channels) - set(CHANNELS)), ", ".join(sorted(set(declared.channels) - set(CHANNELS)))),
    ):
        if found:
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
