"""What the package prints on its pages: `make pages` writes it, and a test of each compares."""

from __future__ import annotations

from accelcal.diagnosis import policy
from accelcal.effects import BUILT_IN, cards

from .pages import DOCS


def live_effects() -> str:
    """The table of the live page; without the folder `live` the other pages are printed all the same."""
    from accelcal.live import tracker

    return tracker.markdown()


PRINTED = {"method.md": ("thresholds", policy.markdown), "live.md": ("effects", live_effects)}
"""Pages with a part that the package prints, between marks that name it."""


def with_printed(page: str, text: str) -> str:
    """A page with what the package prints between its marks."""
    part, markdown = PRINTED[page]
    begin, end = f"<!-- {part}: begin -->\n", f"<!-- {part}: end -->"
    before, _, rest = text.partition(begin)
    return before + begin + markdown() + end + rest.partition(end)[2]


def main() -> None:
    """Write the cards of effects, the tables of thresholds and what becomes of each effect live."""
    (DOCS / "effects.md").write_text(cards(BUILT_IN), encoding="utf-8")
    for page in PRINTED:
        path = DOCS / page
        path.write_text(with_printed(page, path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
