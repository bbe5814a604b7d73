"""Widgets shared by all screens: headings, buttons, tables, notes."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from nicegui import ui


class Uploader(ui.upload):
    """An area for files that knows whether some are on their way; its removal would lose them."""

    is_sending = False

    def sends(self, under_way: bool) -> None:
        """Note that files begin to be sent, or that all are here."""
        self.is_sending = under_way


def clear(place: ui.element) -> None:
    """Remove what stands in a place; what files are sent from is hidden until they have come."""
    for child in list(place):
        if any(isinstance(one, Uploader) and one.is_sending for one in child.descendants(include_self=True)):
            child.set_visibility(False)
        else:
            child.delete()


def attribute(text: str) -> str:
    """Text escaped for an attribute of `props`."""
    return html.escape(" ".join(text.split())).replace("\\", "/")


def heading(text: str, level: int = 2) -> ui.label:
    """A heading that screen readers find."""
    return ui.label(text).classes(f"h{level}").props(f"role=heading aria-level={level}")


def button(
    text: str, icon: str, action: Callable[..., Any], *, flat: bool = False, primary: bool = False, label: str = ""
) -> ui.button:
    """A button with a name; only the suggested next step is filled."""
    made = ui.button(text, icon=icon, on_click=action, color="primary" if primary else None)
    made.classes("" if primary else "secondary").props(
        "no-caps " + ("unelevated" if primary else "flat" if flat else "outline")
    )
    if label:
        made.props(f'aria-label="{attribute(label)}"')
    return made


@contextmanager
def card(title: str = "", classes: str = "") -> Iterator[None]:
    """A sheet with a heading."""
    with ui.element("section").classes(f"sheet {classes}"):
        if title:
            heading(title)
        yield


def lines(texts: Sequence[str], kind: str = "note") -> None:
    """Sentences, one a line."""
    for text in texts:
        ui.label(text).classes(kind)


Cell = str | Callable[[], Any]
"""Text, or a function that builds the content of a cell."""


def table(titles: Sequence[str], rows: Sequence[Sequence[Cell]], label: str) -> None:
    """A table; a cell is text, or a function that builds it."""
    name = f'aria-label="{attribute(label)}"'
    with ui.element("div").classes("scroll").props(f"tabindex=0 role=group {name}"), ui.element("table").props(name):
        with ui.element("thead"), ui.element("tr"):
            for title in titles:
                with ui.element("th").props("scope=col"):
                    ui.label(title)
        with ui.element("tbody"):
            for row in rows:
                with ui.element("tr"):
                    for cell in row:
                        with ui.element("td"):
                            if callable(cell):
                                cell()
                            else:
                                ui.label(cell)


def code(text: str, language: str, label: str) -> None:
    """Source text that can be scrolled by keyboard and copied."""
    made = ui.code(text, language=language).classes("full")
    made.markdown.props(f'tabindex=0 role=group aria-label="{attribute(label)}"')
    made.copy_button.props(f'aria-label="Copy: {attribute(label)}"')


def empty(text: str) -> None:
    """A hint in place of content that does not exist yet."""
    with ui.element("section").classes("sheet empty"):
        ui.label(text)


def copies(page: Any) -> None:
    """Buttons that copy the steps so far as a Python script or as shell commands."""
    from accelcal.app.script import COPIES

    with ui.row().classes("copies"):
        for name, make in COPIES.items():

            def copy(name: str = name, make: Callable[[Any], str] = make) -> None:
                ui.clipboard.write(make(page.bench.state))
                ui.notify(f"Copied as {name}", position="bottom-right")

            button(f"Copy as {name}", "content_copy", copy, flat=True)
