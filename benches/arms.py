"""Sensors on arms about axles: what is named with nothing missing, what is found of hidden effects, and how right the
estimates are.

From the top of the repository: python -m benches.arms [--records 100] [--seed 1] [--out build/arms]
The records come from `tests/estimation/arms.py`, which turns and differentiates frames. Of so many records each, 3 in 5
have an effect hidden at d = 20, and twice as many are fitted for the consistency of the estimates. Outcomes are kept in
OUT, a line each, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import chi2

from accelcal import verbs
from accelcal.data import Recording
from accelcal.model import Model
from benches.outcomes import Outcome, Trial, guarded, run_all
from tests.estimation.arms import Rigged, record

RIGS = (
    Rigged(),
    Rigged(motion="turns"),
    Rigged(input_axis="tangential"),
    Rigged(motion="turns", input_axis="tangential"),
    Rigged(motion="turns", axle="vertical"),
    Rigged(axle="vertical"),
    Rigged(motion="steps"),
    Rigged(axle="vertical", input_axis="tangential"),
    Rigged(motion="steps", axle="vertical", seconds=60.0),
)
HIDDEN = {
    "quadratic": ("quadratic", "quadratic"),
    "cubic": ("cubic", "cubic"),
    "lag": ("time_offset", "sensor_lag"),
    "eccentricity": ("angle_eccentricity", "angle_eccentricity"),
    "bending": ("arm_bending", "arm_bending"),
}
"""By what is hidden: the effect by whose standard deviation its size is set, and the one that must be in a class."""
DELAYS = {"time_offset", "sensor_lag", "sensor_resonance"}
D = 20.0
MOST_NULLS, LEAST_HIDDEN = 0.03, 0.95
"""Share of nulls in which something may be named, and of hidden effects that must be in a reported class."""
ALPHA = 0.01


def drawn(trial: Trial) -> Rigged:
    """A rig whose declared quantities are off by what is declared of them."""
    rng = np.random.default_rng([trial.seed, trial.number])
    rig = RIGS[trial.number % len(RIGS)]
    level, upright = 1e-3 * rng.standard_normal(), rig.axle == "vertical"
    return replace(
        rig,
        seed=1000 * trial.seed + trial.number,
        arm_error=2e-4 * rng.standard_normal(),
        across=2e-3 * rng.standard_normal(),
        bias=0.05 * rng.standard_normal(),
        k=0.01 * rng.standard_normal(),
        delay=0.0,
        keys={"arm_std": '"0.2 mm"'},
        zero=0.0 if upright else level,
        tilt=level if upright else 0.0,
    )


def outcome_of(trial: Trial) -> Outcome:
    """Draw, write, read, and fit or diagnose."""
    rig, begin = drawn(trial), time.process_time()
    outcome: Outcome = {"key": trial.key, "kind": trial.kind, "rig": f"{rig.axle} {rig.motion} {rig.input_axis}"}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if trial.kind == "nees":
            rig = replace(rig, delay=2e-3)
            return outcome | consistency(rig, record(rig, folder))
        if trial.kind != "null":
            effect = HIDDEN[trial.kind][0]
            model = Model.linear() if effect == "time_offset" else Model.linear().add(effect)
            quiet = verbs.fit(record(rig, folder), model)
            stds = [e.std for e in quiet.free if e.name.partition(".")[0] == effect]
            rig = replace(rig, **{trial.kind: D * min(stds)})  # type: ignore[arg-type]
            outcome["size"] = D * min(stds)
        recording = record(rig, folder)
        improvement = verbs.improve(recording, holdout=recording)
    classes = [sorted({tie.effect, *tie.members}) for tie in improvement.classes]
    return outcome | {
        "effects": list(improvement.effects),
        "classes": classes,
        "verdict": improvement.diagnosis.verdict,
        "sentence": improvement.diagnosis.sentence,
        "seconds": time.process_time() - begin,
    }


def consistency(rig: Rigged, recording: Recording) -> Outcome:
    """Normalised estimation error squared of five parameters, and the error of each in standard deviations."""
    fit = verbs.fit(recording)
    of_axle = ("axle_tilt.cos", rig.zero) if rig.axle == "horizontal" else ("axle_tilt.sin", rig.tilt)
    truth = {"bias": rig.bias, "scale_factor": rig.k, "time_offset": rig.delay, "lever_arm.x": rig.arm_error}
    truth |= dict([of_axle])
    names = [e.name for e in fit.free]
    at = [names.index(name) for name in truth]
    errors = np.array([fit[name].value - truth[name] for name in truth])
    covariance = np.asarray(fit.covariance)[np.ix_(at, at)]
    z = errors / np.sqrt(np.diag(covariance))
    return {"nees": float(errors @ np.linalg.solve(covariance, errors)), "z": z.tolist(), "names": list(truth)}


def in_class(outcome: Outcome) -> bool:
    """Whether what was hidden is in a reported class; of the delays any counts."""
    wanted = HIDDEN[outcome["kind"]][1]
    reported = {name for tie in outcome["classes"] for name in tie}
    return wanted in reported or (wanted in DELAYS and bool(DELAYS & reported))


def null(outcome: Outcome) -> tuple[str, str, Sequence[str]] | None:
    """Bench, regime and false names for the ledger, where nothing was hidden."""
    return ("arms", outcome["rig"], outcome["effects"]) if outcome["kind"] == "null" and "effects" in outcome else None


def report(outcomes: Sequence[Outcome]) -> bool:
    """Print figure, count and threshold of every claim; whether all hold."""
    failed = [o for o in outcomes if "error" in o]
    for o in failed:
        print(f"{o['key']}: {o['error'].splitlines()[-1]}")
    whole = [o for o in outcomes if "error" not in o]
    nulls = [o for o in whole if o["kind"] == "null"]
    hidden = [o for o in whole if o["kind"] in HIDDEN]
    wrong, lost = [o for o in nulls if o["effects"]], [o for o in hidden if not in_class(o)]
    for o in (*wrong, *lost):
        print(f"  {o['key']} ({o['rig']}): {o['effects']}, {o['verdict']}: {o['sentence']}")
    print(f"nulls: {len(wrong)} of {len(nulls)} named something (at most {MOST_NULLS:.0%})")
    print(f"hidden at d = {D:g}: {len(hidden) - len(lost)} of {len(hidden)} in a class (at least {LEAST_HIDDEN:.0%})")
    of_fits = [o for o in whole if o["kind"] == "nees"]
    n = max(1, len(of_fits))
    low, high = chi2.ppf([ALPHA / 2.0, 1.0 - ALPHA / 2.0], 5 * n) / n
    mean = float(np.mean([o["nees"] for o in of_fits])) if of_fits else 5.0
    print(f"NEES {mean:.3f} of 5 over {n} fits (99 %: {low:.2f} to {high:.2f})")
    for rig in sorted({o["rig"] for o in of_fits}):
        z = np.array([o["z"] for o in of_fits if o["rig"] == rig])
        print(f"  {rig}: NEES {np.mean([o['nees'] for o in of_fits if o['rig'] == rig]):.2f}, rms z {rms(z)}")
    held = len(wrong) <= MOST_NULLS * len(nulls) and len(hidden) - len(lost) >= LEAST_HIDDEN * len(hidden)
    return held and low <= mean <= high and not failed


def rms(z: np.ndarray) -> str:
    """Root mean squares of columns, in words."""
    return ", ".join(f"{value:.2f}" for value in np.sqrt(np.mean(z**2, axis=0)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=100, help="nulls; 3 in 5 as many with an effect, twice for NEES")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/arms"))
    wanted = parser.parse_args(arguments)
    kinds = tuple(HIDDEN)
    trials = [Trial("null", n, wanted.seed) for n in range(wanted.records)]
    trials += [Trial(kinds[n % len(kinds)], n, wanted.seed) for n in range(3 * wanted.records // 5)]
    trials += [Trial("nees", n, wanted.seed) for n in range(2 * wanted.records)]
    outcomes = run_all(partial(guarded, outcome_of), trials, wanted.out / "arms.jsonl", wanted.workers, null)
    return 0 if report(outcomes) else 1


if __name__ == "__main__":
    raise SystemExit(main())
