"""Residuals: every channel over one time axis, and the residual against every variable."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from nicegui import ui

from accelcal.app import figures, widgets
from accelcal.app.figures import Picture
from accelcal.app.page import Page
from accelcal.plots.style import ThemeName


def show(page: Page) -> None:
    """Build the screen."""
    bench, state = page.bench, page.bench.state
    if state.step is None:
        widgets.empty("Fit a model first, on the Data tab." if state.recording else "Load a recording first.")
        return

    def make(theme: ThemeName) -> Sequence[Picture]:
        return [figures.linked(state, bench.whole(), theme, page.window)]

    with widgets.card("Position, acceleration, residual, temperature"):
        ui.label("Drag to zoom; all panels follow, at full resolution. Double-click to reset.").classes("note")
        page.pictures(
            ("linked", state.current),
            make,
            first=bench.whole,
            prepare=lambda plot, redraw: zooming(page, plot, redraw),
            height=600,
        )
    found = bench.diagnosis
    with widgets.card("Residual against each variable", "many"):
        if found is None:
            if bench.job is None and not page.asking:
                ui.label("Not diagnosed yet.")
                widgets.button("Diagnose", "search", page.ask, primary=True)
            else:
                ui.label("Diagnosis is running …")
        else:
            worst = found.where.worst
            ui.label(f"{worst[:1].upper()}{worst[1:]}.".replace(" sigma", " σ")).classes("verdict-text")
            page.pictures(("where", id(found)), lambda theme: figures.where(found, theme), height=1500)
    widgets.copies(page)


def zooming(page: Page, plot: ui.plotly, redraw: Callable[[Picture], None]) -> None:
    """Thin the traces again for the visible part when the time axis changes."""
    bench = page.bench

    async def moved(event: Any) -> None:
        is_zoom, window = window_of(event.args or {})
        if not is_zoom or window == page.window:
            return
        page.window = window
        state, theme = bench.state, page.themes.theme
        fresh = await page.drawn(lambda: figures.linked(state, bench.whole(), theme, window))
        if state is bench.state and not plot.is_deleted:
            redraw(fresh)

    keys = ["xaxis.autorange"] + [f"xaxis{i or ''}.range[{j}]" for i in ("", *range(2, 8)) for j in (0, 1)]
    plot.on("plotly_relayout", moved, [keys])


def window_of(args: dict[str, Any]) -> tuple[bool, tuple[float, float] | None]:
    """Whether an event changes the time axis, and the part that it shows; None for all of it."""
    for i in ("", *range(2, 8)):
        low, high = args.get(f"xaxis{i}.range[0]"), args.get(f"xaxis{i}.range[1]")
        if isinstance(low, int | float) and isinstance(high, int | float):
            return True, (float(low), float(high))
        if args.get(f"xaxis{i}.autorange"):
            return True, None
    return False, None
