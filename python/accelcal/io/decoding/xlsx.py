"""Excel workbooks: each sheet with a header and rows of numbers gives a column for each of its own."""

from __future__ import annotations

import datetime
from itertools import count
from typing import Any

import numpy as np
from python_calamine import CalamineWorkbook

from accelcal.io.decoding.source import Entry, RefusedError, Source, limited, numbers, plain

_ROWS = 3
"""Rows of numbers from which on a sheet is a table."""


def opened(path: str) -> Source:
    """Open a workbook: a column is called by the last row of words above its numbers, elsewhere ``sheet.name``.

    A row of short words below the header are units. Dates become seconds from the first, times of day and durations
    seconds.
    """
    entries: list[Entry] = []
    columns: dict[str, Any] = {}
    book = CalamineWorkbook.from_path(path)
    for sheet in book.sheet_names:
        rows = book.get_sheet_by_name(sheet).to_python()
        first = next((k for k, row in enumerate(rows) if _has_numbers(row)), len(rows))
        if len(rows) - first < _ROWS:
            continue
        words = [row for row in rows[:first] if sum(isinstance(cell, str) and bool(cell) for cell in row) > 1]
        has_units = len(words) > 1 and all(len(str(cell).strip("[]() ")) <= _LONGEST_UNIT for cell in words[-1])
        header = words[-1 - has_units] if words else []
        prefix = f"{sheet}." if entries else ""
        for k, cells in enumerate(zip(*rows[first:], strict=True)):
            values = _values(cells)
            if values is None:
                continue
            name = plain(f"{prefix}{header[k] if k < len(header) and header[k] else k + 1}")
            name = next(other for n in count(1) if (other := name if n == 1 else f"{name} #{n}") not in columns)
            columns[name] = values
            stamps = next((cell for cell in cells if not isinstance(cell, str)), 0.0)
            unit = str(words[-1][k]).strip("[]() ") if has_units else ""
            entries.append(Entry(name, len(values), "s" if not isinstance(stamps, float | int) else unit or None))
    if not entries and book.sheet_names:
        raise RefusedError("no sheet has rows of numbers; expected a header, then one row per sample")
    return Source(limited(entries), lambda name: numbers(columns[name]))


_LONGEST_UNIT = 10
"""Characters of a unit in a row of its own."""


def _has_numbers(row: list[Any]) -> bool:
    """Whether most cells of a row are numbers or dates."""
    filled = [cell for cell in row if cell != ""]
    return 2 * sum(not isinstance(cell, str) for cell in filled) > len(filled)


def _values(cells: tuple[Any, ...]) -> Any:
    """The numbers of a column, NaN where it is empty; None where most cells are words."""
    filled = [cell for cell in cells if cell != ""]
    if not filled or 2 * sum(isinstance(cell, str) for cell in filled) > len(filled):
        return None
    start = next((cell for cell in filled if isinstance(cell, datetime.date)), None)
    values = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        if cell != "":
            values[k] = _number(cell, start)
    return values


def _number(cell: Any, start: Any) -> float:
    """A cell as a number; a date in seconds from another one."""
    if isinstance(cell, datetime.date):
        return float((_moment(cell) - _moment(start)).total_seconds())
    if isinstance(cell, datetime.time):
        return cell.hour * 3600.0 + cell.minute * 60.0 + cell.second + 1e-6 * cell.microsecond
    if isinstance(cell, datetime.timedelta):
        return cell.total_seconds()
    if isinstance(cell, str):
        raise RefusedError(f'has the text "{cell[:40]}" among its numbers; correct the cell, or leave it empty')
    return float(cell)


def _moment(cell: datetime.date) -> datetime.datetime:
    return cell if isinstance(cell, datetime.datetime) else datetime.datetime(cell.year, cell.month, cell.day)
