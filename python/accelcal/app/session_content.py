"""Schema `accelcal/session/2`: what `session.json` may hold, each leaf with its range; where its recordings are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, StringConstraints, model_validator

from accelcal._support.errors import AccelcalError
from accelcal.effects import Own, from_expression
from accelcal.effects.own import from_tried_expression
from accelcal.io.loading import digest_of

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
    def of(cls, own: Own) -> Formula:
        """The formula of an effect that is in the catalogue."""
        e = own.effect
        return cls.model_construct(name=e.name, expression=own.expression, unit=e.unit, port=e.port, channels=e.needs)

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
        known: set[int] = set()
        for step in self.steps:
            if step.key in known or not (step.parent is None or step.parent in known):
                raise AccelcalError(f"model {step.key} occurs twice or before its parent")
            if step.kind == "base" and step.name not in ("linear", "cubic"):
                raise AccelcalError(f"there is no base model {step.name}")
            known.add(step.key)
        if self.current is not None and self.current not in known:
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
