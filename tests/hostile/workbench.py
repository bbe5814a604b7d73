"""A workbench that runs as a user would run it, in folders of its own, and raw requests to it."""

from __future__ import annotations

import http.client
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal import io
from accelcal.app.server import HOST, free_port
from accelcal.simulation import CXL02_RIG

LONG = 240_000
"""ms; a loaded machine takes its time."""


def port_of_worker() -> int:
    """Return a free port; processes that look for one at the same moment begin at different places."""
    return free_port(int(np.random.default_rng(os.getpid()).integers(20_000, 32_000)))


class Served:
    """A server in a process of its own; `start` and `stop` may be repeated, its folders stay."""

    def __init__(self, place: Path) -> None:
        self.temporary, self.state = place / "temporary", place / "state"
        self.temporary.mkdir()
        # Below the ports that the system hands out: there `start` could connect to itself, before the server listens.
        self.port = port_of_worker()
        self.log = place / "log"
        self.process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        """Where it is served."""
        return f"http://{HOST}:{self.port}"

    def start(self) -> None:
        """Start it, and wait until it listens."""
        passed = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "NICEGUI"))}
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "accelcal", "app", "--no-browser", "--port", str(self.port)],
                cwd=self.temporary.parent,
                env={**passed, "TMPDIR": str(self.temporary), "ACCELCAL_STATE": str(self.state)},
                stdout=log,
                stderr=log,
            )
        while True:
            assert self.process.poll() is None, self.log.read_text()
            with socket.socket() as probe:
                if probe.connect_ex((HOST, self.port)) == 0:
                    return
            time.sleep(0.1)

    def stop(self, number: int = signal.SIGTERM) -> int:
        """Send a signal, wait, and return the exit code."""
        assert self.process is not None
        self.process.send_signal(number)
        return self.process.wait(60)

    def workers(self) -> list[int]:
        """Process numbers of its workers."""
        assert self.process is not None
        return [pid for pid in descendants(self.process.pid) if "accelcal.app.workers" in command_of(pid)]

    def sessions(self) -> set[str]:
        """Names of the sessions that it holds."""
        return {folder.name for folder in self.temporary.glob("accelcal-*/*") if folder.is_dir()}

    def ask(
        self, path: str = "/", method: str = "GET", headers: Mapping[str, str] | None = None, body: bytes | None = None
    ) -> tuple[int, dict[str, str], str]:
        """Answer to one request: status, headers in small letters, text."""
        connection = http.client.HTTPConnection(HOST, self.port, timeout=60)
        try:
            connection.request(method, path, body, dict(headers or {}))
            answer = connection.getresponse()
            text = answer.read().decode(errors="replace")
            return answer.status, {name.lower(): value for name, value in answer.getheaders()}, text
        finally:
            connection.close()


def command_of(pid: int) -> str:
    """Command line of a process; empty where it has gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return ""


def descendants(root: int) -> list[int]:
    """Processes below another."""
    children: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        children.setdefault(int(fields[1]), []).append(int(stat.parent.name))
    result, left = [], [root]
    while left:
        below = children.get(left.pop(), [])
        result += below
        left += below
    return result


def has_ended(pid: int, within: float = 30.0) -> bool:
    """Whether a process ends within a time, s."""
    end = time.monotonic() + within
    while time.monotonic() < end:
        if not command_of(pid):
            return True
        time.sleep(0.05)
    return False


def is_emptied(folder: Path, within: float = 30.0) -> bool:
    """Whether nothing is left in a folder within a time, s: the last worker may still be leaving."""
    end = time.monotonic() + within
    while any(folder.iterdir()) and time.monotonic() < end:
        time.sleep(0.05)
    return not any(folder.iterdir())


@contextmanager
def serving() -> Iterator[Served]:
    """A running workbench; it is stopped, and its folders removed."""
    place = Path(tempfile.mkdtemp())
    server = Served(place)
    try:
        server.start()
        yield server
    finally:
        if server.process is not None and server.process.poll() is None:
            server.stop(signal.SIGKILL)
        shutil.rmtree(place, ignore_errors=True)


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    """One workbench for the tests of a file."""
    pytest.importorskip("nicegui")
    with serving() as server:
        yield server


def write(path: Path, seed: int, seconds: float = 20.0) -> Path:
    """A simulated recording with a hidden cubic, and its sidecar."""
    parameters = {"bias": 0.05, "scale_factor": 0.01, "cubic": 4e-3}
    rng = np.random.default_rng(seed)
    recording = ac.simulate("interleaved", seconds=seconds, rig=CXL02_RIG, parameters=parameters, rng=rng).recording
    io.write_sidecar(recording.rig, io.write_csv(recording, path), io.sidecar_of(path))
    return path
