"""A scale factor that is a Gauss-Markov process: what is named, and errors of k, K2 and K3, on independent worlds.

python -m benches.random_processes --seed 1701 --count 30 --nulls 300
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from scipy import stats

import accelcal as ac
from accelcal.diagnosis.verdict import Diagnosis
from benches.ledger import enter
from tests.worlds import Hidden, World

CASES = ((2e-3, 2.0), (5e-3, 0.5))
"""Standard deviation of the scale factor and its correlation time, s."""
CLASS = {"scale_gauss_markov", "scale_random_walk", "scale_drift", "scale_step"}
"""Names of a class that are right."""
MOTIONS = ("interleaved", "tones")


def recorded(world: World, folder: Path) -> ac.Recording:
    """The record of a world as a user would open it."""
    return ac.load(world.record().write(folder, f"{world.seed}"))


def named(diagnosis: Diagnosis) -> set[str]:
    """Names of the first effect that is missing and of all that it is confounded with."""
    return set(diagnosis.classes[0].members) if diagnosis.classes else set()


def main() -> None:
    """Print counts and figures beside their bars."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seed", type=int, default=1701)
    asked.add_argument("--count", type=int, default=30)
    asked.add_argument("--nulls", type=int, default=300)
    asked.add_argument("--sensor", default="ADXL105")
    given = asked.parse_args()
    scores: dict[str, list[float]] = {"scale_factor": [], "quadratic": [], "cubic": []}
    right = total = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for size, tau in CASES:
            for k in range(given.count):
                hidden = (Hidden("scale_gauss_markov", size, {"tau": tau}),)
                world = World(MOTIONS[k % 2], given.sensor, hidden, seed=1000 * given.seed + k).settled()
                run = recorded(world, folder)
                linear = ac.fit(run)
                diagnosis = ac.diagnose(linear, run)
                group = named(diagnosis)
                fine = bool(group & CLASS)
                right, total = right + fine, total + 1
                with_process = linear.model.add("quadratic", "cubic")
                line = f"{size:g} {tau:g} {world.motion} {world.seed}: {sorted(group) or diagnosis.verdict}"
                if fine and diagnosis.scan.detected:
                    with_process = diagnosis.scan.detected[0].enter(with_process)
                fit = ac.fit(run, with_process)
                truth = {"scale_factor": world.scale_factor or 0.0}
                for item, values in scores.items():
                    values.append((fit[item].value - truth.get(item, 0.0)) / fit[item].std)
                    line += f" {item} {values[-1]:.2f}"
                print(line, flush=True)
    false = 0
    with tempfile.TemporaryDirectory() as name:
        for k in range(given.nulls):
            run = recorded(World(MOTIONS[k % 2], given.sensor, (), seed=1000 * given.seed + 500 + k), Path(name))
            group = named(ac.diagnose(ac.fit(run), run))
            enter("random_processes", f"{given.sensor} {MOTIONS[k % 2]}", 1000 * given.seed + 500 + k, sorted(group))
            false += bool(group & CLASS)
            if group:
                print(f"nothing hidden, {MOTIONS[k % 2]} {k}: {sorted(group)}", flush=True)
    most = int(stats.binom.ppf(0.975, given.nulls, 0.01))
    print(f"nothing hidden: a process, drift or step of the scale named in {false} of {given.nulls} (at most {most})")
    print(f"process in the class: {right} of {total} (least {int(stats.binom.ppf(0.025, total, 0.95))})")
    for item, values in scores.items():
        rms, beyond = float(np.sqrt(np.mean(np.square(values)))), int(np.sum(np.abs(values) > 3.0))
        most = int(stats.binom.ppf(0.975, total, 0.01))
        print(f"{item}: z rms {rms:.3f} of {total}, beyond 3: {beyond} (at most {most})")


if __name__ == "__main__":
    main()
