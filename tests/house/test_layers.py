"""A folder of the package imports only folders above it in one list; inside a folder files form no cycle."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import accelcal

pytestmark = pytest.mark.always

PACKAGE = Path(accelcal.__file__).parent
TESTS = Path(__file__).parents[1]
CRATES = TESTS.parent / "crates"

LAYERS = (
    "_support",
    "data",
    "io",
    "signals",
    "simulation",
    "effects",
    "model",
    "filters",
    "estimation",
    "validation",
    "diagnosis",
    "calibration",
    "verbs",
    "response",
    "results",
    "live",
    "demo",
    "plots",
    "report",
    "fleet",
    "app",
    "cli",
    "__main__",
)
"""From the ground up. ARCHITECTURE.md says what each holds."""
EVERYWHERE = ("_core", "__version__")
"""The compiled core, and the version that it carries."""


def module_of(path: Path, package: Path = PACKAGE) -> str:
    """Dotted name of a file below the package; of `__init__.py` that of its folder."""
    parts = path.relative_to(package).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imported(path: Path, modules: Mapping[str, object] = MODULES) -> Iterator[str]:
    """Modules of the package that a file imports anywhere: at the top, inside functions, and for types alone."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name.removeprefix("accelcal.") for alias in node.names if alias.name.startswith("accelcal.")]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "accelcal":
            module = (node.module or "").removeprefix("accelcal").removeprefix(".")
            inner = [f"{module}.{alias.name}".removeprefix(".") for alias in node.names]
            names = [name if name in modules else module or name for name in inner]
        else:
            continue
        yield from names


def folder(module: str) -> str:
    """The entry of the list that a module belongs to."""
    return module.partition(".")[0]


def upward(module: str, targets: set[str], layers: tuple[str, ...] = LAYERS) -> list[str]:
    """Imports of a module that lead to its own layer's successors."""
    if not module:
        return []  # the package itself, which binds the public names
    place = layers.index(folder(module))
    layered = [t for t in targets if folder(t) not in EVERYWHERE and folder(t) != folder(module)]
    return sorted(f"{module} -> {t}" for t in layered if folder(t) not in layers or layers.index(folder(t)) > place)


def test_every_file_has_its_layer() -> None:
    assert {folder(m) for m in MODULES if m} <= set(LAYERS)
    assert set(LAYERS) <= {folder(m) for m in MODULES if m}


@pytest.mark.parametrize("layer", LAYERS)
def test_a_folder_imports_only_folders_above_it(layer: str) -> None:
    wrong = [line for m, path in MODULES.items() if folder(m) == layer for line in upward(m, set(imported(path)))]
    assert not wrong, wrong


def cycle(graph: Mapping[str, set[str]]) -> list[str]:
    """Modules that import one another in a ring; empty where there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_files_form_no_cycle() -> None:
    files = {m: {t for t in imported(path) if t in MODULES and t != m} for m, path in MODULES.items() if m}
    # A package's `__init__` binds names of its files, which never import the package itself to use them.
    assert not cycle(files), " -> ".join(cycle(files))


def rust_imports(crate: Path) -> dict[str, set[str]]:
    """Modules of a crate with those that each names by `crate::` or `super::`, tests within a file aside."""
    files = {rust_module(path, crate): path for path in sorted((crate / "src").rglob("*.rs")) if path.stem != "tests"}
    results: dict[str, set[str]] = {}
    for module, path in files.items():
        text = path.read_text(encoding="utf-8").partition("#[cfg(test)]")[0]
        names = [m[1] for m in re.finditer(r"\bcrate::([a-z_]\w*(?:::[a-z_]\w*)*)", text)]
        for group in re.finditer(r"\buse crate::\{([^;]*)\}", text):
            names += [m[1] for m in re.finditer(r"(?:^|[,{])\s*([a-z_]\w*(?:::[a-z_]\w*)*)", group[1])]
        above = module.rpartition("::")[0]
        names += [f"{above}::{m[1]}".removeprefix("::") for m in re.finditer(r"\bsuper::([a-z_]\w*)", text)]
        results[module] = set()
        for name in names:
            parts = name.split("::")
            prefixes = ["::".join(parts[:k]) for k in range(len(parts), 0, -1) if "::".join(parts[:k]) in files]
            results[module] |= set(prefixes[:1]) - {module}
    return results


def rust_module(path: Path, crate: Path) -> str:
    """Path of a module below its crate: `replay/mod.rs` is `replay`."""
    parts = path.relative_to(crate / "src").with_suffix("").parts
    return "::".join(parts[:-1] if parts[-1] == "mod" else parts)


@pytest.mark.parametrize("crate", ["ekf-core", "ekf-simd", "accelcal-py"])
def test_files_of_rust_form_no_cycle(crate: str) -> None:
    graph = rust_imports(CRATES / crate)
    assert sum(map(len, graph.values())) > 5, graph
    assert not cycle(graph), " -> ".join(cycle(graph))


def test_few_files_lie_in_the_root_of_the_package() -> None:
    results = [path.name for path in PACKAGE.iterdir() if path.is_file() and path.suffix != ".so"]
    print(f"{len(results)} files in the root (at most 9): {', '.join(sorted(results))}")
    assert len(results) <= 9


def test_no_module_shares_a_name_with_a_public_function() -> None:
    verbs = {name for name in accelcal.__all__ if callable(getattr(accelcal, name)) and name.islower()}
    wrong = sorted(m for m in MODULES if m.rpartition(".")[2] in verbs and folder(m) != "cli")
    assert not wrong, wrong


def test_the_package_has_no_relative_imports() -> None:
    for path in MODULES.values():
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        assert not [node for node in nodes if isinstance(node, ast.ImportFrom) and node.level], path


def test_only_results_that_show_themselves_reach_a_face_by_name() -> None:
    calling = [path.name for path in MODULES.values() if "import_module" in path.read_text(encoding="utf-8")]
    # A reader of a container is the file that the table of formats names, a campaign's task is the user's own.
    assert sorted(calling) == ["campaign.py", "child.py", "values.py"]


def test_the_reference_shares_no_code_with_what_it_checks() -> None:
    assert not set(imported(TESTS / "twin" / "reference.py")) - {"data.recording"}


def test_the_independent_simulators_import_nothing_of_the_package() -> None:
    worlds = sorted((TESTS / "worlds").rglob("*.py"))
    regimes = [TESTS / "regimes" / f"{name}.py" for name in ("motion", "profiles", "noise", "rig", "regimes", "hidden")]
    assert worlds
    assert not [path for path in (*worlds, *regimes) if any(imported(path))]


def at_once(path: Path) -> Iterator[str]:
    """Modules of the package that a file imports while it is itself imported."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("accelcal."):
            yield (node.module or "").removeprefix("accelcal.")


def test_app_and_live_are_imported_by_nobody_else_as_the_package_loads() -> None:
    others = [m for m in MODULES if folder(m) not in ("app", "live")]
    assert not [m for m in others if {"app", "live"}.intersection(map(folder, at_once(MODULES[m])))]
    assert "live" in map(folder, at_once(MODULES["app.live_page"]))  # the twin


def test_an_upward_import_is_caught(tmp_path: Path) -> None:
    # The sister: the same reading of a file that breaks the rules, also where the import hides in a function.
    path = tmp_path / "units.py"
    path.write_text(
        "def late():\n"
        "    from accelcal.estimation.estimate import estimate\n"
        "    import accelcal.cli\n"
        "    from accelcal import plots\n"
    )
    names = set(imported(path))
    assert names == {"estimation.estimate", "cli", "plots"}
    assert len(upward("data.units", names)) == 3
    assert upward("__main__", names) == []


def test_a_cycle_is_caught() -> None:
    assert not cycle({"a": {"b"}, "b": {"c"}, "c": set()})
    assert set(cycle({"a": {"b"}, "b": {"c"}, "c": {"a"}})) == {"a", "b", "c"}
