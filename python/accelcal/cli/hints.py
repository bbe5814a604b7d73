"""The next step after a command, on stderr: nothing with --json, and nothing that the user has not the files for."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from accelcal.cli.common import print_status

UNSEEN = "OTHER.csv"
"""Stands in a hint for a recording that the command has not seen."""


def suggest(*words: str | Path | None) -> None:
    """Print "next: accelcal ..." with some words; nothing where one of them is None: a file that is not known."""
    if None not in words:
        print_status(f"next: accelcal {' '.join(shlex.quote(str(word)) for word in words)}")


def after_fit(model: Path | None, runs: Sequence[Path]) -> None:
    """A fit that was written is diagnosed; one that was not is written first."""
    if model is None:
        suggest("fit", *runs, "-o", "model.json")
    else:
        suggest("diagnose", model, *runs)


def after_diagnosis(model: Path, runs: Sequence[Path], effects: Sequence[str], verdict: str) -> None:
    """What is missing is added; a model that lacks nothing goes into the report."""
    if verdict in ("named", "tied", "shape") and effects:
        suggest("add", model, runs[0], "--effect", effects[0], "-o", f"{model.stem}_{effects[0]}.json")
    elif verdict == "adequate":
        suggest("report", model, runs[0], "-o", f"{runs[0].stem}.html")
    elif verdict == "too_short":
        suggest("power", runs[0])
