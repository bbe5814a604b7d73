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
DATED = ("created", "date")
"""Keys that hold the time at which a file was made."""
ORDERED = ("run.csv", "other.csv", "curved.csv")


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
    made = folder / "made.json"
    content = made.read_bytes()
    made.unlink()
    return content, done.stdout


@pytest.mark.parametrize("name", COMMANDS if LONG else ("joint fit", "diagnose"))
def test_threads_hash_seeds_and_processes_give_the_same_bytes(inputs: Path, name: str) -> None:
    found = [outputs(inputs, COMMANDS[name], *setting) for setting in SETTINGS]
    print(f"{name}: {len(found)} processes, {len(set(found))} different answers (expected 1)")
    assert len(set(found)) == 1


@pytest.mark.parametrize("name", ["fit"])
def test_another_recording_gives_other_bytes(inputs: Path, name: str) -> None:
    words = [word.replace("run.csv", "other.csv") for word in COMMANDS[name]]
    assert outputs(inputs, COMMANDS[name])[0] != outputs(inputs, words)[0]
