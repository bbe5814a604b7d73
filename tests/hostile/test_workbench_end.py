"""The end of a workbench: a signal while requests run leaves one sentence or none, and no folder stays."""

from __future__ import annotations

import http.client
import signal
import threading
from contextlib import suppress

import pytest

from .workbench import Served, has_ended, is_emptied, serving

pytest.importorskip("nicegui")


def ask_on(server: Served, ended: threading.Event) -> None:
    """Ask for pages until the end."""
    while not ended.is_set():
        with suppress(OSError, http.client.HTTPException):
            server.ask()


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_requests_run_ends_in_one_sentence_or_none(number: signal.Signals) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # a terminal that was left has it ignored
    ended = threading.Event()
    try:
        with serving() as server:
            server.ask()
            asking = [threading.Thread(target=ask_on, args=(server, ended), daemon=True) for _ in range(6)]
            for thread in asking:
                thread.start()
            assert server.stop(number) == 128 + number
            ended.set()
            messages = [line for line in server.log.read_text().splitlines()[1:] if line.strip()]
            assert len(messages) <= 1, messages
            assert all(line.startswith("accelcal: ") for line in messages)
            assert is_emptied(server.temporary)
    finally:
        ended.set()
        signal.signal(signal.SIGHUP, before)


def test_the_next_server_goes_on_with_the_folder_of_a_killed_one_and_removes_it() -> None:
    with serving() as server:
        first = list(server.temporary.glob("accelcal-*"))
        (first[0] / "upload").write_text("data")
        workers = server.workers()
        server.stop(signal.SIGKILL)
        assert all(has_ended(pid) for pid in workers)
        server.start()
        assert list(server.temporary.glob("accelcal-*")) == first
        assert (first[0] / "upload").read_text() == "data"
        server.stop(signal.SIGTERM)
        assert is_emptied(server.temporary)
