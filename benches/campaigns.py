"""Campaigns of 4 to 12 runs whose bias differs: shared parameters, the next run, what it goes with by chance.

python -m benches.campaigns --seed 1603 --count 300
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

import accelcal as ac
from accelcal.data.recording import Recording, RunLabels
from accelcal.simulation import CXL02_RIG

SECONDS = 10.0
MEAN, SCALE = 0.05, 0.01


def runs(rng: np.random.Generator, biases: np.ndarray) -> list[Recording]:
    """One run for each bias, on dates and with mountings that have nothing to do with it."""
    days = np.sort(rng.uniform(0.0, 200.0, len(biases)))
    recordings = []
    for k, (bias, day) in enumerate(zip(biases, days, strict=True)):
        truth = {"bias": float(bias), "scale_factor": SCALE}
        recording = ac.simulate("tones", seconds=SECONDS, rig=CXL02_RIG, parameters=truth, rng=rng).recording
        labels = RunLabels(date=float(day), mounting="AB"[k % 2])
        recordings.append(replace(recording, name=f"run{k}", digest=f"{rng.integers(1 << 60)}", labels=labels))
    return recordings


def main() -> None:
    """Print figures beside their bars."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seed", type=int, default=1603)
    asked.add_argument("--count", type=int, default=300)
    given = asked.parse_args()
    z, means, inside, spread, varied, goes = [], [], 0, 0, 0, 0
    for number in range(given.count):
        rng = np.random.default_rng([given.seed, number])
        count, D = int(rng.integers(4, 13)), 10.0 ** rng.uniform(-3.5, -1.5)
        fit = ac.fit(runs(rng, MEAN + D * rng.standard_normal(count)))
        z.append((fit["scale_factor"].value - SCALE) / fit["scale_factor"].std)
        goes += bool(fit.goes_with)
        varied += len(fit.spreads)
        for item in fit.spreads:
            mean = fit[item.name].value
            means.append(abs(MEAN - mean) <= item.mean_half)
            inside += abs(MEAN + D * rng.standard_normal() - mean) <= item.next_half
            spread += item.low <= D <= item.high
    equal = 0
    for number in range(given.count):
        rng = np.random.default_rng([given.seed, 1 << 20, number])
        fit = ac.fit(runs(rng, np.full(int(rng.integers(4, 13)), MEAN)))
        equal += bool(fit.spreads)
    rms = float(np.sqrt(np.mean(np.square(z))))
    print(f"{given.count} campaigns: z-rms of k {rms:.3f} (0.9 to 1.1), the bias differs in {varied}")
    print(f"95 % intervals: mean {sum(means)}, next run {inside}, spread {spread} of {varied}")
    print(f"goes with a date or mounting by chance: {goes} of {given.count} (1 %)")
    print(f"equal biases said to differ: {equal} of {given.count} (1 %)")


if __name__ == "__main__":
    main()
