"""What the package needs: imports and declarations agree, tested versions are listed, licences are brought along."""

from __future__ import annotations

import ast
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OF_DEVELOPERS = {"docs", "peers", "dev"}
"""Extras of those who build and test; what they bring is imported by tests, benches and pages."""


def declared(requirements: list[str]) -> dict[str, Requirement]:
    """Requirements on other packages by name."""
    results = [Requirement(text) for text in requirements]
    return {canonicalize_name(item.name): item for item in results if item.name != "accelcal"}


def of_users() -> dict[str, Requirement]:
    """What the package and the extras of its users declare."""
    extras = [extra for name, extra in PROJECT["optional-dependencies"].items() if name not in OF_DEVELOPERS]
    return declared([*PROJECT["dependencies"], *(text for extra in extras for text in extra)])


def imported(folder: Path) -> set[str]:
    """Distributions whose modules the files of a folder import."""
    modules: set[str] = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                modules |= {name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                modules.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "optional":
                modules.add(str(ast.literal_eval(node.args[0])).partition(".")[0])
    distributions = packages_distributions()
    foreign = modules - set(sys.stdlib_module_names) - {"accelcal"}
    return {canonicalize_name(distributions[module][0]) for module in foreign}


def test_what_is_imported_is_declared_and_no_more():
    assert imported(ROOT / "python" / "accelcal") == set(of_users())


def test_an_import_that_is_not_declared_is_found(tmp_path):
    (tmp_path / "one.py").write_text("import hypothesis.strategies\nfrom packaging import tags\nimport os\n")
    assert imported(tmp_path) == {"hypothesis", "packaging"}


def test_every_requirement_has_a_lower_bound_and_no_cap():
    for name, item in of_users().items():
        assert [part.operator for part in item.specifier] == [">="], name


def argued(page: str) -> set[str]:
    """Names in the first column of the table of dependencies."""
    table = page.partition("## Dependencies")[2]
    cells = re.findall(r"^\| ([^|]+) \| [^|]+ \| [^|]+ \| [^|]+ \|$", table, flags=re.MULTILINE)
    names = {name for cell in cells for name in re.sub(r"\([^)]*\)", "", cell).split(",")}
    return {canonicalize_name(name.strip()) for name in names} - {"dependency", "---"}


def test_every_dependency_is_argued_on_the_page_of_decisions():
    extras = PROJECT["optional-dependencies"].values()
    python = declared([*PROJECT["dependencies"], *(text for manifest in extras for text in manifest)])
    manifests = [tomllib.loads(path.read_text(encoding="utf-8")) for path in ROOT.glob("crates/**/Cargo.toml")]
    tables = [manifest.get(name, {}) for manifest in manifests for name in ("dependencies", "dev-dependencies")]
    crates = {name for table in tables for name in table if not name.startswith("ekf-")}
    page = (ROOT / "docs" / "decisions.md").read_text(encoding="utf-8")
    print(f"{len(python)} Python packages, {len(crates)} crates")
    assert argued(page) == set(python) | crates
    assert argued("## Dependencies\n| one, Two (`x`) | a | b | c |\n") == {"one", "two"}


def test_the_versions_that_were_tested_are_listed():
    listed = dict(
        line.split("==") for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines() if line
    )
    tested = {canonicalize_name(name): version for name, version in listed.items()}
    for name, item in of_users().items():
        assert name in tested, f"{name} has no tested version: make constraints"
        assert item.specifier.contains(tested[name]), f"{name}: {tested[name]} was tested, {item} is declared"


def test_the_licences_of_all_crates_in_the_wheel_are_there():
    command = [sys.executable, "tools/licences.py"]
    stdout = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    locked = (ROOT / "Cargo.lock").read_text(encoding="utf-8")
    for name, version in re.findall(r"^([\w-]+) (\d\S+): ", stdout, flags=re.M):
        assert f'name = "{name}"\nversion = "{version}"' in locked
    assert "numpy 0" in stdout
    assert "Redistributions in binary form must reproduce" in stdout
    written = re.search(r"tools/licences.py > (\S+)\n.*maturin build", (ROOT / "Makefile").read_text(encoding="utf-8"))
    assert written
    assert any(fnmatch(written[1], pattern) for pattern in PROJECT["license-files"])


RELEASE = runpy.run_path(str(ROOT / "tools" / "release_check.py"))


def test_versions_agree_and_the_changelog_is_short():
    print(RELEASE["versions"](), RELEASE["changelog"](), sep="; ")


@pytest.mark.parametrize(
    ("item", "file", "before", "after", "sentence"),
    [
        ("versions", "Cargo.toml", 'version = "0.1.0"', 'version = "0.2.0"', "pyproject|CHANGELOG.md has 0.1.0"),
        (
            "versions",
            "Cargo.lock",
            'ekf-core"\nversion = "0.1.0"',
            'ekf-core"\nversion = "0.0.9"',
            "ekf-core in .* 0.0.9",
        ),
        ("versions", "CHANGELOG.md", "## 0.1.0", "## 0.2.0\n\n## 0.1.0", "CHANGELOG.md has 0.2.0"),
        ("changelog", "CHANGELOG.md", "## 0.1.0", "## 0.1.0" + "\n" * 60, "lines, at most 60"),
        ("changelog", "CHANGELOG.md", "## 0.1.0", "## 0.1.0 (unreleased)", "says that it is not released"),
    ],
)
def test_a_release_that_does_not_fit_together_is_refused(item, file, before, after, sentence, tmp_path):
    for name in ("Cargo.toml", "Cargo.lock", "pyproject.toml", "CHANGELOG.md"):
        shutil.copy(ROOT / name, tmp_path)
    text = (tmp_path / file).read_text(encoding="utf-8")
    assert before in text
    (tmp_path / file).write_text(text.replace(before, after), encoding="utf-8")
    with pytest.raises(RELEASE["NotHeld"], match=sentence):
        RELEASE[item](tmp_path)


def test_a_release_page_has_a_line_an_item_and_fails_with_one(monkeypatch, capsys):
    items = {"short": lambda: "3 lines", "long": lambda: RELEASE["require"](False, "99 lines")}
    monkeypatch.setitem(RELEASE["main"].__globals__, "ITEMS", items)
    assert RELEASE["main"](["short"]) == 0
    assert RELEASE["main"]([]) == 1
    assert "NOT HELD  long        99 lines\n1 of 2 items held, 1 not, 0 open" in capsys.readouterr().out
    assert RELEASE["main"](["absent"]) == 2


def test_a_licence_is_allowed_where_one_choice_is_permissive():
    assert [
        RELEASE["allowed"](terms) for terms in ("MIT OR GPL-3.0", "MIT/Apache-2.0", "MIT AND GPL-3.0", "MPL-2.0")
    ] == [*(True, True, False, False)]
