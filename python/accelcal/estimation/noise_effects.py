"""What a fit knows of an effect that acts on noise: its coefficient, and the distribution of noise with and without."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from accelcal.data.arrays import Array
from accelcal.effects.registry import Owner


@dataclass(frozen=True, slots=True, eq=False)
class NoiseSpectrum:
    """Power of the noise of the output in blocks, at each frequency: floor + sum of growth times variance function.

    White noise has its variance as power, (m/s²)².
    """

    f: Array
    """(F,) Hz"""
    floor: Array
    """(F,) (m/s²)²"""
    growth: Mapping[str, Array] = field(default_factory=dict)
    """Of each effect, (F,) (m/s²)² per unit of its variance function."""


@dataclass(frozen=True, slots=True, eq=False)
class NoiseEffect:
    """Estimate of one effect that acts on noise."""

    name: str
    symbol: str
    unit: str
    value: float
    """Factor of the effect's variance function."""
    std: float
    owner: Owner
    p_value: float
    """Probability of such a value, or a larger one, by chance where there is none."""
    sentence: str
    particulars: Mapping[str, float] = field(default_factory=dict)
    """In SI: share and size of outliers, step of a converter, standard deviation of the noise otherwise, ..."""
    spectrum: NoiseSpectrum | None = None
    """With all effects of the model that make the noise of the output grow; None where it is not one of them."""
    without: NoiseSpectrum | None = None
    """The same without this one."""


@dataclass(frozen=True, slots=True)
class NoiseScore:
    """What one effect that acts on noise gains on a recording: log predictive density with it less that without it."""

    effect: str
    channel: str
    """accel or position: whose samples are scored."""
    gain: float
    """Natural logarithm, summed over the record."""
    std: float
    """Of the paired difference, from its scatter between parts of the record."""
    count: int
    """Samples or block frequencies that are scored."""
    ratio: float
    """Mean square where the effect is strongest, over what the model with the effect expects there; 1 when calibrated.
    For rare events: events that were found over events expected."""
    ratio_without: float
    """The same for the model without it."""
    what: str = "noise where it is strongest"
    """What the ratios are of."""

    @property
    def gained(self) -> bool:
        """Whether the gain exceeds two of its standard deviations."""
        return self.gain > 2.0 * self.std

    @property
    def sentence(self) -> str:
        """For people."""
        return (
            f"{self.effect}: log score of {self.channel} {self.gain:+.3g} ± {self.std:.2g} over {self.count} values; "
            f"{self.what} {self.ratio:.3g} times what is expected, {self.ratio_without:.3g} times without it"
        )
