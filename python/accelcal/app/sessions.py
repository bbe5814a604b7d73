"""Workbenches and running measurements by browser session: which are kept, which make room, and when they end."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import subprocess
import sys
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from accelcal._support.process import OWN_GROUP
from accelcal.app.session_file import Keeper, KeptSession
from accelcal.app.workbench import Workbench
from accelcal.app.workers import Compute, direct
from accelcal.live.session import LiveEvent, LiveHistory
from accelcal.results.table import capital

MOST = 32
"""Workbenches at a time."""
IDLE = 600.0
"""Time after which work that no page shows may make room for new work, s."""


class Full(Exception):
    """No workbench can make room. The text says what to do."""


@dataclass
class Session:
    """A workbench and the pages that show it."""

    bench: Workbench
    last_used: float = field(default_factory=time.monotonic)
    """When a page last showed it, on the monotonic clock, s."""
    pages: list[Callable[[], bool]] = field(default_factory=list)
    """For each page, whether it is still connected."""

    @property
    def in_use(self) -> bool:
        """Whether a page shows it or something is under way."""
        self.pages = [connected for connected in self.pages if connected()]
        if self.pages or self.bench.job is not None:
            self.last_used = time.monotonic()
            return True
        return False

    @property
    def can_go(self) -> bool:
        """Whether it may make room: nobody looks at it, and either it is empty or nobody has looked for long."""
        return not self.in_use and (self.bench.state.file is None or time.monotonic() - self.last_used > IDLE)


class Workbenches:
    """The workbenches of this server by their secret names."""

    def __init__(self, folder: Path, keeper: Keeper, recording: Path | None = None, compute: Compute = direct) -> None:
        self.folder = folder
        self.keeper = keeper
        self.recording = recording
        """Loaded into every new workbench: a recording or a session file."""
        self._compute = compute
        self._kept: OrderedDict[str, Session] = OrderedDict()

    def new(self, name: str = "") -> str:
        """Make a workbench and return its name; with `name` that of kept work, unless it is there already.

        Raises
        ------
        Full
            If there are too many, and each is in use or was until a short time ago.
        """
        if name in self._kept:
            return name
        self._make_room()
        name = name or secrets.token_urlsafe(12)
        home = self.folder / name
        home.mkdir(mode=0o700, exist_ok=True)  # that of a session of a killed server is there
        bench = Workbench(home, self._compute)
        bench.changed = lambda state: self.keeper.keep(name, state)
        self._kept[name] = Session(bench)
        return name

    def earlier(self) -> list[KeptSession]:
        """Work that was kept and is not open in this server."""
        return [session for session in self.keeper.listed() if session.name not in self._kept]

    def find(self, name: str) -> Workbench | None:
        """Return the workbench called `name`, or None if it has been deleted."""
        if name not in self._kept:
            return None
        self._kept.move_to_end(name)
        return self._kept[name].bench

    def show(self, name: str, connected: Callable[[], bool]) -> None:
        """Note a page that shows a workbench; `connected` tells for how long."""
        if name in self._kept:
            self._kept[name].pages.append(connected)
            self._kept[name].last_used = time.monotonic()

    def _make_room(self) -> None:
        if len(self._kept) < MOST:
            return
        oldest = next((name for name, session in self._kept.items() if session.can_go), None)
        if oldest is None:
            raise Full(
                f"{MOST} sessions are open, and this server has room for no more. Close a tab of the workbench and "
                f"wait {IDLE / 60:.0f} minutes, or start a second server: accelcal app"
            )
        self._kept.pop(oldest).bench.cancel()
        shutil.rmtree(self.folder / oldest, ignore_errors=True)


EVERY = "0.25 s"
"""Time between two states."""
PATIENCE = 15.0
"""Time that a process which was asked to end has for its last rows, s."""
MOST_SAID = 20
"""Lines of its messages that are kept."""
Kind = Literal["TCP server", "serial port", "file"]
KINDS: tuple[Kind, ...] = ("TCP server", "serial port", "file")
"""Of sources."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What is to be followed, with what, and where it is recorded."""

    kind: Kind
    address: str
    """HOST:PORT, the name of the port, or the path of the file."""
    rig: Path
    recording: Path
    model: Path | None = None
    baud: int = 115_200
    follow: bool = True
    """Whether further lines are awaited at the end of a file."""

    @property
    def words(self) -> list[str]:
        """The words of the command; what a user has typed is never an option of its own."""
        sources = {
            "TCP server": [f"--tcp={self.address}"],
            "serial port": [f"--serial={self.address}", f"--baud={self.baud}"],
            "file": [f"--file={self.address}", *(["--follow"] if self.follow else [])],
        }
        model = [] if self.model is None else [f"--model={self.model}"]
        return ["live", *sources[self.kind], f"--rig={self.rig}", *model, f"--output={self.recording}"]


class Follower:
    """The process, from its start to its end.

    Parameters
    ----------
    asked : what it follows.
    folder : where it runs; nothing is imported from it that others may have written.
    """

    def __init__(self, asked: Asked, folder: Path) -> None:
        self.asked = asked
        self.history = LiveHistory()
        self.version = 0
        """Incremented with everything that a page must show."""
        self.ended = False
        self.sentence = ""
        """Why it could not go on; empty where it ended in order."""
        self.pages: set[str] = set()
        """Pages that show it."""
        self.lock = threading.Lock()
        """Held while `history` changes."""
        self._said: deque[str] = deque(maxlen=MOST_SAID)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "accelcal", *asked.words, "--json", f"--every={EVERY}"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            cwd=folder,
            **OWN_GROUP,
        )
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    @property
    def has_recording(self) -> bool:
        """Whether there is a file of rows."""
        return self.asked.recording.is_file()

    def stop(self) -> None:
        """Ask it to write its last rows and to end; it is killed where it does not."""
        if self.process.poll() is None:
            self.process.terminate()
            threading.Thread(target=self._insist, daemon=True).start()

    def wait(self) -> None:
        """Wait until it has ended and all that it said is known."""
        self._listener.join(PATIENCE)

    def show(self, page: str) -> None:
        """Note a page that shows it."""
        self.pages.add(page)

    def forget(self, page: str) -> None:
        """A page is gone for good; it was the last to show this, so nobody looks any more."""
        self.pages.discard(page)
        if not self.pages:
            self.stop()

    def _insist(self) -> None:
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            try:
                event = LiveEvent.from_json(line)
            except ValueError:
                self._said.append(line)
                continue
            with self.lock:
                self.history.add(event)
                self.version += 1
        status = self.process.wait()
        with self.lock:
            self.sentence = self._complaint(status)
            self.ended = True
            self.version += 1

    def _complaint(self, status: int) -> str:
        """What the process said against what it was asked, in words of the page."""
        newest = self.history.newest
        if newest is not None and newest.ended and not newest.ended.startswith("the source broke off"):
            return ""
        if newest is not None and newest.ended:
            return f"{capital(newest.ended)}. The recording holds what came until then."
        text = "".join(line for line in self._said if not line.startswith("wrote ")).strip()
        text = text.removeprefix("accelcal: ").removeprefix("live: ")
        for option, word in (("--output", "recording"), ("--model", "a model"), ("--tcp", "address")):
            text = text.replace(option, word)
        return text or f"accelcal live has ended with status {status}."


class Followers:
    """The running measurements of a server, at most one for each session.

    Parameters
    ----------
    folder : where their processes run.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._by_session: dict[str, Follower] = {}

    def find(self, session: str) -> Follower | None:
        """The newest of a session; None where there is none."""
        return self._by_session.get(session)

    def start(self, session: str, asked: Asked) -> Follower:
        """Follow something in a session, in place of what it followed before."""
        self.clear(session)
        follower = self._by_session[session] = Follower(asked, self.folder)
        return follower

    def clear(self, session: str) -> None:
        """Forget what a session followed; it ends."""
        before = self._by_session.pop(session, None)
        if before is not None:
            before.stop()

    def close(self) -> None:
        """End all, their recordings complete."""
        followers = list(self._by_session.values())
        self._by_session.clear()
        for follower in followers:
            follower.stop()
        for follower in followers:
            follower.wait()


def recording_path(folder: Path, name: str, fallback: Path) -> Path:
    """Where a recording called `name` goes: into `folder`, or into `fallback` where nothing can be written there."""
    bare = re.sub(r"[^\w.+ -]", "_", name.strip().replace("\\", "/").rpartition("/")[2]).lstrip(". ")
    stem = bare.removesuffix(".parquet")[:80] or "live"
    return (folder if os.access(folder, os.W_OK) else fallback) / f"{stem}.parquet"
