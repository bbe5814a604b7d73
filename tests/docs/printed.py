"""What the package prints on its pages: `make pages` writes it, and a test of each compares."""

from __future__ import annotations

from accelcal.diagnosis import policy
from accelcal.effects import BUILT_IN, cards

from .pages import DOCS

BEGIN, END = "<!-- thresholds: begin -->\n", "<!-- thresholds: end -->"
"""Marks of the page of the method around the tables of thresholds."""


def with_thresholds(page: str) -> str:
    """The page of the method with the tables that the policy prints."""
    before, _, rest = page.partition(BEGIN)
    return before + BEGIN + policy.markdown() + END + rest.partition(END)[2]


def main() -> None:
    """Write the cards of effects and the tables of thresholds."""
    (DOCS / "effects.md").write_text(cards(BUILT_IN), encoding="utf-8")
    method = DOCS / "method.md"
    method.write_text(with_thresholds(method.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
