"""The next step after a command, on stderr: nothing with --json, and nothing that the user has not the files for."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from accelcal.cli.common import print_status

if TYPE_CHECKING:
    from accelcal.diagnosis.verdict import Diagnosis
    from accelcal.estimation.estimate import Fit
    from accelcal.estimation.run_fit import RunFit

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


def after_diagnosis(fit: Fit, found: Diagnosis, model: Path, runs: Sequence[Path], holdout: Path | None) -> None:
    """What is missing is added, to the recordings that the model was fitted to; a model that lacks nothing goes into
    the report."""
    fitted = fitted_files(fit, model, *runs)
    missing = next((effect for effect in found.effects if effect not in fit.model.effects), None)
    if found.verdict in ("named", "tied", "shape"):
        suggest("add", model, *fitted, "--effect", missing, "-o", f"{model.stem}_{missing}.json")
    elif found.verdict == "adequate":
        suggest("report", model, fitted[0], *held_out(holdout), "-o", f"{runs[0].stem}.html")
    elif found.verdict == "too_short":
        suggest("power", runs[0])


def after_comparison(fit: Fit, model: Path, run: Path) -> None:
    """A model is diagnosed on what it was fitted to: a recording that it has not seen stays held out."""
    fitted = fitted_files(fit, model, run)
    unseen = () if any(path is not None and path.samefile(run) for path in fitted) else ("--holdout", run)
    suggest("diagnose", model, *fitted, *unseen)


def held_out(holdout: Path | None) -> tuple[str | Path, ...]:
    """The option that names a held-out recording, where there is one."""
    return () if holdout is None else ("--holdout", holdout)


def fitted_files(fit: Fit, *given: Path) -> list[Path | None]:
    """Recordings of a model, looked for beside the files that a command was given; None for one that is elsewhere."""
    from accelcal.io.loading import digest_of

    def place(run: RunFit) -> Path | None:
        beside = (folder / run.name for folder in dict.fromkeys(path.parent for path in given))
        return next((at for at in beside if at.is_file() and digest_of(at) in (run.digest, run.session)), None)

    return [place(run) for run in fit.runs]
