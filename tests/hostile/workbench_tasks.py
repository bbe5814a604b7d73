"""Work for a worker that goes wrong, or on."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

import accelcal
from accelcal.app.workers import Report


def sleep(note: Path, *, progress: Report) -> None:
    """Note the process and one that it starts, then work on without an end."""
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    note.with_suffix(".part").write_text(f"{os.getpid()} {child.pid}")
    note.with_suffix(".part").rename(note)
    progress(0.25)
    time.sleep(600.0)


def try_for_ever(formulas: object, *, progress: Report) -> None:
    """Note the process in the folder that it runs in, then evaluate a formula that never comes to an end."""
    Path("part").write_text(str(os.getpid()))
    Path("part").rename("note")
    while True:
        math.sqrt(2.0)


def die(number: int, *, progress: Report) -> None:
    """End by a signal, as a damaged file or the system that needs memory may do it."""
    os.kill(os.getpid(), number)
    time.sleep(600.0)


def leave(status: int, *, progress: Report) -> None:
    """End without an answer."""
    os._exit(status)


def swallow(*, progress: Report) -> int:
    """Take ten times the memory of the machine."""
    return len(np.ones(int(10 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 8)))


def fail(text: str, *, progress: Report) -> None:
    """Raise what the library raises."""
    raise ValueError(text)


def unsendable(*, progress: Report) -> Any:
    """Return what cannot be sent."""
    return threading.Lock()


class Odd(Exception):
    """An error that cannot be made again from its text."""

    def __init__(self, first: int, two: int) -> None:
        super().__init__(f"{first} and {two}")


def oddly(*, progress: Report) -> None:
    """Raise an error that cannot be sent as it is."""
    raise Odd(1, 2)


def speak(*, progress: Report) -> str:
    """Print among the answers."""
    print("a library prints this", flush=True)
    os.write(1, b"and writes this")
    return "heard"


def names(*, progress: Report) -> list[str]:
    """Effects of the catalogue that come from a user or a channel."""
    from accelcal.effects import BUILT_IN, CATALOGUE

    return sorted(set(CATALOGUE) - {effect.name for effect in BUILT_IN})


def foreign(*, progress: Report) -> float:
    """Raise what a library raises: no words for a user."""
    return math.sqrt(float("-1"))


def absent_file(*, progress: Report) -> None:
    """Raise what accelcal says of a file that is not there."""
    accelcal.load(Path("absent.csv"))
