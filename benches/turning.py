"""Records of one axis that does not turn: the remark on a turning sensor must not appear beside their true effects.

From the top of the repository: python -m benches.turning [--records 200] [--seed 1] [--out build/turning]
Outcomes are kept line by line in OUT; an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests.hidden.trials import Trial, draw

from accelcal import workflow
from accelcal.io import load

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
    chosen.out.mkdir(parents=True, exist_ok=True)
    path = chosen.out / "one_axis.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    known = {one["key"]: one for one in map(json.loads, lines)}
    outcomes = []
    with path.open("a", encoding="utf-8") as file:
        for number in range(chosen.records):
            trial = Trial(2, number, chosen.seed, (EFFECTS[number % len(EFFECTS)],), STRENGTH)
            outcome = known.get(trial.key) or run(trial)
            if trial.key not in known:
                file.write(json.dumps(outcome) + "\n")
                file.flush()
            outcomes.append(outcome)
    judged = [one for one in outcomes if "skipped" not in one]
    turning = [one for one in judged if "turning_sensor" in one["codes"]]
    told = [one for one in judged if one["effect"] in one["members"]]
    print(f"turning_sensor: {len(turning)} of {len(judged)} (at most {MOST:.0%})")
    print(f"true effect named, or in the class of one that is: {len(told)} of {len(judged)}")
    for one in turning:
        print(f"  {one['key']}: {one['sentence']}")
    return int(len(turning) > MOST * len(judged))


def run(trial: Trial) -> dict[str, Any]:
    """Draw, write, load, improve: remarks and names."""
    outcome: dict[str, Any] = {"key": trial.key, "effect": trial.names[0]}
    try:
        world = draw(trial)
    except ValueError as refused:
        return {**outcome, "skipped": str(refused)}
    with tempfile.TemporaryDirectory() as folder:
        recording = load(world.record().write(folder))
        found = workflow.improve(recording, holdout=recording)
    return {
        **outcome,
        "codes": [one.code for one in found.diagnosis.remarks],
        "members": sorted({name for group in found.classes for name in group.members}),
        "sentence": found.sentence,
    }


if __name__ == "__main__":
    raise SystemExit(main())
