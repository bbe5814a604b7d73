"""A figure over time that is thinned for the part that is visible, and where the model fails as places in it.

A region of a table, a stretch of the largest residual or a click into one leads to the same place: all panels show that
stretch, marked, with a little of its surroundings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from nicegui import ui

from accelcal.app import widgets
from accelcal.app.figures import Picture
from accelcal.app.page import Page
from accelcal.app.run import Stretch
from accelcal.data.units import instant
from accelcal.plots.style import ThemeName
from accelcal.validation.comparison import Evaluation
from accelcal.validation.worst import worst_stretches

AROUND = 0.5
"""Of the length of a stretch that is shown at either side of it."""
Draw = Callable[[ThemeName, "Stretch | None", "Stretch | None"], Picture]
"""From the theme, the visible part of the time axis (None: all of it) and the stretch that is marked."""


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

    def whole(self, theme: ThemeName) -> list[Picture]:
        """The figure of all of the record."""
        return [self.draw(theme, None, None)]

    def follow(self, plot: ui.plotly, redraw: Callable[[Picture], None]) -> None:
        """Follow the time axis and the clicks of a plot."""
        self._plot, self._redraw = plot, redraw

        async def moved(event: Any) -> None:
            is_zoom, window = window_of(event.args or {})
            if is_zoom and window != self.window:
                await self._show(window, self.chosen)

        async def clicked(event: Any) -> None:
            at = event.args
            inside = (s for s in self.stretches if isinstance(at, int | float) and s[0] <= at <= s[1])
            found = next(inside, None)
            if found is not None and found != self.chosen:
                await self.go(found)

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
        fresh = await self.page.drawn(lambda: self.draw(theme, window, chosen))
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

    def table(self, seen: Evaluation) -> None:
        """Where the model fails: a row for each variable, whose range leads to where it is seen."""
        shown = seen.table("regions")
        head, worded = shown.cells
        rows: list[list[widgets.Cell]] = [list(row) for row in worded]
        for cells, region in zip(rows, seen.worst_regions, strict=True):
            if region.stretch is not None:
                cells[1] = self._link(str(cells[1]), region.variable, region.stretch)
        if rows:
            widgets.table(head, rows, "Where it fails")
            ui.label(" ".join((*shown.notes, "Click a range to see it in the figure."))).classes("note")

    def _link(self, text: str, variable: str, stretch: Stretch) -> Callable[[], Any]:
        """A cell that leads to a stretch of time."""

        async def go() -> None:
            await self.go(stretch)

        label = f"Show where {variable} is {text}"
        return lambda: widgets.button(text, "zoom_in", go, flat=True, label=label).props("dense align=left")


def stretches_of(seen: Evaluation) -> list[Stretch]:
    """The largest residuals of a comparison."""
    return worst_stretches(*seen.accel_residual)


def window_of(args: dict[str, Any]) -> tuple[bool, Stretch | None]:
    """Whether an event changes the time axis, and the part that it shows; None for all of it."""
    for i in ("", *range(2, 8)):
        low, high = args.get(f"xaxis{i}.range[0]"), args.get(f"xaxis{i}.range[1]")
        if isinstance(low, int | float) and isinstance(high, int | float):
            return True, (float(low), float(high))
        if args.get(f"xaxis{i}.autorange"):
            return True, None
    return False, None
