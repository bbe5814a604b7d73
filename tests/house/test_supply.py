"""What the package needs: imports and declarations agree, tested versions are listed, licences are brought along."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from importlib.metadata import packages_distributions
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OF_DEVELOPERS = {"docs", "peers", "dev"}
"""Extras of those who build and test; what they bring is imported by tests, benches and pages."""


def declared(requirements: list[str]) -> dict[str, Requirement]:
    """Requirements on other packages by name."""
    found = [Requirement(text) for text in requirements]
    return {canonicalize_name(each.name): each for each in found if each.name != "accelcal"}


def of_users() -> dict[str, Requirement]:
    """What the package and the extras of its users declare."""
    extras = [each for name, each in PROJECT["optional-dependencies"].items() if name not in OF_DEVELOPERS]
    return declared([*PROJECT["dependencies"], *(text for each in extras for text in each)])


def imported(folder: Path) -> set[str]:
    """Distributions whose modules the files of a folder import."""
    modules: set[str] = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                modules |= {each.name.partition(".")[0] for each in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                modules.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "optional":
                modules.add(str(ast.literal_eval(node.args[0])).partition(".")[0])
    known = packages_distributions()
    foreign = modules - set(sys.stdlib_module_names) - {"accelcal"}
    return {canonicalize_name(known[module][0]) for module in foreign}


def test_what_is_imported_is_declared_and_no_more():
    assert imported(ROOT / "python" / "accelcal") == set(of_users())


def test_an_import_that_is_not_declared_is_found(tmp_path):
    (tmp_path / "one.py").write_text("import hypothesis.strategies\nfrom packaging import tags\nimport os\n")
    assert imported(tmp_path) == {"hypothesis", "packaging"}


def test_every_requirement_has_a_lower_bound_and_no_cap():
    for name, each in of_users().items():
        assert [one.operator for one in each.specifier] == [">="], name


def test_the_versions_that_were_tested_are_listed():
    listed = dict(
        line.split("==") for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines() if line
    )
    tested = {canonicalize_name(name): version for name, version in listed.items()}
    for name, each in of_users().items():
        assert name in tested, f"{name} has no tested version: make constraints"
        assert each.specifier.contains(tested[name]), f"{name}: {tested[name]} was tested, {each} is declared"


def test_the_licences_of_all_crates_in_the_wheel_are_there():
    command = [sys.executable, "tools/licences.py"]
    made = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    locked = (ROOT / "Cargo.lock").read_text(encoding="utf-8")
    for name, version in re.findall(r"^([\w-]+) (\d\S+): ", made, flags=re.M):
        assert f'name = "{name}"\nversion = "{version}"' in locked
    assert "numpy 0" in made
    assert "Redistributions in binary form must reproduce" in made
    written = re.search(r"tools/licences.py > (\S+)\n.*maturin build", (ROOT / "Makefile").read_text(encoding="utf-8"))
    assert written
    assert any(fnmatch(written[1], pattern) for pattern in PROJECT["license-files"])
