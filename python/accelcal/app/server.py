"""The workbench as a local web server: loopback only, one folder and one workbench for every tab."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from accelcal.app.kept import Keeper, state_folder
from accelcal.app.sessions import Workbenches
from accelcal.app.workbench import MOST_BYTES
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
OWNER = "server.pid"
"""File in it that names the process."""
KEPT_FOR = 86_400.0
"""Age from which the folder of a killed server is removed, s."""
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
    raise OSError(f"ports {first} to {first + TRIED - 1} are all in use; choose another with --port")


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
    from accelcal._support.extras import MissingExtra

    try:
        from nicegui import app, core, ui
        from starlette.middleware.trustedhost import TrustedHostMiddleware

        from accelcal.app.guard import Guard
        from accelcal.app.routes import install
    except ImportError as error:
        raise MissingExtra('the workbench needs nicegui; install it with: pip install "accelcal[app]"') from error
    chosen = free_port(PORT) if port is None else port
    signal.signal(signal.SIGTERM, _end)
    sweep(Path(tempfile.gettempdir()))
    folder = Path(tempfile.mkdtemp(prefix=PREFIX))
    (folder / OWNER).write_text(str(os.getpid()))
    tempfile.tempdir = str(folder)  # uploads that are on their way vanish with the rest
    workers = Workers(folder)
    keeper = Keeper(state_folder())
    workbenches = Workbenches(folder, keeper, recording, workers)
    try:
        workers.start_one()
        install(workbenches)
        core.sio.eio.cors_allowed_origins = None  # the server's own origin alone
        core.sio.eio.cors_credentials = False
        app.add_middleware(Guard, folder=folder, most=MOST_UPLOAD)
        app.add_middleware(TrustedHostMiddleware, allowed_hosts=list(NAMES))
        app.on_shutdown(workers.close)
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
        workers.close()
        keeper.close()
        tempfile.tempdir = None
        shutil.rmtree(folder, ignore_errors=True)


def sweep(place: Path) -> None:
    """Remove folders of servers that were killed and have been gone for a day; until then their uploads may be used."""
    for owner in place.glob(f"{PREFIX}*/{OWNER}"):
        with suppress(OSError, ValueError):
            if owner.is_symlink() or time.time() - owner.stat().st_mtime < KEPT_FOR:
                continue
            if not is_alive(int(owner.read_text()[:20])):
                shutil.rmtree(owner.parent, ignore_errors=True)


def is_alive(pid: int) -> bool:
    """Whether a process of that number exists."""
    if sys.platform == "win32":
        return True  # a signal would end it there
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _end(number: int, frame: Any) -> None:
    """End as Ctrl-C does, so that nothing stays in the temporary folder."""
    sys.exit(128 + number)
