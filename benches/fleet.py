"""A fleet of recordings of 60 s: time per recording over that of a single fit, memory, bytes on any number of workers.

python -m benches.fleet --count 1000
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


def made(folder: Path, count: int) -> list[str]:
    """Recordings of many sensors."""
    rng, sources = np.random.default_rng(16), []
    for k in range(min(DIFFERENT, count)):
        truth = {"bias": 0.05 + 0.01 * rng.standard_normal(), "scale_factor": 0.01}
        one = ac.simulate("tones", seconds=60.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording
        path = folder / f"source{k}.parquet"
        write_recording(replace(one, name=path.name), path)
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


def peak() -> float:
    """Largest resident memory so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> None:
    """Print figures beside their bars."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--count", type=int, default=1000)
    given = asked.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = made(folder, given.count)
        fit_of(Path(files[0]))
        start = time.process_time()
        for path in files[:DIFFERENT]:
            fit_of(Path(path))
        single = (time.process_time() - start) / min(DIFFERENT, given.count)
        before, start = peak(), time.process_time()
        serial = campaign.run(fit_of, files, store=folder / "a.sqlite", batch=1, executor=OneThread())
        each = (time.process_time() - start) / given.count
        found = summarise(campaign.load(folder / "a.sqlite"))
        ratio = f"{each:.3f} s each, single fit {single:.3f} s: {each / single:.3f} ({LIMIT})"
        print(f"{serial.computed} recordings: {ratio}")
        print(f"peak memory {before:.0f} MB after {DIFFERENT} fits, {peak():.0f} MB after {given.count}")
        few = min(given.count, SENSORS)
        half = folder / "half.sqlite"
        campaign.run(fit_of, files[: few // 2], store=half, batch=1, executor=OneThread())
        again = campaign.run(fit_of, files[:few], store=half, batch=1)
        print(f"resumed after {few // 2}: {again.computed} computed, {again.kept} kept")
        texts = []
        for workers in (1, 2):
            command = [sys.executable, "-m", "accelcal", "fleet", *sorted({str(Path(f).parent) for f in files})[:4]]
            store = ["--store", str(folder / f"w{workers}.sqlite"), "--workers", str(workers), "--json"]
            texts.append(subprocess.run([*command, *store], capture_output=True, text=True, check=True).stdout)
        same = len(set(texts)) == 1
        size = len(found.to_json())
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
