"""What all commands share: the application, its options, errors as sentences, progress."""

from __future__ import annotations

import functools
import inspect
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

if TYPE_CHECKING:
    pass

WRITTEN = ("output", "c", "rust", "dcc")
"""Parameters that name a file to write."""
RECORDINGS = (".csv", ".parquet")
"""What a recording is written as, with a sidecar beside it."""
USAGE, BAD_DATA, NOT_IDENTIFIABLE, INTERRUPTED = 2, 3, 4, 130
app = typer.Typer(
    name="accelcal",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Estimate an accelerometer from position, see where the model fails, learn which physical effect is missing.",
)
Rig = Annotated[Path | None, typer.Option("--rig", help="Sidecar to use instead of NAME.toml beside the file.")]
Json = Annotated[bool, typer.Option("--json", help="JSON on stdout; everything else on stderr.")]
Band = Annotated[str | None, typer.Option("--band", help='Trust the encoder up to this frequency, e.g. "300 Hz".')]
From = Annotated[str | None, typer.Option("--from", help="Begin here on the position clock, s.")]
To = Annotated[str | None, typer.Option("--to", help="End here on the position clock, s.")]
Seed = Annotated[int | None, typer.Option("--seed", help="Seed of everything random; stored in what is written.")]


def new_file(option: typer.CallbackParam, path: Path | None) -> Path | None:
    """Refuse a place where no file can be written before any work is done."""
    if path is None:
        return None
    name = f"--{option.name} {path}"
    if path.is_dir():
        fail(f"{name}: this is a folder; give the name of a file", USAGE)
    if not path.parent.is_dir():
        fail(f"{name}: there is no folder {path.parent}; make it first, or write elsewhere", USAGE)
    if not os.access(path.parent, os.W_OK):
        fail(f"{name}: the folder {path.parent.absolute()} may not be written to; write elsewhere", USAGE)
    return path


def folder(option: typer.CallbackParam, path: Path | None) -> Path | None:
    """Refuse a folder that is none, or lies in a file, before any work is done."""
    if path is not None:
        for part in (path, *path.parents):
            if part.exists() and not part.is_dir():
                fail(f"--{option.name} {path}: {part} is a file; give the name of a folder", USAGE)
    return path


Output = Annotated[Path | None, typer.Option("-o", "--output", help="Write the result here.", callback=new_file)]
Holdout = Annotated[Path | None, typer.Option("--holdout", help="Recording that is not fitted.")]
EffectsFile = Annotated[
    list[Path] | None,
    typer.Option("--effects-file", help="Python file with effects of your own; may be given several times."),
]
RunFile = Annotated[Path, typer.Argument(help="Recording: CSV, Parquet, MAT, npz or HDF5.", show_default=False)]
ModelFile = Annotated[Path, typer.Argument(help="Model file written by fit.", show_default=False)]


def main() -> None:
    """Run the command line."""
    app()


def reported(command: Callable[..., None]) -> Callable[..., None]:
    """Turn what the library raises into one sentence and an exit code."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        try:
            require_apart(kwargs)
            command(*args, **kwargs)
        except KeyboardInterrupt:
            fail("interrupted; nothing was left half-written", INTERRUPTED)
        except (ValueError, OSError, ImportError) as error:
            fail(told(error), code_of(error))

    # typer reads options from evaluated annotations.
    signature = inspect.signature(command, eval_str=True)
    run.__signature__ = signature  # type: ignore[attr-defined]
    run.__annotations__ = {name: p.annotation for name, p in signature.parameters.items()} | {"return": None}
    return run


def require_apart(given: Mapping[str, Any]) -> None:
    """Refuse to write over a recording or a sidecar that the command reads; a model may be replaced by the next one.

    Raises
    ------
    Usage
        Naming the option.
    """
    written = {name: given[name] for name in WRITTEN if isinstance(given.get(name), Path)}
    if not written:
        return
    from accelcal.io import sidecar_of

    values = [value for name, value in given.items() if name not in (*WRITTEN, "model", "models")]
    read = {
        path for value in values for path in (value if isinstance(value, list) else [value]) if isinstance(path, Path)
    }
    kept = {path.resolve() for one in read for path in (one, sidecar_of(one))}
    for name, path in written.items():
        for made in (path, sidecar_of(path)) if path.suffix in RECORDINGS else (path,):
            if made.resolve() in kept:
                raise Usage(f"--{name} {path}: {made} is read by this command and would be lost; give another name")


def told(error: Exception) -> str:
    """What an error says; one of the operating system in the order that the others have, the file first."""
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror.lower()}; check the path and who may write there"
    return str(error)


def code_of(error: Exception) -> int:
    """Exit code that suits an error."""
    from accelcal.estimation.gauss_newton import NotIdentifiable

    if isinstance(error, NotIdentifiable):
        return NOT_IDENTIFIABLE
    return USAGE if isinstance(error, Usage) else BAD_DATA


class Usage(ValueError):
    """An option whose text cannot be understood."""


def fail(text: str, code: int) -> NoReturn:
    """Say what is wrong and leave."""
    print(f"accelcal: {text}", file=sys.stderr)
    raise SystemExit(code)


def say(text: str) -> None:
    """Talk, on stderr."""
    print(text, file=sys.stderr)


def emit(content: dict[str, Any]) -> None:
    """Print JSON on stdout."""
    from accelcal.serialization import model_file

    print(model_file.dumps(content), end="")


def amount(text: str | None, kind: str, option: str) -> float | None:
    """Read an option with a unit; a bare number is taken in SI."""
    from accelcal.data.units import UnitError, quantity

    if text is None:
        return None
    try:
        found = float(text)
    except ValueError:
        try:
            found = quantity(text, kind)
        except UnitError as error:
            raise Usage(f"{option} {text!r}: {error}") from None
    if not math.isfinite(found):
        raise Usage(f"{option} {text!r}: expected a finite {kind}")
    return found


@contextmanager
def progress(title: str) -> Iterator[Callable[[float], None]]:
    """A bar with the time left on stderr; silent when stderr is not a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda share: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def stretch(text: str, option: str) -> tuple[float, float]:
    """Read FROM:TO."""
    try:
        start, end = (float(part) for part in text.split(":"))
    except ValueError:
        raise Usage(f"{option} {text!r}: expected two times in s with a colon between, such as 42:60") from None
    return start, end


def own_effects(paths: Sequence[Path] | None) -> None:
    """Register the effects of the user's files, in the order given; every verb then takes them."""
    from accelcal.effects import load_effects

    for path in paths or ():
        load_effects(path)
