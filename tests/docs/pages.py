"""Examples of a page, in the order in which a reader meets them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
FENCE = re.compile(
    r"(?:^`(?P<file>[\w.-]+)`:\n\n)?^```(?P<language>\w+)\n(?P<text>.*?)^```", flags=re.MULTILINE | re.DOTALL
)


@dataclass(frozen=True)
class Example:
    """One block of a page."""

    language: str
    text: str
    file: str = ""
    """Name of the file that the reader is asked to write with this text."""


INCLUDE = re.compile(
    r"^```\{include\} (?P<file>\S+)\n:start-after: (?P<after>.+)\n:end-before: (?P<before>.+)\n(?::.*\n)*```$",
    flags=re.MULTILINE,
)


def text_of(page: str) -> str:
    """Text of a page of `docs` with the parts of other files that it includes."""
    return INCLUDE.sub(
        lambda m: (DOCS / m["file"]).read_text("utf-8").partition(m["after"])[2].partition(m["before"])[0],
        (DOCS / f"{page}.md").read_text(encoding="utf-8"),
    )


def examples(page: str) -> Iterator[Example]:
    """Yield the blocks of a page of `docs`."""
    for result in FENCE.finditer(text_of(page)):
        yield Example(result["language"], result["text"], result["file"] or "")
