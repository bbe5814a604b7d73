"""Messages of topics as columns: the numbers of each message by path, its stamps beside them."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from accelcal.io.decoding.sampled import Clock, Sampled, opened_channels, seconds_since
from accelcal.io.decoding.source import Source

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
    return opened_channels(each for topic in topics for each in _sampled(topic, zero))


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
