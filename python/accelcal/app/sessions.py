"""Workbenches by browser session: which are kept, and which make room."""

from __future__ import annotations

import secrets
import shutil
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from accelcal.app.session_file import Keeper, KeptSession
from accelcal.app.workbench import Workbench
from accelcal.app.workers import Compute, direct

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
    seen: float = field(default_factory=time.monotonic)
    """When a page last showed it, on the monotonic clock, s."""
    pages: list[Callable[[], bool]] = field(default_factory=list)
    """For each page, whether it is still connected."""

    @property
    def in_use(self) -> bool:
        """Whether a page shows it or something is under way."""
        self.pages = [connected for connected in self.pages if connected()]
        if self.pages or self.bench.job is not None:
            self.seen = time.monotonic()
            return True
        return False

    @property
    def can_go(self) -> bool:
        """Whether it may make room: nobody looks at it, and either it is empty or nobody has looked for long."""
        return not self.in_use and (self.bench.state.file is None or time.monotonic() - self.seen > IDLE)


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
        return [kept for kept in self.keeper.listed() if kept.name not in self._kept]

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
            self._kept[name].seen = time.monotonic()

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
