"""Every screen of the workbench before axe, in both themes: no serious finding, and what the rules do not see."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from .conftest import write
from .test_server import HOST, server  # noqa: F401  (the fixture that runs the workbench)
from .user import LONG, User, arrives

SCREENS = {"Data": 1, "Improve": 5, "Residuals": 6, "Model": 0, "Export": 0}
"""Number of figures of each screen with a fitted model."""
HIGHEST = {"Data": 2200, "Improve": 5200, "Residuals": 7000, "Model": 1600, "Export": 2000, "start": 3000}
"""Height of each screen on a phone, px: that of the figures and cards that it has, not of words one a line."""


@pytest.fixture(scope="module")
def user(browser: Any, server: Any) -> Any:  # noqa: F811
    """A user at a wide window, with a dark theme at first."""
    page = arrives(browser, f"http://{HOST}:{server[0]}", "axe-1920", 1920, "dark")
    yield page
    page.page.context.close()


def both_themes(user: User, screen: str, figures: int) -> None:
    """Look at a screen in the dark and in the light theme."""
    for other in ("Light theme", "Dark theme"):
        user.button(other).wait_for(timeout=LONG)  # the theme before it is gone
        user.settles(figures)
        user.look(f"{screen}-{other.split()[0].lower()}-next")
        user.click(other)
    user.settles(figures)


def ring_of_a_figure(user: User) -> str:
    """Width of the ring around a button of a figure that the keyboard has reached; plotly's own is a black line."""
    user.page.keyboard.press("Tab")
    return str(
        user.page.evaluate(
            """() => {
                const button = document.querySelector('.modebar-btn'); button.focus();
                return getComputedStyle(button).outlineWidth;
            }"""
        )
    )


def test_no_screen_has_a_serious_finding(user: User, tmp_path: Path) -> None:
    both_themes(user, "start", 0)
    names = tmp_path / "odd.csv"
    names.write_text("stamp,sensor,scale\n" + "".join(f"{0.01 * i:.2f},0.1,{i % 5}\n" for i in range(99)))
    user.drop(names)
    user.sees("what is in its columns?")
    user.page.get_by_text("Everything else: the sidecar").click()
    user.page.get_by_text("The body can turn").click()
    user.settles()
    user.look("columns")
    user.load(write(tmp_path / "run.csv", 21, seconds=20.0, cubic=4e-3))
    user.fit()
    for title, figures in SCREENS.items():
        user.click(title, "tab")
        both_themes(user, title, figures)
        assert not figures or ring_of_a_figure(user) == "3px", title
    user.page.goto("/".join(user.page.url.split("/")[:3]) + "/bench/nobody")
    user.sees("This session has expired")
    assert user.findings() == []
    assert user.outside == []


def test_axe_would_find_a_button_without_a_name(user: User) -> None:
    user.page.set_content("<html lang=en><title>x</title><main><h1>x</h1><button></button></main></html>")
    assert [line.partition(":")[0] for line in user.findings()] == ["button-name"]


def test_a_phone_shows_screens_of_a_sensible_height(browser: Any, server: Any, tmp_path: Path) -> None:  # noqa: F811
    phone = arrives(browser, f"http://{HOST}:{server[0]}", "height-390", 390, "light")
    heights = {"start": height(phone)}
    phone.load(write(tmp_path / "run.csv", 21, seconds=20.0, cubic=4e-3))
    phone.fit()
    for title, figures in SCREENS.items():
        phone.click(title, "tab")
        phone.settles(figures)
        heights[title] = height(phone)
        narrow = phone.page.evaluate(
            "() => [...document.querySelectorAll('.body .main-svg')].map(s => s.getBoundingClientRect().right)"
        )
        assert all(right <= 390 for right in narrow), title
        lines = phone.page.evaluate(
            """() => [...document.querySelectorAll('[role=heading]:not(.unseen-text)')].filter(
                h => h.innerText.split(' ').length > 2 && h.clientWidth < 150).map(h => h.innerText)"""
        )
        assert lines == [], f"{title}: headings in a column of words"
    print(heights)
    assert {title: pixels for title, pixels in heights.items() if pixels > HIGHEST[title]} == {}
    phone.page.context.close()


def test_a_click_on_a_tab_waits_for_its_screen_and_a_look_for_stillness(user: User) -> None:
    for title, heading in (("Model", "Model: run.csv"), ("Data", "Data")):
        user.page.set_content(f"<h1>Residuals: run.csv</h1><button role=tab>{title}</button><div></div>")
        user.page.evaluate(
            """heading => document.querySelector('button').addEventListener('click', () => setTimeout(
                () => { document.querySelector('h1').innerText = heading; }, 1500))""",
            heading,
        )
        user.click(title, "tab")
        assert user.page.inner_text("h1") == heading
    user.page.evaluate(
        """() => { let n = 0; const grows = setInterval(() => {
            document.querySelector('div').style.height = `${1000 + 100 * n}px`;
            if (++n == 10) clearInterval(grows); }, 100); }"""
    )
    user.settles()
    assert height(user) >= 1900


def height(user: User) -> int:
    """Height of the page, px."""
    return int(user.page.evaluate("() => document.documentElement.scrollHeight"))


@pytest.mark.parametrize("wish", ["reduce", "no-preference"])
def test_motion_is_reduced_where_that_is_asked_for(browser: Any, server: Any, wish: str) -> None:  # noqa: F811
    page = browser.new_page(reduced_motion=wish)
    page.goto(f"http://{HOST}:{server[0]}/", timeout=LONG)
    tab = page.get_by_role("tab", name="Improve")
    tab.wait_for(timeout=LONG)
    seconds = page.evaluate(
        "() => parseFloat(getComputedStyle(document.querySelector('.q-focus-helper')).transitionDuration)"
    )
    page.close()
    assert (seconds < 0.001) == (wish == "reduce")
