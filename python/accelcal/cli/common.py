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
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from accelcal._support import internal_error
from accelcal._support.errors import AccelcalError
from accelcal._support.plain_text import visible
from accelcal._support.process import continue_in_child
from accelcal._support.stopping import asked_to_end
from accelcal.cli.overwriting import WRITTEN, OverwriteError, Writing, refuse_overwriting, writing

USAGE, BAD_DATA, NOT_IDENTIFIABLE, INTERNAL, INTERRUPTED = 2, 3, 4, 70, 130
USAGE_ERROR: type[Exception] = typer.BadParameter.__mro__[1]
"""What typer itself prints as a mistake in the use of a command."""
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


def _print_version(asked: bool) -> None:
    if asked:
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


def writable_file(option: typer.CallbackParam, path: Path | None) -> Path | None:
    """Refuse a path where no file can be written, before any work is done."""
    if path is None:
        return None
    from accelcal.io.atomic import is_stream, require_writable

    name = f"--{option.name} {path}"
    if path.is_dir():
        exit_with(f"{name}: this is a folder; give a file name", USAGE)
    folder = Path(os.path.realpath(path)).parent if path.is_symlink() else path.parent
    if not folder.is_dir():
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
            if part.exists() and not part.is_dir():
                exit_with(f"--{option.name} {path}: {part} is a file; give a folder name", USAGE)
    return path


OfPosition = Annotated[
    Path | None, typer.Option("--position", help="File of another logger with the position; the two are aligned.")
]
Output = Annotated[Path | None, typer.Option("-o", "--output", help="File to write.", callback=writable_file)]
Holdout = Annotated[Path | None, typer.Option("--holdout", help="Held-out recording.")]
EffectsFile = Annotated[
    list[Path] | None,
    typer.Option("--effects-file", help="Python file with your own effects; may be given several times."),
]
RunFile = Annotated[Path, typer.Argument(help="Recording: CSV, Parquet, MAT, npz or HDF5.", show_default=False)]
ModelFile = Annotated[Path, typer.Argument(help="Model file written by fit.", show_default=False)]


def with_exit_codes(command: Callable[..., None]) -> Callable[..., None]:
    """Turn every exception into one sentence and an exit code."""

    @functools.wraps(command)
    def run(*args: Any, force: bool = False, **kwargs: Any) -> None:
        token = writing.set(Writing(command.__name__, force))
        try:
            refuse_overwriting(kwargs)
            command(*args, **kwargs)
        except KeyboardInterrupt:  # of a caller that catches no signals
            exit_with("interrupted; no file was left half-written", INTERRUPTED)
        except BaseException as error:
            if speaks_for_itself(error) or asked_to_end():
                raise
            exit_with(internal_error.sentence(error) + template_hint(error, kwargs), code_of(error))
        finally:
            writing.reset(token)

    # typer reads options from evaluated annotations.
    signature = inspect.signature(command, eval_str=True)
    if any(name in WRITTEN for name in signature.parameters):
        force = inspect.Parameter("force", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Force)
        signature = signature.replace(parameters=[*signature.parameters.values(), force])
    run.__signature__ = signature  # type: ignore[attr-defined]
    run.__annotations__ = {name: p.annotation for name, p in signature.parameters.items()} | {"return": None}
    return run


def template_hint(error: BaseException, given: Mapping[str, Any]) -> str:
    """How to have a sidecar written, where a recording has none and the error asks for lines of one."""
    from accelcal.data.recording import RecordingError
    from accelcal.io import sidecar_of

    if not isinstance(error, RecordingError) or given.get("rig") is not None:
        return ""
    for path in (given.get("run"), *(given.get("runs") or ()), *(given.get("files") or ())):
        if isinstance(path, Path) and f"write in {sidecar_of(path)}" in str(error) and not sidecar_of(path).exists():
            return f"\nor have the whole sidecar written, to fill in: accelcal init {shlex.quote(str(path))}"
    return ""


def speaks_for_itself(error: BaseException) -> bool:
    """Whether an exception ends the command in its own way: an exit, a signal, a pipe that nobody reads, a question
    that was declined.
    """
    return isinstance(error, SystemExit | GeneratorExit | BrokenPipeError | typer.Exit | typer.Abort | USAGE_ERROR)


def code_of(error: BaseException) -> int:
    """Exit code of an error."""
    if not internal_error.is_for_user(error):
        return BAD_DATA if internal_error.is_of_user_code(error) else INTERNAL
    from accelcal.estimation.gauss_newton import NotIdentifiable

    if isinstance(error, NotIdentifiable):
        return NOT_IDENTIFIABLE
    return USAGE if isinstance(error, UsageError | OverwriteError) else BAD_DATA


class UsageError(AccelcalError):
    """An option with an invalid value."""


def exit_with(text: str, code: int) -> NoReturn:
    """Print an error on stderr and exit."""
    print(visible(f"accelcal: {text}"), file=sys.stderr)
    raise SystemExit(code)


def print_status(text: str) -> None:
    """Print a line on stderr, which keeps stdout free for data."""
    print(visible(text), file=sys.stderr)


def print_alignment(recording: Any) -> None:
    """Print how the clocks of two loggers were aligned, where they were."""
    for finding in recording.findings:
        if finding.kind == "alignment":
            print_status(f"{recording.name}: {finding.text}")


def print_json(content: dict[str, Any], indent: int | None = 2) -> None:
    """Print JSON on stdout, in ASCII where its encoding lacks a character; without an indent in one line."""
    from accelcal.results.json_text import dumps

    text = dumps(content, indent)
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        text = f"{json.dumps(json.loads(text), indent=indent)}\n"
    print(text, end="", flush=True)


def parse_quantity(text: str | None, kind: str, option: str) -> float | None:
    """Parse an option with a unit; a bare number is in SI."""
    from accelcal.data.units import UnitError, quantity

    if text is None:
        return None
    try:
        found = float(text)
    except ValueError:
        try:
            found = quantity(text, kind)
        except UnitError as error:
            raise UsageError(f"{option} {text!r}: {error}") from None
    if not math.isfinite(found):
        raise UsageError(f"{option} {text!r}: expected a finite {kind}")
    return found


@contextmanager
def progress(title: str) -> Iterator[Callable[[float], None]]:
    """A progress bar with the time that is left on stderr; nothing when stderr is not a terminal."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda share: None
        return
    from accelcal.cli.progress_bar import bar

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
    from accelcal.effects import load_effects

    for path in paths:
        load_effects(path)
