"""What an SQLite file holds, how a campaign is killed, and how often its runs were computed."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
from collections import Counter
from contextlib import closing
from pathlib import Path

from tests.campaign.tasks import CALLS


def contents(path: Path) -> str:
    """Every table and row as SQL."""
    with closing(sqlite3.connect(path)) as connection:
        return "\n".join(connection.iterdump())


def killed(store: Path, calls: Path, *, runs: int, seconds: float, after: int) -> None:
    """Start a campaign of W2 runs in a process of its own, and kill it once `after` of them are stored."""
    command = [sys.executable, "-m", "tests.campaign.child", str(store), str(runs), str(seconds)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | {CALLS: str(calls)}) as child:
        assert child.stdout is not None
        for line in child.stdout:
            if int(line) >= after:
                break
        child.send_signal(signal.SIGKILL)
        child.wait()
    if child.returncode != -signal.SIGKILL:
        raise RuntimeError(f"the campaign ended by itself ({child.returncode}) before {after} runs were stored")


def counted(calls: Path) -> Counter[str]:
    """How often each run was computed."""
    return Counter(calls.read_text().splitlines())
