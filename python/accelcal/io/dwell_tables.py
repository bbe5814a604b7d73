"""Tables of dwells: a row for each attitude at which a sensor rested."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from accelcal._support.errors import visible
from accelcal.data import (
    OUTPUTS,
    STANDARD_GRAVITY,
    Array,
    Dwells,
    DwellSetup,
    RecordingError,
    units,
)
from accelcal.io import naming
from accelcal.io.assign import (
    Plan,
    in_si,
    unit_of,
)
from accelcal.io.files import digest_of, open_table
from accelcal.io.sidecar import (
    Sidecar,
    Source,
    has_sidecar,
    no_sidecar,
    read_sidecar,
    sidecar_of,
)
from accelcal.io.table import Column, Table

COLUMNS = ("attitude_deg", "mean", "std", "duration_s", "temperature_degC", "samples", "group")
"""Header of a table of dwells; temperature and group may be missing."""
OPTIONAL = ("temperature_degC", "group")
MOST_DEGREES = 360.0
"""Largest angle of a dividing head."""
ASSUMED_GRAVITY = (
    "local gravity is not declared: standard gravity is assumed, which differs from place to place by up to 0.3 %, and "
    "so does the scale factor; write gravity in [dwell]"
)
ASSUMED_ANGLE = "angle_std is not declared: the angles of the dwells are taken as exact, but for one zero of each group"


def load_dwell_table(path: Path) -> Dwells:
    """Dwells of a table, with the sidecar beside it."""
    beside = sidecar_of(path)
    return dwells_from(open_table(path), read_sidecar(beside) if has_sidecar(path) else no_sidecar(), beside)


def dwell_columns(table: Table) -> dict[str, str]:
    """Columns of a table of dwells by the names of `COLUMNS`, whatever letter case and unit its header gives them."""
    bases = {base: columns[0] for base, columns in _by_base(table).items()}
    named = {name: name if name in table.columns else bases.get(naming.take_apart(name).base) for name in COLUMNS}
    return {name: column for name, column in named.items() if column is not None}


def _by_base(table: Table) -> dict[str, list[str]]:
    """Columns of a table by their names without unit, in small letters."""
    columns = dict[str, list[str]]()
    for column in table.columns:
        columns.setdefault(naming.take_apart(column).base.lower(), []).append(column)
    return columns


def is_dwell_table(table: Table) -> bool:
    """Whether a file has the header of a table of dwells."""
    return {"attitude_deg", "mean"} <= {*dwell_columns(table)}


def dwells_from(table: Table, declared: Sidecar, sidecar: Path) -> Dwells:
    """Dwells of a table that is open."""
    named = dwell_columns(table)
    missing = [name for name in COLUMNS if name not in named and name not in OPTIONAL]
    if missing:
        positions = OUTPUTS["x"] in table.columns
        raise RecordingError(
            f'{table.path}: no column "{missing[0]}"; a table of dwells has the header {",".join(COLUMNS)}: add it'
            + (". Positions of three outputs are a file of their own beside the motion: give both to fit" * positions)
        )
    alike = _by_base(table)
    for name, column in named.items():
        if column != name and len(several := alike[naming.take_apart(name).base]) > 1:
            shown = ", ".join(f'"{other}"' for other in several)
            raise RecordingError(f'{table.path}: columns {shown} may each be "{name}"; call the one to use "{name}"')
    read = table.read(list(named.values()))
    columns = {
        name: in_header_unit(table, name, column, complete_column(table, column, read[column]))
        for name, column in named.items()
        if name not in OPTIONAL or (filled := read[column].present) is None or filled.any()
    }
    limits = (
        ("attitude_deg", -MOST_DEGREES, MOST_DEGREES, "an angle of at most 360 degrees"),
        ("std", 0.0, math.inf, "a standard deviation of the samples"),
        ("duration_s", 1e-9, math.inf, "a duration above 0 s"),
        ("samples", 2.0, math.inf, "a number of samples, at least 2"),
        ("temperature_degC", -273.15, math.inf, "a temperature above absolute zero"),
    )
    require_between(table, columns, limits)
    unit = declared.channels["accel"].unit if "accel" in declared.channels else None
    plan = Plan({}, sidecar)

    def si(name: str, y: Array) -> Array:
        stated = unit if name == "mean" else unit_of(table, named[name]) or unit or unit_of(table, named["mean"])
        return in_si(table, plan, "accel", Source(named[name], stated or None), declared.rig, y)[0]

    mean = si("mean", columns["mean"])
    group = columns.get("group", np.zeros(len(mean)))
    setup = declared.dwell or DwellSetup()
    return Dwells(
        angle=np.radians(columns["attitude_deg"]),
        mean=mean,
        std=np.abs(si("std", columns["std"]) - si("std", np.zeros(len(mean)))),
        duration=columns["duration_s"],
        samples=columns["samples"],
        group=tuple(f"{g:.17g}" for g in group),
        rig=declared.rig,
        temperature=columns.get("temperature_degC"),
        angle_std=setup.angle_std or 0.0,
        gravity=local_gravity(setup),
        name=visible(table.path.name, one_line=True),
        digest=digest_of(table.path),
        assumptions=undeclared_of_dwells(setup)
        + repeated_rows_note(table, columns)
        + kelvin_note(columns.get("temperature_degC")),
    )


def in_header_unit(table: Table, name: str, column: str, values: Array) -> Array:
    """Values of a column of a table of dwells in the unit of its name in `COLUMNS`, from the one that its header says.

    Raises
    ------
    RecordingError
        If that is a unit of another quantity.
    """
    usual = naming.take_apart(name).suffix
    unit = unit_of(table, column)
    if usual is None or not unit or units.same_unit(unit, usual):
        return values
    to = units.conversion(usual)
    if not units.is_unit(unit) or (rule := units.conversion(unit)).si != to.si:
        raise RecordingError(f'{table.path}: column "{column}" is in "{unit}"; expected {usual} as in "{name}"')
    return np.asarray((rule.apply(values) - to.offset) / to.factor)


def require_between(
    table: Table, columns: Mapping[str, Array], limits: Sequence[tuple[str, float | Array, float, str]]
) -> None:
    """Refuse a table with a value beyond its limits, which are of the whole column or of each row.

    Raises
    ------
    RecordingError
        Naming row, column and what was expected.
    """
    for name, low, high, words in limits:
        values = columns.get(name, np.zeros(0))
        wrong = ~((values >= low) & (values <= high)) if len(values) else values > 0.0
        if wrong.any():
            k = int(np.argmax(wrong))
            raise RecordingError(
                f'{table.path}: {table.row(k)}, column "{name}": found {values[k]:g}, expected {words}; correct it'
            )


def complete_column(table: Table, name: str, column: Column) -> Array:
    """Values of a column without empty cells.

    Raises
    ------
    RecordingError
        Naming the row of the first that is empty, not finite or beyond all that is measured.
    """
    good = np.abs(column.values) <= units.LARGEST  # and so is no NaN
    if column.present is not None:
        good &= column.present
    if not good.all():
        raise RecordingError(
            f'{table.path}: {table.row(int(np.argmin(good)))}, column "{name}": expected a finite number of at most '
            f"{units.LARGEST:g}; complete or delete this row"
        )
    return column.values


def local_gravity(setup: DwellSetup | None) -> float:
    """Gravity as declared, or standard gravity, m/s²."""
    return (setup.gravity if setup else None) or STANDARD_GRAVITY


def undeclared_of_dwells(setup: DwellSetup) -> tuple[str, ...]:
    """Sentences on what a sidecar does not declare of dwells."""
    unsaid = {ASSUMED_GRAVITY: setup.gravity is None, ASSUMED_ANGLE: setup.angle_std is None}
    return tuple(sentence for sentence, missing in unsaid.items() if missing)


ROOM = (233.0, 398.0)
"""Temperatures of a laboratory and its ovens, K; in degC few accelerometers stand them."""


def kelvin_note(temperature: Array | None) -> tuple[str, ...]:
    """A sentence on temperatures of dwells that are those of a laboratory if they are in kelvin."""
    if temperature is None or not ROOM[0] <= np.min(temperature) <= np.max(temperature) <= ROOM[1]:
        return ()
    span = f"{np.min(temperature):.5g} to {np.max(temperature):.5g}"
    return (f"temperature_degC is {span}, as if it were in kelvin; expected degC: subtract 273.15 if it is",)


def repeated_rows_note(table: Table, columns: Mapping[str, Array]) -> tuple[str, ...]:
    """A sentence on rows of a table of dwells that equal one before in every cell."""
    first, of = np.unique(np.column_stack(list(columns.values())), axis=0, return_index=True, return_inverse=True)[1:]
    again = np.flatnonzero(first[of.ravel()] < np.arange(len(of)))
    if not len(again):
        return ()
    rows = f"{table.row(int(again[0]))} equals {table.row(int(first[of.ravel()[again[0]]]))}"
    return (f"rows that equal one before in every cell count twice: {len(again)}, {rows}; delete what is one dwell",)
