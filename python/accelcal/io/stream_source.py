"""Where lines of a running measurement come from: a serial port, a TCP server, a file; read by a thread of its own."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from accelcal._support.errors import MissingExtra
from accelcal.data.recording import RecordingError
from accelcal.io.files import open_regular

PATIENCE = 0.2
"""Longest wait for bytes before a source is asked whether it should end, s."""
CONNECT = 10.0
"""Longest wait for a TCP server to answer, s."""
CHUNK = 1 << 16
"""Most bytes of one read."""
MOST_WAITING = 1 << 26
"""Most bytes that wait to be processed; 10 kHz of 30 bytes a line for 3 min."""
MOST_KEPT_WAITING = 1 << 18
"""The same of a sender that is kept waiting beyond it."""


@dataclass(frozen=True, slots=True)
class ByteSource:
    """An open source of bytes."""

    name: str
    """As messages show it."""
    read: Callable[[], bytes | None]
    """Next bytes, b"" at the end, None where none came within `PATIENCE`; raises where the source breaks."""
    close: Callable[[], None]
    waits: bool
    """Whether the sender waits for a slow reader; else bytes that nobody reads are lost."""
    from_its_start: bool
    """Whether the first byte begins a line."""
    ends_lines: bool
    """Whether the last line is whole although no line end follows."""


def open_file(path: Path) -> ByteSource:
    """A recorded stream.

    Raises
    ------
    RecordingError
        If there is no such file, or it is none.
    """
    file = _opened(path)
    return ByteSource(str(path), lambda: file.read(CHUNK), file.close, waits=True, from_its_start=True, ends_lines=True)


def open_growing(path: Path) -> ByteSource:
    """A file that another program appends lines to; it has no end, but breaks off where it is cut or replaced.

    Raises
    ------
    RecordingError
        If there is no such file, or it is none.
    """
    file = _opened(path)

    def read() -> bytes | None:
        chunk = file.read(CHUNK)
        if chunk:
            return chunk
        require_growing(path, file)
        time.sleep(PATIENCE)
        return None

    return ByteSource(str(path), read, file.close, waits=True, from_its_start=True, ends_lines=False)


def _opened(path: Path) -> IO[bytes]:
    try:
        return open_regular(path, "a file of lines t,accel,position")
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such file; check the path.") from None


def require_growing(path: Path, file: IO[bytes]) -> None:
    """Refuse a file that has become shorter than what was read of it, or has another under its name now.

    Raises
    ------
    RecordingError
        Saying which.
    """
    own = os.fstat(file.fileno())
    if own.st_size < file.tell():
        raise RecordingError(f"{path} has become shorter")
    if not path.exists() or not os.path.samestat(own, path.stat()):
        raise RecordingError(f"{path} was removed or replaced")


def open_tcp(host: str, port: int) -> ByteSource:
    """A connection to a server that sends lines.

    Raises
    ------
    RecordingError
        If nobody answers within `CONNECT`.
    """
    name = f"{host}:{port}"
    try:
        connection = socket.create_connection((host, port), timeout=CONNECT)
    except OSError as error:
        raise RecordingError(
            f"{name}: no connection ({error.strerror or error}); start the server that sends the lines, and check host "
            "and port."
        ) from None
    connection.settimeout(PATIENCE)

    def read() -> bytes | None:
        try:
            return connection.recv(CHUNK)
        except TimeoutError:
            return None

    return ByteSource(name, read, connection.close, waits=True, from_its_start=True, ends_lines=False)


def open_serial(device: str, baud: int) -> ByteSource:
    """A serial port: 8 data bits, no parity, 1 stop bit.

    Raises
    ------
    MissingExtra
        Without pyserial.
    RecordingError
        If the port cannot be opened.
    """
    try:
        import serial
    except ImportError as error:
        raise MissingExtra('a serial port needs pyserial; install it with: pip install "accelcal[live]"') from error
    try:
        port: Any = serial.Serial(device, baud, timeout=PATIENCE)
    except (OSError, ValueError, OverflowError) as error:
        raise RecordingError(
            f"{device}: the serial port cannot be opened ({error}); check its name, the rate of {baud} baud, and that "
            "no other program uses it."
        ) from None

    return ByteSource(
        device,
        lambda: port.read(max(1, min(port.in_waiting, CHUNK))) or None,
        port.close,
        waits=False,
        from_its_start=False,
        ends_lines=False,
    )


class Intake:
    """Reads a source in a thread of its own, so that no work on earlier lines keeps it from reading.

    Parameters
    ----------
    source : whoever opened it closes it, after `stop`.
    most : bytes that may wait; beyond, a sender that waits is kept waiting, and bytes of any other are dropped.
    """

    def __init__(self, source: ByteSource, most: int | None = None) -> None:
        self.source = source
        self.most = most or (MOST_KEPT_WAITING if source.waits else MOST_WAITING)
        self.dropped = 0
        """Bytes that were read and thrown away, because too many waited."""
        self.error: Exception | None = None
        """Why the source ended, if it broke; a driver may raise anything."""
        self._chunks: deque[bytes | None] = deque()
        self._waiting = 0
        self._ended = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._read_all, name="intake", daemon=True)
        self._thread.start()

    def take(self, patience: float) -> list[bytes | None]:
        """All chunks that wait, None where bytes were dropped; none at the end, or after `patience`, s."""
        with self._changed:
            if not self._chunks and not self._ended:
                self._changed.wait(patience)
            taken = list(self._chunks)
            self._chunks.clear()
            self._waiting = 0
            self._changed.notify_all()
        return taken

    @property
    def ended(self) -> bool:
        """Whether nothing will come any more."""
        with self._changed:
            return self._ended and not self._chunks

    def stop(self) -> None:
        """Read no more; what waits can still be taken."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        self._thread.join(timeout=5.0 * PATIENCE)

    def _read_all(self) -> None:
        try:
            while not self._ended:
                chunk = self.source.read()
                if chunk == b"":
                    break
                if chunk is not None:
                    self._keep(chunk)
        except Exception as error:
            self.error = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _keep(self, chunk: bytes) -> None:
        with self._changed:
            while self.source.waits and self._waiting >= self.most and not self._ended:
                self._changed.wait(PATIENCE)
            if self._waiting >= self.most:
                self.dropped += len(chunk)
                if self._chunks[-1] is not None:
                    self._chunks.append(None)
                return
            self._chunks.append(chunk)
            self._waiting += len(chunk)
            self._changed.notify_all()
