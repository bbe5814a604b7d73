"""MCAP: channels and counts of the summary first; messages of ROS 1, ROS 2 and JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from mcap.reader import SeekingReader

from accelcal.io.decoding.source import Leaf, RefusedError, Source, Topic, opened_topics
from accelcal.io.table import MOST_DEPTH

_ROS = {("ros1msg", "ros1"), ("ros2msg", "cdr"), ("ros2idl", "cdr")}
"""Encodings of schema and message that rosbags reads."""
_MOST_RECORD = 256_000_000
"""Bytes of one record."""


def opened(path: str) -> Source:
    """Open a file: each number of the messages of a channel is a column, called ``topic.path``."""
    reader = SeekingReader(Path(path).open("rb"), validate_crcs=True, record_size_limit=_MOST_RECORD)  # noqa: SIM115
    summary = reader.get_summary()
    if summary is None or summary.statistics is None:
        raise RefusedError("it has no summary, as if its logger was cut off; mend it: mcap recover in.mcap -o out.mcap")
    counts = summary.statistics.channel_message_counts
    channels = [channel for number, channel in summary.channels.items() if counts.get(number)]
    return opened_topics(_topics(reader, summary, channels, counts), summary.statistics.message_start_time)


def _topics(reader: SeekingReader, summary: Any, channels: list[Any], counts: Mapping[int, int]) -> Iterator[Topic]:
    """Those that can be read; if there are others alone, they are refused."""
    schemas = {topic_channel.id: summary.schemas.get(topic_channel.schema_id) for topic_channel in channels}
    by_ros = [c for c in channels if (getattr(schemas[c.id], "encoding", ""), c.message_encoding) in _ROS]
    by_json = [topic_channel for topic_channel in channels if topic_channel.message_encoding == "json"]
    if not by_ros and not by_json:
        encodings = ", ".join(sorted({topic_channel.message_encoding for topic_channel in channels})) or "nothing"
        raise RefusedError(
            f"its messages are encoded as {encodings}; expected ROS 1, ROS 2 or JSON; convert the recording"
        )
    if by_ros:
        from accelcal.io.decoding.ros import Messages

        messages = Messages(
            (
                schemas[topic_channel.id].name,
                schemas[topic_channel.id].data.decode(),
                schemas[topic_channel.id].encoding,
            )
            for topic_channel in by_ros
        )
        for channel in by_ros:
            schema = schemas[channel.id]
            decode = messages.decoder(schema.name, schema.encoding)
            leaves, stamp = messages.leaves(schema.name), messages.stamp(schema.name)
            yield Topic(channel.topic, counts[channel.id], leaves, _messages(reader, channel, decode), stamp)
    for channel in by_json:
        read = _messages(reader, channel, json.loads)
        first: Any = next(read(), (0, {}))[1]
        yield Topic(
            channel.topic, counts[channel.id], tuple(_leaves(first, _units(schemas[channel.id], channel), (), 0)), read
        )


def _messages(
    reader: SeekingReader, channel: Any, decode: Callable[[bytes], Any]
) -> Callable[[], Iterator[tuple[int, Any]]]:
    def messages() -> Iterator[tuple[int, Any]]:
        for _, record, message in reader.iter_messages(topics=[channel.topic]):
            if record.id == channel.id:
                yield message.log_time, decode(message.data)

    return messages


def _leaves(message: Any, units: Any, path: tuple[str, ...], depth: int) -> Iterator[Leaf]:
    """The numbers of a JSON object, by the first message of its channel."""
    if depth > MOST_DEPTH:
        raise RefusedError(f"messages lie more than {MOST_DEPTH} deep; expected numbers of a sensor")
    for key, value in message.items() if isinstance(message, Mapping) else ():
        its = units.get(key) if isinstance(units, Mapping) else None
        if isinstance(value, Mapping):
            yield from _leaves(value, its, (*path, key), depth + 1)
        elif isinstance(value, int | float):
            yield Leaf(".".join((*path, key)), its if isinstance(its, str) else None, _taker((*path, key)))


def _taker(path: tuple[str, ...]) -> Callable[[Any], float]:
    """What takes a number out of a message; NaN, not sampled, where it has none."""

    def take(message: Any) -> float:
        for key in path:
            message = message.get(key) if isinstance(message, Mapping) else None
        return float(message) if isinstance(message, int | float) else float("nan")

    return take


def _units(schema: Any, channel: Any) -> dict[str, Any]:
    """Units by name: the key ``unit`` of a property in the JSON schema, else metadata ``unit.NAME`` of the channel."""
    declared = {key.removeprefix("unit."): text for key, text in channel.metadata.items() if key.startswith("unit.")}
    content = json.loads(schema.data) if schema is not None and schema.encoding == "jsonschema" else {}
    return {**declared, **_of_properties(content, 0)}


def _of_properties(schema: Any, depth: int) -> dict[str, Any]:
    properties = schema.get("properties") if isinstance(schema, Mapping) else None
    if not isinstance(properties, Mapping) or depth > MOST_DEPTH:
        return {}
    leaves: dict[str, Any] = {}
    for name, declared in properties.items():
        unit = declared.get("unit") if isinstance(declared, Mapping) else None
        its = unit if isinstance(unit, str) else _of_properties(declared, depth + 1)
        if its:
            leaves[name] = its
    return leaves
