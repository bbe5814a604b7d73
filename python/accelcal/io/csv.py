"""Text tables: the dialect is read off the first lines, and pyarrow reads the bulk."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import Any

from accelcal.data import RecordingError, units
from accelcal.io.table import MOST_COLUMNS, Column, Table, from_arrow


@dataclass(frozen=True, slots=True)
class _Dialect:
    """How the rows of one file are written."""

    delimiter: str
    decimal: str
    width: int
    """Cells per row."""
    columns: tuple[str, ...]
    """Column names; a column without one is called by its number, counted from 1."""
    units: Mapping[str, str]
    """From the unit row; empty when there is none."""
    start: int
    """Where the first row of numbers begins, in bytes."""
    first_line: int
    """The line number of that row, counted from 1."""
    stamps: frozenset[str]
    """Columns of date-time stamps."""


def open_csv(path: Path) -> Table:
    """Open a text table.

    Preamble and comment lines (``#``, ``%``, ``//``), a unit row under the header, a byte-order mark, Latin-1, UTF-16,
    comma, semicolon, tab or bar between cells, decimal comma, ISO 8601 stamps (they become seconds from the first),
    quoted cells, trailing delimiters and empty lines are all understood. Nothing else is repaired.

    Raises
    ------
    RecordingError
        If the file is not text or holds no rows of numbers.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
        whole = not file.read(1)
    head = _as_text_bytes(path, head)
    dialect = _recognise(path, head, whole)

    def row(i: int) -> str:
        number, _ = next(islice(_rows(_as_text_bytes(path, path.read_bytes()), dialect), i, None))
        return f"row {number}"

    declared = dict(dialect.units) | dict.fromkeys(dialect.stamps, "s")
    return Table(path, dialect.columns, lambda names: _read(path, dialect, names), row, declared, "the unit row")


_HEAD = 1 << 18  # bytes; a preamble and some hundred rows fit in
_LONGEST_LINE = 1 << 16  # bytes; a row of numbers is far shorter, a file without line ends is longer
_LONGEST_NUMBER = 40  # characters of a cell; a longer one is no number and no stamp
_COMMENT = ("#", "%", "//")
_NUMBER = {
    ".": re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE | re.ASCII),
    ",": re.compile(r"[+-]?(?:(?:\d+,?\d*|,\d+)(?:[eE][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE | re.ASCII),
}
_STAMP = re.compile(r"\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d(?:[.,]\d+)?)?)?(?:Z|[+-]\d\d:?\d\d)?", re.ASCII)
_DIALECTS = [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", "."), ("|", ",")]


def _as_text_bytes(path: Path, data: bytes) -> bytes:
    """Return `data` as UTF-8 or Latin-1 without a byte-order mark; refuse what is not text."""
    for mark, encoding in ((b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        if data.startswith(mark):
            data = data[2 : len(data) - len(data) % 2].decode(encoding, errors="replace").encode()
    data = data.removeprefix(b"\xef\xbb\xbf")
    sample = data[:_LONGEST_LINE]
    if b"\0" in sample or len(re.findall(rb"[\x01-\x08\x0e-\x1f]", sample)) > len(sample) // 100:
        raise RecordingError(
            f"{path}: this is not text but binary data of no known format; "
            "export the recording as CSV (UTF-8), Parquet, MAT, npz or HDF5."
        )
    return data


def _decode(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _lines(data: bytes, start: int = 0) -> Iterator[tuple[int, str]]:
    """Yield (offset in bytes, text) of each line from `start` on, without its line end."""
    while start < len(data):
        end = data.find(b"\n", start)
        end = len(data) if end < 0 else end
        yield start, _decode(data[start : min(end, start + _LONGEST_LINE + 1)].removesuffix(b"\r"))
        start = end + 1


def _rows(data: bytes, dialect: _Dialect) -> Iterator[tuple[int, str]]:
    """Yield (line number, text) of each row of numbers; the same lines that pyarrow is shown."""
    for number, (_, text) in enumerate(_lines(data, dialect.start), start=dialect.first_line):
        if not text.startswith(_COMMENT) and (text or dialect.width == 1):
            yield number, text


def _cells(text: str, delimiter: str) -> list[str]:
    if '"' in text:
        return [cell.strip() for cell in next(csv.reader([text.replace("\r", " ")], delimiter=delimiter))]
    return [cell.strip() for cell in text.split(delimiter)]


def _is_number(cell: str, decimal: str) -> bool:
    return len(cell) <= _LONGEST_NUMBER and _NUMBER[decimal].fullmatch(cell) is not None


def _is_stamp(cell: str) -> bool:
    if len(cell) > _LONGEST_NUMBER:
        return False
    try:
        datetime.fromisoformat(cell.replace(",", "."))
    except ValueError:
        return False
    return _STAMP.fullmatch(cell) is not None


def _is_value(cell: str, decimal: str) -> bool:
    return len(cell) <= _LONGEST_NUMBER and (_is_number(cell, decimal) or _STAMP.fullmatch(cell) is not None)


def _recognise(path: Path, head: bytes, whole: bool) -> _Dialect:
    """Read the dialect off the first bytes; `whole` says that there are no more."""
    lines = list(_lines(head))
    long = next((k for k, (_, text) in enumerate(lines, start=1) if len(text) > _LONGEST_LINE), None)
    if long is not None:
        raise RecordingError(f"{path}: {_too_long(long)}")
    if not whole:
        lines = lines[:-1]  # the last one is cut
    content = [(i, text) for i, (_, text) in enumerate(lines) if text.strip(" \t,;|") and not text.startswith(_COMMENT)]
    tail = [text for _, text in content[-50:]]
    delimiter, decimal, width = _separators(tail)
    if width > MOST_COLUMNS:
        raise RecordingError(
            f"{path}: {width} columns, expected at most {MOST_COLUMNS}; export those that are needed, one per channel."
        )
    numeric = _value_columns(tail, delimiter, decimal, width)
    first = next((k for k, (_, text) in enumerate(content) if _is_data(text, delimiter, decimal, width, numeric)), None)
    if first is None:
        raise RecordingError(
            f"{path}: no row of numbers among the first {len(lines)} lines; expected a header line, then one row per "
            "sample with comma, semicolon or tab between the cells."
        )
    at, row = content[first]
    above, last = content[first - 1] if first else (0, "")
    if any(_is_value(cell, decimal) for cell in _cells(last, delimiter)):
        raise RecordingError(
            f'{path}: row {above + 1} is neither a header nor like the rows of numbers below it: found "{last[:60]}", '
            f"expected {width} cells; correct or delete this row."
        )
    names, unit_row = _header(lines, [i for i, _ in content[:first]], at, delimiter, width)
    if len(names) > width:
        raise RecordingError(
            f"{path}: the header has {len(names)} columns but row {at + 1} has {width}; "
            "make them agree (a decimal comma needs semicolons between the cells)."
        )
    columns = tuple((names[k] if k < len(names) else "") or str(k + 1) for k in range(width))
    stamps = {columns[k] for k, cell in enumerate(_cells(row, delimiter)) if _STAMP.fullmatch(cell)}
    declared = {columns[k]: unit for k, unit in enumerate(unit_row[:width]) if unit}
    start = above + 1 if first and names else at  # rows without any reading may stand between header and first numbers
    return _Dialect(delimiter, decimal, width, columns, declared, lines[start][0], start + 1, frozenset(stamps))


def _separators(rows: list[str]) -> tuple[str, str, int]:
    """Choose delimiter and decimal mark under which most rows have the same width and most cells are numbers."""
    best, chosen = 0.0, (",", ".", 1)
    for delimiter, decimal in _DIALECTS:
        split = [_cells(text, delimiter) for text in rows]
        width = Counter(map(len, split)).most_common(1)[0][0] if split else 1
        regular = [row for row in split if len(row) == width]
        filled = [cell for row in regular for cell in row if cell]
        share = sum(_is_value(cell, decimal) for cell in filled) / max(len(filled), 1)
        score = share * len(regular) / max(len(rows), 1)
        if width > 1 and score > best:
            best, chosen = score, (delimiter, decimal, width)
    return chosen


def _value_columns(rows: list[str], delimiter: str, decimal: str, width: int) -> list[int]:
    """Return the columns that hold numbers or stamps in most of the lower half of `rows`; the header is above."""
    split = [row for row in [_cells(text, delimiter) for text in rows[len(rows) // 2 :]] if len(row) == width]
    return [
        k
        for k in range(width)
        if 2 * sum(_is_value(row[k], decimal) for row in split) > sum(1 for row in split if row[k])
    ]


def _is_data(text: str, delimiter: str, decimal: str, width: int, numeric: list[int]) -> bool:
    cells = _cells(text, delimiter)
    if len(cells) != width:
        return False
    filled = [cells[k] for k in numeric if cells[k]]
    return 2 * sum(_is_value(cell, decimal) for cell in filled) > len(filled)


def _header(
    lines: list[tuple[int, str]], content: list[int], at: int, delimiter: str, width: int
) -> tuple[list[str], list[str]]:
    """Return column names and unit row from the lines above the first row of numbers, which is line `at`.

    `content` are the lines above that are neither empty nor comments. A header that was written as a comment
    (numpy.savetxt does that) counts when nothing else can be one.
    """
    plain = [_trimmed(_cells(lines[i][1], delimiter)) for i in content]
    commented = [_trimmed(_cells(lines[i][1].lstrip("#%/ "), delimiter)) for i in range(at) if i not in content]
    rows = (
        plain if plain and (len(plain[-1]) > 1 or width == 1) else [cells for cells in commented if len(cells) == width]
    )
    if not rows:
        return [], []
    if len(rows) > 1 and len(rows[-1]) <= len(rows[-2]) <= width and _is_unit_row(rows[-1]):
        return rows[-2], [cell.strip("[]() ") if cell != "-" else "1" for cell in rows[-1]]
    return rows[-1], []


def _trimmed(cells: list[str]) -> list[str]:
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells


def _is_unit_row(cells: list[str]) -> bool:
    filled = [cell for cell in cells if cell]
    return 2 * sum(cell == "-" or units.is_unit(cell.strip("[]() ")) for cell in filled) > len(filled)


def _read(path: Path, dialect: _Dialect, names: Sequence[str]) -> Mapping[str, Column]:
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    data = _as_text_bytes(path, path.read_bytes())
    rows = _without_comments(data, dialect.start)
    index = {name: str(place) for name, place in _places(dialect, names).items()}
    types = {index[name]: pa.string() if name in dialect.stamps else pa.float64() for name in names}
    try:
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
        columns = {}
        for name in names:
            cells = table.column(index[name]).combine_chunks()
            columns[name] = from_arrow(_instants(cells) if name in dialect.stamps else cells)
        return columns
    except pa.ArrowInvalid as error:
        raise RecordingError(f"{path}: {_fault(data, dialect, names) or error}") from None


def _places(dialect: _Dialect, names: Sequence[str]) -> dict[str, int]:
    """Where each of the named columns stands, from 0."""
    every = {name: place for place, name in enumerate(dialect.columns)}
    return {name: every[name] for name in names}


_BLANK = [" " * k for k in range(17)]


def _without_comments(data: bytes, start: int) -> bytes | memoryview:
    """Return `data` from `start` on, without the comment lines; a copy is made only when there are any."""
    rows = memoryview(data)[start:]
    if all(data.find(b"\n" + mark.encode(), max(start - 1, 0)) < 0 for mark in _COMMENT):
        return rows
    return re.sub(rb"(?m)^(?:" + "|".join(_COMMENT).encode() + rb")[^\n]*\n?", b"", rows)


def _instants(cells: Any) -> Any:
    """Turn ISO 8601 texts, a pyarrow array, into time stamps."""
    import pyarrow as pa
    from pyarrow import compute

    texts = compute.replace_substring(compute.utf8_trim_whitespace(cells), ",", ".")
    zoned = compute.any(compute.match_substring_regex(texts, r"(Z|[+-]\d\d:?\d\d)$")).as_py()
    return texts.cast(pa.timestamp("ns", tz="UTC" if zoned else None))


def _too_long(number: int) -> str:
    return f"row {number} is longer than {_LONGEST_LINE} characters; export the file with one row per sample."


def _fault(data: bytes, dialect: _Dialect, names: Sequence[str]) -> str | None:
    """Find the first row that cannot be read, slowly, and say what is wrong with it."""
    places = _places(dialect, names)
    for number, text in _rows(data, dialect):
        if len(text) > _LONGEST_LINE:
            return _too_long(number)
        cells = _cells(text, dialect.delimiter)
        if len(cells) != dialect.width:
            return (
                f"row {number} has {len(cells)} cells where the rows before have {dialect.width}; "
                "complete or delete this row."
            )
        for name, place in places.items():
            cell = cells[place]
            stamp = name in dialect.stamps
            if cell and not (_is_stamp(cell) if stamp else _is_number(cell, dialect.decimal)):
                expected = "an ISO 8601 date and time" if stamp else "a number"
                return (
                    f'row {number}, column "{name}": found "{cell[:40]}", expected {expected}; '
                    "correct the cell, or leave it empty if nothing was sampled."
                )
    return None
