"""The command line is up before anything heavy is."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = (
    "numpy",
    "concurrent.futures.process",
    "scipy.stats",
    "scipy.special",
    "scipy.linalg",
    "matplotlib",
    "plotly",
    "pint",
    "pydantic",
)


def loaded_by(*command: str) -> set[str]:
    """Modules that a fresh interpreter has loaded when a command ends."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", *command], capture_output=True, text=True, check=True, timeout=120
    )
    return {line.rpartition("|")[2].strip() for line in done.stderr.splitlines() if line.startswith("import time:")}


def test_help_loads_nothing_heavy() -> None:
    loaded = loaded_by("-m", "accelcal", "--help")
    assert "typer" in loaded  # the help did run
    assert not loaded.intersection(HEAVY), loaded.intersection(HEAVY)


@pytest.mark.parametrize("module", HEAVY)
def test_a_heavy_module_is_seen_when_it_is_loaded(module: str) -> None:
    try:
        loaded = loaded_by("-c", f"import {module}")
    except subprocess.CalledProcessError:
        loaded = loaded_by("-c", f"import sys; sys.modules[{module!r}] = sys")  # not installed: nothing can load it
        assert module not in loaded
        return
    assert module in loaded
