"""The result of one noise test of one effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from accelcal.diagnosis.policy import OWN_WAVE_TURNS
from accelcal.effects import HARMONICS, find, found_by, stem_of
from accelcal.model import Model
from accelcal.signals.signals import Signals

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
WHITENESS = "whiteness"
"""The test that finds no effect."""


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
    """Particulars in SI: frequency, period, step, count, ...; a shape parameter of the effect by its name."""
    at: tuple[float, ...] = ()
    """Instants of the effect, where it has any, s on the clock of its channel."""

    @property
    def shape(self) -> dict[str, float]:
        """Shape parameters of the wave that it tells, at which a fit begins; empty where the effect is no wave."""
        shapes = {} if self.effect == WHITENESS else find(self.effect).shapes
        is_wave = any(shape.width for shape in shapes.values())
        return {name: self.parts[name] for name in shapes if is_wave and name in self.parts}

    @property
    def evidence(self) -> float:
        """Twice the log-likelihood that its effect gains, for one that has an amplitude."""
        return (self.estimate / self.std) ** 2 if self.std > 0.0 else 0.0

    @property
    def single(self) -> bool:
        """Whether it tells of one outlier alone, which is an event of the record and no property of the noise."""
        noise = None if self.effect == WHITENESS else find(self.effect).traits.noise
        return noise is not None and bool(noise.rejects) and self.parts.get("count") == 1.0

    def in_model(self, model: Model, s: Signals) -> bool:
        """Whether a model has what it tells: the effect, or of a wave one with as many turns over the record, or with a
        harmonic that has."""
        if not self.shape:
            return self.effect in model.effects
        waves = [model.shapes[name] for name in model.added if stem_of(find(name)) == self.effect]
        return any(
            abs(value - multiple) < OWN_WAVE_TURNS * width(s, multiple)
            for name, value in self.shape.items()
            if (width := (shape := find(self.effect).shapes[name]).width)
            for wave in waves
            for multiple in (shape.multiple(wave[name], n) for n in range(1, int(wave[HARMONICS]) + 1))
        )
