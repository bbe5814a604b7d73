"""MATLAB files up to version 7: shapes of the variables first; structures and cells as a whole, for they have none."""

from __future__ import annotations

from itertools import starmap
from typing import Any

from scipy.io import matlab

from accelcal.io.decoding.source import Entry, Source, is_vector, limited, numbers, require_no_objects, vectors

_NUMERIC = {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}


def opened(path: str) -> Source:
    """Open a MAT file: each numeric vector is a column, named by its path (``run.X.Data``)."""
    require_no_objects(objects_in(path))
    declared = [(name, shape, kind) for name, shape, kind in matlab.whosmat(path) if not name.startswith("__")]
    inside = [name for name, _, kind in declared if kind in ("struct", "cell")]
    content = matlab.loadmat(path, variable_names=inside, simplify_cells=True) if inside else {}
    nested: dict[str, Any] = dict(vectors({name: content[name] for name in inside if name in content}))
    shapes = {
        name: shape
        for name, shape, kind in declared
        if kind in _NUMERIC and min(shape, default=0) >= 0 and is_vector(shape, "f") and max(shape) != 1
    }
    lengths = {name: int(max(shape)) for name, shape in shapes.items()}
    lengths |= {name: len(values) for name, values in nested.items()}

    def values_of(name: str) -> Any:
        return nested if name in nested else matlab.loadmat(path, variable_names=[name], simplify_cells=True)

    return Source(limited(starmap(Entry, lengths.items())), lambda name: numbers(values_of(name)[name]))


def objects_in(path: str) -> list[str]:
    """Names of the objects in a file: tables, timetables and the like, which SciPy lists as opaque."""
    try:
        matlab.whosmat(path)
    except TypeError:  # of SciPy, at an object whose shape it does not know
        content = matlab.loadmat(path)
        return [str(value["s0"][0].decode()) for value in content.values() if type(value).__name__ == "MatlabOpaque"]
    return []
