"""Mapping of columns to channels: a proposal from the file, and the sidecar for the user's choice."""

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
    """Channel and unit assigned to one column of a file."""

    column: str
    channel: str
    """time, accel, position, a name chosen by the user, or `NOT_USED`."""
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
    """Current text of the sidecar: the user's, else the file next to the recording, else a commented template."""
    if sidecar is not None:
        return sidecar
    beside = io.sidecar_of(path)
    if beside.exists():
        return beside.read_text(encoding="utf-8-sig")
    return io.template(path)


def choices(path: Path, text: str) -> list[Choice]:
    """Assignment of each column by the sidecar; of a column that it does not mention, by the column's name."""
    declared = _channels(text)
    guessed = _channels(io.template(path))
    found = []
    for column in columns_of(path):
        channel, unit = next(
            ((name, unit) for source in (declared, guessed) for name, (of, unit) in source.items() if of == column),
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
    for i, choice in enumerate(used):
        twin = next((c for c in used[:i] if c.channel == choice.channel), None)
        if twin is not None:
            raise RecordingError(f'columns "{twin.column}" and "{choice.column}" are both {choice.channel}; keep one')
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
    for choice in used:
        old = table.get(choice.channel)
        kept = {k: v for k, v in old.items() if k not in ("column", "unit")} if isinstance(old, dict) else {}
        entry = tomlkit.inline_table()
        entry["column"] = choice.column
        if choice.unit:
            entry["unit"] = choice.unit
        for key, value in kept.items():
            entry[key] = value
        table[choice.channel] = entry
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
