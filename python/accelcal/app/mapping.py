"""Mapping of columns to channels: a proposal from the file, and the sidecar for the user's choice."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import tomlkit

from accelcal import io
from accelcal.data import GRAVITY, GYROSCOPE, PLACE, QUATERNION, RecordingError, units
from accelcal.io.files import open_regular, open_table
from accelcal.io.sidecar import has_sidecar
from accelcal.io.table import SIDECAR_BYTES

NOT_USED = "not used"
ESSENTIAL = ("time", "accel", "position")
ORIENTATION = (GRAVITY, *GYROSCOPE, *PLACE, *QUATERNION)
"""What says how a body turns: gravity along the axis, a gyroscope, or place and attitude."""
UNKNOWN = "?"
ELECTRICAL = ("V", "count")
"""Units of an output that a scale turns into acceleration."""
FIRST_BYTES, FIRST_LINES, FIRST_WIDTH = 8192, 8, 120
"""How much of a text file is shown: bytes that are read, lines, characters of a line."""


@dataclass(frozen=True, slots=True)
class Choice:
    """Channel and unit assigned to one column of a file."""

    column: str
    channel: str
    """time, accel, position, a part of an orientation, a name chosen by the user, or `NOT_USED`."""
    unit: str
    """Empty where none is known."""


def columns_of(path: Path) -> tuple[str, ...]:
    """Names of the columns of a recording.

    Raises
    ------
    RecordingError
        If the file cannot be read as a table.
    """
    return open_table(path).columns


def text_of(path: Path, sidecar: str | None, template: str) -> str:
    """Current text of the sidecar: the user's, else the file next to the recording, else the template."""
    if sidecar is not None:
        return sidecar
    return text_in(io.sidecar_of(path)) if has_sidecar(path) else template


def text_in(sidecar: Path) -> str:
    """The text of a sidecar for people to see; what is not UTF-8 in it, and what is beyond the limit, is lost."""
    with open_regular(sidecar, "a sidecar (TOML)") as file:
        return file.read(SIDECAR_BYTES).decode("utf-8-sig", errors="replace")


def first_lines(path: Path) -> list[str]:
    """The first lines of a text file as they are; empty for the other formats."""
    if path.suffix.lower() not in (".csv", ".txt", ".tsv"):
        return []
    with open_regular(path, "a recording") as file:
        head = file.read(FIRST_BYTES).decode("utf-8-sig", errors="replace")
    return [line[:FIRST_WIDTH] for line in head.splitlines()[:FIRST_LINES]]


def choices(columns: Sequence[str], text: str, template: str) -> list[Choice]:
    """Assignment of each column by the sidecar; of a column that it does not mention, by the column's name and unit."""
    sources = _channels(text), _channels(template)
    options = []
    for column in columns:
        channel, unit = next(
            ((name, unit) for source in sources for name, (of, unit) in source.items() if of == column),
            (NOT_USED, ""),
        )
        options.append(Choice(column, channel, "" if unit == UNKNOWN else unit))
    return options


def _dimension(unit: str) -> str:
    """SI unit of a unit; empty where it is none."""
    return units.conversion(unit).si if unit and units.is_unit(unit) else ""


def unknown(options: Sequence[Choice], text: str) -> list[str]:
    """What must be said before the columns can be used, for people; empty where that is everything."""
    by_channel = {c.channel: c for c in options}
    open_points = []
    for channel in ESSENTIAL:
        choice = by_channel.get(channel)
        if choice is None:
            open_points.append(f"the column of {channel}")
        elif not choice.unit:
            open_points.append(f"the unit of {channel}")
    accel = by_channel.get("accel")
    if accel is not None and _dimension(accel.unit) in ELECTRICAL and not sensor_in(text).get("scale"):
        open_points.append("the scale of the sensor")
    return open_points


def sensor_in(text: str) -> dict[str, str]:
    """What a sidecar declares of the sensor, by key; empty where the text is no TOML."""
    declared = _read_table(text, "sensor").items()
    return {key: str(value) for key, value in declared if isinstance(value, str | int | float) and value != UNKNOWN}


def sidecar_from(
    text: str,
    chosen: Sequence[Choice],
    input_axis: str = "",
    maps: str = "",
    sensor: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """The sidecar with its columns as chosen; everything else in it stays, comments included.

    Parameters
    ----------
    text : the sidecar.
    chosen : what each column is.
    input_axis : of a body that turns: x, y, z, or three numbers with commas between them; empty: as the sidecar says.
    maps : what a quaternion turns into what; empty: as the sidecar says.
    sensor : values of ``[sensor]`` by key; an empty one leaves what the sidecar says.

    Raises
    ------
    RecordingError
        If two columns are the same channel, a quaternion has not all its columns or nothing says what it maps, or the
        text is no TOML.
    """
    used = [c for c in chosen if c.channel != NOT_USED]
    for i, choice in enumerate(used):
        twin = next((c for c in used[:i] if c.channel == choice.channel), None)
        if twin is not None:
            raise RecordingError(f'columns "{twin.column}" and "{choice.column}" are both {choice.channel}; keep one')
    try:
        document = tomlkit.parse(text)
    except (tomlkit.exceptions.ParseError, ValueError) as error:
        raise RecordingError(f"the sidecar is not valid TOML: {error}; correct that line") from None
    except RecursionError:
        raise RecordingError("the sidecar has brackets inside brackets too deep to read; write it flat") from None
    table = _table(document, "channels")
    quaternion = {c.channel: c.column for c in used if c.channel in QUATERNION}
    if quaternion and len(quaternion) < len(QUATERNION):
        missing = next(name for name in QUATERNION if name not in quaternion)
        raise RecordingError(f"no column is {missing}; an attitude needs {', '.join(QUATERNION)}")
    used = [c for c in used if c.channel not in QUATERNION]
    names = {c.channel for c in used} | ({"attitude"} if quaternion else set())
    for name in [n for n in table if n not in names and n != "rate"]:
        del table[name]
    if "time" in names and "rate" in table:
        del table["rate"]
    for choice in used:
        old = table.get(choice.channel)
        entries = {k: v for k, v in old.items() if k not in ("column", "unit")} if isinstance(old, dict) else {}
        entry = tomlkit.inline_table()
        entry["column"] = choice.column
        if choice.unit:
            entry["unit"] = choice.unit
        for key, value in entries.items():
            entry[key] = value
        table[choice.channel] = entry
    if quaternion:
        attitude = _table(table, "attitude")
        attitude["columns"] = [quaternion[name] for name in QUATERNION]
        maps = maps or attitude.get("maps", "")
        if not maps:
            raise RecordingError("say what the quaternion maps: sensor to ENU, or ENU to sensor")
        attitude["maps"] = maps
    if input_axis.strip():
        _table(document, "rig")["input_axis"] = _direction(input_axis.strip())
    for key, value in sensor.items():
        if value and value != sensor_in(text).get(key, ""):
            _table(document, "sensor")[key] = value
    return tomlkit.dumps(document)


def _table(holder: Any, name: str) -> Any:
    """The table called `name`, made where there is none."""
    table = holder.setdefault(name, tomlkit.table())
    if not isinstance(table, dict):
        raise RecordingError(f"the sidecar: {name} is no table; write [{name}] on a line of its own")
    return table


def _read_table(text: str, name: str) -> dict[str, Any]:
    """A table of a sidecar; empty where the text is no TOML, or has none."""
    try:
        table = tomllib.loads(text).get(name)
    except (ValueError, RecursionError):
        return {}
    return table if isinstance(table, dict) else {}


def _direction(text: str) -> str | list[float]:
    """An axis as the sidecar writes it."""
    if "," not in text:
        return text
    try:
        return [float(part) for part in text.strip("[] ").split(",")]
    except ValueError:
        raise RecordingError(f'input axis "{text}": expected x, y, z or three numbers such as 0, 0.6, 0.8') from None


def _channels(text: str) -> dict[str, tuple[str, str]]:
    """Column and unit by channel; empty where the text is no TOML."""
    table = _read_table(text, "channels")
    attitude = table.get("attitude", {})
    listed = attitude.get("columns") if isinstance(attitude, dict) else None
    columns = listed if isinstance(listed, list) else []
    return {
        name: (source["column"], str(source.get("unit", "")))
        for name, source in table.items()
        if isinstance(source, dict) and isinstance(source.get("column"), str)
    } | {name: (str(column), "") for name, column in zip(QUATERNION, columns, strict=False)}
