"""Which files a command replaces: what the same command has written before, and with --force whatever is there.

A recording and its sidecar are known by the mark in the sidecar (`accelcal.io.write`), a model by the recordings that
it was fitted to, other JSON by its schema, a table by its header, text by the name of its maker. Figures are replaced.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from accelcal._support.errors import AccelcalError
from accelcal.cli.lazy import files, io, json_text, model_file, response_files

WRITTEN = ("output", "c", "rust", "dcc", "csv", "figure", "save", "motion")
"""Parameters that name an output file."""
RECORDINGS = (".csv", ".parquet")
"""Endings of recordings that are written, each with a sidecar next to it."""
RECORDING = ("cut", "demo", "dwells", "next", "plan", "simulate")
"""Commands that write a recording, or a table, with a sidecar."""
MODELLING = ("add", "demo", "drop", "fit", "freeze", "improve", "live")
"""Commands that write a model."""
FIGURES = (".pdf", ".png", ".svg")
"""Endings of figures, which hold no name of their maker."""


@dataclass(frozen=True, slots=True)
class Writing:
    """The command that is under way."""

    command: str = ""
    force: bool = True
    """Whether it replaces whatever is there; a program that calls its parts does."""
    explain: bool = False
    """Whether it prints details of its tables."""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    """Its arguments by name."""


_BY_PROGRAM = Writing()
writing: ContextVar[Writing] = ContextVar("writing", default=_BY_PROGRAM)


class OverwriteError(AccelcalError):
    """A file that would be replaced, and is not what the command has written before."""


def refuse_overwriting(given: Mapping[str, Any]) -> None:
    """Refuse the outputs of a command that are among its inputs, or that it did not write before.

    Parameters
    ----------
    given : arguments of the command by name.

    Raises
    ------
    OverwriteError
        Naming the option.
    """
    written = {name: given[name] for name in WRITTEN if isinstance(given.get(name), Path)}
    if not written:
        return

    read = paths_in(value for name, value in given.items() if name not in (*WRITTEN, "model", "models"))
    models = paths_in(given.get(name) for name in ("model", "models"))
    inputs = {path.resolve() for source in read for path in (source, io.sidecar_of(source))}
    for name, path in written.items():
        for output in (path, io.sidecar_of(path)) if path.suffix in RECORDINGS else (path,):
            if output.resolve() in inputs:
                raise OverwriteError(
                    f"--{name} {path}: {output} is an input of this command and would be overwritten; give another name"
                )
        if path.is_dir() or (name == "output" and writing.get().command == "live"):
            continue  # a measurement cannot be repeated: `live` never replaces one, whoever asks
        require_replaceable(path, f"--{name} {path}: ", read, models, joined=given.get("position") is not None)


def mark_of(recording: Path) -> Callable[[str], str]:
    """How the sidecar of a recording, which is written before it, is marked by the command under way."""
    from accelcal.io.atomic import waiting
    from accelcal.io.write import marked

    command = writing.get().command
    return (lambda text: marked(text, command, files.digest_of(waiting(recording)))) if command else str


def paths_in(values: Iterator[Any]) -> list[Path]:
    """Paths among arguments and lists of them."""
    listed = [item for value in values for item in (value if isinstance(value, list) else [value])]
    return [item for item in listed if isinstance(item, Path)]


def require_replaceable(
    path: Path, option: str, read: Sequence[Path], models: Sequence[Path] = (), *, joined: bool = False
) -> None:
    """Refuse a file that the command under way did not write before, unless it was given --force.

    Parameters
    ----------
    option : beginning of the message.
    read : recordings that the command reads.
    models : model files that it reads.
    joined : whether its recording is made of two files, and has a digest of its own.

    Raises
    ------
    OverwriteError
        With what is there.
    """
    now = writing.get()
    if now.force:
        return
    reason = (
        _of_recording(path, now.command)
        if now.command in RECORDING and path.suffix in RECORDINGS
        else _of_file(path, now.command, read, models, joined=joined)
    )
    if reason:
        raise OverwriteError(f"{option}{reason}; give another name, or --force to replace what is there")


def _of_recording(path: Path, command: str) -> str:
    """Why a recording is not written with its sidecar; "" where it may be."""
    from accelcal.io.write import writer_of

    sidecar = io.sidecar_of(path)
    others = [
        neighbour for neighbour in map(path.with_suffix, files.READABLE) if neighbour != path and neighbour.is_file()
    ]
    if others and not (path.exists() and writer_of(path) == command):
        return f"{sidecar.name} would be the sidecar of {others[0].name} as well"
    for there in (path, sidecar):
        if there.is_file() and writer_of(path) != command:
            return f"accelcal {command} did not write {there}, or it has changed since"
    return ""


def _of_file(path: Path, command: str, read: Sequence[Path], models: Sequence[Path], *, joined: bool) -> str:
    """Why a model, a table or a page is not written; "" where it may be."""
    if not path.is_file() or path.suffix in FIGURES or not path.stat().st_size:
        return ""

    if path.suffix == ".json":
        try:
            content = json_text.read_json(path)
            schema = str(content["schema"])
        except (ValueError, KeyError, TypeError, IndexError):
            schema = ""
        if schema.startswith("accelcal/model/"):
            if command not in MODELLING:
                return f"{path} is a model"
            runs, used = _sources(content)
            if joined or (not runs and len(read) > 1):  # made of several files, with a digest of its own
                same = any(file.name in str(source.get("name")) for source in used for file in read)
            elif command == "live":  # which goes on with a model
                same = any(_digests(used) & _digests(_sources(json_text.read_json(model))[1]) for model in models)
            elif not _digests(used):  # of arrays of a program
                same = any(path.samefile(model) for model in models)
            else:
                same = any(file.is_file() and files.digest_of(file) in _digests(used) for file in read)
            return "" if same else f"{path} is a model of another recording"
        if schema.startswith("accelcal/") and command not in MODELLING:
            return ""
    elif _is_text_of_accelcal(path):
        return ""
    return f"accelcal {command} did not write {path}"


def _sources(model: Any) -> tuple[list[Any], list[Any]]:
    """Recordings that a model was fitted to; the same and its dwells."""
    try:
        present = model_file.migrated(model)
    except ValueError:
        return [], []
    runs = [run for run in present.get("runs") or () if isinstance(run, Mapping)]
    dwells = present.get("dwells")
    return runs, [*runs, *([dwells] if isinstance(dwells, Mapping) else ())]


def _digests(sources: Sequence[Mapping[str, Any]]) -> set[Any]:
    return {source.get(key) for source in sources for key in ("digest", "session")} - {None, ""}


def _is_text_of_accelcal(path: Path) -> bool:
    """Whether a file that is no recording says that accelcal made it, or is a table of `response`."""
    with path.open("rb") as file:
        head = file.read(100_000)
    if path.suffix in files.READABLE:
        return head.startswith(",".join(response_files.COLUMNS).encode())
    return path.suffix != ".toml" and b"accelcal" in head
