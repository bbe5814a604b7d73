"""State of the workbench: the data, how they are divided, and a tree of models. Values, no actions."""

from __future__ import annotations

import json
import shlex
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from accelcal._support.progress import time_left
from accelcal.app.opened_session import OpenedSession
from accelcal.app.run import Run
from accelcal.data.dwells import Dwells
from accelcal.data.recording import Recording
from accelcal.effects import Own
from accelcal.estimation.estimate import Fit
from accelcal.validation.comparison import Evaluation
from accelcal.validation.pooled import pooled


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
            return f"ac.fit(train, ac.Model.{self.name}())"
        if self.kind in ("add", "drop"):
            return f"ac.{self.kind}(PARENT, train, {quoted(self.name)})"
        name = quoted(self.name)
        held = f"freeze(**{{{name}: {self.value!r}}})" if self.kind == "hold" else f"release({name})"
        return f"ac.fit(train, PARENT.model.{held}, origins=PARENT.origins)"

    def command(self, own_files: str, data: str) -> str:
        """The shell command that makes the model, with PARENT and THIS for the model files, from the files `data`."""
        if self.kind == "base":
            return f"accelcal fit {data} --model {self.name} -o THIS"
        name = shlex.quote(self.name)
        if self.kind in ("add", "drop"):
            return f"accelcal {self.kind} PARENT {data} --effect {name}{own_files} -o THIS"
        held = f"--at {name}={self.value!r}" if self.kind == "hold" else f"--release {name}"
        return f"accelcal freeze PARENT {data} {held}{own_files} -o THIS"


@dataclass(frozen=True, slots=True)
class Step:
    """One model of the tree."""

    key: int
    parent: int | None
    change: Change
    fit: Fit
    heldouts: tuple[Evaluation, ...]
    """Against each held-out recording, in their order."""

    @property
    def label(self) -> str:
        """What distinguishes this model from its parent, for people: base, + cubic, bias fixed."""
        return self.change.label

    @property
    def heldout(self) -> Evaluation:
        """Against all held-out data together; its curves are those of the first recording."""
        return pooled(self.heldouts)


@dataclass(frozen=True, slots=True)
class Guest:
    """A model of another session or of a model file, to be put beside those of this session."""

    name: str
    fit: Fit
    own: Evaluation | None = None
    """Against what its own session holds out; None where that is not at hand."""


@dataclass(frozen=True, slots=True)
class State:
    """Everything that undo restores."""

    runs: tuple[Run, ...] = ()
    """Recordings and dwells, in the order in which they were given."""
    shown: int = 0
    """Number of the one on the time line."""
    looked_at: int = 0
    """Number of the held-out recording whose curves are drawn."""
    own: tuple[Own, ...] = ()
    steps: tuple[Step, ...] = ()
    current: int | None = None
    guests: tuple[Guest, ...] = ()
    """Models from elsewhere."""
    responded: tuple[str, ...] = ()
    """SHA-256 of the data whose frequency response was asked for."""
    opened: OpenedSession | None = None
    """A session that waits for a recording, in place of all else."""

    @property
    def run(self) -> Run | None:
        """The file on the time line."""
        return self.runs[self.shown] if self.runs else None

    @property
    def file(self) -> Path | None:
        """Path of that file."""
        return self.run.file if self.run is not None else None

    @property
    def recording(self) -> Recording | None:
        """The recording on the time line; the first one where that is none."""
        found = (run.recording for run in ([self.run] if self.run else []) + list(self.runs))
        return next((recording for recording in found if recording is not None), None)

    @property
    def title(self) -> str:
        """The files in a few words."""
        more = f" and {len(self.runs) - 1} more" if len(self.runs) > 1 else ""
        return f"{self.runs[0].name}{more}" if self.runs else ""

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

    def named(self, step: Step) -> str:
        """A model with all that led to it, for people: base + cubic, bias fixed."""
        by_key = {s.key: s for s in self.steps}
        parent = None if step.parent is None else by_key[step.parent]
        return step.label if parent is None else f"{self.named(parent)} {step.label}"

    @property
    def models(self) -> dict[str, Fit]:
        """Every model of the session, and every guest, by the name that a list shows."""
        own = {f"{number}: {self.named(step)}": step.fit for number, step in enumerate(self.steps, start=1)}
        return {**own, **{guest.name: guest.fit for guest in self.guests}}

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
        """Data in use of the recording on the time line, its held-out part included."""
        return self.drawn.data

    @property
    def drawn(self) -> Run:
        """The recording whose curves are over the time line: the one on it, or the first where dwells are."""
        return self.run if self.run and self.run.recording else next(r for r in self.runs if r.recording is not None)

    @property
    def first_fitted(self) -> Run:
        """The first recording that models are fitted to: what is said of a single one is of it."""
        return next(run for run in self.runs if run.role == "fit" and run.recording is not None)

    @property
    def train(self) -> tuple[Recording | Dwells, ...]:
        """Data that models are fitted to."""
        return tuple(part for run in self.runs if (part := run.train) is not None)

    @property
    def unseen(self) -> tuple[Recording, ...]:
        """Held-out data, a recording each."""
        return tuple(part for run in self.runs if (part := run.unseen) is not None)

    @property
    def unseen_runs(self) -> tuple[Run, ...]:
        """Where they are from."""
        return tuple(run for run in self.runs if run.holds_out)

    @property
    def holds_out_parts(self) -> bool:
        """Whether all that is held out are parts of recordings that are fitted."""
        return all(run.role == "fit" for run in self.unseen_runs)


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
