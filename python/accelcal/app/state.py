"""State of the workbench: the data, how they are divided, and a tree of models. Values, no actions."""

from __future__ import annotations

import json
import shlex
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from accelcal._support.progress import time_left
from accelcal.app.opened_session import OpenedSession
from accelcal.data.recording import Recording
from accelcal.effects import Own
from accelcal.estimation.estimate import Fit
from accelcal.plots.interactive.timeline import Marks
from accelcal.validation.comparison import Comparison

Stretch = tuple[float, float]
"""From, to, s."""


def quoted(text: str) -> str:
    """A text as a Python script writes it, whatever it holds."""
    return json.dumps(text, ensure_ascii=False)


@dataclass(frozen=True, slots=True)
class Change:
    """How a model came from its parent."""

    kind: Literal["base", "add", "drop", "hold", "release"]
    name: str
    """Of the base model (linear, cubic), the effect or the parameter."""
    value: float = 0.0
    """At which a parameter is held, SI."""

    @property
    def label(self) -> str:
        """What distinguishes the model from its parent, for people."""
        texts = {"base": "base", "add": f"+ {self.name}", "drop": f"− {self.name}"}
        return texts.get(self.kind) or f"{self.name} {'fixed' if self.kind == 'hold' else 'free'}"

    @property
    def python(self) -> str:
        """The expression that makes the fit, with PARENT for the one before."""
        if self.kind == "base":
            return f"ac.fit(ac.Model.{self.name}(), train)"
        if self.kind in ("add", "drop"):
            return f"ac.{self.kind}(PARENT, train, {quoted(self.name)})"
        name = quoted(self.name)
        held = f"freeze(**{{{name}: {self.value!r}}})" if self.kind == "hold" else f"release({name})"
        return f"ac.fit(PARENT.model.{held}, train, origins=PARENT.origins)"

    def command(self, own_files: str) -> str:
        """The shell command that makes the model, with PARENT and THIS for the model files."""
        if self.kind == "base":
            return f"accelcal fit train.csv --model {self.name} -o THIS"
        name = shlex.quote(self.name)
        if self.kind in ("add", "drop"):
            return f"accelcal {self.kind} PARENT train.csv --effect {name}{own_files} -o THIS"
        held = f"--at {name}={self.value!r}" if self.kind == "hold" else f"--release {name}"
        return f"accelcal freeze PARENT train.csv {held}{own_files} -o THIS"


@dataclass(frozen=True, slots=True)
class Step:
    """One model of the tree."""

    key: int
    parent: int | None
    change: Change
    fit: Fit
    heldout: Comparison
    """Against the held-out data."""

    @property
    def label(self) -> str:
        """What distinguishes this model from its parent, for people: base, + cubic, bias fixed."""
        return self.change.label


@dataclass(frozen=True, slots=True)
class State:
    """Everything that undo restores."""

    file: Path | None = None
    sidecar: str | None = None
    """Text that replaces the sidecar next to the file; None: use that one, if any."""
    columns: tuple[str, ...] = ()
    template: str = ""
    """A commented sidecar for the columns of the file."""
    problem: str = ""
    """Why the columns of the file are not understood; empty when they are."""
    recording: Recording | None = None
    summary: Mapping[str, Any] = field(default_factory=dict)
    """What the check of the recording found, for the page."""
    used: Stretch = (0.0, 0.0)
    """Part on which one model can hold."""
    marks: Marks | None = None
    """Breaks, faults and rest on the time line."""
    breaks: tuple[float, ...] = ()
    held_out: Stretch | None = None
    """Part of the recording that is not fitted; None when another recording is held out."""
    other: Recording | None = None
    """Held-out recording."""
    other_file: Path | None = None
    """Where it was read from."""
    excluded: tuple[Stretch, ...] = ()
    own: tuple[Own, ...] = ()
    steps: tuple[Step, ...] = ()
    current: int | None = None
    opened: OpenedSession | None = None
    """A session that waits for a recording, in place of all else."""

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
    began: float = field(default_factory=time.monotonic)
    """On the monotonic clock, s."""
    cancelled: bool = field(default=False)

    @property
    def left(self) -> str:
        """The time that is left, for people."""
        return time_left(time.monotonic() - self.began, self.share)

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
