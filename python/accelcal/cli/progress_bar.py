"""The bar of long work in a terminal: how far it is, and the time that is left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

from accelcal._support.progress import time_left


class _Left(ProgressColumn):
    """What is left, by the share of the work and the time that it took."""

    def render(self, task: Task) -> Text:
        return Text(time_left(task.elapsed or 0.0, task.completed))


@contextmanager
def bar(title: str, console: Console) -> Iterator[Callable[[float], None]]:
    """Show a bar on a terminal while a block runs; it takes the share that is done, 0 to 1, which never falls."""
    with Progress(TextColumn("{task.description}"), BarColumn(), _Left(), console=console, transient=True) as shown:
        task = shown.add_task(title, total=None)
        done = 0.0

        def report(share: float) -> None:
            nonlocal done
            done = max(done, min(1.0, share))
            shown.update(task, completed=done, total=1.0 if done else None)

        yield report
