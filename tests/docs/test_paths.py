"""Paths, definitions, tests and layers that the documents name exist."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from tests.house.test_layers import LAYERS, MODULES

from .pages import DOCS

ROOT = DOCS.parent
PAGES = ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "docs/decisions.md", "docs/method.md", "docs/measured.md")
BASES = ("", "python", "python/accelcal", "tests", "docs", "crates", "crates/ekf-core/src", "crates/ekf-simd/src")
"""Folders that paths on these pages are relative to."""
PATH = re.compile(
    r"(?<![\w./<-])((?:[\w-]+/)+(?:[\w-]+\.(?:py|rs|md|toml|txt|csv|sh|png|c|ipynb))?|[\w-]+/[\w/-]+)(?![\w/*<{])"
)
"""A path with at least one folder in it."""
DEFINITION = re.compile(r"`([\w/-]+\.(?:py|rs))::(\w+)`")


def quoted(text: str) -> Iterator[str]:
    """Code spans, fenced text and targets of links."""
    fences = re.findall(r"^```text\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    without = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    yield from fences
    yield from re.findall(r"`([^`\n]+)`", without)
    yield from re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", without)


def paths(text: str) -> set[str]:
    """Paths that a page names, in code or in a link."""
    results = {p for part in quoted(text) for p in PATH.findall(part.partition("::")[0])}
    return {
        p
        for p in results
        if re.search(r"\.(py|rs|md|toml|txt|csv|sh|png|c|ipynb)$|^(tests|docs|crates|python|benches)/", p)
    }


def absent(text: str) -> list[str]:
    """Paths that are not there."""
    return sorted(p for p in paths(text) if not any((ROOT / base / p).exists() for base in BASES))


@pytest.mark.parametrize("page", PAGES)
def test_every_path_on_a_page_exists(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    assert paths(text)
    assert not absent(text)


def test_the_layers_are_those_of_the_test():
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    (listed,) = re.findall(r"^```text\n(_support.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    assert tuple(listed.split()) == LAYERS


def absent_definitions(text: str) -> list[str]:
    """Functions, classes, constants and tests named as `file::name` that their file does not define."""
    wrong = []
    for file, name in DEFINITION.findall(text):
        path = next((ROOT / base / file for base in BASES if (ROOT / base / file).is_file()), None)
        pattern = rf"^\s*(?:(?:pub(?:\([^)]*\))? )?(?:fn|struct) |def |class ){name}\b|^{name}(?::.*)? = "
        if path is None or not re.search(pattern, path.read_text(encoding="utf-8"), flags=re.MULTILINE):
            wrong.append(f"{file}::{name}")
    return wrong


def test_recipes_name_tests_that_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert not absent_definitions(text)
    recipes = re.split(r"^### ", text.partition("## Recipes")[2].partition("\n## ")[0], flags=re.MULTILINE)[1:]
    assert len(recipes) >= 8
    for recipe in recipes:
        assert re.search(r"`tests/|`make |`benches/", recipe), f"no test is named: {recipe.splitlines()[0]}"


def test_twenty_questions_are_answered_by_files_that_define_what_they_name():
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").partition("## Where is it")[2]
    rows = re.findall(r"^\| (.+\?) \| (.+) \|$", text, flags=re.MULTILINE)
    assert len(rows) == 20
    for question, answer in rows:
        assert paths(answer), question
        assert not absent_definitions(answer), question


def test_equations_lead_to_functions():
    text = (ROOT / "crates" / "README.md").read_text(encoding="utf-8")
    assert len(DEFINITION.findall(text)) > 15
    assert not absent_definitions(text)


def test_architecture_is_short_enough_to_be_read():
    assert len((ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").splitlines()) <= 80


def test_pages_of_the_interface_name_modules_that_exist():
    texts = [path.read_text(encoding="utf-8") for path in (DOCS / "api").glob("*.rst")]
    named = [
        name for text in texts for name in re.findall(r"^\.\. automodule:: accelcal\.?(\S*)$", text, flags=re.MULTILINE)
    ]
    assert len(named) > 20
    assert not sorted(name for name in named if name and name not in MODULES)


@pytest.mark.parametrize("folder", ["tests", "benches"])
def test_programs_and_folders_of_a_readme_exist(folder):
    text = (ROOT / folder / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", text, flags=re.MULTILINE)
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    assert len(named) > 5
    assert not [n for n in named if not (ROOT / folder / n).exists() and not (ROOT / folder / f"{n}.py").is_file()]
    assert not absent(text)


def test_every_folder_of_tests_is_a_folder_of_the_package_or_explained():
    explained = set(re.findall(r"`([\w/]+)`", (ROOT / "tests" / "README.md").read_text(encoding="utf-8")))
    for top in ("", "diagnosis/"):
        for folder in (ROOT / "tests" / top).glob("*/__init__.py"):
            name = top + folder.parent.name
            assert name in explained or (ROOT / "python" / "accelcal" / name).is_dir(), name


def test_a_path_or_a_test_that_is_not_there_is_found():
    assert absent("see `estimation/no_such.py` and [this](docs/absent.md)") == [
        "docs/absent.md",
        "estimation/no_such.py",
    ]
    assert absent("see `estimation/noise.py` and [this](docs/index.md)") == []
    text = "`tests/docs/test_paths.py::{}` and `dense/update.rs::{}` and `diagnosis/policy.py::{}`"
    assert absent_definitions(text.format("absent", "correct", "FAMILYWISE_ALPHA")) == []
    assert len(absent_definitions(text.format("test_no_such", "corrects", "FAMILYWISE"))) == 3
