"""The frame of the page: header, progress, tabs; it shows a workbench and hands on what the user does."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from typing import Any, TypeAlias

from nicegui import background_tasks, run, ui

from accelcal.app import widgets
from accelcal.app.figures import Picture
from accelcal.app.workbench import Busy, Workbench
from accelcal.plots.style import ThemeName

TICK = 0.25
"""s between looks at the workbench."""
QUIET = """<script>addEventListener("unhandledrejection", event => {
  if (String(event.reason).includes("Resize must be passed a displayed plot")) event.preventDefault();
});</script>"""
"""A plot that is taken off the page while it is being resized has nothing to complain of."""
Screen: TypeAlias = "tuple[str, str, Callable[[Page], None]]"
"""Title, icon and builder of a screen."""


class Page:
    """One browser tab on a workbench."""

    def __init__(self, bench: Workbench, screens: Mapping[str, Screen]) -> None:
        self.bench = bench
        self.screens = screens
        """By name, in the order of the work."""
        self.theme: ThemeName = "light"
        self.tab = "data" if bench.state.step is None else "improve"
        self.window: tuple[float, float] | None = None
        """Part of the time axis that is zoomed in, s."""
        self.brushed: tuple[float, float] | None = None
        self.fields: tuple[ui.number, ...] = ()
        """From and to of a stretch, on the screen that has them."""
        self._seen = -1
        self._turn = 0
        self._kept: dict[tuple[Any, ...], list[Picture]] = {}
        self._drawing: dict[tuple[Any, ...], asyncio.Task[list[Picture]]] = {}
        self.asking = False
        """Whether a diagnosis begins as soon as the pictures are drawn."""

    async def build(self) -> None:
        """Lay the frame out and show the first screen."""
        ui.colors(primary="#0072B2", positive="#009E73", negative="#B3261E", warning="#8A5A00")
        ui.add_css(resources.files("accelcal.app").joinpath("page.css").read_text(encoding="utf-8"))
        ui.add_head_html(QUIET)
        self.dark = ui.dark_mode()
        with ui.header().classes("bar"):
            ui.label("accelcal").classes("brand")
            self.file = ui.label().classes("file")
            ui.space()
            self.undo = widgets.button("Undo", "undo", lambda: self.change(self.bench.undo), flat=True)
            self.redo = widgets.button("Redo", "redo", lambda: self.change(self.bench.redo), flat=True)
            self.look = widgets.button("Dark page", "dark_mode", self.turn_theme, flat=True)
        with ui.row().classes("job").props("role=status aria-live=polite") as self.working:
            self.doing = ui.label()
            self.progress = ui.linear_progress(0.0, show_value=False).props("aria-label=Progress instant-feedback")
            widgets.button("Cancel", "close", lambda: self.change(self.bench.cancel), flat=True)
        with ui.row().classes("sentence").props("role=alert") as self.alert:
            ui.icon("error_outline")
            self.said = ui.label().classes("said")
        self.tabs = ui.tabs(on_change=lambda e: self.go(e.value)).classes("tabs").props("align=left no-caps")
        with self.tabs:
            for name, (title, icon, _) in self.screens.items():
                ui.tab(name, title, icon=icon)
        self.tabs.set_value(self.tab)
        self.body = ui.element("main").classes("body")
        # What draws takes a second or two to load; a figure that nobody sees has it loaded before the first drop.
        ui.plotly({"data": [], "layout": {"width": 10, "height": 10}}).classes("unseen").props("aria-hidden=true")
        ui.keyboard(on_key=self._key)
        await ui.context.client.connected()
        dark = await ui.run_javascript("matchMedia('(prefers-color-scheme: dark)').matches", timeout=5.0)
        self._set_theme("dark" if dark else "light")
        self.rebuild()
        ui.timer(TICK, self._tick)

    # What the user does

    async def act(self, action: Callable[..., Any], *args: Any, then: str = "") -> Any:
        """Do something that takes time off the page's own thread; then go to another screen if it went well."""
        try:
            background = run.io_bound(action, *args)
            self._tick()
            result = await background
        except Busy:
            result = None
        if then and not self.bench.sentence:
            self.tab = then
            self.tabs.set_value(then)
        self._tick()
        return result

    async def improve(self, action: Callable[..., Any], *args: Any) -> None:
        """Change the model, show it, and ask what the new one lacks as soon as its pictures are drawn."""
        self.asking = True
        await self.act(action, *args, then="improve")
        await asyncio.gather(*self._drawing.values(), return_exceptions=True)
        await self.ask()

    async def ask(self) -> None:
        """Ask what the model that is looked at lacks, unless there is something to be read first."""
        self.asking = not self.bench.sentence
        if self.asking:
            self.rebuild()
            await self.act(self.bench.diagnose)
        self.asking = False

    def change(self, action: Callable[[], None]) -> None:
        """Do something that is done at once."""
        action()
        self._tick()

    def go(self, tab: str) -> None:
        """Show another screen."""
        if tab != self.tab:
            self.tab = tab
            self.rebuild()

    def turn_theme(self) -> None:
        """Turn light into dark and back."""
        self._set_theme("light" if self.theme == "dark" else "dark")
        self.rebuild()

    def _set_theme(self, theme: ThemeName) -> None:
        self.theme = theme
        self.dark.set_value(theme == "dark")
        other = "Light page" if theme == "dark" else "Dark page"
        self.look.set_text(other)
        self.look.props(f"icon={'light_mode' if theme == 'dark' else 'dark_mode'}")

    def _key(self, event: Any) -> None:
        if event.action.keydown and not event.action.repeat and event.modifiers.ctrl and event.key.name.lower() == "z":
            self.change(self.bench.redo if event.modifiers.shift else self.bench.undo)

    # What the page shows

    def _tick(self) -> None:
        """Show progress and what can be done meanwhile; build the screen anew when the workbench has changed."""
        self.undo.set_enabled(self.bench.can_undo)
        self.redo.set_enabled(self.bench.can_redo)
        job = self.bench.job
        titled = job is not None and bool(job.title)
        self.working.set_visibility(titled)
        if job is not None and titled:
            self.doing.set_text(f"{job.title[:1].upper()}{job.title[1:]} …")
            self.progress.set_value(round(max(job.share, 0.02), 3))
        if self._seen != self.bench.version:
            self.rebuild()

    def rebuild(self) -> None:
        """Build the screen that is looked at."""
        self._seen = self.bench.version
        self._turn += 1
        state = self.bench.state
        self.file.set_text(state.file.name if state.file is not None else "")
        self.alert.set_visibility(bool(self.bench.sentence))
        self.said.set_text(self.bench.sentence)
        self.body.clear()
        with self.body:
            self.screens[self.tab][2](self)

    def pictures(
        self,
        key: tuple[Any, ...],
        make: Callable[[ThemeName], Sequence[Picture]],
        *,
        prepare: Callable[[ui.plotly, Callable[[Picture], None]], None] = lambda plot, redraw: None,
        height: int = 300,
    ) -> None:
        """Draw figures where this is called; they are worked out beside the page and kept under `key`.

        `prepare` is given each plot with a function that shows another picture in its place.
        """
        key = (*key, self.theme)
        theme, turn = self.theme, self._turn
        box = ui.element("div").classes("pictures").style(f"min-height: {height}px")

        def fill(several: Sequence[Picture]) -> None:
            box.style("min-height: 0")
            for one in several:
                with ui.element("figure"):
                    headline, note = ui.label(one.headline).classes("headline"), ui.label(one.note).classes("note")
                    note.set_visibility(bool(one.note))
                    plot = ui.plotly(one.figure).classes("plot")
                    plot.props(f'role=img aria-label="{widgets.attribute(one.headline)}"')

                    def redraw(
                        new: Picture, plot: ui.plotly = plot, headline: ui.label = headline, note: ui.label = note
                    ) -> None:
                        headline.set_text(new.headline)
                        note.set_text(new.note)
                        plot.update_figure(new.figure)

                    prepare(plot, redraw)

        if key in self._kept:
            with box:
                fill(self._kept[key])
            return

        async def draw() -> list[Picture]:
            try:
                several = list(await run.io_bound(lambda: make(theme)) or ())
            finally:
                del self._drawing[key]
            while len(self._kept) >= 12:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = several
            return several

        if key not in self._drawing:
            self._drawing[key] = background_tasks.create(draw(), handle_exceptions=False)
        drawing = self._drawing[key]

        async def work() -> None:
            try:
                several = await asyncio.shield(drawing)
            except (ValueError, ImportError) as error:
                if turn == self._turn:
                    with box:
                        ui.label(self.bench.plain(str(error))).classes("note")
                return
            if turn == self._turn and not box.is_deleted:
                with box:
                    fill(several)

        background_tasks.create(work())
