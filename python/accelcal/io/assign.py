"""Columns to channels: which is which, by the sidecar or by their names, in which unit, and their numbers in SI."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from accelcal._support.errors import OBEYED_IN_NAMES, visible
from accelcal.data import (
    ACCELERATION,
    ANGLE,
    GYROSCOPE,
    OUTPUTS,
    PLACE,
    QUATERNION,
    VELOCITY,
    Array,
    Finding,
    RecordingError,
    Rig,
    reference_among,
    units,
)
from accelcal.data.clocks import BITS, FRAME_BITS, packets, unwrapped
from accelcal.data.recording import ORDERS
from accelcal.io import naming
from accelcal.io.sidecar import UNKNOWN, Clock, Sidecar, Source, sidecar_of, toml_text, unfilled
from accelcal.io.table import DATES, MOST_CHANNEL_NAME, MOST_NAME, Column, Table

ATTITUDE = tuple(f"attitude.{name}" for name in QUATERNION)
"""Channels that a quaternion is read into."""


class NoScaleError(RecordingError):
    """A column is in V or counts, and no scale is declared."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Which column serves which channel, before any number is read."""

    sources: Mapping[str, Source]
    """By channel name; each with its clock."""
    sidecar: Path
    """Where the user declares what is missing."""


def assign(table: Table, declared: Sidecar, required: tuple[str, ...]) -> tuple[Plan, list[Finding]]:
    """Assign columns and clocks to channels: those that the sidecar maps, then by name those that it leaves out.

    Parameters
    ----------
    table : the file.
    declared : its sidecar.
    required : the channels without which the file is of no use.

    Returns
    -------
    The plan, and a note on columns that are not used.

    Raises
    ------
    RecordingError
        If a channel or clock is missing or ambiguous; it shows the lines to write.
    """
    sidecar = declared.path or sidecar_of(table.path)
    sources, notes = _sources(table, declared, sidecar)
    for name, source in sources.items():
        _require_name(table, name, source, sidecar)
    for name in ("accel", "position"):
        if name in required and name not in sources and not (name == "position" and reference_among(sources)):
            raise RecordingError(_absent(table, name, sidecar, declared.channels))
        unasked = name in sources and name not in required
        if unasked and (sources[name].column == UNKNOWN or not _recorded(table, sources, name, declared.time)):
            del sources[name]
    # One of the columns that nobody asked for may be the output.
    if "accel" not in sources and notes and not declared.channels:
        alone = "A planned motion has columns for time and position alone."
        raise RecordingError(f"{_absent(table, 'accel', sidecar, declared.channels)}\n{alone}")
    clock = declared.time or _common_clock(table, sources, sidecar)
    times = Counter(table.columns)
    for name, source in sources.items():
        named = [source.column] if source.where is None else [source.column, source.where[0]]
        if (wrong := next((column for column in named if times[column] != 1), None)) is not None:
            raise RecordingError(_wrong_column(table, name, wrong, sidecar))
        stamps = source.time or _stated(table, source.column, declared.time) or clock
        if stamps is None:
            raise RecordingError(_absent(table, "time", sidecar, declared.channels))
        if (wrong := next((column for column in columns_of(stamps) if times[column] != 1), None)) is not None:
            raise RecordingError(_wrong_column(table, "time", wrong, sidecar))
        sources[name] = replace(source, time=stamps)
    declarations = {(s.column, s.unit) for s in sources.values()}
    declarations |= {(s.time.column, s.time.unit) for s in sources.values() if s.time and s.time.column}
    notes += [
        Finding(
            "declared_unit",
            "",
            1,
            0.0,
            f'column "{column}" is read in {unit}, as declared, though its name says {other}',
        )
        for column, unit in sorted(declarations, key=str)
        if unit not in (None, UNKNOWN) and column
        for other in (naming.take_apart(column).suffix or naming.take_apart(column).brackets,)
        if other and units.is_unit(other) and units.is_unit(unit) and not units.same_unit(unit, other)
    ]
    return Plan(sources, sidecar), notes


def _sources(table: Table, declared: Sidecar, sidecar: Path) -> tuple[dict[str, Source], list[Finding]]:
    """Return a column for each channel; side channels are looked for only when no sidecar lists the channels."""
    sources = dict(declared.channels)
    if declared.attitude is not None:
        sources |= {name: Source(column, "1", declared.attitude.time) for name, column in attitude_columns(declared)}
    mapped = {source.column for source in sources.values()}
    unused, served = [], {*_of_clocks(declared), *declared.aside}
    for column, (channel, own_clock) in discover(table).items():
        moved = declared.turns or reference_among(declared.channels) is not None
        essential = channel == "accel" or (channel == "position" and not moved)
        if channel == "time" or channel in declared.channels or column in mapped:
            continue
        side = (
            not declared.channels and column not in {*table.stamps, *served} and units.is_unit(unit_of(table, column))
        )
        if essential or side:
            if channel in sources:
                raise RecordingError(
                    f'{table.path}: columns "{sources[channel].column}" and "{column}" can both be {channel}; '
                    + fix(sidecar, line(channel, column, "..."))
                )
            sources[channel] = Source(column, time=own_clock)
        elif column not in served:
            unused.append(column)
    what = f"columns that {sidecar.name} does not name" if declared.channels else "columns without a known unit"
    text = f"{what} are not used: {_listed(unused)}; declare them in [channels] to use them"
    return sources, [Finding("unused_columns", "", len(unused), 0.0, text)] if unused else []


def _of_clocks(declared: Sidecar) -> set[str]:
    """The columns that serve a sidecar as stamps, or tell rows apart."""
    sources = [*declared.channels.values()]
    clocks_of = [source.time for source in (*sources, declared.attitude) if source is not None]
    clocks = [clock for clock in (declared.time, *clocks_of) if clock is not None]
    return {
        *(column for clock in clocks for column in columns_of(clock)),
        *(source.where[0] for source in sources if source.where is not None),
    }


def _require_name(table: Table, name: str, source: Source, sidecar: Path) -> None:
    """Refuse a name that no model file can hold: effects of a side channel have its name."""
    if OBEYED_IN_NAMES.search(name):
        wrong = f'its name "{visible(name[:MOST_NAME], one_line=True)}" holds characters that are not shown'
    elif len(name) > MOST_CHANNEL_NAME:
        wrong = f'its name "{name[:_SHOWN]}..." has {len(name)} characters, expected at most {MOST_CHANNEL_NAME}'
    else:
        return
    column = visible(str(source.column)[:MOST_NAME], one_line=True)
    raise RecordingError(
        f'{table.path}: column "{column}" cannot be a channel: {wrong}; rename the column, or give the channel a plain '
        f"name in [channels] of {sidecar}"
    )


def attitude_columns(declared: Sidecar) -> list[tuple[str, str]]:
    """The channels that an attitude is read into, each with its column."""
    return list(zip(ATTITUDE, declared.attitude.columns, strict=True)) if declared.attitude else []


def discover(table: Table) -> dict[str, tuple[str, Clock | None]]:
    """Return by column the channel that its name speaks of, and the clock column of its own that it has, if any.

    Clocks, common or own, are called "time".
    """
    named = {column: naming.take_apart(column).base for column in table.columns}
    places = {column: place for place, column in enumerate(named)}
    by_base: dict[str, str] = {}
    for column, base in named.items():
        by_base.setdefault(base.lower(), column)
    clocks = {}
    for column, base in named.items():
        aliases = naming.ROLES.get(naming.role(base) or "", (base.lower(),))
        stamps = [f"{alias}_{stamp}" for alias in aliases for stamp in naming.ROLES["time"]]
        bases = [by_base[stamp] for stamp in stamps if stamp in by_base]
        file_clock = clock_in_file(table, column)
        if file_clock is not None:
            clocks[column] = file_clock
        elif bases:
            clocks[column] = Clock(column=min(bases, key=places.__getitem__))
    owned = {clock.column for clock in clocks.values()}
    return {
        column: ("time" if column in owned else naming.role(base) or base, clocks.get(column))
        for column, base in named.items()
    }


def clock_in_file(table: Table, column: str) -> Clock | None:
    """The stamps that a file itself gives a column."""
    stamps = table.clocks.get(column)
    return None if stamps is None else Clock(rate=stamps) if isinstance(stamps, float) else Clock(column=stamps)


def _stated(table: Table, column: str, declared: Clock | None) -> Clock | None:
    """The clock that a file itself gives a column; a common one that is declared wins unless it is another column's."""
    stamps = clock_in_file(table, column)
    if declared is None or stamps is None or (stamps.column, stamps.rate) == (declared.column, declared.rate):
        return None if declared else stamps
    return stamps if (declared.column or declared.rate) in {*table.clocks.values()} else None


def _common_clock(table: Table, sources: Mapping[str, Source], sidecar: Path) -> Clock | None:
    """The stamps of the sources that have none of their own."""
    if all(source.time or clock_in_file(table, source.column) for source in sources.values()):
        return None
    common = [column for column in table.columns if naming.role(naming.take_apart(column).base) == "time"]
    if len(common) > 1:
        names = " and ".join(f'"{column}"' for column in common)
        raise RecordingError(
            f"{table.path}: columns {names} can both be time; " + fix(sidecar, line("time", common[0], "..."))
        )
    if (parts := parts_of_instant(table, common[0] if common else None)) is not None:
        listed = ", ".join(f'"{name}"' for name in columns_of(parts))
        raise RecordingError(
            f"{table.path}: the parts of an instant stand in several columns, {listed}; "
            + fix(sidecar, f"[channels]\ntime = {clock_text(parts)}")
        )
    return Clock(column=common[0]) if common else None


def parts_of_instant(table: Table, time: str | None) -> Clock | None:
    """The clock of times of day beside which a column has the fraction of the second; None where none has.

    Parameters
    ----------
    time : the column that is called so; None = the one that holds times of day.
    """
    fractions = [column for column in table.columns if naming.take_apart(column).base.lower() in naming.COUNTED]
    times = [column for column, form in table.stamps.items() if form != DATES and time in (None, column)]
    if len(fractions) != 1 or len(times) != 1:
        return None
    fraction, dates = Source(fractions[0], unit_of(table, fractions[0])), {*table.stamps} - {*times}
    return Clock(times[0], date=dates.pop() if len(dates) == 1 else None, fraction=fraction)


def columns_of(clock: Clock) -> list[str]:
    """The columns from which the stamps of a clock are made."""
    return [name for name in (clock.date, clock.column, clock.fraction and clock.fraction.column) if name]


def clock_text(clock: Clock) -> str:
    """A clock as a sidecar has it."""
    entries = {"column": clock.column, "unit": clock.unit, "date": clock.date}
    text = ", ".join(f"{key} = {toml_text(value)}" for key, value in entries.items() if value)
    if clock.fraction is not None:
        rest = f"column = {toml_text(clock.fraction.column)}, unit = {toml_text(clock.fraction.unit or UNKNOWN)}"
        text += f", fraction = {{ {rest} }}"
    return f"{{ {text} }}"


def _recorded(table: Table, sources: Mapping[str, Source], channel: str, clock: Clock | None) -> bool:
    """Whether the file holds the column of a channel, or one that is not assigned and that may be it."""
    claimed = {source.column for source in sources.values()}
    claimed |= {time.column for time in (clock, *(source.time for source in sources.values())) if time and time.column}
    stamps = {column for column in table.columns if naming.role(naming.take_apart(column).base) == "time"}
    return sources[channel].column in table.columns or bool({*table.columns} - claimed - stamps)


def unit_of(table: Table, column: str) -> str:
    """The unit of a column by the file, else by the name of the column; empty where there is none."""
    name = naming.take_apart(column)
    return table.units.get(column) or name.suffix or name.brackets or ""


def line(channel: str, column: str, unit: str) -> str:
    """Return the lines of a sidecar that declare one channel."""
    return f'[channels]\n{channel} = {{ column = {toml_text(column)}, unit = "{unit}" }}'


def fix(sidecar: Path, lines: str) -> str:
    """Say where to write `lines`, and show them."""
    indented = "\n".join(f"    {line}" for line in lines.splitlines())
    return f"write in {sidecar}:\n{indented}"


def _listed(columns: Sequence[str]) -> str:
    """Names of columns in a sentence, cut where there are many or long ones."""
    text = ", ".join(name[:MOST_NAME] for name in columns[:_MOST_LISTED])
    return text if len(columns) <= _MOST_LISTED else f"{text} and {len(columns) - _MOST_LISTED} more"


_MOST_LISTED = 50
_SHOWN = 40
"""Characters of a long name."""


def _absent(table: Table, channel: str, sidecar: Path, declared: Iterable[str]) -> str:
    names = list(declared)
    close = difflib.get_close_matches(channel, names, n=1)
    hint = f' (the sidecar has "{close[0]}"; did you mean "{channel}"?)' if close else ""
    if channel == "accel" and {*OUTPUTS.values()} <= {*names}:
        hint = (
            " (of three outputs declare [channels.attitude] and the place, too, give the file of another logger that "
            "has them as --position, or use accelcal dwells at rest)"
        )
    elif (
        not hint
        and channel == "accel"
        and {*OUTPUTS.values(), *QUATERNION} <= {*naming.orientation_roles(table.columns)}
    ):
        hint = " (of three outputs map accel_x, accel_y, accel_z, place and attitude, as accelcal init has them)"
    likely, file, elsewhere = candidates(table, channel), table.path, ""
    if not (hint or likely) and channel in ("accel", "position"):
        files = f"{file} --position READINGS" if channel == "position" else f"OUTPUT --position {file}"
        elsewhere = f"If a second logger has it: accelcal fit {files}. "
    lines = line(channel, *likely[0]) if likely else line(channel, "...", USUAL_UNIT[channel])
    if channel == "time":
        lines += '\n# or, without a time column: rate = "1667 Hz"'
    return (
        f"{table.path}: no column for {channel}{hint}; columns are: {_listed(table.columns)}. "
        f"{elsewhere}{_likely_text(likely)}Name it like "
        f"{'t_s' if channel == 'time' else naming.column_name(channel, USUAL_UNIT[channel])}, or {fix(sidecar, lines)}"
    )


def candidates(table: Table, channel: str) -> list[tuple[str, str]]:
    """Columns, with their units, that measure what a channel does and are not called otherwise."""
    several = {"time": ("s",), "accel": ("m/s^2", "V", "count"), "position": ("m",), "temperature": ("degC",)}
    dimensions = several.get(channel, ())
    stated = [(column, unit_of(table, column)) for column in table.columns if table.stamps.get(column) != DATES]
    return [
        (column, unit) for column, unit in stated if units.is_unit(unit) and units.conversion(unit).si in dimensions
    ]


def _likely_text(likely: Sequence[tuple[str, str]]) -> str:
    """Columns that a channel may be, in a sentence of their own."""
    names = [f'"{column}" in {unit}' for column, unit in likely]
    return f"By its unit it may be {_listed(names).removesuffix('.')}. " if names else ""


def _wrong_column(table: Table, channel: str, column: str, sidecar: Path) -> str:
    if column == UNKNOWN:
        hint = _likely_text(candidates(table, channel)).strip() or f"Columns are: {_listed(table.columns)}"
        return unfilled(sidecar, f"channels.{channel}.column", f"expected the name of a column. {hint}")
    if column in table.columns:
        return f'{table.path}: {table.columns.count(column)} columns are called "{column}"; rename all but one.'
    close = difflib.get_close_matches(column, table.columns, n=1)
    hint = f'did you mean "{close[0]}"? ' if close else ""
    return (
        f'{table.path}: there is no column "{column}", which {sidecar.name} names for {channel}; '
        f"{hint}columns are: {_listed(table.columns)}; write the name of one of them"
    )


USUAL_UNIT = {
    **{"time": "s", "accel": "m/s^2", "position": "m", "temperature": "degC", ANGLE: "deg"},
    **dict.fromkeys(OUTPUTS.values(), "m/s^2"),
    **dict.fromkeys(PLACE, "m"),
    **dict.fromkeys(GYROSCOPE, "rad/s"),
}
"""The unit that a message proposes."""


def in_seconds(
    table: Table, plan: Plan, clock: Clock, column: Column, readings: Sequence[Column] = ()
) -> tuple[Column, list[Finding]]:
    """Convert a column of stamps, or of the counter that takes their place; one that wraps is unwrapped.

    Parameters
    ----------
    column : values of shape (n,) in the unit of the file.
    readings : (n,) that have these stamps, by which times of arrival are told from true stamps.

    Returns
    -------
    The stamps in s, and a note on a counter that wraps.

    Raises
    ------
    RecordingError
        If the unit is missing, unknown, contradictory or not a time.
    """
    assert clock.column is not None  # a clock without a counter has a rate, or names a column
    counts = clock.rate is not None
    rows = np.arange(len(column.values)) if column.present is None else np.flatnonzero(column.present)
    straight, wraps = unwrapped(column.values[rows], FRAME_BITS if counts else BITS)
    if len(wraps):
        values = column.values.copy()
        values[rows] = straight
        column = replace(column, values=values)
    if clock.rate is not None:
        first = column.values[rows[0]] if len(rows) else 0.0
        stamps = Column((column.values - first) / clock.rate, column.present)
    else:
        unit = stated_unit(table, plan, "time", clock.column, clock.unit)
        stamps = replace(column, values=_conversion(table, clock.column, unit, "time").apply(column.values))
    findings = []
    if len(wraps):
        k = int(rows[wraps[0]])
        text = (
            f'column "{clock.column}" counts to its end and starts anew {len(wraps)} times, first at {table.row(k)}: '
            "the stamps go on from there as if it did not"
        )
        findings.append(Finding("counter_wraps", "", len(wraps), float(stamps.values[k]), text))
    whole = [
        y.values[rows]
        for y in readings
        if len(y.values) == len(column.values) and (y.present is None or y.present[rows].all())
    ]
    behind = None if clock.rate is not None else packets(stamps.values[rows], whole)
    if behind is None:
        return stamps, findings
    first, shared = float(stamps.values[rows[0]]), [name for name, s in plan.sources.items() if s.time == clock]
    values = stamps.values.copy()
    values[rows] = behind.instants
    steps = f", whose rate steps {behind.pieces - 1} times," if behind.pieces > 1 else ""
    text = (
        f'column "{clock.column}" holds times of arrival, of {behind.samples} samples at a time, that scatter by '
        f"{1e3 * behind.scatter:.2g} ms: one clock of {behind.rate:.6g} Hz{steps} goes through the earliest of them, "
        "and its instants are used; how late the earliest were is not known, and is part of time_offset"
    )
    common = 0.0 if {"accel", "position"} <= {*shared} else behind.scatter
    return replace(stamps, values=values), [
        *findings,
        Finding("burst_stamps", "", len(rows), first, text, "warning", common=common),
    ]


def in_si(table: Table, plan: Plan, name: str, source: Source, rig: Rig, values: Array) -> tuple[Array, str]:
    """Convert the values of a channel; an accelerometer in V or counts goes through the declared scale.

    Parameters
    ----------
    values : (n,) in the unit of the file.

    Returns
    -------
    The values, shape (n,), and their SI unit.

    Raises
    ------
    RecordingError
        If the unit is missing, unknown, contradictory, of the wrong dimension, or in want of a scale.
    """
    unit = stated_unit(table, plan, name, source.column, source.unit)
    kind = MEASURED.get(name)
    rule, scale, zero = _conversion(table, source.column, unit, None), source.scale, source.zero
    if name == "accel" and rig.sensor.scale is not None:
        scale, zero = (rig.sensor.scale, rig.sensor.scale_unit, "m/s^2"), rig.sensor.zero or 0.0
    if rule.si not in units.ELECTRICAL or (kind is None and scale is None):
        rule = _conversion(table, source.column, unit, None if name in ORDERS else kind)  # those are checked later
        return rule.apply(values), rule.si
    if scale is None or scale[1] != rule.si:
        declared = "no scale is declared" if scale is None else f"the declared scale is per {scale[1]}"
        example = units.SCALE_EXAMPLES[kind or "temperature"][rule.si]
        lines = f'[channels]\n{name} = {{ column = "{source.column}", unit = "{unit}", scale = "{example}" }}'
        if name == "accel":
            lines = f'[sensor]\nscale = "{example}"\nzero  = "{units.ZERO_EXAMPLE[rule.si]}"'
        write = fix(plan.sidecar, lines)
        if table.units_from == IN_MEMORY:
            number, per = example.split()[0], example.partition("/")[2]
            write = f"give it converted: of {example} the array divided by {number}, in {per}"
            if name == "accel":
                write = f'give rig=Rig(sensor=Sensor(scale=..., scale_unit="{rule.si}", zero=...)), the scale in '
                write += f"{rule.si} per m/s²: of {example} it is {number} / 9.80665"
        if kind in ("length", "angle") and rule.si == "count":
            declared += " (the resolution of the encoder, from its data sheet)"
        text = f'{table.path}: column "{source.column}" is in {unit}, but {declared}; {write}'
        raise RecordingError(text) if scale is not None else NoScaleError(text)
    with np.errstate(over="ignore"):  # found as not finite
        return (rule.apply(values) - zero) / scale[0], scale[2]


IN_MEMORY = "units"
"""Where the units of arrays come from: what is missing is given, and no sidecar written."""
MEASURED = {
    **{"accel": "acceleration", "position": "length", VELOCITY: "speed", ACCELERATION: "acceleration"},
    **{"time": "time", "temperature": "temperature", ANGLE: "angle"},
}
"""What a known channel measures; any other takes any unit."""


def stated_unit(table: Table, plan: Plan, channel: str, column: str, declared: str | None) -> str:
    """Find the unit of a column; two sources that disagree are an error."""
    name = naming.take_apart(column)
    stored = table.units.get(column)
    if stored is not None and declared not in (None, UNKNOWN) and not units.is_unit(stored):
        stored = None  # words that a file has for a unit cannot be corrected in it, and the user says what they mean
    units_stated = {table.units_from: stored, plan.sidecar.name: declared}
    if declared is None:  # else the user says what the name means
        units_stated |= {"the suffix of the column name": name.suffix, "the bracket in the column name": name.brackets}
    stated = [(source, unit) for source, unit in units_stated.items() if unit is not None]
    if not stated:
        raise RecordingError(
            f'{table.path}: column "{column}" has no unit; '
            + fix(plan.sidecar, line(channel, column, USUAL_UNIT.get(channel, "1")))
        )
    source, unit = stated[0]
    if unit == UNKNOWN:
        example = f'expected the unit of column "{column}" such as unit = "{USUAL_UNIT.get(channel, "V")}"'
        raise RecordingError(unfilled(plan.sidecar, f"channels.{channel}.unit", example))
    for other, differing in stated[1:]:
        if not units.same_unit(unit, differing):
            raise RecordingError(
                f'{table.path}: column "{column}": {source} says "{unit}" but {other} says "{differing}"; '
                "correct one of the two."
            )
    return unit


def _conversion(table: Table, column: str, unit: str, kind: str | None) -> units.Conversion:
    try:
        return units.conversion(unit, kind)
    except units.UnitError as error:
        volts = ', or "V" or "count" with a scale' if kind in ("acceleration", "length") else ""
        raise RecordingError(f'{table.path}: column "{column}": {error}{volts}') from None
