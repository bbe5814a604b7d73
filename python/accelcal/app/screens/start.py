"""The first screen: purpose, a place for a file, examples, recent projects, formats, a tour; sessions that are kept."""

from __future__ import annotations

from nicegui import background_tasks, ui

from accelcal.app import widgets, workers
from accelcal.app.page import Page
from accelcal.app.screens import files
from accelcal.app.session_file import KeptSession
from accelcal.app.tasks import EXAMPLES, Example

STEPS = (
    (
        "Drop a recording",
        "The sensor's output and the position of an encoder, in one file. Where the columns have other names, the page "
        "asks which is which. A part at the end is held out: no fit uses it, and the error is computed on it.",
    ),
    (
        "Fit",
        "One click estimates bias, scale factor and time offset, and compares the model with the held-out part.",
    ),
    (
        "Read the verdict",
        "The page tests every effect of the catalogue. It says which one is missing and how sure that is, which others "
        "look the same on this recording, and what to record to separate them; or that nothing is missing, and how "
        "large an effect could have hidden.",
    ),
    (
        "Add, and see the error fall",
        "Add fits again. The falling error is that of held-out data, so that a wrong effect does not help. Undo takes "
        "it back; every model stays in the tree and may be the start of another branch.",
    ),
    (
        "Look and export",
        "Residuals shows where a model fails, Model has every parameter with its uncertainty, Export has the report, "
        "the model, code for firmware, and your steps as a script.",
    ),
)
"""Title and text of each step."""


def open_tour() -> None:
    """Open the tour above the page."""
    at = 0
    with ui.dialog() as dialog, ui.card().classes("tour"):
        count = ui.label().classes("note").props("role=status")
        title = widgets.heading("", 2)
        text = ui.label()
        with ui.row().classes("line"):
            back = widgets.button("Back", "arrow_back", lambda: go(-1))
            forward = widgets.button("Next", "arrow_forward", lambda: go(1), primary=True).props("data-autofocus")
            widgets.button("Close", "close", dialog.close, flat=True)
    dialog.props('aria-label="One-minute tour"')
    dialog.on("hide", dialog.delete)

    def go(by: int) -> None:
        nonlocal at
        if at + by == len(STEPS):
            dialog.close()
            return
        at += by
        count.set_text(f"{at + 1} of {len(STEPS)}")
        title.set_text(STEPS[at][0])
        text.set_text(STEPS[at][1])
        back.set_enabled(at > 0)
        forward.set_text("Done" if at + 1 == len(STEPS) else "Next")

    go(0)
    dialog.open()


def ask(page: Page) -> None:
    """Say which recording an opened session needs."""
    opened = page.bench.state.opened
    source = None if opened is None else opened.awaited
    if source is None:
        return
    ui.label(
        f"This session was made with {source.path.name}, which is not where it was, or has changed since. A session "
        "file holds models and steps, and no recorded data: drop the recording once more, and the work goes on."
    )
    ui.label(f"SHA-256 {source.sha256}").classes("note")


def earlier(page: Page) -> None:
    """Offer work that was kept when a server ended."""
    place = ui.element("div").classes("stack")

    async def fill() -> None:
        found = await workers.act(page.workbenches.earlier)
        if found and not place.is_deleted:
            with place, widgets.card("Recent projects"):
                for kept in found:
                    line(page, kept, place)
                ui.label(f"Kept in {page.workbenches.keeper.folder}, without recorded data.").classes("note")

    background_tasks.create(fill())


def line(page: Page, kept: KeptSession, place: ui.element) -> None:
    """One kept session: what it is, Open, Delete."""
    keeper = page.workbenches.keeper

    async def go_on() -> None:
        path = keeper.path(kept.name)
        if path is None:
            page.bench.refuse("this session has been deleted meanwhile")
            return
        await page.open(path, session=True)
        if page.bench.state.recording is not None:
            keeper.remove(kept.name)  # it goes on under the name of this session

    def delete() -> None:
        keeper.remove(kept.name)
        place.clear()
        page.rebuild()

    with ui.row().classes("line spread"):
        with ui.element("div"):
            ui.label(kept.title).classes("strong")
            ui.label(f"saved {kept.saved} UTC").classes("note")
        with ui.row().classes("tight"):
            widgets.button("Open", "folder_open", go_on, label=f"Open {kept.title}, {kept.saved}")
            widgets.button("Delete", "delete", delete, flat=True, label=f"Delete {kept.title}, {kept.saved}")


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
            files.drop(page, "Drop a recording here, or click to choose a file")
            with ui.row().classes("line"):
                widgets.button("One-minute tour", "explore", open_tour, flat=True)
                widgets.button(
                    "Live measurement", "sensors", lambda: ui.navigate.to(f"/bench/{page.name}/live"), flat=True
                )
        with widgets.card("Find it yourself: three recordings with a hidden effect"):
            for name, example in EXAMPLES.items():
                offer(page, name, example)
        earlier(page)
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
