"""What was measured: channels, each on its own clock, and what was noticed when they were read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from accelcal.rig import Rig

Array = NDArray[np.float64]


class RecordingError(ValueError):
    """The data cannot be used as they are. The text says what was found, where, and the next step."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured quantity on its own clock."""

    name: str
    t: Array
    """(n,) s, strictly rising, finite."""
    y: Array
    """(n,) in `unit`, finite: a sample that was not taken is simply absent."""
    unit: str
    """SI unit of `y` (temperature: "degC")."""

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True)
class Finding:
    """Something noticed while reading, and the policy that was applied to it."""

    kind: str
    """One word: gap, held_repeats, duplicate_stamps, clipping, constant, ... (see `accelcal.checks`)."""
    channel: str
    count: int
    first: float
    """Time of the first occurrence, s."""
    text: str
    """A whole sentence: what was found, where, what was done about it."""
    severity: Literal["note", "warning"] = "note"


@dataclass(frozen=True, slots=True)
class Recording:
    """One run: the accelerometer output, the encoder position, side channels, and the rig it came from."""

    accel: Channel
    """Accelerometer output, m/s² (converted from V or counts through the declared scale)."""
    position: Channel
    """Encoder reading, m."""
    rig: Rig
    side: Mapping[str, Channel] = field(default_factory=dict)
    """Further channels by name: temperature, a_y, ..."""
    name: str = ""
    """File name, for messages."""
    digest: str = ""
    """SHA-256 of the source file, hex."""
    findings: tuple[Finding, ...] = ()
