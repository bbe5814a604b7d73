"""State of the workbench: the data, how they are divided, and a tree of models. Values, no actions."""

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
    """What distinguishes this model from its parent, for people: base, + cubic, bias held."""
    python: str
    """The expression that makes its fit, with PARENT for the one before."""
    command: str
    """The shell command that makes it, with PARENT and THIS for the model files."""
    fit: Fit
    heldout: Comparison
    """Against the held-out data."""


@dataclass(frozen=True, slots=True)
class State:
    """Everything that undo restores."""

    file: Path | None = None
    sidecar: str | None = None
    """Text that replaces the sidecar next to the file; None: use that one, if any."""
    columns: tuple[str, ...] = ()
    problem: str = ""
    """Why the columns of the file are not understood; empty when they are."""
    recording: Recording | None = None
    used: Stretch = (0.0, 0.0)
    """Part on which one model can hold."""
    marks: Marks | None = None
    """Breaks, faults and rest on the time line."""
    breaks: tuple[float, ...] = ()
    held_out: Stretch | None = None
    """Part of the recording that is not fitted; None when another recording is held out."""
    other: Recording | None = None
    """Held-out recording."""
    excluded: tuple[Stretch, ...] = ()
    own: tuple[Own, ...] = ()
    steps: tuple[Step, ...] = ()
    current: int | None = None

    @property
    def step(self) -> Step | None:
        """The current model."""
        return next((s for s in self.steps if s.key == self.current), None)

    @property
    def path(self) -> tuple[Step, ...]:
        """Models from the base to the current one."""
        found: list[Step] = []
        by_key = {s.key: s for s in self.steps}
        key = self.current
        while key is not None:
            found.append(by_key[key])
            key = by_key[key].parent
        return tuple(reversed(found))

    @property
    def previous(self) -> Step | None:
        """The parent of the current model."""
        return self.path[-2] if len(self.path) > 1 else None

    @property
    def own_files(self) -> str:
        """Command-line options that load the user's own effects."""
        return "".join(f" --effects-file {own.effect.name}.py" for own in self.own)

    @property
    def data(self) -> Recording:
        """Data in use, the held-out part included."""
        assert self.recording is not None
        whole = self.recording
        if self.breaks:
            whole = whole.part(*self.used)
        return whole.without(*self.excluded)

    @property
    def train(self) -> Recording:
        """Data that models are fitted to."""
        return self.data if self.held_out is None else self.data.without(self.held_out)

    @property
    def unseen(self) -> Recording:
        """Held-out data."""
        if self.other is not None:
            return self.other
        assert self.held_out is not None
        return self.data.part(*self.held_out)


@dataclass
class Job:
    """The running action."""

    title: str
    share: float = 0.0
    cancelled: bool = field(default=False)

    def report(self, share: float) -> None:
        """Record progress, 0 to 1.

        Raises
        ------
        Cancelled
            If the action was cancelled.
        """
        if self.cancelled:
            raise Cancelled
        self.share = max(self.share, min(1.0, share))


class Cancelled(Exception):
    """The user has cancelled the action."""
