"""The addresses of the workbench, and the screens behind them."""

from __future__ import annotations

from nicegui import ui

from accelcal.app import widgets
from accelcal.app.page import Page, Screen
from accelcal.app.screens import data, download, improvement, model, residuals
from accelcal.app.sessions import Full, Workbenches

SCREENS: dict[str, Screen] = {
    "data": ("Data", "insert_chart", data.show),
    "improve": ("Improve", "trending_down", improvement.show),
    "where": ("Residuals", "troubleshoot", residuals.show),
    "model": ("Model", "tune", model.show),
    "take": ("Download", "download", download.show),
}
"""Title, icon and builder of each screen, in the order of the tabs."""


def install(workbenches: Workbenches) -> None:
    """Register the pages of the workbench with the server."""

    @ui.page("/")
    async def start() -> None:
        """Begin new work; nothing is made before a browser has connected, so that a mere request changes nothing."""
        with ui.column().classes("expired"):
            text = ui.label("Opening the workbench …").props("role=status")
        await ui.context.client.connected()
        try:
            name = workbenches.new()
        except Full as error:
            text.set_text(str(error))
            return
        ui.run_javascript(f"location.replace('/bench/{name}')")

    @ui.page("/bench/{name}")
    async def bench(name: str) -> None:
        found = workbenches.find(name)
        if found is None:
            with ui.column().classes("expired"):
                widgets.heading("This session has expired", 1)
                ui.label("The workbench was restarted, or newer sessions replaced this one.")
                ui.link("New session", "/")
            return
        client, page = ui.context.client, Page(found, SCREENS)
        await page.build()
        workbenches.show(name, lambda: not client.is_deleted)
        if workbenches.recording is not None and found.state.file is None and found.job is None and not found.sentence:
            await page.act(found.load, workbenches.recording)
