"""The dialect of a text table, read off its first lines: what separates the cells, how columns and units are called,
and instants as loggers write them: ISO 8601, time of day, and dates in other orders."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from accelcal.data import RecordingError, units
from accelcal.data.arrays import Array, Flags
from accelcal.io import naming
from accelcal.io.table import DATES, MOST_COLUMNS, Column, Order, from_arrow


@dataclass(frozen=True, slots=True)
class Dialect:
    """How the rows of one table are written."""

    delimiter: str
    decimal: str
    width: int
    """Cells per row."""
    columns: tuple[str, ...]
    """Column names; a column without one is called by its number, counted from 1."""
    units: Mapping[str, str]
    """From the unit row, and the length unit of a motion capture; empty when there is none."""
    rate: float | None
    """Hz, where the lines above the header state it and no column has the time."""
    start: int
    """Where the first row of numbers begins, in bytes."""
    end: int | None
    """Where the last ends; None = with the file."""
    first_line: int
    """The line number of the first row, counted from 1."""
    stamps: Mapping[str, str]
    """Columns of instants, and their form; that of dates alone is `DATES`."""
    texts: frozenset[str]
    """Columns that hold neither numbers nor instants."""
    key: int
    """Place of the first column of numbers or instants: a row without one there is no reading."""
    cut: tuple[str, ...]
    """Lines above a header that is preceded by rows: the end of a row whose beginning was lost."""
    named: bool
    """Whether the columns have a header."""


HEAD = 1 << 18
"""Bytes; a preamble and some hundred rows fit in."""
LONGEST_LINE = 1 << 16
"""Bytes; a row of numbers is far shorter, a file without line ends is longer."""
COMMENT = ("#", "%", "//")
_COMMENT_BYTES = tuple(mark.encode() for mark in COMMENT)
_LONGEST_NUMBER = 40  # characters of a cell; a longer one is no number and no stamp
_NUMBER = {
    ".": re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE | re.ASCII),
    ",": re.compile(r"[+-]?(?:(?:\d+,?\d*|,\d+)(?:[eE][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE | re.ASCII),
}
_DIALECTS = [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", "."), ("|", ",")]
_ROWS = 10
"""Rows of numbers from which on lines are a table, and not a summary."""
_END_OF_HEADER = b"***End_of_Header***"
"""What LabVIEW writes below the header of a file, and again below that of its numbers."""
_MOST_LABELS = 60
"""Lines in which it stands."""
_MOST_HEADER = 20
"""Lines above the rows of numbers of a second table."""
_RATE = re.compile(
    r"(?:(?:export|capture|camera|sampl\w*|frame|scan|acquisition|output|data) )*(?:rate|frequency)(?: [\[(]hz[\])])?"
)
"""Keys in lower case that state a rate; that of a line, in baud, is none."""
_KINDS = {"rigid body", "rigid body marker", "marker", "bone", "bone marker", "type", "id"}
"""What a motion capture calls kinds of things: such a row of a header tells nothing that their names do not."""


def decoded(line: bytes) -> str:
    """A line as text, UTF-8 or Latin-1, without a carriage return."""
    line = line.removesuffix(b"\r")
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def lines_of(data: bytes, start: int = 0, end: int | None = None) -> Iterator[tuple[int, str]]:
    """Yield (offset in bytes, text) of each line from `start` on, without its line end."""
    last = len(data) if end is None else end
    while start < last:
        stop = data.find(b"\n", start, last)
        stop = last if stop < 0 else stop
        yield start, decoded(data[start : min(stop, start + LONGEST_LINE + 1)])
        start = stop + 1


def cells_in(text: str, delimiter: str) -> list[str]:
    """The cells of a line, without spaces around them."""
    if '"' in text:
        return [cell.strip() for cell in next(csv.reader([text.replace("\r", " ")], delimiter=delimiter))]
    return [cell.strip() for cell in text.split(delimiter)]


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number."""
    return len(cell) <= _LONGEST_NUMBER and _NUMBER[decimal].fullmatch(cell) is not None


def is_value(cell: str, decimal: str) -> bool:
    """Whether a cell is a number or an instant."""
    return is_number(cell, decimal) or form_of(cell) is not None


def recognise(
    path: Path, data: bytes, start: int, end: int | None, *, whole: bool, reserved: Collection[str]
) -> Dialect:
    """Read the dialect of the table between two offsets off its first lines.

    Parameters
    ----------
    data : the file, or its beginning.
    whole : whether the last line of `data` is not cut.
    reserved : names of the columns of tables above it, which its own do not repeat.

    Raises
    ------
    RecordingError
        If there are no rows of numbers, or header and rows do not agree.
    """
    skipped = data.count(b"\n", 0, start)
    lines = _first_lines(path, data, start, len(data) if end is None else end, whole or end is not None, skipped)
    content = [k for k, line in enumerate(lines) if line.strip(b" \t,;|\r") and not line.startswith(_COMMENT_BYTES)]
    tail = [decoded(lines[k]) for k in content[-50:]]
    delimiter, decimal, width = _separators(tail)
    if width > MOST_COLUMNS:
        raise RecordingError(
            f"{path}: {width} columns, expected at most {MOST_COLUMNS}; export those that are needed, one per channel."
        )
    numeric = _value_columns(tail, delimiter, decimal, width)
    ends = [n for n, k in enumerate(content[:_MOST_LABELS]) if lines[k].startswith(_END_OF_HEADER)][:2]
    candidates = ((n, decoded(lines[content[n]])) for n in range(ends[-1] if ends else 0, len(content)))
    rows = (n for n, text in candidates if _is_data(text, delimiter, decimal, width, numeric))
    first = next(rows, None)
    if first is None:
        raise RecordingError(
            f"{path}: no row of numbers among the first {len(lines)} lines; expected a header line, then one row per "
            "sample with comma, semicolon or tab between the cells. Open it in an editor, and export it as such text."
        )
    top = [decoded(lines[k]) for k in content[: first + _MOST_HEADER]]
    below = None if first else _header_below_cut(top, delimiter, decimal, width)
    after = None if below is None else next((n for n in rows if n > below), None)
    first = after or first
    at, above = content[first], content[first - 1] if first else 0
    texts = [decoded(line) for line in lines[: at + 1]]
    if (hidden := _table_among([texts[k] for k in content[: 0 if after else first]])) is not None:
        raise RecordingError(f"{path}: {second_table(skipped + content[hidden] + 1)}")
    if first and any(is_value(cell, decimal) for cell in cells_in(texts[above], delimiter)):
        raise RecordingError(
            f"{path}: row {skipped + above + 1} is neither a header nor like the rows of numbers below it: found "
            f'"{texts[above][:60]}", expected {width} cells; correct or delete this row.'
        )
    header = _header(texts, content[:first], delimiter, decimal, width)
    names, cells = header.names, cells_in(texts[at], delimiter)
    if len(names) > width or (names and any(cells[len(names) :])):
        raise RecordingError(
            f"{path}: the header has {len(names)} columns but row {skipped + at + 1} has {width}; "
            "make them agree (a decimal comma needs semicolons between the cells)."
        )
    columns = tuple((names[k] if k < len(names) else "") or str(k + 1) for k in range(width))
    columns = tuple(f"{header.title or 'table 2'}.{name}" if name in reserved else name for name in columns)
    timed = any(naming.role(naming.take_apart(name).base) == "time" for name in columns)
    begin = above + 1 if first and names else at  # rows without any reading may stand between header and first numbers
    return Dialect(
        delimiter=delimiter,
        decimal=decimal,
        width=width,
        columns=columns,
        units={columns[k]: unit for k, unit in enumerate(header.units[:width]) if unit},
        rate=None if timed else header.rate,
        start=start + sum(len(line) + 1 for line in lines[:begin]),
        end=end,
        first_line=skipped + begin + 1,
        stamps={columns[k]: form if ":" in cell else DATES for k, cell in enumerate(cells) if (form := form_of(cell))},
        texts=frozenset(columns[k] for k in range(width) if k not in numeric),
        key=min(numeric, default=0),
        cut=tuple(top[:below]) if after else (),
        named=bool(names),
    )


def _first_lines(path: Path, data: bytes, start: int, stop: int, whole: bool, skipped: int) -> list[bytes]:
    """The first lines of a table, with their carriage returns, without one that is cut."""
    lines = data[start : min(stop, start + HEAD)].split(b"\n")
    long = next((k for k, line in enumerate(lines, start=1) if len(line) > LONGEST_LINE), None)
    if long is not None:
        raise RecordingError(f"{path}: {too_long(skipped + long)}")
    return lines[:-1] if stop > start + HEAD or not whole or not lines[-1] else lines


def too_long(number: int) -> str:
    """The sentence on a row that is too long."""
    return f"row {number} is longer than {LONGEST_LINE} characters; export the file with one row per sample."


def second_table(number: int) -> str:
    """The sentence on a table that begins where no empty line is."""
    return f"a second table begins at row {number}; put an empty line above that row, and both tables are read."


def _separators(rows: list[str]) -> tuple[str, str, int]:
    """Choose delimiter and decimal mark under which most rows have the same width and most cells are numbers."""
    best, chosen = 0.0, (",", ".", 1)
    for delimiter, decimal in _DIALECTS:
        split = [cells_in(text, delimiter) for text in rows]
        width = Counter(map(len, split)).most_common(1)[0][0] if split else 1
        regular = [row for row in split if len(row) == width]
        filled = [cell for row in regular for cell in row if cell]
        share = sum(is_value(cell, decimal) for cell in filled) / max(len(filled), 1)
        score = share * len(regular) / max(len(rows), 1)
        if width > 1 and score > best:
            best, chosen = score, (delimiter, decimal, width)
    return chosen


def _value_columns(rows: list[str], delimiter: str, decimal: str, width: int) -> list[int]:
    """Return the columns that hold numbers or stamps in most of the lower half of `rows`; the header is above."""
    split = [row for row in [cells_in(text, delimiter) for text in rows[len(rows) // 2 :]] if len(row) == width]
    return [
        k
        for k in range(width)
        if 2 * sum(is_value(row[k], decimal) for row in split) > sum(1 for row in split if row[k])
    ]


def _is_data(text: str, delimiter: str, decimal: str, width: int, numeric: list[int]) -> bool:
    cells = cells_in(text, delimiter)
    if len(cells) != width:
        return False
    filled = [cells[k] for k in numeric if cells[k]]
    return 2 * sum(is_value(cell, decimal) for cell in filled) > len(filled)


def are_rows(texts: list[str]) -> bool:
    """Whether lines are rows of numbers of one table, and enough of them to be one."""
    delimiter, decimal, width = _separators(texts)
    numeric = _value_columns(texts, delimiter, decimal, width)
    return len(texts) >= _ROWS and width > 1 and all(_is_data(t, delimiter, decimal, width, numeric) for t in texts)


def begins_table(data: bytes, at: int) -> bool:
    """Whether a header and rows of numbers begin at an offset."""
    texts = [text for _, text in islice(lines_of(data, at), _MOST_HEADER + _ROWS)]
    return bool(texts) and not _is_row(texts[0]) and are_rows(texts[-_ROWS:])


def _is_row(text: str) -> bool:
    """Whether a line by itself has more numbers than words."""
    delimiter, decimal, _ = _separators([text])
    filled = [cell for cell in cells_in(text, delimiter) if cell]
    return 2 * sum(is_value(cell, decimal) for cell in filled) > len(filled)


def _table_among(texts: list[str]) -> int | None:
    """The line after a table that stands among the lines above another one, counted from 0."""
    ends = (k for k in range(_ROWS, len(texts)) if _is_row(texts[k - 1]) and not _is_row(texts[k]))
    return next((k for k in ends if are_rows(texts[k - _ROWS : k])), None)


def _header_below_cut(texts: list[str], delimiter: str, decimal: str, width: int) -> int | None:
    """The header of a file that begins with the end of a row, or with words of its logger, counted from 0."""
    for k, text in enumerate(texts[1:], start=1):
        cells = cells_in(text, delimiter)
        if len(cells) == width and all(cells) and not any(is_value(cell, decimal) for cell in cells):
            return k
    return None


@dataclass(frozen=True, slots=True)
class _Header:
    """What the lines above the rows of numbers say."""

    names: list[str]
    units: list[str]
    rate: float | None
    """Hz"""
    title: str
    """The line that names the table."""


def _header(texts: list[str], content: list[int], delimiter: str, decimal: str, width: int) -> _Header:
    """Read the lines above the first row of numbers, which is the last one.

    `content` are the lines above that are neither empty nor comments. A header that was written as a comment
    (numpy.savetxt does that) counts when nothing else can be one.
    """
    plain = [_trimmed(cells_in(texts[i], delimiter)) for i in content]
    commented = [
        _trimmed(cells_in(text.lstrip("#%/ "), delimiter)) for i, text in enumerate(texts[:-1]) if i not in content
    ]
    stated = _stated(plain)
    rate = _rate(stated, plain if any("Frame" in row for row in plain) else [], decimal)
    title = next((row[0] for row in plain if len(row) == 1 and not is_number(row[0], ".")), "")
    rows = (
        plain if plain and (len(plain[-1]) > 1 or width == 1) else [cells for cells in commented if len(cells) == width]
    )
    if not rows:
        return _Header([], [], rate, title)
    named = []
    if len(rows) > 1 and len(rows[-1]) <= len(rows[-2]) <= width and _is_unit_row(rows[-1]):
        named = [cell.strip("[]() ") if cell != "-" else "1" for cell in rows[-1]]
        rows = rows[:-1]
    names = rows[-1]
    if len(names) == width + 1 and names[-1] == "Comment":  # of LabVIEW, whose rows have none
        names = names[:-1]
    if len({*names}) < len(names):
        names, kinds = _joined(rows, decimal, width)
        length = stated.get("length units", [""])[0]
        named = named or [length if "position" in kind else "" for kind in kinds]
    labels = stated.get("y_unit_label")
    if labels is not None and not named:
        timed = names[0] == "X_Value" and cells_in(texts[-1], delimiter)[0] != ""  # LabVIEW may leave the time out
        named = ["s" if timed else "", *labels]
        names = names if timed else ["", *names[1:]]
    return _Header(names, named, rate, title)


def _stated(rows: list[list[str]]) -> dict[str, list[str]]:
    """What key rows say, by key in lower case: all cells that follow it in the row."""
    return {row[k].lower(): row[k + 1 :] for row in rows for k in range(0, len(row) - 1, 2) if row[k]}


def _rate(stated: Mapping[str, list[str]], rows: list[list[str]], decimal: str) -> float | None:
    """The rate in lines above a header, Hz: by its key, or by a number alone below the title of a motion capture."""
    named = [values[0] for key, values in stated.items() if _RATE.fullmatch(key)]
    alone = [below[0] for row, below in pairwise(rows) if len(row) == len(below) == 1]
    steps = stated.get("delta_x", [])[:1]
    rates = [1.0 / step for step in _values(steps, decimal) if step]
    rates = [*_values([*alone, *named], decimal), *rates]
    return next((rate for rate in reversed(rates) if 0.0 < rate < float("inf")), None)


def _values(cells: Iterable[str], decimal: str) -> list[float]:
    """The numbers among cells of a preamble, with a point or with the decimal mark of the rows below it."""
    return [float(cell.replace(decimal, ".")) for cell in cells if is_number(cell, ".") or is_number(cell, decimal)]


def _joined(rows: list[list[str]], decimal: str, width: int) -> tuple[list[str], list[set[str]]]:
    """Names made of the rows of a header that tell columns apart, as ``Sled.Position.X``, where the last one repeats.

    Returns
    -------
    The names, and for each all cells above it in lower case.
    """
    names = [*rows[-1], *[""] * (width - len(rows[-1]))]
    first = next(k for k, name in enumerate(names) if name and names.count(name) > 1)
    upper: list[list[str]] = []
    for cells in reversed(rows[:-1]):
        if len(cells) < 2 or len(cells) > width or any(is_value(cell, decimal) for cell in cells):
            break
        filled: list[str] = []
        for k in range(width):
            cell = cells[k] if k < len(cells) else ""
            filled.append(cell or (filled[-1] if k > first else ""))
        upper.insert(0, filled)
    kinds = [{row[k].lower() for row in upper} for k in range(width)]
    ranked = sorted(upper, key=lambda row: {cell.lower() for cell in row[first:] if cell} <= _KINDS)
    used: list[list[str]] = []
    for row in ranked:
        more = [other for other in upper if other in used or other is row]
        if len({*zip(names, *more, strict=True)}) > len({*zip(names, *used, strict=True)}):
            used = more
    joined = [".".join(filter(None, [*(row[k] for row in used), name])) for k, name in enumerate(names)]
    return [*names[:first], *joined[first:]], kinds


def _trimmed(cells: list[str]) -> list[str]:
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells


def _is_unit_row(cells: list[str]) -> bool:
    filled = [cell for cell in cells if cell]
    named = [units.is_unit(cell.strip("[]() ")) for cell in filled]
    return any(named) and 2 * sum(named) + 2 * filled.count("-") > len(filled)


DAY = 86400.0
"""s"""
_ISO = re.compile(r"\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d(?:[.,]\d+)?)?)?(?:Z|[+-]\d\d:?\d\d)?", re.ASCII)
_DATE = r"(?P<a>\d{1,4})(?P<mark>[./-])(?P<b>\d{1,2})[./-](?P<c>\d{2,4})"
_CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(?::(?P<second>\d\d(?:[.,:]\d{1,9})?))?(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?"
_OF_DAY = re.compile(_CLOCK, re.ASCII)
_DATED = re.compile(rf"{_DATE}(?:[T ]+{_CLOCK})?", re.ASCII)
_MOST = 40
"""Characters of an instant."""


def form_of(cell: str) -> str | None:
    """How an instant is written: as ISO 8601, another date, or a time of day; None of what is none.

    The numbers in it may be none of a calendar.
    """
    forms = (("ISO", _ISO), ("time of day", _OF_DAY), ("date", _DATED)) if len(cell) <= _MOST else ()
    return next((name for name, form in forms if form.fullmatch(cell)), None)


def is_instant(cell: str) -> bool:
    """Whether a cell is an instant of a calendar."""
    form = form_of(cell)
    try:
        if form == "ISO":
            datetime.fromisoformat(cell.replace(",", "."))
    except ValueError:
        return False
    return form is not None


def seconds(cells: Any, order: Order | None) -> Column:
    """Turn texts into seconds: of ISO 8601 since the first, of another date since its midnight, of a time of day since
    midnight; a time of day that falls by more than half a day has passed midnight.

    Parameters
    ----------
    cells : pyarrow array of texts, (n,).
    order : of day and month; None = as the dates themselves say.

    Raises
    ------
    pyarrow.ArrowInvalid
        If a cell is no instant, or the order of day and month is open; its text is a sentence.
    """
    import pyarrow as pa
    from pyarrow import compute

    texts = compute.utf8_trim_whitespace(cells)
    given = texts.drop_null()
    form = form_of(given[0].as_py()) if len(given) else "ISO"
    if form == "ISO":
        texts = compute.replace_substring(texts, ",", ".")
        zoned = compute.any(compute.match_substring_regex(texts, r"(Z|[+-]\d\d:?\d\d)$")).as_py()
        return from_arrow(texts.cast(pa.timestamp("ns", tz="UTC" if zoned else None)))
    dated = form == "date"
    parts = compute.extract_regex(given, f"^(?:{(_DATED if dated else _OF_DAY).pattern})$")
    if parts.null_count:
        raise pa.ArrowInvalid("a cell is no instant")

    def numbers(name: str) -> Array:
        texts = compute.replace_substring_regex(parts.field(name), "[,:]", ".")
        blank = compute.equal(texts, "")
        return np.asarray(compute.if_else(blank, "0", texts).cast(pa.float64()))

    half = np.asarray(parts.field("half").to_numpy(zero_copy_only=False), dtype=str)
    hour = np.where(half == "", numbers("hour"), numbers("hour") % 12 + 12 * np.char.equal(np.char.lower(half), "p"))
    if np.any(hour > 24) or np.any(numbers("minute") > 59) or np.any(numbers("second") >= 61):
        raise pa.ArrowInvalid("a cell is no time of day")
    t = 3600.0 * hour + 60.0 * numbers("minute") + numbers("second")
    origin = None
    if dated:
        days = _days(numbers("a"), numbers("b"), numbers("c"), order or _order_of(given, parts, numbers))
        origin = int(DAY * days[0]) * 10**9
        t = DAY * (days - days[0]) + t
    else:
        t = t + DAY * np.cumsum(np.diff(t, prepend=t[:1]) < -0.5 * DAY)
    if not texts.null_count:
        return Column(t, origin=origin)
    present: Flags = np.asarray(compute.is_valid(texts).to_numpy(zero_copy_only=False), dtype=np.bool_)
    values = np.full(len(present), np.nan)
    values[present] = t
    return Column(values, present, origin)


def _order_of(given: Any, parts: Any, numbers: Any) -> Order:
    """The order of day and month in dates: by their mark or a number above 12; any where the day never changes."""
    import pyarrow as pa

    a, b = numbers("a"), numbers("b")
    if parts.field("mark")[0].as_py() == "." or a.max() > 12:
        return "DMY"
    if b.max() > 12 or (np.ptp(a) == 0 and np.ptp(b) == 0):
        return "MDY"
    i = int(np.argmax((a != a[0]) | (b != b[0])))
    raise pa.ArrowInvalid(
        f'"{given[0].as_py()}" and "{given[i].as_py()}": the order of day and month is open; say it beside the column '
        'in the sidecar: time = { column = "...", order = "DMY" } or order = "MDY"'
    )


def _days(a: Array, b: Array, c: Array, order: Order) -> Array:
    """Days since 1970 of dates whose year comes first or last."""
    import pyarrow as pa

    year, month, day = (a, b, c) if a[0] > 31 else (c, a, b) if order == "MDY" else (c, b, a)
    year = np.where(year < 100, year + 2000, year)
    if np.any((month < 1) | (month > 12) | (day < 1) | (day > 31)):
        raise pa.ArrowInvalid(f"a date has no such day or month in the order {order}")
    months = (year.astype(int) - 1970) * 12 + month.astype(int) - 1
    days: Array = months.astype("datetime64[M]").astype("datetime64[D]").astype(float) + day - 1.0
    return days
