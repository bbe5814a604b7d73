"""References from poor to far too good: what is named where nothing is missing, and what of hidden effects is found.

From the top of the repository: python -m benches.crossovers [--records 400] [--hidden 84] [--seed 1]
                                                            [--out build/crossovers]
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
from scipy.stats import binom, chi2

from accelcal import Fit, verbs
from accelcal.io import load
from benches.outcomes import run_all
from benches.references import AT_OUTPUT
from tests.hidden.trials import MIXES, Outcome, beside, hide, improved
from tests.hidden.verdicts import in_class
from tests.worlds import SENSORS, Nuisances, World, at_d
from tests.worlds.scene import G0
from tests.worlds.world import ACCEL_RATE, CUTOFF, time_constant

LEAST, MOST = 0.01, 10.0
"""Crossover over the sampling rate of the output."""
READING_RATES = (0.5, 1.0, 2.0)
"""Over that of the output, about."""
NAMED = 0.01
"""Share of the records in which something may be named."""
EVEN = (0.9, 1.1)
"""Of the rms of normalised errors."""
SEEN = [name for name in AT_OUTPUT if not name.startswith("vibration")]
"""Effects of the sensor and of its clock. A reference that is so good would see what shakes the stage, and errors of an
encoder that it would show lie beyond the band of the rows."""
D, LEAST_IN_CLASS = 20.0, 0.97
"""Strength of hidden effects, and the share of them that must be in a reported class."""
ENOUGH = 400
"""Values from which on `EVEN` bounds the rms; of fewer the 99 % interval of their number does."""
COUNTED = {"scale_factor": ("scale_factor",), "bias": ("bias",), "delay": ("time_offset", "lowpass_error")}
"""Sums of coefficients."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One record."""

    number: int
    seed: int
    name: str = ""
    """What is hidden."""

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.seed}/{self.number}" + (f"/{self.name}" if self.name else "")

    def world(self) -> tuple[World, float]:
        """The world, and its crossover over the sampling rate of the output.

        The bearings do not shake it: a reference that is so good would see them.

        Raises
        ------
        ValueError
            If the motion does not show the effect.
        """
        rng = np.random.default_rng([self.seed, self.number])
        motion, sensor = MIXES[(self.number + (self.number // len(SEEN) if self.name else 0)) % len(MIXES)]
        crossover = float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST))))
        rate = float(rng.choice(READING_RATES)) * ACCEL_RATE * (1.0 + 3e-4 * float(rng.standard_normal()))
        density = SENSORS[sensor].noise ** 2 / 2.0
        variance = density * rate / (2.0 * np.pi * crossover * ACCEL_RATE) ** 4
        noise = float(np.sqrt(variance * 12.0 / 13.0))  # the counts, as wide as it, are the rest
        names = (self.name,) if self.name else ()
        nuisances = replace(beside(names, Nuisances.draw(rng)), vibration=0.0)
        changed = World(motion, sensor, seed=int(rng.integers(2**31)), nuisances=nuisances)
        changed = replace(changed, encoder_rate=rate, encoder_noise=noise, resolution=noise)
        if names:
            changed = at_d(replace(changed, hidden=(hide(self.name, rng.choice([-1.0, 1.0])),)), D)
        return changed, crossover


def run(trial: Trial) -> Outcome:
    """Draw, write, load, improve."""
    outcome: Outcome = {"key": trial.key, "name": trial.name}
    try:
        world, crossover = trial.world()
    except ValueError as refused:
        return {**outcome, "skipped": str(refused)}
    outcome |= {"crossover": crossover, "sensor": world.sensor, "motion": world.motion}
    begin = time.process_time()
    try:
        record = world.record()
        with tempfile.TemporaryDirectory() as folder:
            recording = load(record.write(folder))
        begin = time.process_time()
        improvement = verbs.improve(recording, holdout=recording)
    except Exception:
        return {**outcome, "error": traceback.format_exc()}
    fit = improvement.steps[0].fit
    return {
        **outcome,
        **improved(improvement, record.world),
        "names": [trial.name] if trial.name else [],
        "nuisances": {"vibration": 0.0, "converter_bits": world.nuisances.converter_bits},
        "remarks": [remark.sentence for remark in fit.remarks],
        "method": fit.method,
        "z": {} if trial.name else errors(fit, record.world),
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
    results = {}
    for name, parts in COUNTED.items():
        sum_of = np.array([float(item in parts) for item in names])
        results[name] = float(sum_of @ off / np.sqrt(sum_of @ fit.covariance @ sum_of))
    return results


def null(outcome: Outcome) -> tuple[str, str, Sequence[str]] | None:
    """Bench, regime and false names for the ledger, where nothing was hidden."""
    honest = not outcome["name"] and "effects" in outcome
    return ("crossovers", f"crossover {outcome['crossover']:.2g}", outcome["effects"]) if honest else None


def found_hidden(outcomes: Sequence[Outcome]) -> bool:
    """Print how many hidden effects are in a reported class; whether enough are."""
    holds = True
    for method in ("weak", "replay"):
        scored = [outcome for outcome in outcomes if outcome.get("method") == method]
        results = [outcome for outcome in scored if in_class(outcome, outcome["name"])]
        least = int(binom.ppf(0.025, max(1, len(scored)), LEAST_IN_CLASS))
        holds &= len(results) >= least
        print(f"{method}: {len(results)} of {len(scored)} effects at d = {D:g} in a reported class (at least {least})")
        for outcome in scored:
            if outcome not in results:
                print(
                    f"  {outcome['key']}: crossover {outcome['crossover']:.3g}: "
                    f"{outcome['effects']}, {outcome['verdict']}"
                )
    for outcome in outcomes:
        if "error" in outcome:
            print(f"{outcome['key']}: crossover {outcome['crossover']:.3g}: {outcome['error'].splitlines()[-1]}")
    return holds and not any("error" in outcome for outcome in outcomes)


def report(outcomes: Sequence[Outcome]) -> bool:
    """Print figure, count and threshold of every claim on nulls; whether all hold."""
    scored = [outcome for outcome in outcomes if "error" not in outcome]
    for outcome in outcomes:
        if "error" in outcome:
            print(f"{outcome['key']}: crossover {outcome['crossover']:.3g}: {outcome['error'].splitlines()[-1]}")
    named = [outcome for outcome in scored if outcome["effects"]]
    for outcome in named:
        print(
            f"{outcome['key']}: crossover {outcome['crossover']:.3g}, {outcome['sensor']}, {outcome['motion']}: "
            f"{outcome['effects']}"
        )
    most = int(binom.ppf(0.975, max(1, len(scored)), NAMED))
    adequate = sum(outcome["verdict"] == "adequate" for outcome in scored)
    weak = sum(outcome["method"] == "weak" for outcome in scored)
    print(f"{len(scored)} records, {weak} by the weak form; something is named in {len(named)} (at most {most})")
    print(f"verdict adequate: {adequate} of {len(scored)}")
    holds = len(named) <= most and len(scored) == len(outcomes)
    for name in COUNTED:
        z = np.array([outcome["z"][name] for outcome in scored])
        rms = float(np.sqrt(np.mean(z**2)))
        low, high = EVEN if len(z) >= ENOUGH else np.sqrt(chi2.ppf([0.005, 0.995], len(z)) / len(z))
        holds &= bool(low <= rms <= high)
        print(f"rms z of {name}: {rms:.3f} of {len(z)} ({low:.2f} to {high:.2f}), largest {np.max(np.abs(z)):.1f}")
    return holds


def main() -> int:
    """Run what is missing, and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=400)
    parser.add_argument("--hidden", type=int, default=84, help="records with one hidden effect")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/crossovers"))
    wanted = parser.parse_args()
    nulls = [Trial(number, wanted.seed) for number in range(wanted.records)]
    hidden = [Trial(number, wanted.seed, SEEN[number % len(SEEN)]) for number in range(wanted.hidden)]
    outcomes = run_all(run, nulls + hidden, wanted.out / f"seed{wanted.seed}.jsonl", wanted.workers, null)
    holds = not nulls or report(outcomes[: len(nulls)])
    return 0 if found_hidden(outcomes[len(nulls) :]) and holds else 1


if __name__ == "__main__":
    raise SystemExit(main())
