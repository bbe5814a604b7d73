"""Units, ranges, columns, signs and gravity that are declared wrongly, and honest rigs: what is told, what is named.

Run from the top of the repository: python -m benches.mistakes [--records 60] [--honest 300] [--seed 1] [--workers 2]
Outcomes are kept line by line in OUT/mistakes.jsonl; an interrupted run goes on where it stopped.
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
from accelcal.estimation.plausible import suspicion
from benches.outcomes import Outcome, Trial, guarded, run_all
from tests.field.rigs import MOTIONS, honest, mistaken

ACCUSED = ("implausible", "gravity", "runs against", "not one axis", "the motion is in")
"""Words of the sentences on a mistake."""


def outcome_of(trial: Trial) -> Outcome:
    """What `check`, `fit` and `improve` say of a record beside what is wrong in it."""
    with tempfile.TemporaryDirectory() as folder:
        if trial.kind == "mistake":
            name, record, line = mistaken(trial.number, trial.seed)
        else:
            name = list(MOTIONS)[trial.number % len(MOTIONS)]
            record, line = honest(10_000 * trial.seed + trial.number, name), ""
        path, names, verdict = record.write(Path(folder)), [], ""
        recording = ac.load(path)
        checked = suspicion(recording)
        try:
            fit = ac.fit(recording)
            text = " ".join(note.sentence for note in fit.remarks)
            if line:
                better = ac.improve(recording)
                names, verdict = list(better.effects), better.verdict
        except ValueError as error:
            text = str(error)
    accused = [word for word in ACCUSED if word in f"{text} {checked}"]
    right = (line in text and not names and verdict != "adequate") if line else not accused
    return {
        "key": trial.key,
        "kind": trial.kind,
        "name": name,
        "k": record.k,
        "line": line,
        "said": text,
        "checked": checked,
        "names": names,
        "verdict": verdict,
        "right": bool(right),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing; print the records that are wrong, and how many are right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=60, help="with a mistake")
    parser.add_argument("--honest", type=int, default=300, help="without")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/mistakes"))
    chosen = parser.parse_args(arguments)
    counts = {"mistake": chosen.records, "honest": chosen.honest}
    trials = [Trial(kind, number, chosen.seed) for kind, count in counts.items() for number in range(count)]
    outcomes = run_all(partial(guarded, outcome_of), trials, chosen.out / "mistakes.jsonl", chosen.workers)
    held = True
    for kind, count in counts.items():
        of_kind = [outcome for outcome in outcomes if outcome["kind"] == kind]
        right, least = (
            sum(outcome["right"] for outcome in of_kind),
            int(0.95 * count if kind == "mistake" else 0.976 * count),
        )
        for outcome in of_kind:
            if not outcome["right"]:
                print(f"wrong: {outcome}")
        named = sum(bool(outcome.get("names")) for outcome in of_kind)
        print(f"{kind}: right in {right} of {len(of_kind)}, at least {least}; a name in {named}, none expected")
        held = held and right >= least and named == 0
    return 0 if held else 1


if __name__ == "__main__":
    raise SystemExit(main())
