"""MATLAB files up to version 7: shapes of the variables first; structures and cells as a whole, for they have none."""

from __future__ import annotations

from itertools import starmap
from typing import Any

import numpy as np
from scipy.io import matlab

from accelcal.io.decoding.source import (
    IN_MATLAB,
    Entry,
    Part,
    Source,
    limited,
    numbers,
    parts,
    require_no_objects,
    vectors,
)
from accelcal.io.table import Column

_NUMERIC = {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}


def opened(path: str) -> Source:
    """Open a MAT file: each numeric vector is a column, named by its path (``run.X.Data``); see `parts`."""
    require_no_objects(objects_in(path))
    declared = [(name, shape, kind) for name, shape, kind in matlab.whosmat(path) if not name.startswith("__")]
    inside = [name for name, _, kind in declared if kind in ("struct", "cell")]
    content = matlab.loadmat(path, variable_names=inside, simplify_cells=True) if inside else {}
    nested: dict[str, Any] = dict(vectors({name: content[name] for name in inside if name in content}))
    plain: dict[str, tuple[str, Part]] = {
        part.name: (name, part)
        for name, shape, kind in declared
        if kind in _NUMERIC and min(shape, default=0) >= 0 and max(shape) != 1
        for part in parts(name, shape, np.dtype(np.float64), IN_MATLAB)
    }
    lengths = {name: int(part.length) for name, (_, part) in plain.items()}
    lengths |= {name: len(values) for name, values in nested.items()}

    def column(name: str) -> Column:
        if name in nested:
            return numbers(nested[name])
        variable, part = plain[name]
        return numbers(part.pick(matlab.loadmat(path, variable_names=[variable], simplify_cells=True)[variable]))

    return Source(limited(starmap(Entry, lengths.items())), column)


def objects_in(path: str) -> list[str]:
    """Names of the objects in a file: tables, timetables and the like, which SciPy lists as opaque."""
    try:
        matlab.whosmat(path)
    except TypeError:  # of SciPy, at an object whose shape it does not know
        content = matlab.loadmat(path)
        return [str(value["s0"][0].decode()) for value in content.values() if type(value).__name__ == "MatlabOpaque"]
    return []
