"""A temporary folder that is removed when its block ends; that of a killed process goes with the next one."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from accelcal._support import locks

LOCK = re.compile(r"accelcal-[0-9a-f]{24}\.lock")


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Give a new folder, for this user alone, in the folder for temporary files; a fork of this process leaves it.

    Raises
    ------
    OSError
        If there is no place for temporary files.
    """
    where = Path(tempfile.gettempdir())
    _sweep(where)
    lock, descriptor, owner = _free_name(where), None, os.getpid()
    try:
        while (descriptor := locks.create(lock, 0o600)) is None:
            lock = _free_name(where)
        lock.with_suffix("").mkdir(mode=0o700)
        yield lock.with_suffix("")
    finally:
        if os.getpid() == owner:
            shutil.rmtree(lock.with_suffix(""), ignore_errors=True)
            lock.unlink(missing_ok=True)
        if descriptor is not None:
            os.close(descriptor)


def _free_name(where: Path) -> Path:
    return where / f"accelcal-{locks.MACHINE}{os.urandom(8).hex()}.lock"


def _sweep(where: Path) -> None:
    """Remove folders whose process has ended."""
    for name in os.listdir(where):
        if LOCK.fullmatch(name) and locks.is_abandoned(where / name):
            shutil.rmtree((where / name).with_suffix(""), ignore_errors=True)
            (where / name).unlink(missing_ok=True)
