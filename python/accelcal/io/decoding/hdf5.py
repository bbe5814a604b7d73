"""HDF5 and MATLAB 7.3: shapes first; what lies in another file is never opened."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from accelcal.io.decoding.source import RefusedError, Source, Stored, opened_arrays, require_no_objects
from accelcal.io.table import MOST_DEPTH, MOST_NAME


def opened(path: str) -> Source:
    """Open a file: each numeric vector is a column, named by its path (``run/accel``); see `parts` for other arrays."""
    file = h5py.File(Path(path).open("rb"), "r")  # noqa: SIM115  by this, and by no name, HDF5 reads: no other file opens

    here = (name for name in file if isinstance(file.get(name, getlink=True), h5py.HardLink))
    objects = [name for name in here if "MATLAB_object_decode" in file[name].attrs]
    require_no_objects([] if all(name.startswith("#") for name in objects) else objects)

    def read(name: str) -> Any:
        item = file[name]
        if item.external or item.is_virtual:
            raise RefusedError(
                "keeps its numbers in another file, which is not opened; expected the numbers in this file; "
                "copy the data set (h5repack, or h5py's file[name][()])"
            )
        return item[()]

    return opened_arrays(_arrays(file, "", 0, {_address(file)}), read)


def _arrays(group: Any, prefix: str, depth: int, addresses: set[int]) -> Iterator[Stored]:
    """Data sets below a group, each object once; links that are soft or lead to another file are not followed."""
    if depth > MOST_DEPTH:
        raise RefusedError(f"groups lie more than {MOST_DEPTH} deep; expected data sets, one per channel")
    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        item = group[name]
        address = _address(item)
        if address in addresses:
            continue
        addresses.add(address)
        if isinstance(item, h5py.Group):
            yield from _arrays(item, f"{prefix}{name}/", depth + 1, addresses)
        elif isinstance(item, h5py.Dataset) and item.shape is not None:
            yield Stored(f"{prefix}{name}", item.shape, item.dtype, _unit(item))


def _address(item: Any) -> int:
    """Where an object lies in its file, by which links to one object are known."""
    return int(h5py.h5o.get_info(item.id).addr)


def _unit(item: Any) -> str | None:
    """The ``unit`` or ``units`` attribute of a data set."""
    declared = item.attrs.get("unit", item.attrs.get("units"))
    if isinstance(declared, bytes):
        declared = declared.decode()
    return None if declared is None else str(declared)[:MOST_NAME]
