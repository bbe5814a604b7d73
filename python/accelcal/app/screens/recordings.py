"""Several files: a role for each, the one on the time line, and places to drop more."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from accelcal.app import widgets
from accelcal.app.page import Page
from accelcal.app.roles import ROLES
from accelcal.app.run import Run, time_span
from accelcal.app.screens import uploads
from accelcal.results.words import number


def card(page: Page) -> None:
    """Files with their roles; of a single one only the places to drop more."""
    state = page.bench.state
    with widgets.card("Recordings"):
        if len(state.runs) > 1:
            titles = ["file", "use", "length", "held out", "time line", "remove"]
            widgets.table(titles, [row(page, at, run) for at, run in enumerate(state.runs)], "Recordings and their use")
            ui.label(
                "Models are fitted to all files with the use fit together, and compared with what is held out."
            ).classes("note")
        uploads.drop(page, "Add recordings or dwells", more=True)
        with ui.expansion("Begin anew with others", icon="restart_alt").classes("full"):
            uploads.drop(page, "Drop the recordings here")


def row(page: Page, at: int, run: Run) -> list[widgets.Cell]:
    """A file with what can be done with it."""
    return [run.name, use(page, at, run), length(run), held_out(run), show_button(page, at, run), remove(page, at, run)]


def use(page: Page, at: int, run: Run) -> Callable[[], None]:
    """The choice of a role; dwells cannot be held out."""

    def build() -> None:
        roles = [role for role in ROLES if run.dwells is None or role != "hold out"]

        async def choose(event: object) -> None:
            role = chosen.value
            if role != run.role:
                await page.act(page.bench.assign, at, role)
            if page.bench.state.runs[at].role == run.role:
                chosen.set_value(run.role)

        chosen = ui.select(roles, value=run.role, on_change=choose)
        chosen.props(f'dense outlined aria-label="Use of {widgets.attribute(run.name)}"').classes("role")

    return build


def length(run: Run) -> str:
    """How long a recording is, or how many dwells there are."""
    if run.dwells is not None:
        return "1 dwell" if len(run.dwells) == 1 else f"{len(run.dwells)} dwells"
    if run.recording is None:
        return "columns unknown"
    begin, end = time_span(run.recording)
    return f"{number(end - begin, 4)} s"


def held_out(run: Run) -> str:
    """Which part is held out."""
    if run.role == "hold out":
        return "all of it"
    return "" if run.held_out is None else f"{run.held_out[0]:.6g} s to {run.held_out[1]:.6g} s"


def show_button(page: Page, at: int, run: Run) -> widgets.Cell:
    """A button that brings a file to the time line."""
    if at == page.bench.state.shown:
        return "shown"
    return lambda: widgets.button(
        "Show", "insert_chart", lambda: page.act(page.bench.show, at), flat=True, label=f"Show {run.name}"
    )


def remove(page: Page, at: int, run: Run) -> Callable[[], object]:
    """A button that removes a file."""
    return lambda: widgets.button(
        "Remove", "delete", lambda: page.act(page.bench.remove, at), flat=True, label=f"Remove {run.name}"
    )
