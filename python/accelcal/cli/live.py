"""The command on a running measurement: `live`."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from accelcal._support.stopping import deferred
from accelcal.cli.common import (
    Json,
    Output,
    UsageError,
    app,
    parse_quantity,
    print_status,
    require_folder,
    with_exit_codes,
    writable_file,
)

if TYPE_CHECKING:
    from accelcal.cli.live_faces import Lines
    from accelcal.estimation.estimate import Fit
    from accelcal.io.stream import ByteSource
    from accelcal.live import LiveSession, LiveSettings
    from accelcal.live.session import LiveState

MOST_BAUD = 100_000_000


@app.command()
@with_exit_codes
def live(
    rig: Annotated[Path, typer.Option("--rig", help="Sidecar: units and names of the lines, sensor, rig.")],
    serial: Annotated[str | None, typer.Option("--serial", help="Serial port, such as /dev/ttyUSB0.")] = None,
    baud: Annotated[int | None, typer.Option("--baud", help="Rate of the serial port.", min=1, max=MOST_BAUD)] = None,
    tcp: Annotated[str | None, typer.Option("--tcp", help="HOST:PORT of a server that sends lines.")] = None,
    file: Annotated[Path | None, typer.Option("--file", help="File of lines.")] = None,
    follow: Annotated[bool, typer.Option("--follow", help="Wait for further lines at the end of --file.")] = False,
    model: Annotated[Path | None, typer.Option("--model", help="Model file to start from.")] = None,
    output: Output = None,
    save: Annotated[
        Path | None,
        typer.Option("--save", help="Model file to write at the end; needs --model.", callback=writable_file),
    ] = None,
    every: Annotated[str, typer.Option("--every", help="Time between lines when stdout is not a terminal.")] = "5 s",
    json: Json = False,
) -> None:
    """Follow a running measurement, lines t,accel,position: parameters, innovations, and whether the model holds.

    An empty field was not sampled. Ctrl-C ends it with a summary. The file of -o can be read at any time.

    Example: [bold]accelcal live --serial /dev/ttyUSB0 --baud 921600 --rig rig.toml -o run.parquet[/bold]
    """
    require_folder("live")
    from accelcal.io import read_sidecar
    from accelcal.live import LiveSession, settings_of
    from accelcal.results import model_file

    interval = parse_quantity(every, "time", "--every")
    if interval is None or not interval > 0.0:
        raise UsageError(f"--every {every!r}: expected a time above 0")
    if output is not None and output.suffix != ".parquet":
        raise UsageError(f"--output {output}: expected a name that ends in .parquet")
    if output is not None:
        refuse_replacing(output)
    if save is not None and model is None:
        raise UsageError("--save: needs --model, whose noise, rig and range the new file keeps; or fit the recording")
    opener = source_of(serial, baud, tcp, file, follow=follow)
    declared = read_sidecar(rig)
    fit = None if model is None else model_file.load(model)
    settings = settings_of(declared.rig, fit)
    source = opener()
    with deferred() as stopped, LiveSession(source, declared, settings, output) as session:
        with face_of(source.name, interval, json=json) as face:
            session.run(
                ends=stopped,
                on_alarm=lambda alarm: face.alarm(alarm, session.state),
                show=lambda: face.show(session.state) if face.due else None,
            )
            if not stopped():
                require_rows(session.state, source.name)
            face.end(session.state, session.ended)
        if output is not None and session.state.recorded:
            print_status(f"wrote {output}")
        if fit is not None and save is not None:
            require_small_bias(session.state, save)
            model_file.save(followed(fit, settings, session), save)
            print_status(f"wrote {save}")


def source_of(
    serial: str | None, baud: int | None, tcp: str | None, file: Path | None, *, follow: bool
) -> Callable[[], ByteSource]:
    """What opens the one source that is asked for.

    Raises
    ------
    UsageError
        If it is none, or more than one, or described in part.
    """
    from accelcal.io import stream

    if sum(each is not None for each in (serial, tcp, file)) != 1:
        raise UsageError("give one of --serial DEV --baud N, --tcp HOST:PORT and --file PATH")
    if (serial is None) != (baud is None):
        raise UsageError("--serial and --baud belong together, such as --serial /dev/ttyUSB0 --baud 921600")
    if serial is not None and baud is not None:
        return functools.partial(stream.open_serial, serial, baud)
    if follow and file is None:
        raise UsageError("--follow belongs to --file; a serial port and a TCP server are followed anyway")
    if file is not None:
        return functools.partial(stream.open_growing if follow else stream.open_file, file)
    host, colon, port = (tcp or "").rpartition(":")
    if not (host and colon and port.isascii() and port.isdecimal() and 0 < int(port[:9]) < 1 << 16):
        raise UsageError(f"--tcp {tcp!r}: expected HOST:PORT, such as 192.168.1.7:5025")
    return functools.partial(stream.open_tcp, host.removeprefix("[").removesuffix("]"), int(port))


def refuse_replacing(output: Path) -> None:
    """Refuse to record where a recording, or its sidecar, is already: a measurement cannot be made again.

    Raises
    ------
    UsageError
        Naming the file that is there.
    """
    from accelcal.io import sidecar_of

    for path, what in ((output, "recording"), (sidecar_of(output), "sidecar")):
        if path.is_file():
            raise UsageError(f"--output {output}: {path}: there is a {what} already; give another name")


def face_of(source: str, every: float, *, json: bool) -> Lines:
    """JSON where it is asked for, a screen in a terminal, lines elsewhere."""
    from rich.console import Console

    from accelcal.cli.live_faces import JsonLines, Lines, Screen

    if json:
        return JsonLines(source, every)
    return Screen(source) if Console().is_terminal else Lines(source, every)


def require_rows(state: LiveState, source: str) -> None:
    """Refuse a source without a single row.

    Raises
    ------
    RecordingError
        Saying what came in its place.
    """
    from accelcal.data.recording import RecordingError

    if not state.used:
        raise RecordingError(
            f"{source}: no line could be used ({state.broken} broken, {state.out_of_order} out of order); expected "
            "lines t,accel,position with a comma between the fields, a point in the numbers and an empty field where "
            "nothing was sampled"
        )


def require_small_bias(state: LiveState, save: Path) -> None:
    """Refuse to save a scale factor that noise of the output has biased.

    Raises
    ------
    RecordingError
        Saying by how much, and what to do.
    """
    from accelcal.data.recording import RecordingError
    from accelcal.live.tracker import MOST_SAVED

    bias = state.regressor_bias
    if bias is not None and bias.sigma > MOST_SAVED:
        raise RecordingError(f"--save {save}: nothing is written, since {bias.sentence}")


def followed(fit: Fit, settings: LiveSettings, session: LiveSession) -> Fit:
    """The fit with the parameters that the live filter holds now."""
    from accelcal.estimation.recursive import as_fit
    from accelcal.estimation.remarks import remark
    from accelcal.filters.record import ForwardParameters

    tracker, state = session.tracker, session.state
    if tracker.filter is None:
        return fit
    m = len(settings.names)
    parameters = ForwardParameters(settings.names, tracker.filter.estimate[-m:], tracker.covariance[-m:, -m:])
    found = replace(as_fit(replace(fit, rig=settings.rig), parameters, settings.choice), rig=fit.rig)
    text = f"followed live over {state.readings} readings of {session.source.name}; {state.alarms} of {state.blocks} "
    followed = remark("live_filter", text=f"{text}blocks of innovations raised an alarm")
    return replace(found, remarks=(followed, *found.remarks))
