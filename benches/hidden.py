"""The acceptance table of hidden effects: the product on files that the independent worlds wrote.

Run from the top of the repository: python -m benches.hidden [--group 2] [--records 60] [--d 20] [--out build/hidden]
Outcomes are kept line by line in OUT/barN.jsonl; an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import argparse
import os
import traceback
from collections.abc import Sequence
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from benches.outcomes import cost, counted, earlier_outcomes, run_all
from tests.hidden.trials import Outcome, Trial, plan, run
from tests.hidden.verdicts import Line, falsely_named, lines

RECORDS = {1: 560, 2: 308, 3: 308, 4: 200, 5: 40, 6: 195, 8: 88}
"""Records of each group; group 2 takes each at three strengths, group 7 reads the outcomes of groups 1 and 2."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, then print figure, count and threshold of every claim."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--group", type=int, action="append", choices=(1, 2, 3, 4, 5, 6, 7, 8))
    parser.add_argument("--records", type=int, help="records of each group; by default as many as the group asks for")
    parser.add_argument("--d", type=float, action="append", help="only effects of this size in standard deviations")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/hidden"))
    parser.add_argument("--effects", default="", help="only these, separated by commas")
    parser.add_argument("--write", action="store_true", help="put the table into docs/hidden.md")
    chosen = parser.parse_args(arguments)
    effects = [name for name in chosen.effects.split(",") if name]
    results: list[Line] = []
    searched: list[Outcome] = []
    for group in chosen.group or (1, 2, 3, 4, 5, 6, 7, 8):
        if group != 7:
            trials = list(plan(group, chosen.records or RECORDS[group], chosen.seed, effects))
            trials = [trial for trial in trials if not chosen.d or trial.d in chosen.d]
            outcomes = run_all(partial(counted, guarded), trials, chosen.out / f"group{group}.jsonl", 2, null)
            searched += outcomes if group != 8 else []  # which compares with the truth as well
        else:
            outcomes = [o for b in (1, 2) for o in earlier_outcomes(chosen.out / f"group{b}.jsonl")]
        for line in lines(group, outcomes):
            print(line.text, flush=True)
            results.append(line)
    table = markdown(results)
    print("\n" + table)
    if chosen.write:
        Path("docs/hidden.md").write_text(PREFACE + table, encoding="utf-8")
    text, fast = cost(searched)
    print(text)
    return 0 if fast and all(line.holds for line in results) else 1


PREFACE = """# Hidden effects: the acceptance table

Each record comes from `tests/worlds`, simulators that share no formula with the product, was written to CSV and
sidecar, and was read back by the public interface, which knew the base model only. `make bench-hidden` repeats it.

"""


def null(outcome: Outcome) -> tuple[str, str, Sequence[str]] | None:
    """Bench, regime and false names for the ledger, where nothing was hidden."""
    honest = outcome.get("group") == 1 and "effects" in outcome
    return ("hidden", "worlds", falsely_named(outcome)) if honest else None


def guarded(trial: Trial) -> Outcome:
    """Run a trial; an exception is an outcome that fails every claim."""
    try:
        return run(trial)
    except Exception:
        return {"key": trial.key, "names": list(trial.names), "d": trial.d, "error": traceback.format_exc()}


def markdown(results: Sequence[Line]) -> str:
    """The table."""
    rows = ["| group | claim | figure | count | threshold | holds |", "|---|---|---|---|---|---|"]
    rows += [f"| {x.group} | {x.claim} | {x.figure} | {x.count} | {x.threshold} | {_yes(x)} |" for x in results]
    return "\n".join(rows) + "\n"


def _yes(line: Line) -> str:
    return "yes" if line.holds else "**no**"


if __name__ == "__main__":
    raise SystemExit(main())
