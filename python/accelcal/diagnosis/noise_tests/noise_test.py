"""The result of one noise test of one effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from accelcal.effects import found_by

LINE = found_by("line").name
VIBRATION = found_by("noise over speed").name
JITTER = found_by("noise over jerk").name
OUTPUT_OUTLIERS = found_by("output outliers").name
READING_OUTLIERS = found_by("reading outliers").name
STEPS = found_by("output steps").name
ROUNDED_STAMPS = found_by("stamps on a grid").name
HELD_SAMPLES = found_by("held output").name
POSITION_WAVE = found_by("wave over position").name
POSITION_JUMPS = found_by("position jumps").name
"""The effects that the tests find, by name."""


@dataclass(frozen=True, slots=True)
class NoiseTest:
    """Result of one test of one effect, significant or not."""

    effect: str
    statistic: float
    p_value: float
    """Probability of such a statistic under the null, with everything that this test has compared included."""
    estimate: float
    unit: str
    std: float
    sentence: str
    parts: Mapping[str, float] = field(default_factory=dict)
    """Particulars in SI: frequency, wavelength, step, count, ..."""
    at: tuple[float, ...] = ()
    """Instants of the effect, where it has any, s on the clock of its channel."""
