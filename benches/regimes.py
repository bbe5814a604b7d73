"""Honest records of every kind of rig: the product must name nothing that is not in them.

From the top of the repository: python -m benches.regimes [--regime NAME ...] [--records 12] [--seed 1] [--hidden]
Names may hold * and ?. Outcomes are kept line by line in OUT; an interrupted run continues where it stopped.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from benches.outcomes import cost, counted, run_all
from tests.regimes.judge import Outcome, false_names, hidden_lines, lines, rows, unreachable
from tests.regimes.regimes import TABLE
from tests.regimes.trials import plan, plan_hidden, run


def null(outcome: Outcome) -> tuple[str, str, Sequence[str]] | None:
    """Bench, regime and false names for the ledger, where nothing was planted."""
    honest = not outcome["hidden"] and "effects" in outcome
    return ("regimes", outcome["regime"], false_names(outcome)) if honest else None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing; print the table, then figure, count and threshold of every claim."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--regime", nargs="+", default=["*"], help="names, all by default")
    parser.add_argument("--records", type=int, help="of each regime: 12, or 40 where it failed at first; hidden: 1")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/regimes"))
    parser.add_argument("--hidden", action="store_true", help="plant an effect in each record")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--list", action="store_true", help="print the names of the regimes")
    chosen = parser.parse_args(arguments)
    names = [name for name in TABLE if any(fnmatchcase(name, pattern) for pattern in chosen.regime)]
    if not names:
        parser.error(f"no regime is called {' or '.join(chosen.regime)}; --list prints all")
    if chosen.list:
        print("\n".join(names))
        return 0
    trials = list((plan_hidden if chosen.hidden else plan)(names, chosen.records, chosen.seed))
    path = chosen.out / ("hidden.jsonl" if chosen.hidden else "null.jsonl")
    outcomes = run_all(partial(counted, run), trials, path, chosen.workers, null)
    print("\n".join(rows(outcomes)))
    for pair in unreachable(outcomes):
        print(f"out of reach: {pair}")
    result = (hidden_lines if chosen.hidden else lines)(outcomes)
    print()
    for line in result:
        print(line.text)
    text, fast = cost([outcome for outcome in outcomes if TABLE[outcome["regime"]].seconds <= 60.0])
    print(text)
    return 0 if fast and all(line.holds for line in result) else 1


if __name__ == "__main__":
    raise SystemExit(main())
