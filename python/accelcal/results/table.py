"""Tables: rows of plain values, columns that word them, numbers and units in words, renderers for each format.

A renderer may leave out columns in which every cell is empty. It never adds or leaves out a row.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import singledispatch
from html import escape
from typing import TYPE_CHECKING, Any

from accelcal._support.errors import AccelcalError, optional

if TYPE_CHECKING:
    from pandas import DataFrame

Row = Mapping[str, Any]
"""One row: plain values in SI units by key."""
LONGEST_BAR = 150.0
"""Width of the longest bar in HTML, pixels."""
UNBROKEN = 26
"""Characters that a cell of HTML holds in one line; longer texts may break."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table."""

    key: str
    """Name in data; empty for a column that only words other values."""
    head: str = ""
    """Title for people; empty for a column that is in data only."""
    text: Callable[[Row], str] | None = None
    """Wording of a row; by default the value as text."""
    unit: str = ""
    """SI unit of its values, where all rows have the same one."""
    exact: Callable[[Row], float | None] | None = None
    """Number that a worded cell shows, with all its digits, for pages that machines read as well."""
    detail: bool = False
    """Whether a terminal shows it with `--explain` alone: it words again what other columns say, or names the rig."""

    def cell(self, row: Row) -> str:
        """Wording of one row; empty for a value that does not exist."""
        if self.text is not None:
            return self.text(row)
        value = row.get(self.key)
        return "" if value is None else str(value)


@dataclass(frozen=True, slots=True)
class Table:
    """Content that every face shows of a result."""

    title: str
    sentence: str
    columns: tuple[Column, ...] = ()
    rows: tuple[Row, ...] = ()
    notes: tuple[str, ...] = ()
    detail: tuple[str, ...] = ()
    """Further notes: what holds for every run on the rig, what columns mean, more of the same."""
    alarms: tuple[str, ...] = ()
    """Faults of the data and similar sentences, which are read before the rows."""
    bars: tuple[float, ...] = ()
    """Lengths of bars beside the rows in HTML, 1 for the longest; empty without bars."""
    about: Mapping[str, Any] = field(default_factory=dict)
    """Attributes of the data frame."""

    @property
    def shown(self) -> tuple[Column, ...]:
        """Columns that people read, without those in which every cell is empty."""
        return tuple(column for column in self.columns if column.head and any(map(column.cell, self.rows)))

    @property
    def brief(self) -> Table:
        """Table of a narrow page: columns and notes that are no detail."""
        return replace(self, columns=tuple(column for column in self.columns if not column.detail), detail=())

    @property
    def explained(self) -> Table:
        """Table with everything: the further notes follow the others."""
        return replace(self, notes=(*self.notes, *self.detail), detail=())

    @property
    def cells(self) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
        """Titles and worded rows."""
        columns = self.shown
        return tuple(c.head for c in columns), tuple(tuple(c.cell(row) for c in columns) for row in self.rows)

    def __str__(self) -> str:
        return as_text(self)

    def _repr_html_(self) -> str:
        """HTML of the table, as notebooks show it."""
        return as_html(self)

    def with_columns(self, *columns: Column) -> Table:
        """Copy of the table with further columns."""
        return replace(self, columns=(*self.columns, *columns))


@singledispatch
def table(result: object, which: str = "") -> Table:
    """Table of a result; `which` names one beside its first.

    Raises
    ------
    TypeError
        If there is no table of such an object.
    ValueError
        If it has no table of that name.
    """
    raise TypeError(f"a {type(result).__name__} has no table")


def require(which: str, *names: str) -> None:
    """Refuse the name of a table that a result does not have."""
    if which and which not in names:
        expected = f"one of {', '.join(names)}" if names else "no name: it has one table"
        raise AccelcalError(f"there is no table {which!r}; expected {expected}")


def capital(text: str) -> str:
    """A text with a capital, unless it begins with a name: of a file, of a channel, of an effect with more words.

    Examples
    --------
    >>> capital("drift after 5 s"), capital("i.json is better"), capital("data/a.csv: cut"), capital("scale_step: none")
    ('Drift after 5 s', 'i.json is better', 'data/a.csv: cut', 'scale_step: none')
    """
    word = text.partition(" ")[0].rstrip(".,:;")
    return text if any(mark in word for mark in "._/\\") else f"{text[:1].upper()}{text[1:]}"


def as_sentence(text: str) -> str:
    """A text with a capital and a full stop; empty for an empty one."""
    return f"{capital(text).rstrip('.')}." if text else ""


def as_text(shown: Table) -> str:
    """Plain text without details: title, sentence, aligned columns, notes."""
    shown = shown.brief
    head, rows = shown.cells
    lines = aligned(head, rows) if rows else []
    return "\n".join([*filter(None, (shown.title, *shown.alarms, shown.sentence)), *lines, *shown.notes])


def aligned(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table whose columns are as wide as their longest cell."""
    every = [tuple(head), *map(tuple, rows)]
    widths = [max(map(len, cells)) for cells in zip(*every, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in every]


def as_html(shown: Table) -> str:
    """HTML fragment that needs nothing else.

    Everything is escaped, and only opacity is set, no colour, so that light and dark pages both stay readable.
    """
    head, rows = shown.cells
    muted = 'style="opacity:.75;margin:2px 0"'
    strong = [f'<p style="margin:2px 0"><b>{escape(text)}</b></p>' for text in (*shown.alarms, shown.sentence)]
    parts = [f"<p {muted}>{escape(shown.title)}</p>", *strong]
    if rows:
        titles = "".join(_cell(text, "th") for text in ((*head, "") if shown.bars else head))
        body = "".join(
            f"<tr>{''.join(map(_cell, row))}{_bar(shown.bars[k]) if shown.bars else ''}</tr>"
            for k, row in enumerate(rows)
        )
        parts.append(
            f'<table style="border-collapse:collapse;margin:4px 0"><thead><tr>{titles}</tr></thead>'
            f"<tbody>{body}</tbody></table>"
        )
    parts += [f"<p {muted}>{escape(note)}</p>" for note in shown.notes]
    return f'<div class="accelcal" style="overflow-x:auto">{"".join(parts)}</div>'


def _cell(text: str, kind: str = "td") -> str:
    unbroken = ";white-space:nowrap" if len(text) <= UNBROKEN else ""
    return (
        f'<{kind} style="text-align:left;vertical-align:top;padding:2px 14px 2px 0{unbroken}">{escape(text)}</{kind}>'
    )


def _bar(share: float) -> str:
    look = f"width:{LONGEST_BAR * share:.0f}px;height:9px;background:currentColor;opacity:.55"
    return f'<td style="text-align:left;padding:2px 14px 2px 0;vertical-align:middle"><div style="{look}"></div></td>'


def as_frame(shown: Table) -> DataFrame:
    """DataFrame of the values in SI units, the first column as index; units in `attrs["units"]`.

    Raises
    ------
    MissingExtra
        If pandas is not installed.
    """
    columns = [column for column in shown.columns if column.key]
    values = {
        column.key: [math.nan if row.get(column.key) is None else row[column.key] for row in shown.rows]
        for column in columns
    }
    frame = pandas_module().DataFrame(values, columns=[column.key for column in columns]).set_index(columns[0].key)
    frame.attrs = {"units": {column.key: column.unit for column in columns if column.unit}, **shown.about}
    return frame


def pandas_module() -> Any:
    """The module pandas.

    Raises
    ------
    MissingExtra
        If it is not installed.
    """
    return optional("pandas", "a DataFrame needs", "pandas")


def as_view(shown: Table) -> dict[str, Any]:
    """Plain lists for the templates of the report: head, rows, numbers behind the cells, notes."""
    head, rows = shown.cells
    exact = [[None if c.exact is None else c.exact(row) for c in shown.shown] for row in shown.rows]
    return {"head": head, "rows": rows, "exact": exact, "notes": shown.notes}
