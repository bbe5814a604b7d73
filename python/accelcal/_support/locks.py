"""Locks that end with their process: who still works on a file? And temporary folders that hold one."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

DAY = 86400.0
"""Age after which a leftover is removed that no lock tells of, s."""
MACHINE = f"{zlib.crc32(os.uname().nodename.encode() if hasattr(os, 'uname') else b''):08x}"
"""Part of the names of files of this machine: the locks of another one may not be seen here."""


def create(path: Path, mode: int = 0o666) -> int | None:
    """Create a file that nobody else has, and lock it; return its descriptor, or None if it was swept meanwhile.

    A system without locks neither renames nor removes a file that is open: there the descriptor is that of no file.

    Raises
    ------
    OSError
        If it exists or cannot be made.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, mode)
    if fcntl is None:
        os.close(descriptor)
        return os.open(os.devnull, os.O_RDONLY)
    if try_lock(descriptor) is not False and _is_at(path, descriptor):
        return descriptor
    os.close(descriptor)
    return None


def take(path: Path) -> int | None:
    """Lock a file of this user that an ended process made with `create`; return its descriptor, or None if it lives on.

    None as well where that cannot be told: on a file system or a machine without locks, or of another user's file.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return None
    ours = hasattr(os, "getuid") and os.fstat(descriptor).st_uid == os.getuid()
    if ours and try_lock(descriptor) and _is_at(path, descriptor):
        return descriptor
    os.close(descriptor)
    return None


def try_lock(descriptor: int) -> bool | None:
    """Lock a file: True if that succeeded, False if it is locked, None if the file system knows no locks."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def is_abandoned(path: Path) -> bool:
    """Whether the process that made this file with `create` has ended; of another machine, whether it is a day old."""
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return False  # removed meanwhile, or of another user
    try:
        locked = try_lock(descriptor)
        old = time.time() - os.fstat(descriptor).st_mtime > DAY
    finally:
        os.close(descriptor)
    return old and locked is not False if MACHINE not in path.name or locked is None else locked


def _is_at(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


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
        while (descriptor := create(lock, 0o600)) is None:
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
    return where / f"accelcal-{MACHINE}{os.urandom(8).hex()}.lock"


def _sweep(where: Path) -> None:
    """Remove folders whose process has ended."""
    for name in os.listdir(where):
        if LOCK.fullmatch(name) and is_abandoned(where / name):
            shutil.rmtree((where / name).with_suffix(""), ignore_errors=True)
            (where / name).unlink(missing_ok=True)
