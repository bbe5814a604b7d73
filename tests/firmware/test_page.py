"""The ten commands of embedded.md: from a recording to a filter on the emulated board, with the bits of the host."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.docs.pages import examples

from .build import FIRMWARE

TRUTH = {0: 0.01, 1: 0.05, 3: 1e-3, 4: 1e-3}
"""Of the recordings of the page: scale_factor, bias, quadratic, cubic."""


def estimates(text: str) -> np.ndarray:
    """Estimates and variances of a program's lines, (parameters, 2)."""
    return np.array([line.split()[1:] for line in text.splitlines() if line[:2].isdigit()], float)


@pytest.mark.usefixtures("device_tools")
def test_the_ten_commands_end_with_the_same_bits_on_the_board(tmp_path: Path) -> None:
    commands = [example.text for example in examples("embedded") if example.language == "sh"]
    assert len("".join(commands).replace("\\\n", "").splitlines()) == 10
    (tmp_path / "firmware").symlink_to(FIRMWARE)
    places = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])

    def shell(text: str) -> subprocess.CompletedProcess[str]:
        command = ["bash", "-e", "-c", text]
        return subprocess.run(
            command,
            cwd=tmp_path,
            env=os.environ | {"PATH": places},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )

    done = shell("".join(commands))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "warning" not in done.stderr
    board = (tmp_path / "board.txt").read_text()
    result = estimates(board)
    sigma = np.sqrt(result[:, 1])
    for at, truth in TRUTH.items():
        assert abs(result[at, 0] - truth) < 4.0 * sigma[at]  # one record: false alarms 4 x 6e-5
    printed = estimates(next(e.text for e in examples("embedded") if e.text.startswith("parameter")))
    assert np.all(np.abs(printed - result)[:, 0] < 0.01 * sigma)
    assert np.allclose(printed[:, 1], result[:, 1], rtol=1e-3, atol=0.0)
    rows = (tmp_path / "today.csv").read_text().splitlines()
    for at in (*range(20_000, 60_000, 1000), *range(70_000, 70_201)):  # forty outputs, and two hundred in a row
        t, _, position = rows[at].split(",")
        rows[at] = f"{t},,{position}"
    (tmp_path / "holes.csv").write_text("\n".join(rows) + "\n")
    over_holes = estimates(shell("./on-host < holes.csv").stdout)
    assert np.all(np.abs(over_holes - result)[:, 0] < sigma)
    assert shell("./on-host < run.csv | cmp - board.txt").returncode == 1  # another recording has other bits


CALLS = """\
#ifndef CALLS
#define CALLS
#include <math.h>
#include <stdio.h>
#define TRACKER_PARAMETERS 1u
typedef int tracker_filter;
static float largest;
static void tracker_init(tracker_filter *f, float position) { *f = 0; printf("init %g\\n", (double)position); }
static int tracker_step(tracker_filter *f, float output, float position)
{
    *f += 1;
    largest = position > largest ? position : largest;
    printf("step %g %g\\n", (double)output, (double)position);
    return 0;
}
static int tracker_resume(tracker_filter *f, float position, uint32_t missed)
{
    *f = 0;
    printf("resume %g %u\\n", (double)position, missed);
    return !isfinite(position);
}
static int tracker_finite(const tracker_filter *f) { return *f > 0 && largest < 1e30f; }
static float tracker_estimate(const tracker_filter *f, unsigned i) { return (float)*f * (float)i; }
static float tracker_variance(const tracker_filter *f, unsigned i) { return (float)*f * (float)i; }
#endif
"""
"""A filter that says how it is called."""


@pytest.mark.outside
def test_eight_lost_outputs_are_held_and_the_ninth_begins_the_gap(tmp_path: Path) -> None:
    (tmp_path / "tracker.h").write_text(CALLS)
    build_it = ["cc", "-std=gnu99", "-Wall", "-Wextra", "-Werror", "-I.", str(FIRMWARE / "track.c"), "-o", "track"]
    subprocess.run(build_it, cwd=tmp_path, check=True)

    def calls(*rows: str, before: tuple[str, ...] = ()) -> list[str]:
        """Calls for rows of output and position, behind the first that has both."""
        text = "t,output,position\n" + "".join(f"0.1,{row}\n" for row in (*before, "1,2", *rows))
        done = subprocess.run(["./track"], cwd=tmp_path, input=text, capture_output=True, text=True, check=False)
        messages = [line for line in done.stdout.splitlines() if line.split()[0] in ("init", "step", "resume")]
        assert messages[:2] == ["init 2", "step 1 2"]
        assert done.returncode == any(line.startswith("resume inf") or line.endswith("e+30") for line in messages)
        return messages[2:]

    for lost in (0, 1, 8):
        assert calls(*[",3"] * lost, "4,5", "6,") == ["step 1 3"] * lost + ["step 4 5", "step 6 nan"]
    for lost in (9, 10, 201):
        gap = ["step 1 3"] * 8 + [f"resume 5 {lost - 8}", "step 4 5"]
        assert calls(*[",3"] * lost, "4,5", ",6") == [*gap, "step 4 6"]
    # A gap ends with both readings, and with none that the filter cannot hold.
    held = ["step 1 3"] * 8
    assert calls(*[",3"] * 9, "4,", ",5", "6,7") == [*held, "resume 7 3", "step 6 7"]
    assert calls(*[",3"] * 9, "4,1e300", "6,7") == [*held, "resume inf 1", "resume 7 2", "step 6 7"]
    assert calls("4,1e30", "6,7") == ["step 4 1e+30", "step 6 7"]  # a filter that has lost its numbers is no success
    # What is lost before the first row, or before an output that came, does not count.
    assert calls(",3", before=(",3",) * 10) == ["step 1 3"]
    assert calls(*[",3"] * 8, "1,5", *[",3"] * 8) == [*held, "step 1 5", *held]
