"""Records of one axis that does not turn: the remark on a turning sensor must not appear beside their true effects.

From the top of the repository: python -m benches.turning [--records 200] [--seed 1] [--out build/turning]
Outcomes are kept line by line in OUT; an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from accelcal import verbs
from accelcal.io import load
from benches.outcomes import Outcome, run_all
from tests.hidden.trials import Trial, draw

EFFECTS = ("bias_gauss_markov", "rail_wave", "cubic")
STRENGTH = 20.0
MOST = 0.01
"""Share of records that may have the remark."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, then print figure, count and threshold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/turning"))
    chosen = parser.parse_args(arguments)
    trials = [
        Trial(2, number, chosen.seed, (EFFECTS[number % len(EFFECTS)],), STRENGTH) for number in range(chosen.records)
    ]
    outcomes = run_all(run, trials, chosen.out / "one_axis.jsonl", 1)
    judged = [outcome for outcome in outcomes if "skipped" not in outcome]
    turning = [outcome for outcome in judged if "turning_sensor" in outcome["codes"]]
    messages = [outcome for outcome in judged if outcome["effect"] in outcome["members"]]
    print(f"turning_sensor: {len(turning)} of {len(judged)} (at most {MOST:.0%})")
    print(f"true effect named, or in the class of one that is: {len(messages)} of {len(judged)}")
    for outcome in turning:
        print(f"  {outcome['key']}: {outcome['sentence']}")
    return int(len(turning) > MOST * len(judged))


def run(trial: Trial) -> Outcome:
    """Draw, write, load, improve: remarks and names."""
    outcome: Outcome = {"key": trial.key, "effect": trial.names[0]}
    try:
        world = draw(trial)
    except ValueError as refused:
        return {**outcome, "skipped": str(refused)}
    with tempfile.TemporaryDirectory() as folder:
        recording = load(world.record().write(folder))
        improvement = verbs.improve(recording, holdout=recording)
    return {
        **outcome,
        "codes": [remark.code for remark in improvement.diagnosis.remarks],
        "members": sorted({name for group in improvement.classes for name in group.members}),
        "sentence": improvement.sentence,
    }


if __name__ == "__main__":
    raise SystemExit(main())
