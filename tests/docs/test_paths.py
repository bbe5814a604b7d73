"""Paths, tests and layers that the documents name exist."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from tests.house.test_layers import LAYERS

from .pages import DOCS

ROOT = DOCS.parent
PAGES = ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "docs/decisions.md", "docs/method.md", "docs/measured.md")
BASES = ("", "python", "python/accelcal", "tests", "docs", "crates", "crates/ekf-core/src", "crates/ekf-simd/src")
"""Folders that paths on these pages are relative to."""
PATH = re.compile(
    r"(?<![\w./<-])((?:[\w-]+/)+(?:[\w-]+\.(?:py|rs|md|toml|txt|sh|png|c|ipynb))?|[\w-]+/[\w/-]+)(?![\w/*<{])"
)
"""A path with at least one folder in it."""
TEST = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")


def quoted(text: str) -> Iterator[str]:
    """Code spans, fenced text and targets of links."""
    fences = re.findall(r"^```text\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    without = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    yield from fences
    yield from re.findall(r"`([^`\n]+)`", without)
    yield from re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", without)


def paths(text: str) -> set[str]:
    """Paths that a page names, in code or in a link."""
    found = {p for part in quoted(text) for p in PATH.findall(part.partition("::")[0])}
    return {
        p for p in found if re.search(r"\.(py|rs|md|toml|txt|sh|png|c|ipynb)$|^(tests|docs|crates|python|benches)/", p)
    }


def absent(text: str) -> list[str]:
    """Paths that are not there."""
    return sorted(p for p in paths(text) if not any((ROOT / base / p).exists() for base in BASES))


@pytest.mark.parametrize("page", PAGES)
def test_every_path_on_a_page_exists(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    assert paths(text)
    assert not absent(text)


def files_by_folder(text: str) -> Iterator[tuple[str, str]]:
    """Folder and file of each row of the maps in ARCHITECTURE.md."""
    base = ""
    for line in text.splitlines():
        head = re.match(r"\| folder(?: of `([^`]+)`)?", line)
        if head:
            base = head[1] or "python/accelcal"
        row = re.match(r"\| `([\w./]+)` \| (.+) \|$", line)
        if row and base and not row[1].endswith((".py", ".rs")):
            yield from ((f"{base}/{row[1]}", name) for name in re.findall(r"`([\w]+\.(?:py|rs))`", row[2]))


def test_the_maps_name_files_that_exist_and_leave_none_out():
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    named = set(files_by_folder(text))
    assert len(named) > 100
    assert not sorted(f"{folder}/{name}" for folder, name in named if not (ROOT / folder / name).is_file())
    # One kind of figure, of physics, of screen, of statement a file: these folders are described, not listed.
    described = {
        "effects",
        "plots",
        "paper",
        "app",
        "app/screens",
        "calibration/export",
    }
    package = ROOT / "python" / "accelcal"
    for path in package.rglob("*.py"):
        folder = path.parent.relative_to(package).as_posix()
        if folder not in (".", *described) and not path.stem.startswith("__"):
            assert (f"python/accelcal/{folder}", path.name) in named, path


def test_the_layers_are_those_of_the_test():
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    (listed,) = re.findall(r"^```text\n(_support.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    assert tuple(listed.split()) == LAYERS


def missing_tests(text: str) -> list[str]:
    """Tests named as `file::function` that do not exist."""
    wrong = []
    for file, function in TEST.findall(text):
        path = ROOT / file
        tree = ast.parse(path.read_text(encoding="utf-8")) if path.is_file() else ast.Module([], [])
        if function not in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}:
            wrong.append(f"{file}::{function}")
    return wrong


def test_recipes_name_tests_that_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert not missing_tests(text)
    recipes = re.split(r"^### ", text.partition("## Recipes")[2].partition("\n## ")[0], flags=re.MULTILINE)[1:]
    assert len(recipes) >= 8
    for recipe in recipes:
        assert re.search(r"`tests/|`make |`benches/", recipe), f"no test is named: {recipe.splitlines()[0]}"


def test_every_question_is_answered_by_a_path():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Where is it")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (.+\?) \| (.+) \|$", text, flags=re.MULTILINE)
    assert len(rows) >= 10
    for question, answer in rows:
        assert paths(answer), question


FOLDERS = {path.parent for path in (ROOT / "python" / "accelcal").rglob("*.py")} - {ROOT / "python" / "accelcal"}
MOST_UNDESCRIBED = 6
"""Files that a folder of the package may hold without a README."""


@pytest.mark.parametrize("folder", sorted(FOLDERS), ids=lambda path: path.name)
def test_a_large_folder_has_a_readme_whose_files_exist(folder):
    readme = folder / "README.md"
    files = [path for path in folder.glob("*.py") if not path.name.startswith("__")]
    assert readme.is_file() or len(files) <= MOST_UNDESCRIBED
    if readme.is_file():
        text = readme.read_text(encoding="utf-8")
        named = set(re.findall(r"`([\w]+\.(?:py|html|css|js|typ))`", text))
        assert named
        assert not sorted(name for name in named if not (folder / name).is_file())
        assert not absent(text)


@pytest.mark.parametrize("folder", ["tests", "benches"])
def test_programs_and_folders_of_a_readme_exist(folder):
    text = (ROOT / folder / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", text, flags=re.MULTILINE)
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    assert len(named) > 5
    assert not [n for n in named if not (ROOT / folder / n).exists() and not (ROOT / folder / f"{n}.py").is_file()]
    assert not absent(text)


def test_a_path_or_a_test_that_is_not_there_is_found():
    assert absent("see `estimation/no_such.py` and [this](docs/absent.md)") == [
        "docs/absent.md",
        "estimation/no_such.py",
    ]
    assert absent("see `estimation/noise.py` and [this](docs/index.md)") == []
    text = (
        "`tests/docs/test_paths.py::test_no_such` and `tests/docs/test_paths.py::test_the_layers_are_those_of_the_test`"
    )
    assert missing_tests(text) == ["tests/docs/test_paths.py::test_no_such"]
