"""Take the pictures of the workbench in `docs/static`, as a user sees it at a desk, in Debian's Chromium.

.venv/bin/python docs/photograph_workbench.py
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

import accelcal as ac
from accelcal.cli import write_recording

PICTURES = Path(__file__).parent / "static"
PORT = 8799
CHROMIUM = "/usr/bin/chromium"
LONG = 120_000
"""ms; a loaded machine takes its time."""
COLOURS = 96
"""Of a picture: enough for a page with figures, and small."""


def main() -> None:
    """Serve the workbench, walk from the first screen to the verdict and beyond, and keep what is seen."""
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder, "run12.csv")
        truth = {"bias": 0.05, "scale_factor": 0.01, "cubic": 2e-3}
        rng = np.random.default_rng(12)
        simulation = ac.simulate("interleaved", seconds=40.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
        write_recording(simulation.recording, recording)
        command = [sys.executable, "-m", "accelcal", "app", "--no-browser", "--port", str(PORT)]
        server = subprocess.Popen(command, env=os.environ | {"ACCELCAL_STATE": folder})
        try:
            address = f"http://127.0.0.1:{PORT}/"
            wait_for(address)
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
                page = browser.new_page(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
                page.goto(address, timeout=LONG)
                walk(page, recording)
                browser.close()
        finally:
            server.terminate()
            server.wait()


def wait_for(address: str) -> None:
    """Wait until the server answers."""
    for _ in range(120):
        try:
            urllib.request.urlopen(address, timeout=1.0)
        except OSError:
            time.sleep(0.5)
        else:
            return
    raise SystemExit(f"{address} does not answer")


def walk(page: Page, recording: Path) -> None:
    """Drop, fit, read the verdict, add the effect; a picture of each."""
    page.get_by_text("Drop a recording here").first.wait_for(timeout=LONG)
    keep(page, "workbench-start")
    page.locator("input[type=file]").first.set_input_files([str(recording), str(recording.with_suffix(".toml"))])
    page.get_by_role("button", name="Fit the linear model", exact=True).first.wait_for(timeout=LONG)
    keep(page, "workbench-data")
    page.get_by_role("button", name="Fit the linear model", exact=True).first.click(timeout=LONG)
    page.locator("[data-verdict]").wait_for(timeout=LONG)
    keep(page, "workbench-verdict")
    page.get_by_role("button", name="Add cubic", exact=True).first.click(timeout=LONG)
    page.locator("[data-verdict=adequate]").wait_for(timeout=LONG)
    keep(page, "workbench-added")


def keep(page: Page, name: str) -> None:
    """One picture of the window, with few colours."""
    page.wait_for_timeout(2500)
    image = Image.open(io.BytesIO(page.screenshot())).convert("RGB").quantize(COLOURS)
    image.save(PICTURES / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
