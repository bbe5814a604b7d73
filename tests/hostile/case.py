"""A case is a function of its section and its number, so that any failure is made again by naming both."""

from __future__ import annotations

import os
import zlib

import numpy as np

LONG = os.environ.get("ACCELCAL_HOSTILE") == "long"
"""Whether `make test-hostile` runs: every case, not a slice."""

FIRST = int(os.environ.get("ACCELCAL_HOSTILE_FIRST", "0"))
"""Number from which a long run is resumed."""


def case_rng(section: str, number: int) -> np.random.Generator:
    """Random numbers of one case."""
    return np.random.default_rng([zlib.crc32(section.encode()), number])


def cases(few: int, many: int) -> range:
    """Numbers of the cases to run: `few` in `make test-all`, `many` in `make test-hostile`, there from `FIRST` on."""
    return range(min(FIRST, many), many) if LONG else range(few)
