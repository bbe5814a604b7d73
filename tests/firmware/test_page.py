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
    found = estimates(board)
    sigma = np.sqrt(found[:, 1])
    for at, truth in TRUTH.items():
        assert abs(found[at, 0] - truth) < 4.0 * sigma[at]  # one record: false alarms 4 x 6e-5
    printed = estimates(next(e.text for e in examples("embedded") if e.text.startswith("parameter")))
    assert np.all(np.abs(printed - found)[:, 0] < 0.01 * sigma)
    assert np.allclose(printed[:, 1], found[:, 1], rtol=1e-3, atol=0.0)
    rows = (tmp_path / "today.csv").read_text().splitlines()
    for at in (*range(20_000, 60_000, 1000), *range(70_000, 70_201)):  # forty outputs, and two hundred in a row
        t, _, position = rows[at].split(",")
        rows[at] = f"{t},,{position}"
    (tmp_path / "holes.csv").write_text("\n".join(rows) + "\n")
    over_holes = estimates(shell("./on-host < holes.csv").stdout)
    assert np.all(np.abs(over_holes - found)[:, 0] < sigma)
    assert shell("./on-host < run.csv | cmp - board.txt").returncode == 1  # another recording has other bits
