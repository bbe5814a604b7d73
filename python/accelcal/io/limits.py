"""How much a file may hold: what is larger is refused in one sentence before it is read."""

from __future__ import annotations

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


def most_numbers(size: int) -> int:
    """Numbers in the columns that are used of a file of `size` bytes: what it may grow to in memory."""
    return FREE_NUMBERS + size
