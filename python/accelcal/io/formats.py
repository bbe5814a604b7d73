"""Which reader opens a file: by its first bytes and its suffix."""

from __future__ import annotations

from pathlib import Path

from accelcal.data.recording import RecordingError
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
    found = _format_of(head)
    suffix = path.suffix.lower()
    if found not in _FORMATS.get(suffix, (found,)):
        raise RecordingError(_mismatch(path, head, found))

    from accelcal.io import containers, csv

    if found is None and suffix != ".mat":
        return csv.open_csv(path)
    return containers.open_container(path, found or "MAT")


_FORMATS: dict[str, tuple[str | None, ...]] = {
    ".csv": (None,),
    ".txt": (None,),
    ".tsv": (None,),
    ".parquet": ("Parquet",),
    ".npz": ("npz",),
    ".h5": ("HDF5",),
    ".hdf5": ("HDF5",),
    ".mat": ("MAT", "HDF5", None),  # v7.3 is HDF5; v4 has no mark of its own
}
"""The marks that a file of each suffix may begin with; None = no mark."""
_HEAD = 1024
_HDF5_MARK = b"\x89HDF\r\n\x1a\n"


def _first_bytes(path: Path) -> bytes:
    try:
        with open_regular(path, "one recording file (CSV, Parquet, MAT, npz or HDF5)") as file:
            head = file.read(_HEAD)
    except FileNotFoundError:
        raise RecordingError(f"{shown(path)}: there is no such file; check the path.") from None
    if not head:
        raise RecordingError(f"{path}: the file is empty (0 bytes); record or copy it again.")
    return head


def _format_of(head: bytes) -> str | None:
    """Return the format that the first bytes mark; None when they mark none (text, or MAT v4)."""
    if head.startswith(b"PAR1"):
        return "Parquet"
    if head.startswith(b"PK\x03\x04"):
        return "npz"
    if head.startswith(_HDF5_MARK) or head[512:].startswith(_HDF5_MARK):  # MAT v7.3 puts a text of 512 bytes in front
        return "HDF5"
    if head.startswith(b"MATLAB 5.0 MAT-file"):
        return "MAT"
    return None


def _mismatch(path: Path, head: bytes, found: str | None) -> str:
    if found is not None:
        return f"{path}: the name ends in {path.suffix} but the content is {found}; rename the file."
    mark = head[:4].decode("latin-1").encode("unicode_escape").decode()
    return (
        f'{path}: the name ends in {path.suffix} but the file begins with "{mark}", which is not of that format; '
        "copy or export it again, or rename it."
    )
