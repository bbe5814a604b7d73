"""Imports run downwards only, and the command line is up before anything heavy is (DESIGN section 3)."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import accelcal

PACKAGE = Path(accelcal.__file__).parent
TESTS = Path(__file__).parents[1]

FOUNDATION = ("units", "rig", "recording")
LAYERS = (
    ("units", "shown", "blas"),
    ("rig",),
    ("recording",),
    ("checks", "motion", "loudness"),
    ("io", "signals", "simulate", "matched", "consistency", "filters", "overview"),
    ("effects",),
    ("model", "replay"),
    ("noise",),
    ("passes", "adjoint"),
    ("gauss_newton",),
    ("shaping",),
    ("fit",),
    ("predict", "characteristic"),
    ("compare", "recursive", "live", "tracks", "budget", "applied", "recovered"),
    ("store",),
    ("power", "diagnose", "breaks", "channels", "detectable"),
    ("gating", "importance"),
    ("judgement",),
    ("walk",),
    ("loop", "campaign"),
    ("findings", "ladder", "likeness"),
)
"""From the ground up: a module imports from lower layers, or from its own."""
FACES = ("paper", "plots", "report", "app", "notebook", "export", "cli", "demo", "doctor", "__main__")
"""They hold no physics and nothing below imports them."""
ANYWHERE = ("_core", "__init__")
HEAVY = ("scipy.stats", "scipy.special", "scipy.linalg", "matplotlib", "plotly", "pint")


def files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def part_of(path: Path) -> str:
    """The part of the house that a file belongs to: its module, or the folder it lives in."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(path: Path) -> Iterator[str]:
    """Parts of accelcal that a file imports anywhere, also inside functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                continue
            module = node.module or ""
            names = [f"{module}.{alias.name}" for alias in node.names] if module == "accelcal" else [module]
        for name in names:
            first, _, rest = name.partition(".")
            if first == "accelcal" and rest:
                yield rest.partition(".")[0]


def layer(part: str) -> int:
    found = [i for i, parts in enumerate(LAYERS) if part in parts]
    return found[0] if found else len(LAYERS)


def edges() -> list[tuple[str, str]]:
    """Who imports whom, once each."""
    found = {(part_of(path), to) for path in files() for to in imported(path)}
    return sorted((a, b) for a, b in found if a != b and b not in ANYWHERE and b != "__version__")


def test_every_part_has_its_place() -> None:
    known = {part for parts in LAYERS for part in parts} | {*FACES, *ANYWHERE, "reference"}
    parts = {part_of(path) for path in files()}
    assert parts <= known, f"give {sorted(parts - known)} a layer, or call it a face"


def test_imports_run_downwards() -> None:
    wrong = [(a, b) for a, b in edges() if a not in FACES and layer(b) > layer(a)]
    assert not wrong, f"upward imports: {wrong}"


def test_parts_do_not_import_each_other() -> None:
    found = {(a, b) for a, b in edges() if a not in FACES}
    assert not [(a, b) for a, b in found if (b, a) in found]


def test_the_package_has_no_relative_imports() -> None:
    for path in files():
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        assert not [node for node in nodes if isinstance(node, ast.ImportFrom) and node.level], path


def test_io_knows_recordings_and_units_alone() -> None:
    known = {b for a, b in edges() if a == "io"}
    assert known <= {"recording", "units", "rig", "checks"}, known


def test_nothing_imports_a_face() -> None:
    wrong = [(a, b) for a, b in edges() if b in FACES and a not in FACES]
    assert not wrong, wrong


def test_only_results_that_show_themselves_reach_a_face_by_name() -> None:
    calling = [path.name for path in files() if "import_module" in path.read_text(encoding="utf-8")]
    assert sorted(calling) == ["shown.py", "task.py"]  # a campaign's task is the user's own, known by name


def test_the_reference_is_imported_by_tests_alone() -> None:
    assert "reference" not in {b for _, b in edges()}
    assert not set(imported(PACKAGE / "reference.py")) - {"recording"}  # a twin that shares code proves nothing
    assert any("reference" in set(imported(path)) for path in TESTS.rglob("*.py"))


def test_the_independent_simulators_import_nothing_of_the_package() -> None:
    worlds = sorted((TESTS / "worlds").rglob("*.py"))
    assert not [path for path in worlds if any(imported(path))]


def test_an_upward_import_is_caught(tmp_path: Path) -> None:
    # The sister: the same reading of a file that breaks the rules, also where the import hides in a function.
    path = tmp_path / "units.py"
    path.write_text(
        "def late():\n    from accelcal.fit import fit\n    import accelcal.cli\n    from accelcal import plots\n"
    )
    found = list(imported(path))
    assert found == ["fit", "cli", "plots"]
    assert layer("fit") > layer("units")
    assert layer("cli") > layer("loop")


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
