"""Where it fails: everything over one time axis, and the residual against every variable."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from nicegui import run, ui

from accelcal.app import figures, widgets
from accelcal.app.figures import Picture
from accelcal.app.page import Page
from accelcal.plots.style import ThemeName


def show(page: Page) -> None:
    """Build the screen."""
    bench, state = page.bench, page.bench.state
    if state.step is None:
        widgets.empty("Fit a model first, on the screen Data." if state.recording else "Load a recording first.")
        return

    def make(theme: ThemeName) -> Sequence[Picture]:
        return [figures.linked(state, bench.whole(), theme, page.window)]

    with widgets.card("Position, acceleration, residual, temperature"):
        ui.label(
            "Drag to zoom: every panel follows, and the traces are thinned anew. Double-click to see all."
        ).classes("note")
        page.pictures(
            ("linked", state.current), make, prepare=lambda plot, redraw: zooming(page, plot, redraw), height=600
        )
    found = bench.diagnosis
    with widgets.card("Against every variable"):
        if found is None:
            if bench.job is None and not page.asking:
                ui.label("Not asked yet.")
                widgets.button("Look for what is missing", "search", page.ask, primary=True)
            else:
                ui.label("Being worked out …")
        else:
            worst = found.where.worst
            ui.label(f"{worst[:1].upper()}{worst[1:]}.".replace(" sigma", " σ")).classes("verdict-text")
            page.pictures(("where", id(found)), lambda theme: figures.where(found, theme), height=1500)
    widgets.copies(page)


def zooming(page: Page, plot: ui.plotly, redraw: Callable[[Picture], None]) -> None:
    """When the time axis changes, the traces are thinned anew for what is seen."""
    bench = page.bench

    async def moved(event: Any) -> None:
        heard, window = window_of(event.args or {})
        if not heard or window == page.window:
            return
        page.window = window
        state, theme = bench.state, page.theme
        fresh = await run.io_bound(lambda: figures.linked(state, bench.whole(), theme, window))
        if fresh is not None and state is bench.state and not plot.is_deleted:
            redraw(fresh)

    keys = ["xaxis.autorange"] + [f"xaxis{i or ''}.range[{j}]" for i in ("", *range(2, 8)) for j in (0, 1)]
    plot.on("plotly_relayout", moved, [keys])


def window_of(args: dict[str, Any]) -> tuple[bool, tuple[float, float] | None]:
    """Whether an event speaks of the time axis, and of which part of it; None for all of it."""
    for i in ("", *range(2, 8)):
        low, high = args.get(f"xaxis{i}.range[0]"), args.get(f"xaxis{i}.range[1]")
        if isinstance(low, int | float) and isinstance(high, int | float):
            return True, (float(low), float(high))
        if args.get(f"xaxis{i}.autorange"):
            return True, None
    return False, None
