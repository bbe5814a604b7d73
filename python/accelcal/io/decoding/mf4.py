"""MF4 (ASAM MDF 4) of vehicle loggers: channels and counts of the groups first, then one channel at a time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF

from accelcal.io.decoding.sampled import Clock, Sampled, opened_channels
from accelcal.io.decoding.source import RefusedError, Source

_NUMBERS = range(6)
"""Data types of channels that are whole or real numbers."""
_AS_STORED, _FORMULA, _TO_TEXT = {0}, 3, range(7, 12)
"""Conversions: none; a formula in text; from numbers to texts and back."""


def opened(path: str) -> Source:
    """Open a file: each numeric channel is a column; the master of its group holds its stamps."""
    with Path(path).open("rb") as file:
        version = file.read(16)[8:].decode("latin-1").strip("\x00 ")
    if not version.startswith("4"):
        raise RefusedError(f"it is MDF of version {version[:8]}; expected version 4; convert it with asammdf")
    return opened_channels(_sampled(MDF(path)))


def _sampled(file: Any) -> Iterator[Sampled]:
    for g, group in enumerate(file.groups):
        master, count = file.masters_db.get(g), int(group.channel_group.cycles_nr)
        clock = None if master is None else Clock(g, lambda g=g: np.asarray(file.get_master(g)))  # type: ignore[misc]
        for k, channel in enumerate(group.channels):
            if k != master and count and channel.data_type in _NUMBERS:
                unit = str(file.get_channel_unit(group=g, index=k) or "")
                yield Sampled(channel.name, count, unit or None, lambda g=g, k=k: _values(file, g, k), clock)  # type: ignore[misc]


def _values(file: Any, group: int, index: int) -> Any:
    """Values in the unit of the channel; NaN where the logger marked them as invalid."""
    found = file.get(group=group, index=index, raw=True, ignore_invalidation_bits=True)
    conversion = found.conversion
    kind = 0 if conversion is None else int(conversion.conversion_type)
    if kind == _FORMULA:
        raise RefusedError("is converted by a formula in the file, which is not evaluated; export it with its values")
    values = found.samples if kind in _AS_STORED or kind in _TO_TEXT else conversion.convert(found.samples)
    if found.invalidation_bits is None:
        return np.asarray(values)
    invalid = np.asarray(found.invalidation_bits, dtype=bool)
    return np.where(invalid, np.nan, np.asarray(values, dtype=np.float64)) if invalid.any() else np.asarray(values)
