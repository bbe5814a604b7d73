"""Is power honest (bar 10): detection as predicted beside detection as observed, on worlds that share no code with it.

Run from the top of the repository: python -m benches.power [--records 50] [--only velocity]
Prints count and prediction of every pair with its 99.9 % binomial band; exit code 1 when one is missed, or when all
together differ by more than 5 points.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.stats import binom
from tests.worlds import Hidden, World

from accelcal import io
from accelcal.diagnose import scan
from accelcal.fit import Pass, solve_runs
from accelcal.model import Model
from accelcal.power import power

SECONDS = 30.0
POOLED = 0.05
"""Difference of all pairs together that is allowed."""


@dataclass(frozen=True, slots=True)
class Pair:
    """An effect on a kind of motion, as large as stands `d` standard deviations from nothing on the first record."""

    effect: str
    motion: str
    sensor: str
    d: float


PAIRS = (
    Pair("quadratic", "interleaved", "ADXL105", 3.5),
    Pair("quadratic", "tones", "CXL02", 4.5),
    Pair("quadratic", "fast", "ADXL105", 5.5),
    Pair("cubic", "interleaved", "CXL02", 4.0),
    Pair("cubic", "fast", "ADXL105", 5.0),
    Pair("cubic", "bursts", "CXL02", 3.5),
    Pair("odd_quadratic", "interleaved", "ADXL105", 4.5),
    Pair("odd_quadratic", "bursts", "CXL02", 5.5),
    Pair("scale_asymmetry", "interleaved", "CXL02", 4.0),
    Pair("scale_asymmetry", "tones", "ADXL105", 5.0),
    Pair("bias_drift", "interleaved", "ADXL105", 4.0),
    Pair("bias_drift", "bursts", "CXL02", 5.0),
    Pair("scale_drift", "bursts", "ADXL105", 4.5),
    Pair("velocity", "interleaved", "CXL02", 4.5),
    Pair("velocity_squared", "moves", "CXL02", 4.0),
    Pair("velocity_odd", "interleaved", "ADXL105", 5.5),
    Pair("coulomb", "interleaved", "CXL02", 3.5),
    Pair("acceleration_velocity", "fast", "CXL02", 4.5),
    Pair("rail_slope", "moves", "ADXL105", 4.5),
    Pair("rail_curve", "interleaved", "CXL02", 5.0),
)


def fitted(world: World) -> Pass:
    """The linear model on a world's record, read from its file."""
    with tempfile.TemporaryDirectory() as folder:
        recording = io.load(world.record().write(folder))
    return solve_runs(Model.linear(), [recording]).passes[0]


def size_of(pair: Pair) -> float:
    """Size that stands `pair.d` standard deviations from nothing on a record that is not counted."""
    one = fitted(World(pair.motion, pair.sensor, seconds=SECONDS, seed=10_000))
    return pair.d / power(one)[pair.effect].d[0]


def one_record(pair: Pair, size: float, seed: int) -> tuple[float, bool]:
    """Predicted probability on this record, and whether anything was found on it."""
    one = fitted(World(pair.motion, pair.sensor, (Hidden(pair.effect, size),), seconds=SECONDS, seed=seed))
    return power(one).detection(pair.effect, size), bool(scan([one], Model.linear()).found)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run every pair and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=50, help="records for each pair")
    parser.add_argument("--only", default="", help="effects whose name contains this")
    chosen = parser.parse_args(arguments)
    began, good = time.perf_counter(), True
    predicted, observed, total = 0.0, 0, 0
    print(f"{'effect':22} {'motion':12} {'sensor':8} predicted observed 99.9 % band")
    with multiprocessing.Pool(2) as pool:
        for pair in (p for p in PAIRS if chosen.only in p.effect):
            rows = pool.map(partial(one_record, pair, size_of(pair)), range(chosen.records), chunksize=2)
            probability, count = float(np.mean([p for p, _ in rows])), sum(hit for _, hit in rows)
            low, high = binom.ppf([0.0005, 0.9995], chosen.records, probability)
            inside = bool(low <= count <= high)
            good &= inside
            predicted, observed, total = predicted + sum(p for p, _ in rows), observed + count, total + len(rows)
            print(
                f"{pair.effect:22} {pair.motion:12} {pair.sensor:8} {probability:9.2f} {count / chosen.records:8.2f} "
                f"{low / chosen.records:.2f}-{high / chosen.records:.2f} {'' if inside else 'MISSED'}",
                flush=True,
            )
    gap = (observed - predicted) / total
    good &= abs(gap) <= POOLED
    print(f"all: predicted {predicted / total:.3f}, observed {observed / total:.3f} on {total} records")
    print(f"{'all bars hold' if good else 'A BAR IS MISSED'}; {time.perf_counter() - began:.0f} s")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
