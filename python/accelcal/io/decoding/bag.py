"""Bags of ROS 1 (.bag) and ROS 2 (.db3): connections and counts first, then the messages of one topic."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from accelcal.io.decoding.ros import Kind, Messages
from accelcal.io.decoding.source import Source, Topic, opened_topics

_MARK = b"#ROSBAG"


def opened(path: str) -> Source:
    """Open a bag: each number of the messages of a topic is a column, called ``topic.path``."""
    with Path(path).open("rb") as file:
        first = file.read(len(_MARK)) == _MARK
    reader: Any = Reader1(Path(path)) if first else Reader2(Path(path))
    reader.open()
    return opened_topics(_topics(reader, "ros1msg" if first else "ros2msg"), int(reader.start_time))


def _topics(reader: Any, kind: Kind) -> Iterator[Topic]:
    messages = Messages((c.msgtype, *_definition(c, kind)) for c in reader.connections)
    kinds = dict.fromkeys((c.topic, c.msgtype) for c in reader.connections)
    for topic, type_name in kinds:
        of_topic = [c for c in reader.connections if (c.topic, c.msgtype) == (topic, type_name)]
        count = sum(int(c.msgcount) for c in of_topic)
        decode = messages.decoder(type_name, kind)

        def read(connections: Any = of_topic, decode: Any = decode) -> Iterator[tuple[int, Any]]:
            for _, logged, data in reader.messages(connections=connections):
                yield int(logged), decode(data)

        yield Topic(topic, count, messages.leaves(type_name), read, messages.stamp(type_name))


def _definition(connection: Any, kind: Kind) -> tuple[str, Kind]:
    """The definition of a type and its language; "" where the bag, of an older ROS 2, brings none along."""
    definition = connection.msgdef
    if definition.format == MessageDefinitionFormat.NONE:
        return "", kind
    return str(definition.data), "ros2idl" if definition.format == MessageDefinitionFormat.IDL else kind
