"""Sensor and rig as declared before any fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from accelcal._support.arguments import check_fields
from accelcal._support.errors import AccelcalError
from accelcal._support.values import immutable, listing, short_repr
from accelcal.data.arrays import VANISHING

Kind = Literal["RC", "butterworth", "bessel", "resonance", "biquad", "sinc", "fir"]
Pass = Literal["lowpass", "highpass"]

KINDS: tuple[Kind, ...] = get_args(Kind)
"""Every kind of filter that can be declared."""
CORNERED: tuple[Kind, ...] = ("RC", "butterworth", "bessel")
"""Kinds with a corner frequency: analog unless a rate is given."""
ANALOG: tuple[Kind, ...] = (*CORNERED, "resonance")
"""Kinds that run on no samples, unless a rate is given."""
MOST_ORDER = 10
"""Largest order of a declared filter: beyond it the coefficients of its polynomials lose their digits."""

MOST_ACCEL, MOST_POSITION = 1e6, 1e6
"""What no stage does, m/s² and m: live, such a number was damaged on its way."""
MOST_RANGES = 2.0
"""The same of the output, in declared ranges of the sensor."""


@dataclass(frozen=True, slots=True)
class ChannelFilter:
    """One declared filter; the fields that its kind does not use keep their defaults.

    Raises
    ------
    ValueError
        If a number is missing, out of range or makes the filter unstable; the text says what was expected.
    """

    kind: Kind
    passes: Pass = "lowpass"
    cutoff: float | None = None
    """Frequency at which the gain is -3 dB, Hz; of RC, butterworth and bessel. Natural frequency f0 of resonance."""
    order: int = 1
    """Number of poles of butterworth and bessel; number of cascaded averages of sinc."""
    b: tuple[float, ...] = ()
    """Numerator of biquad, in powers of the delay by one sample; taps of fir."""
    a: tuple[float, ...] = ()
    """Denominator of biquad."""
    quality: float | None = None
    """Quality factor Q of resonance: a mass on a spring, w0²/(s² + w0 s/Q + w0²)."""
    tolerance: float | None = None
    """Relative standard uncertainty of the natural frequency of resonance, or of the time constant of RC, which a rig
    holds as its `lowpass`; None: the fit takes it as exact."""
    length: int = 0
    """Samples in one average of sinc."""
    rate: float | None = None
    """Rate at which a digital filter runs, Hz; None = that of the channel, and an analog filter where there is a
    corner."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise AccelcalError(f"kind: found {self.kind!r}, expected {' or '.join(KINDS)}")
        if self.rate is not None and not (math.isfinite(self.rate) and self.rate > 0.0):
            raise AccelcalError(f"rate: found {self.rate!r} Hz, expected a positive frequency")
        if not 1 <= self.order <= MOST_ORDER:
            raise AccelcalError(f"order: found {self.order}, expected a whole number from 1 to {MOST_ORDER}")
        if self.kind == "resonance":
            self._check_resonance()
        elif self.kind in ANALOG:
            self._check_corner()
        elif self.kind == "sinc":
            self._check_sinc()
        else:
            self._check_coefficients()

    @property
    def digital(self) -> bool:
        """Whether it runs on samples, at `rate` or at the rate of the channel."""
        return self.kind not in ANALOG or self.rate is not None

    @property
    def name(self) -> str:
        """The filter in words, as sentences refer to it."""
        kind = "high-pass" if self.passes == "highpass" else "low-pass"
        if self.kind == "resonance":
            return f"resonance at {self.cutoff:.6g} Hz with Q = {self.quality:.4g}"
        if self.cutoff is not None:
            order = f" of order {self.order}" if self.kind != "RC" else ""
            return f"{self.kind} {kind}{order} at {self.cutoff:.6g} Hz"
        if self.kind == "sinc":
            return f"sinc {kind} of order {self.order} over {self.length} samples"
        return f"{self.kind} {kind} of {max(len(self.b), len(self.a))} coefficients"

    def _check_corner(self) -> None:
        if self.cutoff is None or not (math.isfinite(self.cutoff) and self.cutoff > 0.0):
            raise AccelcalError(
                f"fc: found {self.cutoff!r} Hz, expected a positive frequency at which the gain is -3 dB"
            )
        if self.rate is not None and self.cutoff >= 0.5 * self.rate:
            raise AccelcalError(
                f"fc: found {self.cutoff:.6g} Hz, expected less than half the rate of the digital filter, "
                f"{0.5 * self.rate:.6g} Hz; leave out rate where the filter is analog"
            )

    def _check_resonance(self) -> None:
        if self.passes == "highpass":
            raise AccelcalError("kind: found 'resonance', expected a kind that blocks a constant; a spring passes it")
        if self.rate is not None:
            raise AccelcalError(f"rate: found {self.rate:.6g} Hz, expected none: a resonance runs on no samples")
        for key, value, unit in (("f0", self.cutoff, " Hz"), ("Q", self.quality, "")):
            if value is None or not (math.isfinite(value) and value > 0.0):
                raise AccelcalError(f"{key}: found {value!r}{unit}, expected a positive number")
        if self.tolerance is not None and not 0.0 <= self.tolerance < 1.0:
            raise AccelcalError(f"tolerance: found {self.tolerance!r}, expected a share of f0 from 0 to 1")

    def _check_sinc(self) -> None:
        if self.passes == "highpass":
            raise AccelcalError("kind: found 'sinc', expected a kind that passes high frequencies; an average does not")
        if self.length < 2:
            raise AccelcalError(f"length: found {self.length}, expected a whole number of samples, at least 2")

    def _check_coefficients(self) -> None:
        key = "taps" if self.kind == "fir" else "b"
        coefficients = np.array([*self.b, *self.a], dtype=np.float64)
        if not self.b or not np.any(self.b):
            raise AccelcalError(f"{key}: found {list(self.b)}, expected at least one number that is not zero")
        if not np.all(np.isfinite(coefficients)):
            raise AccelcalError(f"{key}: expected finite numbers, found {coefficients.tolist()}")
        if self.kind == "biquad":
            if not 1 <= len(self.a) <= 3 or len(self.b) > 3 or self.a[0] == 0.0:
                raise AccelcalError(
                    f"b, a: found {len(self.b)} and {len(self.a)} numbers, expected up to three each, the first of a "
                    "not zero; write a longer filter as a list of biquads"
                )
            size = float(np.max(np.abs(np.roots(self.a)), initial=0.0))
            if size >= 1.0:
                raise AccelcalError(f"a: unstable, a pole has the magnitude {size:.6g}; expected all below 1")
        gain = abs(sum(self.b)) / (abs(sum(self.a)) if self.a else 1.0)
        if (gain > VANISHING * sum(map(abs, self.b))) != (self.passes == "lowpass"):
            other = "highpass" if self.passes == "lowpass" else "lowpass"
            raise AccelcalError(
                f"{key}: the gain at rest is {gain:.6g}, which is no {self.passes}; check the numbers, or declare it "
                f"as {other}"
            )


def low_passes(filters: Sequence[ChannelFilter]) -> tuple[ChannelFilter, ...]:
    """Filters that pass slow motion."""
    return tuple(f for f in filters if f.passes == "lowpass")


def high_passes(filters: Sequence[ChannelFilter]) -> tuple[ChannelFilter, ...]:
    """Filters that block a constant."""
    return tuple(f for f in filters if f.passes == "highpass")


def unsupported(filters: Sequence[ChannelFilter], what: str) -> str | None:
    """One sentence that refuses filters which `what` cannot take into account; None without any."""
    if not filters:
        return None
    names = ", ".join(f.name for f in filters)
    return (
        f"{what} takes one RC low-pass of the accelerometer into account, but {names} "
        f"{'is' if len(filters) == 1 else 'are'} declared; use fit and diagnose, which take every kind, or run it on a "
        "channel without such a filter"
    )


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
        check_fields(self, signed=())

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

    An output of 0.1 V/g around 2.5 V, for `accelcal.load` and `Recording.from_arrays`, whose unit of it is then V:

    >>> from accelcal.data import units
    >>> scale, unit, _ = units.sensitivity("0.1 V/g", "acceleration")
    >>> rig = Rig(sensor=Sensor(scale=scale, scale_unit=unit, zero=2.5))
    >>> rig.sensor.scale == 0.1 / 9.80665, rig.sensor.scale_unit
    (True, 'V')
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
    """Unit of the electrical output: "V", "count" or empty when the channel is already in m/s²."""
    zero: float | None = None
    """Electrical output at zero acceleration, V (or counts)."""
    bias_instability: float | None = None
    """Slow change of the bias that is ordinary for it, rms, m/s²."""
    random_walk: float | None = None
    """Random walk of the bias, (m/s²)/sqrt(s)."""

    def __post_init__(self) -> None:
        check_fields(self, signed=("scale", "zero"))

    @property
    def most_output(self) -> float:
        """Largest output of a live stream that is taken for one, m/s²."""
        return MOST_ACCEL if self.range is None else MOST_RANGES * self.range


@immutable
@short_repr
@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Standard uncertainties declared for the budget; None = not declared."""

    encoder_scale: float | None = None
    """Of the reference, relative."""
    reference_zero: float | None = None
    """Of an acceleration, m/s²."""
    level: float | None = None
    """rad."""
    misalignment: float | None = None
    """rad."""
    clock_rate: float | None = None
    """Relative, of the rate of the clock that is trusted."""


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
    trusted_clock: Literal["position", "accel"] | None = None
    """Whose rate is right where the two differ; None = not declared."""
    lowpass: LowPass | None = None
    """Declared low-pass of the accelerometer channel where it is one RC; any other is in `output_filters`."""
    output_filters: tuple[ChannelFilter, ...] = ()
    """Further declared filters of the accelerometer channel, in the order of the signal."""
    position_filters: tuple[ChannelFilter, ...] = ()
    """Declared filters of the position channel, in the order of the signal."""
    resolution: float | None = None
    """Encoder resolution, m."""
    reading_noise: float | None = None
    """Standard deviation of the noise of one reading of the reference, in its unit: m of a position."""
    ratio: float | None = None
    """1 + k that the rig makes by itself, a lever or a ratio of masses; None = 1."""
    arm: float | None = None
    """Distance of the sensor from the axle about which it turns, m; None = it does not turn about one."""
    arm_std: float | None = None
    """Standard uncertainty of that distance, m; None = not declared."""
    axle: float | None = None
    """Elevation of that axle, rad: 0 is horizontal."""
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    tolerance: float | None = None
    """Contribution to the output below which an effect does not matter to the user, m/s²; None = not declared."""
    assumptions: tuple[str, ...] = field(default=(), repr=False)
    """Sentences on what was not declared and therefore assumed."""

    def __post_init__(self) -> None:
        check_fields(self, signed=("gravity_along_axis", "ratio", "axle"))

    @property
    def gravity(self) -> float:
        """Specific force at rest along the stage axis, m/s²."""
        if self.gravity_along_axis is not None:
            return self.gravity_along_axis
        return {"level": 0.0, "up": STANDARD_GRAVITY, "down": -STANDARD_GRAVITY}[self.axis]

    @property
    def lowpass_tau(self) -> float:
        """Time constant of the declared RC low-pass, s; 0 where there is none."""
        return 0.0 if self.lowpass is None else self.lowpass.tau

    @property
    def lowpass_tolerance(self) -> float:
        """How far the time constant of the declared low-pass may be off, s; 5 % where no tolerance is declared."""
        declared = None if self.lowpass is None else self.lowpass.tolerance
        return (UNDECLARED_TOLERANCE if declared is None else declared) * self.lowpass_tau

    @property
    def lowpass_prior(self) -> float:
        """Declared standard deviation of the time constant, s; 0 where none is declared: the fit takes it as exact."""
        return 0.0 if self.lowpass is None else (self.lowpass.tolerance or 0.0) * self.lowpass.tau

    @property
    def resonance_prior(self) -> float:
        """Standard deviation of 1/w0² of a declared resonance, s², by its tolerance; 0 where none is declared."""
        unsure = [
            2.0 * item.tolerance / (2.0 * math.pi * item.cutoff) ** 2
            for item in self.output_filters
            if item.tolerance and item.cutoff
        ]
        return max(unsure, default=0.0)

    @property
    def coupled(self) -> bool:
        """Whether a constant acceleration is seen by both channels; not behind a high-pass of either."""
        return not high_passes(self.filters)

    @property
    def filters(self) -> tuple[ChannelFilter, ...]:
        """Declared filters beside the one RC of the accelerometer."""
        return (*self.output_filters, *self.position_filters)

    @property
    def passed_by_output(self) -> tuple[ChannelFilter, ...]:
        """Declared filters of the accelerometer, its one RC the first."""
        first = () if self.lowpass is None else (ChannelFilter("RC", cutoff=self.lowpass.cutoff),)
        return (*first, *self.output_filters)

    @property
    def polarity(self) -> float:
        """+1 when the input axis points along the stage axis, -1 when the sensor is reversed on it."""
        return -1.0 if self.mount == "reversed" else 1.0

    @property
    def roll(self) -> float:
        """-1 when the sensor is rolled by 180 degrees about its input axis, else +1."""
        return -1.0 if self.mount == "rolled" else 1.0


__dir__ = listing(globals())
