"""Binary containers as tables: Parquet, NumPy archives, MATLAB files, HDF5."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from accelcal.data.recording import RecordingError
from accelcal.io import arrow
from accelcal.io.table import Column, Table


def open_parquet(path: Path) -> Table:
    """Open a Parquet file; the ``unit`` entry of a column's metadata is its unit, null means not sampled.

    Raises
    ------
    RecordingError
        If the file is truncated or damaged.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        schema = parquet.read_schema(path)
    except Exception as error:  # see _damaged
        raise _damaged(path, "Parquet", error) from None

    units = {}
    for entry in schema:
        declared = (entry.metadata or {}).get(b"unit")
        if declared:
            units[entry.name] = declared.decode("utf-8", errors="replace")
        elif pa.types.is_timestamp(entry.type) or pa.types.is_duration(entry.type):
            units[entry.name] = "s"

    def read(names: Sequence[str]) -> Mapping[str, Column]:
        columns = {}
        for name in names:  # one at a time: the peak stays at one column more than the result
            try:
                cells = (
                    parquet.read_table(path, columns=[name], page_checksum_verification=True).column(0).combine_chunks()
                )
                columns[name] = arrow.column(cells)
            except pa.ArrowNotImplementedError:
                raise RecordingError(
                    f'{path}: column "{name}" holds {schema.field(name).type}, expected numbers; convert it first.'
                ) from None
            except Exception as error:  # see _damaged
                raise _damaged(path, "Parquet", error) from None
        cells = None
        pa.default_memory_pool().release_unused()  # decoding buffers: more than the columns themselves
        return columns

    return Table(path, tuple(schema.names), read, _sample, units)


def open_npz(path: Path) -> Table:
    """Open a NumPy archive: each numeric vector is a column, NaN means not sampled.

    Raises
    ------
    RecordingError
        If the archive is damaged or holds no numeric vector.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            found = dict(_vectors({name: archive[name] for name in archive.files}))
    except Exception as error:  # see _damaged
        raise _damaged(path, "npz", error) from None
    return _table_of_vectors(path, found)


def open_mat(path: Path) -> Table:
    """Open a MATLAB file up to version 7: each numeric vector is a column, named by its path (``run.X.Data``).

    Raises
    ------
    RecordingError
        If the file is damaged or holds no numeric vector.
    """
    from scipy import io as scipy_io

    try:
        content = scipy_io.loadmat(path, simplify_cells=True)
    except Exception as error:  # see _damaged
        raise _damaged(path, "MAT", error) from None
    return _table_of_vectors(
        path, dict(_vectors({name: value for name, value in content.items() if not name.startswith("__")}))
    )


def open_hdf5(path: Path) -> Table:
    """Open HDF5 or MATLAB 7.3: each numeric data set that is a vector is a column, named by its path (``run/accel``).

    A ``unit`` or ``units`` attribute is its unit, NaN means not sampled.

    Raises
    ------
    RecordingError
        If h5py is not installed, or the file is damaged or holds no numeric vector.
    """
    try:
        import h5py
    except ImportError:
        raise RecordingError(
            f"{path}: this is HDF5 (or MATLAB 7.3), which needs h5py; install it with: pip install 'accelcal[hdf5]'"
        ) from None

    found: dict[str, Any] = {}
    units: dict[str, str] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub" and max(item.shape, default=0) == item.size:
            found[name] = item[()].ravel()
            declared = item.attrs.get("unit", item.attrs.get("units"))
            if declared is not None:
                units[name] = declared.decode() if isinstance(declared, bytes) else str(declared)

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except Exception as error:  # see _damaged
        raise _damaged(path, "HDF5", error) from None
    return _table_of_vectors(path, dict(_vectors(found)), units, "the data set's attributes")


def _damaged(path: Path, kind: str, error: Exception) -> RecordingError:
    """Say that a container cannot be read. Flipped bits make its library raise nearly anything, so all is caught."""
    reason = str(error).strip().splitlines()
    return RecordingError(
        f"{path}: this {kind} file is truncated or damaged ({reason[0] if reason else type(error).__name__}); "
        "copy or export it again."
    )


def _vectors(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, vector) of each numeric vector inside nested mappings and lists."""
    for name, value in content.items():
        path = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _vectors(value, f"{path}.")
        elif isinstance(value, list):
            yield from _vectors({str(k): item for k, item in enumerate(value, start=1)}, f"{path}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.size == max(value.shape, default=0):
            yield path, value.ravel()


def _table_of_vectors(
    path: Path, found: Mapping[str, Any], units: Mapping[str, str] | None = None, units_from: str = ""
) -> Table:
    if not found:
        raise RecordingError(f"{path}: the file holds no vector of numbers; expected one per channel.")

    def read(names: Sequence[str]) -> Mapping[str, Column]:
        columns = {}
        for name in names:
            values = np.ascontiguousarray(found[name], dtype=np.float64)
            missing = np.isnan(values)
            columns[name] = Column(values, ~missing if missing.any() else None)
        return columns

    return Table(path, tuple(found), read, _sample, units or {}, units_from)


def _sample(i: int) -> str:
    return f"sample {i + 1}"
