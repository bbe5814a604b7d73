"""Simulated sensors at rest: how often the stated 95 % intervals hold noise density, bias instability and random walk.

Run from the top of the repository: python -m benches.allan [--records 1000] [--seed 1] [--out target/bench/allan.jsonl]
Each sensor has white noise, flicker of random Fourier amplitudes (no formula of the estimator) and a random walk, in a
record of 100 to 1000 times its Allan minimum. Each of the three intervals must hold the truth in 93 to 97 % of the
records; with 1000 records and true coverage of 95 % a bar is missed in 0.4 % of the runs. A line per record; an
interrupted run continues. Exit code 1 where a bar is missed.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence

import numpy as np

from accelcal.data import Array, Channel, Recording, Rig
from accelcal.estimation.allan import TERMS, rest
from benches.outcomes import Outcome, Trial, asked, run_all

SAMPLES = 100_000
COVERED = (0.93, 0.97)
LONGER = 16
"""Period of the flicker over the length of the record."""


def flicker(count: int, rng: np.random.Generator) -> Array:
    """Flicker with B = 1 at one sample a second, (count,): random Fourier amplitudes (Timmer, Koenig 1995) with the
    one-sided density 1/(pi f) up to half the rate, a part of a period that is `LONGER`."""
    whole = LONGER * count
    f = np.arange(1, whole // 2 + 1) / whole
    parts = rng.standard_normal((2, len(f))) * np.sqrt(whole / (4.0 * np.pi * f))
    return np.fft.irfft(np.append(0.0, parts[0] + 1j * parts[1]), whole)[:count]


def sensor(rng: np.random.Generator, count: int = SAMPLES) -> tuple[Recording, tuple[float, float, float]]:
    """A record at rest, and its N in (m/s²)/sqrt(Hz), B in m/s² and K in (m/s²)/sqrt(s)."""
    rate = 10.0 ** rng.uniform(-1.0, 3.0)
    minimum = count / 10.0 ** rng.uniform(2.0, 3.0)
    noise = 10.0 ** rng.uniform(-5.0, -2.0)
    instability = noise * 10.0 ** rng.uniform(-1.5, -0.8)
    walk = math.sqrt(1.5) * noise / minimum
    white = math.sqrt(0.5) * noise * rng.standard_normal(count)  # at one sample a second
    y = white + instability * flicker(count, rng) + walk * np.cumsum(rng.standard_normal(count))
    nothing = np.empty(0)
    accel = Channel("accel", np.arange(count) / rate, 0.1 + y, "m/s^2")
    recording = Recording(accel, Channel("position", nothing, nothing, "m"), Rig())
    return recording, (noise / math.sqrt(rate), instability, walk * math.sqrt(rate))


def outcome_of(trial: Trial) -> Outcome:
    """Intervals of one sensor, and the truth."""
    recording, truth = sensor(np.random.default_rng([trial.seed, trial.number]))
    (output,) = rest(recording).outputs
    intervals = {term.name: (t, term.low, term.value, term.high) for term, t in zip(output.terms, truth, strict=True)}
    return {"key": trial.key, "notes": len(output.notes), **intervals}


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code."""
    given = asked(__doc__, "allan", 1000, arguments)
    trials = [Trial("rest", number, given.seed) for number in range(given.records)]
    outcomes = run_all(outcome_of, trials, given.out, given.workers)
    right = True
    for name in TERMS:
        truth, low, value, high = np.transpose([outcome[name] for outcome in outcomes])
        covered = float(np.mean((low <= truth) & (truth <= high)))
        right &= COVERED[0] <= covered <= COVERED[1]
        print(
            f"{name}: {100.0 * covered:.1f} % of {len(outcomes)} intervals hold the truth (93 to 97 %), an upper "
            f"limit alone in {100.0 * np.mean(low == 0.0):.1f} %, median error "
            f"{100.0 * np.median(np.abs(value / truth - 1.0)):.2g} %"
        )
    print(f"{np.mean([outcome['notes'] > 0 for outcome in outcomes]):.1%} of the records with a note on the spectrum")
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
