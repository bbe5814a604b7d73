"""MF4 (ASAM MDF 4) of vehicle loggers: channels and counts of the groups first, then one channel at a time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF
from asammdf.blocks.v4_blocks import ChannelConversion
from asammdf.blocks.v4_constants import FLAG_CG_REMOTE_MASTER

from accelcal.io.decoding.source import Clock, RefusedError, Sampled, Source, opened_channels

_AS_STORED, _RATIONAL, _FORMULA, _TO_TEXT = 0, 2, 3, range(7, 12)
"""Conversions: none; a quotient of polynomials; a formula in text; from numbers to texts and back."""


def opened(path: str) -> Source:
    """Open a file: each numeric channel is a column; the master of its group holds its stamps."""
    with Path(path).open("rb") as file:
        version = file.read(16)[8:].decode("latin-1").strip("\x00 ")
    if not version.startswith("4"):
        raise RefusedError(f"it is MDF of version {version[:8]}; expected version 4; convert it with asammdf")
    # Logs of a bus would be decoded at once, by masters that have been converted.
    return opened_channels(_sampled(MDF(path, process_bus_logging=False)))  # type: ignore[call-arg]


def _sampled(file: Any) -> Iterator[Sampled]:
    for g, group in enumerate(file.groups):
        master, count = file.masters_db.get(g), int(group.channel_group.cycles_nr)
        clock = None if master is None else Clock(g, lambda g=g: _stamps(file, g))  # type: ignore[misc]
        for k, channel in enumerate(group.channels):
            if k != master and count and channel.data_type in range(6):  # whole or real numbers
                unit = str(file.get_channel_unit(group=g, index=k) or "")
                yield Sampled(channel.name, count, unit or None, lambda g=g, k=k: _values(file, g, k), clock)  # type: ignore[misc]


def _stamps(file: Any, number: int) -> Any:
    """Stamps of a group, s; of the group that has its master, where that is another one."""
    group = file.groups[number]
    if group.channel_group.flags & FLAG_CG_REMOTE_MASTER:
        return _stamps(file, group.channel_group.cg_master_index)
    master = group.channels[file.masters_db[number]]
    conversion, master.conversion = master.conversion, None
    try:
        return _converted(conversion, file.get_master(number))
    finally:
        master.conversion = conversion


def _values(file: Any, group: int, index: int) -> Any:
    """Values in the unit of the channel; NaN where the logger marked them as invalid.

    They are asked for without their stamps, which the library would convert along with them.
    """
    samples, marks = file.get(group=group, index=index, raw=True, samples_only=True, ignore_invalidation_bits=True)
    values = _converted(file.groups[group].channels[index].conversion, samples)
    if marks is None:
        return values
    invalid = np.asarray(marks, dtype=bool)
    return np.where(invalid, np.nan, values.astype(np.float64)) if invalid.any() else values


def _converted(conversion: Any, raw: Any) -> Any:
    """Readings of a logger in the unit of their channel; those that stand for texts stay as they are."""
    _require_no_formula(conversion)
    kind = 0 if conversion is None else int(conversion.conversion_type)
    if kind == _AS_STORED or kind in _TO_TEXT:
        return np.asarray(raw)
    if kind == _RATIONAL:  # the square of a whole number is longer than its type
        raw = np.asarray(raw, dtype=np.float64)
    return np.asarray(conversion.convert(raw))


def _require_no_formula(conversion: Any) -> None:
    """Refuse a conversion that is a formula in text, or refers to one."""
    if not isinstance(conversion, ChannelConversion):
        return
    if conversion.conversion_type == _FORMULA:
        raise RefusedError("is converted by a formula in the file, which is not evaluated; export it with its values")
    for block in (conversion.referenced_blocks or {}).values():
        _require_no_formula(block)
