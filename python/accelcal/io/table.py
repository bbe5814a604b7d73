"""A table of columns as it was read from a file, before any of them has a role or a unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array


@dataclass(frozen=True, slots=True)
class Column:
    """One column as it is in the file."""

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
    clocks: Mapping[str, str] = field(default_factory=dict)
    """Column of stamps by column name, where the file itself says which belong together."""
