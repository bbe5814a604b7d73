"""ROS messages by the definitions that a file brings along, and bags of ROS 1 and ROS 2.

The library makes Python code of these definitions, so nothing but plain names comes near it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from functools import reduce
from pathlib import Path
from typing import Any, Literal, TypeAlias

from rosbags.interfaces import MessageDefinitionFormat, Nodetype
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from accelcal.io.decoding.source import Leaf, RefusedError, Source, Topic, limited, opened_topics
from accelcal.io.table import MOST_DEPTH

Kind = Literal["ros1msg", "ros2msg", "ros2idl"]
_Number: TypeAlias = tuple[tuple[str | int, ...], str | None]
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
_STAMP, _HEADER = "builtin_interfaces/msg/Time", "std_msgs/msg/Header"
_IDL_MARK = "=" * 80 + "\nIDL: "
"""What stands before each of several definitions in one text, with a file name behind it."""
_MOST_ELEMENTS = 64
"""Elements of an array of fixed length whose elements are columns."""
_UNITS = {
    ("sensor_msgs/msg/Imu", "linear_acceleration"): "m/s^2",
    ("sensor_msgs/msg/Imu", "angular_velocity"): "rad/s",
    ("sensor_msgs/msg/Imu", "orientation"): "1",
    ("sensor_msgs/msg/Range", "range"): "m",
    ("sensor_msgs/msg/Temperature", "temperature"): "degC",
    ("sensor_msgs/msg/FluidPressure", "fluid_pressure"): "Pa",
    ("sensor_msgs/msg/MagneticField", "magnetic_field"): "T",
    ("geometry_msgs/msg/Accel", "linear"): "m/s^2",
    ("geometry_msgs/msg/Accel", "angular"): "rad/s^2",
    ("geometry_msgs/msg/Twist", "linear"): "m/s",
    ("geometry_msgs/msg/Twist", "angular"): "rad/s",
    ("geometry_msgs/msg/Pose", "position"): "m",
    ("geometry_msgs/msg/Pose", "orientation"): "1",
    ("geometry_msgs/msg/Transform", "translation"): "m",
    ("geometry_msgs/msg/Transform", "rotation"): "1",
    ("geometry_msgs/msg/PointStamped", "point"): "m",
}
"""Units that the definitions of ROS state in words (REP 103)."""


class Messages:
    """Decodes messages of all types that a file defines."""

    def __init__(self, definitions: Iterable[tuple[str, str, Kind]]) -> None:
        """`definitions`: name of the type, its definition, and in which language; "" = one of ROS itself."""
        types: dict[str, Any] = {}
        for name, text, kind in definitions:
            _require_name(name)
            types.update(_parsed(name, text, kind))
        for name, (_, fields) in types.items():
            for identifier in (name, *(field for field, _ in fields)):
                _require_name(identifier)
        self._store = get_typestore(Stores.EMPTY)
        self._store.register({name: ([], fields) for name, (_, fields) in types.items()})
        self._listed: dict[tuple[str, int], tuple[_Number, ...]] = {}

    def leaves(self, name: str) -> tuple[Leaf, ...]:
        """The numbers of each message of a type."""
        return tuple(
            Leaf(".".join(map(str, path)), unit, _taker(path, float)) for path, unit in self._numbers(_full(name), 0)
        )

    def stamp(self, name: str) -> Callable[[Any], int] | None:
        """What reads the stamp of a message with a header, ns."""
        for field, node in self._store.fielddefs[_full(name)][1]:
            if node == (Nodetype.NAME, _HEADER):
                return _taker((field, "stamp"), lambda stamp: int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec))
        return None

    def decoder(self, name: str, kind: Kind) -> Callable[[bytes], Any]:
        """What reads the bytes of a message of a type."""
        read = self._store.deserialize_ros1 if kind == "ros1msg" else self._store.deserialize_cdr
        return lambda data: read(data, _full(name))

    def _numbers(self, name: str, depth: int) -> tuple[_Number, ...]:
        """Path and unit of each number; listed once for a type and depth, since a few types may nest into endless ones.

        The unit is that of the innermost field that has one.
        """
        if depth > MOST_DEPTH:
            raise RefusedError(f"messages lie more than {MOST_DEPTH} deep; expected numbers of a sensor")
        if (name, depth) not in self._listed:
            self._listed[name, depth] = limited(
                ((field, *path), unit or _UNITS.get((name, field)))
                for field, node in self._store.fielddefs[name][1]
                for path, unit in self._inside(field, node, depth)
            )
        return self._listed[name, depth]

    def _inside(self, field: str, of: Any, depth: int) -> Iterable[_Number]:
        kind, node = of
        if kind == Nodetype.BASE and "string" not in node[0]:
            return [((), None)]
        if kind == Nodetype.NAME and node not in (_HEADER, _STAMP):
            return self._numbers(str(node), depth + 1)
        return [((k,), None) for k in range(int(node[1]))] if kind == Nodetype.ARRAY and _is_short(field, node) else []


def _parsed(name: str, text: str, kind: Kind) -> dict[str, Any]:
    """Types by name, each as constants and fields."""
    if not text:
        fields = get_typestore(Stores.LATEST).fielddefs
        if _full(name) not in fields:
            raise RefusedError(f"messages of type {name} are not defined in the file; record them with MCAP")
        return dict(fields)
    if kind == "ros2idl":
        parts = [part.partition("\n")[2] for part in text.split(_IDL_MARK)[1:]] or [text]
        return {k: v for part in parts for k, v in get_types_from_idl(part).items()}
    return dict(get_types_from_msg(text, name))


def _require_name(name: str) -> None:
    if not _NAME.fullmatch(name):
        raise RefusedError(f"a message definition holds the name {name[:40]!r}; expected letters, digits, _ and /")


def _full(name: str) -> str:
    """``sensor_msgs/Imu`` as ``sensor_msgs/msg/Imu``."""
    package, *rest = name.split("/")
    return name if len(rest) != 1 else f"{package}/msg/{rest[0]}"


def _is_short(field: str, node: Any) -> bool:
    """Whether the elements of an array are columns: those of a covariance are not."""
    (kind, what), length = node
    return kind == Nodetype.BASE and "string" not in what[0] and length <= _MOST_ELEMENTS and "covariance" not in field


def _taker(path: tuple[str | int, ...], convert: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """What takes one value out of a message."""
    return lambda message: convert(reduce(_step, path, message))


def _step(value: Any, key: str | int) -> Any:
    return value[key] if isinstance(key, int) else getattr(value, key)


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
