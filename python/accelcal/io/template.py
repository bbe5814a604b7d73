"""A first sidecar for a recording: filled with what its file states, the rest marked or commented out."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np

from accelcal.data import ANGLE, OUTPUTS, PLACE, QUATERNION, VELOCITY, RecordingError, median_step, units
from accelcal.io import naming
from accelcal.io.assign import (
    candidates,
    clock_text,
    columns_of,
    discover,
    parts_of_instant,
    unit_of,
)
from accelcal.io.atomic import atomic_write
from accelcal.io.dwell_tables import dwell_columns, is_dwell_table
from accelcal.io.files import open_table
from accelcal.io.sidecar import KEYS, UNKNOWN, sidecar_of, toml_key, toml_text
from accelcal.io.table import Table


def init(path: str | Path) -> str:
    """Write ``NAME.toml`` beside a recording file, and return its text.

    Raises
    ------
    RecordingError
        If the sidecar exists already, or the recording cannot be read.
    """
    target = sidecar_of(Path(path))
    if target.exists():
        raise RecordingError(f"{target}: there is a sidecar already; edit it, or remove it first.")
    text = template(path)
    atomic_write(target, text)
    return text


def template(path: str | Path) -> str:
    """Return the text of a commented sidecar, with columns, units and rates as far as the file states them.

    What must be added by hand is marked FILL IN; its value is ``"?"``, which `accelcal.io.loading` refuses.

    Raises
    ------
    RecordingError
        If the recording cannot be read.
    """
    path = Path(path)
    table = open_table(path)
    if is_dwell_table(table):
        return _of_dwells(table)
    assigned = discover(table)
    by_name = {column: channel for column, (channel, _) in assigned.items()}
    clocks = {column: clock.column for column, (_, clock) in assigned.items() if clock is not None and clock.column}
    alone = {column: channel for column, channel in by_name.items() if column not in {*clocks.values()}}
    copies = _copies(table)
    columns: dict[str, str | None] = {}
    roles = naming.orientation_roles(table.columns)
    outputs = OUTPUTS.values() if {*OUTPUTS.values()} <= {*roles} else ()
    tracked = {*QUATERNION} <= {*roles} and "accel" not in by_name.values()
    tracked = tracked and bool(outputs or not candidates(table, "accel"))  # the outputs may be of another logger
    for name in ("time", *outputs, *PLACE) if tracked else ("time", "accel", "position"):
        called = next((column for column, channel in alone.items() if channel == name), None)
        turned = next(filter(partial(_is_angle, table), alone), None)
        if name == "position" and turned and not called and not candidates(table, name):
            columns[ANGLE] = turned
            continue
        columns[name] = roles.get(name) or called or _only(table, name, {*columns.values(), *clocks.values(), *copies})
        speeds = [column for column in alone if name == "position" and _dimension(table, column) == "m/s"]
        if columns[name] is None and len(speeds) == 1:
            del columns[name]
            columns[VELOCITY] = speeds[0]
    turning = {column: role for role, column in roles.items() if role and column not in columns.values()}
    if (parts := parts_of_instant(table, columns["time"])) is not None:
        columns["time"] = parts.column
    taken = {*columns.values(), *clocks.values(), *(columns_of(parts) if parts else ())}
    others = [column for column in dict.fromkeys(table.columns) if column not in taken and column not in copies]
    others = [column for column in others if turning.get(column) not in QUATERNION]
    channels = [
        (column is None and _elsewhere(table, name, others))
        or _required(table, name, column, clocks, called=name in (ANGLE, by_name.get(column or "")) or name in roles)
        for name, column in columns.items()
    ]
    if parts is not None:
        channels[0] = f"time = {clock_text(parts)}"
    quaternion = ", ".join(toml_text(roles.get(name, name)) for name in QUATERNION)
    maps = '"?"                      # FILL IN "sensor to ENU" or' if tracked else '"sensor to ENU"      # or'
    attitude = f'[channels.attitude]\ncolumns = [{quaternion}]\nmaps = {maps} "ENU to sensor"'
    missing = [name for name, column in columns.items() if column is None]
    likely = {column for name in missing for column, _ in candidates(table, name)}
    likely |= {column for column in others if "position" in missing and _dimension(table, column) == "V"}
    warm = None if "temperature" in by_name.values() else _only(table, "temperature", {*columns.values(), *copies})
    lines, keys = [f"# {column} is a copy of {copies[column]}" for column in copies if column not in taken], {*columns}
    for column in others:
        usual = "temperature" if column == warm else turning.get(column) or by_name[column]
        key = next(key for k in count(1) if (key := usual if k == 1 else f"{usual}_{k}") not in keys)
        keys.add(key)
        lines.append(_optional(table, column, key, clocks, column in likely or key == ANGLE))
    text = _TEXT.replace("[rig]\n", f"[rig]\n{_ON_ARM}") if ANGLE in columns else _TEXT
    text = re.sub("^KEYS (.*)$", _examples, text, flags=re.MULTILINE)
    if _dimension(table, columns.get("accel", columns.get("accel_x"))) in ("V", "count"):
        text = re.sub("^# scale .*$", _SCALE_NEEDED, text, flags=re.MULTILINE)
    text = text.replace("NAME", path.name).replace(
        "ATTITUDE", attitude if tracked else re.sub("^", "# ", attitude, flags=re.MULTILINE)
    )
    return text.replace("CHANNELS", "\n".join(channels + lines))


def _of_dwells(table: Table) -> str:
    """The text of the sidecar of a table of dwells."""
    mean = dwell_columns(table)["mean"]
    text = re.sub("^KEYS (.*)$", _examples, _DWELLS, flags=re.MULTILINE)
    if _dimension(table, mean) in ("V", "count"):
        text = re.sub("^# scale .*$", _SCALE_NEEDED, text, flags=re.MULTILINE)
    line = _required(table, "accel", mean, {}, called=True)
    return text.replace("NAME", table.path.name).replace("CHANNELS", line)


def _examples(asked: re.Match[str]) -> str:
    """Examples of the keys of a table, a line each, commented out."""
    keys = {key: entry for key, entry in KEYS[asked[1]].items() if entry.example}
    return "\n".join(
        f"{f'# {key} = {entry.example}':32}{'# ' * bool(entry.note)}{entry.note}".rstrip()
        for key, entry in keys.items()
    )


_TEXT = """\
# Declarations for NAME: sensor, rig and columns. Lines marked FILL IN need you;
# lines that begin with # are examples of what else can be declared.
[sensor]
KEYS sensor

[rig]
KEYS rig

[clock]
KEYS clock

[channels]                      # accel may add: lowpass = { kind = "RC", fc = "159 Hz", tolerance = 0.0 }
                                # position may add: resolution = "1 um", noise = "2 um", u_scale = 1e-4, and its own
                                # time = { column = "...", unit = "s" }; any channel in V or counts: scale and zero, as
                                # in { column = "lvdt", unit = "V", scale = "20 V/m", zero = "2.5 V" }
CHANNELS

# Can the body turn? Then gravity along the axis changes. Declare one of three, or the scale factor is not the sensor's:
# what an ideal accelerometer on the axis reads at rest, in [channels]:
#   gravity_along_axis = { column = "...", unit = "m/s^2" }
# a gyroscope, in [channels], right-handed, in the axes that [rig] input_axis means:
#   gyr_x = { column = "...", unit = "rad/s" }, and gyr_y and gyr_z
# a reference that tracks place and attitude: position_e, position_n and position_u in [channels], no position, and
ATTITUDE

[uncertainty]                   # standard uncertainties, for the budget
KEYS uncertainty

[judge]
KEYS judge
"""
_DWELLS = """\
# Declarations for NAME, a table of dwells. Lines marked FILL IN need you;
# lines that begin with # are examples of what else can be declared.
[sensor]
KEYS sensor

[channels]
CHANNELS

[dwell]
# angle_std = "2 arcsec"        # standard uncertainty of each angle; without it the angles are exact
# gravity = "9.80665 m/s^2"     # local gravity, to which the scale factor is relative

[uncertainty]                   # standard uncertainties
# level = "0.001 deg"           # of the zero of the dividing head
"""
_ON_ARM = """\
arm = "?"                       # FILL IN the distance from the axle to the sensor, like "200 mm"
axle = "?"                      # FILL IN "horizontal", "vertical" or an elevation, like "30 deg"
input_axis = "?"                # FILL IN "radial", "tangential", "axial" or a unit vector of these three
"""
_SCALE_NEEDED = 'scale = "?"                     # FILL IN, like "0.25 V/g" or "1024 count/g"'
_UNITS = {
    "time": "s, ms, us",
    "accel": "m/s^2, g, mg, V, count",
    "position": "m, mm, um, V, count",
    ANGLE: "deg, rad, rev, count",
}
_SCALES = {"position": '"20 V/m" or "200 count/mm"', ANGLE: '"4096 count/rev"'}


def _unit(table: Table, column: str) -> str | None:
    unit = unit_of(table, column)
    return unit if units.is_unit(unit) else None


def _dimension(table: Table, column: str | None) -> str | None:
    unit = _unit(table, column) if column is not None else None
    return units.conversion(unit).si if unit is not None else None


def _is_angle(table: Table, column: str) -> bool:
    """Whether a column is the angle of an arm by its name, and by its unit where an encoder may read a length."""
    base, measured = naming.take_apart(column).base.lower(), _dimension(table, column)
    return base in naming.ENCODERS if measured == "rad" else base in naming.ANGLES and measured in (None, "count")


def _only(table: Table, name: str, others: Collection[str | None]) -> str | None:
    """The column that is alone in measuring what a channel does, for a position else in counts; None where none or
    several do."""
    likely = [column for column, _ in candidates(table, name) if column not in others]
    if name == "accel" and len(likely) > 1 and not candidates(table, "position"):
        likely = [c for c in likely if _dimension(table, c) != "count"]  # which is then the position
    if name == "position" and not likely:
        likely = [c for c in table.columns if c not in others and _dimension(table, c) == "count"]
    return likely[0] if len(likely) == 1 else None


def _copies(table: Table) -> dict[str, str]:
    """Columns of numbers that repeat one before them exactly, and which."""
    names = [name for name, times in Counter(table.columns).items() if times == 1 and name not in table.texts]
    if len(names) > _MOST_COMPARED:
        return {}
    try:
        read = table.read(names)
    except RecordingError:  # it is told when the columns are used
        return {}
    first: dict[bytes, str] = {}
    copies = {}
    for name in names:
        content = read[name].values.tobytes()
        if first.setdefault(content, name) != name and len(np.unique(read[name].values)) > _FEWEST_VALUES:
            copies[name] = first[content]
    return copies


_MOST_COMPARED = 64
"""Columns that are compared with each other."""
_FEWEST_VALUES = 2
"""Different values of a column of which another one is a copy; what never moves is alike by chance."""


def _required(table: Table, name: str, column: str | None, clocks: Mapping[str, str], *, called: bool) -> str:
    if column is None:
        if name == "time" and table.clocks:
            return "# time: the columns below have stamps of their own in this file"
        rate = ', or in its place: rate = "1667 Hz"' if name == "time" else ""
        return f'{name} = {{ column = "{UNKNOWN}", unit = "{UNKNOWN}" }}  # FILL IN: one of the columns below{rate}'
    unit = _unit(table, column)
    volts = name in _SCALES and _dimension(table, column) in units.ELECTRICAL
    scale = f', scale = "{UNKNOWN}"' if volts else ""
    line = f"{name} = {_source(table, column, unit, clocks, scale)}"
    notes = [] if unit else [f"FILL IN the unit: {_UNITS[name.partition('_')[0]]}"]
    notes += [f"FILL IN the scale, like {_SCALES[name]}"] if volts else []
    if not called:
        notes.append("by its unit alone: check that it is this one")
    if name == "time":
        with np.errstate(all="ignore"):  # stamps that are not finite are shown as they are
            notes.append(_clock_note(table, column, unit))
    return f"{line}  # {'; '.join(notes)}" if notes else line


def _elsewhere(table: Table, name: str, others: Collection[str]) -> str:
    """A comment on an output or a position that no column measures; empty where one may, or for another channel."""
    lacking = {"accel": f"accelcal check OUTPUT --position {table.path.name}", "position": "--position READINGS"}
    if name not in lacking or candidates(table, name) or any(_unit(table, c) is None for c in others):
        return ""
    volts = [column for column in others if name == "position" and _dimension(table, column) == "V"]
    if volts:  # the last: an output mostly stands before its reference
        as_position = _source(table, volts[-1], _unit(table, volts[-1]), {}, ', scale = "20 V/m", zero = "0 V"')
        return (
            f"# {name}: FILL IN, unless a file of another logger has it ({lacking[name]}):\n# {name} = {as_position}\n"
            '# what a vibrometer reads is its velocity, with a scale like "8 V/(m/s)"'
        )
    return f"# {name}: no column measures it; where a file of another logger does: {lacking[name]}"


def _optional(table: Table, column: str, channel: str, clocks: Mapping[str, str], likely: bool) -> str:
    """The line of a further column; a comment where it needs words of the user, or may be a channel that is missing."""
    unit = _unit(table, column)
    mark = "" if unit and not table.clocks and not likely and column not in table.stamps else "# "
    return f"{mark}{toml_key(channel)} = {_source(table, column, unit, clocks)}"


def _source(table: Table, column: str, unit: str | None, clocks: Mapping[str, str], scale: str = "") -> str:
    """A column, its unit, and the clock that is its own by its name; one that the file gives it needs no words."""
    stamps = clocks.get(column) if column not in table.clocks else None
    time = "" if stamps is None else f", time = {_source(table, stamps, _unit(table, stamps), {})}"
    return f"{{ column = {toml_text(column)}, unit = {toml_text(unit or UNKNOWN)}{scale}{time} }}"


def _clock_note(table: Table, column: str, unit: str | None) -> str:
    """Say how many rows there are and how they follow each other, in seconds if the unit is known."""
    read = table.read([column])[column]
    t = read.values if read.present is None else read.values[read.present]
    if len(t) < 2:
        return f"{len(t)} rows"
    if unit is None or units.conversion(unit).si != "s":
        return f"{len(t)} rows from {t[0]:g} to {t[-1]:g}, median step {np.median(np.diff(t)):.4g}"
    t = units.conversion(unit, "time").apply(t)
    step = median_step(t)
    rate = f" ({1.0 / step:.6g} Hz)" if step > 0 else ""
    return f"{len(t)} rows from {t[0]:g} s to {t[-1]:g} s, median step {step:.4g} s{rate}"
