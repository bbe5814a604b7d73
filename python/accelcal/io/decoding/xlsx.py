"""Excel workbooks: each column of numbers below a header, of every sheet."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date, datetime, time, timedelta
from typing import Any

import numpy as np
from python_calamine import CalamineWorkbook

from accelcal.io.decoding.source import RefusedError, Sampled, Source, opened_channels

_LONGEST_UNIT = 10
"""Characters of a unit in a row of its own."""


def opened(path: str) -> Source:
    """Open a workbook: a column is called by the last row of words above its numbers, elsewhere ``sheet.name``.

    A row of short words below the header are units. Dates become seconds from the first, times of day and durations
    seconds.
    """
    book = CalamineWorkbook.from_path(path)
    sheets = ((name, book.get_sheet_by_name(name).to_python()) for name in book.sheet_names)
    return opened_channels(
        channel for place, (name, rows) in enumerate(sheets) for channel in _channels(f"{name}." if place else "", rows)
    )


def _channels(prefix: str, rows: list[list[Any]]) -> Iterator[Sampled]:
    """The columns of a sheet that begin with a number or an instant."""
    counts = [[isinstance(cell, str) and cell != "" for cell in row] for row in rows]
    first = next((k for k, row in enumerate(rows) if 2 * sum(counts[k]) < sum(cell != "" for cell in row)), len(rows))
    words = [row for k, row in enumerate(rows[:first]) if sum(counts[k]) > 1]
    units = words.pop() if len(words) > 1 and all(len(str(cell)) <= _LONGEST_UNIT for cell in words[-1]) else []
    for k, cells in enumerate(zip(*rows[first:], strict=True)):
        begin = next((cell for cell in cells if cell != ""), "")
        if not isinstance(begin, str):
            unit = str(units[k]).strip("[]() ") if units else None
            unit = unit if isinstance(begin, float | int) else "s"
            name = words[-1][k] if words else ""
            yield Sampled(f"{prefix}{name or k + 1}", len(cells), unit, lambda cells=cells, at=begin: _read(cells, at))  # type: ignore[misc]


def _read(cells: tuple[Any, ...], begin: Any) -> Any:
    """The numbers of a column, (n,), NaN where it is empty, or its dates."""
    numbers = np.array([_number(cell) for cell in cells])
    if not isinstance(begin, date):
        return numbers
    return np.array([np.datetime64("NaT") if np.isnan(s) else round(1e6 * s) for s in numbers], dtype="datetime64[us]")


def _number(cell: Any) -> float:
    """A cell as a number; an instant in seconds."""
    if isinstance(cell, date):
        cell = (cell if isinstance(cell, datetime) else datetime(cell.year, cell.month, cell.day)) - datetime(
            1970, 1, 1
        )
    if isinstance(cell, time):
        cell = datetime.combine(date.min, cell) - datetime.min
    if isinstance(cell, str) and cell:
        raise RefusedError(f'has the text "{cell[:40]}" among its numbers; correct the cell, or leave it empty')
    return cell.total_seconds() if isinstance(cell, timedelta) else float("nan" if cell == "" else cell)
