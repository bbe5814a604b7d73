"""Locks that the operating system gives back when their process ends, however it ends: who still works on a file?"""

from __future__ import annotations

import os
import sys
import time
import zlib
from pathlib import Path

DAY = 86400.0
"""Age after which a leftover is removed that no lock tells of, s."""
MACHINE = f"{zlib.crc32(os.uname().nodename.encode() if sys.platform != 'win32' else b''):08x}"
"""Part of the names of files of this machine: the locks of another one may not be seen here."""


def create(path: Path, mode: int = 0o666) -> int | None:
    """Create a file that nobody else has, and lock it; return its descriptor, or None if it was swept meanwhile.

    Raises
    ------
    OSError
        If it exists or cannot be made.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, mode)
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
    ours = sys.platform != "win32" and os.fstat(descriptor).st_uid == os.getuid()
    if ours and try_lock(descriptor) and _is_at(path, descriptor):
        return descriptor
    os.close(descriptor)
    return None


def try_lock(descriptor: int) -> bool | None:
    """Lock a file: True if that succeeded, False if it is locked, None if the file system knows no locks."""
    if sys.platform == "win32":
        return None
    import fcntl

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
