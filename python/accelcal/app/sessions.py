"""Workbenches by browser session."""

from __future__ import annotations

import secrets
import shutil
from collections import OrderedDict
from pathlib import Path

from accelcal.app.workbench import Workbench

MOST = 12
"""Workbenches that are kept; the least recently used is deleted first."""


class Workbenches:
    """The workbenches of this server by their secret names."""

    def __init__(self, folder: Path, recording: Path | None = None) -> None:
        self.folder = folder
        self.recording = recording
        """Loaded into every new workbench."""
        self._kept: OrderedDict[str, Workbench] = OrderedDict()

    def new(self) -> str:
        """Make a workbench and return its name."""
        name = secrets.token_urlsafe(12)
        home = self.folder / name
        home.mkdir(mode=0o700)
        self._kept[name] = Workbench(home)
        while len(self._kept) > MOST:
            oldest, bench = self._kept.popitem(last=False)
            bench.cancel()
            shutil.rmtree(self.folder / oldest, ignore_errors=True)
        return name

    def find(self, name: str) -> Workbench | None:
        """Return the workbench called `name`, or None if it has been deleted."""
        if name in self._kept:
            self._kept.move_to_end(name)
        return self._kept.get(name)
