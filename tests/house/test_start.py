"""The command line is up before anything heavy is."""

from __future__ import annotations

import gc
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from accelcal import cli

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


LIGHT = """import sys
HEAVY = {heavy}
from typer.testing import CliRunner
from accelcal.cli import app
for line in sys.stdin.read().splitlines():
    done = CliRunner().invoke(app, line.split())
    assert done.exit_code == 0, (line, done.output)
print(*sorted(HEAVY.intersection(sys.modules)))
"""
COMMANDS = """simulate --seconds 8 --seed 1 -o a.csv
simulate --seconds 8 --seed 2 -o b.parquet
check a.csv
fit a.csv -o m.json
diagnose m.json a.csv
add m.json a.csv --effect quadratic -o m2.json
compare m.json m2.json b.parquet
improve a.csv
"""


LIBRARIES = {"pint", "pandas", "dask", "xarray", "pyarrow.compute", "scipy.ndimage", "scipy.signal", "scipy.stats"}
CHECK = "check a.csv\n"


def test_ordinary_files_need_no_heavy_library(tmp_path: Path) -> None:
    def loaded(code: str, commands: str = COMMANDS, heavy: set[str] = LIBRARIES) -> str:
        code = code.replace("{heavy}", repr(heavy))
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, input=commands, capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    assert loaded(LIGHT) == ""
    assert loaded(LIGHT, CHECK, {"scipy.special", "scipy.linalg", "accelcal.verbs", "accelcal.estimation.noise"}) == ""
    assert loaded(LIGHT, "fit a.csv -o m.json\n", {"accelcal.simulation", "accelcal.diagnosis.experiment"}) == ""
    assert "pint" in loaded(
        "import pint\n" + LIGHT.replace("read().splitlines()", "read().splitlines()[:0]")
    )  # the twin


def test_only_the_command_that_is_asked_for_is_built(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: list[int] = []
    monkeypatch.setattr(typer.Typer, "__call__", lambda self: counts.append(len(self.registered_commands)))
    monkeypatch.setattr(gc, "set_threshold", lambda *_: None)
    monkeypatch.setenv("PYTHONWARNINGS", "")

    def built(*words: str) -> int:
        monkeypatch.setattr(sys, "argv", ["accelcal", *words])
        cli._command_line()
        return counts[-1]

    assert built("check", "a.csv") == built("app") == 1
    assert built("--help") == built("chek") == len(cli.app.registered_commands) > 20
