"""From a file to a recording: read, convert, check; parts of a file, files of two loggers."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from shlex import quote
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from accelcal._support.arguments import checked
from accelcal._support.errors import visible
from accelcal.data import (
    ANGLE,
    DERIVED,
    GRAVITY,
    OUTPUTS,
    PLACE,
    STANDARD_GRAVITY,
    Array,
    Channel,
    Finding,
    Flags,
    Recording,
    RecordingError,
    Rig,
    integrated,
    quality,
    reference_among,
    units,
)
from accelcal.data.arrays import Unchanged, runs_of, within_spans
from accelcal.data.clocks import FEWEST, NEAR, THE_OUTPUT, Alignment, lost_rows, relation, restamped
from accelcal.data.orientation import (
    Sense,
)
from accelcal.data.recording import UNITS, Origin
from accelcal.io import naming
from accelcal.io.assign import (
    NoScaleError,
    Plan,
    assign,
    columns_of,
    fix,
    in_seconds,
    in_si,
    stated_unit,
    unit_of,
)
from accelcal.io.dialect import DAY
from accelcal.io.dwell_tables import load_dwell_table, local_gravity
from accelcal.io.files import digest_of, is_there, open_table
from accelcal.io.orientation import parts_of_orientation, undeclared_orientation, with_orientation
from accelcal.io.sidecar import (
    AXES,
    Clock,
    Sidecar,
    Source,
    declared_rate,
    declared_tables,
    has_sidecar,
    no_sidecar,
    read_sidecar,
    sidecar_from,
    sidecar_of,
    toml_text,
    with_one_output,
)
from accelcal.io.table import Column, Table
from accelcal.io.two_clocks import alignment_of, completed, declared_of_two, joined, of_two_clocks, on_trusted, table_of

Sampled = tuple[Array, Array, NDArray[np.intp] | None]
"""Stamps, s, and readings of a channel, and its rows in the file from 0, (n,) each; None = all."""
MOST_TRIED = 64
"""Columns that are asked whether they tell the sources of the rows apart."""
MOST_PARTS = 16
"""Sources of the rows of one table."""


@checked
def load(
    path: str | Path,
    rig: str | Path | Rig | None = None,
    *,
    position: str | Path | None = None,
    need_position: bool = True,
    need_accel: bool = True,
    part: int | None = None,
    axis: Literal["", "x", "y", "z"] = "",
) -> Recording:
    """Read a recording and check it.

    Parameters
    ----------
    path : CSV (also .txt, .tsv), or a container of `accelcal.io.decoding.known_formats`: Parquet, MAT, npz, a logger's.
    rig : sidecar file, or a `Rig` when the columns are found by their names; None = ``NAME.toml`` beside the file.
    position : file of another logger that recorded the position, with a sidecar of its own; the output is shifted onto
        its clock (`accelcal.data.clocks`), and a finding says by how much and how ambiguous that is.
    need_position : accept a file without position when False; its position then has shape (0,).
    need_accel : accept a planned motion, position alone, when False; its output then has shape (0,).
    part : of a file whose clock starts again, from 1.
    axis : of a file with the attitude of a body and three outputs; `load_axes` reads all three.

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
        return _of_two_loggers(Path(path), Path(position), rig, part)
    path = Path(path)
    table = open_table(path)
    return loaded(table, *declaration(path, rig, axis), part, need_position=need_position, need_accel=need_accel)


@checked
def load_axes(
    path: str | Path,
    rig: str | Path | None = None,
    *,
    position: str | Path | None = None,
    part: int | None = None,
) -> tuple[Recording, ...]:
    """Read the three outputs of one sensor on a body whose place and attitude are recorded.

    Parameters
    ----------
    path, rig, part : as of `load`; the sidecar maps accel_x, accel_y and accel_z beside [channels.attitude].
    position : file of another logger with the place and the attitude, with a sidecar of its own; the outputs, and a
        gyroscope beside them, are shifted onto its clock.

    Returns
    -------
    Recordings of the axes x, y and z, which `fit` takes together: one delay, lever arm, scale and direction of each.

    Raises
    ------
    RecordingError
        As `load`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> run = pathlib.Path(tempfile.mkdtemp(), "board.csv")
    >>> rows = [f"{0.01 * k:.2f},0.1,0.2,9.8,0,0,{1e-4 * k * k:.4f},1,0,0,0" for k in range(100)]
    >>> _ = run.write_text("\\n".join(["t_s,ax,ay,az,e_m,n_m,u_m,qw,qx,qy,qz", *rows]))
    >>> outputs = [f'accel_{a} = {{ column = "a{a}", unit = "m/s^2" }}' for a in "xyz"]
    >>> places = [f'position_{a} = {{ column = "{a}_m" }}' for a in "enu"]
    >>> attitude = 'attitude = { columns = ["qw", "qx", "qy", "qz"], maps = "sensor to ENU" }'
    >>> lines = ["[channels]", 'time = { column = "t_s" }', *outputs, *places, attitude]
    >>> _ = run.with_suffix(".toml").write_text("\\n".join(lines))
    >>> [axis.name for axis in load_axes(run)]
    ['board.csv x', 'board.csv y', 'board.csv z']
    """
    if position is None:
        return axes(open_table(Path(path)), rig, part)
    both = body_of_two(Path(path), Path(position), rig, part)
    outputs = axes(both.table, both.declared, whole=both.digest)
    return tuple(
        replace(
            recording,
            name=f"{both.name} {recording.axis}",
            origin=replace(recording.origin, file="", arguments=both.arguments),
            findings=(both.alignment, *recording.findings),
        )
        for recording in outputs
    )


def axes(
    table: Table, rig: str | Path | dict[str, Any] | None, part: int | None = None, whole: str = ""
) -> tuple[Recording, ...]:
    """The recordings of the three outputs that a table holds; parameters and errors are those of `load_axes`.

    Parameters
    ----------
    rig : as of `load_axes`, or the tables of a sidecar.
    whole : digest of the table, where it is no file.
    """
    columns: dict[str, Column] = {}

    def once(names: Sequence[str]) -> Mapping[str, Column]:
        columns.update(table.read([name for name in names if name not in columns]))
        return {name: columns[name] for name in names}

    shared, digest = replace(table, read=once), whole or digest_of(table.path)
    unchanged = Unchanged()
    declared = (
        (sidecar_from(rig, sidecar_of(table.path), axis), list[Finding]())
        if isinstance(rig, dict)
        else declaration(table.path, rig, axis)
        for axis in OUTPUTS
    )
    return tuple(loaded(shared, *what, part, digest, unchanged=unchanged) for what in declared)


def loaded(
    table: Table,
    declared: Sidecar,
    notes: list[Finding],
    part: int | None = None,
    whole: str = "",
    *,
    need_position: bool = True,
    need_accel: bool = True,
    unchanged: Unchanged | None = None,
) -> Recording:
    """The recording that a table holds, or one of its outputs; parameters and errors are those of `load`.

    Parameters
    ----------
    declared, notes : as `declaration` gives them.
    whole : digest of the file, where it is known.
    unchanged : of another output of the same body, whose motion it holds.
    """
    path, axis = table.path, declared.axis
    if declared.triad:
        raise RecordingError(
            f"{declared.path}: three outputs, {', '.join(OUTPUTS.values())}; expected one. load_axes reads all three, "
            'load(..., axis="x") one of them'
        )
    try:
        needs = {"need_position": need_position, "need_accel": need_accel}
        recording = recording_of(table, declared, notes, **needs, part=part, unchanged=unchanged)
    except NoScaleError as error:
        raise RecordingError(f"{error}{sensitivity_shown(table, declared)}") from None
    whole = whole or digest_of(path)
    digest = whole if part is None else hashlib.sha256(f"{whole} part {part}".encode()).hexdigest()
    recording = replace(recording, digest=digest, axis=axis, name=f"{recording.name} {axis}".rstrip())
    if declared.dwell is None or not declared.dwell.table:
        return recording
    return recording.with_dwells(load_dwell_table((declared.path or path).parent / declared.dwell.table))


def sensitivity_shown(table: Table, declared: Sidecar) -> str:
    """The sensitivity that motion shows of an output in V or counts, where none is declared; else empty."""
    for output in units.ELECTRICAL if declared.rig.sensor.scale is None else ():
        sensor = replace(declared.rig.sensor, scale=1.0, scale_unit=output)
        with suppress(ValueError):
            recording = recording_of(table, replace(declared, rig=replace(declared.rig, sensor=sensor)), [])
            slope, correlation = relation(recording.accel, recording.position)
            if abs(correlation) > THE_OUTPUT:
                shown = declared.rig.polarity * slope * STANDARD_GRAVITY
                return f'\nBy the motion of this recording it is about scale = "{shown:.4g} {output}/g"'
    return ""


def _of_two_loggers(output: Path, position: Path, rig: str | Path | Rig | None, part: int | None) -> Recording:
    """The output of one file and the position of another, aligned."""
    if is_there(position) and is_there(output) and position.samefile(output):  # two tables, each with its clock
        both = load(output, rig, part=part)
        if any(finding.kind == "alignment" for finding in both.findings):
            return both
        nothing, declared = np.empty(0), declaration(output, rig)[0]
        return joined(
            replace(both, position=Channel("position", nothing, nothing, "m")),
            replace(both, accel=Channel("accel", nothing, nothing, "m/s^2"), side={}, findings=()),
            (declared_rate(declared, "accel"), declared_rate(declared, "position")),
        )
    first, other = load(output, rig, need_position=False, part=part), load(position, need_accel=False)
    for recording, channel, place in ((first, first.position, output), (other, other.accel, position)):
        if len(channel):
            what = "a position" if channel is first.position else "an output"
            raise RecordingError(
                f"{place}: this file has {what} of its own, in {recording.name}; expected the output in the first file "
                "alone and the position in the second alone; give one file, or map its columns in a sidecar"
            )
    declared, of_position = declaration(output, rig)[0], declaration(position, None)[0]
    return joined(first, other, (declared_rate(declared, "accel"), declared_rate(of_position, "position")))


@dataclass(frozen=True, slots=True)
class Body:
    """What two loggers recorded of one body, its outputs and its place and attitude, on the clock that is trusted."""

    table: Table
    """In SI, on all instants at which anything was read."""
    declared: dict[str, Any]
    """Tables of a sidecar of it."""
    alignment: Finding
    digest: str
    name: str
    arguments: str
    """What a command is given for it."""


def body_of_two(output: Path, position: Path, rig: str | Path | None = None, part: int | None = None) -> Body:
    """Three outputs of one file laid upon the place and attitude of another by the axis that shows it most clearly.

    Parameters
    ----------
    output, position, rig, part : as of `load_axes`.

    Raises
    ------
    RecordingError
        As `load_axes`, and if the outputs and the attitude are not one in each file, or no axis can be aligned.
    """
    beside, other = sidecar_of(output) if rig is None else Path(rig), sidecar_of(position)
    of_output, of_body = declared_tables(beside), declared_tables(other)
    for path, content in ((beside, of_output), (other, of_body)):
        if not all(isinstance(table, dict) for table in content.values()):
            sidecar_from(content, path)  # says which is none
    channels, of_place = of_output.get("channels", {}), of_body.get("channels", {})
    outputs = {*OUTPUTS.values()}
    lacking = outputs - {*channels} or {"attitude"} - {*of_place}
    if lacking or {"accel", "attitude"} & {*channels} or {"accel", *outputs} & {*of_place}:
        raise RecordingError(
            f"{beside} and {other}: expected {', '.join(OUTPUTS.values())} in the first alone and {', '.join(PLACE)} "
            "with [channels.attitude] in the second alone; map them so, with the time of each"
        )
    declared = sidecar_from({**of_body, "rig": {**of_body.get("rig", {}), "input_axis": "x"}}, other)
    body, findings, _ = channels_of(open_table(position), declared, ())
    table, accels, beside_them = open_table(output), dict[str, Channel](), dict[str, Channel]()
    for name in OUTPUTS.values():
        sidecar = sidecar_from(with_one_output(of_output, name), beside)
        beside_them, noticed, _ = channels_of(table, sidecar, ("accel",), part)
        accels[name] = replace(beside_them.pop("accel"), name=name)
        findings += [note for note in noticed if note not in findings and note.kind not in OF_ONE_FILE]
    what = visible(f"{output.name} with {position.name}", one_line=True)
    assert declared.attitude is not None
    along = partial(of_axis, position, body, declared)
    best = clocks_of_body(accels, along, declared.attitude.maps, sidecar, what)
    rig_of_both = completed(sidecar.rig, declared.rig)
    rates = declared_rate(sidecar, "accel"), declared_rate(declared, PLACE[0])
    of_outputs, of_places, note = on_trusted(rig_of_both, best, rates, accels["accel_x"].t[0])
    together = [restamped(y, of_outputs) for y in (*accels.values(), *beside_them.values())]
    together += [restamped(channel, of_places) for name, channel in body.items() if name not in beside_them]
    tables = declared_of_two(of_output, of_body, rig_of_both, best, together)
    for axis in OUTPUTS:
        sidecar_from(tables, beside, axis)  # says what none may declare
    digest = f"{digest_of(output)} at {best.shift!r} on {digest_of(position)}"
    return Body(
        replace(table_of(output, together), notes=findings),
        tables,
        note,
        hashlib.sha256(digest.encode()).hexdigest(),
        what,
        f"{arguments_for(output, sidecar.path)} --position {quote(position.name)}",
    )


OF_ONE_FILE = "unused_columns", "orientation"
"""Notes on what a file lacks that another has."""


def of_axis(
    file: Path, body: Mapping[str, Channel], declared: Sidecar, axis: str, sense: Sense
) -> tuple[Channel, Channel]:
    """Path and gravity along an axis of a body, as `with_orientation` has them, where its attitude has a sense."""
    assert declared.attitude is not None
    turned = replace(declared, input_axis=AXES[axis], attitude=replace(declared.attitude, maps=sense))
    channels, *_ = with_orientation(str(file), body, turned)
    return channels["position"], channels[GRAVITY]


def since(alignment: Alignment, first: float, other: float) -> Alignment:
    """An alignment whose shift is that of another first sample, s, where the rates of the clocks differ."""
    return replace(alignment, shift=float(alignment.instants(np.array([other]), first)[0] - other))


def clocks_of_body(
    accels: Mapping[str, Channel],
    along: Callable[[str, Sense], tuple[Channel, Channel]],
    sense: Sense,
    declared: Sidecar,
    what: str,
) -> Alignment:
    """How the clock of three outputs lies upon that of place and attitude: by the output that tells it best.

    Parameters
    ----------
    accels : outputs by the name of their channel.
    along : path and gravity along an axis, with a sense of the attitude.
    sense : the declared one.
    declared : sidecar of the outputs.
    what : names of the files, for messages.

    Raises
    ------
    RecordingError
        If the outputs fit at no shift together.
    """

    def best(sense: Sense) -> Alignment | None:
        """The shift that an output tells best and at which the others are like what is made of the body, too."""
        pairs = []
        for axis, name in OUTPUTS.items():
            position, gravity = along(axis, sense)
            accel = replace(accels[name], name="accel")
            pairs.append(Recording(accel, position, declared.rig, side={GRAVITY: gravity}, name=f"{what} {axis}"))
        alone, first = list[Alignment](), pairs[0].accel.t[0]
        for pair in pairs:
            short = min(len(pair.accel), len(pair.position)) < FEWEST
            with nullcontext() if short else suppress(RecordingError):  # which no sense of the attitude mends
                alone.append(since(alignment_of(pair, ()), pair.accel.t[0], first))
        for fit in sorted(alone, key=lambda fit: (fit.is_ambiguous, fit.std)):
            near = (alignment_of(pair, (), near=since(fit, first, pair.accel.t[0])) for pair in pairs)
            if all(alignment.correlation > NEAR for alignment in near):
                return fit
        return None

    if (fit := best(sense)) is not None:
        return fit
    other: Sense = "ENU to sensor" if sense == "sensor to ENU" else "sensor to ENU"
    raise RecordingError(
        f"{what}: at no shift of the clocks are the three outputs like what place and attitude make of them; "
        + (
            "check that both files are of one run, the order of the columns of the attitude, and the signs of the "
            "outputs, or record a longer motion that does not repeat"
            if best(other) is None
            else f'they are with maps = "{other}": write that in [channels.attitude]'
        )
    )


def recording_of(
    table: Table,
    declared: Sidecar,
    notes: list[Finding],
    *,
    need_position: bool = True,
    need_accel: bool = True,
    part: int | None = None,
    unchanged: Unchanged | None = None,
) -> Recording:
    """The recording that a table holds, without its digest; parameters and errors are those of `load`."""
    path = table.path
    needs = {"accel": need_accel, "position": need_position and not declared.turns}
    channels, noticed, plan = channels_of(
        table, declared, tuple(name for name, needed in needs.items() if needed), part
    )
    findings = notes + noticed
    channels, rig, noticed = with_orientation(str(path), channels, declared, unchanged)
    findings += noticed
    accel = channels.pop("accel", Channel("accel", np.empty(0), np.empty(0), "m/s^2"))
    reference = channels.pop(reference_among(channels) or "", None) if needs["position"] else None
    if reference is not None:
        channels["position"] = of_reference(str(path), reference)
        text = f"position: not recorded; it is the integral of {reference.name}, from zero at the first reading"
        findings.append(Finding("integrated", "position", len(reference), 0.0, text))
    position = channels.pop("position", Channel("position", np.empty(0), np.empty(0), "m"))
    anew = {(finding.kind, finding.channel) for finding in findings}
    findings += [finding for finding in declared.noticed if (finding.kind, finding.channel) not in anew]
    recording = Recording(
        accel=accel,
        position=position,
        rig=rig,
        side=channels,
        name=visible(path.name, one_line=True),
        findings=tuple(findings),
        labels=declared.labels,
        reference=reference,
        origin=origin_of(table, plan, declared),
        gravity=local_gravity(declared.dwell),
        prior_sizes=declared.prior_sizes,
    )
    clocks = {name: source.time for name, source in plan.sources.items()}
    motion_channel = ANGLE if declared.angle_zero is not None else "position" if reference is None else reference.name
    if len(accel) and clocks.get(motion_channel, clocks["accel"]) != clocks["accel"]:
        beside = [name for name in channels if clocks.get(name) == clocks["accel"]]
        rates = declared_rate(declared, "accel"), declared_rate(declared, motion_channel)
        recording = of_two_clocks(recording, rates, beside)
    if len(accel) and len(position):
        quality.require_overlap(str(path), recording.accel, recording.position)
    return recording


def channels_of(
    table: Table, declared: Sidecar, required: tuple[str, ...], part: int | None = None
) -> tuple[dict[str, Channel], list[Finding], Plan]:
    """The channels of a table, cleaned, by name, what was noticed of them, and where they come from.

    Parameters
    ----------
    declared, part : as of `loaded`.
    required : those without which the table is of no use.
    """
    path = table.path
    plan, unused = assign(table, declared, required)
    findings, parts = unused + undeclared_orientation(table, declared), parts_of_orientation(declared)
    channels: dict[str, Channel] = {}
    for name, samples in _samples(table, plan, declared.rig, part, findings):
        column = plan.sources[name].column
        if not len(samples.t) and name == "accel" and len(table.read([column])[column].values):
            planned = "a planned motion has columns for time and position alone"
            text = "give another column" if name in required else planned
            raise RecordingError(
                f'{path}: column "{column}": every cell is empty, expected the output of the accelerometer; {text}'
            )
        if not len(samples.t) and name not in required:
            findings.append(Finding("empty", name, 0, 0.0, f"{name}: every cell is empty; the channel is left out"))
            continue
        try:
            channels[name], noticed = quality.clean(samples, declared.rig)
        except RecordingError:
            if in_turn := _in_turn(table, plan, name):
                raise RecordingError(in_turn) from None
            raise
        findings += [] if name in parts else noticed
    return channels, findings + table.notes, plan


def origin_of(table: Table, plan: Plan, declared: Sidecar) -> Origin:
    """The columns of a recording and their units, as they were read."""
    columns = {
        name: (source.column, stated_unit(table, plan, name, source.column, source.unit))
        for name, source in plan.sources.items()
    }
    clock = plan.sources["accel"].time if "accel" in plan.sources else None
    if clock is not None and clock.rate is None and clock.column is not None:
        columns["time"] = clock.column, stated_unit(table, plan, "time", clock.column, clock.unit)
    scales = {name: source.scale[:2] for name, source in plan.sources.items() if source.scale is not None}
    return Origin(str(table.path), str(declared.path or ""), arguments_for(table.path, declared.path), columns, scales)


def arguments_for(path: Path, sidecar: Path | None) -> str:
    """What a command is given to read a file with a sidecar, as a shell takes it."""
    return quote(str(path)) + (f" --rig {quote(str(sidecar))}" if sidecar not in (None, sidecar_of(path)) else "")


def other_outputs(recording: Recording) -> Iterator[tuple[str, str, Channel]]:
    """Further channels that may be the output of a recording: column, unit, and what it reads in m/s².

    Those are its side channels, and columns of its file that no sidecar maps, if there is a file and it can be read.
    """
    origin = recording.origin
    for name, channel in recording.side.items():
        if channel.unit == "m/s^2" and name not in DERIVED:
            yield *origin.columns.get(name, (name, channel.unit)), channel
    if not origin.file:
        return
    table = open_table(Path(origin.file))
    declared = read_sidecar(Path(origin.sidecar), recording.axis) if origin.sidecar else Sidecar(rig=recording.rig)
    plan, taken = assign(table, declared, ())[0], {*declared.aside, *(column for column, _ in origin.columns.values())}
    clock = plan.sources["accel"].time
    beside = {name: s for name, s in plan.sources.items() if s.time != clock}  # dates count from the first of all
    for column in table.columns:
        stated, role = unit_of(table, column), naming.role(naming.take_apart(column).base)
        source = replace(plan.sources["accel"], column=column, unit=None if stated else origin.columns["accel"][1])
        with suppress(ValueError):  # of another quantity, or no numbers
            read = (
                ()
                if column in taken or role == "time"
                else _samples(table, Plan({**beside, "accel": source}, plan.sidecar), declared.rig, None, [])
            )
            for sampled, samples in read:
                if sampled == "accel" and len(samples.t) > 1:
                    yield column, stated or origin.columns["accel"][1], quality.clean(samples, declared.rig)[0]


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


def declaration(path: Path, rig: str | Path | Rig | None, axis: str = "") -> tuple[Sidecar, list[Finding]]:
    """What is declared of a file, or of one of its outputs, and a note where that is not the sidecar beside it."""
    beside = sidecar_of(path)
    if rig is None:
        return (read_sidecar(beside, axis) if has_sidecar(path) else no_sidecar()), []
    declared = Sidecar(rig=rig) if isinstance(rig, Rig) else read_sidecar(Path(rig), axis)
    if not has_sidecar(path) or (declared.path is not None and declared.path.resolve() == beside.resolve()):
        return declared, []
    name = declared.path.name if declared.path is not None else "a rig"
    text = f"{beside.name} beside the recording is not read, because {name} was given in its place"
    return declared, [Finding("sidecar", "", 1, 0.0, text)]


def _samples(
    table: Table, plan: Plan, rig: Rig, part: int | None, findings: list[Finding]
) -> Iterator[tuple[str, quality.Samples]]:
    """Yield each channel in SI, on the instants at which it was sampled; of one part where a clock starts again.

    What is noticed of the clocks is added to the findings.
    """
    wanted = [source.column for source in plan.sources.values()]
    clocks = list(dict.fromkeys(s.time for s in plan.sources.values() if s.time is not None and s.time.column))
    for timing in clocks:
        wanted += columns_of(timing)
        table.orders.update({name: timing.order for name in (timing.column, timing.date) if name and timing.order})
    raw = dict(table.read(list(dict.fromkeys(wanted))))
    once = (
        None if clocks or "accel" not in plan.sources else _once(table, [raw[name].values for name in wanted], findings)
    )
    instants: dict[Clock, Column] = {}
    for timing in clocks:
        instants[timing], noticed = _instants(table, plan, timing, raw)
        findings += noticed
    _require_one_kind(table, plan, instants)
    began = min((stamps.origin for stamps in instants.values() if stamps.origin is not None), default=0)
    sampled: dict[str, Sampled] = {}
    for name, source in plan.sources.items():
        clock = source.time
        assert clock is not None  # _plan gave each source one
        y, chosen = raw[source.column], _rows_where(table, source, name)
        if once is not None:
            chosen = once if chosen is None else chosen & once
        if chosen is not None:
            y = Column(y.values[chosen], None if y.present is None else y.present[chosen])
        if clock.column is None:
            assert clock.rate is not None
            stamps = Column(np.arange(len(y.values)) / clock.rate)
        else:
            stamps = instants[clock]
            if stamps.origin is not None:  # dates of every clock count from the first of all
                stamps = Column(stamps.values + 1e-9 * (stamps.origin - began), stamps.present)
            if chosen is not None and len(stamps.values) == len(chosen):
                stamps = Column(stamps.values[chosen], None if stamps.present is None else stamps.present[chosen])
        if len(stamps.values) != len(y.values):
            raise RecordingError(
                f'{table.path}: {name}: column "{source.column}" has {len(y.values)} values but its time column '
                f'"{clock.column}" has {len(stamps.values)}; give it its own: time = {{ column = "...", unit = "s" }}'
            )
        filled = _sampled_rows(table, name, stamps, y)
        rows = slice(None) if filled is None else filled
        sampled[name] = stamps.values[rows], y.values[rows], _places(chosen, filled)
    _with_lost_rows(plan, sampled, findings)
    try:
        run = _part(table, sampled, part, plan.sidecar)
    except RecordingError:
        texts = (_in_turn(table, plan, name) for name in sampled)
        if in_turn := next(filter(None, texts), None):
            raise RecordingError(in_turn) from None
        raise
    for name, (t, read, places) in sampled.items():
        if run is not None:
            places = np.arange(len(t)) if places is None else places
            inside = slice(*np.searchsorted(places, run))
            t, read, places = t[inside], read[inside], places[inside]
        values, unit = in_si(table, plan, name, plan.sources[name], rig, read)
        yield (
            name,
            quality.Samples(
                file=str(table.path),
                name=name,
                t=t,
                y=values,
                unit=unit,
                row=table.row if places is None else lambda i, places=places: table.row(int(places[i])),  # type: ignore[misc]
            ),
        )


def _once(table: Table, columns: Sequence[Array], findings: list[Finding]) -> Flags | None:
    """Which rows of a table without stamps do not repeat a block before them, (n,); None = all.

    What is left out is added to the findings: repeated rows have no time of their own.
    """
    blocks = quality.repeated_rows(columns) if len({len(y) for y in columns}) == 1 else []
    if not blocks:
        return None
    once = ~within_spans(blocks, len(columns[0]))
    begin, end = blocks[0]
    text = (
        f"{np.count_nonzero(~once)} rows repeat the rows before them ({len(blocks)} blocks, first {table.row(begin)} "
        f"to {table.row(end - 1)}) and are left out"
    )
    findings.append(Finding("repeated_rows", "", int(np.count_nonzero(~once)), float(begin), text, "warning"))
    return once


def _with_lost_rows(plan: Plan, sampled: dict[str, Sampled], findings: list[Finding]) -> None:
    """Leave a gap in channels without stamps where rows were lost, and add that to the findings."""
    alike: dict[tuple[Clock | None, int], list[str]] = {}
    for name in sampled.keys() & {"accel", *UNITS}:
        alike.setdefault((plan.sources[name].time, len(sampled[name][0])), []).append(name)
    for (clock, n), names in alike.items():
        t = sampled[names[0]][0]
        if clock is None or clock.rate is None or clock.column or n < 2 or (t[-1] - t[0]) * clock.rate > n - 0.5:
            continue
        lost = lost_rows([sampled[name][1] for name in names])
        if lost is None:
            continue
        for name in names:
            sampled[name] = t + np.cumsum(lost) / clock.rate, *sampled[name][1:]
        count, first = int(np.sum(lost)), float(t[np.argmax(lost > 0)])
        text = (
            f"{' and '.join(sorted(names))}: {count} rows ({count / (n + count):.2%}) were lost before the file was "
            f"written (first at t = {units.instant(first)} s): the readings step there by what they change by in whole "
            f"rows, however fast; gaps are left in their place, at {clock.rate:.6g} Hz as declared. Record a counter "
            "with each row: where a motion is slow, a loss may hide"
        )
        findings.append(Finding("lost_rows", names[0], count, first, text, "warning"))


def _part(table: Table, sampled: Mapping[str, Sampled], part: int | None, sidecar: Path) -> tuple[int, int] | None:
    """First row of a part of a file whose clock starts again, from 0, and the row behind it; None for all of one whose
    clock does not.

    Raises
    ------
    RecordingError
        If it does and no part is asked for, or one that is not there; it names the parts. If rows are out of order; it
        names them.
    """
    again: dict[int, tuple[float, float]] = {}
    strays: dict[int, str] = {}
    last, ends = 0, (0.0, 0.0)
    for t, _, places in sampled.values():
        if not len(t) or not np.all(np.isfinite(t)):
            continue
        back = np.flatnonzero(np.diff(t) < 0.0) + 1
        for k in back.tolist():
            again.setdefault(int(k if places is None else places[k]), (float(t[k - 1]), float(t[k])))
        if len(back):
            reached = np.maximum.accumulate(t)
            below = runs_of(t < reached)
            short = below[(np.ptp(below, axis=1) <= MOST_STRAYS) & (below[:, 1] < len(t))]
            for first, end in short.tolist():
                for k in range(first, end):
                    row = int(k if places is None else places[k])
                    strays[row] = f"{table.row(row)} ({units.instant(t[k])} s after {units.instant(reached[k])} s)"
        last, ends = max(last, int(len(t) if places is None else places[-1] + 1)), (float(t[0]), float(t[-1]))
    if part in (None, 1) and not (again and is_there(table.path)):
        return None  # of arrays `clean` says it
    if strays:
        are, them = "s are", "their order is not known; correct or delete them"
        if len(strays) == 1:
            are, them = " is", "its place is not known; correct or delete it"
        named = [strays[row] for row in sorted(strays)]
        raise RecordingError(f"{table.path}: {len(strays)} row{are} out of order: {_few(named, ', ')}; {them}")
    parts = list(pairwise([0, *sorted(again), last]))
    if part is not None and 1 <= part <= len(parts):
        return parts[part - 1]
    edges = [ends[0], *(instant for row in sorted(again) for instant in again[row]), ends[1]]
    named = [
        f"part {number}, {table.row(begin)} to {table.row(end - 1)} ({units.instant(edges[2 * number - 2])} s to "
        f"{units.instant(edges[2 * number - 1])} s)"
        for number, (begin, end) in enumerate(parts, 1)
    ]
    listed = _few(named, "; ")
    if part is not None:
        raise RecordingError(
            f"{table.path}: --part {part}: the file has {len(parts)} parts: {listed}; give one of them"
        )
    begin = parts[1][0]
    raise RecordingError(
        f"{table.path}: the clock starts again at {table.row(begin)}: {edges[2]:.9g} s after {edges[1]:.9g} s. The "
        f"file holds {len(parts)} runs: {listed}. Write each to a file of its own: "
        f"accelcal cut {arguments_for(table.path, sidecar)} --part 1 -o {quote(f'{table.path.stem}_1.csv')}"
    )


MOST_NAMED = 4
"""Parts or rows of a file that a sentence names."""
MOST_STRAYS = 8
"""Rows behind a step back of the clock within which it is further on than before: they are out of order."""


def _few(named: list[str], between: str) -> str:
    """The first of many in a sentence, and the last."""
    return between.join(named if len(named) <= MOST_NAMED else [*named[: MOST_NAMED - 1], "...", named[-1]])


def _places(chosen: Flags | None, rows: Flags | None) -> NDArray[np.intp] | None:
    """Which rows of the file a channel has, from 0; None = all."""
    if chosen is None:
        return None if rows is None else np.flatnonzero(rows)
    return np.flatnonzero(chosen) if rows is None else np.flatnonzero(chosen)[rows]


def _rows_where(table: Table, source: Source, name: str) -> Flags | None:
    """Which rows are those of a channel, (n,); None = all.

    Raises
    ------
    RecordingError
        If none is.
    """
    if source.where is None:
        return None
    column, value = source.where
    labels = _labels(table, column)
    chosen = labels == (str(value) if labels.dtype.kind == "U" else value)
    if not np.any(chosen):
        raise RecordingError(
            f'{table.path}: {name}: no row has {units.shown(value)} in column "{column}"; correct where in the sidecar'
        )
    return np.asarray(chosen, dtype=np.bool_)


def _labels(table: Table, column: str) -> NDArray[Any]:
    """The cells of a column, numbers or texts, (n,)."""
    return table.text(column) if column in table.texts else table.read([column])[column].values


def _require_one_kind(table: Table, plan: Plan, instants: Mapping[Clock, Column]) -> None:
    """Refuse an output and a reference of which one has dates and the other has none: how they belong together is not
    said."""
    measured = [s for name, s in plan.sources.items() if name == "accel" or name in UNITS]
    stamps = {s.column: instants[s.time] for s in measured if s.time and s.time in instants and s.time.rate is None}
    dated, plain = ([c for c, t in stamps.items() if (t.origin is not None) == is_date] for is_date in (True, False))
    if dated and plain:
        raise RecordingError(
            f'{table.path}: the stamps of "{dated[0]}" are dates, those of "{plain[0]}" are not, so nothing tells how '
            "the two belong together; give both as dates, or both in seconds of one clock"
        )


def _instants(table: Table, plan: Plan, clock: Clock, raw: Mapping[str, Column]) -> tuple[Column, list[Finding]]:
    """The stamps of a clock, s: its column, on the day of a date, with a fraction of the second added; and what was
    noticed of them."""
    assert clock.column is not None  # a clock without a counter has a rate, or names a column
    measured = [plan.sources[name] for name in ("accel", "position") if name in plan.sources]
    readings = [raw[s.column] for s in measured if s.time == clock and s.where is None and s.column in raw]
    stamps, noticed = in_seconds(table, plan, clock, raw[clock.column], readings)
    if clock.date is not None:
        day = raw[clock.date]
        stamps = Column(stamps.values % DAY + day.values, _both(stamps.present, day.present), day.origin)
    if clock.fraction is not None:
        rest = raw[clock.fraction.column]
        more, _ = in_seconds(table, plan, Clock(clock.fraction.column, clock.fraction.unit), rest)
        stamps = Column(stamps.values + more.values, _both(stamps.present, rest.present), stamps.origin)
    return stamps, noticed


def _both(first: Flags | None, other: Flags | None) -> Flags | None:
    return other if first is None else first if other is None else first & other


def _in_turn(table: Table, plan: Plan, name: str) -> str | None:
    """The sentence on a column by whose values the rows fall into parts with rising stamps; None where none does so."""
    source = plan.sources[name]
    clock = source.time
    if clock is None or clock.column is None or source.where is not None:
        return None
    stamps = columns_of(clock)
    t = _instants(table, plan, clock, table.read(stamps))[0].values
    if np.all(t[1:] > t[:-1]):
        return None
    for column in table.columns[:MOST_TRIED]:
        if column in (source.column, *stamps):
            continue
        with suppress(RecordingError):
            labels = _labels(table, column)
            values, parts = np.unique(labels, return_inverse=True) if len(labels) == len(t) else (labels[:0], labels)
            stretches = [t[parts == k] for k in range(len(values))] if 1 < len(values) <= MOST_PARTS else []
            if stretches and all(len(part) > 1 and np.all(part[1:] > part[:-1]) for part in stretches):
                texts = [toml_text(str(v)) if labels.dtype.kind == "U" else f"{v:g}" for v in values]
                return (
                    f"{table.path}: {name}: the rows belong to {len(values)} sources in turn: the stamps rise in the "
                    f'rows with one value of column "{column}" ({", ".join(texts)}), and not in all rows together. '
                    f"Say which is meant; {fix(plan.sidecar, _line_where(table, plan, name, column, texts[0]))}"
                )
    return None


def _line_where(table: Table, plan: Plan, name: str, column: str, value: str) -> str:
    """The lines of a sidecar that give a channel the rows with one value of a column."""
    source = plan.sources[name]
    where = f"where = {{ column = {toml_text(column)}, equals = {value} }}"
    unit = source.unit or unit_of(table, source.column) or "..."
    return f'[channels]\n{name} = {{ column = {toml_text(source.column)}, unit = "{unit}", {where} }}'


def _sampled_rows(table: Table, name: str, stamps: Column, y: Column) -> NDArray[np.bool_] | None:
    """Return where a channel was sampled; None = everywhere."""
    if stamps.present is None:
        return y.present
    unstamped = ~stamps.present if y.present is None else y.present & ~stamps.present
    if unstamped.any():
        row = table.row(int(np.argmax(unstamped)))
        raise RecordingError(f"{table.path}: {row} has a value of {name} but no time; complete or delete this row.")
    return y.present
