"""Recordings of what is in memory: arrays and pandas DataFrames go the way of a file, and are checked as one."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from accelcal._support.arguments import HOW_TO, found
from accelcal.data import UNITS, Array, Recording, RecordingError, Reference, Rig, reference_among
from accelcal.data.recording import series
from accelcal.io import naming
from accelcal.io.assign import IN_MEMORY, discover, unit_of
from accelcal.io.loading import recording_of
from accelcal.io.sidecar import Sidecar
from accelcal.io.table import Column, Table

if TYPE_CHECKING:
    from pandas import DataFrame

ESSENTIAL = ("time", "accel", "position")


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
    columns = {"t": t, "accel": accel, reference: position, **side}
    if position_t is not None:
        columns["position_t"] = position_t
    stamps = units.get("t", "s")
    return from_columns(columns, {"position_t": stamps, **units, "t": stamps}, rig, name)


def from_dataframe(frame: DataFrame, *, units: Mapping[str, str] | None, rig: Rig | None, name: str) -> Recording:
    """See `accelcal.Recording.from_dataframe`."""
    if not all(hasattr(frame, key) for key in ("columns", "index", "attrs")):
        raise TypeError(
            f"from_dataframe: frame is a {type(frame).__name__}; expected a pandas DataFrame. "
            "Recording.from_arrays takes arrays"
        )
    require_kinds("from_dataframe", {} if units is None else units, rig)
    twice = [str(key) for key in frame.columns[frame.columns.duplicated()]]
    if twice:
        raise RecordingError(f'{name or "frame"}: two columns are called "{twice[0]}"; give each a name of its own')
    columns = {str(key): frame[key] for key in frame.columns}
    declared = dict(frame.attrs.get("units", {}) if units is None else units)
    for key in [key for key, column in columns.items() if getattr(column.dtype, "kind", "") in "OSUT"]:
        plain = naming.take_apart(key)
        if not (plain.suffix or plain.brackets or naming.role(plain.base) or key in declared):
            del columns[key]  # a remark, a label
    dated = [key for key, column in columns.items() if getattr(column.dtype, "kind", "") in "mM"]
    columns |= {key: index_in_seconds(frame.set_index(key).index) for key in dated}
    declared |= dict.fromkeys(dated, "s")
    if not any(naming.role(naming.take_apart(key).base) == "time" for key in columns):
        if type(frame.index).__name__ == "RangeIndex" and "t" not in declared and len(frame):
            raise RecordingError(
                f"{name or 'frame'}: no column for time; the columns are {', '.join(columns)}, and the index counts "
                'rows. Name one t, or say what the index is, as in units={"t": "s"}'
            )
        columns = {"t": index_in_seconds(frame.index), **columns}
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
        raise TypeError(f'{caller}: units is {found(units)}; expected a unit by column, as {{"accel": "g"}}')
    if not isinstance(rig, Rig | None):
        raise TypeError(f"{caller}: rig is {found(rig)}; {HOW_TO['Rig']}; a sidecar belongs to accelcal.load")


def index_in_seconds(index: Any) -> Any:
    """The index of a frame as stamps: numbers as they are, time deltas and dates in s, dates from the first.

    Dates with a time zone are instants, and go through UTC.
    """
    zoned = getattr(index, "tz", None) is not None and hasattr(index, "tz_convert")
    stamps = (index.tz_convert(None) if zoned else index).to_numpy()
    if stamps.dtype.kind == "M":
        stamps = stamps - stamps[:1]
    return stamps / np.timedelta64(1, "ns") * 1e-9 if stamps.dtype.kind == "m" else stamps


def from_columns(columns: Mapping[str, ArrayLike], units: Mapping[str, str], rig: Rig | None, name: str) -> Recording:
    """A recording of named columns.

    Parameters
    ----------
    columns : (n,) by name; NaN, masked or NA = not sampled.
    units : by name of the column.

    Raises
    ------
    RecordingError
        If a column or a unit is missing, unknown or of the wrong dimension, or the samples cannot be used.
    """
    where = name or "recording"
    numbers = {key: series(where, key, values) for key, values in columns.items()}
    unknown = [key for key in units if key not in columns and key != "position_t"]
    if unknown:
        raise RecordingError(f'{where}: units names "{unknown[0]}", but the columns are {", ".join(columns)}')

    given = {key: unit for key, unit in units.items() if key in columns}
    table = Table(
        Path(where),
        tuple(numbers),
        lambda names: {key: with_holes(numbers[key]) for key in names},
        lambda i: f"row {i}",
        given,
        IN_MEMORY,
    )
    require_roles(table, where)
    require_lengths(numbers, where)
    recording = recording_of(table, Sidecar(rig=Rig() if rig is None else rig), [])
    origin = replace(recording.origin, file="", given="")
    return replace(recording, name=name, digest=digest_of(numbers, given), origin=origin)


def with_holes(values: Array) -> Column:
    """A column with NaN where it was not sampled."""
    present = ~np.isnan(values)
    return Column(values, None if present.all() else present)


def require_roles(table: Table, where: str) -> None:
    """Refuse columns among which time, output or position, or the unit of one of them, is missing.

    Raises
    ------
    RecordingError
        Saying how to name it, and how to give its unit.
    """
    by_role = {channel: column for column, (channel, _) in reversed(discover(table).items())}
    for role in ESSENTIAL:
        if role == "position" and role not in by_role:
            role = reference_among(by_role) or role
        if role not in by_role:
            raise RecordingError(
                f"{where}: no column for {role}; the columns are {', '.join(table.columns)}. Name one "
                f"{'t' if role == 'time' else role}, or map its name before"
            )
        if by_role[role] not in table.units and not unit_of(table, by_role[role]):
            example = {"time": "s", "accel": "g", "position": "mm"}.get(role) or UNITS[role]
            raise RecordingError(
                f"{where}: {by_role[role]} has no unit; units are never guessed. Give it, as in "
                f'units={{"{by_role[role]}": "{example}"}}'
            )


def require_lengths(numbers: Mapping[str, Array], where: str) -> None:
    """Refuse columns that do not pair with their stamps.

    Raises
    ------
    RecordingError
        Naming both lengths.
    """
    common = next(key for key in numbers if naming.role(naming.take_apart(key).base) == "time")
    for key, values in numbers.items():
        clock = "position_t" if key in ("position", "position_t") and "position_t" in numbers else common
        if len(values) != len(numbers[clock]):
            raise RecordingError(
                f"{where}: {key} has {len(values)} values and {clock} has {len(numbers[clock])}; expected as many of "
                "each. A position with a clock of its own comes with position_t"
            )


def digest_of(numbers: Mapping[str, Array], units: Mapping[str, str]) -> str:
    """SHA-256 of columns and units, hex."""
    digest = hashlib.sha256(repr(sorted(units.items())).encode())
    for key, values in numbers.items():
        digest.update(key.encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
