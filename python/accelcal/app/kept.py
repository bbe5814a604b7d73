"""Work that survives the server: session files in a folder of the user, written after every change."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from accelcal import io
from accelcal.app import session_file
from accelcal.app.state import State

MOST = 10
"""Sessions that are kept; the oldest is removed first."""
NAME = re.compile(r"[A-Za-z0-9_-]{16}")
"""Of a session: what the server draws, 12 bytes in base64."""


@dataclass(frozen=True, slots=True)
class KeptSession:
    """One session file of the folder."""

    name: str
    title: str
    saved: str
    """When, UTC."""


def state_folder() -> Path:
    """Folder of the user for kept work: ``ACCELCAL_STATE``, else the one that the system has for such files."""
    asked = os.environ.get("ACCELCAL_STATE")
    if asked:
        return Path(asked).expanduser()
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or "~/AppData/Local"
    else:
        base = os.environ.get("XDG_STATE_HOME") or "~/.local/state"
    return Path(base).expanduser() / "accelcal" / "sessions"


class Keeper:
    """Writes session files behind the page, one after the other, and lists them.

    Parameters
    ----------
    folder : made when something is kept for the first time, for the user alone.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.problem = ""
        """Why the last session could not be kept; empty after a success."""
        self._writing = ThreadPoolExecutor(1, "keeping")

    def keep(self, name: str, state: State) -> Future[None]:
        """Write the work of a session as it is now."""
        return self._writing.submit(self._write, name, state)

    def path(self, name: str) -> Path | None:
        """The file of a kept session; None where there is none."""
        if not NAME.fullmatch(name):
            return None
        path = self._path(name)
        return path if path.is_file() and not path.is_symlink() else None

    def listed(self) -> list[KeptSession]:
        """Sessions that can be read, newest first."""
        found = []
        for path in self._newest():
            with contextlib.suppress(session_file.SessionError):
                content = session_file.peek(path)
                found.append(KeptSession(path.stem, content.title, content.saved[:16].replace("T", " ")))
        return found

    def remove(self, name: str) -> None:
        """Delete a kept session."""
        path = self.path(name)
        if path is not None:
            path.unlink(missing_ok=True)

    def close(self) -> None:
        """Wait until everything is written."""
        self._writing.shutdown(wait=True)

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}{session_file.SUFFIX}"

    def _write(self, name: str, state: State) -> None:
        if state.recording is None:
            return
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            io.atomic_write(self._path(name), session_file.dumps(state))
            self._path(name).chmod(0o600)
            for old in self._newest()[MOST:]:
                old.unlink(missing_ok=True)
            self.problem = ""
        except (OSError, ValueError) as error:
            self.problem = f"This work is not kept for a later day: {error}"

    def _newest(self) -> list[Path]:
        with contextlib.suppress(OSError):
            files = [p for p in self.folder.glob(f"*{session_file.SUFFIX}") if NAME.fullmatch(p.stem) and p.is_file()]
            return sorted(files, key=lambda p: p.stat().st_mtime, reverse=True)
        return []
