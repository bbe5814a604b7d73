"""The look of every page: style sheet, scripts, and the switch between the light and the dark theme."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources

from nicegui import ui

from accelcal.app import widgets
from accelcal.plots.style import ThemeName

NARROW = 700
"""Widest window on which figures are drawn one panel a line, px; page.css stacks its columns below it."""


def dress() -> None:
    """Give a page the look and the manners of the workbench."""
    ui.colors(primary="#0072B2", positive="#009E73", negative="#B3261E", warning="#8A5A00")
    files = resources.files("accelcal.app")
    ui.add_css(files.joinpath("page.css").read_text(encoding="utf-8"))
    ui.add_head_html(f"<script>{files.joinpath('page.js').read_text(encoding='utf-8')}</script>")


async def asked() -> tuple[bool, bool]:
    """Whether the browser of this page asks for a dark theme, and whether its window is narrow."""
    question = f"[matchMedia('(prefers-color-scheme: dark)').matches, innerWidth <= {NARROW}]"
    try:
        dark, is_narrow = await ui.run_javascript(question, timeout=30.0)
    except TimeoutError:
        return False, False  # a browser that is busy gets its page all the same
    return bool(dark), bool(is_narrow)


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
