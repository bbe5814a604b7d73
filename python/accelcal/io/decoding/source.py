"""What a reader of one container format offers: its columns by name, and the numbers of one of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from accelcal.io.limits import MOST_COLUMNS, MOST_DEPTH
from accelcal.io.table import Column


class RefusedError(Exception):
    """A file that is whole and yet not read; the text says what was found, what was expected and the next step."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One column, before its numbers are read."""

    name: str
    length: int
    """Samples."""
    unit: str | None = None
    """As the file declares it."""
    clock: str | None = None
    """The column with its stamps, where the file itself says which."""


@dataclass(frozen=True, slots=True)
class Source:
    """An open container."""

    entries: tuple[Entry, ...]
    column: Callable[[str], Column]
    """Reads one column by its name."""


def limited(entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """The entries of a file, unless there are too many of them."""
    found = []
    for entry in entries:
        found.append(entry)
        if len(found) > MOST_COLUMNS:
            raise RefusedError(
                f"it holds more than {MOST_COLUMNS} columns; expected a few, one per channel; export those that are "
                "needed to a file of their own"
            )
    return tuple(found)


def is_vector(shape: tuple[int, ...], kind: str) -> bool:
    """Whether an array is a vector of real numbers: of one axis at most longer than 1."""
    size = 1
    for length in shape:
        size *= length
    return kind in "fiub" and size == max(shape, default=0)


def vectors(content: Mapping[str, Any], prefix: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, vector) of each numeric vector inside nested mappings and lists."""
    if depth > MOST_DEPTH:
        raise RefusedError(f"structures lie more than {MOST_DEPTH} deep; expected vectors, one per channel")
    for name, value in content.items():
        path = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from vectors(value, f"{path}.", depth + 1)
        elif isinstance(value, list):
            yield from vectors({str(k): item for k, item in enumerate(value, start=1)}, f"{path}.", depth + 1)
        elif isinstance(value, np.ndarray) and is_vector(value.shape, value.dtype.kind):
            yield path, value.ravel()


def numbers(values: Any) -> Column:
    """A vector as a column; NaN means not sampled.

    Raises
    ------
    RefusedError
        If it is no vector of real numbers.
    """
    if not isinstance(values, np.ndarray) or not is_vector(values.shape, values.dtype.kind):
        raise RefusedError("is no vector of real numbers; export it as one")
    found = np.ascontiguousarray(values.ravel(), dtype=np.float64)
    missing = np.isnan(found)
    return Column(found, ~missing if missing.any() else None)
