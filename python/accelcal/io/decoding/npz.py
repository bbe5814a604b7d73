"""NumPy archives: headers of the members first, then the members that are asked for."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.io.decoding.source import RefusedError, Source, Stored, opened_arrays
from accelcal.io.table import MOST_COLUMNS

_SUFFIX = ".npy"
ALONE = "column"
"""Name of an array in a file of its own, which has none."""
_HEADERS: dict[tuple[int, int], Any] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
"""Version 3 serves names of fields that are not Latin-1, and is not read."""


def opened(path: str) -> Source:
    """Open an archive, or an array in a file of its own: a numeric vector is a column; see `parts` for other arrays."""
    with Path(path).open("rb") as file:
        archive = zipfile.ZipFile(path) if file.read(2) == b"PK" else None
    files = [info.filename for info in archive.infolist()] if archive else [ALONE + _SUFFIX]
    if len(files) > MOST_COLUMNS:
        raise RefusedError(f"it holds {len(files)} arrays, expected at most {MOST_COLUMNS}; save those of one run")

    def open_member(name: str) -> IO[bytes]:
        return archive.open(name + _SUFFIX) if archive else Path(path).open("rb")

    def arrays() -> Iterator[Stored]:
        for member in files:
            if member.endswith(_SUFFIX):
                name = member.removesuffix(_SUFFIX)
                size = archive.getinfo(member).file_size if archive else Path(path).stat().st_size
                with open_member(name) as file:
                    shape, dtype = _header(file, size)
                yield Stored("" if dtype.names and not archive else name, shape, dtype)

    def read(name: str) -> Any:
        with open_member(name) as file:
            return np.lib.format.read_array(file, allow_pickle=False)

    return opened_arrays(arrays(), read)


def _header(file: IO[bytes], size: int) -> tuple[tuple[int, ...], Any]:
    """Shape and type of the array that a member of `size` bytes holds; those of no column if it holds objects."""
    read_header = _HEADERS.get(np.lib.format.read_magic(file))
    if read_header is None:
        return (), np.dtype(object)
    shape, _, dtype = read_header(file)
    count = math.prod(shape)
    if not dtype.hasobject and (min(shape, default=0) < 0 or count * dtype.itemsize != size - file.tell()):
        raise AccelcalError(f"a header promises {count} numbers in {size} bytes")
    return shape, dtype
