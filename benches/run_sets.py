"""What sets of runs can tell: encoder scale, tilt, misalignment, cross-axis gravity, dwells; sets with nothing hidden.

python -m benches.run_sets --seed 1601 --count 40 --nulls 300
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scipy import stats

import accelcal as ac
from accelcal.data.dwells import Dwells
from accelcal.data.recording import Recording
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.simulation import CXL02_RIG
from benches.ledger import enter

D = 10.0
"""Size of what is hidden, in standard deviations of it in the set that can tell."""
SECONDS = 20.0
G = 9.80665
BLIND = [("level", "normal")]
SETS = {
    "encoder_scale": [[("level", "normal"), ("up", "normal"), ("down", "normal")], "dwells"],
    "tilt": [[("level", "normal"), ("level", "reversed")]],
    "misalignment": [[("level", "normal"), ("level", "rolled")]],
    "cross_axis_gravity": [[("level", "normal"), ("level", "rolled")]],
}
"""Sets that can tell, by effect; the first run of each alone cannot."""


def run(rng: np.random.Generator, axis: str, mount: str, effect: str, size: float) -> Recording:
    """One run with an effect hidden in it."""
    rig = replace(CXL02_RIG, axis=axis, mount=mount)
    truth = {"bias": 0.05, "scale_factor": 0.01}
    if effect == "tilt":  # of the stage: its sign is that of the mount
        truth["bias"] += 1.01 * rig.polarity * G * size
    elif effect and effect != "encoder_scale":
        truth[effect] = size
    recording = ac.simulate("tones", seconds=SECONDS, rig=rig, parameters=truth, rng=rng).recording
    eps = size if effect == "encoder_scale" else 0.0
    position = replace(recording.position, y=recording.position.y * (1.0 + eps))
    return replace(recording, position=position, digest=f"{rng.integers(1 << 60)}", name=f"{axis} {mount}")


def tumble(rng: np.random.Generator, rig: ac.Rig) -> Dwells:
    """24 dwells of the same sensor on a dividing head."""
    angle = np.arange(24) * np.pi / 12.0
    std, white = np.radians(0.002), 0.5 * rig.sensor.noise**2 / 60.0
    mean = 0.05 + 1.01 * G * np.sin(angle + std * rng.standard_normal(24)) + np.sqrt(white) * rng.standard_normal(24)
    item = (np.full(24, np.sqrt(white * 1e4)), np.full(24, 60.0), np.full(24, 1e4))
    return Dwells(angle, mean, *item, ("0",) * 24, rig, angle_std=float(std), name="tumble")


def set_of_runs(rng: np.random.Generator, which: object, effect: str, size: float) -> list[Recording]:
    """A set of runs."""
    if which == "dwells":
        outcome = run(rng, "level", "normal", effect, size)
        return [outcome.with_dwells(tumble(rng, outcome.rig))]
    return [run(rng, axis, mount, effect, size) for axis, mount in which]


def judged(runs: list[Recording]) -> Diagnosis:
    """The verdict on the linear model."""
    return ac.diagnose(ac.fit(runs), runs)


def named_in(diagnosis: Diagnosis, effect: str) -> bool:
    """Whether an effect is among those that are missing, or is found in the model."""
    missing = {member for group in diagnosis.classes for member in group.members}
    inside = {finding.group.effect for finding in diagnosis.present}
    return effect in missing | inside


def deviation(which: object, effect: str) -> float:
    """Standard deviation of the effect in a set."""
    runs = set_of_runs(np.random.default_rng(0), which, "", 0.0)
    model = ac.Model.linear()
    free = ac.fit(runs, model).model
    fit = ac.fit(runs, free if effect in free.effects else free.alike("bias").add(effect))
    return fit[effect].std


def main() -> None:
    """Print counts beside their bars."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seed", type=int, default=1601)
    asked.add_argument("--count", type=int, default=40)
    asked.add_argument("--nulls", type=int, default=300)
    asked.add_argument("--effects", nargs="*", default=list(SETS))
    given = asked.parse_args()
    least = int(stats.binom.ppf(0.025, given.count, 0.95))
    for effect in given.effects:
        for which in SETS[effect]:
            size = D * deviation(which, effect)
            named = by_dwells = 0
            for k in range(given.count):
                rng = np.random.default_rng([given.seed, k])
                named += named_in(judged(set_of_runs(rng, which, effect, size)), effect)
                if k < given.count // 4:
                    blind = judged(set_of_runs(np.random.default_rng([given.seed, k]), BLIND, effect, size))
                    by_dwells += not named_in(blind, effect) and any(
                        effect in tie.members and f"gives {effect} to" in tie.experiment for tie in blind.inseparable
                    )
            name = which if isinstance(which, str) else ", ".join(f"{a} {m}" for a, m in which)
            few = given.count // 4
            print(f"{effect} of {size:.2g} in [{name}]: named {named} of {given.count} (least {least});", flush=True)
            print(
                f"    one level run alone: confounded, with the run that would tell, {by_dwells} of {few}", flush=True
            )
    false = 0
    for k in range(given.nulls):
        rng = np.random.default_rng([given.seed, 1 << 20, k])
        sets = [which for item in SETS.values() for which in item]
        result = judged(set_of_runs(rng, sets[k % len(sets)], "", 0.0))
        enter("run_sets", str(sets[k % len(sets)]), f"{given.seed}/{k}", [group.effect for group in result.classes])
        wrong = bool(result.classes) or bool({finding.group.effect for finding in result.present} & set(SETS))
        wrong |= bool(result.fit.spreads) or result.verdict != "adequate"
        false += wrong
        if wrong:
            print(f"    null {k}: {result.sentence}", flush=True)
    most = int(stats.binom.ppf(0.975, given.nulls, 0.01))
    print(f"nothing hidden: {false} of {given.nulls} sets are not adequate (1 %: at most {most})")


if __name__ == "__main__":
    main()
