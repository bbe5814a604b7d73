"""A Parquet file that grows by row groups and is whole at any time, also after its writer was killed.

A Parquet file ends with a table of its row groups, so one that is being appended to cannot be read. Two copies take
turns: the one that nobody sees receives the new row groups and a new table, then takes the name of the other.
"""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from accelcal.data.arrays import Array
from accelcal.io.atomic import Part, named

if TYPE_CHECKING:
    import pyarrow as pa

_MAGIC = b"PAR1"
_END = 8
"""Bytes after the table: its length and the magic number."""
_SKIPPED = np.zeros(1 << 26, np.uint8)
"""Never read and never written: places in the file that are there already."""


class GrowingParquet:
    """Row groups appended to a file that any reader of Parquet may open at any time.

    Parameters
    ----------
    path : the file; what is there keeps its content until the first row group.
    units : unit by name of the column, in order. Columns are float64; NaN is written as null.

    Raises
    ------
    OSError
        If nothing can be written there, it is a pipe or a device, or the file system has no hard links. The text names
        it and says why.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "run.parquet")
    >>> with GrowingParquet(path, {"t": "s"}) as file:
    ...     file.append({"t": np.array([0.0, 1.0])})
    ...     file.append({"t": np.array([2.0])})
    >>> file.rows, path.stat().st_size == file.size
    (3, True)
    """

    def __init__(self, path: Path, units: Mapping[str, str]) -> None:
        import pyarrow as pa

        self.path = path
        self.rows, self.groups = 0, 0
        self.size = 0
        """Bytes of the file under its name."""
        self.broken = False
        """Whether an append failed or was cut short: copies and table may not match, and none can follow."""
        self._schema = pa.schema(
            [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in units.items()]
        )
        self._table: Any = None
        self._copies: list[_Copy] = []
        self._new = len(_MAGIC)
        """Where the next row group begins."""
        self._late = b""
        """What the copy that nobody sees lacks of the other."""

    def __enter__(self) -> Self:
        """Make both copies, unseen."""
        with named(self.path):
            try:
                for _ in range(2):
                    part = Part(self.path)
                    if part.straight:
                        raise OSError(errno.EINVAL, "it is a pipe or a device, and a recording grows in a file")
                    part.create()
                    self._copies.append(_Copy(part))
            except BaseException:
                self.close()
                raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def append(self, columns: Mapping[str, Array]) -> None:
        """Write a row group, after which the file under its name holds it; (n,) each, NaN where not sampled.

        Raises
        ------
        OSError
            If it cannot be written, or an earlier group could not; the file under its name is then as it was.
        """
        import pyarrow as pa

        if self.broken:
            raise OSError(errno.EIO, f"{self.path}: an earlier row group could not be written, so none can follow")
        self.broken = True  # until all of it is done
        values = {name: pa.array(y, mask=np.isnan(y)) for name, y in columns.items()}
        group, table = _encoded(pa.table(values, schema=self._schema), self._new)
        if self._table is None:
            self._table = table
        else:
            self._table.append_row_groups(table)
        hidden, seen = self._copies
        with named(self.path):
            hidden.grow(self._late + group, _footer(self._table))
            hidden.take(self.path)
        self._copies = [seen, hidden]
        self._late = group
        self._new += len(group)
        self.rows, self.groups = self.rows + len(next(iter(columns.values()))), self.groups + 1
        self.size = hidden.size
        self.broken = False

    def close(self) -> None:
        """Remove the copy that nobody sees; the file stays under its name."""
        for copy in self._copies:
            copy.part.discard()
        self._copies = []


class _Copy:
    """One of the two files."""

    def __init__(self, part: Part) -> None:
        self.part = part
        self.size = 0
        self._end = 0
        """Where the row groups end."""

    def grow(self, groups: bytes, footer: bytes) -> None:
        """Put row groups in the place of the table at the end, and a new table behind them."""
        with self.part.path.open("r+b") as file:
            content = groups + footer if self._end else _MAGIC + groups + footer
            file.seek(self._end)
            file.write(content)
            file.truncate()
            self.size = file.tell()
        self._end = self.size - len(footer)
        self.part.settle()

    def take(self, path: Path) -> None:
        """Become the file under this name, at once."""
        name = self.part.free_name()
        os.link(self.part.path, name)
        try:
            os.replace(name, os.path.realpath(path))
        except BaseException:
            name.unlink(missing_ok=True)
            raise


class _Sink(io.RawIOBase):
    """Keeps what is written beyond a place."""

    def __init__(self, start: int) -> None:
        self.kept = bytearray()
        self._skip = start

    def writable(self) -> bool:
        """A sink for `pyarrow`."""
        return True

    def write(self, content: Any) -> int:
        """Keep what lies beyond the start."""
        size = len(content)
        skipped = min(size, self._skip)
        self._skip -= skipped
        if skipped < size:
            self.kept += memoryview(content)[skipped:]
        return size


def _encoded(rows: pa.Table, start: int) -> tuple[bytes, Any]:
    """A row group as it lies in a file from the byte `start`, and the table of a file that held it alone.

    `pyarrow` counts places from where its writer began, so it is led over the bytes before; they are never touched.
    """
    import pyarrow as pa
    from pyarrow import parquet

    sink = _Sink(start)
    tables: list[Any] = []
    stream = pa.PythonFile(sink, mode="w")
    writer = parquet.ParquetWriter(
        stream,
        rows.schema,
        compression="zstd",
        use_dictionary=False,
        write_page_checksum=True,
        metadata_collector=tables,
    )
    while (ahead := start - stream.tell()) > 0:
        stream.write(_SKIPPED.data[: min(ahead, len(_SKIPPED))])
    writer.write_table(rows, row_group_size=max(1, rows.num_rows))
    writer.close()
    table = int.from_bytes(sink.kept[-_END : -_END // 2], "little")
    return bytes(sink.kept[: -_END - table]), tables[0]


def _footer(table: Any) -> bytes:
    """The end of a file with these row groups."""
    import pyarrow as pa

    whole = pa.BufferOutputStream()
    table.write_metadata_file(whole)
    return bytes(memoryview(whole.getvalue())[len(_MAGIC) :])
