"""Instants as loggers write them: ISO 8601, time of day, and dates in other orders, as seconds."""

from __future__ import annotations

import re
from datetime import datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal.data.arrays import Array
from accelcal.io.table import Column, Order, from_arrow

if TYPE_CHECKING:
    from accelcal.data.arrays import Flags

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
    if dated:
        days = _days(numbers("a"), numbers("b"), numbers("c"), order or _order_of(given, parts, numbers))
        t = DAY * (days - days[0]) + t
    else:
        t = t + DAY * np.cumsum(np.diff(t, prepend=t[:1]) < -0.5 * DAY)
    if not texts.null_count:
        return Column(t)
    present: Flags = np.asarray(compute.is_valid(texts).to_numpy(zero_copy_only=False), dtype=np.bool_)
    values = np.full(len(present), np.nan)
    values[present] = t
    return Column(values, present)


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
