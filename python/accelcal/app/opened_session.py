"""A session file that was opened: its content, and where its recordings are found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from accelcal._support.errors import AccelcalError
from accelcal.app.session_content import Content, Source
from accelcal.io.dwell_table import digest_of


@dataclass(frozen=True, slots=True)
class OpenedSession:
    """A session on its way back to work."""

    content: Content
    models: Mapping[int, str]
    """Text of each model file by its key."""
    guests: tuple[str, ...] = ()
    """Text of the model file of each model from elsewhere."""
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
        sources = [run.source for run in self.content.runs]
        return next((s for s in sources if digest_at(self.path(s)) != s.sha256), None)

    def with_files(self, paths: Sequence[Path]) -> OpenedSession:
        """The session with files of the user in place of those that are missing.

        Raises
        ------
        ValueError
            If one is not a file that the session was made with.
        """
        given = dict(self.given)
        for path in paths:
            digest = digest_at(path)
            source = next((run.source for run in self.content.runs if run.source.sha256 == digest), None)
            if source is None:
                asked = self.missing or self.content.runs[0].source
                raise AccelcalError(
                    f"{path.name}: not the recording that this session was made with ({asked.path.name}, SHA-256 "
                    f"{asked.sha256[:12]}…). Give that file, or press Undo and begin anew with this one"
                )
            given[source.sha256] = path
        return replace(self, given=given)


def digest_at(path: Path) -> str:
    """SHA-256 of a file, hex; empty where there is none to read. Files of other machines are not asked for."""
    if not path.is_absolute() or str(path).startswith(("\\\\", "//")):
        return ""
    try:
        return digest_of(path) if path.is_file() else ""
    except (OSError, ValueError):
        return ""
