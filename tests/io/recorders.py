"""Recordings of other loggers, each written by the library of its format: channels at a constant rate, with units."""

from __future__ import annotations

import json
import warnings
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

Columns = Mapping[str, np.ndarray]
START = 1_760_000_000_000_000_000
"""When each recording begins, ns since 1970."""


def tdms(path: Path, columns: Columns, units: Mapping[str, str], step: float) -> None:
    """A waveform for each column."""
    from nptdms import ChannelObject, TdmsWriter

    start = np.datetime64(START // 1000, "us")
    with TdmsWriter(path) as file:
        file.write_segment(
            [
                ChannelObject(
                    "run",
                    name,
                    y,
                    {"wf_increment": step, "wf_start_offset": 0.0, "wf_start_time": start}
                    | ({"unit_string": units[name]} if name in units else {}),
                )
                for name, y in columns.items()
            ]
        )


def uff(path: Path, columns: Columns, units: Mapping[str, str], step: float, binary: int = 1) -> None:
    """A time response in a binary data set for each column."""
    import pyuff

    sets = [
        pyuff.prepare_58(
            binary=binary,
            func_type=1,
            rsp_node=k + 1,
            rsp_dir=1,
            ref_dir=1,
            ref_node=1,
            data=np.asarray(y, dtype=np.float64),
            x=np.arange(len(y)) * step,
            id1=name,
            rsp_ent_name=name[:10],
            abscissa_spacing=1,
            abscissa_min=0.0,
            abscissa_inc=step,
            ordinate_spec_data_type=12,
            abscissa_spec_data_type=17,
            orddenom_spec_data_type=0,
            z_axis_spec_data_type=0,
            ordinate_axis_units_lab=units.get(name, "NONE"),
        )
        for k, (name, y) in enumerate(columns.items())
    ]
    path.unlink(missing_ok=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # files that the library leaves open
        pyuff.UFF(str(path)).write_sets(sets, mode="add")  # its other mode cuts off what is not text


def mf4(path: Path, columns: Columns, units: Mapping[str, str], step: float) -> None:
    """A channel group with a master of its own for each column."""
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        for name, y in columns.items():
            file.append([Signal(y, np.arange(len(y)) * step, name=name, unit=units.get(name, ""))])
        file.save(path, overwrite=True)


def mseed(path: Path, columns: Columns, units: Mapping[str, str], step: float) -> None:
    """A source for each column; the format holds no units."""
    from pymseed import DataEncoding, MS3TraceList

    traces = MS3TraceList()
    for name, y in columns.items():
        traces.add_data(f"FDSN:{name}", np.asarray(y, dtype=np.float64), "d", 1.0 / step, starttime=START)
    traces.to_file(path, overwrite=True, encoding=DataEncoding.FLOAT64)


def c3d(path: Path, columns: Columns, units: Mapping[str, str], step: float) -> None:
    """The columns as analog channels, two samples a frame, beside a point that is not seen in every third frame."""
    import c3d as library

    names = list(columns)
    count = min(len(y) for y in columns.values()) // 2
    file = library.Writer(point_rate=0.5 / step, analog_rate=1.0 / step, point_scale=-1.0, point_units="mm")
    values = np.array([np.asarray(y, dtype=np.float32)[: 2 * count] for y in columns.values()]).reshape(-1, count, 2)
    for k in range(count):
        point = np.array([[float(k), 0.0, -1.0, 0.0, 0.0]], dtype=np.float32)
        if k % 3 == 2:
            point[:, 3] = -1.0
        file.add_frames([(point, values[:, k])])
    file.set_point_labels(["mark"])
    file.set_analog_labels(names)
    width = max(4, *(len(text) for text in units.values())) if units else 4
    if units:
        texts = "".join(units.get(name, "").ljust(width) for name in names)
        file.analog_group.add_str("UNITS", "Units", texts, width, len(names))
    with path.open("wb") as handle:
        file.write(handle)


def mcap(path: Path, columns: Columns, units: Mapping[str, str], step: float) -> None:
    """A topic of JSON for each column."""
    from mcap.writer import Writer

    with path.open("wb") as handle:
        file = Writer(handle)
        file.start()
        for name, y in columns.items():
            entry = {"type": "number"} | ({"unit": units[name]} if name in units else {})
            content = json.dumps({"type": "object", "properties": {"value": entry}}).encode()
            channel = file.register_channel(f"/{name}", "json", file.register_schema(name, "jsonschema", content))
            for k, value in enumerate(y):
                stamp = START + round(k * step * 1e9)
                file.add_message(channel, stamp, json.dumps({"value": float(value)}).encode(), stamp)
        file.finish()


def _messages(columns: Columns, step: float, store: Any, ros1: bool) -> list[tuple[str, str, int, Any]]:
    """A topic of accelerations for each column, which is their x; of type, stamp and message."""
    types = store.types
    vector, header, time = (
        types["geometry_msgs/msg/Vector3"],
        types["std_msgs/msg/Header"],
        types["builtin_interfaces/msg/Time"],
    )
    name = "geometry_msgs/msg/AccelStamped"
    results = []
    for topic, y in columns.items():
        for k, value in enumerate(y):
            ns = START + round(k * step * 1e9)
            stamp = time(sec=ns // 1_000_000_000, nanosec=ns % 1_000_000_000)
            head = header(seq=k, stamp=stamp, frame_id="") if ros1 else header(stamp=stamp, frame_id="")
            accel = types["geometry_msgs/msg/Accel"](
                linear=vector(x=float(value), y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0)
            )
            results.append((f"/{topic}", name, ns, types[name](header=head, accel=accel)))
    return results


def bag(path: Path, columns: Columns, units: Mapping[str, str], step: float) -> None:
    """A bag of ROS 1 with a topic for each column; its definitions state the units."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    path.unlink(missing_ok=True)
    with Writer(path) as file:
        declared: dict[str, Any] = {}
        for topic, name, stamp, message in _messages(columns, step, store, True):
            if topic not in declared:
                declared[topic] = file.add_connection(topic, name, typestore=store)
            file.write(declared[topic], stamp, store.serialize_ros1(message, name))


def db3(path: Path, columns: Columns, units: Mapping[str, str], step: float) -> None:
    """A bag of ROS 2, out of its folder."""
    import shutil
    import tempfile

    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "made"
        with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as file:
            declared: dict[str, Any] = {}
            for topic, name, stamp, message in _messages(columns, step, store, False):
                if topic not in declared:
                    declared[topic] = file.add_connection(topic, name, typestore=store)
                file.write(declared[topic], stamp, store.serialize_cdr(message, name))
        shutil.move(str(next(folder.glob("*.db3"))), path)


OPEN = "http://schemas.openxmlformats.org"
OFFICE = f"{OPEN}/officeDocument/2006/relationships"
SHEETS = f"{OPEN}/spreadsheetml/2006/main"
KINDS = "application/vnd.openxmlformats"
WORKBOOK = {
    "[Content_Types].xml": f'<Types xmlns="{OPEN}/package/2006/content-types">'
    f'<Default Extension="rels" ContentType="{KINDS}-package.relationships+xml"/>'
    f'<Default Extension="xml" ContentType="{KINDS}-officedocument.spreadsheetml.sheet.main+xml"/></Types>',
    "_rels/.rels": f'<Relationships xmlns="{OPEN}/package/2006/relationships">'
    f'<Relationship Id="r1" Type="{OFFICE}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
    "xl/workbook.xml": f'<workbook xmlns="{SHEETS}" xmlns:r="{OFFICE}"><sheets>'
    '<sheet name="Messung" sheetId="1" r:id="r1"/></sheets></workbook>',
    "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{OPEN}/package/2006/relationships">'
    f'<Relationship Id="r1" Type="{OFFICE}/worksheet" Target="worksheets/sheet1.xml"/></Relationships>',
}
"""The parts of a workbook but its sheet."""


def workbook(path: Path, rows: Sequence[Sequence[str | float]]) -> Path:
    """A workbook of one sheet with texts and numbers."""
    cells = "".join(
        "<row>"
        + "".join(
            f'<c t="inlineStr"><is><t>{cell}</t></is></c>' if isinstance(cell, str) else f"<c><v>{cell!r}</v></c>"
            for cell in row
        )
        + "</row>"
        for row in rows
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in WORKBOOK.items():
            archive.writestr(name, f'<?xml version="1.0"?>{content}')
        sheet = f'<worksheet xmlns="{SHEETS}"><sheetData>{cells}</sheetData></worksheet>'
        archive.writestr("xl/worksheets/sheet1.xml", f'<?xml version="1.0"?>{sheet}')
    return path


def xlsx(path: Path, columns: Columns, units: Mapping[str, str], step: float) -> None:
    """A sheet with a column of the time, and a row of units."""
    stamps = [k * step for k in range(max(map(len, columns.values())))]
    rows = zip(stamps, *([float(value) for value in y] for y in columns.values()), strict=True)
    workbook(path, [["t_s", *columns], ["s", *(units.get(name, "") for name in columns)], *map(list, rows)])


RECORDERS: dict[str, Callable[[Path, Columns, Mapping[str, str], float], None]] = {
    "tdms": tdms,
    "uff": uff,
    "mf4": mf4,
    "mseed": mseed,
    "c3d": c3d,
    "mcap": mcap,
    "bag": bag,
    "db3": db3,
    "xlsx": xlsx,
}
"""Writers by the ending of their files."""
IN_MESSAGES = {"mcap": "/{}.value", "bag": "/{}.accel.linear.x", "db3": "/{}.accel.linear.x"}
"""How a column is called where it is one number of a message."""
NO_UNITS = {"mseed"}
"""Formats that hold none."""


def named(suffix: str, channel: str) -> str:
    """How a reader calls a column of a format."""
    return IN_MESSAGES.get(suffix, "{}").format(channel)
