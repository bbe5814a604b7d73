"""What the replay costs: 170 columns and their Gram matrix over a minute, an hour in stretches, and how time grows.

Run from the top of the repository: python -m benches.replay
Encoder readings at 833.5 Hz run through the two-state filter; 170 columns (powers and products of acceleration,
velocity, position and time, on a grid of 400 Hz) are carried through its gains stretch by stretch, every reading
counts, and the Gram matrix of columns and innovations is summed. Columns are made where they are needed, so an hour of
them is never held in memory. Each length runs in a fresh process with one BLAS thread. Prints figure and threshold;
exit code 1 when one is missed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from itertools import product
from pathlib import Path

import numpy as np

from accelcal import _core
from benches.peak import megabytes

COLUMNS = 170
RATE = 833.5
"""Encoder readings per second, Hz."""
GRID = 1.0 / 400.0
"""Spacing of the grid on which columns are given, s."""
STRETCH = 1 << 12
"""Readings whose columns are held in memory at a time."""
LENGTHS = (60.0, 240.0, 960.0, 3600.0)
"""s"""
REPEATS = 3
"""Of the minute, the fastest counts: what else runs on the machine only adds."""
SECONDS_FOR_A_MINUTE = 0.25
MEGABYTES_FOR_AN_HOUR = 400.0
EXPONENT = (0.95, 1.05)
"""Of time over length, by least squares on logarithms."""
TONES = ((2.0, 11.0), (1.5, 23.0), (1.0, 41.0))
"""Amplitude, m/s², and angular frequency, rad/s."""
POWERS = tuple(power for power in product(range(6), range(6), range(4), range(3)) if 0 < sum(power) < 8)[:COLUMNS]
"""Exponents of acceleration, velocity, position and time in each column."""
PRIOR = (0.0, 1e-8, 0.0, 1.0)


def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Acceleration, velocity and position, about 1 each."""
    a = sum(A * np.sin(w * t) for A, w in TONES)
    v = sum(-A / w * np.cos(w * t) for A, w in TONES)
    p = sum(-A / w**2 * np.sin(w * t) for A, w in TONES)
    return np.asarray(a), np.asarray(v), np.asarray(p)


def drive(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocity gained over the interval before each reading, and position beyond v h."""
    h = 1.0 / RATE
    first, second = np.zeros(len(t)), np.zeros(len(t))
    for begin in range(1, len(t), STRETCH):
        here = slice(begin, begin + STRETCH)
        (_, v0, p0), (_, v1, p1) = motion(t[here] - h), motion(t[here])
        first[here], second[here] = v1 - v0, p1 - p0 - h * v0
    return first, second


def columns(t: np.ndarray, length: float) -> list[np.ndarray]:
    """All columns at times t, (n,) each."""
    words = (*motion(t), t / length)
    powers = [[np.ones_like(t)] for _ in words]
    for word, powers_of in zip(words, powers, strict=True):
        while len(powers_of) < 6:
            powers_of.append(powers_of[-1] * word)
    results = []
    for exponents in POWERS:
        used = [powers_of[exponent] for powers_of, exponent in zip(powers, exponents, strict=True) if exponent]
        column = used[0].copy()
        for factor in used[1:]:
            column *= factor
        results.append(column)
    return results


def gram(seconds: float) -> dict[str, float]:
    """The Gram matrix of one length, and the processor time of everything behind the filter's own pass."""
    t = np.arange(int(seconds * RATE)) / RATE
    rng = np.random.default_rng(1)
    z = 1e-6 * rng.standard_normal(len(t))
    for begin in range(0, len(t), STRETCH):
        z[begin : begin + STRETCH] += motion(t[begin : begin + STRETCH])[2]
    first, second = drive(t)
    restart = np.zeros(len(t), dtype=bool)
    restart[0] = True
    counts = np.ones(len(t), dtype=bool)
    begun = time.process_time()
    track = _core.ReplayTrack(t, z, first, second, restart, np.zeros(len(t)), np.empty(0), q=1e-6, r=1e-12, prior=PRIOR)
    filtered = time.process_time()
    del first, second, z
    whitened = track.series("e")
    whitened /= np.sqrt(track.series("S"))
    total = np.zeros((COLUMNS + 1, COLUMNS + 1))
    state = np.zeros((COLUMNS, 2))
    duration = 0.0
    for begin in range(0, len(t), STRETCH):
        end = min(begin + STRETCH, len(t))
        low = max(0, int(t[max(begin - 1, 0)] / GRID) - 2)
        high = int(t[end - 1] / GRID) + 4
        before = time.process_time()
        given = columns(np.arange(low, high) * GRID, seconds)
        duration += time.process_time() - before
        bank = _core.Bank(track, t, restart, counts, grid=(low * GRID, GRID, high - low), from_=begin, to=end, group=1)
        X = np.empty((COLUMNS + 1, end - begin))
        X[-1] = whitened[begin:end]
        for at in range(0, COLUMNS, 8):
            here = slice(at, min(at + 8, COLUMNS))
            bank.carry_inputs(given[here], -1.0, state[here], X[here])
        total += X @ X.T
    done = time.process_time()
    assert np.all(np.isfinite(total))
    return {
        "seconds": done - begun - duration,
        "filter": filtered - begun,
        "columns": duration,
        "megabytes": megabytes(),
        "innovation": total[-1, -1] / len(t),
    }


def cost(seconds: float) -> dict[str, float]:
    """One length in a process of its own."""
    run = [sys.executable, "-m", "benches.replay", str(seconds)]
    alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(run, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=True, env=alone)
    return dict(json.loads(done.stdout))


def main() -> int:
    """Four lengths, three thresholds."""
    results = []
    for seconds in LENGTHS:
        tries = [cost(seconds) for _ in range(REPEATS if seconds == LENGTHS[0] else 1)]
        results.append(min(tries, key=lambda run: run["seconds"]))
        last = results[-1]
        print(
            f"{seconds:.0f} s, {COLUMNS} columns: {last['seconds']:.3f} s processor time "
            f"(filter {last['filter']:.3f} s; "
            f"not counted: {last['columns']:.2f} s to make the columns), peak {last['megabytes']:.0f} MB",
            flush=True,
        )
    exponent = float(np.polyfit(np.log(LENGTHS), np.log([run["seconds"] for run in results]), 1)[0])
    checks = [
        ("a minute with Gram matrix, s", results[0]["seconds"], (0.0, SECONDS_FOR_A_MINUTE)),
        ("peak memory for an hour, MB", results[-1]["megabytes"], (0.0, MEGABYTES_FOR_AN_HOUR)),
        ("exponent of time over length", exponent, EXPONENT),
    ]
    for what, value, (low, high) in checks:
        print(f"{what}: {value:.3f}, limits {low:g} to {high:g}: {'ok' if low <= value <= high else 'MISSED'}")
    return 0 if all(low <= value <= high for _, value, (low, high) in checks) else 1


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(gram(float(sys.argv[1]))))
        raise SystemExit(0)
    raise SystemExit(main())
