"""A session file that was opened: its content, and where its recordings are found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from accelcal.io.dwell_table import digest_of
from accelcal.serialization.schema.session import Content, Source


@dataclass(frozen=True, slots=True)
class OpenedSession:
    """A session on its way back to work."""

    content: Content
    models: Mapping[int, str]
    """Text of each model file by its key."""
    given: Mapping[str, Path] = field(default_factory=dict)
    """Files that the user has given, by their SHA-256."""
    awaited: Source | None = None
    """The recording that was missing when it was last looked for."""

    def path(self, source: Source) -> Path:
        """Where a recording is looked for."""
        return self.given.get(source.sha256, source.path)

    @property
    def missing(self) -> Source | None:
        """The first recording that is not where it was, or has changed since."""
        sources = [s for s in (self.content.recording, self.content.other) if s is not None]
        return next((s for s in sources if not is_file_of(self.path(s), s)), None)

    def with_file(self, path: Path) -> OpenedSession:
        """The session with a file of the user in place of the one that is missing.

        Raises
        ------
        ValueError
            If it is not the file that the session was made with.
        """
        source = self.missing
        if source is None:
            return self
        if not is_file_of(path, source):
            raise ValueError(
                f"{path.name}: not the recording that this session was made with ({source.path.name}, SHA-256 "
                f"{source.sha256[:12]}…). Give that file, or press Undo and begin anew with this one"
            )
        return replace(self, given={**self.given, source.sha256: path})


def is_file_of(path: Path, source: Source) -> bool:
    """Whether a file is the recording that a session names; files of other machines are not asked for."""
    if not path.is_absolute() or str(path).startswith(("\\\\", "//")):
        return False
    try:
        return path.is_file() and digest_of(path) == source.sha256
    except (OSError, ValueError):
        return False
