"""MATLAB files up to version 7: shapes of the variables first; structures and cells as a whole, for they have none."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.io import matlab

from accelcal.io.decoding.source import Source, Stored, arrays_inside, opened_arrays, require_no_objects

_INDEX = "({1})"
"""Of a column, as MATLAB counts."""
_NUMERIC = {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}


def opened(path: str) -> Source:
    """Open a MAT file: each numeric vector is a column, named by its path (``run.X.Data``); see `parts`."""
    require_no_objects(objects_in(path))
    declared = [(name, shape, kind) for name, shape, kind in matlab.whosmat(path) if not name.startswith("__")]
    inside = [name for name, _, kind in declared if kind in ("struct", "cell")]
    content = matlab.loadmat(path, variable_names=inside, simplify_cells=True) if inside else {}
    nested = dict(arrays_inside({name: content[name] for name in inside if name in content}))
    arrays = [
        Stored(name, shape, np.dtype(np.float64))
        for name, shape, kind in declared
        if kind in _NUMERIC and min(shape, default=0) >= 0 and max(shape) != 1
    ]
    arrays += [Stored(name, array.shape, array.dtype) for name, array in nested.items()]

    def read(name: str) -> Any:
        if name in nested:
            return nested[name]
        return matlab.loadmat(path, variable_names=[name], simplify_cells=True)[name]

    return opened_arrays(arrays, read, _INDEX)


def objects_in(path: str) -> list[str]:
    """Names of the objects in a file: tables, timetables and the like, which SciPy lists as opaque."""
    try:
        matlab.whosmat(path)
    except TypeError:  # of SciPy, at an object whose shape it does not know
        content = matlab.loadmat(path)
        return [str(value["s0"][0].decode()) for value in content.values() if type(value).__name__ == "MatlabOpaque"]
    return []
