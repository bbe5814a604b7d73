"""Which reader opens a file: by its first bytes and its suffix."""

from __future__ import annotations

from pathlib import Path

from accelcal.data.recording import RecordingError
from accelcal.io.decoding.known_formats import FORMATS, MARKS, SUFFIXES
from accelcal.io.files import open_regular, shown
from accelcal.io.table import Table


def open_table(path: Path) -> Table:
    """Recognise the format of `path` from its first bytes, and open it.

    Raises
    ------
    RecordingError
        If the file is missing, no regular file, empty, of no known format, or of another format than its name says.
    """
    head = _first_bytes(path)
    found = next((name for name, mark in MARKS.items() if mark.match(head)), None)
    suffix = path.suffix.lower()
    if found not in _ALLOWED.get(suffix, {found}):
        raise RecordingError(_mismatch(path, head, found))

    from accelcal.io import containers, csv

    kind = found or _UNMARKED.get(suffix)
    return csv.open_csv(path) if kind is None else containers.open_container(path, kind)


def _allowed() -> dict[str, set[str | None]]:
    """The formats whose marks a file of each suffix may bear; None = no mark."""
    found: dict[str, set[str | None]] = {suffix: {None} for suffix in TEXTS}
    for each in FORMATS:
        for suffix in each.suffixes:
            found.setdefault(suffix, set()).update({each.name, None} if each.unmarked else {each.name})
    return found


TEXTS = (".csv", ".txt", ".tsv")
"""Endings of text tables."""
READABLE = (*TEXTS, *SUFFIXES)
"""Endings of all recordings."""
_ALLOWED = _allowed()
_UNMARKED = {suffix: each.name for each in FORMATS if each.unmarked for suffix in each.suffixes}
_HEAD = 1024


def _first_bytes(path: Path) -> bytes:
    try:
        with open_regular(path, "one recording file (CSV, Parquet, MAT, npz or HDF5)") as file:
            head = file.read(_HEAD)
    except FileNotFoundError:
        raise RecordingError(f"{shown(path)}: there is no such file; check the path.") from None
    if not head:
        raise RecordingError(f"{path}: the file is empty (0 bytes); record or copy it again.")
    return head


def _mismatch(path: Path, head: bytes, found: str | None) -> str:
    if found is not None:
        return f"{path}: the name ends in {path.suffix} but the content is {found}; rename the file."
    mark = head[:4].decode("latin-1").encode("unicode_escape").decode()
    return (
        f'{path}: the name ends in {path.suffix} but the file begins with "{mark}", which is not of that format; '
        "copy or export it again, or rename it."
    )
