"""Commands on recordings and dwells: describe, check, cut, simulate, dwells."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from accelcal._support.stopping import deferred
from accelcal.cli import printing
from accelcal.cli.common import (
    EffectsFile,
    Json,
    OfPosition,
    Output,
    Rig,
    RunFile,
    UsageError,
    app,
    deliver,
    parse_quantity,
    print_alignment,
    print_json,
    print_status,
    print_written,
    progress,
    require_ending,
    require_folder,
    say_line,
    show_table,
    suggest,
    time_range,
    with_exit_codes,
    writable_file,
)
from accelcal.cli.lazy import catalogue, data, drawing, io, noises, resting, sensors, sessions, triads, words
from accelcal.cli.overwriting import mark_of

if TYPE_CHECKING:
    from accelcal.io.stream import ByteSource


@app.command()
@with_exit_codes
def init(run: RunFile) -> None:
    """Write a commented sidecar template for a recording, filled in as far as the file allows.

    Example: [bold]accelcal init run12.csv[/bold] writes run12.toml.
    """
    needed = any('"?"' in line and not line.startswith("#") for line in io.init(run).splitlines())
    what = "fill in the marked lines" if needed else "check what it takes each column for"
    print_status(f"wrote {io.sidecar_of(run)}: {what}, then run: accelcal check {run}")


def checked_recording(recording: data.Recording) -> tuple[dict[str, Any], list[str], bool]:
    """Report of a check on a recording for JSON, the same as lines, and whether a declaration must be corrected before
    any fit."""
    from accelcal.diagnosis.faults import Examined
    from accelcal.estimation.plausible import suspicion
    from accelcal.estimation.run import recording_of

    data.quality.require_varying(recording)
    if recording.prior_sizes:  # compared with the catalogue; the search takes a while to import
        from accelcal.diagnosis.search.confounding import size_priors

        size_priors([recording], None)
    examined = Examined(recording)
    try:
        noticed, breaks = examined.remarks(), list(examined.breaks)
    except data.RecordingError:  # too short to look for any: the summary says how long it is
        noticed, breaks = [], []
    faults = [note.sentence for note in noticed]
    suspect = [text for text in [suspicion(recording_of(examined.stepped[0]))] if text]
    content = {**data.quality.describe(recording), "breaks_s": breaks, "faults": faults, "suspect": suspect}
    lines = [data.quality.summarise(recording), *(f"suspect data: {text}" for text in (*faults, *suspect))]
    return content, lines, bool(suspect)


@app.command()
@with_exit_codes
def check(
    run: RunFile, position: OfPosition = None, rig: Rig = None, effects_file: EffectsFile = None, json: Json = False
) -> None:
    """Check a recording: rates, spans, gaps, ranges, warnings, what is left out, and where the relation breaks.

    With --position, output and position are of two loggers, as for fit.

    Example: [bold]accelcal check run12.csv[/bold]
    """
    with progress("check") as report:
        recordings, contents = io.load_declared(run, rig, position=position), {}
        for number, recording in enumerate(recordings):
            if isinstance(recording, data.Dwells):
                deliver(recording, printing.show, None, json)
                continue
            if isinstance(recording, data.Positions):
                raise UsageError(
                    f"{run}: {len(recording)} positions of three outputs at rest; accelcal dwells {run} lists and "
                    f"calibrates them, accelcal fit MOTION {run} takes them beside a motion"
                )
            contents[recording.axis] = checked_recording(recording)
            report((number + 0.9) / len(recordings))
    if json:
        by_axis = {axis: content for axis, (content, *_) in contents.items()}
        if by_axis:
            print_json(by_axis.get("", by_axis))
        return
    for _, lines, _ in contents.values():
        for text in lines:
            say_line(text)
    other = () if position is None else ("--position", position)
    if any(wrong for *_, wrong in contents.values()):
        suggest("check", run, *other, before=f"correct that in {rig or io.sidecar_of(run)}, then: ")
    else:
        suggest("fit", run, *other, "-o", f"{run.stem}.json")


@app.command()
@with_exit_codes
def cut(
    run: RunFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="Recording to write: .csv or .parquet.")],
    only: Annotated[list[str] | None, typer.Option("--only", help="Keep FROM:TO in s.")] = None,
    without: Annotated[list[str] | None, typer.Option("--without", help="Exclude FROM:TO in s.")] = None,
    part: Annotated[
        int | None, typer.Option("--part", help="Part of a file whose clock starts again, from 1.", min=1)
    ] = None,
    position: OfPosition = None,
    rig: Rig = None,
) -> None:
    """Write a part of a recording, or all of it without some stretches, with its sidecar; two loggers as one file.

    Example: [bold]accelcal cut run12.csv --without 42:60 -o train.csv[/bold]
    """
    if position is not None and io.has_three_outputs(run, rig):
        return join_body(run, position, rig, output, part, refused=[*(only or ()), *(without or ())])
    with progress("cut") as report:
        whole = part is None  # a part may be that of one of two loggers
        at_rest = whole and position is None and resting.is_at_rest(run, rig)
        needed = whole and not at_rest
        recording = io.load(run, rig, position=position, part=part, need_position=needed, need_accel=needed)
        by_position = len(recording.position) > 0 or data.reference_among(recording.side) is not None
        if not (by_position or at_rest or len(recording.accel)):
            io.load(run, rig, part=part)  # says what is missing
        print_alignment(recording)
        report(0.5)
        recording = replace(recording, findings=handed_on(recording))
        for text in only or ():
            recording = recording.part(*time_range(text, "--only"))
        recording = recording.without(*(time_range(text, "--without") for text in without or ()))
        sidecar = write_recording(recording, output)
    if recording.dwells is not None:
        print_status(f"{recording.dwells.name} is not written: name it in the new sidecar, [dwell] table = ...")
    print_status(f"wrote {output} and {sidecar}")
    if at_rest or (by_position and len(recording.accel)):
        suggest("rest" if at_rest else "check", output)


def join_body(
    run: Path, position: Path, rig: Path | None, output: Path, part: int | None, refused: Sequence[str]
) -> None:
    """Write three outputs of one logger, and place and attitude of another, as one recording."""
    if refused:
        raise UsageError(f"{refused[0]!r}: three outputs are joined whole; give --from and --to to fit instead")
    require_recording(output)
    with progress("cut"), io.together():
        body = io.body_of_two(run, position, rig, part)
        output.parent.mkdir(parents=True, exist_ok=True)
        io.write_body(body, output, mark_of(output))
    print_status(f"{run.name}: {body.alignment.text}")
    print_status(f"wrote {output} and {io.sidecar_of(output)}")
    suggest("check", output)


def handed_on(recording: data.Recording) -> tuple[data.Finding, ...]:
    """Findings that a part of a recording keeps: warnings, uncertainties of its clocks, and faults."""
    from accelcal.diagnosis.faults import Examined

    listed = [finding for finding in recording.findings if finding.lasts]
    with suppress(data.RecordingError):
        for note in Examined(recording).remarks():
            values: dict[str, Any] = {"channel": "", "count": 1, **note.values}
            text = note.sentence.partition("; a file without that: ")[0]
            listed.append(data.Finding(note.code, values["channel"], values["count"], values["time"], text))
    return tuple(
        replace(finding, text=f"before the cut: {finding.text.removeprefix('before the cut: ')}") for finding in listed
    )


@app.command()
@with_exit_codes
def simulate(
    output: Annotated[Path, typer.Option("-o", "--output", help="Recording to write: .csv or .parquet.")],
    motion: Annotated[
        str,
        typer.Option("--motion", help="tones, interleaved, moves, bursts, fast, chirp, rests, sine_steps, sweep."),
    ] = "interleaved",
    seconds: Annotated[float, typer.Option("--seconds", help="Length, s.")] = 60.0,
    sensor: Annotated[str, typer.Option("--sensor", help="ADXL105 or CXL02.")] = "ADXL105",
    a_rms: Annotated[float | None, typer.Option("--a-rms", help="Rms acceleration, m/s².")] = None,
    bias: Annotated[float, typer.Option("--bias", help="K0, m/s².")] = 0.05,
    scale_factor: Annotated[float, typer.Option("--scale-factor", help="k.")] = 0.01,
    time_offset: Annotated[float, typer.Option("--time-offset", help="s, positive = output lags.")] = 0.0,
    quadratic: Annotated[float, typer.Option("--quadratic", help="K2, (m/s²)⁻¹.")] = 0.0,
    cubic: Annotated[float, typer.Option("--cubic", help="K3, (m/s²)⁻².")] = 0.0,
    reference: Annotated[
        str, typer.Option("--reference", help="position, velocity or reference_acceleration.")
    ] = "position",
    missing: Annotated[float, typer.Option("--missing", help="Share of samples lost.")] = 0.0,
    seed: Annotated[int, typer.Option("--seed", help="Random seed.", min=0)] = 1,
    json: Json = False,
) -> None:
    """Simulate a recording of the paper's rig, with its sidecar.

    Example: [bold]accelcal simulate -o run.csv --motion interleaved --cubic 1e-3 --seed 4[/bold]
    """
    import numpy as np

    rig = rig_of_sensor(sensor)
    if reference not in data.UNITS:
        raise UsageError(f"--reference {reference!r}: expected {', '.join(data.UNITS)}")
    truth = {
        "bias": bias,
        "scale_factor": scale_factor,
        "time_offset": time_offset,
        "quadratic": quadratic,
        "cubic": cubic,
    }
    with progress("simulate") as report:
        simulated = sensors.simulate(
            motion,
            seconds=seconds,
            rig=rig,
            parameters=truth,
            rng=np.random.default_rng(seed),
            a_rms=a_rms,
            missing=missing,
            reference=cast("data.Reference", reference),
        )
        report(0.3)
        sidecar = write_recording(simulated.recording, output)
    if json:
        print_json({"file": str(output), "sidecar": str(sidecar), "truth": truth, "seed": seed})
    else:
        print_status(f"wrote {output} and {sidecar}; true values: {truth_text(truth)}")
        suggest("check", output)


def rig_of_sensor(name: str) -> data.Rig:
    """The rig of the paper with a sensor of its."""
    rigs = {"ADXL105": sensors.ADXL105_RIG, "CXL02": sensors.CXL02_RIG}
    if name not in rigs:
        raise UsageError(f"--sensor {name!r}: expected {' or '.join(rigs)}")
    return rigs[name]


def truth_text(truth: Mapping[str, float]) -> str:
    """True parameters that are not zero, each with its unit."""
    find = catalogue.find
    values = [f"{name} {value:g} {find(name).unit}".removesuffix(" 1") for name, value in truth.items() if value]
    return ", ".join(values) or "a perfect sensor"


def require_recording(path: Path) -> Path:
    """Refuse an output that no recording is written as."""
    require_ending("--output", path, ".csv", ".parquet")
    return path


def write_recording(recording: data.Recording, path: Path) -> Path:
    """Write a recording and the sidecar beside it; return the sidecar's path."""
    write = {".csv": io.write_csv, ".parquet": io.write_parquet}[require_recording(path).suffix]
    path.parent.mkdir(parents=True, exist_ok=True)
    sidecar = io.sidecar_of(path)
    with io.together():
        columns = write(recording, path)
        io.write_sidecar(
            recording.rig,
            columns,
            sidecar,
            labels=recording.labels,
            noticed=recording.findings,
            prior_sizes=recording.prior_sizes,
            mark=mark_of(path),
        )
    return sidecar


@app.command()
@with_exit_codes
def rest(
    run: RunFile,
    rig: Rig = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", help="Allan deviation: .png, .svg or .pdf.", callback=writable_file)
    ] = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Measure noise density, bias instability and random walk of a sensor at rest, and print its lines of a sidecar.

    The record needs no position; three outputs accel_x, accel_y, accel_z and a temperature are used where it has them.

    Example: [bold]accelcal rest still.csv --figure allan.png[/bold]
    """
    with progress("rest"):
        recording = io.load(run, rig, need_position=False, need_accel=False)
        if not noises.outputs_of(recording):
            io.load(run, rig, need_position=False)  # says what is missing
        result = noises.rest(recording)
    if figure is not None:
        from accelcal.plots.model import allan

        drawing.save(drawing.draw(allan(result)), figure)
        print_written(figure)
    deliver(result, show_rest, output, json)


def show_rest(result: noises.RestNoise) -> None:
    """Print what a record at rest says, and the lines of a sidecar."""
    printing.show(result)
    for noise in result.outputs:
        say_line(noise.sidecar)


SHORTEST = "2 s"


@app.command()
@with_exit_codes
def dwells(
    run: Annotated[
        Path | None, typer.Argument(help="Recording, or with --guide lines; - is the standard input.")
    ] = None,
    rig: Rig = None,
    least: Annotated[str, typer.Option("--least", help="Shortest rest that is used.")] = SHORTEST,
    attitudes: Annotated[
        str | None,
        typer.Option("--attitudes", help="Elevation of each rest in degrees: 0,90,180 or FIRST:STEP such as 0:15."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", help="Figure of the rests: .png, .svg or .pdf.", callback=writable_file)
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Use the rests without asking.")] = False,
    guide: Annotated[
        bool, typer.Option("--guide", help="Lead through the positions of a triad on running lines t,x,y,z.")
    ] = False,
    positions: Annotated[int, typer.Option("--positions", help="Positions of --guide.", min=6)] = 6,
    serial: Annotated[str | None, typer.Option("--serial", help="Serial port of --guide.")] = None,
    baud: Annotated[int | None, typer.Option("--baud", help="Rate of the serial port.", min=1)] = None,
    tcp: Annotated[str | None, typer.Option("--tcp", help="HOST:PORT of a server that sends lines.")] = None,
    follow: Annotated[bool, typer.Option("--follow", help="Wait for further lines at the end of the file.")] = False,
    output: Output = None,
    json: Json = False,
) -> None:
    """Find the rests of a long tumble record and write them as a table of dwells; or calibrate a triad from them.

    With accel_x, accel_y, accel_z in the sidecar and attitude = "unknown", nine parameters are estimated from the norm
    of gravity alone; of six faces scale and zero of each axis.

    Example: [bold]accelcal dwells tumble.csv --attitudes 0:15 -o dwells.csv[/bold]
    """
    shortest = parse_quantity(least, "time", "--least") or 0.0
    if guide:
        from accelcal.cli.live import source_of

        require_folder("live")
        source = source_of(serial, baud, tcp, run, follow=follow)
        guided(source(), rig, sessions.DwellGuide(shortest, positions), output, json)
        return
    if run is None or serial or baud or tcp or follow:
        raise UsageError("give a recording; --serial, --tcp and --follow belong to --guide")
    with progress("dwells"):
        result = resting.load_rests(run, rig, shortest)
    degrees = angles(attitudes, len(result.rests))
    if figure is not None:
        from accelcal.plots.model import rests

        drawing.save(drawing.draw(rests(result)), figure)
        print_written(figure)
    triad = result.triad
    if not json:
        head = ("", "from (s)", "to (s)", *(f"mean {axis} ({result.unit})" for axis in result.names), "std", "attitude")
        show_table(head, [line(k, rest, degrees) for k, rest in enumerate(result.rests)])
    if (output is not None or triad) and not yes and not confirmed(len(result.rests)):
        print_status("nothing was used or written")
        return
    if triad:
        deliver(triads.fit_triad(result.positions), show_triad, output, json)
        return
    if output is not None:
        sidecar = resting.write_table(result, degrees, output, mark_of(output))
        missing = "" if degrees else "; fill in attitude_deg"
        print_status(f"wrote {output} and {sidecar}{missing}, then run: accelcal fit {output} --model cubic")
    if json:
        print_json({"rests": resting.table_of(result, degrees)})


def guided(source: ByteSource, rig: Path | None, guide: sessions.DwellGuide, output: Path | None, json: bool) -> None:
    """Follow the lines of a triad until enough positions are measured, the lines end or Ctrl-C is pressed; write the
    table of positions after each, and calibrate by them."""
    import numpy as np

    from accelcal.io.stream import Intake, LineReader

    require_ending("--output", output, ".csv", what=" for the table of positions")
    if rig is None:
        raise UsageError("--guide: give --rig with the columns accel_x, accel_y, accel_z and their units")
    declared = io.read_sidecar(rig)
    setup, nothing = declared.dwell or data.DwellSetup(), np.empty((0, 3))
    result = resting.Rests(source.name, nothing[:, 0], nothing, resting.TRIAD, "m/s^2", (), setup, declared.rig)
    lines = LineReader(declared, source.name, source.from_its_start, channels=resting.TRIAD)
    print_status(f"hold still; {guide.next}")
    with deferred() as stopped:
        intake = Intake(source)
        while guide.next and not (intake.ended or stopped()):
            for chunk in intake.take(patience=0.1):
                rows = lines.feed(chunk)
                texts = guide.feed(np.column_stack([rows.t, *rows.side.values()]))
                if output is not None and tuple(guide.rests) != result.rests:
                    resting.write_positions(replace(result, rests=tuple(guide.rests)), output, mark_of(output))
                result = replace(result, rests=tuple(guide.rests))
                for text in texts:
                    print_status(text)
        intake.stop()
        source.close()
        if intake.error is not None:
            print_status(f"{source.name}: the source broke off ({intake.error})")
        if not (lines.counts.used or stopped()):
            raise data.RecordingError(
                f"{source.name}: no line could be used ({lines.counts.broken} broken); expected lines t,x,y,z with a "
                "comma between the fields, as the channels of the sidecar name them"
            )
        print_written(output if guide.rests else None)
        try:
            deliver(triads.fit_triad(result.positions), show_triad, None, json)
        except data.RecordingError as error:
            if not stopped():
                raise
            print_status(str(error))


def confirmed(count: int) -> bool:
    """Whether the user wants the rests to be used; without a terminal, --yes is needed.

    Raises
    ------
    UsageError
        If nobody can be asked.
    """
    if not sys.stdin.isatty():
        raise UsageError(f"{count} rests were found; look at them, then add --yes to use them")
    return bool(typer.confirm(f"use these {count} rests?", default=False, err=True))


def angles(text: str | None, count: int) -> list[float]:
    """Elevations in degrees, one for each rest; empty where none are given."""
    if text is None:
        return []
    try:
        if ":" in text:
            first, step = (float(part) for part in text.split(":"))
            values = [first + k * step for k in range(count)]
        else:
            values = [float(part) for part in text.split(",")]
        if not all(math.isfinite(angle) for angle in values):
            raise ValueError
    except ValueError:
        raise UsageError(
            f"--attitudes {text!r}: expected degrees such as 0,90,180, or FIRST:STEP such as 0:15"
        ) from None
    if len(values) != count:
        raise UsageError(f"--attitudes: {len(values)} angles for {count} rests; give one for each, or change --least")
    return values


def line(k: int, rest: resting.Rest, degrees: list[float]) -> tuple[str, ...]:
    """One rest as a line of the table."""
    means = (f"{y:.7g}" for y in rest.mean)
    shown = f"{degrees[k]:g} deg" if degrees else ""
    return (str(k + 1), f"{rest.start:.6g}", f"{rest.end:.6g}", *means, f"{max(rest.std):.3g}", shown)


def show_triad(fit: triads.TriadFit) -> None:
    """Print nine or six parameters and what they leave."""
    pure, law = fit.unit == "m/s^2", f"a = {'T ' if fit.terms else ''}K (y - b)"
    unit = "m/s²" if pure else fit.unit
    units = {"K": "1" if pure else f"(m/s²)/{unit}", "T": "rad", "b": unit}
    std = dict(fit.std)
    rows = [
        (name, words.plain(units[name[0]], y, std[name]), words.concise(y, std[name]), units[name[0]])
        for name, y in fit.values.items()
    ]
    say_line(f"{fit.name}: {law}, {len(fit.residual)} positions, |a| = {fit.gravity:g} m/s²")
    show_table(("parameter", "value", "SI value (u)", "SI unit"), rows)
    say_line(f"residual of the norm: {fit.rms:.3g} m/s² rms")
    say_line(fit.sentence)
    for text in fit.remarks:
        say_line(f"note: {text}")
