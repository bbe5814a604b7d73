"""The first screen: what the product is for, a place for a file, examples, recent projects, formats."""

from __future__ import annotations

from nicegui import ui

from accelcal.app import widgets
from accelcal.app.examples import EXAMPLES, Example
from accelcal.app.page import Page
from accelcal.app.screens import session, tour, uploads

PURPOSE = "Calibrate an accelerometer against position, and find the physical effect that its model lacks."
FORMATS = (
    (
        "Recordings",
        "CSV and text in any dialect (comma, semicolon or tab; decimal point or comma; a preamble), Parquet, MATLAB "
        "(.mat), NumPy (.npz), HDF5, TDMS, UFF, MF4, ROS bags, MCAP, miniSEED and C3D, with the output of one sensor "
        "and one position; each may have its own clock. "
        "Several of one sensor may be dropped together, tables of dwells among them.",
    ),
    ("Units", "m/s², g, mg, V, mV or counts; m, mm, µm; s, ms. Volts and counts need the sensor's scale."),
    ("Sidecar", "A .toml of the same name says what sensor and rig are; drop it together with the recording."),
    ("Session", "A .accelcal file, saved on the Export tab, resumes the work where it was saved."),
)


def show(page: Page) -> None:
    """Build the screen."""
    with ui.element("div").classes("halves"):
        with ui.element("section").classes("sheet welcome"):
            widgets.heading(PURPOSE, 1)
            ui.label(
                "Drop a recording of the sensor's output and of an encoder's position. One click fits it; then the "
                "page says which effect is missing, and shows the error falling when you add it. No data leave this "
                "machine."
            ).classes("lead")
            uploads.drop(page, "Drop a recording here, or click to choose a file")
            with ui.row().classes("line"):
                widgets.button("One-minute tour", "explore", tour.open_tour, flat=True)
                widgets.button(
                    "Live measurement", "sensors", lambda: ui.navigate.to(f"/bench/{page.name}/live"), flat=True
                )
        with widgets.card("Find it yourself: three recordings with a hidden effect"):
            for name, example in EXAMPLES.items():
                offer(page, name, example)
        session.earlier(page)
        with widgets.card("Supported files"), ui.element("dl").classes("formats"):
            for name, text in FORMATS:
                with ui.element("dt"):
                    ui.label(name)
                with ui.element("dd"):
                    ui.label(text)


def offer(page: Page, name: str, example: Example) -> None:
    """One example: what it is, Try, and the answer behind a click."""
    with ui.element("article").classes("candidate"):
        with ui.row().classes("line spread"):
            widgets.heading(example.title, 3)
            widgets.button(
                "Try it", "science", lambda: page.act(page.bench.example, name), label=f"Try it: {example.title}"
            )
        ui.label(example.about).classes("note")
        answer(example)


def answer(example: Example) -> None:
    """What is hidden in an example, behind a click."""
    with ui.expansion("Show the answer", icon="visibility").classes("full"):
        ui.label(example.answer)
