"""The look of every page: style sheet, scripts, and the switch between the light and the dark theme."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from importlib import resources

from nicegui import ui

from accelcal.app import widgets
from accelcal.app.figures import Picture
from accelcal.app.narrow import narrowed, roomy
from accelcal.app.workbench import Workbench
from accelcal.plots.style import ThemeName

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
        self._button = widgets.button("Dark theme", "dark_mode", self._toggle, flat=True)

    def set(self, theme: ThemeName) -> None:
        """Take a theme; nothing is drawn anew."""
        self.theme = theme
        self._dark.set_value(theme == "dark")
        other = "Light theme" if theme == "dark" else "Dark theme"
        self._button.set_text(other)
        self._button.props(f"icon={'light_mode' if theme == 'dark' else 'dark_mode'}")

    def _toggle(self) -> None:
        self.set("light" if self.theme == "dark" else "dark")
        self._rebuild()
