"""What one test says of one effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

LEAST_BLOCKS = 40
"""Fewer blocks than this show no correlation that could be told from chance at 1e-4."""
ALARM = 1e-4
"""Level at which one test changes what another one says (a line that follows the motion is vibration)."""


@dataclass(frozen=True, slots=True)
class NoiseTest:
    """What one test says of one effect; significant or not."""

    effect: str
    statistic: float
    p_value: float
    """Chance of such a statistic when the effect is absent, all that this test has looked at included."""
    estimate: float
    unit: str
    std: float
    sentence: str
    parts: Mapping[str, float] = field(default_factory=dict)
    """Particulars in SI: frequency, wavelength, step, count, ..."""
    at: tuple[float, ...] = ()
    """Instants it was seen at, where it has any, s on the clock of its channel."""
