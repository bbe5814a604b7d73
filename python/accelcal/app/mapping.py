"""Mapping of columns to channels: a proposal from the file, and the sidecar for the user's choice."""

from __future__ import annotations

import codecs
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import tomlkit

from accelcal import io
from accelcal.data import ANGLE, GRAVITY, GYROSCOPE, PLACE, QUATERNION, RecordingError, units
from accelcal.data.rig import CORNERED
from accelcal.io.dialect import decoded
from accelcal.io.files import open_regular, open_table
from accelcal.io.sidecar import UNKNOWN, has_sidecar
from accelcal.io.table import SIDECAR_BYTES

NOT_USED = "not used"
ESSENTIAL = ("time", "accel", "position")
ORIENTATION = (ANGLE, GRAVITY, *GYROSCOPE, *PLACE, *QUATERNION)
"""What says how a body turns: the angle of an arm, gravity along the axis, a gyroscope, or place and attitude."""
ON_ARM = {
    "rig.arm": ("Arm, from axle to sensor", "200 mm"),
    "rig.axle": ("Axle of the arm", "horizontal"),
    "rig.input_axis": ("Input axis on the arm", "radial"),
}
"""What must be declared beside an angle, by the path of its key: name of its field, and an example."""
ELECTRICAL = ("V", "count")
"""Units of an output that a scale turns into acceleration."""
NO_FILTER, OTHER_FILTER = "none", "as in the sidecar"
LOW_PASSES = (NO_FILTER, *CORNERED, OTHER_FILTER)
"""Kinds of a low-pass that the form knows; any other one is declared in the sidecar."""
LOW_PASS, RESOLUTION = "channels.accel.lowpass", "channels.position.resolution"
"""Where a sidecar has the low-pass of the output, and the resolution of the encoder."""
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
        head = file.read(FIRST_BYTES).removeprefix(codecs.BOM_UTF8)
    return [decoded(line)[:FIRST_WIDTH] for line in head.splitlines()[:FIRST_LINES]]


def choices(columns: Sequence[str], text: str, template: str) -> list[Choice]:
    """Assignment of each column by the sidecar; of a column that it does not mention, by the column's name and unit."""
    sources = channels(text), channels(template)
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
    moved = ANGLE if ANGLE in by_channel else ESSENTIAL[2]
    for channel in (*ESSENTIAL[:2], moved):
        choice = by_channel.get(channel)
        if choice is None:
            open_points.append(f"the column of {channel}")
        elif not choice.unit:
            open_points.append(f"the unit of {channel}")
    for channel, path, of in (("accel", "sensor.scale", "the sensor"), (moved, f"channels.{moved}.scale", moved)):
        choice = by_channel.get(channel)
        if choice is not None and _dimension(choice.unit) in ELECTRICAL and not declared(text, path):
            open_points.append(f"the scale of {of}")
    if ANGLE in by_channel:
        rig = _read_table(text, "rig")
        open_points += [key for key in ON_ARM if rig.get(key.removeprefix("rig."), UNKNOWN) == UNKNOWN]
    return open_points


def declared(text: str, path: str) -> str:
    """What a sidecar declares at a path of keys with dots between them; empty where that is no text or number."""
    *tables, key = path.split(".")
    holder: Any = _read_table(text, tables[0])
    for name in tables[1:]:
        holder = holder.get(name) if isinstance(holder, dict) else None
    value = holder.get(key) if isinstance(holder, dict) else None
    return str(value) if isinstance(value, str | int | float) and value != UNKNOWN else ""


@dataclass(frozen=True, slots=True)
class LowPassEntry:
    """The low-pass of the output as the form has it."""

    kind: str = NO_FILTER
    """One of `LOW_PASSES`."""
    corner: str = ""
    """Frequency with its unit."""
    order: str = ""
    """Of butterworth and bessel."""

    @classmethod
    def of(cls, text: str) -> LowPassEntry:
        """What a sidecar declares."""
        filters = _declared_low_pass(text)
        if filters is None:
            return cls()
        kind = filters.get("kind", "RC") if isinstance(filters, dict) else ""
        if kind not in CORNERED or "fc" not in filters or "rate" in filters:
            return cls(OTHER_FILTER)
        return cls(kind, str(filters["fc"]), str(filters.get("order", "")))

    def changed(self, text: str) -> dict[str, Any]:
        """What of it is new to a sidecar, for `sidecar_from`; a tolerance stays with its RC."""
        before = LowPassEntry.of(text)
        if self == before or self.kind == OTHER_FILTER:
            return {}
        if self.kind == NO_FILTER:
            return {LOW_PASS: ""}
        entry: dict[str, Any] = {"kind": self.kind, "fc": self.corner}
        if self.kind != "RC":
            entry["order"] = int(self.order) if self.order.isdecimal() else self.order
        elif before.kind == "RC":
            entry |= {key: value for key, value in _declared_low_pass(text).items() if key == "tolerance"}
        return {LOW_PASS: entry}


def _declared_low_pass(text: str) -> Any:
    """The low-pass of the output in a sidecar, as it stands there; None where there is none."""
    source = _read_table(text, "channels").get("accel")
    return source.get("lowpass") if isinstance(source, dict) else None


def sidecar_from(
    text: str,
    chosen: Sequence[Choice],
    input_axis: str = "",
    maps: str = "",
    changes: Mapping[str, Any] = MappingProxyType({}),
) -> str:
    """The sidecar with its columns as chosen; everything else in it stays, comments included.

    Parameters
    ----------
    text : the sidecar.
    chosen : what each column is.
    input_axis : of a body that turns: x, y, z, or three numbers with commas between them; empty: as the sidecar says.
    maps : what a quaternion turns into what; empty: as the sidecar says.
    changes : what else is declared anew, by the path of its keys with dots between them; "" declares it no more.

    Raises
    ------
    RecordingError
        If two columns are the same channel, a quaternion has not all its columns or nothing says what it maps, a
        channel is declared that no column is, or the text is no TOML.
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
        unit = {"unit": choice.unit} if choice.unit else {}
        table[choice.channel] = _inline({"column": choice.column, **unit, **entries})
    if quaternion:
        attitude = _table(table, "attitude")
        attitude["columns"] = [quaternion[name] for name in QUATERNION]
        maps = maps or attitude.get("maps", "")
        if not maps:
            raise RecordingError("say what the quaternion maps: sensor to ENU, or ENU to sensor")
        attitude["maps"] = maps
    if input_axis.strip():
        _table(document, "rig")["input_axis"] = _direction(input_axis.strip())
    for path, value in changes.items():
        *tables, key = path.split(".")
        if tables[0] == "channels" and tables[1] not in names:
            if value == "":
                continue
            raise RecordingError(f"{tables[1]}: its {key} is declared, but no column has this role; give it to one")
        holder = document
        for name in tables:
            holder = _table(holder, name)
        if value != "":
            holder[key] = _inline(value) if isinstance(value, dict) else value
        elif key in holder:
            del holder[key]
    return tomlkit.dumps(document)


def _table(holder: Any, name: str) -> Any:
    """The table called `name`, made where there is none."""
    table = holder.setdefault(name, tomlkit.table())
    if not isinstance(table, dict):
        raise RecordingError(f"the sidecar: {name} is no table; write [{name}] on a line of its own")
    return table


def _inline(values: Mapping[str, Any]) -> Any:
    """A table on one line."""
    table = tomlkit.inline_table()
    table.update(values)
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


def channels(text: str) -> dict[str, tuple[str, str]]:
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
