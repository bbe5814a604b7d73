"""Channels whose file itself says when they were sampled: their stamps become columns beside them."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from accelcal.io.decoding.source import Entry, Source, limited, numbers
from accelcal.io.limits import MOST_NAME

COMMON = "t"
"""The column of stamps where a file has one clock."""


@dataclass(frozen=True, slots=True)
class Clock:
    """The instants of one channel, or of several."""

    key: Hashable
    """What two channels on one clock have in common."""
    read: Callable[[], Any]
    """Gives the stamps, s, (n,)."""
    name: str = ""
    """Of the column of stamps; "" for the name of the first channel with "_t", or `COMMON` where it is the only one."""


@dataclass(frozen=True, slots=True)
class Sampled:
    """One channel, before its numbers are read."""

    name: str
    length: int
    unit: str | None
    read: Callable[[], Any]
    """Gives the values, (n,)."""
    clock: Clock | None = None
    """None = the file does not say when it was sampled."""


def uniform(start: float, step: float, length: int) -> Clock:
    """A clock that ticks at a constant rate, s."""
    return Clock((start, step, length), lambda: start + step * np.arange(length))


def opened_channels(channels: Iterable[Sampled]) -> Source:
    """A container of channels; each clock is a column in seconds in front of the first channel that it serves."""
    listed = list(channels)
    alone = len({each.clock.key for each in listed if each.clock is not None}) == 1
    entries: list[Entry] = []
    readers: dict[str, Callable[[], Any]] = {}
    clocks: dict[Hashable, str] = {}

    def enter(name: str, length: int, unit: str | None, read: Callable[[], Any], clock: str | None) -> str:
        name, count = plain(name), 2
        while name in readers:
            name, count = f"{plain(name.removesuffix(f' #{count - 1}'))} #{count}", count + 1
        readers[name] = read
        entries.append(Entry(name, length, plain(unit) or None if unit else None, clock))
        return name

    for each in listed:
        if each.clock is not None and each.clock.key not in clocks:
            name = COMMON if alone else each.clock.name or f"{each.name}_t"
            clocks[each.clock.key] = enter(name, each.length, "s", each.clock.read, None)
        enter(each.name, each.length, each.unit, each.read, clocks[each.clock.key] if each.clock else None)
        limited(entries)

    return Source(limited(entries), lambda name: numbers(np.asarray(readers[name]())))


def plain(text: str) -> str:
    """A name or unit of a file without spaces and zero bytes around it, cut where it is long."""
    return text.strip(" \t\r\n\x00")[:MOST_NAME]


def seconds_since(nanoseconds: Any, zero: int) -> Any:
    """Whole nanoseconds as seconds from an instant, to the last bit that a double has."""
    return (np.asarray(nanoseconds, dtype=np.int64) - zero) * 1e-9
