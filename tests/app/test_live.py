"""A running measurement in the workbench: a device on TCP is followed, alarmed about, recorded and opened."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.live.streams import RATE, RIG, stream

from .test_server import HOST, server  # noqa: F401  (the fixture that runs the workbench)
from .user import LONG, arrives

SECONDS = 30.0
STEP = 12.0
"""When the bias steps, s of the stream."""
SPEED = 4.0
"""Time of the stream over that of the clock."""
PIECE = 0.05
"""Time between two pieces, s."""


class Device:
    """Sends lines to whoever connects, until they go; a broken one among them."""

    def __init__(self) -> None:
        lines = stream(SECONDS, step=0.1, at=STEP).lines().splitlines(keepends=True)
        lines.insert(100, b"0.05,broken\n")
        self._lines = lines
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._listening.getsockname()[1]}"
        self.disconnected = threading.Event()
        """Whether the follower has closed the connection."""
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        connection, _ = self._listening.accept()
        count = int(RATE * SPEED * PIECE)
        try:
            for i in range(0, len(self._lines), count):
                connection.sendall(b"".join(self._lines[i : i + count]))
                time.sleep(PIECE)
            while connection.send(b"\n"):
                time.sleep(PIECE)
        except OSError:
            self.disconnected.set()


@pytest.fixture
def user(browser: Any, server: Any) -> Iterator[Any]:  # noqa: F811
    page = arrives(browser, f"http://{HOST}:{server[0]}", "live", 1280, "light")
    yield page
    page.page.context.close()


def test_a_measurement_is_followed_recorded_and_opened(user: Any, tmp_path: Path) -> None:
    device = Device()
    (tmp_path / "rig.toml").write_text(RIG)
    user.click("Live measurement")
    user.sees("Units, sensor and model")
    user.type("Name of the recording", "seen")
    user.drop(tmp_path / "rig.toml")
    user.page.wait_for_function("() => document.querySelector('textarea').value.includes('2e-3')", timeout=LONG)
    user.click("Start")
    user.sees("is empty")
    user.look("form")
    user.type("Host and port", device.address)
    user.click("Start")
    user.sees("The model holds")
    user.look("running")
    user.click("Dark theme")
    user.page.set_viewport_size({"width": 390, "height": 844})
    user.sees("The model does not hold")
    user.sees("Alarm: ")
    user.settles(1)
    user.look("alarm")
    assert user.page.locator("[data-count=broken]").inner_text() == "1"
    user.click("Stop")
    user.sees("Open in the workbench")
    assert device.disconnected.wait(10)
    user.click("Open in the workbench")
    user.button("Fit the linear model").wait_for(timeout=LONG)
    assert user.complaints == []
    assert user.outside == []
