"""Array types, real series and flags, and the stretch about a place at which flags hold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def stretch_about(flags: Flags, at: int) -> tuple[int, int]:
    """First and last index of the unbroken stretch of flags (n,) that hold about `at`, where one holds.

    Examples
    --------
    >>> stretch_about(np.array([True, False, True, True, False]), 3)
    (2, 3)
    """
    outside = np.flatnonzero(~flags)
    place = int(np.searchsorted(outside, at))
    first = int(outside[place - 1]) + 1 if place > 0 else 0
    last = int(outside[place]) - 1 if place < len(outside) else len(flags) - 1
    return first, last
