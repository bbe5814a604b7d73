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


def examples(page: str) -> Iterator[Example]:
    """Yield the blocks of a page of `docs`."""
    for found in FENCE.finditer((DOCS / f"{page}.md").read_text(encoding="utf-8")):
        yield Example(found["language"], found["text"], found["file"] or "")
