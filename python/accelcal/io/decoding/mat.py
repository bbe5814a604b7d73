"""MATLAB files up to version 7: shapes of the variables first; structures and cells as a whole, for they have none."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from scipy.io import matlab

from accelcal.io.decoding.source import Entry, Source, is_vector, limited, numbers, vectors
from accelcal.io.table import Column

_NUMERIC = {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}


def opened(path: str) -> Source:
    """Open a MAT file: each numeric vector is a column, named by its path (``run.X.Data``)."""
    declared = [(name, shape, kind) for name, shape, kind in matlab.whosmat(path) if not name.startswith("__")]
    inside = [name for name, _, kind in declared if kind in ("struct", "cell")]
    content = matlab.loadmat(path, variable_names=inside, simplify_cells=True) if inside else {}
    nested: dict[str, Any] = dict(vectors({name: content[name] for name in inside if name in content}))
    shapes = {
        name: shape
        for name, shape, kind in declared
        if kind in _NUMERIC and min(shape, default=0) >= 0 and is_vector(shape, "f") and max(shape) != 1
    }

    def entries() -> Iterator[Entry]:
        for name, shape, _ in declared:
            if name in shapes:
                yield Entry(name, int(max(shape)))
        for name, values in nested.items():
            yield Entry(name, len(values))

    def column(name: str) -> Column:
        if name in nested:
            return numbers(nested[name])
        return numbers(matlab.loadmat(path, variable_names=[name], simplify_cells=True)[name])

    return Source(limited(entries()), column)
