"""State of the workbench: files, their roles and parts, effects of a session, a tree of models. Values, no actions."""

from __future__ import annotations

import json
import shlex
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, StringConstraints, model_validator

from accelcal._support.errors import AccelcalError
from accelcal._support.process import time_left
from accelcal.data import Dwells, Recording
from accelcal.effects import CATALOGUE, Own, from_expression, side_channels
from accelcal.effects.own import from_tried_expression
from accelcal.estimation import tracks
from accelcal.estimation.estimate import Fit
from accelcal.estimation.run_fit import run_to_hold_out
from accelcal.io.files import digest_of
from accelcal.plots.timeline import Marks
from accelcal.validation.comparison import HELD_OUT, Evaluation
from accelcal.validation.differences import pooled

SCHEMA: Literal["accelcal/session/2"] = "accelcal/session/2"
MOST_MODELS = 200
MOST_GUESTS = 100
MOST_RUNS = 200
MOST_LINES = 1_000_000
"""Of a sidecar, characters."""

Text = Annotated[str, StringConstraints(max_length=4096, pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
"""One line without control characters."""
Name = Annotated[str, StringConstraints(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f-\x9f\"'\\/]*$")]
"""Of an effect, a parameter or a file."""
Lines = Annotated[str, StringConstraints(max_length=MOST_LINES, pattern=r"^[^\x00-\x08\x0b\x0c\x0e-\x1f\x7f]*$")]
Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Span = tuple[FiniteFloat, FiniteFloat]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Source(_Strict):
    """A recording: where it was, and by what it is known again."""

    file: Text
    """Absolute path."""
    sha256: Digest

    @property
    def path(self) -> Path:
        """Where it was."""
        return Path(self.file)


class Formula(_Strict):
    """A user's effect as it is passed on, to a worker or into a session file: its formula, never code."""

    name: Name
    expression: Text
    unit: Text
    port: Literal["output", "position"]
    channels: tuple[Name, ...] = Field(default=(), max_length=100)
    """Side channels that the formula uses."""

    @classmethod
    def of(cls, definition: Own) -> Formula:
        """The formula of an effect that is in the catalogue."""
        e = definition.effect
        return cls.model_construct(
            name=e.name, expression=definition.expression, unit=e.unit, port=e.port, channels=e.needs
        )

    def try_out(self) -> None:
        """Evaluate the effect on ordinary motions, and enter it.

        Raises
        ------
        ExpressionError
            If the name is taken, anything in it is not allowed, or it is constant or not finite.
        """
        from_expression(self.name, self.expression, unit=self.unit, port=self.port, channels=self.channels)

    def enter(self) -> Own:
        """Enter the effect into the catalogue, without evaluating it; a second time changes nothing.

        Raises
        ------
        ExpressionError
            If the name is taken or anything in it is not allowed.
        """
        return from_tried_expression(self.name, self.expression, unit=self.unit, port=self.port, channels=self.channels)


class StoredStep(_Strict):
    """One model of the tree; its numbers are in ``models/KEY.json``."""

    key: Annotated[int, Field(ge=1, le=10**9)]
    parent: int | None
    kind: Literal["base", "add", "drop", "hold", "release"]
    name: Name
    value: FiniteFloat = 0.0


class StoredRun(_Strict):
    """One recording, or dwells, and what it is used for."""

    source: Source
    sidecar: Lines | None
    """What is declared of it; None: nothing, columns are found by their names, or it has the rig of another."""
    role: Literal["fit", "hold out", "leave out"] = "fit"
    held_out: Span | None = None
    """Part of a fitted recording that is held out, s."""
    excluded: list[Span] = Field(default_factory=list, max_length=1000)


class Content(_Strict):
    """What `session.json` holds."""

    schema_: Literal["accelcal/session/2"] = Field(alias="schema")
    version: Text
    """Of the program that wrote it."""
    saved: Text
    """When, as ISO 8601."""
    own: list[Formula] = Field(default_factory=list, max_length=100)
    steps: list[StoredStep] = Field(default_factory=list, max_length=MOST_MODELS)
    current: int | None = None
    runs: list[StoredRun] = Field(min_length=1, max_length=MOST_RUNS)
    shown: Annotated[int, Field(ge=0)] = 0
    """Number of the one on the time line."""
    guests: list[Text] = Field(default_factory=list, max_length=MOST_GUESTS)
    """Names of models from elsewhere; their numbers are in ``guests/NUMBER.json``, counted from 1."""

    @model_validator(mode="after")
    def _is_a_tree(self) -> Self:
        keys: set[int] = set()
        for step in self.steps:
            if step.key in keys or not (step.parent is None or step.parent in keys):
                raise AccelcalError(f"model {step.key} occurs twice or before its parent")
            if step.kind == "base" and step.name not in ("linear", "cubic"):
                raise AccelcalError(f"there is no base model {step.name}")
            keys.add(step.key)
        if self.current is not None and self.current not in keys:
            raise AccelcalError("the current model is not in the tree")
        return self

    @model_validator(mode="after")
    def _is_divided(self) -> Self:
        if len(set(self.guests)) < len(self.guests):
            raise AccelcalError("two models from elsewhere have the same name")
        if self.shown >= len(self.runs):
            raise AccelcalError("there is no recording of that number on the time line")
        if not any(run.role == "hold out" or (run.role == "fit" and run.held_out) for run in self.runs):
            raise AccelcalError("either a part of a recording or a whole one is held out")
        return self

    @property
    def title(self) -> str:
        """The work in a few words."""
        count, others = len(self.steps), len(self.runs) - 1
        models = "no model yet" if not count else "1 model" if count == 1 else f"{count} models"
        more = f" and {others} more" if others else ""
        return f"{self.runs[0].source.path.name}{more}, {models}"


@dataclass(frozen=True, slots=True)
class OpenedSession:
    """A session on its way back to work."""

    content: Content
    models: Mapping[int, str]
    """Text of each model file by its key."""
    guests: tuple[str, ...] = ()
    """Text of the model file of each model from elsewhere."""
    given: Mapping[str, Path] = field(default_factory=dict)
    """Files that the user has given, by their SHA-256."""
    awaited: Source | None = None
    """The recording that was missing when it was last looked for."""

    def path(self, source: Source) -> Path:
        """Where a recording is looked for."""
        return self.given.get(source.sha256, source.path)

    @property
    def missing(self) -> Source | None:
        """The first recording that is not where it was, or has changed since."""
        return next(
            (run.source for run in self.content.runs if digest_at(self.path(run.source)) != run.source.sha256), None
        )

    def with_files(self, paths: Sequence[Path]) -> OpenedSession:
        """The session with files of the user in place of those that are missing.

        Raises
        ------
        ValueError
            If one is not a file that the session was made with.
        """
        given = dict(self.given)
        for path in paths:
            digest = digest_at(path)
            source = next((run.source for run in self.content.runs if run.source.sha256 == digest), None)
            if source is None:
                asked = self.missing or self.content.runs[0].source
                raise AccelcalError(
                    f"{path.name}: not the recording that this session was made with ({asked.path.name}, SHA-256 "
                    f"{asked.sha256[:12]}…). Give that file, or press Undo and begin anew with this one"
                )
            given[source.sha256] = path
        return replace(self, given=given)


def digest_at(path: Path) -> str:
    """SHA-256 of a file, hex; empty where there is none to read. Files of other machines are not asked for."""
    if not path.is_absolute() or str(path).startswith(("\\\\", "//")):
        return ""
    try:
        return digest_of(path) if path.is_file() else ""
    except (OSError, ValueError):
        return ""


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
    """File whose sidecar it has, or whose rig where the columns differ, where it has none; empty otherwise."""
    columns: tuple[str, ...] = ()
    template: str = ""
    """A commented sidecar for the columns of the file."""
    problem: str = ""
    """Why the columns of the file are not understood; empty when they are."""
    recording: Recording | None = None
    """Of a sensor with three outputs the first of `axes`."""
    axes: tuple[Recording, ...] = ()
    """Every output of a sensor with three; empty of one."""
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
        """File name; of one output of three with its axis."""
        return f"{self.file.name} {self.axis}".rstrip()

    @property
    def axis(self) -> str:
        """Axis of one output of three; empty of a whole file."""
        return "" if self.recording is None or self.axes else self.recording.axis

    @property
    def outputs(self) -> tuple[Run, ...]:
        """A run of each output, with the use and the parts of this one."""
        return tuple(replace(self, recording=output, axes=()) for output in self.axes) or (self,)

    @property
    def source(self) -> Recording | Dwells | None:
        """What was read; None where the columns are not understood."""
        return self.recording if self.recording is not None else self.dwells

    @property
    def digest(self) -> str:
        """SHA-256 of the file, hex; empty where it is not understood."""
        return self.source.digest if self.source is not None else ""

    @property
    def data(self) -> Recording:
        """Data in use, the held-out part included."""
        assert self.recording is not None
        return (self.recording.part(*self.used) if self.breaks else self.recording).without(*self.excluded)

    @property
    def train(self) -> Recording | Dwells | None:
        """What models are fitted to; None where they are not."""
        if self.role != "fit" or self.source is None:
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
        """What distinguishes the model from its parent, for people: base, + cubic, bias fixed."""
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
    moving: tuple[tracks.Path, ...] = ()
    """Coefficients that its processes and mechanisms move, over the first fitted recording."""

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
        recordings = (run.recording for run in ([self.run] if self.run else []) + list(self.runs))
        return next((recording for recording in recordings if recording is not None), None)

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
        steps: list[Step] = []
        by_key = {s.key: s for s in self.steps}
        key = self.current
        while key is not None:
            steps.append(by_key[key])
            key = by_key[key].parent
        return tuple(reversed(steps))

    def named(self, step: Step) -> str:
        """A model with all that led to it, for people: base + cubic, bias fixed."""
        by_key = {s.key: s for s in self.steps}
        parent = None if step.parent is None else by_key[step.parent]
        return step.change.label if parent is None else f"{self.named(parent)} {step.change.label}"

    @property
    def models(self) -> dict[str, Fit]:
        """Every model of the session, and every guest, by the name that a list shows."""
        models = {f"{number}: {self.named(step)}": step.fit for number, step in enumerate(self.steps, start=1)}
        return {**models, **{guest.name: guest.fit for guest in self.guests}}

    @property
    def previous(self) -> Step | None:
        """The parent of the current model."""
        return self.path[-2] if len(self.path) > 1 else None

    @property
    def own_files(self) -> str:
        """Command-line options that load the user's own effects."""
        return "".join(f" --effects-file {entry.effect.name}.py" for entry in self.own)

    @property
    def data(self) -> Recording:
        """Data in use of the recording on the time line, its held-out part included."""
        return next((output.data for output in self.drawn.outputs if output.axis == self.axis), self.drawn.data)

    @property
    def drawn(self) -> Run:
        """The recording whose curves are over the time line: the one on it, or the first where dwells are."""
        return self.run if self.run and self.run.recording else next(r for r in self.runs if r.recording is not None)

    @property
    def first_fitted(self) -> Run:
        """The first recording that models are fitted to: what is said of a single one is of it."""
        return next(run for run in self.fitted_files if run.recording is not None)

    @property
    def fitted_files(self) -> tuple[Run, ...]:
        """Files that models are fitted to."""
        return tuple(run for run in self.runs if run.role == "fit" and run.source is not None)

    @property
    def train(self) -> tuple[Recording | Dwells, ...]:
        """Data that models are fitted to."""
        return tuple(part for run in self.runs for output in run.outputs if (part := output.train) is not None)

    @property
    def unseen(self) -> tuple[Recording, ...]:
        """Held-out data, a recording each."""
        return tuple(part for run in self.unseen_runs if (part := run.unseen) is not None)

    @property
    def unseen_runs(self) -> tuple[Run, ...]:
        """Where they are from, a run for each output."""
        return tuple(output for run in self.runs for output in run.outputs if run.holds_out)

    @property
    def axis(self) -> str:
        """Output of a sensor with three whose curves are drawn; empty of a sensor with one."""
        return self.unseen_runs[self.looked_at].axis if self.unseen_runs else ""

    def beside(self, step: Step) -> dict[str, Evaluation]:
        """Evaluations of a model on every output of the recording whose curves are drawn, by axis."""
        file = self.unseen_runs[self.looked_at].file
        return {run.axis: e for run, e in zip(self.unseen_runs, step.heldouts, strict=True) if run.file == file}

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


ROLES: tuple[Role, ...] = ("fit", "hold out", "leave out")


class Refused(AccelcalError):
    """An action that is not possible now. The text says why and what to do first."""


def divided(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Files that were dropped together with the roles that `accelcal improve` gives them.

    The last of three recordings or more is held out whose axis and mount another one has; else the end of the first.
    """
    motions = [(number, run.recording) for number, run in enumerate(runs) if run.recording is not None]
    given = [replace(run, role="fit", held_out=None) for run in runs]
    last = run_to_hold_out([recording for _, recording in motions])
    if last is not None:
        number = motions[last][0]
        given[number] = replace(given[number], role="hold out")
    return with_something_held_out(given)


def with_role(runs: Sequence[Run], number: int, role: Role) -> tuple[Run, ...]:
    """The files with another role for one of them.

    A recording that is held out takes the place of parts that were; when the last one is used otherwise, the end of the
    first fitted one is held out again.

    Raises
    ------
    Refused
        If dwells were to be held out, or no recording would be left to fit.
    """
    run = runs[number]
    if role == "hold out" and run.dwells is not None:
        raise Refused(f"{run.name}: dwells show no motion to compare a model with; fit them, or leave them out")
    changed = [*runs]
    changed[number] = replace(run, role=role, held_out=run.held_out if role == "fit" else None)
    return with_files_held_out(changed, keep=role != "hold out")


def with_use(run: Run, role: Role) -> Run:
    """A file with a role; dwells show no motion to compare a model with, and are fitted."""
    return replace(run, role="fit" if run.dwells is not None and role == "hold out" else role, held_out=None)


def with_files_held_out(runs: Sequence[Run], *, keep: bool) -> tuple[Run, ...]:
    """The files; a recording that is held out takes the place of parts that were, unless they are to be kept."""
    whole = any(run.role == "hold out" and run.recording is not None for run in runs)
    return with_something_held_out([replace(run, held_out=None) if whole and not keep else run for run in runs])


def with_something_held_out(runs: Sequence[Run]) -> tuple[Run, ...]:
    """The files; where nothing is held out, the end of the first recording that is fitted is.

    Raises
    ------
    Refused
        If no recording is fitted.
    """
    fitted = [number for number, run in enumerate(runs) if run.role == "fit" and run.recording is not None]
    if not fitted and any(run.recording is not None for run in runs):
        raise Refused("no recording would be left to fit; give another one the role fit first")
    if not fitted or any(run.holds_out for run in runs):
        return tuple(runs)
    first = fitted[0]
    return tuple(replace(run, held_out=run.end) if number == first else run for number, run in enumerate(runs))


@dataclass(frozen=True, slots=True)
class SessionEffects:
    """Effects of one session, as they are sent to a worker."""

    formulas: tuple[Formula, ...] = ()
    """Effects of the user."""
    channels: tuple[tuple[str, str], ...] = ()
    """Side channels of its recordings, and their units."""

    @classmethod
    def to(cls, state: State) -> SessionEffects:
        """Effects known to this session."""
        recordings = [run.recording for run in state.runs if run.recording is not None]
        units = dict(pair for recording in recordings for pair in units_of(recording))
        return cls(tuple(Formula.of(entry) for entry in state.own), tuple(units.items()))

    @contextmanager
    def catalogue(self) -> Iterator[None]:
        """The catalogue of this session; what is entered inside is forgotten behind it."""
        with CATALOGUE.apart():
            for formula in self.formulas:  # first: a channel that comes later makes way
                formula.enter()
            side_channels(self.channels)
            yield


def units_of(recording: Recording) -> tuple[tuple[str, str], ...]:
    """Side channels with their units."""
    return tuple((channel.name, channel.unit) for channel in recording.side.values())
