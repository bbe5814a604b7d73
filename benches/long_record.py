"""A long record of Parquet: processor time and peak memory of whole commands, by rows.

python -m benches.long_record --rows 20000000 check fit
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from accelcal.data import Array

RATE = 1000.0
"""Hz"""
TONES = ((2e-3, 1.3, 0.1), (1e-3, 3.1, 1.0), (4e-4, 7.7, 2.0))
"""Amplitude (m), frequency (Hz) and phase of each."""
SWEEP, MIDDLE, HALF, PERIOD = 3e-4, 7.0, 5.0, 400.0
"""Amplitude of a slow sweep (m), its middle frequency and half its range (Hz), the time up and down (s)."""
SIDECAR = """[channels]
time = { column = "t", unit = "s" }
accel = { column = "accel", unit = "m/s^2" }
position = { column = "position", unit = "m" }
"""
PEAK = """import sys
from benches.peak import megabytes
from accelcal.cli import main
sys.argv = ["accelcal", *sys.argv[1:]]
try:
    main()
finally:
    print("peak", megabytes(), file=sys.stderr)
"""


def motion(t: Array) -> tuple[Array, Array]:
    """Position (m) and acceleration (m/s²) at times (n,), s: tones and a sweep."""
    turn = 2.0 * np.pi / PERIOD
    phase = 2.0 * np.pi * (MIDDLE * t - HALF / turn * np.sin(turn * t))
    rate, growth = 2.0 * np.pi * (MIDDLE - HALF * np.cos(turn * t)), 2.0 * np.pi * HALF * turn * np.sin(turn * t)
    p = SWEEP * np.sin(phase)
    a = SWEEP * (growth * np.cos(phase) - rate**2 * np.sin(phase))
    for amplitude, frequency, begin in TONES:
        w = 2.0 * np.pi * frequency
        wave = amplitude * np.sin(w * t + begin)
        p += wave
        a -= w**2 * wave
    return p, a


def write(path: Path, rows: int) -> Path:
    """Write a record of an ordinary sensor, and its sidecar."""
    rng = np.random.default_rng(1)
    t = np.arange(rows) / RATE
    p, a = motion(t)
    accel, position = 0.05 + 1.002 * a + 2e-3 * rng.standard_normal(rows), p + 1e-6 * rng.standard_normal(rows)
    pq.write_table(pa.table({"t": t, "accel": accel, "position": position}), path)
    path.with_suffix(".toml").write_text(SIDECAR)
    return path


def peak_of(verb: str, path: Path) -> float:
    """Peak memory of a command on a record, MB."""
    output = ["-o", str(path.with_suffix(".json")), "--force"] if verb == "fit" else []
    command = [sys.executable, "-c", PEAK, verb, str(path), *output]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(done.stderr.rsplit("peak", 1)[1])


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("verbs", nargs="+")
    parser.add_argument("--rows", type=int, default=20_000_000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder) / "long.parquet", given.rows)
        for verb in given.verbs:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            peak = peak_of(verb, path)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            print(f"{verb}, {given.rows} rows: {spent:.0f} s of processor time, peak {peak:.0f} MB")


if __name__ == "__main__":
    main()
