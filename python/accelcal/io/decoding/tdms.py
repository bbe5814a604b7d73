"""TDMS of LabVIEW and DIAdem: properties and lengths first, then one channel at a time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from nptdms import TdmsFile

from accelcal.io.decoding.source import Clock, RefusedError, Sampled, Source, opened_channels, uniform

_UNITS = ("unit_string", "NI_UnitDescription", "unit")
"""Properties that hold a unit: of waveforms and DAQmx, of DIAdem, of other writers."""


def opened(path: str) -> Source:
    """Open a file: each numeric channel is a column, called ``group/channel``, or ``channel`` where there is one group.

    A waveform has stamps from its increment and start; instants of several channels count from the earliest start.
    """
    file = TdmsFile.open(Path(path).open("rb"), raw_timestamps=True)  # noqa: SIM115  by no name: no index file opens
    if file.file_status.incomplete_final_segment:
        raise RefusedError("its last segment is cut off; copy the file again, or save it anew with LabVIEW or DIAdem")
    groups = [group for group in file.groups() if group.channels()]
    channels = [channel for group in groups for channel in group.channels()]
    starts = [start for start in map(_start, channels) if start is not None]
    return opened_channels(_sampled(channels, len(groups) > 1, min(starts, default=None)))


def _sampled(channels: list[Any], grouped: bool, first: tuple[int, int] | None) -> Iterator[Sampled]:
    for channel in channels:
        kind = np.dtype(channel.dtype).kind if channel.dtype is not None else ""
        name = f"{channel.group_name}/{channel.name}" if grouped else channel.name
        if kind == "M" or channel.data_type.__name__ == "TimeStamp":
            yield Sampled(name, len(channel), "s", lambda c=channel: _instants(c[:]))  # type: ignore[misc]
        elif kind and kind in "fiub":
            yield Sampled(name, len(channel), _unit(channel), lambda c=channel: c[:], _clock(channel, first))  # type: ignore[misc]


def _clock(channel: Any, first: tuple[int, int] | None) -> Clock | None:
    """The stamps of a waveform."""
    increment = float(channel.properties.get("wf_increment", 0.0))
    if not increment > 0.0:
        return None
    offset, start = float(channel.properties.get("wf_start_offset", 0.0)), _start(channel)
    if start is not None and first is not None:
        offset += _difference(start, first)
    return uniform(offset, increment, len(channel))


def _start(channel: Any) -> tuple[int, int] | None:
    """When a waveform begins: seconds and 2^-64 s."""
    start = channel.properties.get("wf_start_time")
    seconds = getattr(start, "seconds", None)
    if seconds is None or not seconds:  # LabVIEW writes 0 where no start is known
        return None
    return int(seconds), int(start.second_fractions)


def _difference(later: tuple[int, int], earlier: tuple[int, int]) -> float:
    return float(later[0] - earlier[0]) + float(later[1] - earlier[1]) * 2.0**-64


def _instants(stamps: Any) -> Any:
    """Time stamps, which count from 1904, as dates of NumPy."""
    fractions = np.asarray(stamps["second_fractions"], dtype=np.float64) * (1e9 * 2.0**-64)
    begun = np.asarray(stamps["seconds"], dtype=np.int64) * 10**9 + np.round(fractions).astype(np.int64)
    return np.datetime64("1904-01-01", "ns") + begun.astype("timedelta64[ns]")


def _unit(channel: Any) -> str | None:
    unit = next((channel.properties[key] for key in _UNITS if channel.properties.get(key)), None)
    return None if unit is None else str(unit)
