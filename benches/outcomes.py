"""Outcomes of the trials of a bench, kept line by line: an interrupted run goes on where it stopped."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from benches.ledger import enter

Outcome = dict[str, Any]


class Keyed(Protocol):
    """A trial, which always gives the same record."""

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""


AnyTrial = TypeVar("AnyTrial", bound=Keyed)


def kept(path: Path) -> list[Outcome]:
    """Outcomes of earlier runs; a last line that was cut off is left out."""
    found = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            found.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return found


Nulls = Callable[[Outcome], tuple[str, str, Sequence[str]] | None]
"""Bench, regime and false names of an outcome whose record is honest; None for any other."""


def run_all(
    run: Callable[[AnyTrial], Outcome], trials: Sequence[AnyTrial], path: Path, workers: int, nulls: Nulls | None = None
) -> list[Outcome]:
    """Run the trials that have no outcome yet in worker processes; return the outcomes of all.

    Parameters
    ----------
    run : what makes an outcome, with its trial's key, of a trial.
    trials, path : what is run, and the file of outcomes.
    workers : processes; each is replaced after a few trials, so that its memory is given back.
    nulls : what the ledger gets of each outcome.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    known = {outcome["key"]: outcome for outcome in kept(path)}
    missing = [trial for trial in trials if trial.key not in known]
    if missing:
        cut = path.exists() and not path.read_bytes().endswith(b"\n") and path.stat().st_size > 0
        with (
            multiprocessing.Pool(workers, maxtasksperchild=8) as pool,
            path.open("a", encoding="utf-8") as file,
        ):
            file.write("\n" if cut else "")
            for outcome in pool.imap_unordered(run, missing):
                known[outcome["key"]] = outcome
                file.write(json.dumps(outcome) + "\n")
                file.flush()
                null = nulls(outcome) if nulls else None
                if null:
                    bench, regime, named = null
                    enter(bench, regime, outcome["key"], named)
    return [known[trial.key] for trial in trials]
