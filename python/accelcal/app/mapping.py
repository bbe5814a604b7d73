"""Which column is which channel: a proposal from the file, and the sidecar that a user's choice amounts to."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tomlkit

from accelcal import io
from accelcal.data.recording import RecordingError
from accelcal.io.formats import open_table

NOT_USED = "not used"
ESSENTIAL = ("time", "accel", "position")
UNKNOWN = "?"


@dataclass(frozen=True, slots=True)
class Choice:
    """What one column of a file is taken for."""

    column: str
    channel: str
    """time, accel, position, a name of the user's, or `NOT_USED`."""
    unit: str
    """Empty where none is known."""


def columns_of(path: Path) -> tuple[str, ...]:
    """Names of the columns of a recording.

    Raises
    ------
    RecordingError
        If the file cannot be read as a table.
    """
    return open_table(path).columns


def text_of(path: Path, sidecar: str | None) -> str:
    """The sidecar as it stands: the user's text, else the file beside the recording, else a commented first one."""
    if sidecar is not None:
        return sidecar
    beside = io.sidecar_of(path)
    if beside.exists():
        return beside.read_text(encoding="utf-8-sig")
    return io.template(path)


def choices(path: Path, text: str) -> list[Choice]:
    """What each column is taken for, as a sidecar says; what it does not mention, as the file's own names say."""
    declared = _channels(text)
    guessed = _channels(io.template(path))
    found = []
    for column in columns_of(path):
        channel, unit = next(
            ((name, one) for source in (declared, guessed) for name, (of, one) in source.items() if of == column),
            (NOT_USED, ""),
        )
        found.append(Choice(column, channel, "" if unit == UNKNOWN else unit))
    return found


def sidecar_from(text: str, chosen: Sequence[Choice]) -> str:
    """The sidecar with its columns as chosen; everything else in it stays, comments included.

    Raises
    ------
    RecordingError
        If two columns are the same channel, or the text is no TOML.
    """
    used = [c for c in chosen if c.channel != NOT_USED]
    for i, one in enumerate(used):
        twin = next((c for c in used[:i] if c.channel == one.channel), None)
        if twin is not None:
            raise RecordingError(f'columns "{twin.column}" and "{one.column}" are both {one.channel}; keep one')
    try:
        document = tomlkit.parse(text)
    except tomlkit.exceptions.ParseError as error:
        raise RecordingError(f"the sidecar is not valid TOML: {error}; correct that line") from None
    table = document.setdefault("channels", tomlkit.table())
    names = {c.channel for c in used}
    for name in [n for n in table if n not in names and n != "rate"]:
        del table[name]
    if "time" in names and "rate" in table:
        del table["rate"]
    for one in used:
        old = table.get(one.channel)
        kept = {k: v for k, v in old.items() if k not in ("column", "unit")} if isinstance(old, dict) else {}
        entry = tomlkit.inline_table()
        entry["column"] = one.column
        if one.unit:
            entry["unit"] = one.unit
        for key, value in kept.items():
            entry[key] = value
        table[one.channel] = entry
    return tomlkit.dumps(document)


def _channels(text: str) -> dict[str, tuple[str, str]]:
    """Column and unit by channel; empty where the text is no TOML."""
    try:
        table = tomllib.loads(text).get("channels", {})
    except tomllib.TOMLDecodeError:
        return {}
    return {
        name: (source["column"], str(source.get("unit", "")))
        for name, source in table.items()
        if isinstance(source, dict) and isinstance(source.get("column"), str)
    }
