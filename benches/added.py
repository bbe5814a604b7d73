"""Every effect of the catalogue hidden, named, added and compared with the truth.

From the top of the repository: python -m benches.added [--effects NAME,...] [--seed 34101] [--out build/added.jsonl]
Each effect is hidden at d = 20 by `tests/worlds` in records of both sensors of the paper with two kinds of ramps. The
base model is diagnosed, the effect that was hidden is added, and the model is diagnosed again: its size must lie within
4 standard deviations of the truth, and the verdict afterwards may not name its class. One line for each record; an
interrupted run continues where it stopped.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import traceback
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from accelcal import verbs
from accelcal.effects import CATALOGUE, find
from accelcal.estimation.estimate import Fit
from accelcal.io import load
from benches.outcomes import run_all
from tests.hidden.trials import VISIBLE, beside, errors, hide
from tests.worlds import SENSORS, Nuisances, World, at_d
from tests.worlds.motion import RAMPS

Outcome = dict[str, Any]
STRENGTH = 20.0
MOST_SIGMA = 4.0
DELAYS = "time_offset", "sensor_lag", "sensor_resonance"
"""Effects whose size in the worlds is a delay: on smooth ramps the time offset, which every model has."""
PROCESSES = tuple(name for name, effect in CATALOGUE.items() if effect.port == "process")
ALIKE = DELAYS, ("bias_random_walk", "bias_gauss_markov"), ("scale_random_walk", "scale_gauss_markov")
"""Effects of which one accounts for the other on these records."""
REASONS = {
    "saturation": "its coefficient is 1 by definition",
    "vibration_rectification": "its coefficient is another quantity in the worlds",
    "timing_jitter": "its size is a standard deviation that a few moves determine to tens of per cent",
    **dict.fromkeys(PROCESSES, "its coefficients are a path, of which the worlds state the intensity"),
}
"""Effects whose size is not compared, and why."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One effect on one sensor and one kind of ramp; the same trial always gives the same record."""

    effect: str
    sensor: str
    ramps: str
    seed: int

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.seed}/{self.effect}/{self.sensor}/{self.ramps}"


def run(trial: Trial) -> Outcome:
    """Hide, diagnose, add, diagnose; whatever happens is an outcome."""
    outcome: Outcome = {"key": trial.key, **asdict(trial)}
    try:
        return outcome | added(trial)
    except Exception:
        return {**outcome, "error": traceback.format_exc(limit=-3)}


def added(trial: Trial) -> Outcome:
    """Verdicts before and after, and the size beside the truth."""
    number = [VISIBLE.index(trial.effect), list(SENSORS).index(trial.sensor), list(RAMPS).index(trial.ramps)]
    rng = np.random.default_rng([trial.seed, *number])
    nuisances = beside((trial.effect,), replace(Nuisances.draw(rng), vibration=0.0, converter_bits=16))
    hidden = (hide(trial.effect, float(rng.choice([-1.0, 1.0]))),)
    world = World(trial.ramps, trial.sensor, hidden, seed=int(rng.integers(2**31)), nuisances=nuisances)
    try:
        world = at_d(world, STRENGTH).settled()
    except ValueError as refused:
        return {"skipped": str(refused)}
    with tempfile.TemporaryDirectory() as folder:
        recording = load(world.record().write(folder))
    base = verbs.fit(recording)
    before = verbs.diagnose(base, recording)
    jumps = [test for test in before.channels if test.effect == trial.effect == "encoder_step"]
    present = jumps or trial.effect in (*DELAYS, *base.model.effects)
    model = base if present else verbs.add(base, recording, trial.effect)
    after = verbs.diagnose(model, recording)
    left_out = {test.effect: [test.estimate, test.std, abs(world.hidden[0].magnitude)] for test in jumps}
    return {
        "before": list(before.effects),
        "classes": [list(group.members) for group in before.classes],
        "sizes": errors(model, world) | waves(model, world) | delay(model, world) | left_out,
        "noise": [[e.name, e.value, e.std] for e in model.noise_effects],
        "accounted": bool(jumps),
        "after": list(after.effects),
        "verdict": after.verdict,
        "sentence": after.sentence,
    }


def waves(model: Fit, world: World) -> dict[str, list[float]]:
    """Amplitude of a wave that has two coefficients, and its period or frequency: estimate, std, truth."""
    (hidden,) = world.hidden
    parts = [e for e in model.estimates if e.name.startswith(f"{hidden.name}.") and e.std > 0.0]
    if len(parts) != 2:
        return {}
    amplitude = math.hypot(*(e.value for e in parts))
    k = float(world.scale_factor or 0.0) if hidden.effect.place == "force" else 0.0
    sizes = {hidden.name: [amplitude, max(e.std for e in parts), abs(hidden.magnitude) * (1.0 + k)]}
    for shape in model.shapes:
        key = shape.name.removeprefix(f"{hidden.name}.")
        if key in hidden.shape and shape.std > 0.0:
            sizes[key] = [shape.value, shape.std, hidden.shape[key]]
    return sizes


def delay(model: Fit, world: World) -> dict[str, list[float]]:
    """Time offset of the model beside a hidden delay: estimate, std, truth."""
    (hidden,) = world.hidden
    offset = model["time_offset"]
    return {hidden.name: [offset.value, offset.std, hidden.magnitude]} if hidden.name in DELAYS else {}


def misses(outcome: Outcome) -> list[str]:
    """Claims that an outcome misses, in words."""
    if "error" in outcome:
        return [outcome["error"].strip().splitlines()[-1]]
    effect = outcome["effect"]
    same = {effect, *(name for group in ALIKE if effect in group for name in group)}
    claims = []
    for name, (value, std, truth) in outcome["sizes"].items():
        if name not in ("scale_factor", *REASONS) and abs(value - truth) > MOST_SIGMA * std:
            claims.append(f"{name} {value:.6g} ± {std:.2g}, truth {truth:.6g}")
    if effect not in outcome["sizes"] and not outcome["noise"] and effect not in REASONS:
        claims.append("no size to compare")
    lacking = set(outcome["after"]) & ({effect} if find(effect).port == "noise" else same) - {"time_offset"}
    if lacking and not outcome["accounted"]:
        claims.append(f"still lacks {', '.join(sorted(lacking))}: {outcome['sentence']}")
    return claims


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing; print each miss, then figure, count and threshold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effects", default="", help="only these, separated by commas")
    parser.add_argument("--seed", type=int, default=34101)
    parser.add_argument("--out", type=Path, default=Path("build/added.jsonl"))
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args(arguments)
    effects = [name for name in chosen.effects.split(",") if name] or VISIBLE
    trials = [Trial(e, s, r, chosen.seed) for e in effects for s in SENSORS for r in RAMPS]
    outcomes = run_all(run, trials, chosen.out, chosen.workers)
    tried = [outcome for outcome in outcomes if "skipped" not in outcome]
    for outcome in outcomes:
        if "skipped" in outcome:
            print(f"{outcome['key']}: out of reach: {outcome['skipped']}")
    missed = {outcome["key"]: misses(outcome) for outcome in tried if misses(outcome)}
    for key, claims in missed.items():
        print(f"{key}: {'; '.join(claims)}")
    for name, reason in REASONS.items():
        print(f"size not compared: {name}: {reason}")
    print(f"hidden, added, right: {len(tried) - len(missed)} of {len(tried)}, expected all but those listed")
    return 0 if not missed else 1


if __name__ == "__main__":
    raise SystemExit(main())
