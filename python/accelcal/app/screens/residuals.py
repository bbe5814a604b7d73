"""Residuals over one time axis, by time, frequency and every variable, and the frequency response on demand."""

from __future__ import annotations

from nicegui import ui

from accelcal.app import widgets
from accelcal.app.page import Page, Zoom
from accelcal.app.state import State
from accelcal.calibration.export import Laboratory
from accelcal.plots.response import (
    FIT_HEAD,
    LINEARITY_HEAD,
    RESPONSE_HEAD,
    RESPONSE_NOTE,
    fit_rows,
    linearity_rows,
    response_rows,
    response_sentences,
    sensitivity,
)
from accelcal.response import FrequencyResponse
from accelcal.response.export import draft_response, to_csv
from accelcal.validation.comparison import Evaluation


def card(page: Page) -> None:
    """A button that computes it, or what was found."""
    bench, run = page.bench, page.bench.state.run
    if run is None or run.recording is None:
        return
    found = bench.response
    with widgets.card("Frequency response", "response"):
        if found is None:
            ui.label(
                f"Magnitude and phase of the sensitivity of {run.name} by frequency, with uncertainties: by sine "
                "approximation where the motion is steps of sines, else by spectral estimation."
            ).classes("note")
            widgets.button("Compute the frequency response", "graphic_eq", lambda: page.act(bench.respond)).set_enabled(
                bench.job is None
            )
            return
        page.pictures(("response", id(found)), lambda theme: [sensitivity(found)], height=700)
        widgets.lines(response_sentences(found), "")
        if found.model is not None:
            widgets.table(FIT_HEAD, fit_rows(found), "Parametric fit")
        with ui.expansion("Table by frequency", icon="table_rows").classes("full"):
            widgets.table(RESPONSE_HEAD, response_rows(found), "Frequency response")
            ui.label(RESPONSE_NOTE).classes("note")
        if found.terms:
            with ui.expansion("Amplitude linearity", icon="show_chart").classes("full"):
                widgets.table(LINEARITY_HEAD, linearity_rows(found), "Amplitude linearity")
        downloads(page, found)


def downloads(page: Page, found: FrequencyResponse) -> None:
    """The table as CSV, and all of it as a draft certificate."""
    data = page.bench.state.drawn
    stem, sensor = data.file.stem, data.data.rig.sensor
    with ui.row().classes("line"):
        widgets.button(
            "Response (.csv)", "table_rows", lambda: ui.download.content(to_csv(found), f"{stem}_response.csv")
        )
        widgets.button(
            "Draft certificate of the response (.xml)",
            "workspace_premium",
            lambda: ui.download.content(draft_response(found, sensor, Laboratory()).text, f"{stem}_response.xml"),
        )


def show(page: Page) -> None:
    """Build the screen."""
    bench, state = page.bench, page.bench.state
    if state.step is None:
        widgets.empty("Fit a model first, on the Data tab." if state.recording else "Load a recording first.")
        card(page)
        return

    zoom = Zoom(page, lambda window, chosen: widgets.linked(state, bench.whole(), window, chosen))
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
    card(page)
    if found is not None:
        with widgets.card("Residual against each variable", "many"):
            page.pictures(("where", id(found)), lambda theme: widgets.where(found, theme), height=1500)
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
