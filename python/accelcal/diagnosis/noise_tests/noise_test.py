"""What one test says of one effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


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
