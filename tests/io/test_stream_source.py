"""Sources of a running measurement: read by a thread of their own, bounded, and refused in one sentence."""

from __future__ import annotations

import os
import pty
import socket
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from accelcal.data.recording import RecordingError
from accelcal.io.stream import ByteSource, Intake, open_file, open_serial, open_tcp

MOST = 60.0
"""Longest wait for anything, s."""


def of_chunks(chunks: Iterator[bytes | None], *, waits: bool) -> ByteSource:
    return ByteSource(
        "made", lambda: next(chunks, b""), lambda: None, waits=waits, from_its_start=True, ends_lines=True
    )


def everything(intake: Intake, pause: float = 0.0) -> list[bytes | None]:
    taken: list[bytes | None] = []
    while not intake.ended:
        taken += intake.take(1.0)
        time.sleep(pause)
    return taken


@pytest.mark.parametrize("most", [100, 1 << 20])
def test_a_sender_that_waits_loses_nothing(most: int) -> None:
    chunks = [b"%6d\n" % i for i in range(2000)]
    intake = Intake(of_chunks(iter(chunks), waits=True), most)
    assert b"".join(c for c in everything(intake, pause=0.001 if most == 100 else 0.0) if c) == b"".join(chunks)
    assert intake.dropped == 0


def test_bytes_beyond_the_limit_are_dropped_counted_and_marked() -> None:
    chunks = [b"%6d\n" % i for i in range(100)]
    intake = Intake(of_chunks(iter(chunks), waits=False), most=70)
    intake._thread.join(MOST)
    assert not intake._thread.is_alive()
    taken = everything(intake)
    assert taken == [b"".join(chunks[:10]), None]  # lines that wait come as one block
    assert intake.dropped == 90 * 7


def test_a_source_that_breaks_keeps_what_came() -> None:
    def broken() -> Iterator[bytes]:
        yield b"1,1,1\n"
        raise OSError(5, "Input/output error")

    intake = Intake(of_chunks(broken(), waits=True))
    assert everything(intake) == [b"1,1,1\n"]
    assert intake.error is not None
    assert intake.error.strerror == "Input/output error"


@pytest.mark.parametrize("error", [TypeError("byref() argument"), ValueError()], ids=repr)
def test_a_driver_that_raises_anything_ends_the_source(error: Exception) -> None:
    def broken() -> Iterator[bytes]:
        yield b"1,1,1\n"
        raise error

    intake = Intake(of_chunks(broken(), waits=True))
    began, taken = time.monotonic(), list[bytes | None]()
    while not intake.ended and time.monotonic() < began + MOST:
        taken += intake.take(1.0)
    assert intake.ended
    assert taken == [b"1,1,1\n"]
    assert intake.error is error


def test_a_connection_gives_its_bytes_and_ends() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        def serve() -> None:
            server.settimeout(MOST)
            connection, _ = server.accept()
            with connection:
                connection.settimeout(MOST)
                for i in range(100):
                    connection.sendall(b"%d\n" % i)
                time.sleep(0.5)  # longer than one patience: no bytes are no end
                connection.sendall(b"last\n")

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        source = open_tcp("127.0.0.1", port)
        try:
            text = b"".join(c for c in everything(Intake(source)) if c)
        finally:
            source.close()
            thread.join(MOST)
    assert text == b"".join(b"%d\n" % i for i in range(100)) + b"last\n"


def test_a_port_gives_its_bytes_until_it_is_stopped() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    source = open_serial(os.ttyname(slave), 115200)
    try:
        intake = Intake(source)
        os.write(master, b"1,2,3\n")
        assert b"".join(c for c in intake.take(MOST) if c).startswith(b"1")
        assert intake._thread.is_alive()
        intake.stop()
        assert not intake._thread.is_alive()
    finally:
        source.close()
        os.close(master)
        os.close(slave)


def test_what_cannot_be_opened_is_one_sentence(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        free = server.getsockname()[1]
    with pytest.raises(RecordingError, match="no connection"):
        open_tcp("127.0.0.1", free)
    with pytest.raises(RecordingError, match="cannot be opened"):
        open_serial(str(tmp_path / "absent"), 9600)
    with pytest.raises(RecordingError, match="no such file"):
        open_file(tmp_path / "absent")
    with pytest.raises(RecordingError, match="directory"):
        open_file(tmp_path)
