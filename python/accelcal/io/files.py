"""Files that are files: pipes, devices and folders are refused at once, and so is what is larger than it can be."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import IO, TypeVar

from accelcal.data.recording import RecordingError

Result = TypeVar("Result")


def open_regular(path: Path, expected: str, most: int | None = None) -> IO[bytes]:
    """Open a regular file to read it; links are followed.

    Parameters
    ----------
    expected : what to give in its place, for messages: "one recording file (CSV, ...)".
    most : largest size, bytes.

    Raises
    ------
    FileNotFoundError
        If nothing is there; its text is a sentence.
    RecordingError
        If it is a folder, a pipe, a device or a socket, has a name that no file can have, is not readable, or is too
        large.
    """
    found = _in_words(os.stat, path, expected)
    if not stat.S_ISREG(found.st_mode):
        kinds = {stat.S_IFDIR: "directory", stat.S_IFIFO: "pipe", stat.S_IFSOCK: "socket"}
        kinds |= {stat.S_IFCHR: "device", stat.S_IFBLK: "device"}
        kind = kinds.get(stat.S_IFMT(found.st_mode))
        raise RecordingError(f"{shown(path)}: this is {f'a {kind}' if kind else 'no regular file'}; give {expected}.")
    if most is not None and found.st_size > most:
        raise RecordingError(f"{shown(path)}: {found.st_size} bytes, expected at most {most}; give {expected}.")
    return os.fdopen(_in_words(lambda name: os.open(name, _FLAGS), path, expected), "rb")


_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
"""A pipe that took the place of a file in between is not waited for."""


def _in_words(ask: Callable[[Path], Result], path: Path, expected: str) -> Result:
    """What the system answers about a path; its refusals as one sentence."""
    try:
        return ask(path)
    except FileNotFoundError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
    except ValueError:
        reason = "its name has a zero byte"
    raise RecordingError(f"{shown(path)}: cannot be read ({reason}); give {expected}.")


def content_of(path: Path, expected: str, most: int) -> bytes:
    """All bytes of a regular file of at most `most` bytes; errors are those of `open_regular`."""
    with open_regular(path, expected, most) as file:
        content = file.read(most + 1)
    if len(content) > most:  # it has grown since
        raise RecordingError(f"{shown(path)}: more than {most} bytes; give {expected}.")
    return content


def is_there(path: Path) -> bool:
    """Whether anything has this name; False where no file can have it."""
    try:
        return path.exists()
    except (OSError, ValueError):  # longer than the system allows, or a zero byte
        return False


def shown(path: Path) -> str:
    """A path as messages show it: a name of thousands of characters is cut."""
    text = str(path).replace("\0", "\\0")
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


_SHOWN = 300
"""Characters of a path."""
