"""A fleet of recordings of 60 s: time per recording over that of a single fit, memory, bytes on any number of workers.

python -m benches.fleet --count 1000
python -m benches.fleet --types 100 : instead, sensors fitted with the prior of a type; how many are told to be of
another, of those that are of it and of those whose scale factor is `AWAY` deviations of estimate and type from it.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path

import numpy as np

import accelcal as ac
from accelcal.cli import write_recording
from accelcal.fleet import campaign
from accelcal.fleet.summary import fit_of, summarise
from accelcal.simulation import CXL02_RIG

DIFFERENT = 20
"""Recordings that are simulated; the others are links to them under names of their own."""
SENSORS = 50
LIMIT = 1.2
AWAY = 6.0
TYPE = ac.Prior(0.012, 1e-4)
"""Scale factor of a type."""


def recordings_of(folder: Path, count: int) -> list[str]:
    """Recordings of many sensors."""
    rng, sources = np.random.default_rng(16), []
    for k in range(min(DIFFERENT, count)):
        truth = {"bias": 0.05 + 0.01 * rng.standard_normal(), "scale_factor": 0.01}
        recording = ac.simulate("tones", seconds=60.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording
        path = folder / f"source{k}.parquet"
        write_recording(replace(recording, name=path.name), path)
        sources.append(path)
    files = []
    for k in range(count):
        sensor = folder / f"s{k % SENSORS}"
        sensor.mkdir(exist_ok=True)
        path, source = sensor / f"r{k:05}.parquet", sources[k % len(sources)]
        os.link(source, path)
        os.link(source.with_suffix(".toml"), path.with_suffix(".toml"))
        files.append(str(path))
    return files


def of_another_type(k: float, seed: int) -> bool:
    """Whether a sensor with this scale factor is told to be none of the type, after 12 s on a stage."""
    truth = {"bias": 0.05, "scale_factor": k}
    recording = ac.simulate(
        "interleaved", seconds=12.0, rig=CXL02_RIG, parameters=truth, rng=np.random.default_rng(seed)
    ).recording
    fit = ac.fit(recording, ac.Model.linear().with_priors({"scale_factor": TYPE}))
    return any(note.code == "not_of_type" for note in fit.remarks)


def types(count: int) -> int:
    """Sensors of the type and of none, `count` each; print how many are told to be of another."""
    rng = np.random.default_rng(62)
    plain = ac.simulate("interleaved", seconds=12.0, rig=CXL02_RIG, parameters={}, rng=rng).recording
    alone = ac.fit(plain)["scale_factor"].std
    spread = float(np.hypot(alone, TYPE.std))
    of_it = sum(of_another_type(TYPE.mean + TYPE.std * rng.standard_normal(), n) for n in range(count))
    others = [rng.choice((-AWAY, AWAY)) * spread for _ in range(count)]
    noticed = sum(of_another_type(TYPE.mean + away, count + n) for n, away in enumerate(others))
    print(f"of another type: {noticed} of {count} that are (95 %), {of_it} of {count} that are not (1 %)")
    return 0 if noticed >= 0.95 * count and of_it <= max(3, 0.03 * count) else 1


def peak() -> float:
    """Largest resident memory so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> None:
    """Print figures beside their bars."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--count", type=int, default=1000)
    asked.add_argument("--types", type=int, default=0, help="sensors of a type, and as many of none")
    given = asked.parse_args()
    if given.types:
        raise SystemExit(types(given.types))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = recordings_of(folder, given.count)
        fit_of(Path(files[0]))
        start = time.process_time()
        for path in files[:DIFFERENT]:
            fit_of(Path(path))
        single = (time.process_time() - start) / min(DIFFERENT, given.count)
        before, start = peak(), time.process_time()
        serial = campaign.run(fit_of, files, store=folder / "a.sqlite", batch=1, executor=OneThread())
        item = (time.process_time() - start) / given.count
        result = summarise(campaign.load(folder / "a.sqlite"))
        ratio = f"{item:.3f} s each, single fit {single:.3f} s: {item / single:.3f} ({LIMIT})"
        print(f"{serial.computed} recordings: {ratio}")
        print(f"peak memory {before:.0f} MB after {DIFFERENT} fits, {peak():.0f} MB after {given.count}")
        few = min(given.count, SENSORS)
        half = folder / "half.sqlite"
        campaign.run(fit_of, files[: few // 2], store=half, batch=1, executor=OneThread())
        again = campaign.run(fit_of, files[:few], store=half, batch=1)
        print(f"resumed after {few // 2}: {again.computed} computed, {again.stored} kept")
        texts = []
        for workers in (1, 2):
            command = [sys.executable, "-m", "accelcal", "fleet", *sorted({str(Path(f).parent) for f in files})[:4]]
            store = ["--store", str(folder / f"w{workers}.sqlite"), "--workers", str(workers), "--json"]
            texts.append(subprocess.run([*command, *store], capture_output=True, text=True, check=True).stdout)
        same = len(set(texts)) == 1
        size = len(result.to_json())
        print(f"same bytes on 1 and 2 workers: {same}; summary of {given.count} runs: {size} bytes")


class OneThread(Executor):
    """Runs at once in the caller, so that processor time is that of one run after the other."""

    def submit(self, function, /, *arguments, **options):  # type: ignore[no-untyped-def]
        """Compute now."""
        future: Future = Future()
        future.set_result(function(*arguments, **options))
        return future


if __name__ == "__main__":
    main()
