"""Gravity on a transverse channel, and on the input axis: what is named, how large it is, and whether drift falls.

Run from the top of the repository: python -m benches.axes [--records 20] [--seed 1] [--workers 2] [--out build/axes]
Outcomes are kept line by line in OUT/axes.jsonl; an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import accelcal as ac
from benches.outcomes import Outcome, Trial, guarded, run_all
from tests.diagnosis.search.axes import Hidden, sideways, vertical

SIDEWAYS = ("cross_axis", "cross_axis", "cross_axis_z", "")
VERTICAL = (("quadratic", False), ("quadratic", True), ("cubic", False), ("cubic", True), ("", False))
STRENGTHS = (20.0, 40.0, 80.0)
SIGMA = 4.0
"""Standard deviations within which a size, the bias and the scale factor are right."""


def planted(trial: Trial, folder: Path) -> tuple[Hidden, str]:
    """The record of a trial, and what is hidden in it."""
    seed = 1000 * trial.seed + trial.number
    if trial.kind == "sideways":
        hidden = SIDEWAYS[trial.number % len(SIDEWAYS)]
        return sideways(seed, folder, hidden=hidden), hidden
    hidden, shaker = VERTICAL[trial.number % len(VERTICAL)]
    d = STRENGTHS[trial.number % len(STRENGTHS)]
    return vertical(seed, folder, hidden=hidden, shaker=shaker, d=d), hidden


def outcome_of(trial: Trial) -> Outcome:
    """What `improve` says of a record beside what is in it."""
    with tempfile.TemporaryDirectory() as folder:
        record, hidden = planted(trial, Path(folder))
        improvement = ac.improve(record.recording)
    names = [name for name in improvement.effects if name != "time_offset"]
    members = [list(group.members) for group in improvement.classes if group.effect in names]
    fit, truth = improvement.best, record.truth
    off = {"bias": 0.0}
    if names == [hidden] or not names:
        # beside a transverse channel the bias is that at its mean
        at_mean = sum(
            truth[e] * fit.origins.side[n] for e, n in (("cross_axis", "a_y"), ("cross_axis_z", "a_z")) if e in truth
        )
        expected = {**truth, "bias": truth["bias"] + at_mean}
        off = {e.name: (e.value - expected[e.name]) / e.std for e in fit.estimates if e.name in expected}
    rises = any(remark.code == "heldout_rises" for remark in improvement.diagnosis.remarks)
    named = len(names) == 1 and hidden in members[0] if hidden else not names
    sized = not names or names != [hidden] or all(abs(x) < SIGMA for x in off.values())
    return {
        "key": trial.key,
        "kind": trial.kind,
        "hidden": hidden,
        "truth": truth,
        "names": names,
        "members": members,
        "verdict": improvement.verdict,
        "off": off,
        "rises": rises,
        "right": bool(named and sized and not rises and (hidden or improvement.verdict == "adequate")),
    }


def null(outcome: Outcome) -> tuple[str, str, Sequence[str]] | None:
    """Bench, regime and false names for the ledger, where nothing was hidden."""
    return ("axes", outcome["kind"], outcome["names"]) if "names" in outcome and not outcome["hidden"] else None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing; print the records that are wrong, and how many are right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=20, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/axes"))
    chosen = parser.parse_args(arguments)
    trials = [Trial(kind, number, chosen.seed) for kind in ("sideways", "vertical") for number in range(chosen.records)]
    outcomes = run_all(partial(guarded, outcome_of), trials, chosen.out / "axes.jsonl", chosen.workers, null)
    held = True
    for kind in ("sideways", "vertical"):
        of_kind = [outcome for outcome in outcomes if outcome["kind"] == kind]
        right = sum(outcome["right"] for outcome in of_kind)
        for outcome in of_kind:
            if not outcome["right"]:
                print(f"wrong: {outcome}")
        print(f"{kind}: right in {right} of {len(of_kind)}, at least {len(of_kind) - 1}")
        held = held and right >= len(of_kind) - 1
    return 0 if held else 1


if __name__ == "__main__":
    raise SystemExit(main())
