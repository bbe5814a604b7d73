"""Records in which nothing is missing, references from poor to far too good: what is named, how right estimates are.

From the top of the repository: python -m benches.crossovers [--records 400] [--seed 1] [--out build/crossovers]
The crossover of both noises over the sampling rate of the output is drawn evenly in its logarithm, from a hundredth to
ten, with slower, equal and faster readings; the records come from `tests/worlds`. Outcomes are kept in OUT, and an
interrupted run continues.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from benches.outcomes import run_all
from scipy.stats import binom, chi2
from tests.hidden.trials import MIXES, Outcome
from tests.worlds import SENSORS, Nuisances, World
from tests.worlds.scene import G0
from tests.worlds.world import ACCEL_RATE, CUTOFF, time_constant

from accelcal import Fit, workflow
from accelcal.io import load

LEAST, MOST = 0.01, 10.0
"""Crossover over the sampling rate of the output."""
READING_RATES = (0.5, 1.0, 2.0)
"""Over that of the output, about."""
NAMED = 0.01
"""Share of the records in which something may be named."""
EVEN = (0.9, 1.1)
"""Of the rms of normalised errors."""
ENOUGH = 400
"""Values from which on `EVEN` bounds the rms; of fewer the 99 % interval of their number does."""
COUNTED = {"scale_factor": ("scale_factor",), "bias": ("bias",), "delay": ("time_offset", "lowpass_error")}
"""Sums of coefficients."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One record."""

    number: int
    seed: int

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.seed}/{self.number}"

    def world(self) -> tuple[World, float]:
        """The world, and its crossover over the sampling rate of the output.

        The bearings do not shake it: a reference that is so good would see them.
        """
        rng = np.random.default_rng([self.seed, self.number])
        motion, sensor = MIXES[self.number % len(MIXES)]
        crossover = float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST))))
        rate = float(rng.choice(READING_RATES)) * ACCEL_RATE * (1.0 + 3e-4 * float(rng.standard_normal()))
        density = SENSORS[sensor].noise ** 2 / 2.0
        variance = density * rate / (2.0 * np.pi * crossover * ACCEL_RATE) ** 4
        noise = float(np.sqrt(variance * 12.0 / 13.0))  # the counts, as wide as it, are the rest
        nuisances = replace(Nuisances.draw(rng), vibration=0.0)
        made = World(motion, sensor, seed=int(rng.integers(2**31)), nuisances=nuisances)
        return replace(made, encoder_rate=rate, encoder_noise=noise, resolution=noise), crossover


def run(trial: Trial) -> Outcome:
    """Draw, write, load, improve."""
    world, crossover = trial.world()
    outcome: Outcome = {"key": trial.key, "crossover": crossover, "sensor": world.sensor, "motion": world.motion}
    begin = time.process_time()
    try:
        record = world.record()
        with tempfile.TemporaryDirectory() as folder:
            recording = load(record.write(folder))
        begin = time.process_time()
        found = workflow.improve(recording, holdout=recording)
    except Exception:
        return {**outcome, "error": traceback.format_exc()}
    fit = found.steps[0].fit
    return {
        **outcome,
        "effects": list(found.effects),
        "verdict": found.diagnosis.verdict,
        "remarks": list(fit.remarks),
        "method": fit.method,
        "z": errors(fit, record.world),
        "seconds": time.process_time() - begin,
    }


def errors(fit: Fit, world: World) -> dict[str, float]:
    """Normalised errors of k, K0 and the whole delay, which is that of the clock and what the low-pass has too much."""
    k, nuisances = float(world.scale_factor or 0.0), world.nuisances
    level = (1.0 + k) * G0 * np.sin(nuisances.level_error)
    lag = time_constant(world) - 1.0 / (2.0 * np.pi * CUTOFF)
    truth = {
        "scale_factor": k,
        "bias": float(world.bias or 0.0) + level,
        "time_offset": nuisances.clock_offset,
        "lowpass_error": lag,
    }
    names = [estimate.name for estimate in fit.estimates]
    off = np.array([estimate.value - truth[estimate.name] for estimate in fit.estimates])
    found = {}
    for name, parts in COUNTED.items():
        sum_of = np.array([float(each in parts) for each in names])
        found[name] = float(sum_of @ off / np.sqrt(sum_of @ fit.covariance @ sum_of))
    return found


def report(outcomes: Sequence[Outcome]) -> bool:
    """Print figure, count and threshold of every claim; whether all hold."""
    known = [one for one in outcomes if "error" not in one]
    for one in outcomes:
        if "error" in one:
            print(f"{one['key']}: crossover {one['crossover']:.3g}: {one['error'].splitlines()[-1]}")
    named = [one for one in known if one["effects"]]
    for one in named:
        print(f"{one['key']}: crossover {one['crossover']:.3g}, {one['sensor']}, {one['motion']}: {one['effects']}")
    most = int(binom.ppf(0.975, max(1, len(known)), NAMED))
    adequate = sum(one["verdict"] == "adequate" for one in known)
    weak = sum(one["method"] == "weak" for one in known)
    print(f"{len(known)} records, {weak} by the weak form; something is named in {len(named)} (at most {most})")
    print(f"verdict adequate: {adequate} of {len(known)}")
    holds = len(named) <= most and len(known) == len(outcomes)
    for name in COUNTED:
        z = np.array([one["z"][name] for one in known])
        rms = float(np.sqrt(np.mean(z**2)))
        low, high = EVEN if len(z) >= ENOUGH else np.sqrt(chi2.ppf([0.005, 0.995], len(z)) / len(z))
        holds &= bool(low <= rms <= high)
        print(f"rms z of {name}: {rms:.3f} of {len(z)} ({low:.2f} to {high:.2f}), largest {np.max(np.abs(z)):.1f}")
    return holds


def main() -> int:
    """Run what is missing, and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/crossovers"))
    wanted = parser.parse_args()
    trials = [Trial(number, wanted.seed) for number in range(wanted.records)]
    outcomes = run_all(run, trials, wanted.out / f"seed{wanted.seed}.jsonl", wanted.workers)
    return 0 if report(outcomes) else 1


if __name__ == "__main__":
    raise SystemExit(main())
