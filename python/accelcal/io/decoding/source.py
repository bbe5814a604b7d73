"""What a reader of one container format offers: columns by name, channels with their clocks, messages of topics."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, TypeVar

import numpy as np

from accelcal.io.table import MOST_COLUMNS, MOST_DEPTH, MOST_NAME, Column, from_dates

Listed = TypeVar("Listed")

LEAST_LONGER, MOST_BESIDE = 4, 64
"""A matrix is channels beside each other where it has so many samples for each at the least, and at most so many
channels: a picture or a spectrogram has more."""


class RefusedError(Exception):
    """A file that is whole and yet not read; the text says what was found, what was expected and the next step."""


def require_no_objects(names: list[str]) -> None:
    """Refuse a MATLAB file whose numbers are inside of objects.

    Raises
    ------
    RefusedError
        With the line of MATLAB that writes them as a table of text.
    """
    if names:
        raise RefusedError(
            f"{', '.join(names[:3])} in this file is an object of MATLAB, such as a table or timetable, whose layout "
            f'MATLAB alone knows; write it there as CSV: writetimetable({names[0]}, "run.csv") for a timetable, '
            f'writetable({names[0]}, "run.csv") for a table'
        )


@dataclass(frozen=True, slots=True)
class Entry:
    """One column, before its numbers are read."""

    name: str
    length: int
    """Samples."""
    unit: str | None = None
    """As the file declares it."""
    clock: str | None = None
    """The column with its stamps, where the file itself says which."""


@dataclass(frozen=True, slots=True)
class Source:
    """An open container."""

    entries: tuple[Entry, ...]
    column: Callable[[str], Column]
    """Reads one column by its name."""


def limited(entries: Iterable[Listed]) -> tuple[Listed, ...]:
    """The columns of a file, unless there are too many of them; counted while they are made."""
    listed: list[Listed] = []
    for entry in entries:
        listed.append(entry)
        if len(listed) > MOST_COLUMNS:
            raise RefusedError(
                f"it holds more than {MOST_COLUMNS} columns; expected a few, one per channel; export those that are "
                "needed to a file of their own"
            )
    return tuple(listed)


def is_vector(shape: tuple[int, ...], kind: str) -> bool:
    """Whether an array is a vector of real numbers, dates or time deltas: of one axis at most longer than 1."""
    size = 1
    for length in shape:
        size *= length
    return kind in "fiubmM" and size == max(shape, default=0)


@dataclass(frozen=True, slots=True)
class Part:
    """One column of an array."""

    name: str
    length: int
    pick: Callable[[Any], Any]
    """Takes it from the array."""


def parts(name: str, shape: tuple[int, ...], dtype: Any, index: str) -> Iterator[Part]:
    """Columns of an array: a vector; those of a matrix, along its longer axis; numeric fields of records."""
    sides = sorted(length for length in shape if length != 1)
    length = max(shape, default=0)
    if is_vector(shape, dtype.kind):
        yield Part(name, length, np.ravel)
    elif dtype.names and len(sides) <= 1:
        for key in dtype.names:
            if dtype[key].kind in "fiub" and not dtype[key].shape:
                yield Part(f"{name}.{key}" if name else key, length, partial(_field, key))
    elif dtype.kind in "fiub" and len(sides) == 2 and LEAST_LONGER * sides[0] <= sides[1] and sides[0] <= MOST_BESIDE:
        for k in range(sides[0]):
            yield Part(name + index.format(k, k + 1), length, partial(_column, k))


def _field(key: str, records: Any) -> Any:
    return records[key].ravel()


def _column(k: int, matrix: Any) -> Any:
    squeezed = np.squeeze(matrix)
    return squeezed[:, k] if squeezed.shape[0] > squeezed.shape[1] else squeezed[k]


@dataclass(frozen=True, slots=True)
class Stored:
    """One array in a file, before its numbers are read."""

    name: str
    shape: tuple[int, ...]
    dtype: Any
    unit: str | None = None
    """As the file declares it."""


def opened_arrays(arrays: Iterable[Stored], read: Callable[[str], Any], index: str = "[{0}]") -> Source:
    """The columns of some arrays; `read` gives the numbers of an array by its name."""
    columns: dict[str, tuple[str, Part]] = {}

    def entries() -> Iterator[Entry]:
        for stored in arrays:
            for part in parts(stored.name, stored.shape, stored.dtype, index):
                if part.name not in columns:  # a ZIP may hold a name twice
                    columns[part.name] = (stored.name, part)
                    seconds = "s" if stored.dtype.kind in "mM" else None
                    yield Entry(part.name, int(part.length), stored.unit or seconds)

    def column(name: str) -> Column:
        array_name, part = columns[name]
        return numbers(part.pick(read(array_name)))

    return Source(limited(entries()), column)


def arrays_inside(content: Mapping[str, Any], prefix: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, array) of each array inside nested mappings and lists."""
    if depth > MOST_DEPTH:
        raise RefusedError(f"structures lie more than {MOST_DEPTH} deep; expected vectors, one per channel")
    for name, value in content.items():
        path = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from arrays_inside(value, f"{path}.", depth + 1)
        elif isinstance(value, list):
            yield from arrays_inside({str(k): item for k, item in enumerate(value, start=1)}, f"{path}.", depth + 1)
        elif isinstance(value, np.ndarray):
            yield path, value


def numbers(values: Any) -> Column:
    """A vector as a column; NaN means not sampled, dates become seconds from the first.

    Raises
    ------
    RefusedError
        If it is no vector of real numbers.
    """
    if not isinstance(values, np.ndarray) or not is_vector(values.shape, values.dtype.kind):
        raise RefusedError("is no vector of real numbers; export it as one")
    if values.dtype.kind in "mM":
        return from_dates(values.ravel())
    vector = np.ascontiguousarray(values.ravel(), dtype=np.float64)
    missing = np.isnan(vector)
    return Column(vector, ~missing if missing.any() else None)


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
    alone = len({part.clock.key for part in listed if part.clock is not None}) == 1
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

    for channel in listed:
        if channel.clock is not None and channel.clock.key not in clocks:
            name = COMMON if alone else channel.clock.name or f"{channel.name}_t"
            clocks[channel.clock.key] = enter(name, channel.length, "s", channel.clock.read, None)
        enter(
            channel.name,
            channel.length,
            channel.unit,
            channel.read,
            clocks[channel.clock.key] if channel.clock else None,
        )
        limited(entries)

    return Source(limited(entries), lambda name: numbers(np.asarray(readers[name]())))


def plain(text: str) -> str:
    """A name or unit of a file without spaces and zero bytes around it, cut where it is long."""
    return text.strip(" \t\r\n\x00")[:MOST_NAME]


def seconds_since(nanoseconds: Any, zero: int) -> Any:
    """Whole nanoseconds as seconds from an instant, to the last bit that a double has."""
    return (np.asarray(nanoseconds, dtype=np.int64) - zero) * 1e-9


_SINCE_1970 = 10**18
"""Nanoseconds from which a stamp is a date (9 September 2001), and not the age of a sensor."""


@dataclass(frozen=True, slots=True)
class Leaf:
    """One number of every message of a topic."""

    name: str
    """``linear_acceleration.x``"""
    unit: str | None
    take: Callable[[Any], float]


@dataclass(frozen=True, slots=True)
class Topic:
    """All messages of one name."""

    name: str
    count: int
    leaves: tuple[Leaf, ...]
    messages: Callable[[], Iterator[tuple[int, Any]]]
    """When each was logged, ns, and what it says."""
    stamp: Callable[[Any], int] | None = None
    """When a message says that it was measured, ns; None = it does not say."""


def opened_topics(topics: Iterable[Topic], zero: int) -> Source:
    """A container of topics, each number called ``topic.path``.

    Its stamps, ``topic.t``, are those of the messages themselves, else those of the logger; with both, the latter are
    ``topic.log_t``. Dates count from `zero`, ns.
    """
    return opened_channels(sampled for topic in topics for sampled in _sampled(topic, zero))


def _sampled(topic: Topic, zero: int) -> Iterator[Sampled]:
    @cache
    def read() -> _Read:
        return _Read(topic)

    def logged() -> Any:
        return seconds_since(read().logged, zero)

    def stamped() -> Any:
        stamps = read().stamps
        return seconds_since(stamps, zero if stamps and stamps[0] >= _SINCE_1970 else 0)

    clock = Clock(topic.name, logged if topic.stamp is None else stamped, f"{topic.name}.t")
    for number, leaf in enumerate(topic.leaves):
        name = f"{topic.name}.{leaf.name}"
        yield Sampled(name, topic.count, leaf.unit, lambda k=number: read().values[k], clock)  # type: ignore[misc]
    if topic.stamp is not None:
        yield Sampled(f"{topic.name}.log_t", topic.count, "s", logged)


class _Read:
    """The numbers of a topic."""

    def __init__(self, topic: Topic) -> None:
        self.logged, self.stamps = array("q"), array("q")
        self.values = [array("d") for _ in topic.leaves]
        for logged, message in topic.messages():
            self.logged.append(logged)
            if topic.stamp is not None:
                self.stamps.append(topic.stamp(message))
            for values, leaf in zip(self.values, topic.leaves, strict=True):
                values.append(leaf.take(message))
