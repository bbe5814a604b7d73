"""How text reaches a terminal: names and sentences from files are shown, never obeyed, and never read as mark-up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from accelcal._support.plain_text import visible

if TYPE_CHECKING:
    from rich.text import Text


def say(text: str, style: str = "") -> None:
    """Print a sentence on stdout, wrapped at the width of the terminal."""
    from rich.console import Console
    from rich.text import Text

    Console().print(Text(visible(text), style=style))


def say_line(text: str, end: str = "\n", *, flush: bool = False) -> None:
    """Print a line on stdout as it is, however long; `flush` shows it at once in a pipe as well."""
    print(visible(text), end=end, flush=flush)


def say_card(markdown: str) -> None:
    """Print the card of an effect: its heading in bold, its lines indented and wrapped, no marks of Markdown."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    console = Console()
    for line in visible(markdown).splitlines():
        if line.startswith("## "):
            console.print(Text(line.removeprefix("## "), style="bold"))
        elif line.startswith("- "):
            label, colon, rest = line.removeprefix("- ").partition(": ")
            console.print(Padding(Text.assemble((label, "bold"), colon, rest), (0, 0, 0, 2)))
        else:
            console.print(Text(line))


def show_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table in full: wider than the terminal rather than with truncated numbers."""
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Column, Table

    table = Table(*(Column(name, no_wrap=True) for name in map(_cell, head)), box=None, pad_edge=False)
    for row in rows:
        table.add_row(*map(_cell, row))
    console = Console()
    needed = Measurement.get(console, console.options.update(max_width=1000), table).maximum
    Console(width=max(console.width, needed)).print(table)


def show_wrapped_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table whose last column is text that may wrap."""
    from rich.console import Console
    from rich.table import Table

    table = Table(*head, box=None)
    for row in rows:
        table.add_row(*map(_cell, row))
    Console().print(table)


def _cell(text: str) -> Text:
    from rich.text import Text

    return Text(visible(text, one_line=True))
