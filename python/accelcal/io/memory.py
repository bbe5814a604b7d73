"""Recordings of what is in memory: arrays and pandas DataFrames go the way of a file, and are checked as one."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from accelcal._support.arguments import HOW_TO, kind_of
from accelcal.data import UNITS, Array, Recording, RecordingError, Reference, Rig, reference_among
from accelcal.data.recording import series
from accelcal.io import naming
from accelcal.io.assign import IN_MEMORY, discover, unit_of
from accelcal.io.loading import recording_of
from accelcal.io.sidecar import Sidecar
from accelcal.io.table import Column, Table, from_dates

if TYPE_CHECKING:
    from pandas import DataFrame

ESSENTIAL = ("time", "accel", "position")
EXAMPLES = {**UNITS, "time": "s", "accel": "g", "position": "mm", "temperature": "degC"}
"""Unit that a message proposes, by role."""


def from_arrays(
    t: ArrayLike,
    accel: ArrayLike,
    position: ArrayLike,
    *,
    units: Mapping[str, str],
    rig: Rig | None,
    position_t: ArrayLike | None,
    side: Mapping[str, ArrayLike],
    name: str,
    reference: Reference,
) -> Recording:
    """See `accelcal.Recording.from_arrays`."""
    require_kinds("from_arrays", units, rig)
    if reference not in get_args(Reference):
        names = " or ".join(f'"{name}"' for name in get_args(Reference))
        raise RecordingError(f"from_arrays: reference is {kind_of(reference)}; expected {names}")
    columns, declared = {"t": t, "accel": accel, reference: position}, {"t": "s", **units}
    if position_t is not None:
        columns[f"{reference}_t"] = position_t
        declared[f"{reference}_t"] = declared.pop("position_t", declared["t"])
    if twice := [key for key in side if key in columns]:
        raise RecordingError(f'{name or "recording"}: side has "{twice[0]}", which is given already; rename it')
    return from_columns({**columns, **side}, declared, rig, name, tuple(side))


def from_dataframe(frame: DataFrame, *, units: Mapping[str, str] | None, rig: Rig | None, name: str) -> Recording:
    """See `accelcal.Recording.from_dataframe`."""
    if not all(hasattr(frame, key) for key in ("columns", "index", "attrs")):
        how = "Its to_pandas() makes one" if hasattr(frame, "to_pandas") else "Recording.from_arrays takes arrays"
        raise TypeError(f"from_dataframe: frame is {kind_of(frame)}; expected a pandas DataFrame. {how}")
    require_kinds("from_dataframe", {} if units is None else units, rig)
    for axis, labels in (("index", frame.index), ("columns", frame.columns)):
        if labels.nlevels > 1:
            raise RecordingError(
                f"{name or 'frame'}: {labels.nlevels} levels of {axis}, expected one. Take what is under one label, "
                f'as in frame.xs("run12", axis="{axis}"), or leave a level out as in frame.droplevel(0, axis="{axis}")'
            )
    twice = [str(key) for key in frame.columns[frame.columns.duplicated()]]
    if twice:
        raise RecordingError(f'{name or "frame"}: two columns are called "{twice[0]}"; give each a name of its own')
    columns = {str(key): frame[key] for key in frame.columns}
    declared = dict(frame.attrs.get("units", {}) if units is None else units)
    for key in [key for key, column in columns.items() if getattr(column.dtype, "kind", "") in "OSUT"]:
        plain = naming.take_apart(key)
        if not (plain.suffix or plain.brackets or naming.role(plain.base) or key in declared):
            del columns[key]  # a remark, a label
    if not has_clocks(columns):
        if type(frame.index).__name__ == "RangeIndex" and "t" not in declared and len(frame):
            raise RecordingError(
                f"{name or 'frame'}: no column for time; the columns are {', '.join(columns)}, and the index counts "
                'rows. Name one t, or say what the index is, as in units={"t": "s"}'
            )
        columns = {"t": frame.index, **columns}
        declared |= {} if frame.index.dtype.kind in "iuf" and "t" in declared else {"t": "s"}
    return from_columns(columns, declared, rig, name or str(frame.attrs.get("name", "")))


def require_kinds(caller: str, units: object, rig: object) -> None:
    """Refuse units that are no mapping, and a rig that is none.

    Raises
    ------
    TypeError
        Saying what was found and how to make one.
    """
    if not isinstance(units, Mapping):
        raise TypeError(f'{caller}: units is {kind_of(units)}; expected a unit by column, as {{"accel": "g"}}')
    if not isinstance(rig, Rig | None):
        raise TypeError(f"{caller}: rig is {kind_of(rig)}; {HOW_TO['Rig']}; a sidecar belongs to accelcal.load")


def has_clocks(names: Iterable[str]) -> bool:
    """Whether columns have stamps: all of them, or output and reference each its own."""
    columns = discover(table_of(dict.fromkeys(names, Column(np.empty(0))), {}, ""))
    clocked = {channel for channel, clock in columns.values() if clock}
    return common_clock(columns) is not None or {"accel", reference_among(clocked) or "position"} <= clocked


def common_clock(names: Iterable[str]) -> str | None:
    """The column of stamps of all columns that have none of their own; None where there is none."""
    return next((name for name in names if naming.role(naming.take_apart(name).base) == "time"), None)


def dates_of(values: ArrayLike) -> NDArray[Any] | None:
    """Dates or time deltas of any package as those of NumPy, dates with a time zone in UTC; None = they are none."""
    kind = getattr(getattr(values, "dtype", None), "kind", "")
    stamps = np.asarray(values, dtype=f"{kind}8[ns]" if kind in ("m", "M") else None)
    if stamps.dtype == object and stamps.ndim == 1:
        plain = [x.astimezone(UTC).replace(tzinfo=None) if getattr(x, "tzinfo", None) else x for x in stamps]
        sampled = [x for x in plain if x is not None]
        for kind, wanted in (("M", datetime), ("m", timedelta)):
            if sampled and all(isinstance(x, wanted) for x in sampled):
                stamps = np.array(plain, dtype=f"{kind}8[us]")
    return stamps if stamps.dtype.kind in "mM" and stamps.ndim == 1 else None


def from_columns(
    columns: Mapping[str, ArrayLike], units: Mapping[str, str], rig: Rig | None, name: str, side: Sequence[str] = ()
) -> Recording:
    """A recording of named columns.

    Parameters
    ----------
    columns : (n,) by name; NaN, NaT, masked or NA = not sampled. Dates count from the first of all.
    units : by name of the column; dates and time deltas need none.
    side : further channels that are asked for, and need a unit.

    Raises
    ------
    RecordingError
        If a column or a unit is missing, unknown or of the wrong dimension, or the samples cannot be used.
    """
    where = name or "recording"
    dates = {key: stamps for key, values in columns.items() if (stamps := dates_of(values)) is not None}
    read = {
        key: from_dates(dates[key]) if key in dates else with_holes(series(where, key, values))
        for key, values in columns.items()
    }
    unknown = [key for key in units if key not in columns]
    if unknown:
        raise RecordingError(f'{where}: units names "{unknown[0]}", but the columns are {", ".join(columns)}')

    given = {key: unit for key, unit in units.items() if key in columns} | dict.fromkeys(dates, "s")
    table = table_of(read, given, where)
    require_roles(table, where, side)
    require_lengths(table, read, where)
    recording = recording_of(table, Sidecar(rig=Rig() if rig is None else rig), [])
    origin = replace(recording.origin, file="", arguments="")
    return replace(recording, name=name, digest=digest_of(read, given), origin=origin)


def table_of(columns: Mapping[str, Column], units: Mapping[str, str], where: str) -> Table:
    """Columns in memory as the table that a file would be."""

    def read(names: Sequence[str]) -> dict[str, Column]:
        return {key: columns[key] for key in names}

    return Table(Path(where), tuple(columns), read, lambda i: f"row {i}", units, IN_MEMORY)


def with_holes(values: Array) -> Column:
    """A column with NaN where it was not sampled."""
    present = ~np.isnan(values)
    return Column(values, None if present.all() else present)


def require_roles(table: Table, where: str, side: Sequence[str]) -> None:
    """Refuse columns among which time, output or position, or the unit of one of them or of `side`, is missing.

    Raises
    ------
    RecordingError
        Saying how to name it, and how to give its unit.
    """
    by_role = {channel: column for column, (channel, _) in reversed(discover(table).items())}
    needed = {}
    for role in ESSENTIAL:
        if role == "position" and role not in by_role:
            role = reference_among(by_role) or role
        if role not in by_role:
            raise RecordingError(
                f"{where}: no column for {role}; the columns are {', '.join(table.columns)}. Name one "
                f"{'t' if role == 'time' else role}, or map its name before"
            )
        needed[role] = by_role[role]
    for role, column in {**needed, **dict(zip(side, side, strict=True))}.items():
        if not unit_of(table, column):
            raise RecordingError(
                f"{where}: {column} has no unit; units are never guessed. Give it, as in "
                f'units={{"{column}": "{EXAMPLES.get(role, "V")}"}}'
            )


def require_lengths(table: Table, columns: Mapping[str, Column], where: str) -> None:
    """Refuse columns that do not pair with their stamps.

    Raises
    ------
    RecordingError
        Naming both lengths.
    """
    common = common_clock(table.columns)
    for key, (channel, clock) in discover(table).items():
        stamps = clock.column if clock and clock.column else common
        if channel == "time" or stamps is None:
            continue
        if len(columns[key].values) != len(columns[stamps].values):
            raise RecordingError(
                f"{where}: {key} has {len(columns[key].values)} values and {stamps} has {len(columns[stamps].values)}; "
                "expected as many of each. A position with a clock of its own comes with position_t"
            )


def digest_of(columns: Mapping[str, Column], units: Mapping[str, str]) -> str:
    """SHA-256 of columns and units, hex."""
    digest = hashlib.sha256(repr(sorted(units.items())).encode())
    for key, column in columns.items():
        digest.update(f"{key}{'' if column.origin is None else column.origin}".encode())
        digest.update(np.ascontiguousarray(column.values).tobytes())
    return digest.hexdigest()
