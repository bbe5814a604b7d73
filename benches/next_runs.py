"""Causes that one tone confounds: how many further runs name one, as `accelcal next` proposes them and repeating.

From the top of the repository: python -m benches.next_runs [--seeds 5] [--seed 4401] [--gentle]
A simulated stage moves by one tone; an effect is hidden at d = 20. Where the diagnosis ends in a class, the first run
of `accelcal next` that the stage can do is recorded with it and diagnosed together with all before, until one cause has
the weight with which it is named, at most ten runs; and the tone is repeated twice as often. Bars: half as many runs as
by repeating in the median; at most 1 % stops at a wrong cause; the pair that a run separates least ends within 20 % of
the predicted distance, with `--gentle`: in runs four times as strong as the tone the effect, which the model lacks, is
taken for noise in part, and how much of a pair that hides is not foreseen. `same`: the class holds a copy of the cause,
which no run separates: said.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import traceback
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import accelcal as ac
from accelcal.demo import with_effect
from accelcal.diagnosis.experiment.next_runs import Experiment, class_with_weights, likeliest
from accelcal.diagnosis.policy import CLASS_WEIGHT
from accelcal.diagnosis.search.beam import saturated
from accelcal.effects import CATALOGUE, Effect, find
from accelcal.signals.signals import Origins
from accelcal.simulation import CXL02_RIG
from accelcal.simulation.motion import Motion, Tones
from benches.outcomes import run_all

CAUSES = "quadratic", "velocity_squared", "vibration_rectification", "scale_asymmetry", "cubic", "odd_quadratic"
TONES = 2.0, 3.0, 5.0, 8.0
SAME = CAUSES[:2] + CAUSES[4:]
SECONDS, TOP, MOST, STRENGTH = 20.0, 2.0, 10, 3.0
"""Length of a run, s; acceleration of the tone, m/s²; runs at most; detection limits that are hidden, d = 20 or so."""
LEAST = 1.0
"""Distance that is compared: a smaller one is lost in that of the noise, which is 1."""
STRONG, GENTLE = (0.1, 0.5, 8.0), (0.02, 0.15, 2.0)
"""Limits of the stage, m, m/s, m/s²."""
LARGER, TURNED = re.compile(r"([\d.]+) times as large"), re.compile("reversed")


@dataclass(frozen=True, slots=True)
class Trial:
    """One cause on one tone; the same trial always gives the same records."""

    hidden: str
    tone: float
    same: bool
    number: int
    seed: int
    gentle: bool = False
    """Whether the further runs are no stronger than the tone: then no effect swallows the noise estimate."""

    @property
    def key(self) -> str:
        return f"{self.seed}/{self.hidden}/{self.tone:g}/{self.same:d}/{self.number}{'/gentle' * self.gentle}"

    @property
    def limits(self) -> dict[str, float]:
        """Limits of the stage, m, m/s, m/s²."""
        return dict(zip(("stroke", "v_max", "a_max"), GENTLE if self.gentle else STRONG, strict=True))


class Stage:
    """Makes the runs of one trial."""

    def __init__(self, trial: Trial) -> None:
        self.trial, self.size, self.count = trial, 0.0, 0
        amplitude = TOP / (2.0 * math.pi * trial.tone) ** 2
        self.tone = Motion((Tones(np.array([amplitude]), np.array([trial.tone]), np.zeros(1)),), SECONDS, name="tone")
        honest = self.run()
        limits = ac.diagnose(ac.fit(honest), honest, extra=()).scan.detection_limits
        self.size = STRENGTH * limits[trial.hidden]

    def run(self, planned: Experiment | None = None) -> ac.Recording:
        """The tone again, or a run as planned."""
        trial, self.count = self.trial, self.count + 1
        seed = [trial.seed, CAUSES.index(trial.hidden), round(trial.tone), trial.same, trial.number, self.count]
        motion, rig = self.tone, CXL02_RIG
        if planned is not None:
            rig = replace(rig, mount="reversed") if TURNED.search(planned.run) else rig
            factor = float((LARGER.search(planned.run) or ["", "1"])[1])
            motion = planned.motion or replace(motion, gain=factor * motion.gain)
        simulation = ac.simulate(
            motion, seconds=motion.seconds, rig=rig, parameters={"bias": 0.05}, rng=np.random.default_rng(seed)
        )
        if not self.size:
            return simulation.recording
        return with_effect(simulation, find(trial.hidden), self.size, {}, Origins(), self.count)


def copy_of(effect: Effect) -> Effect:
    """A user's effect with the values of one of the catalogue."""
    name = f"copy_of_{effect.name}"
    if name in CATALOGUE:  # a trial before in this process
        return find(name)

    @ac.effect(name, unit=effect.unit, owner=effect.owner, symbol="copy", scale=effect.prior.typical)
    def copy(s: Any) -> Any:
        """The same values."""
        return effect.column(s)

    return find(name)


def able(planned: Experiment) -> bool:
    """Whether the simulated stage can do a run."""
    repeats = planned.run.startswith("the same motion") and "twice the rate" not in planned.run
    return planned.motion is not None or (repeats and "upright" not in planned.run)


def decided(diagnosis: ac.Diagnosis) -> str:
    """The cause that remains of the first class; empty where several do."""
    group = class_with_weights(diagnosis)
    if group is None:
        return diagnosis.effects[0] if diagnosis.effects else "none"
    weight, name = likeliest(group)
    return name if weight >= CLASS_WEIGHT else ""


def credited(diagnosis: ac.Diagnosis) -> dict[str, float]:
    """What each cause explains, as the search counts it, twice the log-likelihood."""
    return {candidate.effect: saturated(candidate.gain) for candidate in diagnosis.scan.candidates}


def followed(stage: Stage, records: list[ac.Recording], extra: tuple[Effect, ...]) -> Iterator[dict[str, Any]]:
    """After each run that was proposed: which, the cause that remains, and the least distance beside that predicted."""
    diagnosis = ac.diagnose(ac.fit(records[0]), records, extra=extra)
    while len(records) <= MOST:
        result = ac.next_experiments(diagnosis, records, **stage.trial.limits)
        if not result.separable:
            yield {"run": "", "cause": ""}
            return
        best = next(run for run in result.ranked if able(run))
        before = credited(diagnosis)
        records.append(stage.run(best))
        diagnosis = ac.diagnose(ac.fit(records[0]), records, extra=extra)
        after = credited(diagnosis)
        true, rival = best.pair  # the distance is predicted for this one being the cause, not for the other
        apart = math.nan
        if true == stage.trial.hidden and {true, rival} <= set(before) & set(after):
            grown = after[true] - after[rival] - (before[true] - before[rival])  # by this run
            apart = math.copysign(math.sqrt(abs(grown)), grown)
        cause = decided(diagnosis)
        yield {"run": best.run, "cause": cause, "predicted": best.separation, "reached": apart}
        if cause:
            return


def separated(trial: Trial) -> dict[str, Any]:
    """Runs until one cause remains, as proposed and by repeating."""
    stage = Stage(trial)
    first, extra = stage.run(), tuple[Effect, ...]()
    if trial.same:
        extra = (copy_of(find(trial.hidden)),)
    diagnosis = ac.diagnose(ac.fit(first), first, extra=extra)
    group = class_with_weights(diagnosis)
    if group is None or len(group.members) < 2 or decided(diagnosis):
        return {"class": diagnosis.effects[:1]}
    steps = list(followed(stage, [first], extra))
    runs = next((k for k, step in enumerate(steps, start=1) if step["cause"]), 0)
    outcome = {"class": list(group.members), "steps": steps, "runs": runs, "cause": steps[-1]["cause"]}
    if trial.same or not runs:
        return outcome
    records = [first]
    for again in range(1, min(2 * runs, MOST) + 1):
        records.append(stage.run())
        if cause := decided(ac.diagnose(ac.fit(first), records, extra=extra)):
            return outcome | {"repeated": again, "repeated_cause": cause}
    return outcome | {"repeated": math.inf}


def run(trial: Trial) -> dict[str, Any]:
    """Whatever happens is an outcome."""
    outcome: dict[str, Any] = {"key": trial.key, **asdict(trial)}
    try:
        return outcome | separated(trial)
    except Exception:
        return {**outcome, "error": traceback.format_exc(limit=-3)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=4401)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--gentle", action="store_true", help="with further runs no stronger than the tone")
    parser.add_argument("--out", type=Path, default=Path("build/next_runs.jsonl"))
    given = parser.parse_args()
    trials = [
        Trial(cause, tone, same, number, given.seed, given.gentle)
        for number in range(given.seeds)
        for same, causes in ((False, CAUSES), (True, SAME))
        for cause in causes
        for tone in (TONES if not same else TONES[1:3])
    ]
    outcomes = run_all(run, trials, given.out, given.workers)
    for outcome in outcomes:
        if "error" in outcome:
            print(outcome["key"], outcome["error"].strip().splitlines()[-1])
    judged(outcomes)


def judged(outcomes: list[dict[str, Any]]) -> None:
    """Print what the records say beside the bars."""
    asked = [o for o in outcomes if "steps" in o and not o["same"]]
    ended = [o for o in asked if o["runs"]]
    wrong = [o["key"] for o in ended if o["cause"] != o["hidden"]]
    print(f"{len(asked)} records end in a class, of {len({(o['hidden'], o['tone']) for o in asked})} causes and tones")
    if ended:
        runs, repeated = (np.median([o[key] for o in ended]) for key in ("runs", "repeated"))
        print(f"one cause remains in {len(ended)}: after {runs:g} runs in the median, by repeating {repeated:g}")
        print(f"a wrong one in {len(wrong)} (1 %): {', '.join(wrong)}")
    every = [s for o in asked for s in o["steps"]]
    steps = [s for s in every if s["run"] and math.isfinite(s["reached"]) and s["predicted"] > LEAST]
    if steps:
        ratio = np.median([s["reached"] / s["predicted"] for s in steps])
        print(f"least distance of two causes over that predicted, {len(steps)}: {ratio:.2f} in the median (0.8 to 1.2)")
    copies = [o for o in outcomes if o["same"] and "steps" in o]
    without_cause = sum(not o["cause"] for o in copies)
    print(f"of {len(copies)} with a copy of the cause {without_cause} end without a name")


if __name__ == "__main__":
    main()
