"""Lost motion on moves with rests, and none: is it named, alone, with its size, and is nothing named without it?

This file's simulator imports nothing of the product: point-to-point moves of 5 to 50 mm (polynomials of the fifth
degree), rests of 0.2 to 1 s, counts of 0.1 to 1 um, a gap of 2 to 5 um behind which the reading hangs.

    python -m benches.play [--records 10] [--seed 1] [--out target/bench/play.jsonl]
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from benches.outcomes import Outcome, Trial, run_all

Array = NDArray[np.float64]

SECONDS, RATE, FINE = 24.0, 1000.0, 4
LONGEST, REACH = 0.05, 0.06
"""Longest move and half the travel, m."""
SIGMA, ALONE = 3.0, 0.9
"""Standard deviations that the size may err by, and the share of records that name the play and nothing beside it."""


def moves(rng: np.random.Generator) -> tuple[Array, Array]:
    """Position and acceleration at `FINE` times the rate, m and m/s²."""
    rate, place = RATE * FINE, 0.0
    position, acceleration = [np.zeros(int(0.5 * rate))], [np.zeros(int(0.5 * rate))]
    while sum(map(len, position)) < SECONDS * rate:
        way = rng.uniform(0.1 * LONGEST, LONGEST) * rng.choice([-1.0, 1.0])
        way = -way if abs(place + way) > REACH else way
        duration = max(1.875 * abs(way) / rng.uniform(0.05, 0.3), 0.08)
        x = (np.arange(int(duration * rate)) + 0.5) / int(duration * rate)
        rest = int(rng.uniform(0.2, 1.0) * rate)
        position += [place + way * x**3 * (10.0 - 15.0 * x + 6.0 * x**2), np.full(rest, place + way)]
        acceleration += [way * x * (60.0 - 180.0 * x + 120.0 * x**2) / duration**2, np.zeros(rest)]
        place += way
    end = int(SECONDS * rate)
    return np.concatenate(position)[:end], np.concatenate(acceleration)[:end]


def behind(position: Array, gap: float) -> Array:
    """What a reading that hangs in a gap follows, (n,) m."""
    reading = position.copy()
    for i in range(1, len(reading)):
        reading[i] = min(max(reading[i - 1], position[i] - 0.5 * gap), position[i] + 0.5 * gap)
    return reading


def run(trial: Trial) -> Outcome:
    """Improve a record with a gap, or one without."""
    import accelcal as ac

    rng = np.random.default_rng([20517, trial.seed, trial.number])
    position, acceleration = moves(rng)
    gap = float(rng.uniform(2e-6, 5e-6)) if trial.kind == "play" else 0.0
    count, noise = float(rng.choice([1e-7, 2e-7, 5e-7, 1e-6])), float(rng.uniform(2e-8, 1e-7))
    sigma = float(rng.uniform(1e-3, 5e-3))
    reading = behind(position, gap)[::FINE]
    t = np.arange(len(reading)) / RATE
    reading = np.round((reading + noise * rng.standard_normal(len(t))) / count) * count
    output = 0.08 + 0.988 * acceleration[::FINE] + sigma * rng.standard_normal(len(t))
    rig = ac.Rig(ac.Sensor(noise=sigma / np.sqrt(0.5 * RATE)))
    units = {"accel": "m/s^2", "position": "m"}
    better = ac.improve(ac.Recording.from_arrays(t, output, reading, units=units, rig=rig))
    size = better.best["encoder_backlash"] if "encoder_backlash" in better.effects else None
    return {
        "key": trial.key,
        "kind": trial.kind,
        "gap": gap,
        "count": count,
        "effects": [*better.effects],
        "size": None if size is None else [size.value, size.std],
        "sentence": better.sentence,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, then print figure, count and threshold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=Path("target/bench/play.jsonl"))
    chosen = parser.parse_args(arguments)
    trials = [Trial(kind, n, chosen.seed) for n in range(chosen.records) for kind in ("play", "none")]
    outcomes = run_all(
        run,
        trials,
        chosen.out,
        chosen.workers,
        lambda outcome: ("play", "moves with rests", outcome["effects"]) if outcome["kind"] == "none" else None,
    )
    for outcome in outcomes:
        print(f"{outcome['key']}: gap {outcome['gap']:.3g}, {outcome['effects']} {outcome['size']}")
    hidden = [outcome for outcome in outcomes if outcome["kind"] == "play"]
    alone = sum(outcome["effects"] == ["encoder_backlash"] for outcome in hidden)
    sized = sum(bool(o["size"]) and abs(o["size"][0] + o["gap"]) < SIGMA * o["size"][1] for o in hidden)
    false = sum(bool(outcome["effects"]) for outcome in outcomes if outcome["kind"] == "none")
    print(f"named, and alone: {alone} of {len(hidden)}, at least {ALONE * len(hidden):.3g}")
    print(f"within {SIGMA:g} standard deviations: {sized} of {len(hidden)}, all")
    print(f"named where nothing is hidden: {false} of {len(outcomes) - len(hidden)}, none")
    return 0 if alone >= ALONE * len(hidden) and sized == len(hidden) and not false else 1


if __name__ == "__main__":
    raise SystemExit(main())
