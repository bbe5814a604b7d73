"""From a file to a recording: read, convert, check."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from accelcal._support.arguments import checked
from accelcal.data import quality
from accelcal.data.recording import Channel, Finding, Recording, RecordingError
from accelcal.data.references import integrated, reference_among
from accelcal.data.rig import Rig
from accelcal.io.assign import Plan, assign
from accelcal.io.convert import in_seconds, in_si
from accelcal.io.dwell_table import digest_of, load_dwell_table
from accelcal.io.formats import open_table
from accelcal.io.orientation import asked, parts_of_orientation, with_orientation
from accelcal.io.sidecar import Clock, Sidecar, has_sidecar, no_sidecar, read_sidecar, sidecar_of
from accelcal.io.table import Column, Table
from accelcal.io.two_loggers import joined


@checked
def load(
    path: str | Path,
    rig: str | Path | Rig | None = None,
    *,
    position: str | Path | None = None,
    need_position: bool = True,
    need_accel: bool = True,
) -> Recording:
    """Read a recording and check it.

    Parameters
    ----------
    path : CSV (also .txt, .tsv), Parquet, MAT (v4 to v7.3), npz, HDF5, TDMS, UFF, MF4, MCAP, ROS bag, miniSEED or C3D.
    rig : sidecar file, or a `Rig` when the columns are found by their names; None = ``NAME.toml`` beside the file.
    position : file of another logger that recorded the position, with a sidecar of its own; the output is shifted onto
        its clock (`accelcal.data.alignment`), and a finding says by how much and how ambiguous that is.
    need_position : accept a file without position when False; its position then has shape (0,).
    need_accel : accept a planned motion, position alone, when False; its output then has shape (0,).

    Returns
    -------
    The recording in SI units, each channel on its own clock (shape (n,) each), with the findings of
    `accelcal.data.quality`.
    A unit comes from the column metadata, else the sidecar, else the suffix of the column name, else its brackets.

    Raises
    ------
    RecordingError
        Naming the file, the column or key, the row or time, what was expected and the next step.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> run = pathlib.Path(tempfile.mkdtemp(), "run.csv")
    >>> _ = run.write_text("t_s,accel_g,position_mm\\n0.0,0.1,0.0\\n0.1,0.2,\\n0.2,0.1,1.0\\n")
    >>> recording = load(run)
    >>> recording.position.y.tolist()
    [0.0, 0.001]
    """
    if position is not None:
        return _of_two_loggers(Path(path), Path(position), rig)
    path = Path(path)
    table = open_table(path)
    declared, notes = _declared(path, rig)
    recording = recording_of(table, declared, notes, need_position=need_position, need_accel=need_accel)
    recording = replace(recording, digest=digest_of(path))
    if declared.dwell is None or not declared.dwell.table:
        return recording
    return recording.with_dwells(load_dwell_table((declared.path or path).parent / declared.dwell.table))


def _of_two_loggers(output: Path, position: Path, rig: str | Path | Rig | None) -> Recording:
    """The output of one file and the position of another, aligned."""
    own, other = load(output, rig, need_position=False), load(position, need_accel=False)
    for recording, channel, place in ((own, own.position, output), (other, other.accel, position)):
        if len(channel):
            what = "a position" if channel is own.position else "an output"
            raise RecordingError(
                f"{place}: this file has {what} of its own, in {recording.name}; expected the output in the first file "
                "alone and the position in the second alone; give one file, or map its columns in a sidecar"
            )
    return joined(own, other)


def recording_of(
    table: Table, declared: Sidecar, notes: list[Finding], *, need_position: bool = True, need_accel: bool = True
) -> Recording:
    """The recording that a table holds, without its digest; parameters and errors are those of `load`."""
    path = table.path
    needs = {"accel": need_accel, "position": need_position and declared.attitude is None}
    required = tuple(name for name, needed in needs.items() if needed)
    plan, unused = assign(table, declared, required)
    findings, parts = notes + unused + asked(table, declared), parts_of_orientation(declared)
    channels = {}
    for name, samples in _samples(table, plan, declared.rig):
        if not len(samples.t) and name == "accel" and not need_accel:
            raise RecordingError(
                f'{path}: column "{plan.sources[name].column}": every cell is empty, expected the output of the '
                "accelerometer; a planned motion has columns for time and position alone."
            )
        if not len(samples.t) and name not in required:
            findings.append(Finding("empty", name, 0, 0.0, f"{name}: every cell is empty; the channel is left out"))
            continue
        channels[name], noticed = quality.clean(samples, declared.rig)
        findings += [] if name in parts else noticed
    channels, rig, noticed = with_orientation(str(path), channels, declared)
    findings += noticed
    accel = channels.pop("accel", Channel("accel", np.empty(0), np.empty(0), "m/s^2"))
    reference = channels.pop(reference_among(channels) or "", None) if needs["position"] else None
    if reference is not None:
        channels["position"] = of_reference(str(path), reference)
        text = f"position: not recorded; it is the integral of {reference.name}, from zero at the first reading"
        findings.append(Finding("integrated", "position", len(reference), 0.0, text))
    position = channels.pop("position", Channel("position", np.empty(0), np.empty(0), "m"))
    if len(accel) and len(position):
        quality.require_overlap(str(path), accel, position)
    return Recording(
        accel=accel,
        position=position,
        rig=rig,
        side=channels,
        name=path.name,
        findings=tuple(findings),
        labels=declared.labels,
        reference=reference,
    )


def of_reference(where: str, reference: Channel) -> Channel:
    """The position that a reference integrates to.

    Raises
    ------
    RecordingError
        Naming the file.
    """
    try:
        return integrated(reference)
    except RecordingError as error:
        raise RecordingError(f"{where}: {error}") from None


def _declared(path: Path, rig: str | Path | Rig | None) -> tuple[Sidecar, list[Finding]]:
    beside = sidecar_of(path)
    if rig is None:
        return (read_sidecar(beside) if has_sidecar(path) else no_sidecar()), []
    declared = Sidecar(rig=rig) if isinstance(rig, Rig) else read_sidecar(Path(rig))
    if not has_sidecar(path) or (declared.path is not None and declared.path.resolve() == beside.resolve()):
        return declared, []
    given = declared.path.name if declared.path is not None else "a rig"
    text = f"{beside.name} beside the recording is not read, because {given} was given in its place"
    return declared, [Finding("sidecar", "", 1, 0.0, text)]


def _samples(table: Table, plan: Plan, rig: Rig) -> Iterator[tuple[str, quality.Samples]]:
    """Yield each channel in SI, on the instants at which it was sampled."""
    wanted = [column for s in plan.sources.values() for column in (s.column, s.time and s.time.column) if column]
    raw = dict(table.read(list(dict.fromkeys(wanted))))
    clocks: dict[Clock, Column] = {}
    for name, source in plan.sources.items():
        clock = source.time
        assert clock is not None  # _plan gave each source one
        y = raw[source.column]
        if clock.rate is not None:
            stamps = Column(np.arange(len(y.values)) / clock.rate)
        else:
            if clock not in clocks:
                clocks[clock] = in_seconds(table, plan, clock, raw[str(clock.column)])
            stamps = clocks[clock]
        if len(stamps.values) != len(y.values):
            raise RecordingError(
                f'{table.path}: {name}: column "{source.column}" has {len(y.values)} values but its time column '
                f'"{clock.column}" has {len(stamps.values)}; give it its own: time = {{ column = "...", unit = "s" }}'
            )
        kept = _kept(table, name, stamps, y)
        values, unit = in_si(table, plan, name, source, rig, y.values if kept is None else y.values[kept])
        yield (
            name,
            quality.Samples(
                file=str(table.path),
                name=name,
                t=stamps.values if kept is None else stamps.values[kept],
                y=values,
                unit=unit,
                row=table.row if kept is None else lambda i, kept=kept: table.row(int(np.flatnonzero(kept)[i])),  # type: ignore[misc]
            ),
        )


def _kept(table: Table, name: str, stamps: Column, y: Column) -> NDArray[np.bool_] | None:
    """Return where a channel was sampled; None = everywhere."""
    if stamps.present is None:
        return y.present
    unstamped = ~stamps.present if y.present is None else y.present & ~stamps.present
    if unstamped.any():
        row = table.row(int(np.argmax(unstamped)))
        raise RecordingError(f"{table.path}: {row} has a value of {name} but no time; complete or delete this row.")
    return y.present
