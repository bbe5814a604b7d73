"""The command `live`: a running measurement, in the terminal, as lines of JSON or as a page."""

from __future__ import annotations

import functools
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Self

import typer

from accelcal._support.errors import visible
from accelcal._support.stopping import deferred
from accelcal.cli.common import (
    Json,
    Output,
    UsageError,
    app,
    parse_quantity,
    print_json,
    print_status,
    say_line,
    with_exit_codes,
    writable_file,
)
from accelcal.live.session import LiveEvent, LiveState
from accelcal.live.tracker import Alarm
from accelcal.model import Estimate
from accelcal.results.json import content
from accelcal.results.words import number, with_unit

if TYPE_CHECKING:
    from rich.console import Group

    from accelcal.estimation.estimate import Fit
    from accelcal.io.stream import ByteSource
    from accelcal.live import LiveSession, LiveSettings


REFRESH = 0.25
"""Time between two pictures of the screen, s."""
MOST_ALARMS = 3
"""Alarms on the screen."""


class Lines:
    """A line from time to time; alarms on stderr."""

    def __init__(self, source: str, every: float) -> None:
        self.source, self.every = source, every
        self._next = time.monotonic() + every

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is left to do."""

    @property
    def due(self) -> bool:
        """Whether it is time to show something; asked often."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = max(self._next + self.every, now)
        return True

    def show(self, state: LiveState) -> None:
        """One line of what is known."""
        say_line(line_of(state), flush=True)

    def alarm(self, alarm: Alarm, state: LiveState) -> None:
        """Say that the model no longer holds, once for blocks in a row."""
        if alarm.t == alarm.since:
            print_status(f"alarm: {alarm.sentence}")

    def end(self, state: LiveState, ended: str) -> None:
        """Say what came of it all."""
        for text in summary_of(state, self.source, ended):
            say_line(text, flush=True)


class JsonLines(Lines):
    """JSON, one object a line."""

    def _print(self, event: LiveEvent) -> None:
        print_json(content(event), indent=None)

    def show(self, state: LiveState) -> None:
        """One object of what is known."""
        self._print(LiveEvent("state", self.source, state))

    def alarm(self, alarm: Alarm, state: LiveState) -> None:
        """One object of the alarm."""
        self._print(LiveEvent("alarm", self.source, state, alarm))

    def end(self, state: LiveState, ended: str) -> None:
        """The last object."""
        self._print(LiveEvent("end", self.source, state, ended=ended))


class Screen(Lines):
    """A table that is drawn anew several times a second."""

    def __init__(self, source: str) -> None:
        from rich.live import Live

        super().__init__(source, REFRESH)
        self._live = Live(auto_refresh=False)
        self._alarms: deque[Alarm] = deque(maxlen=MOST_ALARMS)

    def __enter__(self) -> Self:
        self._live.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.__exit__(kind, error, trace)

    def show(self, state: LiveState) -> None:
        """Draw what is known."""
        self._live.update(picture(state, self.source, list(self._alarms)), refresh=True)

    def alarm(self, alarm: Alarm, state: LiveState) -> None:
        """Keep it for the next picture."""
        self._alarms.append(alarm)

    def end(self, state: LiveState, ended: str) -> None:
        """Leave the last picture, and say why it is the last."""
        self.show(state)
        self._live.stop()
        say_line(f"{self.source}: {ended}")


def picture(state: LiveState, source: str, alarms: list[Alarm]) -> Group:
    """Parameters, innovations and counts, for a terminal."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for head in ("parameter", "estimate", "± 2 sigma", "unit"):
        table.add_column(head, justify="left" if head in ("parameter", "unit") else "right")
    for e in state.estimates:
        table.add_row(e.name, number(e.value, 6), number(2.0 * e.std, 2), e.unit)
    held = {None: ("waiting for innovations", ""), True: ("the model holds", "green"), False: ("ALARM", "bold red")}
    word, style = held[state.holds]
    title = f"{source}, t = {'-' if state.t is None else f'{state.t:.3f} s'}"
    return Group(
        Text(visible(title, one_line=True), style="bold"),
        table,
        *(Text(text, style="yellow") for text in bias_of(state)),
        Text(innovation_of(state)),
        Text.assemble((word, style), f" ({state.alarms} of {state.blocks} blocks alarmed)"),
        Text(counts_of(state)),
        *(Text(alarm.sentence, style="red") for alarm in alarms),
    )


def line_of(state: LiveState) -> str:
    """What is known, in one line."""
    parameters = ", ".join(map(with_band, state.estimates))
    when = "no row yet" if state.t is None else f"t = {state.t:.3f} s"
    return f"{when}: {parameters}; {innovation_of(state)}; {counts_of(state)}"


def bias_of(state: LiveState) -> list[str]:
    """The sentence on a scale factor that noise of the output biases by more than it is uncertain; empty else."""
    bias = state.regressor_bias
    return [] if bias is None or not bias.sentence else [bias.sentence]


def with_band(e: Estimate) -> str:
    """A parameter with two standard deviations."""
    return f"{e.name} {with_unit(f'{number(e.value, 6)} ± {number(2.0 * e.std, 2)}', e.unit)}"


def innovation_of(state: LiveState) -> str:
    """The newest innovation and the running NIS."""
    if state.innovation is None or state.nis is None:
        return "no innovation yet"
    e, nis = state.innovation, state.nis
    std = math.sqrt(e.variance)
    return (
        f"innovation {number(1e6 * e.e, 3)} µm, expected ± {number(2e6 * std, 3)}; NIS {nis.value:.3f}, 99 % in "
        f"{nis.low:.3f} .. {nis.high:.3f} ({nis.readings} readings)"
    )


def counts_of(state: LiveState) -> str:
    """What became of the lines."""
    counts = {
        "broken": state.broken,
        "out of order": state.out_of_order,
        "missing": state.missing,
        "bytes dropped": state.dropped_bytes,
    }
    more = {"not tested": state.untested, "refused by the filter": state.refused, "recorded": state.recorded}
    listed = [f"{count} {name}" for name, count in counts.items()]
    return ", ".join([f"{state.used} lines", *listed, *(f"{count} {name}" for name, count in more.items() if count)])


def summary_of(state: LiveState, source: str, ended: str) -> list[str]:
    """What came of a live view."""
    judged = (
        "too few readings to say whether the model holds"
        if state.holds is None
        else f"{state.alarms} of {state.blocks} blocks of innovations raised an alarm"
    )
    lines = [f"{source}: {ended}", line_of(state), *bias_of(state), judged]
    return [*lines, f"the filter refused {state.refused} events: {state.refusal}"] if state.refused else lines


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
