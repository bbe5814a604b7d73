"""What to take away: model, report, code, sidecar, own effects, and the steps as a script and as commands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from nicegui import ui

from accelcal.app import mapping, parts
from accelcal.app.script import COPIES

if TYPE_CHECKING:
    from accelcal.app.page import Page


def show(page: Page) -> None:
    """Build the screen."""
    bench, state = page.bench, page.bench.state
    if state.recording is None or state.file is None:
        parts.empty("Load a recording first.")
        return
    stem = state.file.stem
    with parts.card("Files"), ui.row().classes("line"):
        if state.step is not None:
            parts.button(
                "Model (.json)", "save", lambda: ui.download.content(bench.model_text(), f"{stem}.json"), primary=True
            )

            async def report() -> None:
                path = await page.act(bench.report)
                if path is not None:
                    with page.body:  # the button that was pressed has been built anew meanwhile
                        ui.download.file(path, f"{stem}.html")

            async def code(language: Literal["C", "Rust"]) -> None:
                path = await page.act(bench.code, language)
                if path is not None:
                    with page.body:
                        ui.download.file(path, f"{stem}{path.suffix}")

            parts.button("Report (.html)", "article", report)
            parts.button("For firmware, C (.h)", "memory", lambda: code("C"))
            parts.button("For firmware, Rust (.rs)", "memory", lambda: code("Rust"))
        text = mapping.text_of(state.file, state.sidecar)
        parts.button("Sidecar (.toml)", "description", lambda: ui.download.content(text, f"{stem}.toml"))
        for one in state.own:
            parts.button(
                f"Own effect {one.effect.name} (.py)",
                "functions",
                lambda one=one: ui.download.content(one.file, f"{one.effect.name}.py"),
            )
        parts.button(
            "Script (.py)", "code", lambda: ui.download.content(COPIES["Python"](bench.state), f"{stem}_steps.py")
        )
    for name, make in COPIES.items():
        with parts.card(f"The same as {name}" if name == "Python" else "The same on the command line"):
            ui.code(make(state), language="python" if name == "Python" else "bash").classes("full")
    parts.copies(page)
