"""One file of a workbench, a recording or dwells: what is known of it, what it is used for, and how it is divided."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

from accelcal.data.dwells import Dwells
from accelcal.data.recording import Recording
from accelcal.plots.timeline import Marks
from accelcal.validation.comparison import HELD_OUT

Stretch = tuple[float, float]
"""From, to, s."""
Role: TypeAlias = Literal["fit", "hold out", "leave out"]
"""What a file is used for: models are fitted to it, or compared with it alone, or neither."""


@dataclass(frozen=True, slots=True)
class Run:
    """A file as the workbench holds it."""

    file: Path
    sidecar: str | None = None
    """Text that replaces the sidecar next to the file; None: use that one, if any."""
    lender: str = ""
    """File whose rig it has, where it has no sidecar of its own; empty otherwise."""
    columns: tuple[str, ...] = ()
    template: str = ""
    """A commented sidecar for the columns of the file."""
    problem: str = ""
    """Why the columns of the file are not understood; empty when they are."""
    recording: Recording | None = None
    dwells: Dwells | None = None
    summary: Mapping[str, Any] = field(default_factory=dict)
    """What the check of the recording found, for the page."""
    used: Stretch = (0.0, 0.0)
    """Part on which one model can hold."""
    marks: Marks | None = None
    """Breaks, faults and rest on the time line."""
    breaks: tuple[float, ...] = ()
    role: Role = "fit"
    held_out: Stretch | None = None
    """Part of a fitted recording that is held out; None: it is fitted whole."""
    excluded: tuple[Stretch, ...] = ()

    @property
    def name(self) -> str:
        """File name."""
        return self.file.name

    @property
    def known(self) -> Recording | Dwells | None:
        """What was read; None where the columns are not understood."""
        return self.recording if self.recording is not None else self.dwells

    @property
    def digest(self) -> str:
        """SHA-256 of the file, hex; empty where it is not understood."""
        return self.known.digest if self.known is not None else ""

    @property
    def data(self) -> Recording:
        """Data in use, the held-out part included."""
        assert self.recording is not None
        whole = self.recording.part(*self.used) if self.breaks else self.recording
        return whole.without(*self.excluded)

    @property
    def train(self) -> Recording | Dwells | None:
        """What models are fitted to; None where they are not."""
        if self.role != "fit" or self.known is None:
            return None
        if self.dwells is not None:
            return self.dwells
        return self.data if self.held_out is None else self.data.without(self.held_out)

    @property
    def holds_out(self) -> bool:
        """Whether it, or a part of it, is held out."""
        return self.recording is not None and (self.role == "hold out" or self.held_out is not None)

    @property
    def unseen(self) -> Recording | None:
        """What models are compared with; None where nothing of it is held out."""
        if not self.holds_out:
            return None
        return self.data if self.held_out is None else self.data.part(*self.held_out)

    @property
    def end(self) -> Stretch:
        """The part at the end that is held out where nothing else is."""
        assert self.recording is not None
        begin, finish = self.used
        return round(finish - HELD_OUT * (finish - begin), 3), finish if self.breaks else time_span(self.recording)[1]


def time_span(recording: Recording) -> Stretch:
    """First and last time stamp of any channel, s."""
    channels = [c for c in (recording.accel, recording.position, *recording.side.values()) if len(c)]
    return min(float(c.t[0]) for c in channels), max(float(c.t[-1]) for c in channels)
