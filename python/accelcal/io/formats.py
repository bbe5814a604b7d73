"""Which reader opens a file: by its first bytes and its suffix."""

from __future__ import annotations

from pathlib import Path

from accelcal.data.recording import RecordingError
from accelcal.io.table import Table


def open_table(path: Path) -> Table:
    """Recognise the format of `path` from its first bytes, and open it.

    Raises
    ------
    RecordingError
        If the file is missing, a directory, empty, of no known format, or of another format than its name says.
    """
    head = _first_bytes(path)
    found = _format_of(head)
    suffix = path.suffix.lower()
    if found not in _FORMATS.get(suffix, (found,)):
        raise RecordingError(_mismatch(path, head, found))

    from accelcal.io import containers, csv

    match found:
        case "Parquet":
            return containers.open_parquet(path)
        case "npz":
            return containers.open_npz(path)
        case "HDF5":
            return containers.open_hdf5(path)
        case "MAT v5":
            return containers.open_mat(path)
        case _:
            return containers.open_mat(path) if suffix == ".mat" else csv.open_csv(path)


_FORMATS: dict[str, tuple[str | None, ...]] = {
    ".csv": (None,),
    ".txt": (None,),
    ".tsv": (None,),
    ".parquet": ("Parquet",),
    ".npz": ("npz",),
    ".h5": ("HDF5",),
    ".hdf5": ("HDF5",),
    ".mat": ("MAT v5", "HDF5", None),  # v7.3 is HDF5; v4 has no mark of its own
}
"""The marks that a file of each suffix may begin with; None = no mark."""
_HEAD = 1024
_HDF5_MARK = b"\x89HDF\r\n\x1a\n"


def _first_bytes(path: Path) -> bytes:
    if path.is_dir():
        raise RecordingError(f"{path}: this is a directory; give one recording file (CSV, Parquet, MAT, npz or HDF5).")
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except FileNotFoundError:
        raise RecordingError(f"{path}: there is no such file; check the path.") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}).") from None
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
        return "MAT v5"
    return None


def _mismatch(path: Path, head: bytes, found: str | None) -> str:
    if found is not None:
        return f"{path}: the name ends in {path.suffix} but the content is {found}; rename the file."
    mark = head[:4].decode("latin-1").encode("unicode_escape").decode()
    return (
        f'{path}: the name ends in {path.suffix} but the file begins with "{mark}", which is not of that format; '
        "copy or export it again, or rename it."
    )
