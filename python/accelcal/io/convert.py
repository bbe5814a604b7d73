"""The unit of a column, and its numbers in SI."""

from __future__ import annotations

import numpy as np

from accelcal.data import units
from accelcal.data.arrays import Array
from accelcal.data.recording import RecordingError
from accelcal.data.rig import Rig
from accelcal.io import naming
from accelcal.io.assign import USUAL_UNIT, Plan, fix, line
from accelcal.io.sidecar import Clock, Source
from accelcal.io.table import Column, Table

UNKNOWN = "?"
"""What a sidecar template puts where the user must fill in a unit."""


def in_seconds(table: Table, plan: Plan, clock: Clock, column: Column) -> Column:
    """Convert a column of stamps.

    Parameters
    ----------
    column : values of shape (n,) in the unit of the file.

    Raises
    ------
    RecordingError
        If the unit is missing, unknown, contradictory or not a time.
    """
    assert clock.column is not None  # a clock without a rate names a column
    unit = _unit(table, plan, "time", clock.column, clock.unit)
    return Column(_conversion(table, clock.column, unit, "time").apply(column.values), column.present)


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
    unit = _unit(table, plan, name, source.column, source.unit)
    kind = {"time": "time", "position": "length", "temperature": "temperature"}.get(name)
    rule = _conversion(table, source.column, unit, kind)
    if name != "accel" or rule.si == "m/s^2":
        return rule.apply(values), rule.si
    if rule.si not in ("V", "count"):
        raise RecordingError(
            f'{table.path}: column "{source.column}": "{unit}" does not measure an acceleration; '
            'expected a unit such as "m/s^2" or "g", or "V" or "count" with a scale in [sensor]'
        )
    sensor = rig.sensor
    if sensor.scale is None or sensor.scale_unit != rule.si:
        declared = "no scale is declared" if sensor.scale is None else f"the declared scale is per {sensor.scale_unit}"
        zero = {"V": ("0.25 V/g", "2.5 V"), "count": ("1024 count/g", "2048 count")}[rule.si]
        raise RecordingError(
            f'{table.path}: column "{source.column}" is in {unit}, but {declared}; '
            + fix(plan.sidecar, f'[sensor]\nscale = "{zero[0]}"\nzero  = "{zero[1]}"')
        )
    with np.errstate(over="ignore"):  # found as not finite
        return (rule.apply(values) - (sensor.zero or 0.0)) / sensor.scale, "m/s^2"


def _unit(table: Table, plan: Plan, channel: str, column: str, declared: str | None) -> str:
    """Find the unit of a column; two sources that disagree are an error."""
    name = naming.take_apart(column)
    stored = table.units.get(column)
    if stored is not None and declared not in (None, UNKNOWN) and not units.is_unit(stored):
        stored = None  # words that a file has for a unit cannot be corrected in it, and the user says what they mean
    said = {
        table.units_from: stored,
        plan.sidecar.name: declared,
        "the suffix of the column name": name.suffix,
        "the bracket in the column name": name.brackets,
    }
    found = [(source, unit) for source, unit in said.items() if unit is not None]
    if not found:
        raise RecordingError(
            f'{table.path}: column "{column}" has no unit; '
            + fix(plan.sidecar, line(channel, column, USUAL_UNIT.get(channel, "1")))
        )
    source, unit = found[0]
    if unit == UNKNOWN:
        raise RecordingError(
            f'{plan.sidecar}: channels.{channel}: the unit of column "{column}" is still to be filled in.'
        )
    for other, differing in found[1:]:
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
        raise RecordingError(f'{table.path}: column "{column}": {error}') from None
