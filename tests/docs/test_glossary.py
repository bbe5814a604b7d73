"""No definition is named by a word that the glossary rejects: the field has a word for it."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from accelcal.effects import BUILT_IN

from .pages import DOCS

ROOT = DOCS.parent
PYTHON = ("python/accelcal", "tests", "benches", "tools")
RUST = ("crates", "firmware", "benches")
ENDINGS = ("", "s", "ed", "ing", "er", "est", "ness")
"""Forms of a stem that are rejected with it; a longer word that contains a stem (standard, thinned) is another word."""
TERMS = {("random", "walk")}
"""Pairs of words that are terms of the field although the second is rejected by itself."""
EFFECTS = {effect.name for effect in BUILT_IN}
"""Names of effects are commands and keys of files, and stay."""
TYPED = re.compile(r"(?:^|[(,{])\s*(?:pub(?:\(\w+\))?\s+)?(?:mut\s+)?([a-z_]\w*)\s*:(?!:)", re.MULTILINE)
"""Fields and parameters of Rust: a name before its type."""
DEFINED = re.compile(
    r"^\s*(?:pub(?:\([^)]*\))?\s+)?(?:(?:const|unsafe|async|extern(?:\s+\"C\")?)\s+)*"
    r"(?:fn|struct|enum|trait|type|const|static|mod)\s+(\w+)",
    flags=re.MULTILINE,
)
"""The name of an item of Rust."""


def rejected(page: str) -> dict[str, str]:
    """Stems that the page rejects, each with what it says to write."""
    table = page.partition("## Rejected in names")[2]
    return dict(re.findall(r"^\| `(\w+)` \| (.+) \|$", table, flags=re.MULTILINE))


STEMS = rejected((DOCS / "glossary.md").read_text(encoding="utf-8"))


def words(name: str) -> list[str]:
    """The words of a name, in snake case or camel case, in small letters."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


def stems_in(name: str) -> set[str]:
    """Rejected stems among the words of a name."""
    result = words(name)
    remaining = [w for i, w in enumerate(result) if (result[i - 1] if i else "", w) not in TERMS]
    return {stem for stem in STEMS for word in remaining if word.startswith(stem) and word[len(stem) :] in ENDINGS}


def defined_in_python(text: str) -> Iterator[tuple[int, str]]:
    """Line and name of every class, function, parameter, module constant and attribute."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.ClassDef() | ast.FunctionDef() | ast.AsyncFunctionDef():
                yield node.lineno, node.name
            case ast.arg():
                yield node.lineno, node.arg
            case ast.Attribute(ctx=ast.Store()):
                yield node.lineno, node.attr
        if isinstance(node, ast.Module | ast.ClassDef):
            for statement in node.body:
                if isinstance(statement, ast.Assign | ast.AnnAssign):
                    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
                    yield from (
                        (statement.lineno, part.id)
                        for target in targets
                        for part in ast.walk(target)
                        if isinstance(part, ast.Name)
                    )


def defined_in_rust(text: str) -> Iterator[tuple[int, str]]:
    """Line and name of every item, field and parameter."""
    for pattern in (DEFINED, TYPED):
        for result in pattern.finditer(text):
            yield text.count("\n", 0, result.start(1)) + 1, result[1]


def files(folders: tuple[str, ...], suffix: str) -> Iterator[Path]:
    """Sources below folders of the repository, without what is built."""
    for folder in folders:
        yield from (p for p in sorted((ROOT / folder).rglob(f"*{suffix}")) if "target" not in p.parts)


def misnamed(path: Path) -> Iterator[str]:
    """Every definition of a file, and the file itself, that has a rejected stem in its name."""
    text = path.read_text(encoding="utf-8")
    names = defined_in_python(text) if path.suffix in (".py", ".pyi") else defined_in_rust(text)
    for line, name in [(1, path.stem), *names]:
        if name not in EFFECTS and stems_in(name):
            reasons = "; ".join(f"instead of {stem}: {STEMS[stem]}" for stem in sorted(stems_in(name)))
            place = path.relative_to(ROOT) if path.is_relative_to(ROOT) else path.name
            yield f"{place}:{line}: {name} ({reasons})"


@pytest.mark.parametrize(
    ("folder", "suffix"), [(f, ".py") for f in PYTHON] + [(PYTHON[0], ".pyi")] + [(f, ".rs") for f in RUST]
)
def test_definitions_are_named_in_terms_of_the_field(folder, suffix):
    listed = list(files((folder,), suffix))
    assert listed
    wrong = [line for path in listed for line in misnamed(path)]
    assert not wrong, "\n".join(wrong)


def test_the_glossary_rejects_about_thirty_stems_each_with_what_to_write():
    assert 25 <= len(STEMS) <= 40
    assert all(STEMS.values())


@pytest.mark.parametrize("stem", sorted(STEMS))
def test_a_definition_with_a_rejected_stem_is_found(stem, tmp_path):
    python, rust = tmp_path / "a.py", tmp_path / "b.rs"
    python.write_text(f"class Big{stem.capitalize()}ing:\n    {stem}_size: int\n\n\ndef f({stem}s): ...\n")
    rust.write_text(f"pub(crate) const fn as_{stem}<T>({stem}: u8) {{}}\nmod {stem};\n")
    assert len(list(misnamed(python))) == 3
    assert len(list(misnamed(rust))) == 3


def test_terms_names_of_effects_and_longer_words_are_let_pass(tmp_path):
    path = tmp_path / "a.py"
    path.write_text("def bias_random_walk(standard, thinned, randomWalk, understand): ...\n")
    assert not list(misnamed(path))
    path.write_text("def walk_at_random(): ...\n")
    assert len(list(misnamed(path))) == 1


PRONOUNS = frozenset(("found", "one", "each", "seen", "made", "known", "own", "kept", "said", "told", "gone"))
"""Names that say nothing of what a variable holds."""


def names_bound(source: str) -> set[str]:
    """Names that a module binds: functions, parameters, variables, and attributes of objects; of fields of classes
    `own` is let pass, the key of the user's effects in files."""
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    classes = [node for node in nodes if isinstance(node, ast.ClassDef)]
    fields = {id(field.target) for node in classes for field in node.body if isinstance(field, ast.AnnAssign)}
    methods = {id(field) for node in classes for field in node.body if isinstance(field, ast.FunctionDef)}
    names = set[str]()
    for node in nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names |= {node.id} - ({"own"} if id(node) in fields else set())
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            names.add(node.attr)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names |= {node.name} - ({"own"} if id(node) in methods else set())
        elif isinstance(node, ast.arg):
            names.add(node.arg)
    return names


def test_nothing_is_named_by_a_pronoun() -> None:
    sources = {path: path.read_text(encoding="utf-8") for folder in PYTHON for path in (ROOT / folder).rglob("*.py")}
    assert not {str(path): names for path, text in sources.items() if (names := PRONOUNS & names_bound(text))}
    bound = names_bound("class A:\n    seen: int\n    own: int\ndef f(found):\n    return [each for each in found]")
    assert bound & PRONOUNS == {"found", "each", "seen"}
