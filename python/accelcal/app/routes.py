"""The addresses of the workbench, and the screens behind them."""

from __future__ import annotations

from nicegui import ui
from starlette.responses import RedirectResponse, Response

from accelcal.app import widgets
from accelcal.app.page import Page, Screen
from accelcal.app.screens import data, download, improve, model, residuals
from accelcal.app.sessions import Benches

SCREENS: dict[str, Screen] = {
    "data": ("Data", "insert_chart", data.show),
    "improve": ("Improve", "trending_down", improve.show),
    "where": ("Where it fails", "troubleshoot", residuals.show),
    "model": ("Model", "tune", model.show),
    "take": ("Take away", "download", download.show),
}
"""Title, icon and builder of each screen, in the order of the work."""


def install(benches: Benches) -> None:
    """Enter the pages of the workbench into the server."""

    @ui.page("/")
    def start() -> Response:
        return RedirectResponse(f"/bench/{benches.new()}")

    @ui.page("/bench/{name}")
    async def bench(name: str) -> None:
        found = benches.find(name)
        if found is None:
            with ui.column().classes("gone"):
                widgets.heading("This work is gone", 1)
                ui.label("The workbench was started again, or newer work took its place.")
                ui.link("Start anew", "/")
            return
        page = Page(found, SCREENS)
        await page.build()
        if benches.recording is not None and found.state.file is None and found.job is None and not found.sentence:
            await page.act(found.load, benches.recording)
