"""Two estimates of one record, by the replay and by the weak form: how far apart they are where nothing is wrong.

From the top of the repository: python -m benches.engines [--regime NAME ...] [--records 16] [--seed 1] [--fault]
Each record is honest; both engines fit the base model. With --fault the replay is given an output that is held or
linear between its samples: where that moves its scale factor by ten standard deviations, the two must disagree.
Outcomes are kept in OUT, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import binom

from accelcal import Model, Recording
from accelcal.diagnosis.checks import unresolved_motion
from accelcal.diagnosis.independent_estimate import differences
from accelcal.diagnosis.policy import ENGINES_APART, ENGINES_LEAST_STD
from accelcal.estimation import drive
from accelcal.estimation.engines import ENGINES
from accelcal.estimation.estimate import solve_runs
from accelcal.io import load
from benches.outcomes import run_all
from tests.regimes.regimes import TABLE
from tests.regimes.rig import Planted
from tests.regimes.trials import Trial

FAULTS: tuple[Literal["hold", "linear"], ...] = ("hold", "linear")
FALSE_ALARMS = 1e-3
"""Share of honest records in which the two may be said to disagree."""
MOVED = 10.0
"""Standard deviations by which a fault moves the scale factor of the replay, least, to be counted."""
ABOVE_LEAST = 3.0 * ENGINES_LEAST_STD
"""Uncertainty of a difference over that of the estimate, from which it is not the least one that is assumed."""
LEAST_FAULTS = 0.99
"""Share of the faults that must be seen."""


def run(trial: Trial) -> dict[str, Any]:
    """Fit the base model to one record by both."""
    return compared(trial.key, built(trial))


def run_faulty(trial: Trial) -> dict[str, Any]:
    """Fit it once as it should be, and once for each fault."""
    recording, result = built(trial), {"key": trial.key}
    with_fault: list[dict[str, Any]] = []
    try:
        healthy = solve_runs(Model.linear(), [recording], engine=ENGINES["replay"])
        std = float(np.sqrt(healthy.covariance[1, 1]))
        for fault in FAULTS:
            drive.INTERPOLATION = fault
            comparison = compared(f"{trial.key}{fault}", recording)
            if "values" in comparison:
                moved = abs(comparison["values"]["scale_factor"] - healthy.states[0].values.by_name["scale_factor"])
                with_fault.append({**comparison, "moved": moved / std})
    except Exception as error:  # what no engine can fit is no comparison
        return {**result, "error": f"{type(error).__name__}: {error}", "faults": []}
    finally:
        drive.INTERPOLATION = "cubic"
    return {**result, "faults": with_fault}


def built(trial: Trial) -> Recording:
    """The recording of a trial, through its files."""
    with tempfile.TemporaryDirectory() as folder:
        return load(TABLE[trial.regime].build(trial.record_seed, Planted()).write(folder))


def compared(key: str, recording: Recording) -> dict[str, Any]:
    """Both estimates of the base model on a record."""
    outcome: dict[str, Any] = {"key": key}
    try:
        begin = time.process_time()
        solution = solve_runs(Model.linear(), [recording], engine=ENGINES["replay"])
        fitted = time.process_time()
        outcome["values"] = dict(solution.states[0].values.by_name)
        result = differences(solution)
    except Exception as error:
        return {**outcome, "error": f"{type(error).__name__}: {error}"}
    if not result:
        return outcome
    std = dict(zip([t.name for t, _ in solution.layout.slots], np.sqrt(np.diag(solution.covariance)), strict=True))
    return {
        **outcome,
        "names": [item.name for item in result],
        "sigma": [item.sigma for item in result],
        "shift": [(item.weak - item.replay) / std[item.name] for item in result],
        "fit": fitted - begin,
        "both": time.process_time() - fitted,
    }


def worst(outcome: dict[str, Any]) -> float:
    """Largest difference, in its standard deviations; 0 where nothing was compared."""
    return max((abs(sigma) for sigma in outcome.get("sigma", ())), default=0.0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing; print counts and thresholds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--regime", nargs="+", default=["*"], help="names, all by default")
    parser.add_argument("--records", type=int, default=16, help="of each regime")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fault", action="store_true", help="spoil the replay")
    parser.add_argument("--out", type=Path, default=Path("build/engines"))
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args(arguments)
    names = [name for name in TABLE if any(fnmatchcase(name, pattern) for pattern in chosen.regime)]
    trials = [Trial(name, number, chosen.seed) for number in range(chosen.records) for name in names]
    if chosen.fault:
        return faults(run_all(run_faulty, trials, chosen.out / "faults.jsonl", chosen.workers))
    outcomes = run_all(run, trials, chosen.out / "null.jsonl", chosen.workers)
    return nulls(outcomes, {trial.key: trial for trial in trials})


def beyond_sampling(trial: Trial) -> bool:
    """Whether the verdict says that the motion of a record is beyond its sampling, so that neither engine is valid."""
    runs = [state.run for state in solve_runs(Model.linear(), [built(trial)]).states]
    return any(note.code == "motion_beyond_sampling" for note in unresolved_motion(SimpleNamespace(runs=runs)))


def nulls(outcomes: Sequence[dict[str, Any]], trials: Mapping[str, Trial]) -> int:
    """Print every alarm, then counts; 1 where there are too many."""
    refused = [alarm for alarm in outcomes if "error" in alarm]
    compared = [alarm for alarm in outcomes if alarm.get("sigma")]
    none = len(outcomes) - len(refused) - len(compared)
    alarms = [alarm for alarm in compared if worst(alarm) > ENGINES_APART]
    invalid = [alarm["key"] for alarm in alarms if beyond_sampling(trials[alarm["key"]])]
    for alarm in alarms:
        k = int(np.argmax(np.abs(alarm["sigma"])))
        print(
            f"{alarm['key']}: {alarm['names'][k]} {alarm['sigma'][k]:.1f} standard deviations of the difference, "
            f"{alarm['shift'][k]:.2f} of the estimate{', motion beyond the sampling' * (alarm['key'] in invalid)}"
        )
    shift = np.abs(np.concatenate([alarm["shift"] for alarm in compared]))
    allowed = int(binom.ppf(0.975, len(compared), FALSE_ALARMS))
    print(f"{len(outcomes)} records, {len(refused)} that no fit takes, {none} that are not compared")
    middle, most = np.median(shift), np.quantile(shift, 0.99)
    print(f"|difference| over the uncertainty: median {middle:.3f} (at most 0.5), 99 % {most:.2f}")
    sigma = np.concatenate([alarm["sigma"] for alarm in compared])
    for name, those in (
        ("all", sigma),
        ("whose own exceeds three times the least", sigma[shift > ABOVE_LEAST * np.abs(sigma)]),
    ):
        print(f"difference over its own uncertainty, {name}: rms {np.sqrt(np.mean(those**2)):.2f} of {len(those)}")
    counted = len(alarms) - len(invalid)
    print(f"alarms: {len(alarms)} of {len(compared)}; where both are valid {counted} (at most {allowed})")
    both, fit = (sum(alarm[name] for alarm in compared) for name in ("both", "fit"))
    print(f"processor time of the comparison over that of the fit: {both / fit:.2f}")
    return 0 if counted <= allowed else 1


def faults(outcomes: Sequence[dict[str, Any]]) -> int:
    """Print every fault that is not seen, then counts; 1 where there are too many."""
    counted = [fault for outcome in outcomes for fault in outcome["faults"] if fault["moved"] >= MOVED]
    apart = [fault for fault in counted if worst(fault) > ENGINES_APART]
    for fault in counted:
        if fault not in apart:
            print(
                f"{fault['key']}: the scale factor moves by {fault['moved']:.0f} standard deviations, "
                f"{worst(fault):.1f} seen"
            )
    least = int(binom.ppf(0.025, len(counted), LEAST_FAULTS))
    print(f"faults that are seen: {len(apart)} of {len(counted)} (at least {least})")
    return 0 if counted and len(apart) >= least else 1


if __name__ == "__main__":
    raise SystemExit(main())
