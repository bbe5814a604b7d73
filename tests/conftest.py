"""Fixtures of all tests: a catalogue without the effects of other tests, and Debian's Chromium for pages."""

import os
import shutil
import signal
from pathlib import Path

import pytest

from accelcal.effects import CATALOGUE
from tests import tiers

CHROMIUM = shutil.which("chromium")
REQUIRED = os.environ.get("ACCELCAL_REQUIRE_BROWSER") == "1"
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]


def pytest_configure(config):
    """Let Ctrl-C be what it is in a terminal: who starts the tests in the background has it ignored, and children
    inherit that."""
    if folder := os.environ.get("ACCELCAL_DURATIONS"):
        config.pluginmanager.register(tiers.Stopwatch(Path(folder)))
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(config, items):
    config.unguarded = tiers.mark(items)
    config.dropped = set() if any("::" in name for name in config.args) else tiers.dropped(items)
    if share := os.environ.get("ACCELCAL_SLOW"):
        left_out = tiers.left_out(items, share)
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]


@pytest.fixture(scope="module", autouse=True)
def own_catalogue():
    """Forget, after each module, the effects that its tests registered: every later diagnosis would consider them."""
    before = dict(CATALOGUE)
    yield
    CATALOGUE.clear()
    CATALOGUE.update(before)


@pytest.fixture(scope="module")
def browser():
    """Return a browser; where none is installed the test is skipped with the cure, or fails if one is required."""
    if CHROMIUM is None:
        if REQUIRED:
            pytest.fail("chromium is required here (ACCELCAL_REQUIRE_BROWSER=1) and is not installed")
        reason = "chromium is not installed; apt-get install chromium to run the browser tests"
        print(reason)
        pytest.skip(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()
