"""Records with nothing hidden, of every kind of rig: how many carry a false name.

From the top of the repository: python -m benches.nulls [--worlds 112] [--seed 34001] [--out build/nulls.jsonl]
One record of each regime of `tests/regimes` and records of `tests/worlds` beside them, all entered in the ledger
(`benches.ledger`); an interrupted run continues where it stopped. With `--looks 12` worlds alone, each judged as it
grows: after a twelfth of its length, two, ...; a name at any of these is false. No test promises a rate for that; it is
counted, and at most 4 of 300 are allowed.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import binom

import accelcal as ac
from accelcal._support.errors import AccelcalError
from benches.hidden import guarded
from benches.outcomes import run_all
from tests.hidden import trials as worlds
from tests.hidden.verdicts import falsely_named
from tests.regimes import trials as regimes
from tests.regimes.judge import FALSE_RATE, SURE, false_names
from tests.regimes.regimes import TABLE

Outcome = dict[str, Any]


def run(trial: worlds.Trial | regimes.Trial) -> Outcome:
    """Run one record; its outcome has the false names beside it."""
    if isinstance(trial, worlds.Trial):
        outcome = guarded(trial)
        names = falsely_named(outcome) if "effects" in outcome else []
    else:
        outcome = regimes.run(trial)
        names = false_names(outcome)
    return {**outcome, "false_names": names}


def growing(looks: int, trial: worlds.Trial) -> Outcome:
    """False names at each look at one record of a world that grows; a look at less than a fit needs has none."""
    outcome: Outcome = {"key": trial.key, **asdict(trial), "looks": []}
    with tempfile.TemporaryDirectory() as folder:
        try:
            world = worlds.draw(trial)
            recording = ac.load(world.record().write(folder))
        except ValueError as refused:  # a motion that is longer
            return {**outcome, "skipped": str(refused)}
    outcome["nuisances"] = asdict(world.nuisances)
    begin, length = float(recording.position.t[0]), float(np.ptp(recording.position.t))
    for look in range(1, looks + 1):
        record = recording.part(begin, begin + length * look / looks)
        try:
            outcome["effects"] = list(ac.diagnose(ac.fit(record), record).effects)
        except AccelcalError as refused:
            outcome |= {"effects": [], "refused": str(refused)}
        outcome["looks"].append(falsely_named(outcome))
    names = {name for look in outcome["looks"] for name in look}
    return {**outcome, "false_names": sorted(names), "sentence": f"by look: {outcome['looks']}"}


def null(outcome: Outcome) -> tuple[str, str, Sequence[str]] | None:
    """Bench, regime and false names for the ledger; None where a record ended in an error."""
    return ("nulls", outcome.get("regime", "worlds"), outcome["false_names"]) if "effects" in outcome else None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing; print each false name, then figure, count and threshold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=112, help="records of tests/worlds")
    parser.add_argument("--seed", type=int, default=34001)
    parser.add_argument("--out", type=Path, default=Path("build/nulls.jsonl"))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--looks", type=int, default=0, help="at each record as it grows, in place of one at the whole")
    parser.add_argument("--seconds", type=float, default=24.0, help="length of a record that grows")
    chosen = parser.parse_args(arguments)
    honest = [*worlds.plan(1, chosen.worlds, chosen.seed)]
    if chosen.looks:
        short = [replace(trial, length=chosen.seconds) for trial in honest]
        outcomes = run_all(partial(growing, chosen.looks), short, chosen.out, chosen.workers)
    else:
        trials = [*honest, *regimes.plan(list(TABLE), 1, chosen.seed)]
        outcomes = run_all(run, trials, chosen.out, chosen.workers, null)
    ran = [outcome for outcome in outcomes if "effects" in outcome]
    named = [outcome for outcome in ran if outcome["false_names"]]
    for outcome in named:
        print(f"{outcome['key']}: {', '.join(outcome['false_names'])}: {outcome['sentence']}")
    for outcome in outcomes:
        if "error" in outcome:
            print(f"{outcome['key']}: {outcome['error']}")
    most = int(binom.ppf(SURE, len(ran), FALSE_RATE))
    errors = sum("error" in outcome for outcome in outcomes)
    print(f"honest records with a false name: {len(named)} of {len(ran)} ({errors} ended in an error), at most {most}")
    return 0 if len(named) <= most and not errors else 1


if __name__ == "__main__":
    raise SystemExit(main())
