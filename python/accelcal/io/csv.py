"""Text tables: the dialect of each is read off its first lines, and pyarrow reads the bulk."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice, takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelcal.data import Finding, RecordingError
from accelcal.io import dialect as instants, naming
from accelcal.io.dialect import (
    COMMENT,
    HEAD,
    LONGEST_LINE,
    Dialect,
    are_rows,
    begins_table,
    cells_in,
    is_number,
    is_value,
    lines_of,
    recognise,
    second_table,
    too_long,
)
from accelcal.io.table import Column, Order, Table, from_arrow


def open_csv(path: Path) -> Table:
    """Open a text table.

    Preamble and comment lines (``#``, ``%``, ``//``), several header rows, a unit row under the header, a byte-order
    mark, Latin-1, UTF-16, comma, semicolon, tab or bar between cells, decimal comma, instants (they become seconds),
    quoted cells, trailing delimiters, empty lines, the prefix of a serial monitor and a second table below an empty
    line are all understood. Few lines that are no readings are left out and counted. Nothing else is repaired.

    Raises
    ------
    RecordingError
        If the file is not text or holds no rows of numbers.
    """
    with path.open("rb") as file:
        head = file.read(HEAD)
        whole = not file.read(1)
    head = _as_text_bytes(path, head)
    tables, data = _tables(path, head, whole=whole)
    text = _Text(path, tables, data)
    declared = {name: unit for dialect in tables for name, unit in dialect.units.items()}
    stamps = {name: form for dialect in tables for name, form in dialect.stamps.items()}
    return Table(
        path,
        tuple(name for dialect in tables for name in dialect.columns),
        text.read,
        text.row,
        declared | dict.fromkeys(stamps, "s"),
        "the unit row",
        {name: clock for dialect in tables for name, clock in _clocks(dialect, alone=len(tables) == 1)},
        stamps,
        frozenset().union(*(dialect.texts for dialect in tables)),
        text.notes,
        text.orders,
        text.text,
    )


_PREFIX = re.compile(rb"(?m)^(?:\d\d?:\d\d:\d\d(?:[.,]\d{1,9})? ?->|\[[0-9T:., /+-]{5,40}\]) ?")
"""What a serial monitor puts in front of each line."""
_SAMPLE = 1 << 12
"""Bytes by which a prefix is told."""
_LEFT_OUT = 0.01
"""Share of lines without a number that may stand between the readings."""
_AT_ENDS = 50
"""Lines that are no readings at the beginning, or at the end."""


def _as_text_bytes(path: Path, data: bytes) -> bytes:
    """Return `data` as UTF-8 or Latin-1 without byte-order mark and prefix of a monitor; refuse what is not text."""
    for mark, encoding in ((b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        if data.startswith(mark):
            data = data[2 : len(data) - len(data) % 2].decode(encoding, errors="replace").encode()
    data = data.removeprefix(b"\xef\xbb\xbf")
    sample = data[:LONGEST_LINE]
    if b"\0" in sample or len(re.findall(rb"[\x01-\x08\x0e-\x1f]", sample)) > len(sample) // 100:
        raise RecordingError(
            f"{path}: this is not text but binary data of no known format; "
            "export the recording as CSV (UTF-8), Parquet, MAT, npz or HDF5."
        )
    sample = data[:_SAMPLE]
    return _PREFIX.sub(b"", data) if 2 * len(_PREFIX.findall(sample)) > sample.count(b"\n") > 1 else data


def _tables(path: Path, head: bytes, *, whole: bool) -> tuple[list[Dialect], bytes]:
    """The tables of a file, and all its bytes; each table but the first has a header of its own."""
    starts, tables = _starts(head), list[Dialect]()
    data = head
    if not whole:
        if not starts:  # what is no table is refused before all of it is read
            tables.append(recognise(path, head, 0, None, whole=False, reserved=()))
        data = _as_text_bytes(path, path.read_bytes())
        starts = _starts(data)
    if tables and not starts:
        return tables, data
    tables = [recognise(path, data, 0, starts[0] if starts else None, whole=True, reserved=())]
    for start, end in zip(starts, [*starts, None][1:], strict=True):
        with suppress(RecordingError):
            table = recognise(path, data, start, end, whole=True, reserved=())
            if table.named and table.columns != tables[-1].columns:
                reserved = {name for dialect in tables for name in dialect.columns}
                tables.append(recognise(path, data, start, end, whole=True, reserved=reserved))
                continue
        tables[-1] = replace(tables[-1], end=end)  # rows that go on below a message, or below their header again
    return tables, data


def _starts(data: bytes) -> list[int]:
    """Offsets at which a further table begins: below an empty line, with a header of its own."""
    line_end = b"\r\n" if b"\r" in data[:_SAMPLE] else b"\n"
    starts: list[int] = []
    at = data.find(b"\n" + line_end)
    while at >= 0:
        begin = at + 1 + len(line_end)
        if data.startswith(line_end, begin):  # further empty lines
            at += len(line_end)
            continue
        above = [text for _, text in lines_of(data, max(0, at - _SAMPLE), at)][-10:]
        if are_rows(above) and begins_table(data, begin):
            starts.append(begin)
        at = data.find(b"\n" + line_end, begin)
    return starts


def _clocks(dialect: Dialect, *, alone: bool) -> Iterator[tuple[str, str | float]]:
    """The clock of each column that the file itself says: a stated rate, or the time in the same one of its tables."""
    times = [name for name in dialect.columns if naming.role(naming.take_apart(name).base) == "time"]
    clock = dialect.rate if not times else None if alone else times[0]
    if clock is not None:
        yield from ((name, clock) for name in dialect.columns if name not in times)


class _Text:
    """The rows of a text file, and which of its lines are no readings."""

    def __init__(self, path: Path, tables: Sequence[Dialect], data: bytes) -> None:
        self.path = path
        self.tables = tables
        self._opened: bytes | None = data
        """The file as it was opened, for the first who reads it."""
        self.left_out: dict[int, str] = {}
        """Lines that are no readings, by their number from 1."""
        self.notes: list[Finding] = []
        self.orders: dict[str, Order] = {}
        """Of day and month, by column."""
        self._say([text for dialect in tables for text in dialect.cut], "above the header")

    def row(self, i: int) -> str:
        """Name the i-th row; of several tables, that of its own."""
        if len(self.tables) > 1:
            return f"row {i + 1} of its table"
        number, _, _ = next(islice(self._rows(self._data(), self.tables[0]), i, None))
        return f"row {number}"

    def read(self, names: Sequence[str]) -> Mapping[str, Column]:
        """Columns of numbers, instants in seconds."""
        data, columns = self._data(), dict[str, Column]()
        for dialect in self.tables:
            inside = [name for name in names if name in dialect.columns]
            if inside:
                columns |= zip(inside, self._cells(data, dialect, inside), strict=True)
        return columns

    def text(self, name: str) -> NDArray[np.str_]:
        """A column of texts, (n,); an empty cell is an empty text."""
        from pyarrow import compute

        data = self._data()
        dialect = next(dialect for dialect in self.tables if name in dialect.columns)
        texts = compute.utf8_trim_whitespace(self._parsed(data, dialect, [name], as_text=True)[0])
        return np.array([cell or "" for cell in texts.to_pylist()], dtype=np.str_)

    def _data(self) -> bytes:
        data, self._opened = self._opened, None
        return data if data is not None else _as_text_bytes(self.path, self.path.read_bytes())

    def _rows(self, data: bytes, dialect: Dialect) -> Iterator[tuple[int, int, str]]:
        """Yield (line number, offset, text) of each row of numbers; the same lines that pyarrow is shown."""
        lines = enumerate(lines_of(data, dialect.start, dialect.end), start=dialect.first_line)
        for number, (at, text) in lines:
            if not text.startswith(COMMENT) and (text or dialect.width == 1) and number not in self.left_out:
                yield number, at, text

    def _cells(self, data: bytes, dialect: Dialect, names: Sequence[str]) -> list[Column]:
        import pyarrow as pa

        for again in (False, True):
            try:
                cells = self._parsed(data, dialect, names)
                return [
                    instants.seconds(cell, self.orders.get(name)) if name in dialect.stamps else from_arrow(cell)
                    for name, cell in zip(names, cells, strict=True)
                ]
            except pa.ArrowInvalid as error:
                if again or not self._leave_out(data, dialect):
                    fault = self._fault(data, dialect, names) or str(error)
                    raise RecordingError(f"{self.path}: {fault}") from None
        raise AssertionError

    def _parsed(self, data: bytes, dialect: Dialect, names: Sequence[str], *, as_text: bool = False) -> list[Any]:
        """The cells of columns as pyarrow arrays, (n,): texts where they are asked for or are instants."""
        import pyarrow as pa
        from pyarrow import csv as arrow_csv

        if self.left_out:
            rows: bytes | memoryview = "\n".join(text for _, _, text in self._rows(data, dialect)).encode()
        else:
            rows = _without_comments(data, dialect.start, dialect.end)
        places = {name: str(dialect.columns.index(name)) for name in (*names, dialect.columns[dialect.key])}
        plain = {name for name in places if name not in dialect.stamps and not (as_text and name in names)}
        types = {place: pa.float64() if name in plain else pa.string() for name, place in places.items()}
        table = arrow_csv.read_csv(
            pa.BufferReader(pa.py_buffer(rows)),
            arrow_csv.ReadOptions(column_names=[str(k) for k in range(dialect.width)]),
            arrow_csv.ParseOptions(delimiter=dialect.delimiter, ignore_empty_lines=dialect.width > 1),
            arrow_csv.ConvertOptions(
                include_columns=list(types),
                column_types=types,
                null_values=_BLANK,
                strings_can_be_null=True,
                decimal_point=dialect.decimal,
                check_utf8=False,
            ),
        )
        return [table.column(places[name]).combine_chunks() for name in names]

    def _leave_out(self, data: bytes, dialect: Dialect) -> bool:
        """Leave out lines that are no readings, where they are few; False where there are none or too many.

        Raises
        ------
        RecordingError
            If one of them is the header of another table.
        """
        rows = [(number, at, text, cells_in(text, dialect.delimiter)) for number, at, text in self._rows(data, dialect)]
        broken = [not self._is_reading(cells, dialect) for _, _, _, cells in rows]
        first = len(list(takewhile(bool, broken)))
        last = len(rows) - len(list(takewhile(bool, reversed(broken))))
        lost: dict[int, str] = {}
        inside = 0
        for k, (number, at, text, cells) in enumerate(rows):
            if not broken[k]:
                continue
            if len(text) > LONGEST_LINE:
                return False
            words = not any(is_value(cell, dialect.decimal) for cell in cells)
            at_end = k < first or k >= last
            repeated = all(name.endswith(cell) for name, cell in zip(dialect.columns, cells, strict=False))
            if words and not repeated and (len(cells) == 1 or all(cells)) and begins_table(data, at):
                ahead = [cells_in(t, dialect.delimiter) for _, _, t, _ in rows[k + 1 : k + 4]]
                if len(cells) == dialect.width or any(len(more) != dialect.width for more in ahead):
                    raise RecordingError(f"{self.path}: {second_table(number)}")
            if not words and not (at_end and len(cells) <= dialect.width):
                return False
            lost[number] = text
            inside += not at_end
        if not lost or inside > _LEFT_OUT * len(rows) or max(first, len(rows) - last) > _AT_ENDS or first >= len(rows):
            return False
        self.left_out |= lost
        self._say(list(lost.values()), f"row{'s' * (len(lost) > 1)} {_some([str(number) for number in lost])}")
        return True

    def _is_reading(self, cells: list[str], dialect: Dialect) -> bool:
        """Whether a row has all cells, and a number or nothing in the first column of numbers."""
        return len(cells) == dialect.width and (not cells[dialect.key] or is_value(cells[dialect.key], dialect.decimal))

    def _say(self, lines: Sequence[str], where: str) -> None:
        """Note lines that were left out."""
        if lines:
            count = (
                "1 line that is no reading is" if len(lines) == 1 else f"{len(lines)} lines that are no readings are"
            )
            some = _some([f'"{line[:40]}"' for line in dict.fromkeys(lines)])
            text = f"{count} left out ({where}): {some}"
            self.notes.append(Finding("left_out_lines", "", len(lines), 0.0, text, "warning"))

    def _fault(self, data: bytes, dialect: Dialect, names: Sequence[str]) -> str | None:
        """Find the first row that cannot be read, slowly, and say what is wrong with it."""
        places = {name: dialect.columns.index(name) for name in names}
        short = [
            number
            for number, _, text in self._rows(data, dialect)
            if len(text) <= LONGEST_LINE and len(cells_in(text, dialect.delimiter)) != dialect.width
        ]
        forms: dict[str, str | None] = {}
        for number, at, text in self._rows(data, dialect):
            if len(text) > LONGEST_LINE:
                return too_long(number)
            cells = cells_in(text, dialect.delimiter)
            if len(cells) != dialect.width:
                if begins_table(data, at):
                    return second_table(number)
                others = f", as in {len(short) - 1} more: {_some([str(n) for n in short[1:]])}" if short[1:] else ""
                return (
                    f"row {number} has {len(cells)} cells where the rows before have {dialect.width}{others}; "
                    f"complete or delete {'these rows' if others else 'this row'}."
                )
            for name, place in places.items():
                cell = cells[place]
                stamp = name in dialect.stamps
                form = forms.setdefault(name, instants.form_of(cell)) if stamp and cell else None
                same = instants.is_instant(cell) and instants.form_of(cell) == form
                if cell and not (same if stamp else is_number(cell, dialect.decimal)):
                    expected = "an ISO 8601 date and time, or an instant like those before" if stamp else "a number"
                    return (
                        f'row {number}, column "{name}": found "{cell[:40]}", expected {expected}; '
                        "correct the cell, or leave it empty if nothing was sampled."
                    )
        return None


_BLANK = [" " * k for k in range(17)]


def _some(items: Sequence[str]) -> str:
    """The first few of several things in a sentence."""
    return ", ".join(items[:3]) + (f" and {len(items) - 3} more" if len(items) > 3 else "")


def _without_comments(data: bytes, start: int, end: int | None) -> bytes | memoryview:
    """Return `data` between two offsets, without the comment lines; a copy is made only when there are any."""
    rows = memoryview(data)[start:end]
    marks = [mark.encode() for mark in COMMENT if mark[:1].encode() in data]  # one byte is looked for ten times as fast
    if all(data.find(b"\n" + mark, max(start - 1, 0), end) < 0 for mark in marks):
        return rows
    return re.sub(rb"(?m)^(?:" + "|".join(COMMENT).encode() + rb")[^\n]*\n?", b"", rows)
