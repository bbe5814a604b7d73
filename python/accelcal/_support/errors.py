"""Errors for users: what was found, where, what was expected, the next step; and defects of accelcal itself.

An exception speaks to the user if it is an `AccelcalError`, or names a file that the operating system refused. Anything
else is an error of accelcal. Its report holds what the authors need and nothing of the user's data: no values, no texts
of exceptions.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any


class AccelcalError(ValueError):
    """Base of all errors of accelcal that speak to a user; any other exception is an error of accelcal itself.

    Examples
    --------
    >>> import accelcal as ac
    >>> try:
    ...     ac.load("absent.csv")
    ... except ac.AccelcalError as error:
    ...     print(str(error).partition(":")[0])
    absent.csv
    """


class FieldError(AccelcalError):
    """A field of a value holds a number that it cannot have."""

    def __init__(self, owner: str, field: str, value: float, expected: str) -> None:
        super().__init__(f"{owner}: {field} is {value:g}; expected {expected}")
        self.field, self.value, self.expected = field, value, expected


class AccessError(AccelcalError, OSError):
    """A file or a port cannot be used."""


class MissingExtra(AccelcalError, ImportError):
    """An optional package is not installed. The text states how to install it."""


def optional(module: str, purpose: str, extra: str) -> Any:
    """Return a module of a package that need not be installed.

    Raises
    ------
    MissingExtra
        Saying what needs it (`purpose`, with its verb) and which extra of accelcal brings it.
    """
    try:
        return __import__(module, None, None, ("",))  # the module itself, not the package that it is in
    except ImportError as error:
        package = module.partition(".")[0]
        raise MissingExtra(f'{purpose} {package}; install it with: pip install "accelcal[{extra}]"') from error


PACKAGE = Path(__file__).parents[1]
PACKAGES = ("numpy", "scipy", "pyarrow", "pint", "typer", "rich", "nicegui", "matplotlib", "plotly", "h5py")
_FRAME = re.compile(r'^ +File "(.+)", line (\d+), in (.+)$', re.MULTILINE)
MOST_FRAMES = 60
"""Frames at either end of a traceback that a report lists."""


class RemoteTraceback(Exception):
    """Cause of an exception that another process sent: where it was raised there, as text."""

    def __init__(self, tb: str) -> None:
        super().__init__(tb)
        self.tb = tb


def is_for_user(error: BaseException) -> bool:
    """Whether the text of an exception was written for users; if not, the exception is an error of accelcal."""
    core = sys.modules.get("accelcal._core")  # importing it takes memory, and that may be what is missing
    if core is not None and isinstance(error, core.FilterError):
        return True
    return isinstance(error, AccelcalError) or (isinstance(error, OSError) and error.errno is not None)


def sentence(error: BaseException, command: Sequence[str] | None = None) -> str:
    """What to tell the user, on one line; an error of accelcal leaves a report, and the sentence says where.

    Parameters
    ----------
    error : as it was caught, with its traceback.
    command : with file names, for the report; by default the command of this process.
    """
    if is_for_user(error):
        if isinstance(error, OSError) and error.filename and error.strerror:
            return f"{error.filename}: {error.strerror.lower()}; check the path and its permissions"
        if isinstance(error, FileNotFoundError) and error.errno is not None:  # of no file, so of the working folder
            return "the folder in which the command runs was removed; change to one that exists, or run: cd"
        return str(error)
    line = _line_of_user(error.__traceback__)
    if line is not None:
        text = " ".join(str(error).split())
        return f"{line}: {type(error).__name__}: {text}; change this line"
    place = None
    with suppress(Exception):  # no memory
        place = write_report(error, sys.argv if command is None else command)
    inside = [_place(f.f_code.co_filename, line, "") for f, line in _frames(error.__traceback__) if _is_own(f)]
    cause = (
        "it asked for more memory than there is; a shorter part of the recording may pass"
        if isinstance(error, MemoryError) or "failed to map segment" in str(error)
        else f"{type(error).__name__} in {inside[-1].partition(' in ')[0] if inside else 'code that it calls'}"
    )
    sent = f"please send {place} to its authors; it holds no data" if place else "no folder accepts a report of it"
    return f"this is an error of accelcal: {cause}; {sent}"


def is_of_user_code(error: BaseException) -> bool:
    """Whether code of the user raised an exception: an effect in a file of their own."""
    return _line_of_user(error.__traceback__) is not None


def write_report(error: BaseException, command: Sequence[str]) -> Path | None:
    """Write a report to the first folder that takes one, over no other file; None where none does."""
    import tempfile

    text = "\n".join(_report(error, command)) + "\n"
    for folder in _folders():
        try:
            descriptor, name = tempfile.mkstemp(prefix="accelcal-error-", suffix=".txt", dir=folder)
        except OSError:
            continue
        try:
            with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
                file.write(text)
        except OSError:  # no space
            os.unlink(name)
            continue
        return Path(name)
    return None


def _folders() -> Iterator[str]:
    """Where a report may go: the folder for temporary files, the current one, the user's own."""
    import tempfile

    with suppress(OSError):
        yield tempfile.gettempdir()
    yield from (os.curdir, os.path.expanduser("~"))


def _report(error: BaseException, command: Sequence[str]) -> Iterator[str]:
    import platform
    import shlex
    from importlib import metadata

    yield from (
        "An error of accelcal. This file holds no recorded data and no text of exceptions.",
        "",
        f"command: {shlex.join(command)}",
        f"python: {platform.python_version()} ({platform.python_implementation()}), {platform.platform()}",
    )
    for name in (PACKAGE.name, *PACKAGES):
        try:
            yield f"{name}: {metadata.version(name)}"
        except metadata.PackageNotFoundError:
            yield f"{name}: not installed"
    visited: BaseException | None = error
    while visited is not None:
        yield from ("", f"{type(visited).__module__}.{type(visited).__qualname__}, raised through")
        places = [
            _place(f.f_code.co_filename, line, f.f_code.co_qualname) for f, line in _frames(visited.__traceback__)
        ]
        sent = _FRAME.findall(str(getattr(visited, "tb", "")))  # by another process, as text
        places += [_place(name, int(line), function) for name, line, function in sent]
        yield from _shortened([f"  {place}" for place in places])
        visited = visited.__cause__ or (None if visited.__suppress_context__ else visited.__context__)


def _shortened(lines: list[str]) -> list[str]:
    """Both ends of a long list."""
    if len(lines) <= 2 * MOST_FRAMES:
        return lines
    return [*lines[:MOST_FRAMES], f"  ... {len(lines) - 2 * MOST_FRAMES} more", *lines[-MOST_FRAMES:]]


def _frames(traceback: TracebackType | None) -> Iterator[tuple[FrameType, int]]:
    """Frames with their lines, the outermost first."""
    while traceback is not None:
        yield traceback.tb_frame, traceback.tb_lineno
        traceback = traceback.tb_next


def _is_own(frame: FrameType) -> bool:
    return Path(frame.f_code.co_filename).is_relative_to(PACKAGE)


def _place(name: str, line: int, function: str) -> str:
    """File below the folder that holds it, line and function; paths of the user's machine are left out."""
    path = Path(name)
    for folder in (str(PACKAGE.parent), *_libraries()):
        if path.is_relative_to(folder):
            path = path.relative_to(folder)
            break
    return f"{path}:{line} in {function}"


def _line_of_user(traceback: TracebackType | None) -> str | None:
    """File and line of the user's own code that raised, such as an effect; None where all is accelcal and libraries."""
    for frame, line in reversed(list(_frames(traceback))):
        name = frame.f_code.co_filename
        if _is_own(frame):
            return None
        if (
            Path(name).suffix not in (".pyx", ".pxd")
            and os.path.isfile(name)
            and not any(Path(name).is_relative_to(folder) for folder in _libraries())
        ):
            return f"{name}, line {line}"
    return None


def _libraries() -> tuple[str, ...]:
    """Folders of Python and of installed packages."""
    import sysconfig

    paths = sysconfig.get_paths()
    return tuple(sorted({paths[key] for key in ("purelib", "platlib", "stdlib", "platstdlib")}, key=len, reverse=True))


_OBEYED = r"\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufeff"
"""Control characters but tab and line feed, marks that turn the direction of writing, halves of surrogate pairs."""
OBEYED = re.compile(f"[{_OBEYED}]")
"""What never stands in a line or a page of output."""
OBEYED_IN_NAMES = re.compile(f"[{_OBEYED}\t\n]")
"""The same for a name or one sentence, where tab and line feed have no place either."""


def visible(text: str, *, one_line: bool = False) -> str:
    r"""The text with every character that a terminal would obey written as its escape.

    Parameters
    ----------
    text : of any origin.
    one_line : whether tabs and line feeds are escaped as well.

    Examples
    --------
    >>> visible("\x1b[2J") == r"\x1b[2J"
    True
    """
    return (OBEYED_IN_NAMES if one_line else OBEYED).sub(
        lambda match: f"\\x{code:02x}" if (code := ord(match[0])) < 0x100 else f"\\u{code:04x}", text
    )
