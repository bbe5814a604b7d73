"""The same recordings give the same bytes: whatever the threads, the hash seed or the process, in whatever order."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from .case import LONG
from .writers import make_inputs

COMMANDS = {
    "fit": ("fit", "run.csv", "-o", "made.json"),
    "joint fit": ("fit", "run.csv", "other.csv", "-o", "made.json"),
    "add": ("add", "m.json", "run.csv", "--effect", "hysteresis", "-o", "made.json"),
    "diagnose": ("diagnose", "m.json", "run.csv", "-o", "made.json"),
}
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")
SETTINGS = (("1", "0"), ("2", "1"), ("4", "4242")) if LONG else (("1", "0"), ("4", "4242"))
"""Threads and hash seed of each process."""
ORDERED = ("run.csv", "other.csv", "sensors/a/r1.csv")
APART = 1e-9
"""Most change of an estimate with the order of its recordings, in sigma: sums are rounded in another order."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    make_inputs(folder)
    return folder


def outputs(folder: Path, words: Sequence[str], threads: str = "1", seed: str = "0") -> tuple[bytes, bytes]:
    """The file that a command makes, and what it prints."""
    settings = dict.fromkeys(THREADS, threads) | {"PYTHONHASHSEED": seed}
    done = subprocess.run(
        [sys.executable, "-m", "accelcal", *words],
        cwd=folder,
        capture_output=True,
        env={**os.environ, **settings},
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()
    model = folder / "made.json"
    content = model.read_bytes()
    model.unlink()
    return content, done.stdout


@pytest.mark.parametrize("name", COMMANDS if LONG else ("add", "diagnose"))
def test_threads_hash_seeds_and_processes_give_the_same_bytes(inputs: Path, name: str) -> None:
    results = [outputs(inputs, COMMANDS[name], *setting) for setting in SETTINGS]
    print(f"{name}: {len(results)} processes, {len(set(results))} different answers (expected 1)")
    assert len(set(results)) == 1


def test_another_recording_gives_other_bytes(inputs: Path) -> None:
    words = [word.replace("run.csv", "other.csv") for word in COMMANDS["fit"]]
    assert outputs(inputs, COMMANDS["fit"])[0] != outputs(inputs, words)[0]


def estimates(content: bytes) -> dict[tuple[str, str], tuple[float, float]]:
    """Value and standard deviation of each parameter, by its name and the recording that it belongs to."""
    answer = json.loads(content)
    files = [run["name"] for run in answer["runs"]]
    return {
        (p["name"], "" if p["run"] is None else files[p["run"]]): (p["value"], p["std"]) for p in answer["estimates"]
    }


def test_the_order_of_recordings_changes_no_estimate(inputs: Path) -> None:
    orders = list(itertools.permutations(ORDERED)) if LONG else [ORDERED, ORDERED[::-1]]
    first, *others = (estimates(outputs(inputs, ("fit", *order, "-o", "made.json"))[0]) for order in orders)
    assert len(first) == 5
    worst = 0.0
    for other in others:
        assert other.keys() == first.keys()
        for key, (value, std) in first.items():
            worst = max(worst, abs(other[key][0] - value) / std, abs(other[key][1] / std - 1.0))
    print(f"{len(orders)} orders of recordings: apart by {worst:.1e} sigma (threshold {APART:.0e})")
    assert worst < APART
