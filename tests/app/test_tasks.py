"""Ten tasks of users in Chromium, in windows of three sizes and two themes.

`make test-all` does each task once, with sizes and themes in turn; `make test-browser` does all sixty combinations and
keeps pictures of what was seen.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accelcal import io
from accelcal.app.tasks import EXAMPLES
from accelcal.effects import spelled

from .conftest import write
from .test_server import HOST, served, server  # noqa: F401  (the fixture that runs the workbench)
from .user import LONG, LOOKS, User, arrives

EVERY = os.environ.get("ACCELCAL_BROWSER") == "every"
SCALE, ZERO = 1.2, 2.5
"""Of the sensor whose output is in volts: V/g and V."""


@pytest.fixture(scope="session")
def cubic(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short recording with a hidden cubic, and its sidecar."""
    path: Path = write(tmp_path_factory.mktemp("tasks") / "cubic.csv", 21, seconds=20.0, cubic=4e-3)
    return path


@pytest.fixture(scope="session")
def volts(cubic: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same recording as a laboratory writes it: semicolons, decimal commas, volts, millimetres, no sidecar."""
    run = io.load(cubic)
    t, y = run.position.t, run.position.y
    u = ZERO + SCALE * np.interp(t, run.accel.t, run.accel.y) / 9.80665
    rows = (f"{a:.6f};{b:.7f};{1e3 * c:.6f}".replace(".", ",") for a, b, c in zip(t, u, y, strict=True))
    path = tmp_path_factory.mktemp("volts") / "messung.csv"
    path.write_text("\n".join(["Zeit [s];Ausgang [V];Weg [mm]", *rows]) + "\n", encoding="utf-8")
    return path


def a_file_in_volts_and_millimetres(user: User, cubic: Path, volts: Path) -> None:
    user.drop(volts)
    user.sees("Choose below: the scale of the sensor")
    assert user.page.locator(".problem").count() == 0, "the normal first step looks like an error"
    user.look("columns")
    user.type("Scale", f"{SCALE} V/g")
    user.page.get_by_label("Output at 0 g", exact=True).fill(f"{ZERO} V")  # the next field by Tab
    user.click("Use this assignment")
    user.button("Fit the linear model").wait_for(timeout=LONG)
    assert user.fit() in ("named", "tied")
    assert user.clicks <= 3
    user.settles(figures=4)


def find_the_hidden_effect(user: User, cubic: Path, volts: Path) -> None:
    user.load(cubic)
    assert user.fit() in ("named", "tied")
    assert user.clicks <= 3
    alone = user.number("error")
    user.clicks = 0
    user.add("cubic")
    assert user.clicks == 1
    assert user.number("error") < user.number("before")
    user.settles(figures=4)
    user.look("found")
    user.clicks = 0
    user.click("Undo")
    user.button("Add cubic").wait_for(timeout=LONG)
    assert user.number("error") == alone
    assert user.clicks == 1


def say_how_sure(user: User, cubic: Path, volts: Path) -> None:
    user.load(cubic)
    user.fit()
    user.add("cubic")
    user.click("Model", "tab")
    row = user.page.get_by_role("row").filter(has=user.page.get_by_label("Value to fix cubic at"))
    value = float(row.get_by_label("Value to fix cubic at").input_value())
    assert value == pytest.approx(4e-3, rel=0.02)
    assert "K3" in row.inner_text()
    user.sees("95 % interval")
    user.click("Residuals", "tab")
    user.settles(figures=6)


def hold_out_a_part(user: User, cubic: Path, volts: Path) -> None:
    user.load(cubic)
    for start, end, button, text in (
        ("15", "20", "Hold this stretch out", "Held out: 15 s to"),
        ("2", "3", "Exclude this stretch", "Excluded: 2 s to 3 s"),
    ):
        user.type("From, s", start)
        user.type("To, s", end)
        user.click(button)
        user.sees(text)
    user.settles(figures=1)


def compare_two_models(user: User, cubic: Path, volts: Path) -> None:
    user.load(cubic)
    user.fit()
    user.add("cubic")
    after = user.number("error")
    models = user.page.locator(".node")
    assert models.count() == 2
    models.first.click()
    user.page.wait_for_function(
        "v => document.querySelector('[data-number=error]').dataset.value !== v", arg=repr(after), timeout=LONG
    )
    assert user.number("error") > after
    assert models.first.get_attribute("aria-pressed") == "true"
    user.settles(figures=4)
    number = user.page.locator("[data-number=error]").inner_text()
    assert any(f": {number}" in text for text in user.page.locator("figcaption").all_inner_texts())


def save_and_reopen(user: User, cubic: Path, volts: Path) -> None:
    user.load(cubic)
    user.fit()
    error = user.number("error")
    user.click("Export", "tab")
    with user.page.expect_download(timeout=LONG) as saved:
        user.click("Save session (.accelcal)")
    session = Path(saved.value.path()).with_suffix(".accelcal")
    saved.value.save_as(session)
    user.look("export")
    user.page.goto("/".join(user.page.url.split("/")[:3]) + "/")
    user.sees("Drop a recording here")
    user.drop(session)
    user.page.locator("[data-number=error]").wait_for(timeout=LONG)
    assert user.number("error") == error


def send_a_report(user: User, cubic: Path, volts: Path) -> None:
    user.load(cubic)
    user.fit()
    user.clicks = 0
    user.click("Export", "tab")
    with user.page.expect_download(timeout=LONG) as report:
        user.click("Report (.html)")
    assert user.clicks <= 2
    assert "cubic" in Path(report.value.path()).read_text(encoding="utf-8")


def try_an_own_formula(user: User, cubic: Path, volts: Path) -> None:
    user.load(cubic)
    user.fit()
    user.click("Model", "tab")
    user.type("Name", "my_cube")
    user.type("Unit of the coefficient", "(m/s^2)^-2")
    user.type("Formula", "a ** 3")
    user.look("model")
    user.click("Add to the candidates")
    user.button("Add my cube").wait_for(timeout=LONG)
    user.settles(figures=4)


def do_the_loop_by_keyboard(user: User, cubic: Path, volts: Path) -> None:
    page, keys = user.page, user.page.keyboard
    keys.press("Tab")
    assert focused(user) == "Skip to content"
    keys.press("Enter")
    reach(user, "Drop a recording here")
    chosen_by_keyboard(user).set_files([str(cubic), str(cubic.with_suffix(".toml"))])
    user.button("Fit the linear model").wait_for(timeout=LONG)
    reach(user, "Fit the linear model")
    keys.press("Enter")
    user.verdict()
    reach(user, "Add cubic")
    keys.press("Enter")
    page.locator("[data-verdict=adequate]").wait_for(timeout=LONG)
    keys.press("Control+z")
    user.button("Add cubic").wait_for(timeout=LONG)
    reach(user, "Improve", backward=True)
    for _ in range(3):
        keys.press("ArrowRight")  # along the tabs
    assert focused(user) == "Export"
    keys.press("Enter")
    reach(user, "Report (.html)")
    with page.expect_download(timeout=LONG):
        keys.press("Space")
    assert user.clicks == 0


def chosen_by_keyboard(user: User) -> Any:
    """The dialog for files that Enter opens; the browser may refuse it just after another Enter, and is asked again."""
    sync_api = pytest.importorskip("playwright.sync_api")
    for _ in range(8):
        try:
            with user.page.expect_file_chooser(timeout=5000) as chooser:
                user.page.keyboard.press("Enter")
        except sync_api.TimeoutError:
            continue
        return chooser.value
    raise AssertionError("Enter opens no dialog for files")


def find_what_an_example_hides(user: User, cubic: Path, volts: Path) -> None:
    hidden = EXAMPLES["shaker"]
    user.look("start")
    user.click("One-minute tour")
    for step in range(1, 5):
        user.sees(f"{step} of 5")
        user.page.wait_for_function("() => document.activeElement.innerText.endsWith('Next')", timeout=LONG)
        user.page.keyboard.press("Enter")
    user.sees("5 of 5")
    assert user.findings() == []
    user.page.keyboard.press("Escape")
    user.page.get_by_role("dialog").wait_for(state="hidden", timeout=LONG)
    user.click(f"Try it: {hidden.title}")
    user.button("Fit the linear model").wait_for(timeout=LONG)
    user.fit()
    user.add(spelled(hidden.effect))
    assert not user.page.get_by_text(hidden.answer).is_visible()
    user.page.get_by_text("Show the answer").click()
    user.sees(hidden.answer)
    user.settles(figures=4)


def focused(user: User) -> str:
    """Name of what has the focus, which shows a ring."""
    evaluation: tuple[str, bool] = user.page.evaluate(
        """() => {
            const e = document.activeElement, ring = getComputedStyle(e);
            const outline = ring.outlineStyle !== "none" && parseFloat(ring.outlineWidth) >= 2;
            return [(e.getAttribute("aria-label") || e.innerText || "").trim(),
                    outline || ring.boxShadow.includes(" 3px")];
        }"""
    )
    name, ring = evaluation
    inside = user.page.evaluate("() => ['INPUT', 'TEXTAREA', 'BODY'].includes(document.activeElement.tagName)")
    content = user.page.evaluate("() => document.activeElement.classList.contains('body')")
    assert inside or content or ring, f"{name!r} has the focus and shows no ring"
    return name.split("\n")[-1] if "\n" in name else name


def reach(user: User, name: str, *, backward: bool = False) -> None:
    """Press Tab until a control has the focus."""
    passed = []
    for _ in range(60):
        passed.append(focused(user))
        if name in passed[-1] and "\n" not in passed[-1] and len(passed[-1]) < 80:
            return
        user.page.keyboard.press("Shift+Tab" if backward else "Tab")
    raise AssertionError(f"{name!r} is not reached: {passed}")


Task = Callable[[User, Path, Path], None]
TASKS: tuple[Task, ...] = (
    a_file_in_volts_and_millimetres,
    find_the_hidden_effect,
    say_how_sure,
    hold_out_a_part,
    compare_two_models,
    save_and_reopen,
    send_a_report,
    try_an_own_formula,
    do_the_loop_by_keyboard,
    find_what_an_example_hides,
)


WINDOWS = [(task, LOOKS if EVERY else [LOOKS[i % len(LOOKS)]]) for i, task in enumerate(TASKS)]
"""Each task in every window, or in one of them, so that all windows have their turn."""
AT_ONE_SERVER = 12
"""Users of one server: work that was left within ten minutes makes no room for a 33rd session."""
COMBINATIONS = [
    pytest.param(number // AT_ONE_SERVER, task, width, scheme, id=f"{task.__name__}-{width}-{scheme}")
    for number, (task, width, scheme) in enumerate((task, *look) for task, looks in WINDOWS for look in looks)
]


@pytest.fixture(scope="module")
def port(request, tmp_path_factory):
    """Port of the server that everybody uses, or of one of their own for those who come later."""
    if request.param == 0:
        yield request.getfixturevalue("server")[0]
        return
    with served(tmp_path_factory) as (serving, _):
        yield serving


@pytest.mark.parametrize(("port", "task", "width", "scheme"), COMBINATIONS, indirect=["port"])
def test_a_user_can(browser, port, cubic, volts, task, width, scheme):
    user = arrives(browser, f"http://{HOST}:{port}", f"{task.__name__}-{width}-{scheme}", width, scheme)
    task(user, cubic, volts)
    user.look("end")
    assert user.outside == []
    assert user.complaints == []
    user.page.context.close()


def test_every_window_has_its_turn():
    assert len(TASKS) == 10
    assert {tuple(item.values[2:]) for item in COMBINATIONS} == set(LOOKS)
