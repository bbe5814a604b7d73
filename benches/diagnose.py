"""What a diagnosis costs: processor time for unseen minutes, time and memory for an hour.

Run from the top of the repository: python -m benches.diagnose
The minutes come from the independent worlds, with and without a hidden effect; the hour is four tones with a
second-order nonlinearity. Each is diagnosed in a fresh process. Prints figure and threshold; exit
code 1 when one is missed.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from benches.fit import record, write_sample
from tests.worlds import Hidden, World, at_d

from accelcal.data.recording import Recording

SECONDS_FOR_A_MINUTE = 1.0
"""Processor time, imports warm: all that `diagnose` does to a record it has not seen."""
SECONDS_FOR_AN_HOUR = 60.0
MEGABYTES_FOR_AN_HOUR = 1500.0
REPEATS = 3
"""Diagnoses of a minute, of which the fastest counts: what else runs on the machine only adds."""
QUADRATIC = 1e-4
"""Second-order nonlinearity of the output of the hour, (m/s²)⁻¹."""
MINUTES = (
    ("moves", "ADXL105", ""),
    ("interleaved", "CXL02", "hysteresis"),
    ("fast", "CXL02", "bias_step"),
    ("bursts", "ADXL105", "rail_wave"),
    ("moves", "CXL02", "encoder_backlash"),
)
"""Motion, sensor, and what is hidden at d = 20."""

DIAGNOSE = """
import json, sys, time
from accelcal import io
from benches.peak import megabytes
from accelcal.estimation.estimate import fit
from accelcal.workflow import diagnose
from accelcal.model import Model
recording = io.load(sys.argv[1])
warm = fit(Model.linear(), recording, end=float(sys.argv[2]))
seconds = []
for _ in range(int(sys.argv[3])):
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


def cost(path: Path, fitted: float, repeats: int) -> dict[str, float]:
    """Diagnose a file in a process of its own, with a model that was fitted to its first seconds."""
    run = [sys.executable, "-c", DIAGNOSE, str(path), str(fitted), str(repeats)]
    done = subprocess.run(run, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def bent(samples: int) -> Recording:
    """The record of `benches.fit` with an output that is a little nonlinear."""
    made = record(samples)
    made.accel.y[:] += QUADRATIC * made.accel.y**2
    return made


def told(name: str, one: dict[str, float]) -> None:
    """One line."""
    print(
        f"{name:34s} {one['samples']:9.0f} samples, {one['examined']} candidates: {one['seconds']:.2f} s processor "
        f"time, peak {one['megabytes']:.0f} MB; {one['verdict']} {one['effects']}",
        flush=True,
    )


def main() -> int:
    """Five minutes from the worlds and one hour."""
    minutes = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (motion, sensor, hidden) in enumerate(MINUTES):
            world = World(motion, sensor, seed=2007 + number)
            if hidden:
                world = at_d(World(motion, sensor, (Hidden(hidden, 1e-3),), seed=2007 + number), 20.0)
            path = world.record().write(Path(folder, str(number)))
            minutes.append(cost(path, 20.0, REPEATS))
            told(f"60 s of {motion}, {hidden or 'nothing hidden'}", minutes[-1])
        path = Path(folder, "hour.parquet")
        write_sample(bent(6_001_200), path)
        hour = cost(path, 60.0, 1)
        told("1 hour of tones, quadratic", hour)
    checks = [
        ("diagnosis of a minute, the slowest, s", max(one["seconds"] for one in minutes), SECONDS_FOR_A_MINUTE),
        ("diagnosis of an hour, s", hour["seconds"], SECONDS_FOR_AN_HOUR),
        ("peak memory for an hour, MB", hour["megabytes"], MEGABYTES_FOR_AN_HOUR),
    ]
    for what, value, limit in checks:
        print(f"{what}: {value:.2f}, limit {limit:g}: {'ok' if value <= limit else 'MISSED'}")
    return 0 if all(value <= limit for _, value, limit in checks) else 1


if __name__ == "__main__":
    raise SystemExit(main())
