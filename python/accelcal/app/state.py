"""What the workbench knows at one moment: the data, how they are divided, and a tree of models. Values, no actions."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from accelcal.data.recording import Recording
from accelcal.effects import Own
from accelcal.estimation.estimate import Fit
from accelcal.plots.interactive.timeline import Marks
from accelcal.validation.comparison import Comparison

Stretch = tuple[float, float]
"""From, to, s."""


@dataclass(frozen=True, slots=True)
class Step:
    """One model of the tree."""

    key: int
    parent: int | None
    label: str
    """What is new here, for people: base, + cubic, bias held."""
    python: str
    """The expression that makes its fit, with PARENT for the one before."""
    command: str
    """The same on the command line, with PARENT and THIS for the model files."""
    fit: Fit
    heldout: Comparison
    """Against the data that no fit has seen."""


@dataclass(frozen=True, slots=True)
class State:
    """Everything that undo gives back."""

    file: Path | None = None
    sidecar: str | None = None
    """Text that stands in the place of the sidecar beside the file; None = that one, if any."""
    columns: tuple[str, ...] = ()
    trouble: str = ""
    """Why the file is not understood; empty when it is."""
    recording: Recording | None = None
    used: Stretch = (0.0, 0.0)
    """On which one model can hold."""
    marks: Marks | None = None
    """Breaks, faults and rest on the time line."""
    breaks: tuple[float, ...] = ()
    held_out: Stretch | None = None
    """Part of the recording that no fit sees; None when another recording is held out."""
    other: Recording | None = None
    """Held-out recording."""
    left_out: tuple[Stretch, ...] = ()
    own: tuple[Own, ...] = ()
    steps: tuple[Step, ...] = ()
    current: int | None = None

    @property
    def step(self) -> Step | None:
        """The model that is looked at."""
        return next((s for s in self.steps if s.key == self.current), None)

    @property
    def path(self) -> tuple[Step, ...]:
        """From the base to the model that is looked at."""
        found: list[Step] = []
        by_key = {s.key: s for s in self.steps}
        key = self.current
        while key is not None:
            found.append(by_key[key])
            key = by_key[key].parent
        return tuple(reversed(found))

    @property
    def previous(self) -> Step | None:
        """The model before the one that is looked at."""
        return self.path[-2] if len(self.path) > 1 else None

    @property
    def own_files(self) -> str:
        """How the command line is told of the user's own effects."""
        return "".join(f" --effects-file {own.effect.name}.py" for own in self.own)

    @property
    def data(self) -> Recording:
        """What is used of the recording, the held-out part included."""
        assert self.recording is not None
        whole = self.recording
        if self.breaks:
            whole = whole.part(*self.used)
        return whole.without(*self.left_out)

    @property
    def train(self) -> Recording:
        """What models are fitted to."""
        return self.data if self.held_out is None else self.data.without(self.held_out)

    @property
    def unseen(self) -> Recording:
        """What no fit has seen."""
        if self.other is not None:
            return self.other
        assert self.held_out is not None
        return self.data.part(*self.held_out)


@dataclass
class Job:
    """Work that is under way."""

    title: str
    share: float = 0.0
    cancelled: bool = field(default=False)

    def report(self, share: float) -> None:
        """Take note of progress.

        Raises
        ------
        Cancelled
            If nobody waits for the result any more.
        """
        if self.cancelled:
            raise Cancelled
        self.share = max(self.share, min(1.0, share))


class Cancelled(Exception):
    """The user does not want the result any more."""
