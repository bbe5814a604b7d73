"""A user in front of the workbench in Chromium: a window of some size and theme, clicks that are counted, axe."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from axe_playwright_python.sync_playwright import Axe

LONG = 300_000
"""ms; a loaded machine takes its time."""
SIZES = {390: 844, 1280: 800, 1920: 1080}
"""Height of the window by its width, px: a phone, a desk, a wall."""
LOOKS = [(width, scheme) for width in SIZES for scheme in ("light", "dark")]
SCREENSHOTS = os.environ.get("ACCELCAL_SCREENSHOTS")
"""Folder for pictures of what was seen; none are made without it."""
GRAVE = ("serious", "critical")
"""Impacts of findings of axe that are not let pass."""


@dataclass
class User:
    """One user with a tab of their own."""

    page: Any
    name: str
    """Of what they do, for the screenshots."""
    clicks: int = 0
    outside: list[str] = field(default_factory=list)
    """Requests that would have left this machine; they are stopped."""
    complaints: list[str] = field(default_factory=list)
    """Errors of the scripts of the page."""

    def button(self, name: str) -> Any:
        """A button by its whole name."""
        return self.page.get_by_role("button", name=name, exact=True).first

    def click(self, name: str, role: str = "button") -> None:
        """Click once; a tab is left when its screen is there, however long that takes."""
        self.clicks += 1
        self.page.get_by_role(role, name=name, exact=True).first.click(timeout=LONG)
        if role == "tab":
            require_screen(self.page, name)

    def type(self, label: str, text: str) -> None:
        """Click into a field and fill it."""
        self.clicks += 1
        self.page.get_by_label(label, exact=True).first.fill(text)

    def drop(self, *paths: Path) -> None:
        """Drop files together."""
        area_for_files(self.page).set_input_files([str(path) for path in paths])

    def load(self, path: Path) -> None:
        """Drop a recording with its sidecar, and wait until it can be fitted."""
        self.drop(path, path.with_suffix(".toml"))
        self.button("Fit the linear model").wait_for(timeout=LONG)

    def fit(self) -> str:
        """Fit, and return the verdict."""
        self.click("Fit the linear model")
        return self.verdict()

    def verdict(self) -> str:
        """The verdict, once it is there."""
        badge = self.page.locator("[data-verdict]")
        badge.wait_for(timeout=LONG)
        return str(badge.get_attribute("data-verdict"))

    def add(self, name: str) -> None:
        """Add an effect after which nothing is missing."""
        self.click(f"Add {name}")
        self.page.locator("[data-verdict=adequate]").wait_for(timeout=LONG)

    def number(self, name: str) -> float:
        """A number of the screen Improve with all its digits."""
        return float(self.page.locator(f"[data-number={name}]").get_attribute("data-value"))

    def sees(self, text: str) -> None:
        """Wait until a text is on the page."""
        self.page.get_by_text(text).first.wait_for(timeout=LONG)

    def settles(self, figures: int = 0) -> None:
        """Wait until a number of figures is drawn and nothing moves."""
        if figures:
            self.page.locator(".body figure").nth(figures - 1).locator(".main-svg").first.wait_for(timeout=LONG)
        require_stillness(self.page)

    def look(self, screen: str) -> None:
        """Look at the whole screen: it fits the window, has one first heading, and is accessible to everybody."""
        page = self.page
        if SCREENSHOTS:
            Path(SCREENSHOTS).mkdir(parents=True, exist_ok=True)
            page.screenshot(path=Path(SCREENSHOTS) / f"{self.name}-{screen}.png", full_page=True)
        wide, window = page.evaluate("() => [document.documentElement.scrollWidth, innerWidth]")
        assert wide <= window, f"{screen}: {wide} px wide in a window of {window} px"
        assert page.get_by_role("heading", level=1).count() == 1, screen
        unnamed = page.evaluate(
            "() => [...document.querySelectorAll('figure')].filter(f => !f.innerText.trim()).length"
        )
        assert unnamed == 0, f"{screen}: {unnamed} figures without a text"
        result = self.findings()
        assert not result, f"{screen}: {result}"

    def findings(self) -> list[str]:
        """Serious and critical findings of axe on the page as it is."""
        result = Axe().run(self.page).response["violations"]
        return [f"{v['id']}: {v['nodes'][0]['html'][:200]}" for v in result if v["impact"] in GRAVE]


def area_for_files(page: Any) -> Any:
    """The first input of a page that takes files, those left out that only wait for what was dropped before."""
    return page.locator("input[type=file]:not(.hidden *)").first


def require_screen(page: Any, title: str) -> None:
    """Wait until the first heading of the page is that of a screen."""
    heading = page.get_by_role("heading", level=1, name=re.compile(rf"^{title}(:|$)"))
    heading.wait_for(state="attached", timeout=LONG)


def require_stillness(page: Any) -> None:
    """Wait until the height of the page and the places of its figures have been the same for 0.3 s."""
    page.evaluate("() => { window.seenSince = performance.now(); window.seenAs = ''; }")
    page.wait_for_function(
        """() => {
            const figures = [...document.querySelectorAll('.main-svg')].map(s => s.getBoundingClientRect().bottom);
            const now = [document.documentElement.scrollHeight, ...figures].join();
            if (now !== window.seenAs) { window.seenAs = now; window.seenSince = performance.now(); }
            return performance.now() - window.seenSince > 300;
        }""",
        timeout=LONG,
    )


def arrives(browser: Any, address: str, name: str, width: int, scheme: str) -> User:
    """A user who opens the first page; what would leave the machine is stopped and kept."""
    context = browser.new_context(
        viewport={"width": width, "height": SIZES[width]},
        color_scheme=scheme,
        reduced_motion="reduce",
        accept_downloads=True,
    )
    user = User(context.new_page(), name)

    def pass_on(route: Any) -> None:
        if route.request.url.startswith((address, "data:", "blob:")):
            route.continue_()
        else:
            user.outside.append(route.request.url)
            route.abort()

    def opened(socket: Any) -> None:
        if not socket.url.startswith(address.replace("http", "ws", 1)):
            user.outside.append(socket.url)

    context.route("**/*", pass_on)
    user.page.on("websocket", opened)
    user.page.on("pageerror", lambda error: user.complaints.append(str(error)))
    user.page.goto(f"{address}/", timeout=LONG)
    user.sees("Drop a recording here")
    return user
