"""Lost motion on moves with rests, and none: is it named, alone, with its size, and is nothing named without it?

The simulator is that of `tests/diagnosis/test_lost_motion.py`: point-to-point moves of 5 to 50 mm, rests of 0.2 to 1 s;
counts of 0.1 to 1 um, a gap of 2 to 5 um behind which the reading hangs.

    python -m benches.play [--records 10] [--seed 1] [--out target/bench/play.jsonl]
"""

from __future__ import annotations

import os
from collections.abc import Sequence

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benches.outcomes import Outcome, Trial, asked, run_all
from tests.diagnosis.test_lost_motion import of_moves

SECONDS = 24.0
SIGMA, ALONE = 3.0, 0.9
"""Standard deviations that the size may err by, and the share of records that name the play and nothing beside it."""


def run(trial: Trial) -> Outcome:
    """Improve a record with a gap, or one without."""
    import accelcal as ac

    rng = np.random.default_rng([20517, trial.seed, trial.number])
    gap = float(rng.uniform(2e-6, 5e-6)) if trial.kind == "play" else 0.0
    count, noise = float(rng.choice([1e-7, 2e-7, 5e-7, 1e-6])), float(rng.uniform(2e-8, 1e-7))
    sigma = float(rng.uniform(1e-3, 5e-3))
    recording = of_moves(int(rng.integers(2**31)), gap, count, SECONDS, sigma, noise)
    better = ac.improve(recording)
    size = better.best["encoder_backlash"] if "encoder_backlash" in better.effects else None
    return {
        "key": trial.key,
        "kind": trial.kind,
        "gap": gap,
        "count": count,
        "effects": [*better.effects],
        "size": None if size is None else [size.value, size.std],
        "sentence": better.sentence,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, then print figure, count and threshold."""
    chosen = asked(__doc__, "play", 10, arguments)
    trials = [Trial(kind, n, chosen.seed) for n in range(chosen.records) for kind in ("play", "none")]
    outcomes = run_all(
        run,
        trials,
        chosen.out,
        chosen.workers,
        lambda outcome: ("play", "moves with rests", outcome["effects"]) if outcome["kind"] == "none" else None,
    )
    for outcome in outcomes:
        print(f"{outcome['key']}: gap {outcome['gap']:.3g}, {outcome['effects']} {outcome['size']}")
    hidden = [outcome for outcome in outcomes if outcome["kind"] == "play"]
    alone = sum(outcome["effects"] == ["encoder_backlash"] for outcome in hidden)
    sized = sum(bool(o["size"]) and abs(o["size"][0] + o["gap"]) < SIGMA * o["size"][1] for o in hidden)
    false = sum(bool(outcome["effects"]) for outcome in outcomes if outcome["kind"] == "none")
    print(f"named, and alone: {alone} of {len(hidden)}, at least {ALONE * len(hidden):.3g}")
    print(f"within {SIGMA:g} standard deviations: {sized} of {len(hidden)}, all")
    print(f"named where nothing is hidden: {false} of {len(outcomes) - len(hidden)}, none")
    return 0 if alone >= ALONE * len(hidden) and sized == len(hidden) and not false else 1


if __name__ == "__main__":
    raise SystemExit(main())
