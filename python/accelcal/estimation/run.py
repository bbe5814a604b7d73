"""One recording prepared for the replay: the readings and samples that both channels cover, and its time scales."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from accelcal import _core
from accelcal.data import (
    ANGULAR_ACCELERATION,
    ARM_ANGLE,
    DERIVED,
    GRAVITY,
    GRAVITY_NOISE,
    LEVERS,
    POSITION_ORDER,
    RATES,
    TILTS,
    Array,
    Channel,
    Flags,
    PositionStep,
    Recording,
    RecordingError,
    Rig,
    instant,
    require_few_holes,
    require_reference,
    require_usable,
    usual_step,
)
from accelcal.data.arrays import Answer, Unchanged, median_step, white_variance
from accelcal.data.orientation import HOLE, holes
from accelcal.data.quality import reading_step, require_pace
from accelcal.estimation.channel_filters import ChannelFilters, uniform
from accelcal.estimation.readings import (
    MIN_READINGS,
    AngleError,
    distinct_readings,
    readings_apart,
    runs_of_one_count,
    spikes,
)
from accelcal.estimation.values import Noise, Values
from accelcal.signals.processing import cubic, even_times, low_pass, motion_bandwidth, resample, spectral_density
from accelcal.signals.series import FilledSeries, fill_gaps, grid_step, interpolation_spread
from accelcal.signals.signals import Origins
from accelcal.signals.unresolved import Jumps, jumps, lost_velocity, prediction_scores


@dataclass(frozen=True, eq=False)
class AxisGravity:
    """Reading of an ideal sensor on the axis while the position does not accelerate, with the sign of the stage."""

    constant: float
    """Of the declared axis, m/s²; used where nothing is recorded."""
    channel: Channel | None
    """On the clock of the position, m/s²."""
    filters: ChannelFilters
    unchanged: Unchanged = field(default_factory=Unchanged)

    def at(self, t: Array) -> Array | float:
        """At times t, (n,) m/s²; a number where it is constant."""
        return self.constant if self.channel is None else resample(self.channel, t)

    def within(self, t: Array, step: float, cutoff: float) -> Array | float:
        """At uniform times `step` s apart, up to a bandwidth in Hz, (n,) m/s²."""
        if self.channel is None:
            return self.constant
        return low_pass(np.asarray(self.unchanged("at", (t,), lambda: self.at(t))), 1.0 / step, cutoff)

    def behind_high_passes(self, t: Array, step: float, cutoff: float) -> Array | float:
        """The same as the output shows it, behind its high-passes."""
        if self.channel is None:
            return self.constant * self.filters.at_rest
        return self.filters.behind_high_passes(np.asarray(self.within(t, step, cutoff)), step)

    def integrals(self, t: Array) -> tuple[Array, Array]:
        """Velocity (m/s) and, beyond it, position (m) gained over the interval that ends at each of the times, (n,)."""
        if self.channel is None:
            level = self.constant * self.filters.at_rest
            if level == 0.0:
                return np.zeros(len(t)), np.zeros(len(t))
            h = np.diff(t, prepend=t[0])
            return level * h, level * h**2 / 2.0
        channel = self._covering(t)
        once, twice, covered = _core.drive(
            channel.t - t[0], channel.y, t - t[0], how="cubic", tau=0.0, delay=0.0, hole=HOLE * float(t[-1] - t[0])
        )
        once[~covered] = twice[~covered] = 0.0
        return once, twice

    def _covering(self, t: Array) -> Channel:
        """The channel behind the filters of both channels, held beyond its ends where the times reach farther."""
        assert self.channel is not None
        channel, step = self.channel, median_step(self.channel.t)
        if self.filters.acts:
            at, y = uniform(channel.t, channel.y, step)
            channel = Channel(channel.name, at, self.filters.behind(y, step), channel.unit)
        before = np.array([t[0] - 2.0 * step, t[0] - step]) if channel.t[0] > t[0] else t[:0]
        after = np.array([t[-1] + step, t[-1] + 2.0 * step]) if channel.t[-1] < t[-1] else t[:0]
        stamps = np.concatenate([before, channel.t, after])
        return Channel(channel.name, stamps, np.interp(stamps, channel.t, channel.y), channel.unit)


JUMP_WINDOW = 1.5
"""Samples to either side of a jump over which its error is spread."""
LONG = 1_000_000
"""Readings or samples from which on memory that is not used at the moment is given back and the filter runs part by
part."""
CURVATURE = 1.0 / 64.0
"""Error of a cubic over a hole, as a share of the third difference of samples a hole apart, which bounds it."""


def extra_density(t: Array, accel: Channel, step: float, jumps: Jumps, filled: FilledSeries) -> Array:
    """Density of process noise, beyond that of the record, over the interval before each reading, (n,) (m/s²)²/Hz.

    Derivations 6.6. A jump of the motion between two samples, and the motion over a hole, change the velocity by
    an amount that interpolation cannot recover.

    Parameters
    ----------
    t : (n,) times of the readings, s.
    accel, step : the output, m/s², and the usual spacing of its samples, s.
    jumps, filled : what its samples do not resolve, and what was filled in.
    """
    spans = [jump_variances(jumps, step)] if len(jumps.t) else []
    spans += [hole_variances(accel, step, filled)] if len(filled.begin) else []
    if not spans:
        return np.zeros(len(t))
    h = np.diff(t, prepend=t[0])
    gained = np.zeros_like(t)
    for begin, end, variance in spans:
        edges = np.column_stack([begin, end]).ravel()
        total = np.cumsum(variance)
        reached = np.column_stack([np.append(0.0, total[:-1]), total]).ravel()
        gained += np.diff(np.interp(t, edges, reached, left=0.0), prepend=0.0)
    density, there = np.zeros(len(t)), np.flatnonzero((gained > 0.0) & (h > 0.0))
    density[there] = gained[there] / h[there]  # pages of nothing but zeros take no memory
    return density


def jump_variances(jumps: Jumps, step: float) -> tuple[Array, Array, Array]:
    """Spans about the jumps of the motion, s, and variance of the velocity that is lost in each, (m/s)²."""
    window = JUMP_WINDOW * step
    return jumps.t - window, jumps.t + window, lost_velocity(jumps, step) ** 2


def hole_variances(accel: Channel, step: float, filled: FilledSeries) -> tuple[Array, Array, Array]:
    """Spans without samples, s, and variance of the velocity that is lost in each beyond the usual, (m/s)²."""
    sigma = interpolation_spread(accel.t, accel.y)
    length = filled.end - filled.begin
    nodes = filled.begin[:, None] + length[:, None] * np.array([-1.0, 0.0, 1.0, 2.0])
    curved = np.abs(np.interp(nodes, filled.t, filled.y) @ np.array([1.0, -3.0, 3.0, -1.0])) * CURVATURE * length
    motion = np.where(filled.filled, 0.0, curved)
    return filled.begin, filled.end, filled.noise * (sigma * step) ** 2 + motion**2


SETTLE = 5.0
"""Time constants of the filter after a start whose innovations are not used."""
TURNED_GRAVITY = 0.05
"""Standard deviation of gravity along the axis from which on a body turns, m/s²: 5 mrad, which no attitude errs by."""
TOO_GOOD = 0.2
"""Crossover in sampling rates of the output above which readings are thinned: closer to it the noise of two readings is
that of the same samples, interpolated, and no longer white from reading to reading."""
SAMPLES_BETWEEN = 8, 16
"""Samples of the output between two readings that are kept then: least and most. Fewer would let errors of
interpolation between samples into every other reading."""
MOTION_SHARE = 0.9
"""Share of the power of the output, noise left out, below the frequency that the kept readings should resolve."""
NOISE_SAMPLES = 20_000
"""Samples of a channel from which its noise is estimated in advance."""
NOISE_SEGMENT = 1024
"""Readings in a segment of the spectrum that shows the noise of a reference."""
NYQUIST = 0.5
"""In rates."""
FIRST = 4
"""First readings of a rest whose noise is not that of a rest: position and speed follow from two, and as many may hold
motion within a count. [readings; tests/estimation/test_coarse_counts.py]"""
MOST_CROSSOVER = 2.0
"""Crossover in rates of the readings beyond which a smaller variance of a reading changes nothing: gains are 1."""
LEAST_PRIOR_SHARE = 1e-12
"""Variance of a reading over that which the diffuse start adds in one step, least: the filter subtracts the two."""
FAR_FROM_ZERO = 3.0
"""An encoder whose zero is farther from the travel than this many travels is counted from the middle of it."""


@dataclass(frozen=True, slots=True)
class Unpredicted:
    """Standard deviations of what eight neighbours do not predict of a sample: noise, where no motion is left."""

    sample: float
    """Of the output, m/s²."""
    reading: float
    """Of the position, no less than what its counts round, m."""
    crossover: float
    """Where both determine the acceleration equally well, in sampling rates of the output; 0 where one shows none."""

    @classmethod
    def of(cls, t: Array, z: Array, accel: Channel, step: float, resolution: float) -> Unpredicted:
        """Of readings (n,) of a `resolution`, m, beside an output whose samples come every `step`, s."""
        few = slice(0, NOISE_SAMPLES)
        sample, reading = (interpolation_spread(at[few], y[few]) for at, y in ((accel.t, accel.y), (t, z)))
        reading = math.hypot(reading, resolution / math.sqrt(12.0))
        if reading <= 0.0 or sample <= 0.0:  # nothing to compare
            return cls(sample, reading, 0.0)
        between = median_step(t)
        return cls(sample, reading, (sample**2 * step**5 / (reading**2 * between)) ** 0.25 / (2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class RunSamples:
    """Samples and readings of a prepared recording, and what follows from them alone."""

    recording: Recording
    origins: Origins
    t: Array
    """Times of the readings, (n,) s."""
    z: Array
    """Readings, glitches left out, (n,) m."""
    accel: Channel
    """Output over the readings and a little beyond."""
    accel_step: float
    """Usual spacing of the samples of the output, s."""
    reading_step: float
    """Median spacing of the readings, s."""
    left_out: int
    """Readings that jump away and come back."""
    rounding: float = 0.0
    """One count of an encoder whose noise does not dither its counts, m; else 0."""
    restarts: tuple[float, ...] = ()
    """Instants from which the position counts from another zero, s."""
    every: int = 1
    """One reading in so many is used."""
    read: tuple[Array, Array] | None = None
    """Times (s) and positions (m) of all readings, where only some are used."""
    engine: str = "replay"
    """Name of the engine that fits it."""
    unpredicted: Unpredicted = Unpredicted(0.0, 0.0, 0.0)
    """Noise of both channels before anything is fitted."""
    inside: tuple[int, int] = (0, 0)
    """First reading of the recording that was asked for, and the one behind the last."""
    asked: tuple[float | None, float | None] = (None, None)
    """Start and end that were asked for, s."""
    before: PreparedRun | None = None
    """The same with every repeated count of a resting encoder; None where nothing was left out."""
    answers: dict[Hashable, Any] = field(default_factory=dict)
    """Answers to questions on the samples of the output, for all runs with the same ones."""

    def once(self, question: Hashable, find: Callable[[], Answer]) -> Answer:
        """The answer to a question about the samples, found once."""
        if question not in self.answers:
            self.answers[question] = find()
        answer: Answer = self.answers[question]
        return answer

    @cached_property
    def order(self) -> int:
        """How many derivatives of what the reference reads make an acceleration: 2 of a position, 1, 0."""
        reference = self.recording.reference
        return POSITION_ORDER if reference is None else require_reference(reference)[0]

    @property
    def accounted_steps(self) -> tuple[PositionStep, ...]:
        """Jumps of the position behind which the replay starts anew, so that no effect has to account for them."""
        return tuple(step for step in self.recording.position_steps if step.time in self.restarts)

    @property
    def reference_readings(self) -> tuple[Array, Array]:
        """Times (s) of all readings, and what the reference reads then, in its own unit."""
        reference, (t, z) = self.recording.reference, self.all_readings
        return (t, z) if reference is None else (t, reference.y[np.searchsorted(reference.t, t)])

    @property
    def all_readings(self) -> tuple[Array, Array]:
        """Times (s) and positions (m) of all readings, those among them that are not used."""
        return (self.t, self.z) if self.read is None else self.read

    @property
    def rig(self) -> Rig:
        """How the recording was made."""
        return self.recording.rig

    def tau(self, values: Values) -> float:
        """Time constant of the low-pass at the values of a model, s; 0 where there is none."""
        return max(0.0, self.rig.lowpass_tau + values.lowpass_error)

    @cached_property
    def jumps(self) -> Jumps:
        """Instants at which the motion changes faster than the samples of the output resolve."""
        t, y = self.accel.t, self.accel.y

        def find() -> Jumps:
            scores = prediction_scores(t, y)
            if len(t) < LONG:
                self.answers["noise of a sample"] = scores[1]
            return jumps(t, y, self.accel_step, self.rig.lowpass_tau, scores)

        return self.once("jumps of the motion", find)

    @property
    def sample_noise(self) -> Array:
        """Noise of each sample of the output against its neighbours, (n,) m/s²."""
        t, y = self.accel.t, self.accel.y
        held = self.answers.get("noise of a sample")
        return prediction_scores(t, y)[1] if held is None else held

    @cached_property
    def filled(self) -> FilledSeries:
        """Output with up to three lost samples in a row filled in: what is integrated."""
        return fill_gaps(self.accel.t, self.accel.y, self.accel_step)

    @property
    def whole(self) -> Channel:
        """The same as a channel."""
        filled, accel = self.filled, self.accel
        return accel if filled.t is accel.t else Channel(accel.name, filled.t, filled.y, accel.unit)

    @cached_property
    def extra_q(self) -> Array:
        """Density of process noise over the interval before each reading beyond that of the record, (m/s²)²/Hz."""
        extra = extra_density(self.t, self.accel, self.accel_step, self.jumps, self.filled)
        of_attitude = self.recording.side.get(GRAVITY_NOISE)
        if self.angle_error is None:
            return extra if of_attitude is None else extra + np.interp(self.t, of_attitude.t, of_attitude.y)
        lever = self.recording.side[TILTS[1]]
        slope = math.cos(self.rig.axle or 0.0) * np.interp(self.t, lever.t, lever.y)
        step = median_step(lever.t)
        return np.asarray(extra + self.angle_error.variance_at(self.t, step) * slope**2 * step)

    @cached_property
    def angle_error(self) -> AngleError | None:
        """What rounding makes of the angle of an arm; None where there is none, or it does not lie on a grid."""
        channel = self.recording.side.get(ARM_ANGLE)
        return None if channel is None else AngleError.of(channel.t, channel.y)

    @property
    def attitude_density(self) -> float:
        """Usual one-sided density of what noise of an attitude adds to that of the output, (m/s²)/sqrt(Hz)."""
        of_attitude = self.recording.side.get(GRAVITY_NOISE)
        return 0.0 if of_attitude is None else math.sqrt(2.0 * float(np.median(of_attitude.y)))

    @cached_property
    def filters(self) -> ChannelFilters:
        """Declared filters beside the one RC that the drive inverts itself."""
        return ChannelFilters(self.rig, 1.0 / self.accel_step, 1.0 / self.reading_step)

    @cached_property
    def gravity(self) -> AxisGravity:
        """Specific force at rest along the axis."""
        return AxisGravity(self.rig.gravity, self.recording.side.get(GRAVITY), self.filters)

    @property
    def turns(self) -> bool:
        """Whether gravity along the axis is recorded and changes: a sensor on an axle is not at rest."""
        gravity = self.recording.side.get(GRAVITY)
        return gravity is not None and float(np.std(gravity.y)) > TURNED_GRAVITY

    @property
    def gravity_integrals(self) -> tuple[Array, Array]:
        """Velocity (m/s) and position (m) that it takes from the interval before each reading, (n,)."""
        return self.turning_integrals if self.gravity.channel else self.gravity.integrals(self.t)

    @cached_property
    def turning_integrals(self) -> tuple[Array, Array]:
        """The same of a recorded one, which take a while; those of a constant take memory."""
        return self.gravity.integrals(self.t)

    @cached_property
    def undone(self) -> Channel:
        """The output with declared low-passes inverted, but for one RC alone, which the drive inverts."""
        return self.filters.undone(self.whole)

    @cached_property
    def driving(self) -> Channel:
        """The output that drives the motion which the readings show, (n,) m/s²."""
        return self.filters.driving(self.whole)

    @cached_property
    def blocked(self) -> Array:
        """Part of the readings that the high-passes of the output would remove, (n,) m."""
        return self.filters.blocked(self.t, self.z)

    @cached_property
    def readings(self) -> Array:
        """Readings behind the high-passes of the output; without any the readings themselves, (n,) m."""
        return self.z - self.blocked if self.filters.blocking else self.z

    @cached_property
    def speed(self) -> float:
        """Bound on the speed of the stage for the diffuse start, m/s.

        Three times the speed of the first ten readings, and what the output could add in a second; later readings are
        not used.
        """
        tenth = min(10, len(self.t) - 1)
        initial = abs(self.z[tenth] - self.z[0]) / (self.t[tenth] - self.t[0])
        return float(3.0 * initial + np.ptp(self.accel.y))

    @cached_property
    def least_step(self) -> float:
        """Step of the encoder, declared or as its readings show it, m; 0 when neither is known."""
        return reading_step(self.z, self.rig.resolution) if self.order == POSITION_ORDER else 0.0

    @cached_property
    def confirmed(self) -> float:
        """Frequency up to which a reference that is an acceleration shows motion above its own noise, Hz.

        The output is as noisy, and sees vibration that the reference does not.
        """
        t, y = self.reference_readings
        few = slice(0, NOISE_SAMPLES)
        rate = (len(t[few]) - 1) / float(t[few][-1] - t[0])
        uniform = cubic(t, y, even_times(t[0], t[few][-1], 1.0 / rate))
        f, density = spectral_density(uniform, rate, min(len(uniform), NOISE_SEGMENT))
        floor = float(np.median(density[f > 0.5 * NYQUIST * rate]))
        huge = 1e12 * floor  # no position takes part
        bandwidth = motion_bandwidth(uniform, rate, q=0.5 * floor, reading_density=huge, crossover=0.5 * NYQUIST * rate)
        return bandwidth.cutoff

    @cached_property
    def third_difference_variance(self) -> float:
        """Variance of the readings from their third differences, m²: a bound, since motion adds to it."""
        return white_variance(self.z)

    @property
    def reading_variance_guess(self) -> float:
        """Rough variance of one reading, m²."""
        return max(self.third_difference_variance, self.least_step**2 / 12.0, 1e-24)

    @property
    def least_reading_variance(self) -> float:
        """Variance below which no reading is taken to be, m²: that of rounding to one encoder step.

        Third differences that scatter less than rounding would make them show that it is smaller; below a twentieth,
        where an encoder rests on one count, they show nothing.
        """
        rounding = self.least_step**2 / 12.0
        return max(min(rounding, self.third_difference_variance), rounding / 20.0, 1e-30)

    def prior(self, r: float) -> tuple[float, float, float, float]:
        """Mean of v and covariance (pp, pv, vv) before the first reading."""
        resolved = r / self.reading_step**2
        return 0.0, 1e4 * r, 0.0, min(self.speed**2, resolved / LEAST_PRIOR_SHARE) + resolved

    def crossover(self, noise: Noise) -> float:
        """Frequency at which both channels determine the acceleration equally well, Hz (derivations 3.4)."""
        return float((noise.q / (noise.r * self.reading_step)) ** 0.25 / (2.0 * np.pi))

    def wait(self, noise: Noise) -> float:
        """Time after a start during which innovations are not used, s: five time constants of the filter."""
        return SETTLE / (2.0 * np.pi * self.crossover(noise))


@dataclass(frozen=True, eq=False)
class PreparedRun(RunSamples):
    """A recording prepared for the replay; `prepare` makes one. Nothing in it changes during a fit."""

    @cached_property
    def unchanged(self) -> Unchanged:
        """Results that the rounds of a fit derive from the samples."""
        return Unchanged()

    def but(self, **changes: Any) -> PreparedRun:
        """A copy with another engine, origins or recording of the same samples: what was computed of them stays."""
        run_copy = copy.copy(self)
        for name, value in changes.items():
            object.__setattr__(run_copy, name, value)
        return run_copy

    @property
    def rests(self) -> tuple[Array, Array, Array]:
        """Begin and end (s) of each rest of an encoder that noise does not dither, and its count, m; (rests,) each.

        Those are the runs of one count of which readings were left out.
        """
        t, z = self.complete.t, self.complete.z
        begins, lengths = runs_of_one_count(z)
        long = lengths > runs_of_one_count(self.z)[1]
        first, last = begins[long], (begins + lengths)[long] - 1
        return t[first], t[last], z[first]

    def reading_variance_floor(self, q: float, step: float | None = None) -> float:
        """Least variance of a reading at a process density, m²: of a smooth reference the likelihood knows no other.

        `step` is the spacing of the readings, s; by default of those that are used.
        """
        step = self.reading_step if step is None else step
        if self.order == 0:
            return q / ((2.0 * np.pi * self.confirmed) ** 4 * step)
        return max(self.least_reading_variance, self.resolved_variance(q, step))

    def resolved_variance(self, q: float, step: float | None = None) -> float:
        """Variance of a reading at a process density below which none changes the gains, m²."""
        return q * (step or self.reading_step) ** 3 / (2.0 * np.pi * MOST_CROSSOVER) ** 4

    def held(self, still: Flags) -> Flags:
        """Readings of these rests among those where the stage stands still (n,), behind the first few: at the very
        first ones the motion ends within a count."""
        begins, ends, _ = self.rests
        place = np.searchsorted(begins, self.t, side="right") - 1
        inside = still & (place >= 0) & (self.t <= np.append(ends, -np.inf)[place])
        return np.asarray(np.convolve(inside, np.ones(FIRST + 1))[: len(inside)] > FIRST)

    @property
    def complete(self) -> PreparedRun:
        """The run with every reading that is used, repeated counts among them."""
        return self.before or self

    def with_steps(self, steps: Sequence[PositionStep]) -> PreparedRun:
        """The run with jumps of its position."""
        recording, t = replace(self.recording, position_steps=tuple(steps)), self.complete.all_readings[0]
        starts = tuple(time for time in new_starts(recording, t) if t[0] < time <= self.complete.t[-1])
        return without_repeated_counts(replace(self.complete, recording=recording, restarts=starts))

    def anew(self, recording: Recording) -> PreparedRun:
        """The same part of a recording with other readings, prepared."""
        return prepare(recording, start=self.asked[0], end=self.asked[1])

    def thinned(self, too_good: float) -> PreparedRun:
        """The run with a part of its readings, where they are so good that the crossover, in sampling rates of the
        output, is above a limit; `read` then has all."""
        every = reading_stride(self.t, self.accel, self.accel_step, self.unpredicted, too_good)
        if every == 1:
            return self
        t, z = np.ascontiguousarray(self.t[::every]), np.ascontiguousarray(self.z[::every])
        step, starts = median_step(t), tuple(time for time in self.restarts if time <= t[-1])
        return replace(self, t=t, z=z, reading_step=step, restarts=starts, every=every, read=(self.t, self.z))


Source = Recording | PreparedRun
"""A recording, or a run of it that was prepared before."""


def recording_of(source: Source) -> Recording:
    """The recording itself."""
    return source.recording if isinstance(source, PreparedRun) else source


def prepared(
    source: Source, origins: Origins | None = None, *, start: float | None = None, end: float | None = None
) -> PreparedRun:
    """A run at these origins, by default its own, with the readings in [start, end], s; one that was prepared before
    is not prepared again for the same readings.

    Raises
    ------
    RecordingError
        From `prepare`.
    """
    if isinstance(source, PreparedRun) and source.inside == inside(source.recording, start, end)[0]:
        return source if origins is None else source.but(origins=origins)
    return prepare(recording_of(source), origins, start=start, end=end)


def inside(recording: Recording, start: float | None, end: float | None) -> tuple[tuple[int, int], tuple[float, float]]:
    """Readings of the position in [start, end] and beside samples of the output, and the instants between which they
    are, s."""
    accel, position = recording.accel, recording.position
    first = max(accel.t[0], position.t[0], -np.inf if start is None else start)
    last = min(accel.t[-1], position.t[-1], np.inf if end is None else end)
    begin, stop = np.searchsorted(position.t, [first, np.nextafter(last, np.inf)])
    return (int(begin), int(stop)), (first, last)


def prepare(
    recording: Recording,
    origins: Origins | None = None,
    *,
    start: float | None = None,
    end: float | None = None,
    withheld: float = np.inf,
) -> PreparedRun:
    """Prepare a recording for the replay.

    Parameters
    ----------
    recording : what was measured.
    origins : zero points of t, p and side channels; by default those that suit the recording.
    start, end : s, optional; only readings in [start, end] on the position clock are used.
    withheld : s; readings after this time are not looked at when glitches are sought, and no position step among them
        is known.

    Raises
    ------
    RecordingError
        If the channels are not usable, do not overlap, or fewer than 16 readings remain.
    """
    require_usable(recording)
    accel, position = recording.accel, recording.position
    among, (first, last) = inside(recording, start, end)
    every = slice(*among)
    values = np.where(position.t[every] > withheld, np.nan, position.y[every])
    good = ~spikes(position.t[every], values, accel)
    left_out = int(np.sum(~good))
    rows = good if left_out else slice(None)  # a view where there is nothing to leave out
    t: Array = np.ascontiguousarray(position.t[every][rows])
    z: Array = np.ascontiguousarray(position.y[every][rows])
    if len(t) < MIN_READINGS:
        raise RecordingError(
            f"{recording.title}: {len(t)} encoder readings between {instant(first)} s and "
            f"{instant(last)} s, at least {MIN_READINGS} are needed; record longer or widen start and end (--from, "
            "--to)"
        )
    for name, stamps in (("accel", accel.t[:4096]), ("position", t)):
        require_pace(recording.title, name, stamps)
    step = median_step(accel.t[:4096])
    require_few_holes(recording, last - first, step)
    filters = ChannelFilters(recording.rig, 1.0 / step, 1.0 / median_step(t))
    margin = 64 * step + 2.0 * filters.kernel
    covered = slice(*np.searchsorted(accel.t, [t[0] - margin, t[-1] + margin]))
    part = accel  # a channel copies its samples
    if covered != slice(0, len(accel)):
        part = Channel(accel.name, accel.t[covered], accel.y[covered], accel.unit)
    period = usual_step(part.t)
    resolution = recording.rig.resolution or grid_step(z[:NOISE_SAMPLES])
    unpredicted = Unpredicted.of(t, z, part, period, resolution)
    starts = new_starts(recording, t)
    run = PreparedRun(
        recording=recording,
        origins=origins if origins is not None else natural_origins(recording),
        t=t,
        z=z,
        accel=part,
        accel_step=period,
        reading_step=median_step(t),
        left_out=left_out,
        restarts=tuple(time for time in starts if t[0] < time <= min(t[-1], withheld)),
        unpredicted=unpredicted,
        inside=among,
        asked=(start, end),
    ).thinned(TOO_GOOD)
    return without_repeated_counts(run)


def new_starts(recording: Recording, t: Array) -> list[float]:
    """Instants from which the position counts from another zero, s: its steps, and the ends of holes on a turning body,
    whose acceleration within them nothing tells."""
    turning = any(name in recording.side for name in LEVERS)
    ends = [float(t[k]) for k in holes(t)] if turning else []
    return sorted({*(step.time for step in recording.position_steps), *ends})


def without_repeated_counts(run: PreparedRun) -> PreparedRun:
    """The run with as many readings of each rest as a coarse encoder is worth; the run itself where noise dithers."""
    if run.least_step == 0.0:
        return run
    noise = run.rig.sensor.noise
    apart = readings_apart(run.accel.y, run.accel_step, noise, run.reading_step, run.least_step)
    t, z = distinct_readings(run.t, run.z, apart)
    if t is run.t or len(t) < MIN_READINGS:
        return run
    step = median_step(t)
    return replace(run, t=t, z=z, reading_step=step, rounding=run.least_step, read=None, before=run)


def reading_stride(t: Array, accel: Channel, step: float, unpredicted: Unpredicted, too_good: float) -> int:
    """One reading in how many is used: all, or `SAMPLES_BETWEEN` samples apart where the readings are too good, the
    fewer, the faster the motion; samples of the output come every `step`, s."""
    if unpredicted.crossover < too_good:
        return 1
    between, sample = median_step(t), unpredicted.sample
    apart = min(max(0.5 / (motion_bound(accel.y, sample) + 1e-12), SAMPLES_BETWEEN[0]), SAMPLES_BETWEEN[1])
    wanted = math.ceil(apart * step / between)
    return 1 if len(t) // wanted < MIN_READINGS else max(1, wanted)


def motion_bound(y: Array, noise: float) -> float:
    """Frequency in sampling rates below which most of the power of an output lies beyond white noise of this
    standard deviation."""
    power = np.abs(np.fft.rfft(y - np.mean(y))) ** 2
    below = np.cumsum(np.maximum(power - 2.0 * noise**2 * len(y), 0.0))
    return float(np.searchsorted(below, MOTION_SHARE * below[-1])) / len(y)


def natural_origins(recording: Recording) -> Origins:
    """Zero points that suit a record: its first reading, the encoder's own zero, and the means of its channels."""
    temperature = recording.side.get("temperature")
    y = recording.position.y
    middle = float(np.mean(y))
    return Origins(
        t=float(recording.position.t[0]),
        p=middle if abs(middle) > FAR_FROM_ZERO * float(np.ptp(y)) else 0.0,
        temperature=float(np.mean(temperature.y)) if temperature is not None else 0.0,
        side={name: float(np.mean(recording.side[name].y)) for name in centred_channels(recording)},
    )


def centred_channels(recording: Recording) -> list[str]:
    """Side channels whose effects are about their mean. A rate has a zero of its own, and what is derived from an
    orientation is part of the model of the motion."""
    return [name for name in recording.side if name not in ("temperature", *DERIVED, *RATES, ANGULAR_ACCELERATION)]


def side_means(runs: Sequence[PreparedRun]) -> dict[str, float]:
    """Mean of each side channel over what is used of all runs, in its unit.

    A constant of a channel, such as gravity across the axis, is in the bias of a model. In its effects, it would hide
    what the changes of the channel do.
    """
    used: dict[str, list[Array]] = {}
    for run in runs:
        for name in centred_channels(run.recording):
            channel = run.recording.side[name]
            used.setdefault(name, []).append(channel.y[(run.t[0] <= channel.t) & (channel.t <= run.t[-1])])
    together = {name: np.concatenate(parts) for name, parts in used.items()}
    return {name: float(np.mean(y)) for name, y in together.items() if len(y)}
