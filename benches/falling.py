"""The falling error: with the effect that was hidden added, residual and drift on an unseen record fall.

Run from the top of the repository: python -m benches.falling [--records 300] [--seed 1] [--out build/falling]
Each world of `tests/worlds` hides one effect of position, velocity or memory at 20 standard deviations. The model is
fitted without it and with it, and both are compared with another record of the same rig and kind of motion, under one
filter: the accelerometer-side residual, and the drift after 10 s, which also holds the noise of the sensor.
Outcomes are kept line by line in OUT/outcomes.jsonl; an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import scipy

from accelcal import io, verbs
from benches.outcomes import Outcome, run_all
from tests.hidden.trials import Trial, draw

EFFECTS = (
    *("coulomb", "velocity", "velocity_odd", "velocity_squared", "acceleration_velocity"),
    *("rail_slope", "rail_curve", "rail_wave", "encoder_nonlinearity", "encoder_backlash"),
    *("hysteresis", "sensor_lag", "creep", "self_heating"),
)
"""Of position, velocity and memory."""
SHARE = 0.98
"""Of the records in which an error has to fall."""
CHANCE = 0.025
"""Of a count that misses the share by no more than chance."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, then print figure, count and threshold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/falling"))
    chosen = parser.parse_args(arguments)
    trials = [
        Trial(8, number, chosen.seed, (EFFECTS[number % len(EFFECTS)],), 20.0) for number in range(chosen.records)
    ]
    done = run_all(run, trials, chosen.out / "outcomes.jsonl", 1)
    scored = [outcome for outcome in done if "base" in outcome]
    skipped = len(done) - len(scored)
    missed = False
    for what, before, after in (
        ("accelerometer-side residual", [row["residual"][0] for row in scored], [row["residual"][1] for row in scored]),
        ("drift after 10 s", [row["base"] for row in scored], [row["added"] for row in scored]),
    ):
        worse = [n for n in range(len(scored)) if not after[n] <= before[n]]
        few = scipy.stats.binom.ppf(1.0 - CHANCE, len(scored), 1.0 - SHARE)
        missed |= len(worse) > few
        print(f"{what} falls in {len(scored) - len(worse)} of {len(scored)} (>= {SHARE:.0%}, {few:g} may rise)")
        for n in worse:
            floor = f"; floor {scored[n]['floor']:.3g} m" if what.startswith("drift") else ""
            print(f"  rises: {scored[n]['key']}: {before[n]:.4g} to {after[n]:.4g}{floor}")
    print(f"{skipped} skipped")
    return int(missed)


def run(trial: Trial) -> Outcome:
    """Errors on an unseen motion without and with the effect that is hidden."""
    begin = time.process_time()
    try:
        world = draw(trial)
    except ValueError as refused:
        return {"key": trial.key, "skipped": str(refused)}
    settled = world.settled()
    with tempfile.TemporaryDirectory() as folder:
        recording = io.load(settled.record().write(folder))
        unseen = io.load(settled.again(world.motion, world.seed + 1).record().write(Path(folder), "unseen"))
        base = verbs.fit(recording)
        try:
            added = verbs.add(base, recording, trial.names[0])
        except ValueError as refused:
            return {"key": trial.key, "skipped": str(refused)}
        before, after = verbs.compare([base, added], unseen)
    drifts = [compared.coast_rms.get(10.0) for compared in (before, after)]
    if None in drifts:
        return {"key": trial.key, "skipped": "shorter than 10 s"}
    seconds = time.process_time() - begin
    results = {
        "hidden": [[h.name, h.magnitude] for h in settled.hidden],
        "base": drifts[0],
        "added": drifts[1],
        "floor": after.coast_floor.get(10.0),
        "one_step": [before.one_step_rms, after.one_step_rms],
        "residual": [before.accel_rms, after.accel_rms],
        "seconds": seconds,
    }
    return {"key": trial.key, "motion": world.motion, "sensor": world.sensor, **results}


if __name__ == "__main__":
    raise SystemExit(main())
