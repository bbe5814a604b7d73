"""Commands on many sensors, each recording fitted once, and on a running measurement: `fleet`, `live`."""

from __future__ import annotations

import functools
import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from accelcal._support.errors import visible
from accelcal._support.stopping import deferred
from accelcal.cli import lazy, printing
from accelcal.cli.common import (
    Json,
    Output,
    UsageError,
    app,
    deliver,
    parse_quantity,
    print_json,
    print_status,
    print_written,
    progress,
    require_ending,
    require_folder,
    say_line,
    with_exit_codes,
    writable_file,
)
from accelcal.cli.lazy import campaign, data, io, measuring, model_file, results_json, sessions, summary, words

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from rich.console import Group
    from rich.live import Live

    from accelcal.estimation.estimate import Fit
    from accelcal.io.stream import ByteSource


MOST_WORKERS = 256


@app.command()
@with_exit_codes
def fleet(
    folders: Annotated[
        list[Path], typer.Argument(help="One folder of recordings for each sensor.", metavar="FOLDER...")
    ],
    model: Annotated[str, typer.Option("--model", help="linear or cubic.")] = "linear",
    store: Annotated[
        Path, typer.Option("--store", help="File that keeps what is done; a call goes on from it.")
    ] = Path("fleet.sqlite"),
    workers: Annotated[int, typer.Option("--workers", help="Processes on this machine.", min=1, max=MOST_WORKERS)] = 1,
    dask: Annotated[
        str | None, typer.Option("--dask", help="Address of a dask scheduler, in place of --workers.")
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Fit recordings again that could not be fitted.")] = False,
    output: Output = None,
    json: Json = False,
) -> None:
    """Fit every recording of many sensors once and compare the sensors: population, outliers, repeatability, ageing.

    A killed call loses nothing: the next one goes on. The page is written with -o fleet.html.

    Example: [bold]accelcal fleet sensors/*/ -o fleet.html[/bold]
    """
    if model not in summary.MODELS:
        raise UsageError(f"--model {model!r}: expected {' or '.join(summary.MODELS)}")
    files = in_stored_order([str(file) for file in recordings_in(folders)], store, retry=retry)
    with executor(workers, dask) as pool, progress("fleet") as report:
        done = campaign.run(
            summary.fit_of,
            files,
            store=store,
            parameters={"model": model},
            executor=pool,
            batch=1,
            progress=lambda count, total: report(count / total),
        )
    print_status(f"{done.computed} recordings fitted, {done.stored} found in {store}, {done.failed} refused")
    result = summary.summarise(campaign.load(store))
    if output is not None:
        io.atomic_write(output, summary.html(result, output.parent))
        print_written(output)
    deliver(result, printing.show_fleet, None, json)


def in_stored_order(files: list[str], store: Path, *, retry: bool) -> list[str]:
    """Recordings in the order in which a store knows them, new ones behind; it forgets those that have changed since,
    with `retry` its failures as well."""
    if not store.exists() or not store.stat().st_size:  # of a call that was killed before it wrote anything
        return files
    stored = campaign.load(store)
    places = dict(zip(stored.items, stored.runs.tolist(), strict=True))
    marks = stored.values.get(summary.CONTENT, ())  # of an older version, none
    fitted = [(item, mark) for item, mark in zip(stored.items, marks, strict=False) if item not in stored.errors]
    changed = [item for item, mark in fitted if item in files and summary.content_of(Path(item)) != mark]
    if changed:
        print_status(
            f"{len(changed)} recordings have changed since {store} keeps them, {changed[0]} first: fitted again"
        )
    campaign.forget(store, [*changed, *(stored.errors if retry else ())])
    if not set(places) <= set(files):
        return files  # of other folders: the campaign says so
    new = (file for file in files if file not in places)
    by_run = {run: item for item, run in places.items()}
    return [by_run[run] if run in by_run else next(new) for run in range(len(files))]


def recordings_in(folders: list[Path]) -> list[Path]:
    """Recordings of every folder, in order.

    Raises
    ------
    UsageError
        If a folder is none or holds no recording, or two have one name.
    """
    files: list[Path] = []
    names: dict[str, Path] = {}
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(f"{folder}: expected a folder with the recordings of one sensor")
        same = names.setdefault(folder.resolve().name, folder)
        if same is not folder:
            raise UsageError(f"{folder} and {same} have one name, which is that of the sensor; rename one of them")
        paths = sorted(
            path for path in folder.iterdir() if path.suffix.lower() in lazy.files.READABLE and path.is_file()
        )
        if not paths:
            raise UsageError(f"{folder}: no recording in it ({', '.join(lazy.files.READABLE)})")
        files += paths
    return files


def executor(workers: int, dask: str | None) -> AbstractContextManager[Executor | None]:
    """Processes of this machine, or a cluster; None computes in threads of this process."""
    if dask is not None:
        try:
            from distributed import Client  # type: ignore[import-untyped,unused-ignore]
        except ImportError as error:
            raise UsageError('--dask needs dask; install it with: pip install "accelcal[dask]"') from error
        client: Any = Client
        return nullcontext(client(dask).get_executor())
    from accelcal._support.process import processes

    return processes(workers)


REFRESH = 0.25
"""Time between two pictures of the screen, s."""
MOST_ALARMS = 3
"""Alarms on the screen."""


class Lines:
    """A line from time to time; alarms on stderr."""

    def __init__(self, source: str, every: float) -> None:
        self.source, self.every = source, every
        self._next = time.monotonic() + every

    @property
    def due(self) -> bool:
        """Whether it is time to show something; asked often."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = max(self._next + self.every, now)
        return True

    def show(self, state: sessions.LiveState) -> None:
        """One line of what is known."""
        say_line(line_of(state), flush=True)

    def alarm(self, alarm: measuring.Alarm | measuring.Naming, state: sessions.LiveState) -> None:
        """Say that the model no longer holds, once for blocks in a row, and what a watch names."""
        if isinstance(alarm, measuring.Naming):
            print_status(f"watch: {alarm.sentence}")
        elif alarm.t == alarm.since:
            print_status(f"alarm: {alarm.sentence}")

    def end(self, state: sessions.LiveState, ended: str) -> None:
        """Say what came of it all."""
        for text in summary_of(state, self.source, ended):
            say_line(text, flush=True)


class JsonLines(Lines):
    """JSON, one object a line."""

    def _print(self, event: sessions.LiveEvent) -> None:
        print_json(results_json.content(event), indent=None)

    def show(self, state: sessions.LiveState) -> None:
        """One object of what is known."""
        self._print(sessions.LiveEvent("state", self.source, state))

    def alarm(self, alarm: measuring.Alarm | measuring.Naming, state: sessions.LiveState) -> None:
        """One object of the alarm, or of what is named."""
        if isinstance(alarm, measuring.Naming):
            self._print(sessions.LiveEvent("name", self.source, state, naming=alarm))
        else:
            self._print(sessions.LiveEvent("alarm", self.source, state, alarm))

    def end(self, state: sessions.LiveState, ended: str) -> None:
        """The last object."""
        self._print(sessions.LiveEvent("end", self.source, state, ended=ended))


class Screen(Lines):
    """A table that is drawn anew several times a second."""

    def __init__(self, source: str, drawn: Live) -> None:
        super().__init__(source, REFRESH)
        self._live = drawn
        self._alarms: deque[measuring.Alarm] = deque(maxlen=MOST_ALARMS)

    def show(self, state: sessions.LiveState) -> None:
        """Draw what is known."""
        self._live.update(picture(state, self.source, list(self._alarms)), refresh=True)

    def alarm(self, alarm: measuring.Alarm | measuring.Naming, state: sessions.LiveState) -> None:
        """Keep it for the next picture; what a watch names is in the state."""
        if isinstance(alarm, measuring.Alarm):
            self._alarms.append(alarm)

    def end(self, state: sessions.LiveState, ended: str) -> None:
        """Leave the last picture, and say why it is the last."""
        self.show(state)
        self._live.stop()
        say_line(f"{self.source}: {ended}")


def picture(state: sessions.LiveState, source: str, alarms: list[measuring.Alarm]) -> Group:
    """Parameters, innovations and counts, for a terminal."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for head in ("parameter", "estimate", "± 2 sigma", "unit"):
        table.add_column(head, justify="left" if head in ("parameter", "unit") else "right")
    for e in state.estimates:
        table.add_row(e.name, words.number(e.value, 6), words.number(2.0 * e.std, 2), e.unit)
    held = {None: ("waiting for innovations", ""), True: ("the model holds", "green"), False: ("ALARM", "bold red")}
    word, style = held[state.holds]
    title = f"{source}, t = {'-' if state.t is None else f'{state.t:.3f} s'}"
    return Group(
        Text(visible(title, one_line=True), style="bold"),
        table,
        *(Text(text, style="yellow") for text in state.sentences),
        Text(innovation_of(state)),
        Text.assemble((word, style), f" ({state.alarms} of {state.blocks} blocks alarmed)"),
        Text(counts_of(state)),
        *(Text(alarm.sentence, style="red") for alarm in alarms),
    )


def line_of(state: sessions.LiveState) -> str:
    """What is known, in one line."""
    bands = [f"{words.number(e.value, 6)} ± {words.number(2.0 * e.std, 2)}" for e in state.estimates]
    pairs = zip(state.estimates, bands, strict=True)
    parameters = ", ".join(f"{e.name} {words.with_unit(band, e.unit)}" for e, band in pairs)
    when = "no row yet" if state.t is None else f"t = {state.t:.3f} s"
    late = f", {state.behind:.1f} s behind" if state.is_late else ""
    return f"{when}{late}: {parameters}; {innovation_of(state)}; ± are 2 sigma; {counts_of(state)}"


def innovation_of(state: sessions.LiveState) -> str:
    """The newest innovation and the running NIS."""
    if state.innovation is None:
        return "no innovation yet"
    e, nis = state.innovation, state.nis
    error, expected = words.number(1e6 * e.e, 3), words.number(2e6 * math.sqrt(e.variance), 3)
    power = (
        "no NIS, since the position stays on one count"
        if nis is None
        else f"NIS {nis.value:.3f}, 99 % in {nis.low:.3f} .. {nis.high:.3f} ({nis.readings} readings)"
    )
    return f"innovation {error} µm, expected ± {expected}; {power}"


def counts_of(state: sessions.LiveState) -> str:
    """What became of the lines."""
    counts = {
        "broken": state.broken,
        "out of order": state.out_of_order,
        "missing": state.missing,
        "bytes dropped": state.dropped_bytes,
    }
    more = {
        "clock restarts": state.restarts,
        "refused by the filter": state.refused,
        "recorded": state.recorded,
    }
    listed = [f"{count} {name}" for name, count in counts.items()]
    return ", ".join([f"{state.used} lines", *listed, *(f"{count} {name}" for name, count in more.items() if count)])


def summary_of(state: sessions.LiveState, source: str, ended: str) -> list[str]:
    """What came of a live view."""
    judged = (
        "too few readings to say whether the model holds"
        if state.holds is None
        else f"{state.alarms} of {state.blocks} blocks of innovations raised an alarm"
    )
    lines = [f"{source}: {ended}", line_of(state), *state.sentences, judged]
    return [*lines, f"the filter refused {state.refused} events: {state.refusal}"] if state.refused else lines


MOST_BAUD = 100_000_000


@app.command()
@with_exit_codes
def live(
    rig: Annotated[Path, typer.Option("--rig", help="Sidecar: units and names of the lines, sensor, rig.")],
    serial: Annotated[str | None, typer.Option("--serial", help="Serial port, such as /dev/ttyUSB0.")] = None,
    baud: Annotated[int | None, typer.Option("--baud", help="Rate of the serial port.", min=1, max=MOST_BAUD)] = None,
    tcp: Annotated[str | None, typer.Option("--tcp", help="HOST:PORT of a server that sends lines.")] = None,
    file: Annotated[Path | None, typer.Option("--file", help="File of lines; - is the standard input.")] = None,
    follow: Annotated[bool, typer.Option("--follow", help="Wait for further lines at the end of --file.")] = False,
    model: Annotated[Path | None, typer.Option("--model", help="Model file to start from.")] = None,
    output: Output = None,
    save: Annotated[
        Path | None,
        typer.Option("--save", help="Model file to write at the end; needs --model.", callback=writable_file),
    ] = None,
    watch: Annotated[
        str | None,
        typer.Option("--watch", help="Effects to watch for, a comma between names, or auto; needs --model."),
    ] = None,
    every: Annotated[str, typer.Option("--every", help="Time between lines when stdout is not a terminal.")] = "5 s",
    json: Json = False,
) -> None:
    """Follow a running measurement, lines t,accel,position: parameters, innovations, and whether the model holds.

    An empty field was not sampled. Ctrl-C ends it with a summary. The file of -o can be read at any time.

    Example: [bold]accelcal live --serial /dev/ttyUSB0 --baud 921600 --rig rig.toml -o run.parquet[/bold]
    """
    require_folder("live")
    interval = parse_quantity(every, "time", "--every")
    if interval is None or not interval > 0.0:
        raise UsageError(f"--every {every!r}: expected a time above 0")
    require_ending("--output", output, ".parquet")
    if output is not None:
        refuse_replacing(output)
    if save is not None and model is None:
        raise UsageError("--save: needs --model, whose noise, rig and range the new file keeps; or fit the recording")
    if watch is not None and model is None:
        raise UsageError("--watch: needs --model, what is right so far; fit a recording first: accelcal fit -o m.json")
    opener = source_of(serial, baud, tcp, file, follow=follow)
    declared = io.read_sidecar(rig)
    fit = None if model is None else model_file.load(model)
    suspects = tuple(name.strip() for name in watch.split(",")) if watch is not None else ()
    if suspects == ("auto",) and fit is not None:
        suspects = measuring.watchable(fit.model, declared.channels)
    settings = measuring.settings_of(declared.rig, fit, suspects)
    source = opener()
    with deferred() as stopped, measuring.LiveSession(source, declared, settings, output) as session:
        if session.lines.left_out:
            print_status(f"{rig}: {', '.join(session.lines.left_out)}: not needed by a live view, left out")
        for text in settings.remarks:
            print_status(text)
        with face_of(source.name, interval, json=json) as face:
            session.run(
                ends=stopped,
                on_alarm=lambda alarm: face.alarm(alarm, session.state),
                show=lambda: face.show(session.state) if face.due else None,
            )
            counts = session.lines.counts
            if not stopped() and not counts.used:
                raise data.RecordingError(
                    f"{source.name}: no line could be used ({counts.broken} broken, {counts.out_of_order} out of "
                    "order); expected lines t,accel,position with a comma between the fields, a point in the numbers "
                    f"and an empty field where nothing was sampled{'; check --baud' if serial is not None else ''}"
                )
            face.end(session.state, session.ended)
        if output is not None and session.state.recorded:
            print_written(output)
        if fit is not None and save is not None:
            require_small_noise(session.state, save)
            model_file.save(followed(fit, session), save)
            print_written(save)


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

    if sum(source is not None for source in (serial, tcp, file)) != 1:
        raise UsageError("give one of --serial DEV --baud N, --tcp HOST:PORT and --file PATH")
    if (serial is None) != (baud is None):
        raise UsageError("--serial and --baud belong together, such as --serial /dev/ttyUSB0 --baud 921600")
    if serial is not None and baud is not None:
        return functools.partial(stream.open_serial, serial, baud)
    if follow and file is None:
        raise UsageError("--follow belongs to --file; a serial port and a TCP server are followed anyway")
    if file == Path("-"):
        return stream.open_stdin
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
    for path, what in ((output, "recording"), (io.sidecar_of(output), "sidecar")):
        if path.is_file():
            raise UsageError(f"--output {output}: {path}: there is a {what} already; give another name")


@contextmanager
def face_of(source: str, every: float, *, json: bool) -> Iterator[Lines]:
    """JSON where it is asked for, a screen in a terminal, lines elsewhere."""
    from rich.console import Console
    from rich.live import Live

    if json:
        yield JsonLines(source, every)
    elif Console().is_terminal:
        with Live(auto_refresh=False) as drawn:
            yield Screen(source, drawn)
    else:
        yield Lines(source, every)


def require_small_noise(state: sessions.LiveState, save: Path) -> None:
    """Refuse to save a scale factor beyond what a live filter can correct.

    Raises
    ------
    RecordingError
        Saying how much noise there is, and what to do.
    """
    if state.noise_share is not None and state.noise_share.sentence:
        raise data.RecordingError(f"--save {save}: nothing is written. {state.noise_share.sentence}")


def followed(fit: Fit, session: measuring.LiveSession) -> Fit:
    """The fit with the parameters that the live filter holds now."""
    from accelcal.estimation.remarks import remark

    state, fitted = session.state, session.tracker.fitted(fit)
    if fitted is fit:
        return fit
    text = f"followed live over {state.readings} readings of {session.source.name}; {state.alarms} of {state.blocks} "
    followed = remark("live_filter", text=f"{text}blocks of innovations raised an alarm")
    return replace(fitted, remarks=(followed, *fitted.remarks))
