"""Sizes of effects that a record names near the threshold, beside the truth: as estimated, and given the choice.

From the top of the repository: python -m benches.sizes [--records 60] [--seed 4301] [--out build/sizes.jsonl]
Effects of one coefficient are hidden at d = 3, 4, 5 and 6 by `tests/worlds`, diagnosed, and added where they are named.
One line for each record; an interrupted run continues where it stopped.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from accelcal import verbs
from accelcal.io import load
from benches.outcomes import run_all
from tests.hidden.trials import hide
from tests.worlds import SENSORS, Nuisances, World, at_d
from tests.worlds.motion import RAMPS

EFFECTS = "cubic", "quadratic", "velocity", "temperature_bias"
STRENGTHS = 3.0, 4.0, 5.0, 6.0


@dataclass(frozen=True, slots=True)
class Trial:
    """One effect at one distance from zero; the same trial always gives the same record."""

    effect: str
    d: float
    number: int
    seed: int

    @property
    def key(self) -> str:
        return f"{self.seed}/{self.effect}/{self.d:g}/{self.number}"


def run(trial: Trial) -> dict[str, Any]:
    """Hide, diagnose, add what is named; whatever happens is an outcome."""
    outcome: dict[str, Any] = {"key": trial.key, **asdict(trial)}
    try:
        return outcome | sized(trial)
    except Exception:
        return {**outcome, "error": traceback.format_exc(limit=-3)}


def sized(trial: Trial) -> dict[str, Any]:
    """Estimate and size given the choice, over the truth, and whether the interval holds it."""
    rng = np.random.default_rng([trial.seed, EFFECTS.index(trial.effect), int(trial.d), trial.number])
    sensor, ramps = (str(rng.choice(list(names))) for names in (SENSORS, RAMPS))
    nuisances = Nuisances.draw(rng)
    world = World(ramps, sensor, (hide(trial.effect, 1.0),), seed=int(rng.integers(2**31)), nuisances=nuisances)
    world = at_d(world, trial.d).settled()
    with tempfile.TemporaryDirectory() as folder:
        recording = load(world.record().write(folder))
    base = verbs.fit(recording)
    named = trial.effect in verbs.diagnose(base, recording).effects
    if not named:
        return {"named": False}
    fit = verbs.add(base, recording, trial.effect)
    truth = world.hidden[0].magnitude
    raw, size = fit[trial.effect], fit.given_choice[trial.effect]
    ends = [raw.value - 1.96 * raw.std, raw.value + 1.96 * raw.std]
    for note in (note.values for note in fit.remarks if note.code == "chosen"):
        ends = [float(note["low"]), float(note["high"])]
    holds = min(ends) < truth < max(ends)
    return {"named": True, "raw": raw.value / truth, "size": size.value / truth, "holds": holds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=60)
    parser.add_argument("--seed", type=int, default=4301)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/sizes.jsonl"))
    given = parser.parse_args()
    trials = [
        Trial(name, d, number, given.seed) for number in range(given.records) for d in STRENGTHS for name in EFFECTS
    ]
    outcomes = run_all(run, trials, given.out, given.workers)
    for outcome in outcomes:
        if "error" in outcome:
            print(outcome["key"], outcome["error"].strip().splitlines()[-1])
    for d in STRENGTHS:
        rows = [o for o in outcomes if o["d"] == d and o.get("named")]
        if rows:
            raw, size, holds = (np.array([row[key] for row in rows]) for key in ("raw", "size", "holds"))
            print(
                f"d = {d:g}: {len(rows)} named; estimate over truth {np.mean(raw):.2f}, above it "
                f"{100 * np.mean(raw > 1):.0f} %; given the choice {np.mean(size):.2f}, above it "
                f"{100 * np.mean(size > 1):.0f} % (41 to 59); intervals hold {100 * np.mean(holds):.0f} %"
            )


if __name__ == "__main__":
    main()
