"""A table of columns as it was read from a file, and how much one may hold; no column has a role or a unit yet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array, Flags

if TYPE_CHECKING:
    from accelcal.data.recording import Channel, Finding

DATES = "dates alone"
"""The form of instants without a time of day."""
Order = Literal["DMY", "MDY"]
"""What comes first in a date that does not begin with its year: the day or the month."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column as it is in the file."""

    values: Array
    """(n,) in the unit of the file; meaningless where a cell is empty."""
    present: NDArray[np.bool_] | None = None
    """(n,) False where a cell is empty; None = no cell is."""
    origin: int | None = None
    """Where the values are dates: the instant from which they count, ns since 1970."""


def _no_texts(column: str) -> NDArray[np.str_]:
    """A file without columns of texts has none to read."""
    raise KeyError(column)


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
    clocks: Mapping[str, str | float] = field(default_factory=dict)
    """Column of stamps, or rate in Hz, by column name, where the file itself says which belong together."""
    stamps: Mapping[str, str] = field(default_factory=dict)
    """Columns that hold instants as texts, and the form of each; that of dates alone is `DATES`."""
    texts: frozenset[str] = frozenset()
    """Columns that hold neither numbers nor instants."""
    notes: list[Finding] = field(default_factory=list)
    """What was noticed in the rows that have been read so far."""
    orders: dict[str, Order] = field(default_factory=dict)
    """Order of day and month in a column of dates, where the user says it; set before it is read."""
    text: Callable[[str], NDArray[np.str_]] = _no_texts
    """Reads one of the columns of texts, (n,)."""


MOST_COLUMNS = 4096
"""Columns of a file; arrays, data sets and fields of a container count as columns."""
MOST_SAMPLES = 100_000_000
"""Samples of one column: 16 hours at 1667 Hz."""
FREE_NUMBERS = 20_000_000
"""Numbers in the columns that are used, in a file of any size. Beyond it a file holds at most one number per byte."""
MOST_NAME = 200
"""Characters of a column name that is looked at for a unit and a role."""
MOST_CHANNEL_NAME = 180
"""Characters of a channel's name; those of its effects are a little longer, and model files take 200."""
MOST_DEPTH = 32
"""Groups of HDF5 inside one another."""
SIDECAR_BYTES = 1_000_000
"""Size of a sidecar."""
MODEL_BYTES = 64_000_000
"""Size of a model file."""


def from_arrow(cells: Any) -> Column:
    """Take the numbers out of a pyarrow array; null means an empty cell, stamps become seconds from the first.

    Parameters
    ----------
    cells : pyarrow array of shape (n,): numbers, time stamps or durations.

    Raises
    ------
    pyarrow.ArrowNotImplementedError
        If they are none of these.
    """
    import pyarrow as pa

    cells, origin = _seconds(cells)
    if cells.type != pa.float64():
        cells = cells.cast(pa.float64(), safe=False)
    n, begin = len(cells), cells.offset
    if n == 0:
        return Column(np.zeros(0), origin=origin)
    bits, content = cells.buffers()  # conversions of pyarrow itself import pandas where that is installed
    values = np.frombuffer(content, np.float64, n, 8 * begin)
    if not cells.null_count:
        return Column(values, origin=origin)
    valid = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little")[begin : begin + n].astype(np.bool_)
    return Column(np.where(valid, values, np.nan), valid, origin)


def from_dates(stamps: NDArray[Any]) -> Column:
    """Dates or time deltas of NumPy (n,) as seconds, dates from the first; NaT means an empty cell.

    Examples
    --------
    >>> from_dates(np.array(["2026-05-12T14:03:27", "NaT", "2026-05-12T14:03:27.5"], dtype="datetime64[ms]")).values
    array([0. , nan, 0.5])
    """
    missing = np.isnat(stamps)
    count = stamps.astype(f"{stamps.dtype.kind}8[ns]").astype(np.int64)
    origin = int(count[~missing][0]) if stamps.dtype.kind == "M" and not missing.all() else None
    values = np.where(missing, np.nan, (count - (origin or 0)) * 1e-9)
    return Column(values, ~missing if missing.any() else None, origin)


def on_stamps(channel: Channel, t: Array) -> tuple[Array, Flags]:
    """A channel on stamps `t` (n,) s that hold its own: its values, and where it was sampled, (n,) each."""
    values, present = np.zeros(len(t)), np.zeros(len(t), dtype=bool)
    at = np.searchsorted(t, channel.t)
    values[at], present[at] = channel.y, True
    return values, present


def cells_of(values: Array, missing: Flags) -> Any:
    """Make a pyarrow array of numbers, (n,), null where one is missing."""
    import pyarrow as pa

    bits = pa.py_buffer(np.packbits(~missing, bitorder="little"))
    return pa.Array.from_buffers(pa.float64(), len(values), [bits, pa.py_buffer(np.ascontiguousarray(values))])


def _seconds(cells: Any) -> tuple[Any, int | None]:
    """Numbers as they are, stamps in s; and of dates the one from which they count, ns since 1970."""
    import pyarrow as pa

    if pa.types.is_integer(cells.type) or pa.types.is_floating(cells.type) or pa.types.is_decimal(cells.type):
        return cells, None
    from pyarrow import compute  # for stamps alone: it takes half as long to import as NumPy

    origin = None
    if pa.types.is_timestamp(cells.type):
        count = cells.cast(pa.timestamp("ns", cells.type.tz)).cast(pa.int64())
        given = count.drop_null()
        origin = given[0].as_py() if len(given) else None
        count = compute.subtract(count, origin or 0)
    elif pa.types.is_duration(cells.type):
        count = cells.cast(pa.duration("ns")).cast(pa.int64())
    else:
        raise pa.ArrowNotImplementedError(f"no numbers: {cells.type}")
    return compute.multiply(count.cast(pa.float64()), 1e-9), origin
