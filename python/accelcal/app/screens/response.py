"""Frequency response of the recording on the time line, on demand: figure, tables, downloads."""

from __future__ import annotations

from nicegui import ui

from accelcal.app import figures, widgets
from accelcal.app.page import Page
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
)
from accelcal.response import FrequencyResponse
from accelcal.response.certificate import draft_response
from accelcal.response.table import to_csv


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
            made = widgets.button("Compute the frequency response", "graphic_eq", lambda: page.act(bench.respond))
            made.set_enabled(bench.job is None)
            return
        page.pictures(("response", id(found)), lambda theme: [figures.response(found, theme)], height=700)
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
