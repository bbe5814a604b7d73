"""The addresses of the workbench, the screens behind them, and what is refused before: other sites, large bodies."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from nicegui import ui
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from accelcal.app import session_file, widgets
from accelcal.app.live_page import LivePage
from accelcal.app.page import Page, Screen
from accelcal.app.screens import data, files, improvement, model
from accelcal.app.sessions import Followers, Full, Workbenches
from accelcal.app.workbench import Workbench

SCREENS: dict[str, Screen] = {
    "data": ("Data", "insert_chart", data.show),
    "improve": ("Improve", "trending_down", improvement.show),
    "where": ("Residuals", "troubleshoot", improvement.show_residuals),
    "model": ("Model", "tune", model.show),
    "take": ("Export", "download", files.show),
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
        page = await show(name, lambda session: Page(session, SCREENS, workbenches, name))
        path = workbenches.keeper.path(name) or workbenches.recording
        if page is not None and page.bench.version == 0 and page.bench.job is None and path is not None:
            await page.open(path, session=path.suffix.lower() == session_file.SUFFIX)

    @ui.page("/bench/{name}/live")
    async def live(name: str) -> None:
        await show(name, lambda session: LivePage(session, name, followers))

    async def show(name: str, make: Callable[[Workbench], AnyPage]) -> AnyPage | None:
        """A page on a session, followed as long as its browser is there; None where one of them is not."""
        session = workbenches.find(name)
        if session is None:
            await absent(workbenches, name)
            return None
        client, page = ui.context.client, make(session)
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


OWN_SITES = ("same-origin", "none")
"""Values of Sec-Fetch-Site of the workbench's own pages and of an address that was typed."""
HARMLESS = ("GET", "HEAD", "OPTIONS")
"""Methods that a tool may use without naming an origin."""
MOST_SMALL = 16_000_000
"""Largest body that is no upload, bytes."""
MOST_UPLOADS = 4
"""Uploads at a time."""
COPIES = 3
"""Copies of an upload that are on the disk at a time: as it arrives, as it was sent, as it is kept."""
SPARE = 200_000_000
"""Space that stays free on the disk, bytes."""
FOREIGN = (
    "This request comes from another site, and the workbench answers its own pages alone. "
    "To open the workbench, type its address into the browser."
)
HEADERS = {
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""Sent with every answer: no other page shows, reads or learns of a page of the workbench."""


class TooLarge(Exception):
    """A body that went on beyond its limit."""


class Guard:
    """A layer around the server that refuses what the workbench does not want to read.

    Parameters
    ----------
    app : the server.
    folder : where uploads are kept; its disk is watched.
    most : largest upload, bytes.
    """

    def __init__(self, app: ASGIApp, folder: Path, most: int) -> None:
        self.app = app
        self.folder = folder
        self.most = most
        self._uploads = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
        elif is_foreign(scope):
            await _refuse(scope, receive, send, 403, FOREIGN)
        elif scope["type"] == "websocket":
            await self.app(scope, receive, send)
        elif "/upload/" in scope["path"] and scope["method"] == "POST":
            await self._upload(scope, receive, send)
        else:
            await self._limited(scope, receive, send, min(MOST_SMALL, self.most))

    async def _upload(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self._uploads >= MOST_UPLOADS:
            text = f"{MOST_UPLOADS} uploads are under way; wait until one has ended, and drop the file again."
            await _refuse(scope, receive, send, 503, text)
            return
        free = shutil.disk_usage(self.folder).free
        if COPIES * min(_declared(scope) or 0, self.most) + SPARE > free:
            text = f"{free / 1e6:.0f} MB are free on the disk of temporary files, too few for this file; make room."
            await _refuse(scope, receive, send, 507, text)
            return
        self._uploads += 1
        try:
            await self._limited(scope, receive, send, self.most)
        finally:
            self._uploads -= 1

    async def _limited(self, scope: Scope, receive: Receive, send: Send, most: int) -> None:
        """Pass a request on while its body is within `most` bytes; one that declares more is not read at all."""
        declared = _declared(scope)
        text = f"The request is larger than {most / 1e6:g} MB, the limit of the workbench."
        if declared is not None and declared > most:
            await _refuse(scope, receive, send, 413, text)
            return
        counted, begun, over = 0, False, False

        async def counting() -> Message:
            nonlocal counted, over
            message = await receive()
            counted += len(message.get("body", b""))
            if counted > most:
                over = True
                raise TooLarge
            return message

        async def answering(message: Message) -> None:
            nonlocal begun
            if over:
                return
            if message["type"] == "http.response.start":
                begun = True
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        with suppress(TooLarge):
            await self.app(scope, counting, answering)
        if over and not begun:
            await _refuse(scope, receive, send, 413, text)


def is_foreign(scope: Scope) -> bool:
    """Whether a page of another site makes a request, by what the browser says of it.

    A tool that says nothing may read; what writes, and a socket, must name the workbench as its origin.
    """
    headers = Headers(scope=scope)
    if headers.get("sec-fetch-site", "none") not in OWN_SITES:
        return True
    origin = headers.get("origin")
    if origin is None:
        return scope["type"] == "websocket" or scope["method"] not in HARMLESS
    return origin.lower() != f"http://{headers.get('host', '')}".lower()


def _declared(scope: Scope) -> int | None:
    """Size of the body by its header; None where it says none."""
    text = Headers(scope=scope).get("content-length", "")
    return int(text) if text.isascii() and text.isdigit() and len(text) < 20 else None


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, text: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": "another site"})
        return
    await PlainTextResponse(text + "\n", status, {**HEADERS, "Connection": "close"})(scope, receive, send)
