"""The workbench as a local web server: loopback only, one folder and one workbench for every tab."""

from __future__ import annotations

import asyncio
import logging
import os
import shutil
import signal
import socket
import stat
import sys
import tempfile
from pathlib import Path
from typing import Any

from accelcal._support import locks
from accelcal._support.errors import AccessError
from accelcal._support.stopping import Stopped
from accelcal.app.session_file import Keeper, state_folder
from accelcal.app.sessions import Followers, Workbenches
from accelcal.app.tasks import MOST_BYTES
from accelcal.app.workers import Workers

HOST = "127.0.0.1"
NAMES = ("127.0.0.1", "localhost")
"""Host names that are answered; others are refused, as a protection against DNS rebinding."""
PORT = 8765
TRIED = 20
"""Number of ports that are tried."""
MOST_UPLOAD = MOST_BYTES + 16_000_000
"""Largest upload: a recording, its sidecar, and what the browser writes between them, bytes."""
PREFIX = "accelcal-"
"""Of the temporary folder of a server."""
OWNER = f"server-{locks.MACHINE}.lock"
"""File in it that the server keeps locked."""
GRACE = 2
"""Time that open requests have to end when the server stops, s."""


def free_port(first: int) -> int:
    """Return the first free port from `first` on.

    Raises
    ------
    OSError
        If all that are tried are in use.
    """
    for port in range(first, first + TRIED):
        with socket.socket() as probe:
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return port
    raise AccessError(f"ports {first} to {first + TRIED - 1} are all in use; choose another with --port")


def serve(recording: Path | None = None, *, port: int | None = None, show: bool = True) -> None:
    """Serve the workbench until it is interrupted.

    Parameters
    ----------
    recording : a recording, or a session file, loaded into every new workbench.
    port : on 127.0.0.1; by default the first free one from 8765 on.
    show : open a browser.

    Raises
    ------
    MissingExtra
        If NiceGUI or plotly is not installed.
    """
    from accelcal._support.errors import MissingExtra

    try:
        from nicegui import app, core, ui
        from starlette.middleware.trustedhost import TrustedHostMiddleware

        from accelcal.app.routes import Guard, install
    except ImportError as error:
        raise MissingExtra('the workbench needs nicegui; install it with: pip install "accelcal[app]"') from error
    chosen = free_port(PORT) if port is None else port
    signal.signal(signal.SIGTERM, _end)
    ending = Ending()
    folder, lock = claimed(Path(tempfile.gettempdir()))
    tempfile.tempdir = str(folder)  # uploads that are on their way vanish with the rest
    workers = Workers(folder)
    keeper = Keeper(state_folder())
    workbenches = Workbenches(folder, keeper, recording, workers)
    followers = Followers(folder)
    try:
        workers.start_one()
        install(workbenches, followers)
        core.sio.eio.cors_allowed_origins = None  # the server's own origin alone
        core.sio.eio.cors_credentials = False
        app.add_middleware(Guard, folder=folder, most=MOST_UPLOAD)
        app.add_middleware(TrustedHostMiddleware, allowed_hosts=list(NAMES))
        app.on_shutdown(workers.close)
        app.on_startup(ending.watch)
        print(f"accelcal workbench: http://{HOST}:{chosen}/ (Ctrl-C to stop)", flush=True)
        ui.run(
            host=HOST,
            port=chosen,
            title="accelcal",
            dark=None,
            language="en-US",
            show=show,
            reload=False,
            show_welcome_message=False,
            reconnect_timeout=30.0,
            timeout_graceful_shutdown=GRACE,
        )
    finally:
        followers.close()
        workers.close()
        keeper.close()
        tempfile.tempdir = None
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)
    ending.require_none()


def claimed(place: Path) -> tuple[Path, int]:
    """A folder for this server, and the descriptor of its lock.

    It is the newest that a killed server has left, since its sessions find their recordings there, or a new one. Older
    ones that were left are removed.

    Parameters
    ----------
    place : folder for temporary files.
    """
    folders = [
        (owner.parent, locks.take(owner)) for owner in place.glob(f"{PREFIX}*/{OWNER}") if is_private(owner.parent)
    ]
    left = sorted(((f, lock) for f, lock in folders if lock is not None), key=lambda item: item[0].stat().st_mtime)
    for folder, lock in left[:-1]:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)
    if left:
        return left[-1]
    while True:
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=place))
        lock_file = locks.create(folder / OWNER, 0o600)
        if lock_file is not None:  # else another server took it for one that was left
            return folder, lock_file


def is_private(folder: Path) -> bool:
    """Whether a folder is this user's and nobody else may look into it."""
    if not hasattr(os, "getuid"):
        return True
    there = folder.lstat()
    return stat.S_ISDIR(there.st_mode) and there.st_uid == os.getuid() and not there.st_mode & 0o077


class Ending(logging.Filter):
    """How the web server ends: a closed terminal asks it to end in order, and requests cut off are not reported."""

    def __init__(self) -> None:
        super().__init__()
        self._number = 0

    def watch(self) -> None:
        """Begin; the web server runs, and has handlers of its own for Ctrl-C and SIGTERM."""
        logging.getLogger("uvicorn.error").addFilter(self)
        if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            signal.signal(signal.SIGHUP, self._hang_up)

    def require_none(self) -> None:
        """Raise `Stopped` if the terminal was closed."""
        if self._number:
            raise Stopped(self._number)

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is news: what is cut off when the server ends is none."""
        from nicegui.server import Server

        error = record.exc_info[1] if record.exc_info else None
        cut = isinstance(error, asyncio.CancelledError | Stopped) or record.getMessage().startswith("Cancel ")
        return not (Server.instance.should_exit and cut)

    def _hang_up(self, number: int, frame: Any) -> None:
        from nicegui import app

        self._number = number
        app.shutdown()


def _end(number: int, frame: Any) -> None:
    """End as Ctrl-C does, so that nothing stays in the temporary folder."""
    sys.exit(128 + number)
