"""What a fit of 400 000 samples costs, in a fresh process; a minute and an hour are in tools/bench_against.sh.

Run from the top of the repository: python -m benches.fit
Prints figure and threshold; exit code 1 when it is missed.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from accelcal.data.recording import Channel, Recording
from accelcal.io import write_parquet, write_sidecar
from accelcal.simulation.motion import PAPER_TONES
from accelcal.simulation.sensor import ADXL105_RIG

TAU = ADXL105_RIG.lowpass.tau if ADXL105_RIG.lowpass else 0.0
RATE = 1667.0
"""Hz; the encoder is read at every second sample."""
SECONDS_FOR_400_000 = 2.6
"""Processor time, s: "about 2 s", and a third on top for a busy machine."""

FIT = """
import json, sys, time
from accelcal import io
from benches.peak import megabytes
from accelcal.estimation.estimate import estimate
from accelcal.model import Model
recording = io.load(sys.argv[1])
loaded = time.process_time()
found = estimate(Model.linear(), recording)
print(json.dumps({
    "samples": len(recording.accel),
    "load_s": loaded,
    "fit_s": time.process_time() - loaded,
    "megabytes": megabytes(),
    "scale": found.values().scale,
    "std": found["scale_factor"].std,
}))
"""


def record(samples: int) -> Recording:
    """Four tones of 0.5 m/s² each, the paper's sensor with its noise behind its low-pass, an encoder of 1 um."""
    rng = np.random.default_rng(2007)
    t = np.arange(samples) / RATE
    a, p = np.zeros(samples), np.zeros(samples // 2)
    for f in PAPER_TONES:
        w = 2.0 * np.pi * f
        a += 0.5 * np.sin(w * t - np.arctan(w * TAU)) / np.hypot(1.0, w * TAU)
        p -= 0.5 / w**2 * np.sin(w * t[: 2 * len(p) : 2])
    a *= 1.01
    a += 0.05
    density, decay = ADXL105_RIG.sensor.noise or 0.0, np.exp(-1.0 / (RATE * TAU))
    size, state = density * np.sqrt(0.25 / TAU * (1.0 - decay**2)), np.zeros(1)
    for begin in range(0, samples, 500_000):
        part = a[begin : begin + 500_000]
        noise, state = lfilter([size], [1.0, -decay], rng.standard_normal(len(part)), zi=state)
        part += noise
    p = 1e-6 * np.round((p + 1e-6 * rng.standard_normal(len(p))) / 1e-6)
    return Recording(
        accel=Channel("accel", t, a, "m/s^2"),
        position=Channel("position", t[: 2 * len(p) : 2], p, "m"),
        rig=ADXL105_RIG,
    )


def cost(path: Path) -> dict[str, float]:
    """Fit a file in a process of its own."""
    run = [sys.executable, "-c", FIT, str(path)]
    done = subprocess.run(run, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def main() -> int:
    """One size, one threshold."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "run.parquet")
        write_sample(record(400_000), path)
        run = cost(path)
    print(
        f"load {run['load_s']:.2f} s, peak {run['megabytes']:.0f} MB; 1 + k = {run['scale']:.5f} +- {run['std']:.1g}\n"
        f"fit of {run['samples']} samples, s: {run['fit_s']:.2f}, limit {SECONDS_FOR_400_000:g}: "
        f"{'ok' if run['fit_s'] <= SECONDS_FOR_400_000 else 'MISSED'}"
    )
    return 0 if run["fit_s"] <= SECONDS_FOR_400_000 else 1


def write_sample(recording: Recording, path: Path) -> None:
    """The recording and its sidecar."""
    sources = write_parquet(recording, path)
    write_sidecar(recording.rig, sources, path.with_suffix(".toml"))


if __name__ == "__main__":
    raise SystemExit(main())
