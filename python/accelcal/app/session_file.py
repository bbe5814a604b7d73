"""The session file: a zip of `session.json` and model files that holds the work of a workbench, and no recorded data.

Recordings are named by path and SHA-256. What is read is believed in nothing: names, counts, sizes and types of a file
are checked before its content is used. The last files are kept in a folder of the user, written after every change.
"""

from __future__ import annotations

import contextlib
import os
import re
import sys
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path

from pydantic import ValidationError

from accelcal import _core, io
from accelcal._support.errors import AccelcalError
from accelcal.app import mapping
from accelcal.app.state import (
    MOST_GUESTS,
    MOST_MODELS,
    SCHEMA,
    Content,
    Formula,
    SessionEffects,
    Source,
    State,
    StoredRun,
    StoredStep,
)
from accelcal.results import model_file

SUFFIX = ".accelcal"
CONTENT = "session.json"
MOST_MEMBER = 8_000_000
"""Largest part of a session file, unpacked, bytes."""
MOST_FILE = 64_000_000
"""Largest session file, packed, and all its parts together, bytes."""


class SessionError(AccelcalError):
    """A file that is no session file. The text names it, what was found and what was expected."""


def dumps(state: State, *, when: datetime | None = None) -> bytes:
    """Return the work on recordings as a session file; a file whose columns are not understood yet is not in it.

    Raises
    ------
    SessionError
        If no recording is loaded.
    """
    if state.recording is None:
        raise SessionError("load a recording first; a session without one is empty")
    stored = [run for run in state.runs if run.source is not None]
    content = Content(
        schema=SCHEMA,
        version=_core.__version__,
        saved=(when or datetime.now(UTC)).isoformat(timespec="seconds"),
        runs=[
            StoredRun(
                source=Source(file=str(run.file), sha256=run.digest),
                sidecar=mapping.text_of(run.file, run.sidecar, "") or None,
                role=run.role,
                held_out=run.held_out,
                excluded=list(run.excluded),
            )
            for run in stored
        ],
        shown=next((at for at, run in enumerate(stored) if run is state.run), 0),
        own=[Formula.of(entry) for entry in state.own],
        steps=[
            StoredStep(
                key=step.key,
                parent=step.parent,
                kind=step.change.kind,
                name=step.change.name,
                value=step.change.value,
            )
            for step in state.steps
        ],
        current=state.current,
        guests=[guest.name for guest in state.guests],
    )
    packed = BytesIO()
    with SessionEffects.to(state).catalogue(), zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        # older versions read a session without guests
        archive.writestr(
            CONTENT, content.model_dump_json(by_alias=True, indent=2, exclude=None if content.guests else {"guests"})
        )
        for step in state.steps:
            archive.writestr(f"models/{step.key}.json", model_file.dumps(model_file.to_dict(step.fit)))
        for number, guest in enumerate(state.guests, start=1):
            archive.writestr(f"guests/{number}.json", model_file.dumps(model_file.to_dict(guest.fit)))
    return packed.getvalue()


def read(path: Path) -> tuple[Content, dict[int, str], tuple[str, ...]]:
    """Read a session file: its content, the text of each model file by its key, and those of models from elsewhere.

    Raises
    ------
    SessionError
        If it is not whole, not a session file of a version that is understood, or larger than one can be.
    """
    with _reading(path):
        texts = _texts(path)
        content = Content.model_validate_json(texts.pop(CONTENT))
        models = {step.key: texts.pop(f"models/{step.key}.json") for step in content.steps}
        guests = tuple(texts.pop(f"guests/{number}.json") for number in range(1, len(content.guests) + 1))
    if texts:
        raise SessionError(f"{path.name}: holds {len(texts)} parts that belong to no model; take a copy that is whole")
    return content, models, guests


def peek(path: Path) -> Content:
    """Read what a session file says of itself, without its models; errors as `read`."""
    with _reading(path):
        return Content.model_validate_json(_texts(path, (CONTENT,))[CONTENT])


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Whatever is wrong with a session file becomes one sentence."""
    try:
        yield
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = _plain(".".join(str(part) for part in first["loc"]) or CONTENT)
        raise SessionError(
            f"{path.name}: {CONTENT}: {place}: {_plain(first['msg'])}; expected the schema {SCHEMA} as this version "
            "writes it. Take a copy that is whole, or begin anew with the recording"
        ) from None
    except KeyError as error:
        raise SessionError(f"{path.name}: {error.args[0]} is missing in it; take a copy that is whole") from None
    except SessionError:
        raise
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError, OSError) as error:
        what = _plain(getattr(error, "strerror", None) or str(error) or type(error).__name__)
        raise SessionError(
            f"{path.name}: cannot be read as a session file ({what}); take a copy that is whole"
        ) from None


def _texts(path: Path, wanted: Sequence[str] | None = None) -> dict[str, str]:
    """Parts of the archive as text; sizes are counted while it is unpacked, whatever the archive declares."""
    if path.stat().st_size > MOST_FILE:
        raise SessionError(f"{path.name}: larger than {MOST_FILE / 1e6:.0f} MB, more than a session file can be")
    texts: dict[str, str] = {}
    total = 0
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        if len(members) > MOST_MODELS + MOST_GUESTS + 1 or len({m.filename for m in members}) < len(members):
            raise SessionError(f"{path.name}: has {len(members)} parts, more than a session can have, or some twice")
        for member in members:
            if wanted is not None and member.filename not in wanted:
                continue
            with archive.open(member) as part:
                raw = part.read(MOST_MEMBER + 1)
            total += len(raw)
            if len(raw) > MOST_MEMBER or total > MOST_FILE:
                raise SessionError(f"{path.name}: unpacks to more than a session file can hold; it was not read on")
            texts[member.filename] = raw.decode("utf-8")
    return texts


def _plain(text: str) -> str:
    """What an error says, on one line without control characters."""
    return "".join(c for c in text if c.isprintable())[:200]


MOST = 10
"""Sessions that are kept; the oldest is removed first."""
NAME = re.compile(r"[A-Za-z0-9_-]{16}")
"""Of a session: what the server draws, 12 bytes in base64."""


@dataclass(frozen=True, slots=True)
class KeptSession:
    """One session file of the folder."""

    name: str
    title: str
    saved: str
    """When, UTC."""


def state_folder() -> Path:
    """Folder of the user for kept work: ``ACCELCAL_STATE``, else the one that the system has for such files."""
    asked = os.environ.get("ACCELCAL_STATE")
    if asked:
        return Path(asked).expanduser()
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or "~/AppData/Local"
    else:
        base = os.environ.get("XDG_STATE_HOME") or "~/.local/state"
    return Path(base).expanduser() / "accelcal" / "sessions"


class Keeper:
    """Writes session files behind the page, one after the other, and lists them.

    Parameters
    ----------
    folder : made when something is kept for the first time, for the user alone.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.problem = ""
        """Why the last session could not be kept; empty after a success."""
        self._writing = ThreadPoolExecutor(1, "keeping")

    def keep(self, name: str, state: State) -> Future[None]:
        """Write the work of a session as it is now."""
        return self._writing.submit(self._write, name, state)

    def path(self, name: str) -> Path | None:
        """The file of a kept session; None where there is none."""
        if not NAME.fullmatch(name):
            return None
        path = self._path(name)
        return path if path.is_file() and not path.is_symlink() else None

    def listed(self) -> list[KeptSession]:
        """Sessions that can be read, newest first."""
        sessions = []
        for path in self._newest():
            with contextlib.suppress(SessionError):
                content = peek(path)
                sessions.append(KeptSession(path.stem, content.title, content.saved[:16].replace("T", " ")))
        return sessions

    def remove(self, name: str) -> None:
        """Delete a kept session."""
        path = self.path(name)
        if path is not None:
            path.unlink(missing_ok=True)

    def close(self) -> None:
        """Wait until everything is written."""
        self._writing.shutdown(wait=True)

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}{SUFFIX}"

    def _write(self, name: str, state: State) -> None:
        if state.recording is None:
            return
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            io.atomic_write(self._path(name), dumps(state))
            self._path(name).chmod(0o600)
            for old in self._newest()[MOST:]:
                old.unlink(missing_ok=True)
            self.problem = ""
        except (OSError, ValueError) as error:
            self.problem = f"This work is not kept for a later day: {error}"

    def _newest(self) -> list[Path]:
        with contextlib.suppress(OSError):
            files = [p for p in self.folder.glob(f"*{SUFFIX}") if NAME.fullmatch(p.stem) and p.is_file()]
            return sorted(files, key=lambda p: p.stat().st_mtime, reverse=True)
        return []
