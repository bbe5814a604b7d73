"""Sessions: earlier work that was kept, a recording that an opened session asks for, Save."""

from __future__ import annotations

from nicegui import background_tasks, ui

from accelcal.app import background, session_file, widgets
from accelcal.app.kept import KeptSession
from accelcal.app.page import Page


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
        found = await background.act(page.workbenches.earlier)
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


def save(page: Page) -> None:
    """A button that downloads the session, and where it is kept."""
    bench, keeper = page.bench, page.workbenches.keeper
    assert bench.state.file is not None
    name = f"{bench.state.file.stem}{session_file.SUFFIX}"

    async def download() -> None:
        content = await background.act(bench.session)
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
