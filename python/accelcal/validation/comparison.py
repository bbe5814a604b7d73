"""Result of comparing a model with a recording: unaided drift, one-step residuals, residual by region and frequency."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np

from accelcal._support.arguments import checked
from accelcal._support.result import NotStored, Result
from accelcal._support.values import face, immutable
from accelcal.data import Array, Recording, Rig, instant, median_step, quality
from accelcal.estimation.noise import REMARKED_BEYOND, NoiseScore
from accelcal.estimation.values import Noise
from accelcal.signals.signals import Signals

if TYPE_CHECKING:
    from matplotlib.figure import Figure


LEAST_REST, LEAST_STRETCH = 5.0, 2.0
"""Rests that are shorter in all, and stretches that are, do not determine the noise of the sensor, s."""
EDGE = 0.25
"""Left out at both ends of a stretch, s: the stage still settles."""
LOWEST = 2.0
"""Periods in a stretch from which a frequency counts: slower ones are drift."""
OF_CUTOFF, OF_RATE = 0.2, 0.2
"""Highest frequency that counts, as a share of the lowest corner of a low-pass, and of the sampling rate."""
LEAST_ORDINATES, MOST_ORDINATES = 30, 100
"""Frequencies that determine a density: not fewer, and the slowest ones alone, since they make the drift."""
LEAST_CODES = 8
"""Fewer different values of the output at rest than this are the rounding of a converter, not noise."""
Source = Literal["rest", "declared", "fit"]
SOURCES: Mapping[Source, str] = {
    "rest": "noise density at rest",
    "declared": "declared noise density",
    "fit": "at most: fitted noise density",
}
"""Where a density comes from, for people."""

ONLY_WHITE = "noise alone is white noise; 1/f noise of the sensor is not in it and adds to the drift"
"""What a floor leaves out, for people: a record does not tell 1/f noise from slow effects that a model lacks."""


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Noise density of the sensor and where it comes from."""

    density: float
    """One-sided, (m/s²)/sqrt(Hz)."""
    std: float
    """Its standard deviation; 0 where it is declared."""
    source: Source
    declared: float | None = None
    """The declared density, (m/s²)/sqrt(Hz), where it differs from the one taken by more than `REMARKED_BEYOND`."""

    @property
    def is_limit(self) -> bool:
        """Whether the density is an upper limit only: what models lack adds to a fitted one."""
        return self.source == "fit"

    @classmethod
    def of(cls, recording: Recording, fitted: Noise, scale: float = 1.0, end: float | None = None) -> SensorNoise:
        """Density of the output at rest, else the declared one, else the fitted one.

        What a fit takes for noise is never below the noise of the sensor. So a rest that is noisier than the fit by
        more than a factor `REMARKED_BEYOND` is none (the stage creeps or its servo works), and such a declared density
        is that of another sensor.

        Parameters
        ----------
        recording : what models are compared with, until `end`, s.
        fitted : least noise of all models.
        scale : change of the output with acceleration, 1 + k.
        """
        limit = abs(scale) * math.sqrt(2.0 * fitted.usual.q)
        declared = recording.rig.sensor.noise or None
        density = density_at_rest(recording, end)
        if density is not None and density[0] <= REMARKED_BEYOND * limit:
            return cls(*density, "rest", _beside(declared, density[0]))
        if declared is not None and declared <= REMARKED_BEYOND * limit:
            return cls(declared, 0.0, "declared")
        return cls(limit, 0.0, "fit", _beside(declared, limit))


def _beside(declared: float | None, density: float) -> float | None:
    """The declared density where it differs from the one that is taken."""
    return None if declared is None or 1.0 / REMARKED_BEYOND <= density / declared <= REMARKED_BEYOND else declared


def density_at_rest(recording: Recording, until: float | None = None) -> tuple[float, float] | None:
    """One-sided noise density of the output while the encoder stands still, and its standard deviation.

    In (m/s²)/sqrt(Hz), from the median of the periodogram, which lines of mains or pumps do not move. None where the
    record rests too briefly.
    """
    accel = recording.accel
    rate = 1.0 / median_step(accel.t)
    lowest, highest = _band(recording.rig, rate)
    frequencies, powers, rested = [], [], 0.0
    for begin, end in quality.rest(recording, by_output=False):
        if until is not None and end > until:
            continue
        y = accel.y[slice(*np.searchsorted(accel.t, [begin + EDGE, end - EDGE]))]
        if end - begin >= LEAST_STRETCH and np.all(np.isfinite(y)) and len(np.unique(y)) >= LEAST_CODES:
            rested += end - begin
            place = np.arange(len(y)) - 0.5 * (len(y) - 1)
            y = y - np.mean(y) - place * (place @ y) / (place @ place)
            power = 2.0 * np.abs(np.fft.rfft(y)) ** 2 / (rate * len(y))
            frequency = np.fft.rfftfreq(len(y), 1.0 / rate)
            inside = (frequency >= max(lowest, LOWEST * rate / len(y))) & (frequency <= highest)
            frequencies.append(frequency[inside])
            powers.append(power[inside])
    if rested < LEAST_REST or sum(map(len, powers)) < LEAST_ORDINATES:
        return None
    slowest = np.argsort(np.concatenate(frequencies))[:MOST_ORDINATES]
    power = np.concatenate(powers)[slowest]
    middle = float(np.median(power)) / math.log(2.0)  # of an exponential distribution
    relative = 1.0 / (math.log(2.0) * math.sqrt(len(power)))
    return math.sqrt(middle), 0.5 * relative * math.sqrt(middle)


def _band(rig: Rig, rate: float) -> tuple[float, float]:
    """Frequencies at which the declared filters of the output pass its noise, Hz."""
    lowest, highest = 0.0, OF_RATE * rate
    for channel_filter in rig.passed_by_output:
        if channel_filter.cutoff is not None and channel_filter.passes == "lowpass":
            highest = min(highest, OF_CUTOFF * channel_filter.cutoff)
        elif channel_filter.cutoff is not None:
            lowest = max(lowest, channel_filter.cutoff / OF_CUTOFF)
    return lowest, highest


FigureName = Literal[
    "overlay", "coasting", "simulated", "one_step", "regions", "accel_residual", "histogram", "autocorrelation"
]
"""Figures of a comparison, functions of `accelcal.plots`."""

BINS = 12
"""Bins of the residual against each variable."""
HORIZONS = (1.0, 5.0, 10.0)
"""Seconds after position is withheld at which the coasting error is taken."""
SERIES = NotStored("accelcal.compare makes it from the recording", by_commands=True)
"""Mark of a series as long as the recording."""


@immutable
@dataclass(frozen=True, slots=True)
class Coast(Result):
    """Unaided drift: what position would have been, had it been withheld.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> bool(ac.verbs.coast(fit, simulated.recording, 2.0, 5.0).floor[-1] > 0.0)
    True
    """

    start: float
    """Last reading used, s."""
    t: Array
    """Reading times after it, (n,) s."""
    frozen: Array
    """Predicted position with every parameter from the fit, (n,) m."""
    rezeroed: Array
    """Predicted position with this run's constant estimated before the start, (n,) m."""
    floor: Array
    """Standard deviation that noise and start state alone would give, (n,) m."""

    def __repr__(self) -> str:
        end = f" to {instant(self.t[-1])} s" if len(self.t) else ""
        return f"Coast(from {instant(self.start)} s{end}: {len(self.t)} readings)"


@dataclass(frozen=True, slots=True)
class Bins:
    """Mean residual against one variable, set-up aside, with the band that noise alone would give."""

    variable: str
    unit: str
    edges: Array
    """(n + 1,)"""
    mean: Array
    """(n,) m/s²; against frequency: density ratio of residual to prediction."""
    std: Array
    """(n,) standard deviation of the mean under noise alone; 0 where a bin holds too little to say."""
    seen_at: Array = field(default_factory=lambda: np.empty((0, 2)))
    """Stretch of time that adds most to each mean, (n, 2) s, NaN where there is none; (0, 2) against frequency."""

    share: Array = field(default_factory=lambda: np.empty(0))
    """Of the samples that lie in each, (n,); (0,) against frequency."""

    @property
    def of_frequency(self) -> bool:
        """Whether these are ratios of densities."""
        return self.variable == "frequency"

    @property
    def score(self) -> Array:
        """Mean over its standard deviation, (n,); against frequency the excess over 1."""
        offset = 1.0 if self.of_frequency else 0.0
        return np.divide(self.mean - offset, self.std, out=np.zeros_like(self.mean), where=self.std > 0.0)

    def explained_by(self, rms: float) -> list[float]:
        """Share of the mean square `rms`² that the mean of each bin explains, beyond chance; may be negative, and is 0
        against frequency."""
        if not len(self.share) or not rms > 0.0:
            return [0.0] * len(self.mean)
        return [float(x) for x in self.share * (self.mean**2 - self.std**2) / rms**2]

    def explained(self, rms: float) -> float:
        """Share of the mean square `rms`² that a function of this variable explains, beyond chance; at least 0."""
        return max(0.0, sum(self.explained_by(rms)))


@dataclass(frozen=True, slots=True)
class Region:
    """The region of one variable in which the residual stands out most."""

    variable: str
    unit: str
    low: float
    high: float
    """Its range, in that unit."""
    excess: float
    """Mean residual beyond noise, m/s²; against frequency how many times the predicted noise the residual is."""
    excess_unit: str
    sigma: float
    """The excess over its standard deviation under noise alone."""
    share: float | None
    """Of the mean square of the residual, beyond chance; None against frequency."""
    p: float
    """Probability that noise alone gives such a deviation anywhere: times the number of regions of all variables."""
    stretch: tuple[float, float] | None
    """Stretch of time in which most of the excess is seen, s; None against frequency."""


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Density of a residual, the one that noise alone would have, and the region of their ratio."""

    frequency: Array
    """(n,) Hz"""
    density: Array
    """(n,) one-sided, unit of the residual squared per Hz."""
    predicted: Array
    """(n,) density under noise alone, unit of the residual squared per Hz."""
    low: float
    high: float
    """95 % of the ratios of density to prediction lie between, each frequency on its own."""


@dataclass(frozen=True, slots=True)
class ReferenceNoise:
    """White noise of what tells the motion."""

    order: int
    """How many derivatives of the reference make an acceleration: 2 of a position, 1, 0."""
    density: float
    """One-sided, (m s^(order - 2))²/Hz."""

    def as_acceleration(self, f: Array) -> Array:
        """One-sided density of the acceleration that the reference tells, (n,) (m/s²)²/Hz, at `f` Hz."""
        return np.asarray(self.density * (2.0 * np.pi * f) ** (2 * self.order))


@dataclass(frozen=True, slots=True)
class Outside:
    """Readings outside the fitted range of one variable, and the errors inside and outside of it."""

    variable: str
    """a, v, p, temperature or another side channel; "any" for readings outside of any of these."""
    unit: str
    range: tuple[float, float] | None
    """That the fit has seen; None for "any"."""
    count: int
    of: int
    """Settled readings at which the motion is known; ends of the record and holes do not count."""
    one_step: tuple[float | None, float | None]
    """Rms innovation inside and outside, m; None where there is no reading."""
    coast: Mapping[float, tuple[float | None, float | None]]
    """Rezeroed rms drift by horizon: windows wholly inside, windows that leave the range, m."""
    starts: Mapping[float, tuple[int, int]]
    """Windows by horizon, inside and outside."""
    reach: tuple[float, float] | None = None
    """Least and largest value here; None for "any"."""

    @property
    def beyond(self) -> float:
        """Largest distance from the centre of the fitted range, over half of that range; 1 where it is not known."""
        if self.range is None or self.reach is None:
            return 1.0
        centre, half = 0.5 * (self.range[1] + self.range[0]), 0.5 * (self.range[1] - self.range[0])
        return max(self.reach[1] - centre, centre - self.reach[0]) / half if half > 0.0 else math.inf


@dataclass(frozen=True, slots=True)
class RmsInterval:
    """A root mean square over start points, with the interval that holds it in 95 of 100 such records."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """Errors of the true model under noise of the sensor alone."""

    sensor: SensorNoise
    drift: Mapping[float, RmsInterval | None]
    """Rezeroed rms drift by horizon, m; None where the record is too short."""
    simulated: RmsInterval
    """Rms error of the free-running simulation, m."""

    def at(self, horizon: float | None) -> RmsInterval | None:
        """Error at a horizon, or of the simulation."""
        return self.simulated if horizon is None else self.drift.get(horizon)

    def through(self, held_back: Mapping[float, float]) -> NoiseFloor:
        """The floor of a model that leaves such shares of the drift of noise, by horizon."""
        drift = {
            h: spread and RmsInterval(*(held_back.get(h, 1.0) * y for y in (spread.value, spread.low, spread.high)))
            for h, spread in self.drift.items()
        }
        return replace(self, drift=drift)


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """Independent parts of a drift, whose squares add up to its square."""

    horizon: float
    """s"""
    total: RmsInterval
    """Rezeroed rms drift, m; up to infinity where there are too few start points for an interval."""
    noise: RmsInterval
    """Of sensor and reading after position is withheld, m."""
    setup: RmsInterval
    """Start state and re-zeroed constant, from the noise before, m."""
    parameters: RmsInterval
    """Uncertainty of the fitted parameters, m."""
    missing: float
    """What the effects add that the last model of the table has beyond this one, m."""

    @property
    def predicted(self) -> float:
        """What all parts but the unexplained one give together, m."""
        return math.hypot(self.noise.value, self.setup.value, self.parameters.value, self.missing)

    @property
    def unexplained(self) -> RmsInterval:
        """The rest, with the interval of the total, m; 0 where the parts give as much."""
        ends = self.total.value, self.total.low, self.total.high
        return RmsInterval(*(math.sqrt(max(0.0, end**2 - self.predicted**2)) for end in ends))


TWO_SIDED, ONE_SIDED = 1.959964, 1.644854
"""Standard deviations that hold 95 of 100 values, between two limits and below one."""


@dataclass(frozen=True, slots=True)
class Resolved:
    """The error of a corrected output in the directions that a record resolves, and noise in them."""

    coordinates: Array
    """Of the error, along orthonormal directions, (m,) m/s²."""
    covariance: Array
    """Of their noise, (m, m) (m/s²)²."""
    trace_std: float
    """Standard deviation of its trace, because the level of the noise is measured, (m/s²)²."""
    rest: float
    """Sum of the squares of what lies in no direction, (m/s²)²."""
    noise_in_rest: float
    """Its expectation under the noise of the sensor alone, (m/s²)²; 0 where only an upper limit of that is known."""
    rest_std: float
    """Standard deviation of the difference of the two under noise alone, (m/s²)²."""
    samples: int


@dataclass(frozen=True, slots=True)
class SystematicError:
    """Rms systematic error of a corrected output over the motion of a record.

    The square of what noise alone gives in a direction is known and taken off, so the mean square is unbiased. Its
    interval solves (D - x)² = z² (2 tr W² + 4 x w), D what is left, W the covariance of noise in the directions, w that
    along the error.
    """

    rms: float
    """m/s²; 0 where noise alone gives as much."""
    low: float
    high: float
    """Its 95 % interval, m/s²; below the limit of detection 0, and the bound that holds in 95 of 100 records or more,
    never less than that limit."""
    detection_limit: float
    """Noise alone exceeds it in 5 of 100 records, m/s²."""
    unresolved: float
    """Upper 95 % bound of the rms error that no direction resolves, m/s²."""

    @property
    def detected(self) -> bool:
        """Whether the error is larger than its limit of detection."""
        return self.rms > self.detection_limit

    @classmethod
    def of(cls, parts: Sequence[Resolved]) -> SystematicError | None:
        """Error over all recordings, each sample of which counts the same; None where there are none."""
        n = sum(part.samples for part in parts)
        energy = sum(float(part.coordinates @ part.coordinates) for part in parts)
        if not energy > 0.0:
            return None
        spread = sum(2.0 * float(np.sum(part.covariance**2)) + part.trace_std**2 for part in parts)
        above = energy - sum(float(np.trace(part.covariance)) for part in parts)
        along = sum(float(part.coordinates @ part.covariance @ part.coordinates) for part in parts) / energy
        unresolved = max(0.0, sum(part.rest - part.noise_in_rest for part in parts))
        unresolved += ONE_SIDED * math.sqrt(sum(part.rest_std**2 for part in parts))

        def limit(z: float) -> float:
            """Rms of which the estimate is z standard deviations away."""
            middle = above + 2.0 * z**2 * along
            root = math.sqrt(max(0.0, middle**2 - above**2 + z**2 * spread))
            return math.sqrt(max(0.0, middle + math.copysign(root, z)) / n)

        least, rms = math.sqrt(ONE_SIDED * math.sqrt(spread) / n), math.sqrt(max(0.0, above) / n)
        low, high = (limit(-TWO_SIDED), limit(TWO_SIDED)) if rms > least else (0.0, max(least, limit(ONE_SIDED)))
        return cls(rms, low, high, least, math.sqrt(max(0.0, unresolved) / n))


@immutable
@dataclass(frozen=True, slots=True)
class Evaluation(Result):
    """A fitted model against a recording.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> sorted(ac.compare(fit, simulated.recording)[0].coast_rms)
    [1.0, 5.0, 10.0]
    """

    derived: ClassVar[tuple[str, ...]] = ("fit_percent", "drift_floors", "systematic")

    recording: str
    one_step_rms: float
    """m"""
    nis: float | None
    """Mean normalised innovation squared; None where a band was imposed on the fit."""
    k_step_rms: Mapping[int, float | None]
    """Readings ahead -> m."""
    coast_rms: Mapping[float, float | None]
    """Rezeroed: horizon in s -> m; None where the record is too short."""
    coast_frozen_rms: Mapping[float, float | None]
    coast_floor: Mapping[float, float | None]
    coast_starts: Mapping[float, int]
    accel_rms: float
    """Accelerometer-side residual inside the band, m/s²."""
    band: float
    """Hz"""
    simulated: Annotated[tuple[Array, Array, Array], SERIES]
    """Free-running simulation: time (s), measured and simulated position (m)."""
    simulated_std: Annotated[Array, SERIES]
    """Standard deviation of the simulation from noise and start state, m."""
    simulated_rms: float
    """m"""
    residual: Annotated[tuple[Array, Array], SERIES]
    """One-step residuals: time (s), innovation (m)."""
    residual_std: Annotated[Array, SERIES]
    """Predicted standard deviation of each, m."""
    accel_residual: Annotated[tuple[Array, Array], SERIES]
    """Accelerometer-side residual: time (s), m/s²."""
    measured: Annotated[Array, SERIES]
    """Measured output at the times of that residual and within its band, m/s²."""
    setup_bias: tuple[float, float]
    """This run's constant minus the fit's, with standard deviation, m/s²: set-up or turn-on bias."""
    bins: tuple[Bins, ...] = ()
    """Mean residual by regions of time and of the motion, under the noise that the record shows, and its density."""
    worst: str = "the record is too short to say where the model fails"
    """Sentence on the region that stands out most."""
    outside: tuple[Outside, ...] = ()
    """Readings beyond the range that the fit has seen, variable by variable; the last entry is any of them."""
    drifts: Annotated[Mapping[float, tuple[Array, Array]], SERIES] = field(default_factory=dict)
    """Horizon in s -> start points (n,) s, and rezeroed errors (n,) m, of which `coast_rms` is the rms."""
    not_carried: tuple[str, ...] = ()
    """Sentences on effects that belong to the fitted recording and are left out on this one."""
    noise_scores: tuple[NoiseScore, ...] = ()
    """Gain of each effect on noise of the model on this recording."""
    breaks: tuple[float, ...] = ()
    """Instants from which the relation of output and encoder no longer holds, s; the comparison ends there."""
    left_out: tuple[str, ...] = ()
    """Sentences on readings that are known to be wrong and take no part."""
    worst_regions: tuple[Region, ...] = ()
    """Where the model fails: of every variable the region that stands out most, worst first."""
    noise_floor: NoiseFloor | None = None
    """What noise of the sensor alone would give here; the same for all models that are compared under one ruler, but
    where their effects hold simulated motion back."""
    held_back: Mapping[float, float] = field(default_factory=dict)
    """What effects that act on simulated motion leave of the drift of noise, by horizon, s; 1 where there are none."""
    reference_noise: ReferenceNoise | None = None
    """Noise of the reference signal (position, velocity or acceleration), in its own unit."""
    innovations: Annotated[tuple[Array, Array] | None, SERIES] = None
    """Of the weak form, over their standard deviations: time (s), (n,). Where the reference is no position: errors of
    the position that it integrates to are no white noise. Else None."""

    motion: Annotated[Signals | None, NotStored("accelcal.compare makes it from the recording")] = None
    """Smoothed, on a uniform grid from the first reading to the last, on the clock of the model."""
    resolved: Annotated[tuple[Resolved, ...], SERIES] = ()
    """One for each recording; none where the record is too short."""
    largest: tuple[str, RmsInterval] | None = None
    """Variable and size of the mean error of the region that stands out most, m/s², set-up aside, with an interval that
    holds for the largest of all regions of all variables in 95 of 100 records; from 0 where none stands out."""
    reference: tuple[RmsInterval, RmsInterval] | None = None
    """Error of the readings, rms, m: without what the model corrects of them, and with it; None where it corrects
    nothing."""
    budget: ErrorBudget | None = None
    """Parts of the drift, where they were asked for."""

    @property
    def accel_rms_centred(self) -> float:
        """The accelerometer-side residual, set-up aside, m/s²; NaN where the record is too short."""
        residual = self.accel_residual[1]
        return float(np.std(residual)) if len(residual) else math.nan

    @property
    def systematic(self) -> SystematicError | None:
        """Systematic error of the corrected output below `band`; None where the record is too short."""
        return SystematicError.of(self.resolved)

    @property
    def normalised(self) -> tuple[Array, Array]:
        """Times, s, and innovations over their predicted standard deviations."""
        t, e = self.residual
        return (t, np.asarray(e / self.residual_std)) if self.innovations is None else self.innovations

    @property
    def drift_floors(self) -> Mapping[float, float | None]:
        """Floor under the drift by horizon, m: that of the sensor where known, else what the fit takes for noise."""
        if self.noise_floor is None:
            return self.coast_floor
        floors = self.noise_floor.drift
        return {horizon: None if spread is None else spread.value for horizon, spread in floors.items()}

    @property
    def fit_percent(self) -> float | None:
        """Share of the output that the model gives, 100 (1 - |residual| / |output - its mean|), %.

        None where the record is too short.
        """
        spread = float(np.linalg.norm(self.measured - np.mean(self.measured))) if len(self.measured) else 0.0
        return 100.0 * (1.0 - float(np.linalg.norm(self.accel_residual[1])) / spread) if spread > 0.0 else None

    def __repr__(self) -> str:
        drifts = (f"{h:g} s: {drift:.3g} m" for h, drift in self.coast_rms.items() if drift is not None)
        return f"Evaluation({self.recording!r}: rms drift after {', '.join(drifts) or 'no time: too short'})"

    @checked
    def plot(self, figure: FigureName = "overlay", *, theme: Literal["light", "dark"] = "light") -> Figure:
        """Draw one figure of the comparison.

        Parameters
        ----------
        figure : name of the figure, a function of `accelcal.plots`; by default measured and simulated
            output and position over each other, with the residual.
        theme : "light" or "dark".

        Raises
        ------
        MissingExtra
            If matplotlib is not installed.
        ValueError
            If there is no such figure.
        """
        picture: Figure = getattr(face("plots"), figure)(self, theme=theme)
        return picture


HELD_OUT = 0.3
"""Share at the end of a recording that is held out when no other recording is."""
