"""A table of dwells, one line for each, to dwells."""

from __future__ import annotations

import hashlib
import math
import os
from pathlib import Path

import numpy as np

from accelcal.data import units
from accelcal.data.arrays import Array
from accelcal.data.dwells import Dwells, DwellSetup
from accelcal.data.recording import RecordingError
from accelcal.data.rig import STANDARD_GRAVITY
from accelcal.io.assign import Plan
from accelcal.io.convert import in_si
from accelcal.io.files import open_regular
from accelcal.io.formats import open_table
from accelcal.io.sidecar import Sidecar, Source, has_sidecar, no_sidecar, read_sidecar, sidecar_of
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
    return from_table(open_table(path), read_sidecar(beside) if has_sidecar(path) else no_sidecar(), beside)


def is_table(table: Table) -> bool:
    """Whether a file has the header of a table of dwells."""
    return {"attitude_deg", "mean"} <= set(table.columns)


def from_table(table: Table, declared: Sidecar, sidecar: Path) -> Dwells:
    """Dwells of a table that is open."""
    missing = [name for name in COLUMNS if name not in table.columns and name not in OPTIONAL]
    if missing:
        raise RecordingError(
            f'{table.path}: no column "{missing[0]}"; a table of dwells has the header {",".join(COLUMNS)}'
        )
    read = table.read([name for name in COLUMNS if name in table.columns])
    columns = {
        name: complete(table, name, column) for name, column in read.items() if not (name in OPTIONAL and empty(column))
    }
    for name, low, high, words in (
        ("attitude_deg", -MOST_DEGREES, MOST_DEGREES, "an angle of at most 360 degrees"),
        ("std", 0.0, math.inf, "a standard deviation of the samples"),
        ("duration_s", 1e-9, math.inf, "a duration above 0 s"),
        ("samples", 2.0, math.inf, "a number of samples, at least 2"),
    ):
        wrong = ~((columns[name] >= low) & (columns[name] <= high))
        if wrong.any():
            k = int(np.argmax(wrong))
            raise RecordingError(
                f'{table.path}: {table.row(k)}, column "{name}": found {columns[name][k]:g}, expected {words}'
            )
    unit = declared.channels["accel"].unit if "accel" in declared.channels else None
    plan = Plan({}, sidecar)

    def si(y: Array) -> Array:
        return in_si(table, plan, "accel", Source("mean", unit), declared.rig, y)[0]

    mean = si(columns["mean"])
    group = columns.get("group", np.zeros(len(mean)))
    setup = declared.dwell or DwellSetup()
    return Dwells(
        angle=np.radians(columns["attitude_deg"]),
        mean=mean,
        std=np.abs(si(columns["mean"] + columns["std"]) - mean),
        duration=columns["duration_s"],
        samples=columns["samples"],
        group=tuple(f"{g:.17g}" for g in group),
        rig=declared.rig,
        temperature=columns.get("temperature_degC"),
        angle_std=setup.angle_std or 0.0,
        gravity=setup.gravity or STANDARD_GRAVITY,
        name=table.path.name,
        digest=digest_of(table.path),
        assumptions=assumed(setup),
    )


def empty(column: Column) -> bool:
    """Whether every cell of a column is empty."""
    return column.present is not None and not column.present.any()


def complete(table: Table, name: str, column: Column) -> Array:
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


def assumed(setup: DwellSetup) -> tuple[str, ...]:
    """Sentences on what a sidecar does not declare of dwells."""
    unsaid = {ASSUMED_GRAVITY: setup.gravity is None, ASSUMED_ANGLE: setup.angle_std is None}
    return tuple(sentence for sentence, missing in unsaid.items() if missing)


def digest_of(path: Path) -> str:
    """SHA-256 of a file, hex; of no more than it holds now, for some that the system makes up never end.

    Raises
    ------
    RecordingError
        If it is no regular file, or is not readable.
    """
    found = hashlib.sha256()
    with open_regular(path, "a recording") as file:
        left = os.fstat(file.fileno()).st_size
        while left > 0 and (part := file.read(min(left, 1_000_000))):
            found.update(part)
            left -= len(part)
    return found.hexdigest()
