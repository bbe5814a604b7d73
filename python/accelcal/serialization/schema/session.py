"""Schema `accelcal/session/1`: what `session.json` of a session file may hold, each leaf with its type and range."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, StringConstraints, model_validator

SCHEMA = "accelcal/session/1"
MOST_MODELS = 200
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
    """An effect of the user."""

    name: Name
    expression: Text
    unit: Text
    port: Literal["output", "position"]
    channels: list[Name] = Field(default_factory=list, max_length=100)


class StoredStep(_Strict):
    """One model of the tree; its numbers are in ``models/KEY.json``."""

    key: Annotated[int, Field(ge=1, le=10**9)]
    parent: int | None
    kind: Literal["base", "add", "drop", "hold", "release"]
    name: Name
    value: FiniteFloat = 0.0


class Content(_Strict):
    """What `session.json` holds."""

    schema_: Literal["accelcal/session/1"] = Field(alias="schema")
    version: Text
    """Of the program that wrote it."""
    saved: Text
    """When, as ISO 8601."""
    recording: Source
    sidecar: Lines | None
    """What is declared of the recording; None: nothing, columns are found by their names."""
    other: Source | None = None
    """A recording that is held out as a whole."""
    other_sidecar: Lines | None = None
    held_out: Span | None = None
    excluded: list[Span] = Field(default_factory=list, max_length=1000)
    own: list[Formula] = Field(default_factory=list, max_length=100)
    steps: list[StoredStep] = Field(default_factory=list, max_length=MOST_MODELS)
    current: int | None = None

    @model_validator(mode="after")
    def _hangs_together(self) -> Content:
        known: set[int] = set()
        for step in self.steps:
            if step.key in known or not (step.parent is None or step.parent in known):
                raise ValueError(f"model {step.key} occurs twice or before its parent")
            if step.kind == "base" and step.name not in ("linear", "cubic"):
                raise ValueError(f"there is no base model {step.name}")
            known.add(step.key)
        if self.current is not None and self.current not in known:
            raise ValueError("the current model is not in the tree")
        if (self.other is None) == (self.held_out is None):
            raise ValueError("either a part of the recording or another recording is held out")
        return self

    @property
    def title(self) -> str:
        """The work in a few words."""
        count = len(self.steps)
        models = "no model yet" if not count else "1 model" if count == 1 else f"{count} models"
        return f"{self.recording.path.name}, {models}"
