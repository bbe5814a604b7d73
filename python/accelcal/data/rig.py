"""What is known of the sensor and the rig before any fit."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from accelcal._support.arguments import check_fields
from accelcal._support.values import immutable, listing, short_repr
from accelcal.data.channel_filter import ChannelFilter, high_passes

STANDARD_GRAVITY = 9.80665
"""g0, m/s² (exact by convention)."""

UNDECLARED_TOLERANCE = 0.05
"""Relative tolerance of a low-pass whose tolerance is not declared."""

Axis = Literal["level", "up", "down"]
Mount = Literal["normal", "reversed", "rolled"]


@immutable
@short_repr
@dataclass(frozen=True, slots=True)
class LowPass:
    """A known single-pole RC filter between the sensing element and the sampled output.

    Examples
    --------
    >>> round(LowPass(159.0).tau, 6)
    0.001001
    """

    cutoff: float
    """Corner frequency fc, Hz."""
    tolerance: float | None = None
    """Relative standard tolerance of the time constant; None = not declared."""

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def tau(self) -> float:
        """Time constant 1/(2 pi fc), s."""
        return 1.0 / (2.0 * math.pi * self.cutoff)


@immutable
@short_repr
@dataclass(frozen=True, slots=True)
class Sensor:
    """The accelerometer as its data sheet describes it; None = not declared.

    Examples
    --------
    >>> Sensor(model="CXL02TG3", range=2 * 9.80665)
    Sensor(model='CXL02TG3', range=19.6133)
    """

    model: str = ""
    serial: str = ""
    noise: float | None = None
    """One-sided noise density N, (m/s²)/sqrt(Hz)."""
    range: float | None = None
    """Full scale, m/s² (±)."""
    scale: float | None = None
    """Electrical scale factor K, V (or counts) per m/s²."""
    scale_unit: str = ""
    """What the electrical output is counted in: "V", "count" or empty when the channel is already in m/s²."""
    zero: float | None = None
    """Electrical output at zero acceleration, V (or counts)."""
    bias_instability: float | None = None
    """Slow change of the bias that is ordinary for it, rms, m/s²."""
    random_walk: float | None = None
    """Random walk of the bias, (m/s²)/sqrt(s)."""

    def __post_init__(self) -> None:
        check_fields(self)


@immutable
@short_repr
@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Standard uncertainties declared for the budget; None = not declared."""

    encoder_scale: float | None = None
    """Relative."""
    level: float | None = None
    """rad."""
    misalignment: float | None = None
    """rad."""


@immutable
@short_repr
@dataclass(frozen=True, slots=True)
class Rig:
    """Sensor, axis, mount, clocks and known filters: everything a fit may assume.

    Examples
    --------
    >>> Rig(axis="up", lowpass=LowPass(159.0)).gravity
    9.80665
    """

    sensor: Sensor = field(default_factory=Sensor)
    axis: Axis = "level"
    mount: Mount = "normal"
    gravity_along_axis: float | None = None
    """Specific force at rest along the stage axis, m/s²; None = 0 when level, ±g0 when up or down."""
    offset_tolerance: float = 0.0
    """How far the two clocks may disagree without anyone being to blame, s."""
    lowpass: LowPass | None = None
    """Declared low-pass of the accelerometer channel where it is one RC; any other is in `output_filters`."""
    output_filters: tuple[ChannelFilter, ...] = ()
    """Further declared filters of the accelerometer channel, in the order of the signal."""
    position_filters: tuple[ChannelFilter, ...] = ()
    """Declared filters of the position channel, in the order of the signal."""
    resolution: float | None = None
    """Encoder resolution, m."""
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    tolerance: float | None = None
    """Contribution to the output below which an effect does not matter to the user, m/s²; None = not declared."""
    assumptions: tuple[str, ...] = field(default=(), repr=False)
    """Sentences on what was not declared and therefore assumed."""

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def gravity(self) -> float:
        """Specific force at rest along the stage axis, m/s²."""
        if self.gravity_along_axis is not None:
            return self.gravity_along_axis
        return {"level": 0.0, "up": STANDARD_GRAVITY, "down": -STANDARD_GRAVITY}[self.axis]

    @property
    def lowpass_tolerance(self) -> float:
        """How far the time constant of the declared low-pass may be off, s; 5 % where no tolerance is declared."""
        if self.lowpass is None:
            return 0.0
        share = UNDECLARED_TOLERANCE if self.lowpass.tolerance is None else self.lowpass.tolerance
        return share * self.lowpass.tau

    @property
    def lowpass_prior(self) -> float:
        """Declared standard deviation of the time constant, s; 0 where none is declared: the fit takes it as exact."""
        return 0.0 if self.lowpass is None else (self.lowpass.tolerance or 0.0) * self.lowpass.tau

    @property
    def coupled(self) -> bool:
        """Whether a constant acceleration is seen by both channels; not behind a high-pass of either."""
        return not high_passes(self.filters)

    @property
    def filters(self) -> tuple[ChannelFilter, ...]:
        """Declared filters beside the one RC of the accelerometer."""
        return (*self.output_filters, *self.position_filters)

    @property
    def polarity(self) -> float:
        """+1 when the input axis points along the stage axis, -1 when the sensor is reversed on it."""
        return -1.0 if self.mount == "reversed" else 1.0

    @property
    def roll(self) -> float:
        """-1 when the sensor is rolled by 180 degrees about its input axis, else +1."""
        return -1.0 if self.mount == "rolled" else 1.0


__dir__ = listing(globals())
