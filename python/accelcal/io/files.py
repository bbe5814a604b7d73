"""Files: their kinds and sizes, the reader of each by first bytes and suffix, and columns known by their names."""

from __future__ import annotations

import hashlib
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from accelcal._support.errors import AccelcalError
from accelcal.data import RecordingError
from accelcal.io.decoding.known_formats import EXPORTERS, FORMATS, MARKS, SUFFIXES
from accelcal.io.table import Table


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
    with in_words(path, expected):
        status = os.stat(path)
    if not stat.S_ISREG(status.st_mode):
        kinds = {
            stat.S_IFDIR: "directory",
            stat.S_IFIFO: "pipe",
            stat.S_IFSOCK: "socket",
            stat.S_IFCHR: "device",
            stat.S_IFBLK: "device",
        }
        kind = kinds.get(stat.S_IFMT(status.st_mode))
        raise RecordingError(f"{shown(path)}: this is {f'a {kind}' if kind else 'no regular file'}; give {expected}.")
    if most is not None and status.st_size > most:
        raise RecordingError(f"{shown(path)}: {status.st_size} bytes, expected at most {most}; give {expected}.")
    with in_words(path, expected):
        return os.fdopen(os.open(path, _FLAGS), "rb")


_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
"""A pipe that took the place of a file in between is not waited for."""


@contextmanager
def in_words(path: Path, expected: str) -> Iterator[None]:
    """Refusals of the system, while a file is opened or read, as one sentence; arguments are those of `open_regular`.

    Raises
    ------
    FileNotFoundError
        If nothing is there.
    RecordingError
        Of any other reason, such as a disk that fails.
    """
    try:
        yield
    except (FileNotFoundError, AccelcalError):
        raise
    except (OSError, ValueError) as error:
        reason = (error.strerror or str(error)) if isinstance(error, OSError) else "no file can have this name"
        raise RecordingError(f"{shown(path)}: cannot be read ({reason}); give {expected}.") from None


def content_of(path: Path, expected: str, most: int) -> bytes:
    """All bytes of a regular file of at most `most` bytes; errors are those of `open_regular`."""
    with open_regular(path, expected, most) as file, in_words(path, expected):
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


def open_table(path: Path) -> Table:
    """Recognise the format of `path` from its first bytes, and open it.

    Raises
    ------
    RecordingError
        If the file is missing, no regular file, empty, of no known format, or of another format than its name says.
    """
    head = _first_bytes(path)
    format_name = next((name for name, mark in MARKS.items() if mark.match(head)), None)
    suffix = path.suffix.lower()
    foreign = (what for mark, what in EXPORTERS.items() if re.match(mark, head, re.DOTALL))
    if format_name in (None, "npz") and suffix not in SUFFIXES and (what := next(foreign, None)) is not None:
        raise RecordingError(f"{path}: this is {what}.")
    if format_name not in _ALLOWED.get(suffix, {format_name}):
        raise RecordingError(_mismatch(path, head, format_name))

    from accelcal.io import containers, csv

    kind = format_name or _UNMARKED.get(suffix)
    return csv.open_csv(path) if kind is None else containers.open_container(path, kind)


def _allowed() -> dict[str, set[str | None]]:
    """The formats whose marks a file of each suffix may bear; None = no mark."""
    names: dict[str, set[str | None]] = {suffix: {None} for suffix in TEXTS}
    for file_format in FORMATS:
        for suffix in file_format.suffixes:
            names.setdefault(suffix, set()).update(
                {file_format.name, None} if file_format.unmarked else {file_format.name}
            )
    return names


TEXTS = (".csv", ".txt", ".tsv", ".lvm")
"""Endings of text tables."""
READABLE = (*TEXTS, *SUFFIXES)
"""Endings of all recordings."""
_ALLOWED = _allowed()
_UNMARKED = {
    suffix: file_format.name for file_format in FORMATS if file_format.unmarked for suffix in file_format.suffixes
}
_HEAD = 1024
A_RECORDING = "one recording file (CSV, Parquet, MAT, npz or HDF5)"


def _first_bytes(path: Path) -> bytes:
    try:
        with open_regular(path, A_RECORDING) as file, in_words(path, A_RECORDING):
            head = file.read(_HEAD)
    except FileNotFoundError:
        raise RecordingError(f"{shown(path)}: there is no such file; check the path.") from None
    if not head:
        raise RecordingError(f"{path}: the file is empty (0 bytes); record or copy it again.")
    return head


def _mismatch(path: Path, head: bytes, marked: str | None) -> str:
    if marked is not None:
        return f"{path}: the name ends in {path.suffix} but the content is {marked}; rename the file."
    mark = head[:4].decode("latin-1").encode("unicode_escape").decode()
    return (
        f'{path}: the name ends in {path.suffix} but the file begins with "{mark}", which is not of that format; '
        "copy or export it again, or rename it."
    )


def digest_of(path: Path) -> str:
    """SHA-256 of a file, hex; of no more than it holds now, for some that the system makes up never end.

    Raises
    ------
    RecordingError
        If it is no regular file, or is not readable.
    """
    digest = hashlib.sha256()
    with open_regular(path, A_RECORDING) as file, in_words(path, A_RECORDING):
        left = os.fstat(file.fileno()).st_size
        while left > 0 and (part := file.read(min(left, 1_000_000))):
            digest.update(part)
            left -= len(part)
    return digest.hexdigest()
