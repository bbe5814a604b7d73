"""NumPy archives: headers of the members first, then the members that are asked for."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from typing import IO, Any

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.io.decoding.source import Entry, RefusedError, Source, is_vector, limited, numbers
from accelcal.io.table import MOST_COLUMNS, Column

_SUFFIX = ".npy"
_HEADERS: dict[tuple[int, int], Any] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
"""Version 3 serves names of fields that are not Latin-1, and no vector has fields."""


def opened(path: str) -> Source:
    """Open an archive: each numeric vector is a column."""
    archive = zipfile.ZipFile(path)
    members = {info.filename.removesuffix(_SUFFIX): info for info in archive.infolist()}
    if len(members) > MOST_COLUMNS:
        raise RefusedError(f"it holds {len(members)} arrays, expected at most {MOST_COLUMNS}; save those of one run")

    def entries() -> Iterator[Entry]:
        for name, info in members.items():
            if info.filename.endswith(_SUFFIX):
                with archive.open(info) as file:
                    length = _length(file, info.file_size)
                if length is not None:
                    yield Entry(name, length)

    def column(name: str) -> Column:
        with archive.open(members[name]) as file:
            return numbers(np.lib.format.read_array(file, allow_pickle=False))

    return Source(limited(entries()), column)


def _length(file: IO[bytes], size: int) -> int | None:
    """Samples of the vector that a member of `size` bytes holds; None if it holds something else."""
    read_header = _HEADERS.get(np.lib.format.read_magic(file))
    if read_header is None:
        return None
    shape, _, dtype = read_header(file)
    if not is_vector(shape, dtype.kind):
        return None
    length = max(shape, default=0)
    if length < 0 or length * dtype.itemsize != size - file.tell():
        raise AccelcalError(f"a header promises {length} numbers in {size} bytes")
    return int(length)
