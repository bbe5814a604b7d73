"""How accelcal knows a recording that it wrote: by a mark in the sidecar, which fits until one of both changes."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from accelcal.data.recording import RecordingError
from accelcal.io.dwell_table import digest_of
from accelcal.io.files import content_of
from accelcal.io.limits import SIDECAR_BYTES
from accelcal.io.sidecar import sidecar_of

_MARK = re.compile(r"# accelcal (\S+) wrote this file and its recording: ([0-9a-f]{64})\n")


def marked(declared: str, command: str, recording: str) -> str:
    """Text of a sidecar with the mark of the command that wrote it.

    Parameters
    ----------
    declared : text of the sidecar.
    recording : SHA-256 of the recording beside it, hex.
    """
    return f"# accelcal {command} wrote this file and its recording: {_digest(declared, recording)}\n{declared}"


def writer_of(recording: Path) -> str:
    """The command that wrote a recording and its sidecar, both as they are now; "" for all others."""
    try:
        text = content_of(sidecar_of(recording), "a sidecar", SIDECAR_BYTES).decode()
        mark = _MARK.match(text)
        if mark is not None and mark[2] == _digest(text[mark.end() :], digest_of(recording)):
            return mark[1]
    except (OSError, RecordingError, UnicodeDecodeError):
        pass  # not there, or nothing that accelcal writes
    return ""


def _digest(declared: str, recording: str) -> str:
    return hashlib.sha256(f"{recording}\n{declared}".encode()).hexdigest()
