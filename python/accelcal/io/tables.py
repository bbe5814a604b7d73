"""A file as a table of named columns of numbers, whatever its format; what the columns mean is decided elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from accelcal.recording import Array, RecordingError


@dataclass(frozen=True, slots=True)
class Column:
    """One column as it stands in the file."""

    values: Array
    """(n,) in the unit of the file; meaningless where a cell is empty."""
    present: NDArray[np.bool_] | None = None
    """(n,) False where a cell is empty; None = no cell is."""


@dataclass(frozen=True, slots=True)
class Table:
    """A file that has been understood as far as its column names; the numbers are read on request."""

    path: Path
    columns: tuple[str, ...]
    """Names of the columns, in the order of the file."""
    read: Callable[[Sequence[str]], Mapping[str, Column]]
    """Reads the named columns."""
    row: Callable[[int], str]
    """Names the i-th row (from 0) as the user sees it in the file: "row 17"."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Unit by column name, where the file itself declares one."""
    units_from: str = "the column metadata"
    """Where `units` were found, for messages."""


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
