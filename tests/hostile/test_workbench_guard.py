"""The layer around the server: bodies are counted while they arrive, whatever their headers say."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette")

from accelcal.app import routes
from accelcal.app.routes import Guard, is_foreign

MOST = 1000


class Server:
    """Reads the whole body, in pieces, then answers; it notes how much it took."""

    def __init__(self) -> None:
        self.received = 0
        self.waiting = asyncio.Event()

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        while True:
            message = await receive()
            self.received += len(message.get("body", b""))
            if not message.get("more_body"):
                break
        if "wait" in scope["path"]:
            await self.waiting.wait()
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"done"})


async def posted(
    app: Guard, pieces: list[bytes], declared: int | None, path: str = "/upload/1"
) -> tuple[int, str, int]:
    """Status, text, and how many pieces were asked for."""
    headers = [(b"host", b"127.0.0.1:1"), (b"origin", b"http://127.0.0.1:1")]
    headers += [] if declared is None else [(b"content-length", str(declared).encode())]
    left, sent = list(pieces), []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": left.pop(0), "more_body": bool(left)}

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    scope = {"type": "http", "method": "POST", "path": path, "headers": headers}
    await app(scope, receive, send)
    body = b"".join(m.get("body", b"") for m in sent[1:])
    return sent[0]["status"], body.decode(), len(pieces) - len(left)


@pytest.mark.parametrize(
    ("pieces", "declared", "status"),
    [
        ([b"x" * 100] * 10, 1000, 200),
        ([b"x" * 100] * 11, 1100, 413),
        ([b"x" * 100] * 50, None, 413),
        ([b"x" * 100] * 50, 10, 413),  # a header that lies
        ([b""], 10**18, 413),
        ([b"x" * 100] * 5, -5, 200),
    ],
)
def test_a_body_is_limited_while_it_arrives(
    tmp_path: Path, pieces: list[bytes], declared: int | None, status: int
) -> None:
    server = Server()
    result, text, asked = asyncio.run(posted(Guard(server, tmp_path, MOST), pieces, declared))
    assert result == status
    assert server.received <= MOST
    if status == 413:
        assert "the limit of the workbench" in text
        assert asked <= 11


def test_few_uploads_run_at_a_time(tmp_path: Path) -> None:
    async def many() -> list[int]:
        server = Server()
        app = Guard(server, tmp_path, MOST)
        tasks = [asyncio.create_task(posted(app, [b"x"], 1, "/wait/upload/1")) for _ in range(routes.MOST_UPLOADS + 3)]
        await asyncio.sleep(0.05)
        server.waiting.set()
        first = [answer[0] for answer in await asyncio.gather(*tasks)]
        return [*first, (await posted(app, [b"x"], 1))[0]]

    assert asyncio.run(many()) == [200] * routes.MOST_UPLOADS + [503] * 3 + [200]


def test_a_full_disk_is_said_before_anything_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "SPARE", 10**18)
    status, text, asked = asyncio.run(posted(Guard(Server(), tmp_path, MOST), [b"x"], 1))
    assert (status, asked) == (507, 0)
    assert "make room" in text


@pytest.mark.parametrize(
    ("kind", "method", "headers", "foreign"),
    [
        ("http", "GET", {}, False),
        ("http", "POST", {}, True),
        ("websocket", "GET", {}, True),
        ("http", "POST", {"origin": "http://127.0.0.1:1"}, False),
        ("http", "POST", {"origin": "HTTP://127.0.0.1:1"}, False),
        ("http", "GET", {"origin": "https://127.0.0.1:1"}, True),
        ("http", "GET", {"origin": "http://127.0.0.1:1", "sec-fetch-site": "cross-site"}, True),
        ("http", "GET", {"sec-fetch-site": "same-origin"}, False),
        ("http", "GET", {"sec-fetch-site": "none"}, False),
        ("http", "GET", {"sec-fetch-site": ""}, True),
    ],
)
def test_another_site_is_known_by_what_the_browser_says(
    kind: str, method: str, headers: dict[str, str], foreign: bool
) -> None:
    raw = [(name.encode(), value.encode()) for name, value in {"host": "127.0.0.1:1", **headers}.items()]
    assert is_foreign({"type": kind, "method": method, "headers": raw}) is foreign
