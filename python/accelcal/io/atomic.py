"""Files that appear whole or not at all: written as a part in the folder of their place, then renamed.

A part has a name of its own for every writer, in whatever thread, process or machine; its writer holds a lock on it. A
part without one was left by a killed process and is removed by the next that writes to the folder.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from accelcal._support import locks
from accelcal._support.errors import AccessError

PART = re.compile(r"\.accelcal-[0-9a-f]{24}\.part")
OPEN = re.compile(r"/dev/(?P<name>stdout|stderr)|/(?:dev|proc/self)/fd/(?P<number>\d+)")
"""Names of streams that are open already, wherever they lead: a file, a pipe, a terminal."""
_waiting: ContextVar[list[Part] | None] = ContextVar("waiting", default=None)
"""Parts that become files when the outermost block of `together` ends."""
_swept: set[Path] = set()
"""Folders in which this process has looked for leftovers."""


@contextmanager
def atomic(path: str | Path) -> Iterator[Path]:
    """Give a name to write to; it becomes `path` when the block ends well, and vanishes when it does not.

    A link is followed: its target is replaced and the link stays. A new file has the permissions that the umask leaves,
    a replaced one keeps those that it had; another hard link to it keeps the old content. To a device or a pipe the
    content is written as it is.

    Raises
    ------
    OSError
        If the file cannot be written; the text names it and says why.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp(), "fit.json")
    >>> with atomic(target) as part:
    ...     _ = part.write_text("{}")
    >>> target.read_text()
    '{}'
    """
    with together(), named(Path(path)):
        part = Part(Path(path))
        parts = _waiting.get()
        assert parts is not None
        parts.append(part)
        try:
            part.create()
            yield part.path
        except BaseException:
            parts.remove(part)
            part.discard()
            raise


@contextmanager
def together() -> Iterator[None]:
    """Files that `atomic` writes in this block appear when it ends well, one right after the other, or none of them.

    What cannot be replaced is found before anything is, and an error between two of them brings back what was there.
    A machine that stops exactly there may leave some new and some old; each is whole.

    Raises
    ------
    OSError
        If one of the files cannot be written; the text names it and says why.
    """
    if _waiting.get() is not None:
        yield  # the outer block ends for all
        return
    parts: list[Part] = []
    outside = _waiting.set(parts)
    try:
        yield
        _publish(parts)
    finally:
        _waiting.reset(outside)
        for part in parts:
            part.discard()


def waiting(path: Path) -> Path:
    """Where the content is that `together` will give a place, by its name there; the name where none waits."""
    parts = [part.path for part in _waiting.get() or () if part.name == path]
    return parts[-1] if parts else path


def atomic_write(path: str | Path, content: str | bytes) -> None:
    """Write a whole file at once: bytes, or text as UTF-8 with the line ends it has; what UTF-8 lacks as its escape."""
    with atomic(path) as part:
        part.write_bytes(content.encode(errors="backslashreplace") if isinstance(content, str) else content)


class Part:
    """One file that is being written. Nothing is made before it is known where: an interrupt finds all that there is.

    Parameters
    ----------
    name : where the user wants it: nothing yet, a file, a link to either, a device or a pipe.

    Raises
    ------
    OSError
        If nothing can be written there.
    """

    def __init__(self, name: Path) -> None:
        self.name = name
        there = require_writable(name)
        self.straight = is_stream(name, there)
        """Whether the content goes into what is there, in place of a new file."""
        self.target = name if self.straight else Path(os.path.realpath(name))
        self._folder = Path(tempfile.gettempdir()) if self.straight else self.target.parent
        self._mode = None if there is None or self.straight else stat.S_IMODE(there.st_mode) & 0o777
        self.is_new = there is None
        """Whether nothing was there."""
        self._descriptor = -1
        self._old: Path | None = None
        self.path = free_name(self._folder)
        """The part; not there before `create`, and never after `discard`."""

    def create(self) -> None:
        """Make the part, empty, with the permissions of what it replaces."""
        _sweep(self._folder)
        while (descriptor := locks.create(self.path)) is None:
            self.path = free_name(self._folder)
        self._descriptor = descriptor
        if self._mode is not None:
            with suppress(OSError):  # a file system without permissions
                os.chmod(self.path, self._mode)

    def settle(self) -> None:
        """See that the content is on the disk, so that no power failure leaves a name without it."""
        if not self.straight:
            _settle(self.path, os.O_WRONLY)

    def keep_old(self) -> None:
        """Keep what `publish` replaces within reach of `withdraw`, where the file system has hard links."""
        if not self.straight:
            self._old = free_name(self.target.parent)
            try:
                os.link(self.target, self._old)
            except OSError:  # nothing there, or no hard links
                self._old = None

    def publish(self) -> None:
        """Give the content its place."""
        if self.straight:
            _pour(self.path, self.name)
        else:
            os.replace(self.path, self.target)

    def withdraw(self) -> None:
        """Bring back what `publish` replaced; without hard links the new content stays where an old one was."""
        if self._old is not None:
            os.replace(self._old, self.target)
        elif self.is_new:
            self.target.unlink(missing_ok=True)

    def discard(self) -> None:
        """Remove what is not a file that the user asked for."""
        for path in (self.path, self._old):
            if path is not None:
                with suppress(OSError):  # published, or never made
                    path.unlink()
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def require_writable(name: Path) -> os.stat_result | None:
    """Check that a file can be written or replaced here; return what is there, at the end of all links.

    Raises
    ------
    OSError
        If it is a folder, a file that is write-protected, a disk or a socket.
    """
    try:
        there = os.stat(name)
    except FileNotFoundError:
        return None
    if _open_stream(name) is not None:
        return there
    if stat.S_ISDIR(there.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if stat.S_ISBLK(there.st_mode) or stat.S_ISSOCK(there.st_mode):
        raise OSError(errno.EINVAL, "it is a disk or a socket, neither a file nor a stream")
    if not there.st_mode & 0o222 or not os.access(name, os.W_OK):
        raise PermissionError(errno.EACCES, "it is write-protected")
    return there


def is_stream(name: Path, there: os.stat_result | None) -> bool:
    """Whether what is there receives content and cannot be replaced: a device, a pipe, the standard output."""
    return there is not None and (_open_stream(name) is not None or not stat.S_ISREG(there.st_mode))


def _open_stream(name: Path) -> int | None:
    """Descriptor of an open stream by its name in the file system; None for any other name."""
    match = OPEN.fullmatch(os.path.abspath(name))
    if match is None:
        return None
    return int(match["number"]) if match["number"] else {"stdout": 1, "stderr": 2}[match["name"]]


@contextmanager
def named(name: Path) -> Iterator[None]:
    """Errors of the operating system name the file that the user asked for."""
    try:
        yield
    except BrokenPipeError:
        raise  # whoever reads it wants no more
    except OSError as error:
        if str(error).startswith(f"{name}: "):
            raise
        reason = error.strerror or str(error)
        raise AccessError(f"{name}: cannot be written ({reason}); write to a folder that exists and is yours") from None


def _publish(parts: list[Part]) -> None:
    """Give all parts their places, streams first, or none."""
    ordered = sorted(parts, key=lambda part: not part.straight)
    for part in ordered:
        with named(part.name):
            part.settle()
            require_writable(part.name)
            if len(ordered) > 1:
                part.keep_old()
    done: list[Part] = []
    try:
        for part in ordered:
            done.append(part)
            with named(part.name):
                part.publish()
    except BaseException:
        for part in reversed(done):
            if not part.path.exists():  # this one was published
                part.withdraw()
        raise
    for folder in {part.target.parent for part in ordered if not part.straight}:
        with suppress(OSError):  # a file system that cannot do so for a folder does it in its own time
            _settle(folder, os.O_RDONLY)


def free_name(folder: Path) -> Path:
    """A name in a folder that nobody has and that is swept after a kill."""
    return folder / f".accelcal-{locks.MACHINE}{os.urandom(8).hex()}.part"


def _sweep(folder: Path) -> None:
    """Remove parts that a killed process has left, once for each folder."""
    if folder in _swept:
        return
    _swept.add(folder)
    with suppress(OSError):  # a folder that may be written to but not listed
        for name in os.listdir(folder):
            if PART.fullmatch(name) and locks.is_abandoned(folder / name):
                (folder / name).unlink(missing_ok=True)


def _settle(path: Path, flags: int) -> None:
    """See that a file, or the names in a folder, are on the disk."""
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _pour(part: Path, stream: Path) -> None:
    """Write a part to a device or a pipe that somebody reads."""
    if sys.stdout is not None:
        sys.stdout.flush()
    number = _open_stream(stream)
    descriptor = _open(stream) if number is None else os.dup(number)
    with part.open("rb") as content, os.fdopen(descriptor, "wb") as out:
        shutil.copyfileobj(content, out)


def _open(stream: Path) -> int:
    """Open a device or a pipe, without waiting for somebody to read it."""
    try:
        descriptor = os.open(stream, os.O_WRONLY | os.O_APPEND | getattr(os, "O_NONBLOCK", 0))
    except OSError as error:
        if error.errno == errno.ENXIO:
            raise OSError(errno.ENXIO, "nobody reads this pipe") from None
        raise
    if hasattr(os, "O_NONBLOCK"):
        os.set_blocking(descriptor, True)
    return descriptor
