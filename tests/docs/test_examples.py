"""Every example of the pages runs as printed: `sh` and `python` blocks in the order of the page, in one folder."""

import os
import re
import shlex
import shutil
from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.cli import write_recording
from accelcal.simulation import CXL02_RIG
from tests.commands import accelcal, python

from .pages import DOCS, examples

ENVIRONMENT = os.environ | {"COLUMNS": "160"}
PAGES = (
    "loop",
    "your-data",
    "own-effect",
    "campaign",
    "live",
    "python",
    "stage",
    "shaker",
    "tumble-table",
    "structure",
    "motion-capture",
    "tracked-board",
)
"""Pages with examples that run. Blocks of other languages are output, files, or what a person starts (`bash`)."""
PRINTED = ("tracked-board",)
"""Pages on which a block of text is what the example before it prints."""
NUMBER = re.compile(r"[-−]?\d+(?:\.\d+)?")
DIFFERENCE = 0.1
"""Of a printed figure, relative, between machines: a fit stops at a hundredth of an uncertainty."""
ELSEWHERE = {
    "export": "calibration/export/test_command.py",
    "embedded": "firmware/test_page.py",
    "quick-start": "house/test_readme.py",
}
"""Pages whose examples are run by a test of what they are about."""
BY_HAND = {
    "quick-start": ["make demo", "make test"],
    "live": [
        "accelcal live --serial /dev/ttyUSB0 --baud 921600 --rig rig.toml -o today.parquet",
        "accelcal live --tcp 192.168.1.7:5025 --rig rig.toml --model m.json",
    ],
    "embedded": [
        "rustup target add thumbv7em-none-eabihf",
        "apt-get install qemu-system-arm binutils-arm-none-eabi",
        ".venv/bin/python -m tests.firmware.run",
    ],
    "security": ["pip-audit --strict -r constraints.txt --no-deps --disable-pip", "cargo audit"],
}
"""What these tests do not run: `.ci/run` and `make embedded` do, and rustup, devices and advisories are for other
machines."""


def prepare(page, folder):
    """Write the reader's own recordings, where a page is about them."""
    if page == "tracked-board":
        shutil.copytree(DOCS / "data", folder, dirs_exist_ok=True)
    if page != "your-data":
        return
    for name, mount in (("reversed", "reversed"), ("run12", "normal"), ("normal", "normal")):
        simulation = ac.simulate(
            "interleaved",
            seconds=70.0,
            rig=replace(CXL02_RIG, mount=mount),
            parameters={"bias": 0.05, "scale_factor": 0.01},
            rng=np.random.default_rng(len(name)),
        )
        sidecar = write_recording(simulation.recording, folder / f"{name}.csv")
        if name == "run12":
            sidecar.unlink()  # the page writes it
    for name, channel, header, late in (
        ("accel", simulation.recording.accel, "t_s,accel_m_per_s2", 37.2),
        ("encoder", simulation.recording.position, "t_s,position_m", 0.0),
    ):
        rows = np.column_stack([channel.t + late, channel.y])
        np.savetxt(folder / f"{name}.csv", rows, "%.9f", ",", header=header, comments="")


def run(example, folder):
    """Standard output of the last program that the example starts."""
    if example.file:
        (folder / example.file).write_text(example.text)
        return ""
    if example.language == "python":
        done = python("-c", example.text, cwd=folder, env=ENVIRONMENT, timeout=1500)
        assert done.returncode == 0, f"{example.text}: {done.stderr}"
    elif example.language == "sh":
        for line in filter(None, example.text.splitlines()):
            program, *arguments = shlex.split(line)
            assert program == "accelcal"
            done = accelcal(*arguments, cwd=folder, env=ENVIRONMENT, timeout=1500)
            assert done.returncode == 0, f"{line}: {done.stderr}"
    return done.stdout


def alike(printed, shown):
    """Whether two texts have the same words, and the same figures within the difference."""
    texts = [" ".join(text.split()) for text in (printed, shown)]
    if NUMBER.sub("#", texts[0]) != NUMBER.sub("#", texts[1]):
        return False
    first, second = ([float(x.replace("−", "-")) for x in NUMBER.findall(text)] for text in texts)
    return bool(np.allclose(first, second, rtol=DIFFERENCE, atol=0.0))


@pytest.mark.parametrize("page", PAGES)
def test_examples_run_in_the_order_of_the_page(page, tmp_path):
    prepare(page, tmp_path)
    runnable = [item for item in examples(page) if item.language in ("sh", "python") or item.file]
    assert runnable
    printed = ""
    for example in examples(page):
        if example in runnable:
            printed = run(example, tmp_path)
        elif example.language == "text" and page in PRINTED:
            assert alike(printed, example.text), printed


def test_a_figure_that_is_not_printed_is_found():
    assert alike("error  -27.0 mm/s² on x", "error -27.1 mm/s²\non x")
    assert not alike("error 27.0 mm/s² on x", "error 31.0 mm/s² on x")
    assert not alike("error 27.0 mm/s² on x", "error 27.0 mm/s² on y")


def test_every_command_on_a_page_is_run_here_or_listed_as_started_by_hand():
    for path in DOCS.glob("*.md"):
        by_hand = [
            line
            for example in examples(path.stem)
            if example.language in ("bash", "console")
            for line in example.text.splitlines()
        ]
        assert by_hand == BY_HAND.get(path.stem, []), path.name
        runs = {example.language for example in examples(path.stem)} & {"sh", "python"}
        assert not runs or path.stem in (*PAGES, *ELSEWHERE), f"{path.name} has examples that no test runs"
    for page, test in ELSEWHERE.items():
        assert f"{page}.md" in (DOCS.parent / "tests" / test).read_text(encoding="utf-8")


def test_an_example_that_fails_is_found(tmp_path):
    broken = next(e for e in examples("loop") if e.language == "sh")
    with pytest.raises(AssertionError, match="no-such-effect"):
        run(replace(broken, text="accelcal demo --effect no-such-effect\n"), tmp_path)
