"""Files that come and go: the first screen with its examples and kept sessions, what is dropped, what is exported."""

from __future__ import annotations

import html
import shutil
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import background_tasks, ui

from accelcal.app import mapping, session_file, widgets, workers
from accelcal.app.page import Page
from accelcal.app.script import COPIES
from accelcal.app.session_file import KeptSession
from accelcal.app.state import Refused
from accelcal.app.tasks import EXAMPLES, MOST_BYTES, Example, Export
from accelcal.app.workbench import Workbench
from accelcal.io.decoding import known_formats
from accelcal.io.sidecar import has_sidecar, sidecar_of

EXPORTED: dict[Export, tuple[str, str]] = {
    "C": ("For firmware, C (.h)", "memory"),
    "Rust": ("For firmware, Rust (.rs)", "memory"),
    "JSON": ("Calibration (.json)", "data_object"),
    "DCC": ("Draft certificate (.xml)", "workspace_premium"),
}
"""Title and icon of the button of each export."""
MODEL = ".json"
"""Ending of a model file."""
HEADER = """<button type="button" class="choose" @click="props.pickFiles">
<span class="material-icons" aria-hidden="true">upload_file</span><span>LABEL</span></button>
<q-uploader-add-trigger />"""
"""The whole area is one button with a name; the input behind it is hidden from keyboard and screen readers."""


def drop(page: Page, label: str, *, more: bool = False, guest: bool = False) -> None:
    """An area to drop files on; recordings, dwells and sidecars may come together.

    Parameters
    ----------
    label : name of the area.
    more : whether recordings join those that are there, in place of beginning anew.
    guest : whether models are to stand beside those that are there.
    """

    async def take(event: Any) -> None:
        try:
            paths = await saved(page.bench, event.files)
        except OSError as error:
            page.bench.refuse(f"the file could not be stored ({error.strerror or error}); make room, and drop it again")
            return
        if guest:
            await beside_ours(page, paths)
        else:
            await used(page, paths, more)

    area(page.bench, label, take, "guest" if guest else "more" if more else "recording")


def area(bench: Workbench, label: str, take: Callable[[Any], Awaitable[None]], mark: str) -> None:
    """A button on which files can be dropped; `take` is told what came; it waits for the action under way."""

    async def accept(event: Any) -> None:
        uploader.sends(False)
        if bench.job is not None and bench.job.title:
            names = ", ".join(file.name for file in event.files)
            ui.notify(f"Waiting for this to end: {bench.job.title}; then comes {names}.")
        await take(event)
        if not uploader.is_deleted:
            uploader.reset()  # what was taken is told by the page, and not listed once more

    most = f"{MOST_BYTES / 1e6:.0f} MB"
    too_large = f"the file is larger than {most}, the limit of the workbench"
    failed = (
        f"the upload has failed: the server did not take it. The limit is {most}, a few uploads "
        "at a time, and room on the disk; give the file a short name, and drop it again"
    )
    uploader = widgets.Uploader(
        multiple=True,
        auto_upload=True,
        max_file_size=MOST_BYTES,
        on_multi_upload=accept,
        on_rejected=lambda: bench.refuse(too_large),
    )
    uploader.on("start", lambda: uploader.sends(True), [])
    uploader.on("finish", lambda: uploader.sends(False), [])
    uploader.on("failed", lambda: bench.refuse(failed), [])
    uploader.props("flat hide-upload-btn").classes("drop")
    uploader.add_slot("header", HEADER.replace("LABEL", html.escape(label)))
    uploader.mark(mark)


async def saved(bench: Workbench, files: Sequence[Any]) -> list[Path]:
    """Store what was dropped together; a file that is refused is told and left out.

    Raises
    ------
    OSError
        If the disk does not take it.
    """
    paths: list[Path] = []
    folder = bench.upload_folder()
    for file in files:
        try:
            path = bench.upload_path(file.name, folder)
            if path.exists():
                path = bench.upload_path(file.name, bench.upload_folder())
            bench.require_room()
            if file.size() > MOST_BYTES:
                size, most = file.size() / 1e6, MOST_BYTES / 1e6
                raise Refused(f"{path.name}: {size:.0f} MB; the limit of the workbench is {most:.0f} MB")
        except Refused as error:
            bench.refuse(str(error))
            continue
        await file.save(path)
        paths.append(path)
    return paths


async def used(page: Page, paths: Sequence[Path], more: bool) -> None:
    """Open a session, load recordings with their sidecars, or put a sidecar in the place of the present one.

    What files are for depends on what is there once the action under way has ended.
    """
    bench = page.bench
    await page.idle()
    sessions = [p for p in paths if p.suffix.lower() == session_file.SUFFIX]
    sidecars = [p for p in paths if p.suffix.lower() == ".toml"]
    models = [p for p in paths if p.suffix.lower() == MODEL]
    recordings = [p for p in paths if p not in (*sessions, *sidecars, *models)]
    if models:
        bench.refuse(f"{models[0].name}: a model is put beside those of a session; drop it on the Model tab")
    elif sessions:
        await page.open(sessions[0], session=True)
    elif recordings and bench.state.opened is not None:
        await page.act(bench.give, recordings, waits=True)
    elif recordings:
        unmatched = beside(recordings, sidecars)
        if unmatched:
            bench.refuse(f"{unmatched[0].name}: no file that was dropped with it has this name; give it that name")
        elif more:
            await page.act(bench.include, recordings, waits=True)
        elif len(recordings) > 1:
            await page.act(bench.load_several, recordings, waits=True)
        else:
            await page.act(bench.load, recordings[0], waits=True)
    elif sidecars and bench.state.file is not None:
        await page.act(bench.declare, mapping.text_in(sidecars[0]), waits=True)
    elif sidecars:
        bench.refuse(f"{sidecars[0].name}: drop it together with the recording that it belongs to")


async def beside_ours(page: Page, paths: Sequence[Path]) -> None:
    """Put models and sessions beside the models of this session."""
    for path in paths:
        if path.suffix.lower() not in (MODEL, session_file.SUFFIX):
            page.bench.refuse(f"{path.name}: drop a model (.json) or a session ({session_file.SUFFIX}) here")
            return
        await page.act(page.bench.invite, path, waits=True)
    guests = page.bench.state.guests
    if guests and page.pair is not None:
        page.pair = (page.pair[0], guests[-1].name)
        page.rebuild()


def beside(recordings: Sequence[Path], sidecars: Sequence[Path]) -> list[Path]:
    """Put sidecars beside the files that they belong to, and return those that belong to none.

    A single sidecar of another name belongs to the single recording, or to all files that have none: one sensor.
    """
    of_recordings = {sidecar_of(path).name.lower(): path for path in recordings}
    unmatched = []
    for sidecar in sidecars:
        owner = of_recordings.get(sidecar.name.lower())
        if owner is None:
            unmatched.append(sidecar)
        elif sidecar != sidecar_of(owner):
            sidecar.rename(sidecar_of(owner))
    if len(unmatched) > 1:
        return unmatched
    for sidecar in unmatched:
        for path in [recording for recording in recordings if not has_sidecar(recording)]:
            shutil.copyfile(sidecar, sidecar_of(path))
    return []


STEPS = {
    "Python": ("These steps in Python", "python"),
    "command line": ("These steps on the command line", "bash"),
}
"""Title of each script, and its language."""


def show(page: Page) -> None:
    """Build the screen."""
    state = page.bench.state
    if state.recording is None:
        widgets.empty("Load a recording first.")
        return
    with widgets.card("Files"):
        with ui.row().classes("line"):
            if state.step is not None:
                results(page)
            sources(page)
        if state.step is not None:
            ui.label(
                "The certificate is a draft: data that only the laboratory can supply are marked as missing. "
                "accelcal export with --dcc and --lab fills them in."
            ).classes("note")
            if len(state.fitted_files) > 1 or len({run.file for run in state.unseen_runs}) > 1:
                ui.label(
                    "The report is judged on the first fitted and the first held-out recording: "
                    f"{state.first_fitted.name} and {state.unseen_runs[0].name}."
                ).classes("note")
    with widgets.card("Session"):
        save(page)
    for name, make in COPIES.items():
        title, language = STEPS[name]
        with widgets.card(title):
            widgets.code(make(state), language, title)
    widgets.copies(page)


def save(page: Page) -> None:
    """A button that downloads the session, and where it is kept."""
    bench, keeper = page.bench, page.workbenches.keeper
    assert bench.state.file is not None
    name = f"{bench.state.file.stem}{session_file.SUFFIX}"

    async def download() -> None:
        content = await workers.act(bench.session)
        with page.body:
            ui.download.content(content, name)

    with ui.row().classes("line"):
        widgets.button("Save session (.accelcal)", "save", download)
    ui.label(
        "The session holds the models and how they were made, and names the recording; it holds no recorded data. Drop "
        "it on the Data tab to go on."
    ).classes("note")
    ui.label(keeper.problem or f"It is also kept, after every change, in {keeper.folder}.").classes(
        "warning" if keeper.problem else "note"
    )


def results(page: Page) -> None:
    """Buttons for files made from the current model."""
    bench, file = page.bench, page.bench.state.file
    assert file is not None
    stem = file.stem

    async def download(action: Callable[..., Path | None], *kind: Export) -> None:
        path = await page.act(action, *kind)
        if path is not None:
            with page.body:  # the button that was pressed has been rebuilt meanwhile
                ui.download.file(path, f"{stem}_{path.name}" if kind else f"{stem}.html")

    widgets.button(
        "Model (.json)", "save", lambda: ui.download.content(bench.model_text(), f"{stem}.json"), primary=True
    )
    widgets.button("Report (.html)", "article", lambda: download(bench.report))
    for kind, (title, icon) in EXPORTED.items():
        widgets.button(title, icon, partial(download, bench.export, kind))


def sources(page: Page) -> None:
    """Buttons for the inputs of the steps: sidecar, user effects, the script."""
    state, run = page.bench.state, page.bench.state.run
    assert run is not None
    stem, text = run.file.stem, mapping.text_of(run.file, run.sidecar, run.template)
    widgets.button("Sidecar (.toml)", "description", lambda: ui.download.content(text, f"{stem}.toml"))
    for own_effect in state.own:
        widgets.button(
            f"User effect {own_effect.effect.name} (.py)",
            "functions",
            lambda entry=own_effect: ui.download.content(entry.file, f"{entry.effect.name}.py"),
        )
    widgets.button("Script (.py)", "code", lambda: ui.download.content(COPIES["Python"](state), f"{stem}_steps.py"))


TOUR = (
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
        if at + by == len(TOUR):
            dialog.close()
            return
        at += by
        count.set_text(f"{at + 1} of {len(TOUR)}")
        title.set_text(TOUR[at][0])
        text.set_text(TOUR[at][1])
        back.set_enabled(at > 0)
        forward.set_text("Done" if at + 1 == len(TOUR) else "Next")

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
        sessions = await workers.act(page.workbenches.earlier)
        if sessions and not place.is_deleted:
            with place, widgets.card("Recent projects"):
                for session in sessions:
                    line(page, session, place)
                ui.label(f"Kept in {page.workbenches.keeper.folder}, without recorded data.").classes("note")

    background_tasks.create(fill())


def line(page: Page, session: KeptSession, place: ui.element) -> None:
    """One kept session: what it is, Open, Delete."""
    keeper = page.workbenches.keeper

    async def go_on() -> None:
        path = keeper.path(session.name)
        if path is None:
            page.bench.refuse("this session has been deleted meanwhile")
            return
        await page.open(path, session=True)
        if page.bench.state.recording is not None:
            keeper.remove(session.name)  # it goes on under the name of this session

    def delete() -> None:
        keeper.remove(session.name)
        place.clear()
        page.rebuild()

    with ui.row().classes("line spread"):
        with ui.element("div"):
            ui.label(session.title).classes("strong")
            ui.label(f"saved {session.saved} UTC").classes("note")
        with ui.row().classes("tight"):
            widgets.button("Open", "folder_open", go_on, label=f"Open {session.title}, {session.saved}")
            widgets.button("Delete", "delete", delete, flat=True, label=f"Delete {session.title}, {session.saved}")


PURPOSE = "Calibrate an accelerometer against position, and find the physical effect that its model lacks."
FORMATS = (
    (
        "Recordings",
        "CSV and text in any dialect (comma, semicolon or tab; decimal point or comma; a preamble), "
        f"{', '.join(file_format.name for file_format in known_formats.FORMATS)}, with the output of one sensor "
        "and one position; each may have its own clock. "
        "Several of one sensor may be dropped together, tables of dwells among them.",
    ),
    ("Units", "m/s², g, mg, V, mV or counts; m, mm, µm; s, ms. Volts and counts need the sensor's scale."),
    ("Sidecar", "A .toml of the same name says what sensor and rig are; drop it together with the recording."),
    ("Session", "A .accelcal file, saved on the Export tab, resumes the work where it was saved."),
)


def welcome(page: Page) -> None:
    """Build the screen."""
    with ui.element("div").classes("halves"):
        with ui.element("section").classes("sheet welcome"):
            widgets.heading(PURPOSE, 1)
            ui.label(
                "Drop a recording of the sensor's output and of an encoder's position. One click fits it; then the "
                "page says which effect is missing, and shows the error falling when you add it. No data leave this "
                "machine."
            ).classes("lead")
            drop(page, "Drop a recording here, or click to choose a file")
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
