"""The workbench in Chromium under sessions at work, hostile uploads, killed workers and killed servers."""

from __future__ import annotations

import math
import os
import shutil
import signal
import statistics
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.app.user import area_for_files

from .case import LONG as EVERYTHING
from .workbench import LONG, Served, has_ended, is_emptied, served, serving, write  # noqa: F401  (served: a fixture)
from .workbench_soak import opened, soak

SESSIONS = 20 if EVERYTHING else 3
SECONDS = float(os.environ.get("ACCELCAL_SOAK", 1800.0 if EVERYTHING else 30.0))
ATTACK = '"><img src=x onerror="window.hit=1"><script>window.hit=2</script>\'`${window.hit=3}`{{constructor}}'
ATTACKS = (
    ATTACK,
    '</script><script>window.hit=1</script><svg onload="window.hit=2">',
    "</style></textarea></title><img src=x onerror=window.hit=1>",
    "' onmouseover='window.hit=1' autofocus onfocus='window.hit=2",
    "[x](javascript:window.hit=1) ![x](x)<iframe srcdoc='<script>parent.hit=1</script>'>",
    "{{window.hit=1}} ${window.hit=2} <%= window.hit=3 %> {% raw %}",
)
"""Text that a careless page would run: one in the slice."""

NAMES = [
    "a\0b.csv",
    "x" * 5000 + ".csv",
    "标" * 120 + ".csv",
    "../../../etc/cron.d/x.csv",
    "..\\..\\x.csv",
    "CON.csv",
    ".csv",
    "x.exe",
    "no ending",
    f"{ATTACK}.csv",
    "\u202egnp.csv",
    "a\nb\r\x1b[2J.csv",
]


@pytest.fixture
def page(browser: Any, served: Served) -> Iterator[Any]:  # noqa: F811
    context = browser.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
    yield opened(context, served)
    context.close()


def load(page: Any, path: Path) -> None:
    area_for_files(page).set_input_files([str(path), str(path.with_suffix(".toml"))])
    page.get_by_role("button", name="Fit the linear model").wait_for(timeout=LONG)


def fit(page: Any) -> None:
    page.get_by_role("button", name="Fit the linear model").click()
    page.locator("[data-verdict]").wait_for(timeout=LONG)


def test_sessions_at_work_leave_an_idle_page_alone(served: Served, browser: Any, tmp_path: Path) -> None:  # noqa: F811
    result = soak(served, browser, tmp_path, SESSIONS, SECONDS, math.inf if EVERYTHING else SESSIONS)
    print(result)
    assert result.lost == []
    assert result.errors == []
    assert result.fits >= SESSIONS
    # A slice does not judge the machine's pace: a fit that held the server would show as seconds.
    assert statistics.median(result.answers) < 2.0
    if EVERYTHING:
        assert max(result.answers) <= 1.0


@pytest.mark.parametrize("name", NAMES if EVERYTHING else NAMES[:5], ids=lambda name: repr(name[:20]))
def test_a_hostile_name_ends_in_a_sentence(page: Any, served: Served, name: str) -> None:  # noqa: F811
    before = set(served.temporary.glob("*"))
    area_for_files(page).set_input_files([{"name": name, "mimeType": "text/csv", "buffer": b"x" * 99}])
    page.locator(".sentence, .problem").first.wait_for(timeout=LONG)
    text = page.locator(".sentence:visible, .problem").first.inner_text()
    assert len(text) > 20
    assert page.evaluate("window.hit") is None
    assert set(served.temporary.glob("*")) == before
    page.get_by_role("tab", name="Model").click()  # the page lives
    page.get_by_text("Load a recording first.").wait_for(timeout=LONG)


@pytest.mark.parametrize("status", [413, 503, 507] if EVERYTHING else [413])
def test_an_upload_that_the_server_refuses_is_said_on_the_page(page: Any, status: int, tmp_path: Path) -> None:
    page.route("**/upload/**", lambda route: route.fulfill(status=status, body="no"))
    area_for_files(page).set_input_files([str(write(tmp_path / "run.csv", 1))])
    page.get_by_text("the upload has failed: the server did not take it").wait_for(timeout=LONG)


@pytest.mark.parametrize("attack", ATTACKS if EVERYTHING else ATTACKS[:1])
def test_names_in_a_file_run_nothing_on_any_screen_or_in_the_report(page: Any, tmp_path: Path, attack: str) -> None:
    path = write(tmp_path / "run.csv", 3)
    header, *rows = path.read_text().splitlines()
    quoted = '"' + attack.replace('"', '""') + '"'
    path.write_text("\n".join([f"{header},{quoted}", *(f"{row},{i % 7}" for i, row in enumerate(rows))]) + "\n")
    sidecar = path.with_suffix(".toml")
    sidecar.write_text(f"# {attack}\n{sidecar.read_text()}\n[run]\noperator = '''{attack}'''\n")
    area_for_files(page).set_input_files([str(path), str(sidecar)])
    page.locator(".problem, [aria-label='Fit the linear model']").first.wait_for(timeout=LONG)
    if page.locator("[aria-label='Fit the linear model']").count():
        fit(page)
    for name in ("Data", "Improve", "Residuals", "Model", "Export"):
        page.get_by_role("tab", name=name).click()
        page.wait_for_timeout(300)
        assert page.evaluate("window.hit") is None, name
        assert page.locator("main img[src=x], main script, main iframe[srcdoc]").count() == 0, name
    with page.expect_download(timeout=LONG) as report:
        page.get_by_role("button", name="Report (.html)").click()
    page.goto(Path(report.value.path()).as_uri())
    page.wait_for_timeout(500)
    assert page.evaluate("window.hit") is None
    assert page.locator("img[src=x], iframe[srcdoc]").count() == 0


def test_a_killed_worker_costs_one_action(page: Any, served: Served, tmp_path: Path) -> None:  # noqa: F811
    load(page, write(tmp_path / "run.csv", 4, seconds=100.0))
    page.get_by_role("button", name="Fit the linear model").click()
    page.get_by_role("button", name="Cancel").wait_for(timeout=LONG)
    for pid in served.workers():
        os.kill(pid, signal.SIGKILL)
    page.get_by_text("the process that did this work has ended before it (signal 9)").wait_for(timeout=LONG)
    page.get_by_role("tab", name="Data").click()
    fit(page)


def test_reload_during_a_fit_finds_it_and_cancel_ends_its_process(page: Any, served: Served, tmp_path: Path) -> None:  # noqa: F811
    load(page, write(tmp_path / "run.csv", 5, seconds=200.0))
    page.get_by_role("button", name="Fit the linear model").click()
    page.get_by_role("button", name="Cancel").wait_for(timeout=LONG)
    page.reload()
    page.get_by_role("button", name="Cancel").wait_for(timeout=LONG)
    at_work = served.workers()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text("Cancelled; nothing was changed.").wait_for(timeout=LONG)
    assert any(has_ended(pid) for pid in at_work)
    fit(page)


def test_sessions_do_not_see_each_other(page: Any, served: Served, tmp_path: Path) -> None:  # noqa: F811
    load(page, write(tmp_path / "mine.csv", 6))
    other = opened(page.context, served)
    assert "mine.csv" not in other.locator("body").inner_text()
    load(other, write(tmp_path / "yours.csv", 7))
    assert page.locator(".file").inner_text() == "mine.csv"
    assert other.locator(".file").inner_text() == "yours.csv"


def test_a_killed_server_brings_the_work_back(browser: Any, tmp_path: Path) -> None:
    with serving() as server:
        context = browser.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
        page, run = opened(context, server), write(tmp_path / "run.csv", 8)
        load(page, run)
        fit(page)
        error = page.locator("[data-number=error]").get_attribute("data-value")
        address, workers = page.url, server.workers()
        assert server.stop(signal.SIGKILL) == -signal.SIGKILL
        assert all(has_ended(pid) for pid in workers)
        page.goto("about:blank")  # it would come back by itself, and what is kept goes to who comes first
        server.start()
        page.goto(address)
        page.locator("[data-number=error]").wait_for(timeout=LONG)
        assert page.locator("[data-number=error]").get_attribute("data-value") == error
        page.goto("about:blank")
        # An orderly end takes the uploads along: the recording is asked for, and the work goes on.
        for folder in server.temporary.glob("accelcal-*"):
            shutil.rmtree(folder)
        workers = server.workers()
        assert server.stop(signal.SIGTERM) == 128 + signal.SIGTERM
        assert all(has_ended(pid) for pid in workers)
        assert is_emptied(server.temporary)
        server.start()
        fresh = opened(context, server)
        fresh.get_by_role("button", name="Open run.csv, 1 model").click(timeout=LONG)
        fresh.get_by_text("This session was made with run.csv").wait_for(timeout=LONG)
        area_for_files(fresh).set_input_files([str(run)])
        fresh.get_by_text("This session was made with run.csv").wait_for(state="detached", timeout=LONG)
        fresh.get_by_role("tab", name="Improve").click()
        fresh.locator("[data-number=error]").wait_for(timeout=LONG)
        assert fresh.locator("[data-number=error]").get_attribute("data-value") == error
        # Saved by hand, and opened in another session.
        fresh.get_by_role("tab", name="Export").click()
        with fresh.expect_download(timeout=LONG) as saved:
            fresh.get_by_role("button", name="Save session (.accelcal)").click()
        saved.value.save_as(tmp_path / "saved.accelcal")
        last = opened(context, server)
        area_for_files(last).set_input_files([str(tmp_path / "saved.accelcal")])
        last.locator("[data-number=error]").wait_for(timeout=LONG)
        context.close()
        workers = server.workers()
        server.stop(signal.SIGINT)
        assert all(has_ended(pid) for pid in workers)
        assert is_emptied(server.temporary)
