"""Widgets shared by all screens: headings, buttons, tables, notes, and the frame, look and theme of every page."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import resources
from typing import Any

from nicegui import ui

from accelcal.app.figures import Picture, narrowed, roomy
from accelcal.app.workbench import Workbench
from accelcal.plots.figure import ThemeName


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


NARROW = 700
"""Widest window on which figures are drawn one panel a line, px; page.css stacks its columns below it."""


def dress() -> None:
    """Give a page the look and the manners of the workbench."""
    ui.colors(primary="#0072B2", positive="#009E73", negative="#B3261E", warning="#8A5A00")
    files = resources.files("accelcal.app")
    ui.add_css(files.joinpath("page.css").read_text(encoding="utf-8"))
    ui.add_head_html(f"<script>{files.joinpath('page.js').read_text(encoding='utf-8')}</script>")


class Frame:
    """What the pages of the workbench have in common: header, message, body and theme."""

    themes: ThemeSwitch
    bench: Workbench
    is_narrow = False
    """Whether the window is as narrow as that of a phone."""

    def lay_out(self) -> None:
        """Lay out the frame."""
        dress()
        with ui.header().classes("bar"):
            skip = ui.link("Skip to content").classes("skip")
            ui.label("accelcal").classes("brand")
            self.file = ui.label().classes("file")
            ui.space()
            with ui.row().classes("tools"):
                self.tools()
                self.themes = ThemeSwitch(self.rebuild)
        self.above()
        with ui.row().classes("sentence").props("role=alert") as self.alert:
            ui.icon("error_outline").props("aria-hidden=true")
            self.message = ui.label().classes("message")
        self.alert.set_visibility(False)
        self.below()
        self.body = ui.element("div").classes("body").props("tabindex=-1")
        skip.props(f"href=#{self.body.html_id}")
        # plotly.js takes a second or two to load; a hidden figure loads it before the first recording is dropped.
        ui.plotly({"data": [], "layout": {"width": 10, "height": 10}}).classes("unseen").props("aria-hidden=true")

    def tools(self) -> None:
        """Buttons in the header."""

    def above(self) -> None:
        """What stands above the message."""

    def below(self) -> None:
        """What stands below the message."""

    def rebuild(self) -> None:
        """Draw the page anew."""

    def tell(self, sentence: str) -> None:
        """Show a message, or none."""
        self.alert.set_visibility(bool(sentence))
        self.message.set_text(sentence)

    async def ask_browser(self) -> None:
        """Take the theme that the browser asks for, and note whether its window is narrow."""
        asked = f"[matchMedia('(prefers-color-scheme: dark)').matches, innerWidth <= {NARROW}]"
        dark = False
        with suppress(TimeoutError):  # a browser that is busy gets its page all the same
            dark, self.is_narrow = map(bool, await ui.run_javascript(asked, timeout=30.0))
        self.themes.set("dark" if dark else "light")

    def sized(self, picture: Picture) -> Picture:
        """A figure for the width of this window."""
        return narrowed(picture) if self.is_narrow else roomy(picture)


class ThemeSwitch:
    """A button that goes from one theme to the other; `rebuild` draws the page anew."""

    def __init__(self, rebuild: Callable[[], None]) -> None:
        self.theme: ThemeName = "light"
        self._rebuild = rebuild
        self._dark = ui.dark_mode()
        self._button = button("Dark theme", "dark_mode", self._toggle, flat=True)

    def set(self, theme: ThemeName) -> None:
        """Take a theme; nothing is drawn anew."""
        self.theme = theme
        self._dark.set_value(theme == "dark")
        self._button.set_text("Light theme" if theme == "dark" else "Dark theme")
        self._button.props(f"icon={'light_mode' if theme == 'dark' else 'dark_mode'}")

    def _toggle(self) -> None:
        self.set("light" if self.theme == "dark" else "dark")
        self._rebuild()
