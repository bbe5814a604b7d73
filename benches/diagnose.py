"""Cost of a diagnosis of unseen minutes, and of ten minutes and an hour by the weak form.

Run from the top of the repository: python -m benches.diagnose [--weak]
The minutes come from the independent worlds, with and without a hidden effect. Each is diagnosed in a fresh process.
With --weak four tones with a second-order nonlinearity are diagnosed with all candidates by the weak form. An hour by
the replay is in tools/bench_against.sh. Prints figure and threshold; exit code 1 when one is missed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from accelcal.data.recording import Recording
from benches.fit import record, write_sample
from tests.worlds import Hidden, World, at_d

SECONDS_FOR_A_MINUTE = 1.0
"""Processor time, imports warm: everything that `diagnose` does with a record it has not processed before."""
SECONDS_FOR_AN_HOUR = 60.0
MEGABYTES_FOR_AN_HOUR = 1200.0
LINEAR = 1.1
"""Time per sample of an hour over that of ten minutes by the weak form: linear, with room for caches."""
REPEATS = 3
"""Diagnoses of a minute, of which the fastest counts: other load on the machine only adds."""
QUADRATIC = 1e-4
"""Second-order nonlinearity of the output of the hour, (m/s²)⁻¹."""
MINUTES = (
    ("moves", "ADXL105", ""),
    ("interleaved", "CXL02", "hysteresis"),
    ("fast", "CXL02", "bias_step"),
    ("bursts", "ADXL105", "rail_wave"),
    ("moves", "CXL02", "encoder_backlash"),
)
"""Motion, sensor, and the effect hidden at d = 20."""

DIAGNOSE = """
import json, sys, time
from accelcal import io
from benches.peak import megabytes
from accelcal.estimation.estimate import estimate
from accelcal.verbs import diagnose
from accelcal.model import Model
recording = io.load(sys.argv[1])
warm = estimate(Model.linear(), recording, end=float(sys.argv[2]), method=sys.argv[4])
seconds = []
for _ in range(int(sys.argv[3])):
    recording.accel.y[0] += 1e-9  # other content: nothing of it was examined before
    begin = time.process_time()
    found = diagnose(warm, recording)
    seconds.append(time.process_time() - begin)
print(json.dumps({
    "samples": len(recording.accel),
    "seconds": min(seconds),
    "megabytes": megabytes(),
    "examined": found.scan.examined,
    "effects": found.effects,
    "verdict": found.verdict,
}))
"""


def cost(path: Path, fitted: float, repeats: int, method: str = "auto") -> dict[str, float]:
    """Diagnose a file in a process of its own, with a model that was fitted to its first seconds."""
    run = [sys.executable, "-c", DIAGNOSE, str(path), str(fitted), str(repeats), method]
    done = subprocess.run(run, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def nonlinear_record(samples: int) -> Recording:
    """The record of `benches.fit` with a small second-order nonlinearity of the output."""
    recording = record(samples)
    recording.accel.y[:] += QUADRATIC * recording.accel.y**2
    return recording


def print_cost(name: str, cost: dict[str, float]) -> None:
    """Print one line."""
    print(
        f"{name:34s} {cost['samples']:9.0f} samples, {cost['examined']} candidates: {cost['seconds']:.2f} s processor "
        f"time, peak {cost['megabytes']:.0f} MB; {cost['verdict']} {cost['effects']}",
        flush=True,
    )


def by_the_weak_form() -> bool:
    """Ten minutes and one hour with all candidates; whether time is linear and memory bounded."""
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for name, samples in (("10 minutes", 1_000_200), ("1 hour", 6_001_200)):
            path = Path(folder, f"{samples}.parquet")
            write_sample(nonlinear_record(samples), path)
            results.append(cost(path, 60.0, 1, "weak"))
            print_cost(f"{name} by the weak form", results[-1])
    ten, hour = results
    ratio = hour["seconds"] / ten["seconds"] / (hour["samples"] / ten["samples"])
    return held(
        ("time per sample, an hour over ten minutes", ratio, LINEAR),
        ("an hour, s", hour["seconds"], SECONDS_FOR_AN_HOUR),
        ("peak memory for an hour, MB", hour["megabytes"], MEGABYTES_FOR_AN_HOUR),
    )


def held(*checks: tuple[str, float, float]) -> bool:
    """Print figures and limits; whether all hold."""
    for what, value, limit in checks:
        print(f"{what}: {value:.2f}, limit {limit:g}: {'ok' if value <= limit else 'MISSED'}")
    return all(value <= limit for _, value, limit in checks)


def main() -> int:
    """Five minutes from the worlds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weak", action="store_true", help="ten minutes and an hour by the weak form instead")
    if parser.parse_args().weak:
        return 0 if by_the_weak_form() else 1
    minutes = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (motion, sensor, hidden) in enumerate(MINUTES):
            world = World(motion, sensor, seed=2007 + number)
            if hidden:
                world = at_d(World(motion, sensor, (Hidden(hidden, 1e-3),), seed=2007 + number), 20.0)
            path = world.record().write(Path(folder, str(number)))
            minutes.append(cost(path, 20.0, REPEATS))
            print_cost(f"60 s of {motion}, {hidden or 'nothing hidden'}", minutes[-1])
    slowest = max(minute["seconds"] for minute in minutes)
    return 0 if held(("diagnosis of a minute, the slowest, s", slowest, SECONDS_FOR_A_MINUTE)) else 1


if __name__ == "__main__":
    raise SystemExit(main())
