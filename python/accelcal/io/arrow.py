"""pyarrow arrays from columns and back, by their buffers: its own conversions import pandas where that is installed."""

from __future__ import annotations

from typing import Any

import numpy as np

from accelcal.data.arrays import Array, Flags
from accelcal.io.table import Column


def column(cells: Any) -> Column:
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

    cells = _seconds(cells)
    if cells.type != pa.float64():
        cells = cells.cast(pa.float64(), safe=False)
    n, begin = len(cells), cells.offset
    if n == 0:
        return Column(np.zeros(0))
    bits, content = cells.buffers()
    values = np.frombuffer(content, np.float64, n, 8 * begin)
    if not cells.null_count:
        return Column(values)
    valid = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little")[begin : begin + n].astype(np.bool_)
    return Column(np.where(valid, values, np.nan), valid)


def cells_of(values: Array, missing: Flags) -> Any:
    """Make a pyarrow array of numbers, (n,), null where one is missing."""
    import pyarrow as pa

    bits = pa.py_buffer(np.packbits(~missing, bitorder="little"))
    return pa.Array.from_buffers(pa.float64(), len(values), [bits, pa.py_buffer(np.ascontiguousarray(values))])


def _seconds(cells: Any) -> Any:
    import pyarrow as pa
    from pyarrow import compute

    if pa.types.is_timestamp(cells.type):
        count = cells.cast(pa.timestamp("ns", cells.type.tz)).cast(pa.int64())
        given = count.drop_null()
        count = compute.subtract(count, given[0] if len(given) else 0)
    elif pa.types.is_duration(cells.type):
        count = cells.cast(pa.duration("ns")).cast(pa.int64())
    elif pa.types.is_integer(cells.type) or pa.types.is_floating(cells.type) or pa.types.is_decimal(cells.type):
        return cells
    else:
        raise pa.ArrowNotImplementedError(f"no numbers: {cells.type}")
    return compute.multiply(count.cast(pa.float64()), 1e-9)
