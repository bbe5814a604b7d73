"""Export: model, report, code, certificate, sidecar, user effects, the steps as a script and as commands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from accelcal.app import mapping, session_file, widgets, workers
from accelcal.app.page import Page
from accelcal.app.script import COPIES
from accelcal.app.tasks import Export

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
            if len(state.train) > 1 or len(state.unseen) > 1:
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
    widgets.button("For firmware, C (.h)", "memory", lambda: download(bench.export, "C"))
    widgets.button("For firmware, Rust (.rs)", "memory", lambda: download(bench.export, "Rust"))
    widgets.button("Calibration (.json)", "data_object", lambda: download(bench.export, "JSON"))
    widgets.button("Draft certificate (.xml)", "workspace_premium", lambda: download(bench.export, "DCC"))


def sources(page: Page) -> None:
    """Buttons for the inputs of the steps: sidecar, user effects, the script."""
    state, run = page.bench.state, page.bench.state.run
    assert run is not None
    stem, text = run.file.stem, mapping.text_of(run.file, run.sidecar, run.template)
    widgets.button("Sidecar (.toml)", "description", lambda: ui.download.content(text, f"{stem}.toml"))
    for own in state.own:
        widgets.button(
            f"User effect {own.effect.name} (.py)",
            "functions",
            lambda own=own: ui.download.content(own.file, f"{own.effect.name}.py"),
        )
    widgets.button("Script (.py)", "code", lambda: ui.download.content(COPIES["Python"](state), f"{stem}_steps.py"))
