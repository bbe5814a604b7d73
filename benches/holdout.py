"""The last step against the best step on a part of the record that nothing was decided on.

Each record is cut into three: `improve` fits the first part, with the second one held out, and every step is then
compared with the third one under one filter. From the top of the repository:
python -m benches.holdout [--records 12] [--seed 1] [--kind flicker ...] [--real] [--out build/holdout]
"""

from __future__ import annotations

import argparse
import os
import signal
import tempfile
import time
import traceback
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from accelcal import verbs
from accelcal.data.recording import Recording
from accelcal.io import load
from accelcal.validation.differences import heldout_change
from benches.outcomes import Outcome, run_all
from tests.regimes.regimes import TABLE
from tests.regimes.slow import HONEST, KINDS, build
from tests.worlds import MOTIONS, Hidden, Nuisances, World, at_d

SECONDS = 120.0
"""Length of a simulated record; a third is fitted."""
WORSE, SIGMA = 5.0, 2.0
"""Rise of the error in percent, and in paired standard errors, that counts."""
MOST_WORSE, MOST_FALSE = 0.02, 0.01
LONGEST = 300.0
"""Processor time after which a trial is stopped, s."""
REGIMES = ("a-seg7-cxl02", "a-smooth-adxl105", "a-random-cxl02", "a-hand-adxl105", "a-trap-adxl105", "c-phone-100")
PLANTED = ("quadratic", "cubic", "velocity", "coulomb", "hysteresis", "rail_wave", "encoder_cyclic", "sensor_lag")

PLAIN_SIDECAR = """[channels]
time = { column = "t", unit = "s" }
position = { column = "position", unit = "m" }
accel = { column = "accel", unit = "m/s^2" }
"""
"""Of a real recording that has none."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One record."""

    group: str
    """slow, regime, world or real."""
    name: str
    number: int = 0
    seed: int = 1

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.seed}/{self.group}/{self.name}/{self.number}"

    @property
    def record_seed(self) -> int:
        """Seed of everything that is drawn."""
        return int(np.random.default_rng([self.seed, self.number, zlib.crc32(self.name.encode())]).integers(2**31))


def plan(records: int, seed: int, names: Sequence[str], real: bool) -> Iterator[Trial]:
    """Simulated records of every kind, regimes and hidden effects, then real ones."""
    for number in range(records):
        groups = [("slow", k) for k in KINDS] + [("regime", r) for r in REGIMES if r in TABLE]
        for group, name in [*groups, *(("world", w) for w in PLANTED)]:
            if not names or name in names:
                yield Trial(group, name, number, seed)
    folder = os.environ.get("ACCELCAL_REAL_DATA")
    for path in sorted(Path(folder).rglob("*.csv")) if real and folder else []:
        yield Trial("real", str(path), 0, seed)


def recording_of(trial: Trial, folder: str) -> tuple[Recording, frozenset[str]]:
    """The record of a trial through its files, and the names that are right in it."""
    if trial.group == "real":
        path = Path(trial.name)
        rig = Path("tests/real") / f"{path.stem}.toml"
        if not rig.exists():
            rig = Path(folder) / rig.name
            rig.write_text(PLAIN_SIDECAR, encoding="utf-8")
        return load(path, rig), frozenset()
    if trial.group == "slow":
        return load(build(trial.name, trial.record_seed, SECONDS).write(folder)), HONEST[trial.name]
    if trial.group == "regime":
        regime = TABLE[trial.name]
        return load(regime.build(trial.record_seed, seconds=SECONDS).write(folder)), regime.honest
    rng = np.random.default_rng([trial.record_seed, 3])
    nuisances = Nuisances(missing=float(rng.choice([0.0, 0.1])))
    motion = str(rng.choice(list(MOTIONS)))
    world = World(
        motion,
        str(rng.choice(["ADXL105", "CXL02"])),
        (Hidden(trial.name, 1.0),),
        SECONDS,
        seed=trial.record_seed,
        nuisances=nuisances,
    )
    return load(at_d(world, 30.0).record().write(folder)), frozenset({trial.name})


def run(trial: Trial) -> Outcome:
    """Fit the first third, hold out the second, compare every step with the last; any exception is an outcome."""
    outcome: Outcome = {"key": trial.key, **asdict(trial)}
    begin = time.process_time()
    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        with tempfile.TemporaryDirectory() as folder:
            recording, honest = recording_of(trial, folder)
            t = max(recording.accel.t[0], recording.position.t[0]), min(recording.accel.t[-1], recording.position.t[-1])
            cuts = np.linspace(*t, 4)
            fitted, held, untouched = (recording.part(a, b) for a, b in pairwise(cuts))
            improvement = verbs.improve(fitted, holdout=held)
            outcome |= scored(improvement, untouched)
            outcome["false"] = (
                [group.effect for group in improvement.classes if not honest & {group.effect, *group.members}]
                if trial.group != "real"
                else []
            )
    except Exception as error:
        outcome |= {"error": type(error).__name__, "text": str(error)[:300], "trace": traceback.format_exc(limit=-3)}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return {**outcome, "seconds": time.process_time() - begin}


def stop(number: int, frame: object) -> None:
    """Stop a trial."""
    raise TimeoutError(f"stopped after {LONGEST:g} s of processor time")


def scored(improvement: verbs.Improvement, untouched: Recording) -> Outcome:
    """Names, remarks, and for each horizon the rise from the best step to the last one on the untouched part."""
    evaluations = list(verbs.compare([step.fit for step in improvement.steps], untouched))
    rises = {}
    for horizon in evaluations[0].drifts:
        errors = [remark.coast_rms[horizon] for remark in evaluations]
        if any(error is None for error in errors):
            continue
        best = min(range(len(evaluations)), key=lambda i: errors[i])
        change = heldout_change(evaluations[best], evaluations[-1], horizon)
        rises[f"{horizon:g}"] = {
            "best": best,
            "errors": errors,
            "percent": 100.0 * (errors[-1] / errors[best] - 1.0),
            "sigma": None if change is None else change.sigma,
        }
    notes = [(remark.code, remark.sentence) for remark in improvement.diagnosis.remarks]
    return {
        "effects": list(improvement.effects),
        "steps": [list(step.effects) for step in improvement.steps],
        "verdict": improvement.verdict,
        "sentence": improvement.sentence,
        "remarks": notes,
        "breaks": len(evaluations[-1].breaks),
        "rises": rises,
    }


def worse(outcome: Outcome) -> bool:
    """Whether the last step is worse than the best at any horizon, surely."""
    return any(
        rise["percent"] > WORSE and rise["sigma"] is not None and rise["sigma"] > SIGMA
        for rise in outcome.get("rises", {}).values()
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing; print figure, count and threshold of every claim."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=12, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", nargs="+", default=[])
    parser.add_argument("--real", action="store_true", help="also the recordings of ACCELCAL_REAL_DATA")
    parser.add_argument("--out", type=Path, default=Path("build/holdout"))
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args(arguments)
    trials = list(plan(chosen.records, chosen.seed, chosen.kind, chosen.real))
    outcomes = run_all(run, trials, chosen.out / "outcomes.jsonl", chosen.workers)
    hold = [report(f"{g}: ", [o for o in outcomes if g in ("all", o["group"])]) for g in groups(outcomes)]
    return 0 if all(hold) else 1


def groups(outcomes: Sequence[Outcome]) -> list[str]:
    """Groups with outcomes, then all together."""
    return [*dict.fromkeys(outcome["group"] for outcome in outcomes), "all"]


def report(title: str, outcomes: Sequence[Outcome]) -> bool:
    """Print the figures of some outcomes; whether the claims hold."""
    done = [outcome for outcome in outcomes if "error" not in outcome]
    bad = [outcome for outcome in done if worse(outcome)]
    wrong = [outcome for outcome in done if outcome["false"]]
    count = max(1, len(done))
    print(
        f"{title}last step worse than the best: {len(bad)} of {len(done)} (threshold {100 * MOST_WORSE:g} %); "
        f"false names: {len(wrong)} of {len(done)} (threshold {100 * MOST_FALSE:g} %); "
        f"not fitted: {len(outcomes) - len(done)}"
    )
    for outcome in {id(o): o for o in (*bad, *wrong)}.values():
        rises = {h: (round(r["percent"], 1), r["sigma"] and round(r["sigma"], 1)) for h, r in outcome["rises"].items()}
        print(f"    {outcome['key']}: {outcome['effects']} false {outcome['false']} {rises}")
    return len(bad) <= MOST_WORSE * count and len(wrong) <= MOST_FALSE * count


if __name__ == "__main__":
    raise SystemExit(main())
