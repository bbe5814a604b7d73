"""Parquet: the schema first, then one column at a time."""

from __future__ import annotations

import io
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from accelcal.io import naming
from accelcal.io.decoding.source import Entry, RefusedError, Source, limited
from accelcal.io.table import MOST_NAME, Column, from_arrow

NAMELESS_INDEX = "__index_level_0__"
"""What pandas calls the column of an index without a name."""


def _start_threads() -> None:
    """Start the threads by which Arrow reads files, by a small one: a process that is limited may start none."""
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    small = io.BytesIO()
    parquet.write_table(pa.table({"t": [0.0]}), small)
    parquet.ParquetFile(pa.PythonFile(small, mode="r")).read(use_threads=False)


_start_threads()


def opened(path: str) -> Source:
    """Open a file: the ``unit`` entry of a column's metadata is its unit, null means not sampled.

    The index of a pandas frame that has no name holds the stamps.
    """
    file = parquet.ParquetFile(path, page_checksum_verification=True)
    schema, rows = file.schema_arrow, file.metadata.num_rows
    timed = any(naming.role(naming.take_apart(name).base) == "time" for name in schema.names)
    dated = NAMELESS_INDEX in schema.names and _unit(schema.field(NAMELESS_INDEX)) == "s"
    stamps = {"t": NAMELESS_INDEX} if dated and not timed else {}
    shown = {stored: name for name, stored in stamps.items()}

    def column(name: str) -> Column:
        name = stamps.get(name, name)
        read = file.read(columns=[name], use_threads=False)
        try:
            return from_arrow(read.column(name).combine_chunks())
        except pa.ArrowNotImplementedError:
            raise RefusedError(f"holds {schema.field(name).type}, expected numbers; convert it first") from None

    return Source(limited(Entry(shown.get(entry.name, entry.name), rows, _unit(entry)) for entry in schema), column)


def _unit(entry: Any) -> str | None:
    """The unit that a column declares; of stamps s."""
    unit = (entry.metadata or {}).get(b"unit")
    stamps = pa.types.is_timestamp(entry.type) or pa.types.is_duration(entry.type)
    return unit.decode("utf-8", errors="replace")[:MOST_NAME] if unit else "s" if stamps else None
