"""The addresses of the workbench, and the screens behind them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from nicegui import ui

from accelcal.app import session_file, widgets
from accelcal.app.follower import Followers
from accelcal.app.live_page import LivePage
from accelcal.app.page import Page, Screen
from accelcal.app.screens import data, export, improvement, model, residuals
from accelcal.app.sessions import Full, Workbenches
from accelcal.app.workbench import Workbench

SCREENS: dict[str, Screen] = {
    "data": ("Data", "insert_chart", data.show),
    "improve": ("Improve", "trending_down", improvement.show),
    "where": ("Residuals", "troubleshoot", residuals.show),
    "model": ("Model", "tune", model.show),
    "take": ("Export", "download", export.show),
}
"""Title, icon and builder of each screen, in the order of the tabs."""


AnyPage = TypeVar("AnyPage", Page, LivePage)


def install(workbenches: Workbenches, followers: Followers) -> None:
    """Register the pages of the workbench with the server."""

    @ui.page("/")
    async def start() -> None:
        """Begin new work; nothing is made before a browser has connected, so that a mere request changes nothing."""
        with ui.column().classes("expired"):
            text = ui.label("Opening the workbench …").props("role=status")
        if not await connected():
            return
        try:
            name = workbenches.new()
        except Full as error:
            text.set_text(str(error))
            return
        ui.run_javascript(f"location.replace('/bench/{name}')")

    @ui.page("/bench/{name}")
    async def bench(name: str) -> None:
        page = await show(name, lambda found: Page(found, SCREENS, workbenches, name))
        path = workbenches.keeper.path(name) or workbenches.recording
        if page is not None and page.bench.version == 0 and page.bench.job is None and path is not None:
            await page.open(path, session=path.suffix.lower() == session_file.SUFFIX)

    @ui.page("/bench/{name}/live")
    async def live(name: str) -> None:
        await show(name, lambda found: LivePage(found, name, followers))

    async def show(name: str, make: Callable[[Workbench], AnyPage]) -> AnyPage | None:
        """A page on a session, followed as long as its browser is there; None where one of them is not."""
        found = workbenches.find(name)
        if found is None:
            await absent(workbenches, name)
            return None
        client, page = ui.context.client, make(found)
        page.lay_out()
        if not await connected():
            return None
        await page.fill()
        workbenches.show(name, lambda: not client.is_deleted)
        return page


async def connected() -> bool:
    """Wait until a browser shows the page; False where none has come and the page was given up."""
    client = ui.context.client
    await client.connected()
    return bool(client.has_socket_connection)


async def absent(workbenches: Workbenches, name: str) -> None:
    """A page for a session that this server does not have: it is brought back where it was kept."""
    with ui.column().classes("expired"):
        title = widgets.heading("This session has expired", 1)
        text = ui.label("The workbench was restarted, or newer sessions replaced this one.")
        ui.link("New session", "/")
    if workbenches.keeper.path(name) is None:
        return
    title.set_text("Bringing back the work of this session …")
    text.set_text("The workbench was restarted.")
    if not await connected():
        return
    try:
        workbenches.new(name)
    except Full as error:
        text.set_text(str(error))
        return
    ui.run_javascript("location.reload()")
