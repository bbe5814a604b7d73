"""From files to dwells: a table with one line each, a recording at rest, or the rests of a long record."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from accelcal._support.arguments import checked
from accelcal.data import (
    OUTPUTS,
    STANDARD_GRAVITY,
    Array,
    Dwells,
    DwellSetup,
    Finding,
    Positions,
    Recording,
    RecordingError,
    Rig,
    median_step,
    reference_among,
    runs_of,
    units,
)
from accelcal.io.assign import fix
from accelcal.io.atomic import atomic_write, together
from accelcal.io.dwell_tables import (
    COLUMNS,
    complete_column,
    dwells_from,
    is_dwell_table,
    local_gravity,
    require_between,
    undeclared_of_dwells,
)
from accelcal.io.files import digest_of, open_table
from accelcal.io.loading import axes, declaration, load, load_axes, loaded
from accelcal.io.sidecar import Sidecar, Source, has_sidecar, no_sidecar, read_sidecar, sidecar_of
from accelcal.io.table import Table
from accelcal.io.write import write_sidecar

WINDOW = 1.0
"""Length of the moving window over which a channel is judged, s."""
LEAST_NOISY = 0.05
"""Share of the windows of a record that are taken to be at rest, whatever it is."""
FEWEST = 8
"""Samples of a window at least."""


def rests(t: Array, outputs: Array, least: float = 2.0, *, factor: float = 3.0) -> list[tuple[int, int]]:
    """First and last sample of each rest.

    Parameters
    ----------
    t : (n,) s, rising.
    outputs : (n, channels), any unit.
    least : shortest rest, s.
    factor : standard deviation in a window over that of the quietest windows up to which the sensor rests.

    Notes
    -----
    A window of 1 s moves over each channel; where its standard deviation is within `factor` of that of the quietest
    twentieth of all windows, in every channel, its middle is at rest. Slow motion moves the mean within a window and
    is none.
    """
    half = max(FEWEST, int(WINDOW / median_step(t))) // 2 if len(t) > FEWEST else FEWEST
    if len(t) <= 2 * half:
        return []
    quiet = np.ones(len(t) - 2 * half, dtype=np.bool_)
    for y in outputs.T:
        spread = moving_std(y - np.mean(y), 2 * half + 1)
        counts = np.unique(np.abs(np.diff(y)))
        step = float(counts[counts > 0.0][0]) if np.any(counts > 0.0) else 0.0
        floor = max(float(np.quantile(spread, LEAST_NOISY)), step / np.sqrt(12.0))
        quiet &= spread <= factor * floor
    intervals = [(int(a) + half, int(b) - 1 + half) for a, b in runs_of(quiet)]
    return [(a, b) for a, b in intervals if t[b] - t[a] >= least]


def moving_std(y: Array, width: int) -> Array:
    """Standard deviation over each window of `width` samples, (n - width + 1,)."""
    sums, squares = (np.concatenate([[0.0], np.cumsum(power)]) for power in (y, y**2))
    mean = (sums[width:] - sums[:-width]) / width
    return np.asarray(np.sqrt(np.maximum((squares[width:] - squares[:-width]) / width - mean**2, 0.0)))


def load_declared(
    path: Path,
    rig: Path | None = None,
    single: Callable[[Path], Recording] | None = None,
    position: Path | None = None,
) -> list[Recording | Dwells | Positions]:
    """Read a file as it and its sidecar say: the three outputs of a tracked body, dwells, positions of three outputs at
    rest, or else one recording.

    Parameters
    ----------
    path, rig : as of `load`.
    single : reads a recording of one output in place of `load`.
    position : file of another logger with the position, or with place and attitude where there are three outputs.

    Raises
    ------
    RecordingError
        As `load`, `load_axes`, `load_dwells` or `load_positions`.
    """
    if position is not None:
        three = has_three_outputs(path, rig)
        return [*load_axes(path, rig, position=position)] if three else [load(path, rig, position=position)]
    table, (declared, notes) = open_table(path), declaration(path, rig)
    setup = declared.dwell
    held = setup is not None and setup.unknown and TRIAD[0] in declared.channels
    if set(POSITIONS) <= set(table.columns) or (held and not declared.triad):
        return [load_positions(path, rig)]
    if declared.triad:
        return [*axes(table, rig)]
    if is_dwell_table(table) or (setup is not None and setup.angle is not None):
        return [dwells_of(table, declared, notes, rig or sidecar_of(path))]
    try:
        return [loaded(table, declared, notes) if single is None else single(path)]
    except RecordingError as error:
        if setup is None or setup.table or not str(error).startswith(f"{path}: no column for"):
            raise
        raise RecordingError(
            f"{path}: no table of dwells, which has the header {','.join(COLUMNS)}, with other units as in std_mV; if "
            f"it is one, name its columns so. If it is a recording: {str(error).removeprefix(f'{path}: ')}"
        ) from None


def has_three_outputs(path: Path, rig: Path | None = None) -> bool:
    """Whether the sidecar of a file maps three outputs."""
    return {*OUTPUTS.values()} <= {*declaration(path, rig)[0].channels}


@checked
def load_dwells(path: str | Path, rig: str | Path | None = None) -> Dwells:
    """Read dwells and check them.

    Parameters
    ----------
    path : table with the header ``attitude_deg,mean,std,duration_s,temperature_degC,samples,group``, or a recording at
        rest whose sidecar declares ``[dwell] attitude`` or ``angle``.
    rig : sidecar; None = ``NAME.toml`` beside the file. It declares the unit of the mean as that of the accelerometer.

    Raises
    ------
    RecordingError
        Naming file, column and row, what was expected and the next step.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> table = pathlib.Path(tempfile.mkdtemp(), "tumble.csv")
    >>> rows = "90,9.86,0.001,60,,6000,0\\n0,0.05,0.001,60,,6000,0\\n-90,-9.76,0.001,60,,6000,0\\n"
    >>> _ = table.write_text("attitude_deg,mean,std,duration_s,temperature_degC,samples,group\\n" + rows)
    >>> _ = table.with_suffix(".toml").write_text("[channels]\\naccel = { column = 'mean', unit = 'm/s^2' }\\n")
    >>> len(load_dwells(table))
    3
    """
    path = Path(path)
    return dwells_of(open_table(path), *declaration(path, rig), Path(rig or sidecar_of(path)))


@checked
def load_positions(path: str | Path, rig: str | Path | None = None, *, least: float = 2.0) -> Positions:
    """Read static positions of three outputs at unknown attitudes, which `accelcal.fit` accepts beside their motion.

    Parameters
    ----------
    path : record of which the rests are positions, with ``accel_x``, ``accel_y``, ``accel_z`` and ``[dwell] attitude =
        "unknown"`` in its sidecar; or the table of positions that ``accelcal dwells --guide -o`` writes.
    rig : sidecar; None = ``NAME.toml`` beside the file.
    least : shortest rest that is used, s.

    Raises
    ------
    RecordingError
        If there is no rest, or not three outputs.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> table = pathlib.Path(tempfile.mkdtemp(), "faces.csv")
    >>> rows = ["0,5,500,0,0.1,9.81,0.01,0.01,0.01", "10,15,500,0.1,9.79,0,0.01,0.01,0.01"]
    >>> _ = table.write_text("\\n".join([",".join(POSITIONS), *rows]))
    >>> len(load_positions(table))
    2
    """
    rests = load_rests(Path(path), None if rig is None else Path(rig), least)
    if not rests.triad:
        raise RecordingError(
            f"{path}: one output; expected a record at rest whose sidecar maps {', '.join(TRIAD)}. load_dwells reads "
            "dwells of one output"
        )
    return rests.positions


def dwells_of(table: Table, declared: Sidecar, notes: list[Finding], sidecar: Path) -> Dwells:
    """The dwells that a table holds: one line each, or a recording at rest; errors are those of `load_dwells`."""
    if is_dwell_table(table):
        return dwells_from(table, declared, sidecar)
    return from_recording(loaded(table, declared, notes, need_position=False), declared, sidecar)


def from_recording(recording: Recording, declared: Sidecar, sidecar: Path) -> Dwells:
    """A recording at rest as one dwell."""
    setup = declared.dwell
    if setup is None or setup.angle is None:
        what = "is unknown" if setup is not None and setup.unknown else "is not declared"
        raise RecordingError(
            f"{recording.name}: the attitude of this dwell {what}; "
            + fix(sidecar, '[dwell]\nattitude = "up"   # or "down", "level", or angle = "30 deg"')
        )
    accel = recording.accel
    if len(accel) < 2:
        raise RecordingError(f"{recording.name}: {len(accel)} samples of the output; a dwell needs at least 2")
    warm = recording.side.get("temperature")
    step = float(accel.t[-1] - accel.t[0]) / (len(accel) - 1)
    return Dwells(
        angle=np.array([setup.angle]),
        mean=np.array([float(np.mean(accel.y))]),
        std=np.array([float(np.std(accel.y, ddof=1))]),
        duration=np.array([step * len(accel)]),
        samples=np.array([float(len(accel))]),
        group=("",),
        rig=declared.rig,
        temperature=None if warm is None else np.array([float(np.mean(warm.y))]),
        angle_std=setup.angle_std or 0.0,
        gravity=local_gravity(setup),
        name=recording.name,
        digest=recording.digest,
        assumptions=undeclared_of_dwells(setup),
    )


TRIAD = tuple(OUTPUTS.values())
"""Channels of the three outputs of a triad."""


POSITIONS = ("start_s", "end_s", "samples", *TRIAD, "std_x", "std_y", "std_z")
"""Header of a table of positions of a triad; outputs and their standard deviations in m/s²."""


@dataclass(frozen=True, slots=True)
class Rest:
    """One rest."""

    start: float
    """s"""
    end: float
    """s"""
    samples: int
    mean: tuple[float, ...]
    """Of each output."""
    std: tuple[float, ...]
    """Of the samples."""
    temperature: float | None
    """degC"""


@dataclass(frozen=True, slots=True)
class Rests:
    """Rests of one record."""

    name: str
    t: Array
    """(n,) s"""
    outputs: Array
    """(n, axes)"""
    names: tuple[str, ...]
    unit: str
    rests: tuple[Rest, ...]
    setup: DwellSetup
    rig: Rig
    digest: str = ""

    @property
    def triad(self) -> bool:
        """Whether three outputs at unknown attitudes are to be calibrated by the norm of gravity."""
        return len(self.names) == len(TRIAD)

    @property
    def positions(self) -> Positions:
        """Rests of a triad as positions."""
        warm = [rest.temperature for rest in self.rests]
        samples = np.array([float(rest.samples) for rest in self.rests])
        length = np.array([rest.end - rest.start for rest in self.rests])
        return Positions(
            mean=np.array([rest.mean for rest in self.rests]).reshape(-1, 3),
            std=np.array([rest.std for rest in self.rests]).reshape(-1, 3),
            samples=samples,
            gravity=local_gravity(self.setup),
            name=self.name,
            unit=self.unit,
            duration=length * samples / np.maximum(samples - 1.0, 1.0),
            temperature=None if None in warm else np.array(warm),
            rig=self.rig,
            digest=self.digest,
        )


def is_at_rest(path: Path, rig: Path | None) -> bool:
    """Whether a record holds outputs and nothing that may be a position, as one of a sensor at rest."""
    with suppress(RecordingError):
        recording = load(path, rig, need_position=False, need_accel=False)
        lengths = [channel for channel in recording.side.values() if channel.unit == "m"]
        unread = any(finding.kind == "unused_columns" for finding in recording.findings)
        outputs = len(recording.accel) or any(name in recording.side for name in TRIAD)
        return bool(outputs) and not (len(recording.position) or reference_among(recording.side) or lengths or unread)
    return False


def load_rests(path: Path, rig: Path | None, least: float) -> Rests:
    """Read a record and find its rests, each at least so long, s.

    Raises
    ------
    RecordingError
        If there is none, or the outputs of a triad are sampled at different times.
    """
    sidecar = rig or sidecar_of(path)
    declared = read_sidecar(sidecar) if rig is not None or has_sidecar(path) else no_sidecar()
    table = open_table(path)
    if set(POSITIONS) <= set(table.columns):
        return _positions(table, declared)
    triad = [name for name in TRIAD if name in declared.channels]
    if triad and len(triad) < len(TRIAD):
        lost = next(name for name in TRIAD if name not in triad)
        raise RecordingError(f"{sidecar}: channels.{lost} is missing; a triad is {', '.join(TRIAD)}: map it, too")
    setup = declared.dwell or DwellSetup()
    if triad and not setup.unknown:
        raise RecordingError(
            f"{sidecar}: three outputs are calibrated from positions of unknown attitude; "
            + fix(sidecar, '[dwell]\nattitude = "unknown"\ngravity = "9.81 m/s^2"')
        )
    recording = load(path, rig, need_position=False, need_accel=not triad)
    empty = [name for name in triad if name not in recording.side]
    if empty:
        column = declared.channels[empty[0]].column
        raise RecordingError(
            f'{path}: column "{column}", {empty[0]}: every cell is empty; expected an output of the triad, give '
            "its column"
        )
    channels = [recording.side[name] for name in TRIAD] if triad else [recording.accel]
    first = channels[0]
    for channel in channels[1:]:
        if len(channel) != len(first) or not np.array_equal(channel.t, first.t) or channel.unit != first.unit:
            raise RecordingError(
                f"{path}: {channel.name} and {first.name} differ in their times or units (first at t = "
                f"{units.instant(np.append(np.setxor1d(channel.t, first.t), first.t)[0])} s); expected one row for "
                "all three outputs of the triad"
            )
    outputs = np.column_stack([channel.y for channel in channels])
    warm = recording.side.get("temperature")
    dwells = []
    for a, b in rests(first.t, outputs, least):
        part = outputs[a : b + 1]
        inside = None if warm is None else warm.y[(warm.t >= first.t[a]) & (warm.t <= first.t[b])]
        dwells.append(
            Rest(
                float(first.t[a]),
                float(first.t[b]),
                b + 1 - a,
                tuple(part.mean(axis=0).tolist()),
                tuple(part.std(axis=0, ddof=1).tolist()),
                float(np.mean(inside)) if inside is not None and len(inside) else None,
            )
        )
    if not dwells:
        raise RecordingError(
            f"{path}: no rest of {least:g} s or more was found; look at the record, or give a shorter --least"
        )
    return Rests(
        path.name,
        first.t,
        outputs,
        (TRIAD if triad else ("output",)),
        first.unit,
        tuple(dwells),
        setup,
        declared.rig,
        recording.digest,
    )


def _positions(table: Table, declared: Sidecar) -> Rests:
    columns = table.read(POSITIONS)
    values = {name: complete_column(table, name, columns[name]) for name in POSITIONS}
    start, end, samples, *outputs = values.values()
    limits = [(f"std_{axis}", 0.0, np.inf, "a standard deviation of the samples") for axis in "xyz"]
    later = ("end_s", start + 1e-9, np.inf, "a time after start_s")
    require_between(table, values, [later, ("samples", 2.0, np.inf, "a number of samples, at least 2"), *limits])
    mean, std = np.stack(outputs[:3], axis=1), np.stack(outputs[3:], axis=1)
    norms = np.linalg.norm(mean, axis=1)
    if not 0.5 < (middle := float(np.median(norms))) / STANDARD_GRAVITY < 2.0:
        raise RecordingError(
            f"{table.path}: {', '.join(TRIAD)} have a norm of {middle:.4g} m/s² in the median of {len(norms)} rows; "
            f"expected about {STANDARD_GRAVITY:.4g} m/s². Check their unit, and that these are static positions"
        )
    listed = zip(start.tolist(), end.tolist(), samples.tolist(), mean.tolist(), std.tolist(), strict=True)
    rests = tuple(Rest(a, b, int(n), tuple(y), tuple(s), None) for a, b, n, y, s in listed)
    return Rests(
        table.path.name,
        start,
        mean,
        TRIAD,
        "m/s^2",
        rests,
        declared.dwell or DwellSetup(),
        declared.rig,
        digest_of(table.path),
    )


def write_positions(result: Rests, path: Path, mark: Callable[[str], str] = str) -> None:
    """Write the rests of a triad as a table of positions, with its sidecar; both replace what is there.

    Parameters
    ----------
    mark : as in `accelcal.io.write_sidecar`.
    """
    rows = [(r.start, r.end, r.samples, *r.mean, *r.std) for r in result.rests]
    text = "\n".join([",".join(POSITIONS), *(",".join(map(repr, row)) for row in rows)])
    with together():
        atomic_write(path, f"{text}\n")
        write_sidecar(result.rig, {}, sidecar_of(path), replace(result.setup, angle=None), mark=mark)


def table_of(result: Rests, degrees: list[float]) -> list[dict[str, Any]]:
    """One entry for each rest, by the header of a table of dwells."""
    rows = []
    for k, rest in enumerate(result.rests):
        length = rest.end - rest.start
        values = (
            degrees[k] if degrees else None,
            rest.mean[0] if len(rest.mean) == 1 else list(rest.mean),
            rest.std[0] if len(rest.std) == 1 else list(rest.std),
            length * rest.samples / (rest.samples - 1),
            rest.temperature,
            rest.samples,
            0,
        )
        rows.append({**dict(zip(COLUMNS, values, strict=True)), "start_s": rest.start, "end_s": rest.end})
    return rows


def write_table(result: Rests, degrees: list[float], path: Path, mark: Callable[[str], str] = str) -> Path:
    """Write the rests as a table of dwells, with its sidecar, whose path is returned; both replace what is there.

    Parameters
    ----------
    mark : as in `accelcal.io.write_sidecar`.
    """
    sidecar = sidecar_of(path)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in table_of(result, degrees):
        writer.writerow(["" if row[name] is None else repr(row[name]) for name in COLUMNS])
    with together():
        atomic_write(path, text.getvalue())
        write_sidecar(result.rig, {"accel": Source("mean", result.unit)}, sidecar, result.setup, mark=mark)
    return sidecar
