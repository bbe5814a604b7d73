"""Whether channels of different runs are told apart, and no honest run is taken for one: `python -m benches.unrelated`.

Shuffled pairs take the output of one record and the position of another of the same rig, profile and length. Honest
ones: the records themselves, the same with motion scaled down to and below the noise, and records with a large hidden
effect. Prints both rates with their limits and exits with 1 where one is missed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from contextlib import suppress
from dataclasses import replace

import numpy as np

from accelcal.data.recording import Recording, RecordingError
from accelcal.diagnosis.one_axis import require_one_axis
from accelcal.io import load
from tests.regimes.hidden import PLANTED, OutOfReach, plant
from tests.regimes.motion import Motion
from tests.regimes.regimes import TABLE, Regime
from tests.regimes.rig import Planted, measure

NAMES = tuple(name for name, regime in TABLE.items() if not regime.refusal)
WEAKEST, STRONGEST = 1e-4, 1e-1
"""Factors of a weak motion, least and most."""
LIMIT_SHUFFLED, LIMIT_HONEST = 0.99, 0.01


def built(regime: Regime, seed: int, scale: float = 1.0, hidden: str = "") -> Recording:
    """A record of a regime, its motion scaled, with an effect planted."""
    motion = regime.motion(seed)
    if scale != 1.0:
        motion = Motion.of(replace(motion.a, first=scale * motion.a.first, slope=scale * motion.a.slope))
    planted = plant(regime, hidden, seed) if hidden else Planted()
    record = measure(motion, regime.rig, regime.seconds, seed, planted)
    with tempfile.TemporaryDirectory() as folder:
        return load(record.write(folder))


def is_unrelated(recording: Recording) -> bool:
    """Whether the record is called unrelated."""
    try:
        require_one_axis([recording])
    except RecordingError as error:
        return "not one axis" in str(error)
    return False


def main() -> int:
    """Print both rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    counts = dict.fromkeys(("shuffled", "whole", "weak", "hidden"), 0)
    tried = dict.fromkeys(counts, 0)
    for number in range(options.records):
        name = NAMES[number % len(NAMES)]
        regime, seeds = TABLE[name], rng.integers(1 << 30, size=2)
        first, second = (built(regime, int(seed)) for seed in seeds)
        scale = float(np.exp(rng.uniform(np.log(WEAKEST), np.log(STRONGEST))))
        cases = {
            "shuffled": replace(first, position=second.position, position_steps=()),
            "whole": first,
            "weak": built(regime, int(seeds[0]), scale),
        }
        with suppress(OutOfReach):
            cases["hidden"] = built(regime, int(seeds[0]), hidden=str(rng.choice(PLANTED)))
        for kind, recording in cases.items():
            result = is_unrelated(recording)
            counts[kind] += result
            tried[kind] += 1
            if result != (kind == "shuffled"):
                print(f"  {kind} {name} {seeds[0]} {scale:.2g}: {'said' if result else 'not is_unrelated'}", flush=True)
    for kind, count in counts.items():
        print(f"{kind}: {count} of {tried[kind]} called unrelated")
    shuffled = counts["shuffled"] / tried["shuffled"]
    honest = max(counts[kind] / tried[kind] for kind in ("whole", "weak", "hidden"))
    return int(shuffled < LIMIT_SHUFFLED or honest > LIMIT_HONEST)


if __name__ == "__main__":
    sys.exit(main())
