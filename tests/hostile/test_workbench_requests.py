"""Requests that no page of the workbench makes: none changes anything, and the server goes on answering."""

from __future__ import annotations

import socket
import threading
import time

import pytest

from accelcal.app.server import HOST, MOST_UPLOAD

from .case import LONG
from .workbench import Served, served  # noqa: F401  (the fixture that runs it)

FOREIGN = [
    {"Sec-Fetch-Site": "cross-site"},
    {"Sec-Fetch-Site": "same-site"},
    {"Origin": "http://evil.example"},
    {"Origin": "null"},
    {"Origin": "http://127.0.0.1:1"},
    {"Origin": "http://127.0.0.1.evil.example"},
]
"""What a browser says of a request that another site makes; a page of another port is another site, too."""
GIVEN_UP = 80.0 if LONG else 0.0
"""Time after which the server forgets a page that no browser showed, s; then, too, no session may come of it."""
PATHS = ("/", "/bench/AAAAAAAAAAAAAAAA", "/favicon.ico", "/_nicegui_ws/socket.io/?EIO=4&transport=polling")


def handshake(server: Served, headers: str) -> str:
    """First line of the answer to a websocket handshake with these headers."""
    with socket.create_connection((HOST, server.port), 30) as wire:
        wire.sendall(
            f"GET /_nicegui_ws/socket.io/?EIO=4&transport=websocket HTTP/1.1\r\nHost: {HOST}:{server.port}\r\n"
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n{headers}\r\n".encode()
        )
        return wire.recv(200).split(b"\r\n")[0].decode()


def test_twelve_requests_of_another_site_evict_nothing(served: Served) -> None:  # noqa: F811
    before = served.sessions()
    answers = [served.ask("/", headers=FOREIGN[i % len(FOREIGN)])[0] for i in range(12)]
    print(f"{len(answers)} cross-site requests: {len(before - served.sessions())} evicted")
    assert answers == [403] * 12
    assert served.sessions() == before


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("headers", FOREIGN, ids=lambda h: "=".join(*h.items()))
def test_another_site_is_refused_everywhere(served: Served, path: str, headers: dict[str, str]) -> None:  # noqa: F811
    status, answered, text = served.ask(path, headers=headers)
    assert status == 403
    assert "type its address" in text
    assert "access-control-allow-origin" not in answered
    assert answered["x-frame-options"] == "DENY"


def test_a_socket_needs_the_origin_of_the_workbench(served: Served) -> None:  # noqa: F811
    origin = f"Origin: {served.address}\r\n"
    assert "101" in handshake(served, origin)
    for headers in (
        "",
        "Origin: http://evil.example\r\n",
        "Origin: null\r\n",
        f"{origin}Sec-Fetch-Site: cross-site\r\n",
    ):
        assert "403" in handshake(served, headers), headers


def test_mere_requests_make_no_session(served: Served) -> None:  # noqa: F811
    before = served.sessions()
    for _ in range(60):
        assert served.ask("/")[0] == 200
    time.sleep(GIVEN_UP)
    assert served.sessions() == before


def test_a_tool_may_read_and_must_not_write(served: Served) -> None:  # noqa: F811
    assert served.ask("/favicon.ico")[0] == 200
    status, _, text = served.ask("/_nicegui/client/x/upload/1", "POST", body=b"")
    assert (status, "type its address" in text) == (403, True)


def test_it_listens_on_this_machine_alone(served: Served) -> None:  # noqa: F811
    with socket.create_connection((HOST, served.port), 5):
        pass
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outward:
        outward.connect(("192.0.2.1", 9))  # sends nothing; the system says by which address it would
        addresses = {outward.getsockname()[0], "127.0.0.2"} - {HOST}
    for address in addresses:
        with pytest.raises(ConnectionRefusedError), socket.create_connection((address, served.port), 5):
            pass


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "10.0.0.1", "[::1]", "", "localhost.evil.example:80"]
)
def test_foreign_hosts_are_refused(served: Served, host: str) -> None:  # noqa: F811
    for path in PATHS:
        assert served.ask(path, headers={"Host": host})[0] == 400


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd",
        "/bench/../../../etc/passwd",
        "/_nicegui/../../../etc/passwd",
        "/_nicegui/%2e%2e/%2e%2e/etc/passwd",
        "/_nicegui/auto/static/..%2f..%2f..%2fetc/passwd",
        "/bench/..%2f..%2f..%2fetc%2fpasswd",
        "/bench/%00",
        "/bench/" + "A" * 8000,
        "//etc/passwd",
        "/docs",
        "/openapi.json",
    ],
)
def test_no_path_leads_out(served: Served, path: str) -> None:  # noqa: F811
    status, _, text = served.ask(path)
    assert status < 500
    assert "root:" not in text
    assert '"openapi"' not in text


def test_a_body_that_says_it_is_too_large_is_not_read(served: Served) -> None:  # noqa: F811
    headers = {"Origin": served.address, "Content-Length": str(MOST_UPLOAD + 1)}
    status, _, text = served.ask("/_nicegui/client/x/upload/1", "POST", headers)
    assert status == 413
    assert "the limit of the workbench" in text
    assert served.ask("/bench/x", "POST", {**headers, "Content-Length": "20000000"})[0] == 413


def test_slow_connections_keep_nobody_waiting(served: Served) -> None:  # noqa: F811
    wires = [socket.create_connection((HOST, served.port), 30) for _ in range(300)]
    try:
        for wire in wires:
            wire.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ")
        begin = time.perf_counter()
        assert served.ask("/")[0] == 200
        print(f"an answer beside {len(wires)} slow connections took {time.perf_counter() - begin:.2f} s")
    finally:
        for wire in wires:
            wire.close()
    assert served.ask("/")[0] == 200


def test_many_readers_at_once_are_answered(served: Served) -> None:  # noqa: F811
    results: list[int] = []
    threads = [threading.Thread(target=lambda: results.append(served.ask("/")[0])) for _ in range(60)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [200] * 60
