"""The page: header, progress, tabs; it shows a workbench and forwards actions to it; places in figures over time."""

from __future__ import annotations

import asyncio
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from nicegui import background_tasks, ui

from accelcal._support import errors
from accelcal.app import widgets, workers
from accelcal.app.sessions import Workbenches
from accelcal.app.state import State, Stretch
from accelcal.app.widgets import Picture, picture
from accelcal.app.workbench import Busy, Workbench
from accelcal.data import instant
from accelcal.plots.figure import Figure, ThemeName
from accelcal.validation.comparison import Evaluation

TICK = 0.25
"""Interval at which the page polls the workbench, s."""
Screen: TypeAlias = "tuple[str, str, Callable[[Page], None]]"
"""Title, icon and builder of a screen."""


class Page(widgets.Frame):
    """One browser tab on a workbench."""

    def __init__(
        self, bench: Workbench, screens: Mapping[str, Screen], workbenches: Workbenches, name: str = ""
    ) -> None:
        self.bench = bench
        self.name = name
        """Of the session, in its address."""
        self.workbenches = workbenches
        self.screens = screens
        """By name, in the order of the tabs."""
        self.tab = "data" if bench.state.step is None else "improve"
        self.brushed: tuple[float, float] | None = None
        self.fields: tuple[ui.number, ...] = ()
        """Fields for start and end of a stretch, on the screen that has them."""
        self.pair: tuple[str, str] | None = None
        """Two models that stand side by side."""
        self.of_rest: list[ui.button] = []
        """Buttons of the screen that begin an action: disabled while one is under way."""
        self.of_diagnosis: Callable[[], None] | None = None
        """Builds anew what a diagnosis changes on the screen, so that figures beside it stay; None: all of it."""
        self._seen = -1
        self._built: tuple[State | None, tuple[Any, ...]] = (None, ())
        """What the screen was built of, but the diagnosis."""
        self._build_count = 0
        self._kept: dict[tuple[Any, ...], list[Picture]] = {}
        self._drawing: dict[tuple[Any, ...], asyncio.Task[list[Picture]]] = {}
        self._failures: set[tuple[Any, ...]] = set()
        """Class and place of each exception that was shown."""
        self.asking = False
        """Whether a diagnosis begins as soon as the figures are drawn."""

    def lay_out(self) -> None:
        """Lay out the frame, which listens to the keyboard."""
        super().lay_out()
        ui.keyboard(on_key=self._key)

    def tools(self) -> None:
        """Undo and redo."""
        self.undo = widgets.button("Undo", "undo", lambda: self.change(self.bench.undo), flat=True)
        self.redo = widgets.button("Redo", "redo", lambda: self.change(self.bench.redo), flat=True)

    def above(self) -> None:
        """Progress of the action under way."""
        with ui.row().classes("job").props("role=status aria-live=polite") as self.working:
            self.doing = ui.label()
            self.progress = ui.linear_progress(0.0, show_value=False).props("aria-label=Progress instant-feedback")
            self.left = ui.label().classes("note").props("aria-hidden=true")
            widgets.button("Cancel", "close", lambda: self.change(self.bench.cancel), flat=True)
        self.working.set_visibility(False)

    def below(self) -> None:
        """The tabs."""
        self.tabs = ui.tabs(on_change=lambda e: self.go(e.value)).classes("tabs").props("align=left no-caps")
        with self.tabs:
            for name, (title, icon, _) in self.screens.items():
                ui.tab(name, title, icon=icon)
        self.tabs.set_value(self.tab)

    async def fill(self) -> None:
        """Show the first screen in the theme of the browser, and follow the workbench from now on."""
        await self.ask_browser()
        ui.on_exception(self.failed)
        self.rebuild()
        ui.timer(TICK, self._tick)

    # Actions of the user

    async def act(self, action: Callable[..., Any], *args: Any, then: str = "", waits: bool = False) -> Any:
        """Run an action off the page's own thread; then show the screen `then` of the model if there is one to show.

        One that `waits` is run after the action under way; any other one is refused while there is one.
        """
        if waits:
            await self.idle()
        try:
            running = workers.act(action, *args)
            self._tick()
            result = await running
        except Busy:
            result = await self.act(action, *args, waits=True) if waits else None
        if then and not self.bench.sentence and self.bench.state.step is not None:
            self.tab = then
            self.tabs.set_value(then)
        self._tick()
        return result

    async def idle(self) -> None:
        """Wait for the end of the action under way."""
        while self.bench.job is not None:
            await asyncio.sleep(TICK)

    async def improve(self, action: Callable[..., Any], *args: Any) -> None:
        """Change the model, show it, and diagnose the new one as soon as its figures are drawn."""
        self.asking = True
        await self.act(action, *args, then="improve")
        await asyncio.gather(*self._drawing.values(), return_exceptions=True)
        await self.ask()

    async def ask(self) -> None:
        """Diagnose the current model, unless an error message is waiting to be read."""
        before, self.asking = self.asking, not self.bench.sentence
        if self.asking:
            if not before:  # the screen says so
                self.rebuild()
            await self.act(self.bench.diagnose)
        self.asking = False

    def failed(self, error: Exception) -> None:
        """Show what a handler of this page raised; the same error once, since the page is redrawn all the time."""
        place = (
            type(error),
            *((frame.filename, frame.lineno) for frame in traceback.extract_tb(error.__traceback__)[-1:]),
        )
        if not isinstance(error, Busy) and place not in self._failures:
            self._failures.add(place)
            self.bench.refuse(errors.sentence(error))

    async def open(self, path: Path, *, session: bool) -> None:
        """Load a recording, or go on with a session where it was left."""
        await self.act(self.bench.open if session else self.bench.load, path, waits=True)
        if session and self.bench.state.step is not None:
            self.tabs.set_value("improve")

    async def drawn(self, make: Callable[[], workers.Result]) -> workers.Result:
        """What `make` draws, off the page's own thread, with the effects of this session."""
        with self.bench.catalogue():
            return await workers.draw(make)

    def change(self, action: Callable[[], None]) -> None:
        """Run an action that ends at once."""
        action()
        self._tick()

    def go(self, tab: str) -> None:
        """Show another screen."""
        if tab != self.tab:
            self.tab = tab
            self.rebuild()

    def _key(self, event: Any) -> None:
        if event.action.keydown and not event.action.repeat and event.modifiers.ctrl and event.key.name.lower() == "z":
            self.change(self.bench.redo if event.modifiers.shift else self.bench.undo)

    # Content of the page

    def _tick(self) -> None:
        """Show progress and enable buttons; rebuild the screen when the workbench has changed."""
        self.undo.set_enabled(self.bench.can_undo)
        self.redo.set_enabled(self.bench.can_redo)
        job = self.bench.job
        titled = job is not None and bool(job.title)
        self.working.set_visibility(titled)
        if job is not None and titled:
            self.doing.set_text(f"{job.title[:1].upper()}{job.title[1:]} …")
            self.progress.set_value(round(max(job.share, 0.02), 3))
            self.left.set_text(job.left)
        if self._seen != self.bench.version:
            state, beside = self._built
            if self.of_diagnosis is not None and state is self.bench.state and beside == self._beside:
                self._seen = self.bench.version
                with self.bench.catalogue():
                    self.of_diagnosis()
            else:
                self.rebuild()
        for button in self.of_rest:
            button.set_enabled(job is None)

    def rebuild(self) -> None:
        """Rebuild the current screen."""
        self._seen = self.bench.version
        self._build_count += 1
        state = self.bench.state
        self.file.set_text(state.title)
        self.tell(self.bench.sentence)
        widgets.clear(self.body)
        self.of_rest.clear()
        self.of_diagnosis, self._built = None, (state, self._beside)
        with self.body, self.bench.catalogue():
            if not self.is_new:
                named = f"{self.screens[self.tab][0]}: {state.title}" if state.runs else self.screens[self.tab][0]
                widgets.heading(named, 1).classes("unseen-text")
            self.screens[self.tab][2](self)

    @property
    def _beside(self) -> tuple[Any, ...]:
        """What a screen shows beside the state and the diagnosis."""
        return self.tab, self.themes.theme, self.is_narrow, self.bench.sentence

    @property
    def is_new(self) -> bool:
        """Whether the first screen is shown before any work has begun: it has a heading of its own."""
        state = self.bench.state
        return self.tab == "data" and self.bench.arriving is None and state.file is None and state.opened is None

    def pictures(
        self,
        key: tuple[Any, ...],
        make: Callable[[ThemeName], Sequence[Figure | Picture]],
        *,
        first: Callable[[], Any] = lambda: None,
        behind: tuple[Any, ...] | None = None,
        prepare: Callable[[ui.plotly, Callable[[Picture], None]], None] = lambda plot, redraw: None,
        height: int = 300,
        narrow: bool = False,
    ) -> None:
        """Draw figures at this place of the page; they are computed in the background and cached under `key`.

        `first` is called before, and may take long; the figures under the key `behind`, which a user waits for, are
        drawn and sent before; `prepare` is called with each plot and a function that replaces its figure. In a `narrow`
        place panels stand one under the other, as on a phone.
        """
        theme, build = self.themes.theme, self._build_count
        key = (*key, theme)
        box = ui.element("div").classes("pictures").style(f"min-height: {height}px")

        def fill(several: Sequence[Picture]) -> None:
            box.style("min-height: 0")
            for shown in several:
                with ui.element("figure"):
                    with ui.element("figcaption"):
                        with ui.row().classes("line spread top") as line:
                            headline = ui.label(shown.headline).classes("headline")
                        note = ui.label(shown.note).classes("note")
                    note.set_visibility(bool(shown.note))
                    plot = ui.plotly(self.sized(shown, narrow).figure).classes("plot")
                    with line:
                        widgets.png(plot, headline)

                    def redraw(
                        new: Picture, plot: ui.plotly = plot, headline: ui.label = headline, note: ui.label = note
                    ) -> None:
                        headline.set_text(new.headline)
                        note.set_text(new.note)
                        plot.update_figure(self.sized(new, narrow).figure)

                    prepare(plot, redraw)

        if key in self._kept:
            with box:
                fill(self._kept[key])
            return

        async def draw() -> list[Picture]:
            try:
                before = self._drawing.get((*(behind or ()), theme))  # asked for by now, wherever it stands on the page
                if before is not None:
                    await asyncio.wait([before])
                await workers.act(first)
                several = await self.drawn(lambda: [picture(item, theme) for item in make(theme)])
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
            except Exception as error:
                if build == self._build_count:
                    with box:
                        ui.label(self.bench.plain(errors.sentence(error))).classes("note")
                return
            if build == self._build_count and not box.is_deleted:
                with box:
                    fill(several)

        background_tasks.create(work())


AROUND = 0.5
"""Of the length of a stretch that is shown at either side of it."""
Draw = Callable[["Stretch | None", "Stretch | None"], Figure]
"""From the visible part of the time axis (None: all of it) and the stretch that is marked."""


class Zoom:
    """One figure over time, and what leads to places in it."""

    def __init__(self, page: Page, draw: Draw, stretches: Sequence[Stretch] = ()) -> None:
        self.page, self.draw = page, draw
        self.stretches = tuple(stretches)
        """Of the largest residual, s; a click into one of them leads there."""
        self.window: Stretch | None = None
        self.chosen: Stretch | None = None
        self._plot: ui.plotly | None = None
        self._redraw: Callable[[Picture], None] = lambda picture: None

    def whole(self, theme: ThemeName) -> list[Figure]:
        """The figure of all of the record."""
        return [self.draw(None, None)]

    def follow(self, plot: ui.plotly, redraw: Callable[[Picture], None]) -> None:
        """Follow the time axis and the clicks of a plot."""
        self._plot, self._redraw = plot, redraw

        async def moved(event: Any) -> None:
            is_zoom, window = window_of(event.args or {})
            if is_zoom and window != self.window:
                await self._show(window, self.chosen)

        async def clicked(event: Any) -> None:
            at = event.args
            stretch = next((s for s in self.stretches if isinstance(at, int | float) and s[0] <= at <= s[1]), None)
            if stretch is not None and stretch != self.chosen:
                await self.go(stretch)

        keys = ["xaxis.autorange"] + [f"xaxis{i or ''}.range[{j}]" for i in ("", *range(2, 8)) for j in (0, 1)]
        plot.on("plotly_relayout", moved, [keys])
        plot.on("plotly_click", clicked, js_handler="(event) => emit(event.points[0].x)")

    async def go(self, stretch: Stretch) -> None:
        """Show a stretch of time in all panels, marked."""
        reach = AROUND * (stretch[1] - stretch[0])
        await self._show((stretch[0] - reach, stretch[1] + reach), stretch)
        if self._plot is not None and not self._plot.is_deleted:
            self._plot.client.run_javascript(f"getElement({self._plot.id}).$el.scrollIntoView({{block: 'nearest'}})")

    async def reset(self) -> None:
        """Show all of the record, with nothing marked but the largest residuals."""
        await self._show(None, None)

    async def _show(self, window: Stretch | None, chosen: Stretch | None) -> None:
        self.window, self.chosen = window, chosen
        state, theme = self.page.bench.state, self.page.themes.theme
        fresh = await self.page.drawn(lambda: picture(self.draw(window, chosen), theme))
        latest = (window, chosen) == (self.window, self.chosen)
        if latest and state is self.page.bench.state and self._plot is not None and not self._plot.is_deleted:
            self._redraw(fresh)

    def places(self) -> None:
        """Buttons that lead to the largest residuals, and back to all of the record."""
        with ui.row().classes("copies"):
            for number, stretch in enumerate(self.stretches, start=1):
                text = f"Largest residual {number}: {instant(stretch[0])} s to {instant(stretch[1])} s"
                widgets.button(text, "zoom_in", lambda stretch=stretch: self.go(stretch), flat=True)
            widgets.button("Whole record", "zoom_out_map", self.reset, flat=True)

    def table(self, evaluation: Evaluation, *, leads: bool = True) -> None:
        """Where the model fails: a row for each variable, whose range leads to where it is seen if that is drawn."""
        shown = evaluation.table("regions")
        head, worded = shown.cells
        rows: list[list[widgets.Cell]] = [list(row) for row in worded]
        for cells, region in zip(rows, evaluation.worst_regions, strict=True):
            if leads and region.stretch is not None:
                cells[1] = self._link(str(cells[1]), region.variable, region.stretch)
        if rows:
            widgets.table(head, rows, "Where it fails")
            lead = ["Click a range to see it in the figure."] if leads else []
            ui.label(" ".join((*shown.notes, *lead))).classes("note")

    def _link(self, text: str, variable: str, stretch: Stretch) -> Callable[[], Any]:
        """A cell that leads to a stretch of time."""

        async def go() -> None:
            await self.go(stretch)

        label = f"Show where {variable} is {text}"
        return lambda: widgets.button(text, "zoom_in", go, flat=True, label=label).props("dense align=left")


def window_of(args: dict[str, Any]) -> tuple[bool, Stretch | None]:
    """Whether an event changes the time axis, and the part that it shows; None for all of it."""
    for i in ("", *range(2, 8)):
        low, high = args.get(f"xaxis{i}.range[0]"), args.get(f"xaxis{i}.range[1]")
        if isinstance(low, int | float) and isinstance(high, int | float):
            return True, (float(low), float(high))
        if args.get(f"xaxis{i}.autorange"):
            return True, None
    return False, None
