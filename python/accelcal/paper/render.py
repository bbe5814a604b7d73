"""The reproduction as text."""

from __future__ import annotations

from collections.abc import Iterable
from io import StringIO
from typing import TYPE_CHECKING

from accelcal.paper.rows import Item

if TYPE_CHECKING:
    from rich.table import Table


def render(items: Iterable[Item], *, width: int = 160) -> str:
    """Tables of what is claimed, expected and measured; then the claims that do not hold, first the paper's, then ours.

    Parameters
    ----------
    items : iterable of Item
    width : int
        Characters per line.
    """
    from rich.console import Console

    items = tuple(items)
    console = Console(file=StringIO(), width=width, highlight=False)
    for item in items:
        console.print(_table(item))
        console.print()
    rows = [row for item in items for row in item.rows]
    for by, whose in (("paper", "the paper's"), ("us", "our own")):
        claims = [row for row in rows if row.by == by]
        failed = [row for row in claims if not row.holds]
        console.print(f"{len(claims) - len(failed)} of {whose} {len(claims)} claims hold in these runs.")
        for row in failed:
            remark = f" ({row.remark})" if row.remark else ""
            text = f"  does not hold: {row.claim}: expected {row.expected}, measured {row.measured}{remark}"
            console.print(text, markup=False)
    file = console.file
    assert isinstance(file, StringIO)
    return file.getvalue()


def _table(item: Item) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(f"{item.title} [{item.source}]"), title_justify="left")
    for column in ("claim", "by", "expected", "measured", "n", "threshold", "holds", "remark"):
        table.add_column(column, justify="right" if column == "n" else "left")
    for row in item.rows:
        cells = (row.claim, row.by, row.expected, row.measured, str(row.n), row.threshold, _mark(row.holds), row.remark)
        table.add_row(*(escape(cell) for cell in cells))
    return table


def _mark(holds: bool) -> str:
    return "yes" if holds else "NO"
