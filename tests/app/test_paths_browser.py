"""What changes during the run, in Chromium: the path of a random scale factor, what it follows, and its mechanism."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from .conftest import sagging
from .test_server import HOST, server  # noqa: F401  (the fixture that runs the workbench)
from .user import LONG, User, arrives

PROCESS = "scale gauss markov"
DRIVERS = ("scale factor follows |a|", "scale factor follows a²")
"""What the scale factor of the record follows, and what is nearest to it."""


def with_process(user: User, path: Path) -> Any:
    """Fit a record, and add a random scale factor by hand; return the card of its path."""
    user.load(path)
    user.fit()
    user.click("Model", "tab")
    chosen = user.page.get_by_label("Add any effect, significant or not")
    chosen.fill(PROCESS)
    user.page.get_by_role("option", name=PROCESS, exact=True).click()
    user.click("Add to model")
    card = user.page.locator(".paths")
    card.locator(".main-svg").first.wait_for(timeout=LONG)
    return card


def shares(card: Any) -> list[int]:
    """Shares of the table, per cent, in its order."""
    texts = card.locator("tbody tr td:nth-child(2)").all_inner_texts()
    return [int(text.split()[0]) for text in texts]


@pytest.mark.parametrize(("width", "scheme"), [(390, "light"), (1280, "dark")])
def test_the_mechanism_of_a_driver_takes_the_place_of_the_process(
    browser: Any,
    server: Any,  # noqa: F811
    tmp_path: Path,
    width: int,
    scheme: str,
) -> None:
    user = arrives(browser, f"http://{HOST}:{server[0]}", f"paths-{width}", width, scheme)
    card = with_process(user, sagging(tmp_path / "sag.csv"))
    base, random = user.number("before"), user.number("error")
    ranked = shares(card)
    assert ranked == sorted(ranked, reverse=True)
    assert ranked[0] > 70 > ranked[-1]
    first = card.locator("tbody tr").first.inner_text()
    assert first.split("\t")[0].strip() in DRIVERS
    user.verdict()
    user.settles(4)
    user.look("process")
    add = user.button(f"Add {DRIVERS[0]}")  # reached and pressed by the keyboard alone
    add.scroll_into_view_if_needed()
    place = add.bounding_box()
    assert place["x"] + place["width"] <= card.bounding_box()["x"] + card.bounding_box()["width"]  # without scrolling
    add.focus()
    user.page.keyboard.press("Enter")
    user.page.locator(".node[aria-pressed=true]", has_text=DRIVERS[0]).wait_for(timeout=LONG)
    assert user.number("error") < 0.5 * min(base, random)
    assert card.locator("tbody tr").count() == 0  # nothing of it is random any more
    user.page.locator("[data-verdict=adequate]").wait_for(timeout=LONG)
    user.settles(4)
    user.look("mechanism")
    user.click("Model", "tab")
    user.sees("scale factor, at rest")
    user.sees("scale factor, at the mean of this run")
    assert user.page.get_by_role("button", name=f"Remove {PROCESS}").count() == 0
    user.look("gauge")
    assert user.outside == []
    assert user.complaints == []
    user.page.context.close()
