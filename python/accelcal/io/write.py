"""Recordings and rigs to files, each whole or not at all."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from accelcal.data import units
from accelcal.data.arrays import Array, Flags
from accelcal.data.channel_filter import ChannelFilter, high_passes, low_passes
from accelcal.data.dwells import DwellSetup
from accelcal.data.orientation import GRAVITY
from accelcal.data.recording import Channel, Recording, RecordingError
from accelcal.data.references import reference_among
from accelcal.data.rig import Rig
from accelcal.data.run_labels import NO_LABELS, RunLabels
from accelcal.io import arrow, naming, sidecar
from accelcal.io.atomic import atomic, atomic_write
from accelcal.io.sidecar import Clock, Source


def write_csv(recording: Recording, path: str | Path) -> dict[str, Clock | Source]:
    """Write a recording as CSV, units in the column names; a channel not sampled at an instant leaves its cell empty.

    Parameters
    ----------
    recording : channels of shape (n,) each on its own clock; the rows are the union of their stamps.
    path : the file to write; replaced if it exists.

    Returns
    -------
    By channel, the column it was written to: what `write_sidecar` wants to know.

    Raises
    ------
    RecordingError
        If a channel has a name that would be read back as something else.
    """
    import pyarrow as pa
    from pyarrow import csv

    columns = {channel.name: naming.column_name(channel.name, channel.unit) for channel in _channels(recording)}
    _require_readable(recording, columns)
    table = pa.table({"t_s": _stamps(recording)} | {columns[name]: cells for name, cells in _cells(recording)})
    with atomic(path) as part:
        csv.write_csv(table, part, csv.WriteOptions(quoting_style="needed"))
    return _sources(recording, "t_s", columns)


def write_parquet(recording: Recording, path: str | Path) -> dict[str, Clock | Source]:
    """Write a recording as Parquet, units in the metadata of the columns; null where a channel was not sampled.

    Parameters, return value and errors are those of `write_csv`.
    """
    import pyarrow as pa
    from pyarrow import parquet

    columns = {channel.name: channel.name for channel in _channels(recording)}
    _require_readable(recording, columns)
    units = {"t": "s"} | {channel.name: channel.unit for channel in _channels(recording)}
    schema = pa.schema([pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in units.items()])
    table = pa.table({"t": _stamps(recording)} | dict(_cells(recording)), schema=schema)
    with atomic(path) as part:
        parquet.write_table(table, part, compression="zstd", write_page_checksum=True)
    return _sources(recording, "t", columns)


def write_sidecar(
    rig: Rig,
    channels: Mapping[str, Clock | Source],
    path: str | Path,
    dwell: DwellSetup | None = None,
    labels: RunLabels = NO_LABELS,
    mark: Callable[[str], str] = str,
) -> None:
    """Write what is declared of a rig and of the columns of its file; reading it gives the same rig.

    Parameters
    ----------
    rig : what it merely assumes is not written.
    channels : by channel name, time included, its column.
    path : the sidecar to write; replaced if it exists.
    dwell : what it says of a table of dwells.
    labels : when, how mounted and by whom the run was made.
    mark : gives the text that is written from that which declares all this.
    """
    reference = reference_among(channels) or "position"
    tables = {
        "sensor": _sensor(rig),
        "rig": _rig(rig, turning=GRAVITY in channels),
        "clock": _clock(rig),
        "channels": {name: _inline(_channel(rig, name, source, reference)) for name, source in channels.items()},
        "uncertainty": _uncertainty(rig),
        "run": _labels(labels),
        "dwell": {} if dwell is None else _dwell(dwell),
        "judge": _declared({"tolerance": _amount(rig.tolerance, "m/s^2", "mg")}),
    }
    text = "\n".join(
        f"[{name}]\n" + "".join(f"{toml_key(key)} = {value}\n" for key, value in entries.items())
        for name, entries in tables.items()
        if entries
    )
    atomic_write(path, mark(text))


def _labels(labels: RunLabels) -> dict[str, str]:
    texts = {key: toml_text(text) for key in ("mounting", "operator") if (text := getattr(labels, key))}
    at = None if labels.date is None else datetime.fromtimestamp(labels.date * 86400.0, UTC)
    return texts if at is None else {"date": at.isoformat(), **texts}


def _dwell(setup: DwellSetup) -> dict[str, str]:
    degree = math.pi / 180.0
    angles = {"angle": setup.angle, "angle_std": setup.angle_std}
    shown = {key: None if y is None else f'"{y / degree!r} deg"' for key, y in angles.items()}
    return _declared({**shown, "gravity": _amount(setup.gravity, "m/s^2")})


def toml_key(name: str) -> str:
    """Return `name` as a TOML key, in quotes only if it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_text(name)


def toml_text(value: str) -> str:
    """Return `value` as a TOML string in quotes."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _channels(recording: Recording) -> list[Channel]:
    position = recording.position if recording.reference is None else recording.reference
    return [recording.accel, *([position] if len(position) else []), *recording.side.values()]


def _require_readable(recording: Recording, columns: Mapping[str, str]) -> None:
    """Check that each column name is read back as the channel and unit that it stands for."""
    for channel in _channels(recording):
        named = naming.take_apart(columns[channel.name])
        name = naming.role(named.base) or named.base
        differing = [unit for unit in (named.suffix, named.brackets) if unit not in (None, channel.unit)]
        if name != channel.name or differing:
            read = f"{name} in {differing[0]}" if differing else name
            raise RecordingError(
                f'channel "{channel.name}" in {channel.unit} would be read back as {read}; rename it before writing.'
            )


def common_stamps(recording: Recording) -> Array:
    """Return all instants at which anything was sampled, shape (n,), s."""
    clocks = [channel.t for channel in _channels(recording)]
    if all(np.array_equal(clock, clocks[0]) for clock in clocks[1:]):
        return clocks[0]
    return np.unique(np.concatenate(clocks))


def common_rows(recording: Recording) -> Iterator[tuple[Channel, Array, Flags]]:
    """Each channel on the common stamps: the channel, its values, and where it was not sampled, (n,) each."""
    t = common_stamps(recording)
    for channel in _channels(recording):
        values, missing = np.zeros(len(t)), np.ones(len(t), dtype=bool)
        at = np.searchsorted(t, channel.t)
        values[at], missing[at] = channel.y, False
        yield channel, values, missing


def _cells(recording: Recording) -> Iterator[tuple[str, Any]]:
    """Yield (channel name, pyarrow array on the common stamps with null where it was not sampled)."""
    for channel, values, missing in common_rows(recording):
        yield channel.name, arrow.cells_of(values, missing)


def _stamps(recording: Recording) -> Any:
    t = common_stamps(recording)
    return arrow.cells_of(t, np.zeros(len(t), np.bool_))


def _sources(recording: Recording, time: str, columns: Mapping[str, str]) -> dict[str, Clock | Source]:
    sources = {channel.name: Source(columns[channel.name], channel.unit) for channel in _channels(recording)}
    return {"time": Clock(column=time, unit="s"), **sources}


def _declared(entries: Mapping[str, str | None]) -> dict[str, str]:
    return {key: value for key, value in entries.items() if value is not None}


def _amount(value: float | None, unit: str, usual: str = "") -> str | None:
    """A quantity in its usual unit where it is round there and reads back as the same number, else in SI in full."""
    if value is None:
        return None
    if usual:
        factor = units.conversion(usual).factor
        number = f"{value / factor:.6g}"
        if float(number) * factor == value:
            return f'"{number} {usual}"'
    return f'"{value!r} {unit}"'


def _ratio(value: float | None) -> str | None:
    return None if value is None else repr(float(value))


def _sensor(rig: Rig) -> dict[str, str]:
    sensor = rig.sensor
    return _declared(
        {
            "model": toml_text(sensor.model) if sensor.model else None,
            "serial": toml_text(sensor.serial) if sensor.serial else None,
            "noise": _amount(sensor.noise, "m/s^2/Hz^0.5", "ug/sqrt(Hz)"),
            "bias_instability": _amount(sensor.bias_instability, "m/s^2", "ug"),
            "random_walk": _amount(sensor.random_walk, "m/s^2/s^0.5"),
            "range": _amount(sensor.range, "m/s^2", "g"),
            "scale": _amount(sensor.scale, f"{sensor.scale_unit}/(m/s^2)"),
            "zero": _amount(sensor.zero, sensor.scale_unit),
        }
    )


def _rig(rig: Rig, *, turning: bool) -> dict[str, str]:
    """Return what is declared of the rig; gravity along an axis that a channel holds is not declared twice."""
    assumed = rig.assumptions
    return _declared(
        {
            "axis": None if sidecar.ASSUMED_AXIS in assumed else toml_text(rig.axis),
            "mount": None if sidecar.ASSUMED_MOUNT in assumed else toml_text(rig.mount),
            GRAVITY: None if turning else _amount(rig.gravity_along_axis, "m/s^2"),
        }
    )


def _clock(rig: Rig) -> dict[str, str]:
    assumed = sidecar.ASSUMED_OFFSET_TOLERANCE in rig.assumptions
    return _declared({"offset_tolerance": None if assumed else _amount(rig.offset_tolerance, "s", "us")})


def _uncertainty(rig: Rig) -> dict[str, str]:
    declared = rig.uncertainty
    return _declared(
        {
            "encoder_scale": _ratio(declared.encoder_scale),
            "level": _amount(declared.level, "rad"),
            "misalignment": _amount(declared.misalignment, "rad"),
        }
    )


def _channel(rig: Rig, name: str, source: Clock | Source, reference: str) -> dict[str, str]:
    """Return the entries of one channel; low-pass and resolution are declared beside the channel they belong to."""
    entries = {
        "column": toml_text(source.column) if source.column is not None else None,
        "unit": toml_text(source.unit) if source.unit is not None else None,
    }
    if isinstance(source, Clock):
        return _declared(entries | {"rate": _amount(source.rate, "Hz")})
    if source.time is not None:
        entries["time"] = _inline(_channel(rig, "time", source.time, reference))
    entries |= _filters(rig, name, reference)
    if name == "position":
        entries["resolution"] = _amount(rig.resolution, "m", "um")
    return _declared(entries)


def _filters(rig: Rig, name: str, reference: str) -> dict[str, str | None]:
    """Return the keys lowpass and highpass of one channel."""
    filters = {"accel": rig.output_filters, reference: rig.position_filters}.get(name, ())
    low, high = ([_filter(each) for each in kind] for kind in (low_passes(filters), high_passes(filters)))
    if name == "accel" and rig.lowpass is not None:
        one = {"kind": '"RC"', "fc": _amount(rig.lowpass.cutoff, "Hz"), "tolerance": _ratio(rig.lowpass.tolerance)}
        low = [_inline(_declared(one))]
    listed = {"lowpass": low, "highpass": high}
    return {
        key: each[0] if len(each) == 1 else f"[{', '.join(each)}]" if each else None for key, each in listed.items()
    }


def _filter(declared: ChannelFilter) -> str:
    """Return one filter as an inline table."""
    numbers = {"taps" if declared.kind == "fir" else "b": declared.b, "a": declared.a}
    entries = {
        "kind": f'"{declared.kind}"',
        "fc": _amount(declared.cutoff, "Hz"),
        "length": str(declared.length) if declared.length else None,
        "order": str(declared.order) if declared.kind in ("butterworth", "bessel", "sinc") else None,
        **{key: f"[{', '.join(map(repr, values))}]" if values else None for key, values in numbers.items()},
        "rate": _amount(declared.rate, "Hz"),
    }
    return _inline(_declared(entries))


def _inline(entries: Mapping[str, str]) -> str:
    return "{ " + ", ".join(f"{key} = {value}" for key, value in entries.items()) + " }"
