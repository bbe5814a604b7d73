"""Sessions at once that fit and diagnose without a pause, and one idle page that is asked meanwhile."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from accelcal.app.server import HOST
from tests.app.user import area_for_files

from .workbench import LONG, Served, write

IDLE_PAGE = Path(__file__).with_name("idle_page.py")
STEP = """() => {
  const seen = q => { const e = document.querySelector(q); return e && e.offsetParent !== null ? e : null; };
  const alert = seen('.sentence');
  if (alert && !alert.innerText.includes('Please wait')) return 'error: ' + alert.innerText;
  if (seen('.job')) return 'busy';
  const tab = name => [...document.querySelectorAll('[role=tab]')].find(t => t.innerText.includes(name));
  const fit = document.querySelector('[aria-label="Fit the linear model"]');
  if (Date.now() - (window.clicked ?? 0) < 4000) return 'waiting';
  if (fit && !fit.disabled) { window.clicked = Date.now(); fit.click(); return 'fit'; }
  if (document.querySelector('[data-verdict]')) { tab('Data').click(); return 'diagnosed'; }
  return 'waiting';
}"""
"""The next thing that a user who never rests would do."""


STILL = "export const Plotly = {newPlot(e) { e.on = () => {}; }, react() {}, Plots: {resize() {}}};"
"""In place of the library that draws."""
SCRIPT = "text/javascript"


@dataclass
class Soak:
    """What was seen."""

    sessions: int
    seconds: float
    answers: list[float] = field(default_factory=list)
    """Times in which the idle page was answered, s."""
    fits: int = 0
    diagnoses: int = 0
    errors: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    """Sessions that did not show their own work at the end."""

    def __str__(self) -> str:
        ordered = sorted(self.answers) or [float("nan")]
        return (
            f"{self.sessions} sessions for {self.seconds:.0f} s: {self.fits} fits and {self.diagnoses} diagnoses; "
            f"idle page asked {len(self.answers)} times: median {ordered[len(ordered) // 2]:.3f} s, 99 % within "
            f"{ordered[int(0.99 * (len(ordered) - 1))]:.3f} s, slowest {ordered[-1]:.3f} s (at most 1 s); "
            f"{len(self.lost)} lost, {len(self.errors)} errors"
        )


def soak(server: Served, browser: Any, place: Path, sessions: int, seconds: float, enough: float = math.inf) -> Soak:
    """Keep sessions at work for a time, or until so many diagnoses are done.

    Parameters
    ----------
    browser : Chromium of Playwright; its pages draw no figures, so that the server gets the processor.
    place : for recordings.
    """
    result = Soak(sessions, seconds)
    context = browser.new_context(viewport={"width": 800, "height": 600})
    context.route(re.compile("nicegui-plotly.*index.js"), lambda route: route.fulfill(body=STILL, content_type=SCRIPT))
    idle = opened(context, server)
    pages = []
    for i in range(sessions):
        page, run = opened(context, server), write(place / f"run{i:02d}.csv", i)
        area_for_files(page).set_input_files([str(run), str(run.with_suffix(".toml"))])
        pages.append((page, run.name))
    for page, _ in pages:
        page.get_by_role("button", name="Fit the linear model").wait_for(timeout=LONG)
    asking = subprocess.Popen(
        [sys.executable, str(IDLE_PAGE), HOST, str(server.port), idle.url.removeprefix(server.address)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    end = time.monotonic() + seconds
    while time.monotonic() < end and result.diagnoses < enough:
        for page, _ in pages:
            did = page.evaluate(STEP)
            result.fits += did == "fit"
            result.diagnoses += did == "diagnosed"
            if did.startswith("error"):
                result.errors.append(did)
        pages[0][0].wait_for_timeout(100)
    result.answers, wrong = json.loads(asking.communicate()[0])
    result.errors += wrong
    for page, name in pages:
        page.reload()
        page.locator(".file").wait_for(timeout=LONG)
        page.wait_for_function("name => document.querySelector('.file')?.innerText === name", arg=name, timeout=LONG)
        shown = page.locator("main .body").inner_text()
        if not shown or page.locator(".expired").count():
            result.lost.append(name)
    context.close()
    return result


def opened(context: Any, server: Served) -> Any:
    """A page on a fresh session."""
    page = context.new_page()
    page.goto(server.address, timeout=LONG)
    page.get_by_text("Drop a recording here").wait_for(timeout=LONG)
    return page
