"""Shared by all commands: the application, common options, error messages with exit codes, progress."""

from __future__ import annotations

import functools
import inspect
import json
import math
import os
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

from accelcal._support import errors
from accelcal._support.errors import AccelcalError, visible
from accelcal._support.process import continue_in_child, time_left
from accelcal._support.stopping import asked_to_end
from accelcal.cli.lazy import catalogue, data, files, io, json_text, model_file, results_json
from accelcal.cli.overwriting import WRITTEN, OverwriteError, Writing, refuse_overwriting, writing

if TYPE_CHECKING:
    from accelcal.diagnosis.verdict import Diagnosis
    from accelcal.estimation.estimate import Fit
    from accelcal.estimation.run_fit import RunFit


class _Left(ProgressColumn):
    """Time that is left, by the share of the work and the time that it took."""

    def render(self, task: Task) -> Text:
        return Text(time_left(task.elapsed or 0.0, task.completed))


@contextmanager
def bar(title: str, console: Console) -> Iterator[Callable[[float], None]]:
    """Show a bar on a terminal while a block runs; it takes the share that is done, 0 to 1, which never falls."""
    with Progress(TextColumn("{task.description}"), BarColumn(), _Left(), console=console, transient=True) as shown:
        task = shown.add_task(title, total=None)
        done = 0.0

        def report(share: float) -> None:
            nonlocal done
            done = max(done, min(1.0, share))
            shown.update(task, completed=done, total=1.0 if done else None)

        yield report


def say(text: str, style: str = "") -> None:
    """Print a sentence on stdout, wrapped at the width of the terminal."""
    Console().print(Text(visible(text), style=style))


def say_line(text: str, end: str = "\n", *, flush: bool = False) -> None:
    """Print a line on stdout as it is, however long; `flush` shows it at once in a pipe as well."""
    print(visible(text), end=end, flush=flush)


def say_card(markdown: str) -> None:
    """Print the card of an effect: its heading in bold, its lines indented and wrapped, no marks of Markdown."""
    from rich.padding import Padding

    console = Console()
    for line in visible(markdown).splitlines():
        if line.startswith("## "):
            console.print(Text(line.removeprefix("## "), style="bold"))
        elif line.startswith("- "):
            label, colon, rest = line.removeprefix("- ").partition(": ")
            console.print(Padding(Text.assemble((label, "bold"), colon, rest), (0, 0, 0, 2)))
        else:
            console.print(Text(line))


def show_table(head: Sequence[str], rows: Sequence[Sequence[str]], *, wrapped: bool = False) -> None:
    """Print a table in full: wider than the terminal rather than with truncated numbers, unless its text is wrapped."""
    from rich.measure import Measurement
    from rich.table import Column, Table

    table = Table(*(Column(name, no_wrap=not wrapped) for name in map(_cell, head)), box=None, pad_edge=wrapped)
    for row in rows:
        table.add_row(*map(_cell, row))
    console = Console()
    needed = Measurement.get(console, console.options.update(max_width=1000), table).maximum
    Console(width=console.width if wrapped else max(console.width, needed)).print(table)


def _cell(text: str) -> Text:

    return Text(visible(text, one_line=True))


USAGE, BAD_DATA, NOT_IDENTIFIABLE, INTERNAL, INTERRUPTED = 2, 3, 4, 70, 130
USAGE_ERROR: type[Exception] = typer.BadParameter.__mro__[1]
"""Base class of the mistakes in the use of a command that typer itself prints."""
SPEAK_FOR_THEMSELVES = (SystemExit, GeneratorExit, BrokenPipeError, typer.Exit, typer.Abort, USAGE_ERROR)
"""Exceptions that end a command in their own way: an exit, a signal, a pipe that nobody reads, a question declined."""
app = typer.Typer(
    name="accelcal",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Calibrate an accelerometer against position, see where the model fails, find the physical effect it lacks.",
    epilog="Exit codes: 0 fine, 2 usage, 3 bad data, 4 not identifiable, 70 an error of accelcal, 129 terminal closed, "
    "130 interrupted, 141 nobody reads the output, 143 terminated.",
)


def _print_version(requested: bool) -> None:
    if requested:
        import accelcal

        print(f"accelcal {accelcal.__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """"""


Rig = Annotated[Path | None, typer.Option("--rig", help="Sidecar to use instead of NAME.toml beside the file.")]
Json = Annotated[bool, typer.Option("--json", help="JSON on stdout; everything else on stderr.")]
Band = Annotated[str | None, typer.Option("--band", help='Use the encoder up to this frequency, e.g. "300 Hz".')]
From = Annotated[str | None, typer.Option("--from", help="Start time on the position clock, s.")]
To = Annotated[str | None, typer.Option("--to", help="End time on the position clock, s.")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that this command did not write before.")]
Explain = Annotated[
    bool, typer.Option("--explain", help="Print what is assumed of the rig, what columns mean, and further notes.")
]
EXPLAINED = ("fit", "add", "drop", "freeze", "diagnose", "improve", "compare")
"""Commands whose tables have details."""


def writable_file(option: typer.CallbackParam, path: Path | None) -> Path | None:
    """Refuse a path where no file can be written, before any work is done."""
    if path is None:
        return None
    from accelcal.io.atomic import is_stream, require_writable

    name = f"--{option.name} {path}"
    if os.path.isdir(path):  # unlike those of a path, these answer no for a name that no file can have
        exit_with(f"{name}: this is a folder; give a file name", USAGE)
    folder = Path(os.path.realpath(path)).parent if os.path.islink(path) else path.parent
    if not os.path.isdir(folder):
        exit_with(f"{name}: there is no folder {folder}; create it first, or write elsewhere", USAGE)
    try:
        there = require_writable(path)
    except OSError as error:
        exit_with(f"{name}: cannot be written ({error.strerror}); write elsewhere", USAGE)
    if not is_stream(path, there) and not os.access(folder, os.W_OK):
        exit_with(f"{name}: no permission to write to the folder {folder.absolute()}; write elsewhere", USAGE)
    return path


def writable_folder(option: typer.CallbackParam, path: Path | None) -> Path | None:
    """Refuse a path that is a file or leads through one, before any work is done."""
    if path is not None:
        for part in (path, *path.parents):
            if os.path.exists(part) and not os.path.isdir(part):
                exit_with(f"--{option.name} {path}: {part} is a file; give a folder name", USAGE)
    return path


OfPosition = Annotated[
    Path | None,
    typer.Option(
        "--position",
        help="File of another logger with the position, or with place and attitude beside three outputs; aligned.",
    ),
]
Output = Annotated[Path | None, typer.Option("-o", "--output", help="File to write.", callback=writable_file)]
Holdout = Annotated[Path | None, typer.Option("--holdout", help="Held-out recording.")]
NO_PRIOR = Path("none")
"""Word for no prior, among paths of fleets."""
SizesFrom = Annotated[
    Path | None,
    typer.Option(
        "--prior", help="JSON of accelcal fleet, the prior of effect sizes in weights of causes; none: no such prior."
    ),
]
EffectsFile = Annotated[
    list[Path] | None,
    typer.Option("--effects-file", help="Python file with your own effects; may be given several times."),
]
RunFile = Annotated[Path, typer.Argument(help="Recording: CSV, Parquet, MAT, npz or HDF5.", show_default=False)]
ModelFile = Annotated[Path, typer.Argument(help="Model file written by fit.", show_default=False)]


def with_exit_codes(command: Callable[..., None]) -> Callable[..., None]:
    """Load effects of the user's own before a command, and turn every exception into one sentence and an exit code."""

    @functools.wraps(command)
    def run(*args: Any, force: bool = False, explain: bool = False, **kwargs: Any) -> None:
        token = writing.set(Writing(command.__name__, force, explain, kwargs))
        try:
            refuse_overwriting(kwargs)
            load_own_effects(kwargs.get("effects_file"))
            command(*args, **kwargs)
        except KeyboardInterrupt:  # of a caller that catches no signals
            exit_with("interrupted; no file was left half-written", INTERRUPTED)
        except BaseException as error:
            if isinstance(error, SPEAK_FOR_THEMSELVES) or asked_to_end():
                raise
            exit_with(errors.sentence(error) + template_hint(error, kwargs), code_of(error))
        finally:
            writing.reset(token)

    # typer reads options from evaluated annotations.
    signature = inspect.signature(command, eval_str=True)
    writes = any(name in WRITTEN for name in signature.parameters)
    options = {"force": Force} if writes else {}
    options |= {"explain": Explain} if command.__name__ in EXPLAINED else {}
    more = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=options[name])
        for name in options
    ]
    signature = signature.replace(parameters=[*signature.parameters.values(), *more])
    run.__signature__ = signature  # type: ignore[attr-defined]
    run.__annotations__ = {name: p.annotation for name, p in signature.parameters.items()} | {"return": None}
    return run


def template_hint(error: BaseException, arguments: Mapping[str, Any]) -> str:
    """How to have a sidecar written, where a recording has none and the error asks for lines of one."""
    if not isinstance(error, data.RecordingError) or arguments.get("rig") is not None:
        return ""
    for path in (arguments.get("run"), *(arguments.get("runs") or ()), *(arguments.get("files") or ())):
        if (
            isinstance(path, Path)
            and f"write in {io.sidecar_of(path)}" in str(error)
            and not io.sidecar_of(path).exists()
        ):
            return f"\nor have the whole sidecar written, to fill in: accelcal init {shlex.quote(str(path))}"
    return ""


def code_of(error: BaseException) -> int:
    """Exit code of an error."""
    if not errors.is_for_user(error):
        return BAD_DATA if errors.is_of_user_code(error) else INTERNAL
    from accelcal.estimation.gauss_newton import NotIdentifiable

    if isinstance(error, NotIdentifiable):
        return NOT_IDENTIFIABLE
    return USAGE if isinstance(error, UsageError | OverwriteError) else BAD_DATA


class UsageError(AccelcalError):
    """An option with an invalid value."""


def require_folder(name: str) -> None:
    """Folder `app` or `live` of the package, which an installation may do without.

    Raises
    ------
    UsageError
        If it is not there.
    """
    if find_spec(f"accelcal.{name}") is None:
        raise UsageError(f"accelcal was installed without python/accelcal/{name}; install it from the whole repository")


def require_ending(option: str, path: Path | None, *endings: str, what: str = "") -> None:
    """Refuse the name of an output that ends otherwise."""
    if path is not None and path.suffix not in endings:
        raise UsageError(f"{option} {path}: expected a name that ends in {' or '.join(endings)}{what}")


def exit_with(text: str, code: int) -> NoReturn:
    """Print an error on stderr and exit."""
    print(visible(f"accelcal: {text}"), file=sys.stderr)
    raise SystemExit(code)


def print_status(text: str) -> None:
    """Print a line on stderr at once, which keeps stdout free for data."""
    print(visible(text), file=sys.stderr, flush=True)


def print_written(*paths: Path | None) -> None:
    """Print which files were written."""
    for path in paths:
        if path is not None:
            print_status(f"wrote {path}")


def print_alignment(*recordings: Any) -> bool:
    """Print how two clocks were aligned, where they were; whether any were."""
    texts: dict[str, str] = {}
    for recording in recordings:
        for finding in getattr(recording, "findings", ()):
            if finding.kind == "alignment":  # once for all outputs of a sensor
                texts.setdefault(finding.text, recording.name)
    for text, name in texts.items():
        print_status(f"{name}: {text}")
    return bool(texts)


def print_json(content: dict[str, Any], indent: int | None = 2) -> None:
    """Print JSON on stdout, in ASCII where its encoding lacks a character; without an indent in one line."""
    text = json_text.dumps(content, indent)
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        text = f"{json.dumps(json.loads(text), indent=indent)}\n"
    print(text, end="", flush=True)


def deliver(
    result: Any, show: Callable[[Any], object], output: Path | None, json: bool, model: Fit | None = None
) -> None:
    """Write a result into a file, and print it: as JSON, or by `show`; with a `model`, that is what the file holds."""
    if output is not None:
        if model is None:
            io.atomic_write(output, json_text.dumps(results_json.content(result)))
        else:
            model_file.save(model, output)
        print_written(output)
    if json:
        print_json(model_file.to_dict(model) if model is not None and result is model else results_json.content(result))
    else:
        show(result)


def parse_quantity(text: str | None, kind: str, option: str) -> float | None:
    """Parse an option with a unit; a bare number is in SI."""
    from accelcal.data.units import UnitError, quantity

    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        try:
            value = quantity(text, kind)
        except UnitError as error:
            raise UsageError(f"{option} {text!r}: {error}") from None
    if not math.isfinite(value):
        raise UsageError(f"{option} {text!r}: expected a finite {kind}")
    return value


@contextmanager
def progress(title: str) -> Iterator[Callable[[float], None]]:
    """A progress bar with the time that is left on stderr; nothing when stderr is not a terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda share: None
        return

    with bar(title, console) as report:
        yield report


def time_range(text: str, option: str) -> tuple[float, float]:
    """Parse FROM:TO."""
    try:
        start, end = (float(part) for part in text.split(":"))
    except ValueError:
        raise UsageError(f"{option} {text!r}: expected two times in s separated by a colon, such as 42:60") from None
    return start, end


def load_own_effects(paths: Sequence[Path] | None) -> None:
    """Register the effects of the user's files, in the order given; every verb then takes them."""
    if not paths:
        return
    continue_in_child()

    for path in paths:
        catalogue.load_effects(path)


UNSEEN = "OTHER.csv"
"""Stands in a hint for a recording that the command has not seen."""


def suggest(*words: str | Path | None, before: str = "") -> None:
    """Print "next: accelcal ..." with some words, and the options of the command under way that the next one takes
    as well; nothing where a word is None: a file that is not known. `before` is what the user does before it."""
    if None in words:
        return
    callbacks = [c.callback for c in app.registered_commands if name_of(c) == words[0] and c.callback is not None]
    taken = inspect.signature(callbacks[0]).parameters if callbacks else {}
    arguments = writing.get().arguments
    options = [
        word
        for name, option in CARRIED.items()
        if name in taken and option not in words
        for value in several(arguments.get(name))
        for word in (option, value)
    ]
    output = words.index("-o") if "-o" in words else len(words)
    line = (*words[:output], *options, *words[output:])
    print_status(f"next: {before}accelcal {' '.join(shlex.quote(str(word)) for word in line)}")


CARRIED = {
    "holdout": "--holdout",
    "rig": "--rig",
    "effects_file": "--effects-file",
    "start": "--from",
    "end": "--to",
    "band": "--band",
}
"""Parameters of commands that say what is read, and how: the next step reads the same."""


def name_of(command: typer.models.CommandInfo) -> str:
    """Name of a registered command."""
    return command.name or str(getattr(command.callback, "__name__", ""))


def several(value: Any) -> Sequence[Any]:
    """The values of an option: none, one, or those of one that may be repeated."""
    return () if value is None else value if isinstance(value, list) else (value,)


def after_fit(model: Path | None, runs: Sequence[Path]) -> None:
    """Suggest to diagnose a fit that was written, and to write one that was not."""
    if model is None:
        suggest("fit", *runs, "-o", "model.json")
    else:
        suggest("diagnose", model, *runs)


def after_diagnosis(fit: Fit, diagnosis: Diagnosis, model: Path, runs: Sequence[Path]) -> None:
    """Suggest to add what is missing, on the recordings that the model was fitted to, and for a class to rank the runs
    that separate it; for a model that lacks nothing suggest the report."""
    fitted = fitted_files(fit, model, *runs)
    missing = next((effect for effect in diagnosis.effects if effect not in fit.model.effects), None)
    if diagnosis.verdict == "tied" and any(len(group.weights) > 1 for group in diagnosis.classes):
        suggest("next", model, *fitted)
    if diagnosis.verdict in ("named", "tied", "shape"):
        suggest("add", model, *fitted, "--effect", missing, "-o", f"{model.stem}_{missing}.json")
    elif diagnosis.verdict == "adequate":
        suggest("report", model, fitted[0], "-o", f"{runs[0].stem}.html")
    elif diagnosis.verdict == "too_short":
        suggest("power", runs[0])


def after_comparison(fit: Fit, model: Path, run: Path) -> None:
    """Suggest to diagnose a model on what it was fitted to; a recording that it was not fitted to stays held out."""
    fitted = fitted_files(fit, model, run)
    unseen = () if any(path is not None and path.samefile(run) for path in fitted) else ("--holdout", run)
    suggest("diagnose", model, *fitted, *unseen)


def fitted_files(fit: Fit, *paths: Path) -> list[Path | None]:
    """Recordings of a model, looked for beside the files that a command was given; None for one that is elsewhere."""

    def place(run: RunFit) -> Path | None:
        beside = (folder / run.file for folder in dict.fromkeys(path.parent for path in paths))
        return next((at for at in beside if at.is_file() and files.digest_of(at) in (run.digest, run.session)), None)

    return list(dict.fromkeys(place(run) for run in fit.runs))
