"""Outcomes of the trials of a bench, kept line by line: an interrupted run goes on where it stopped."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar
from unittest.mock import patch

import numpy as np

from accelcal import verbs
from accelcal.diagnosis.select.stepwise import SearchBudget
from benches.ledger import enter

Outcome = dict[str, Any]


class Keyed(Protocol):
    """A trial, which always gives the same record."""

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""


@dataclass(frozen=True)
class Trial:
    """One record of a bench."""

    kind: str
    number: int
    seed: int

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.kind}-{self.number}-{self.seed}"


def guarded(run: Callable[[Trial], Outcome], trial: Trial) -> Outcome:
    """Outcome of a trial; an exception is a wrong one."""
    try:
        return run(trial)
    except Exception:
        return {"key": trial.key, "kind": trial.kind, "right": False, "error": traceback.format_exc()}


AnyTrial = TypeVar("AnyTrial", bound=Keyed)


MOST_SECONDS = 15.0
"""Most processor time of `improve` on 60 s of data, held-out table included, s."""


def counted(run: Callable[[AnyTrial], Outcome], trial: AnyTrial) -> Outcome:
    """The outcome of a trial, with the number of models that its search fitted and whether it was stopped there."""
    budgets: list[SearchBudget] = []

    def begun() -> SearchBudget:
        budgets.append(SearchBudget())
        return budgets[-1]

    with patch.object(verbs, "SearchBudget", begun):
        outcome = run(trial)
    for budget in budgets[-1:]:
        outcome |= {"models": budget.models, "stopped": budget.stopped}
    return outcome


def cost(outcomes: Sequence[Outcome]) -> tuple[str, bool]:
    """Distributions of processor time and of models over the searches of a bench, and whether the time holds."""
    searches = [outcome for outcome in outcomes if "models" in outcome and "seconds" in outcome]
    if not searches:
        return "no search was counted", True
    seconds, models = (np.array([search[key] for search in searches]) for key in ("seconds", "models"))
    text = "; ".join(
        f"{name} " + ", ".join(f"{np.quantile(values, q):.3g}" for q in (0.5, 0.9, 0.99, 1.0))
        for name, values in (("processor time, s:", seconds), ("models:", models))
    )
    longest = searches[int(np.argmax(seconds))]["key"]
    return (
        f"{len(searches)} searches (quantiles 0.5, 0.9, 0.99, 1): {text}; longest {longest}; "
        f"{sum(search['stopped'] for search in searches)} stopped; threshold {MOST_SECONDS:g} s"
    ), bool(seconds.max() <= MOST_SECONDS)


def earlier_outcomes(path: Path) -> list[Outcome]:
    """Outcomes of earlier runs; a last line that was cut off is left out."""
    results = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            results.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return results


def asked(about: str | None, name: str, records: int, arguments: Sequence[str] | None) -> argparse.Namespace:
    """What is asked of a bench: how many records, which seed, how many workers, and the file of outcomes."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=records)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=Path(f"target/bench/{name}.jsonl"))
    return parser.parse_args(arguments)


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
    earlier = {outcome["key"]: outcome for outcome in earlier_outcomes(path)}
    missing = [trial for trial in trials if trial.key not in earlier]
    if missing:
        cut = path.exists() and not path.read_bytes().endswith(b"\n") and path.stat().st_size > 0
        with (
            multiprocessing.Pool(workers, maxtasksperchild=8) as pool,
            path.open("a", encoding="utf-8") as file,
        ):
            file.write("\n" if cut else "")
            for outcome in pool.imap_unordered(run, missing):
                earlier[outcome["key"]] = outcome
                file.write(json.dumps(outcome) + "\n")
                file.flush()
                null = nulls(outcome) if nulls else None
                if null:
                    bench, regime, named = null
                    enter(bench, regime, outcome["key"], named)
    return [earlier[trial.key] for trial in trials]
