"""Every equation that a comment cites is on the page of derivations, and nothing outside the repository is cited."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator, Mapping

import pytest

from .pages import DOCS

ROOT = DOCS.parent
SOURCES = (
    ".py",
    ".pyi",
    ".rs",
    ".md",
    ".rst",
    ".toml",
    ".sh",
    ".ipynb",
    ".html",
    ".typ",
    ".js",
    ".css",
    ".yml",
    "Makefile",
)
LABEL = re.compile(r"[A-Z]?\d+(?:\.\d+[a-z]?)?")
HEADING = re.compile(rf"^###? ({LABEL.pattern}|[A-Z]) ", flags=re.MULTILINE)
CITED = re.compile(rf"\bderivations? (?:§ ?)?({LABEL.pattern}(?:(?:,| and|, and) {LABEL.pattern})*)", re.IGNORECASE)
"""As in "derivations 2.3" and "derivations D3.5, D7"."""
LINKED = re.compile(r"derivations\.md#([\w-]+)")
ABSENT = re.compile(
    r"\b(?:[Pp]hysics|[Dd]iscovery|[Rr]egimes|[Ff]rontier|[Nn]ewcomer|[Rr]eliability) (?:§ ?|section )?[A-Z]?\d"
    r"|\bDESIGN\b(?! ?=)|\b[Bb]ars? \d+\b|\bHOUSE\.md|\bstyle-guide\b"
)
"""Citations of documents that are not in the repository."""
PAGE = DOCS / "derivations.md"
HERE = "tests/docs/test_derivations.py"
NO_TEXT = {HERE}
"""What quotes these citations in order to find them."""


def texts() -> dict[str, str]:
    """Every source of the repository by its path."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    return {
        name: (ROOT / name).read_text(encoding="utf-8")
        for name in listed
        if name.endswith(SOURCES) and name not in NO_TEXT and (ROOT / name).is_file()
    }


def flat(text: str) -> str:
    """Text without the line breaks and comment signs inside a sentence."""
    return re.sub(r"\s*\n\s*(?://[/!]?|#)?\s*", " ", text)


def cited(sources: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """File and label of every citation."""
    for name, text in sources.items():
        for result in CITED.finditer(flat(text)):
            yield from ((name, label) for label in LABEL.findall(result[1]))


def labels(page: str) -> set[str]:
    """Labels of the headings of the page."""
    return set(HEADING.findall(page))


def anchors(page: str) -> set[str]:
    """Anchors of the headings of a page, as the site makes them."""
    heads = re.findall(r"^#+ (.+)$", page, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def unknown(sources: Mapping[str, str], page: str) -> list[str]:
    """Citations of labels, and links to headings, that the page does not have."""
    wrong = [f"{name}: derivations {label}" for name, label in cited(sources) if label not in labels(page)]
    for name, text in sources.items():
        wrong += [f"{name}: #{a}" for a in LINKED.findall(flat(text)) if a not in anchors(page)]
    return wrong


def outside(sources: Mapping[str, str]) -> list[str]:
    """Citations of documents that the repository does not hold."""
    return [f"{name}: {result[0]}" for name, text in sources.items() for result in ABSENT.finditer(flat(text))]


def test_every_cited_derivation_exists():
    sources = texts()
    assert len(list(cited(sources))) > 10
    wrong = unknown(sources, PAGE.read_text(encoding="utf-8"))
    assert not wrong, "\n".join(wrong)


def test_every_derivation_is_cited():
    sources = {name: text for name, text in texts().items() if name != "docs/derivations.md"}
    page = PAGE.read_text(encoding="utf-8")
    used = {label for _, label in cited(sources)} | {
        label
        for text in sources.values()
        for anchor in LINKED.findall(flat(text))
        for label in labels(page)
        if anchor.startswith(re.sub(r"[^\w]", "", label.lower()) + "-")
    }
    # A section may be a step on the way to one that is cited; then the page itself cites it.
    used |= set(re.findall(rf"\bsections? ({LABEL.pattern})\b", page))
    sections = {label for label in labels(page) if "." in label or (label.startswith("D") and label != "D")}
    assert not sorted(sections - used)


def test_no_document_outside_the_repository_is_cited():
    wrong = outside(texts())
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "text",
    [
        "(physics 2.3)",
        "physics 7 E1",
        "discovery 3.5",
        "see DESIGN section 3",
        "bar 4 asks",
        "/// by the\n/// physics 6.3",
    ],
)
def test_a_citation_of_another_document_is_caught(text):
    assert len(outside({"a.rs": text})) == 1


@pytest.mark.parametrize(
    "text", ["derivations 9.9", "Derivations D3.5 and D99", "derivations\n    # 9.9", "derivations.md#99-x"]
)
def test_a_citation_of_a_label_that_is_not_there_is_caught(text):
    page = PAGE.read_text(encoding="utf-8")
    assert len(unknown({"a.py": text}, page)) == 1
    assert not unknown(
        {
            "a.py": "derivations 2.3; derivations D3.5, D7",
            "b.md": "derivations.md#23-inverse-model-series-and-exact-inverse",
        },
        page,
    )
