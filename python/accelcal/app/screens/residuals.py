"""Residuals: every channel over one time axis, where the model fails, by time, frequency and every variable."""

from __future__ import annotations

from nicegui import ui

from accelcal.app import figures, widgets
from accelcal.app.page import Page
from accelcal.app.screens import response
from accelcal.app.state import State
from accelcal.app.zoom import Zoom
from accelcal.validation.comparison import Evaluation


def show(page: Page) -> None:
    """Build the screen."""
    bench, state = page.bench, page.bench.state
    if state.step is None:
        widgets.empty("Fit a model first, on the Data tab." if state.recording else "Load a recording first.")
        response.card(page)
        return

    zoom = Zoom(page, lambda theme, window, chosen: figures.linked(state, bench.whole(), theme, window, chosen))
    with widgets.card("Position, acceleration, residual, temperature"):
        ui.label("Drag to zoom; all panels follow, at full resolution. Double-click to reset.").classes("note")
        page.pictures(
            ("linked", state.current, state.shown, state.data.digest),
            zoom.whole,
            first=bench.whole,
            prepare=zoom.follow,
            height=600,
        )
        zoom.places()
    found = bench.diagnosis
    with widgets.card("Where it fails"):
        if found is None:
            if bench.job is None and not page.asking:
                ui.label("Not diagnosed yet.")
                widgets.button("Diagnose", "search", page.ask, primary=True)
            else:
                ui.label("Diagnosis is running …")
        else:
            worst = found.where.worst
            ui.label(f"{worst[:1].upper()}{worst[1:]}.".replace(" sigma", " σ")).classes("verdict-text")
            regions(state, zoom, found.where)
    response.card(page)
    if found is not None:
        with widgets.card("Residual against each variable", "many"):
            page.pictures(("where", id(found)), lambda theme: figures.where(found, theme), height=1500)
    widgets.copies(page)


def regions(state: State, zoom: Zoom, seen: Evaluation) -> None:
    """Where the model fails on the first fitted recording; its ranges lead into the figure only if that is drawn."""
    first = state.first_fitted
    if state.drawn is first:
        zoom.table(seen)
        return
    ui.label(f"On {first.name}, the first fitted recording; bring it to the time line to see these ranges.").classes(
        "note"
    )
    if seen.worst_regions:
        shown = seen.table("regions")
        head, rows = shown.cells
        widgets.table(head, rows, "Where it fails")
        ui.label(" ".join(shown.notes)).classes("note")
