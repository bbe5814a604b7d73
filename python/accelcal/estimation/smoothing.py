"""Smoothed motion at the accelerometer's rate, thinned to what its bandwidth needs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from accelcal.data import DERIVED, GRAVITY, LEVERS, Array, Flags, batches, root_mean_square
from accelcal.data.orientation import HOLE
from accelcal.effects import is_local
from accelcal.estimation.drive import DriveIntegrals
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise, Values
from accelcal.model import evaluate
from accelcal.signals.processing import (
    GRID_PER_CUTOFF,
    cosine_window,
    cubic,
    derivative,
    even_times,
    integral,
    low_pass,
    motion_bandwidth,
    resample,
)
from accelcal.signals.signals import Signals

NEGLIGIBLE = 0.01
"""Share of noise in the power of the jerk up to which the motion is left as it is: it costs half as much of a standard
deviation."""
STANDS_ABOVE = 3.0
"""Mean density over that of the noise from which a frequency belongs to the motion: a mean of 13 exponential numbers
exceeds it once in a million frequencies."""
STANDS_ABOVE_ONCE = 20.0
"""The same in one segment, so that a short motion counts: an exponential number exceeds it once in 5e8."""
SEGMENTS = 8
"""Least number of segments (without their overlap) that a spectrum is the mean of."""
LONGEST = 16.0
"""Longest segment, s: frequencies are then told apart better than any motion of a stage needs."""
TREND = 2
"""Frequency bins at zero that always belong to the motion: the window spreads a trend over them."""
END_PERIODS = 2.0
"""Periods of the bandwidth at either end within which a low-pass has no noise of the other side to average."""
FEWEST = 64
"""Samples of a segment below which no spectrum is taken."""
BATCH = 256
"""Segments that are transformed at a time."""


def left_density(run: PreparedRun, noise: Noise, f: Array) -> Array:
    """One-sided density of the noise that smoothing leaves in the acceleration (channels in parallel), (m/s²)²/Hz."""
    noise = noise.usual
    encoder = noise.r * run.reading_step * (2.0 * np.pi * f) ** 4
    return np.asarray(2.0 * noise.q * encoder / (noise.q + encoder))


@dataclass(frozen=True, slots=True)
class Shrinkage:
    """Share of the smoothed acceleration that is kept at each frequency: Wiener's, 1 - noise/density, of the motion."""

    f: Array
    """(m,) Hz"""
    share: Array
    """(m,)"""
    rate: float
    """Of the samples that it is applied to, Hz."""
    edge: int
    """Samples at either end that smoothing determines badly."""

    @classmethod
    def of(
        cls, jerk: Array, rate: float, run: PreparedRun, noise: Noise, cutoff: float, delay: float
    ) -> Shrinkage | None:
        """Share of each frequency for a motion of bandwidth `cutoff`, Hz, with this jerk, (n,) m/s³ at `rate`, Hz,
        of an output that is late by `delay`, s.

        None where noise is a negligible share of the jerk, which holds the most of it.

        Notes
        -----
        The columns of what the motion hardly excites would otherwise consist of noise, and X'X would count that noise
        as information (derivations 3.5). Noise that smoothing leaves is not correlated with the innovations at any
        frequency, so a filter without phase keeps estimates free of bias.
        """
        below: Array = np.linspace(cutoff / 400.0, cutoff, 400)
        left = float(np.sum((2.0 * np.pi * below) ** 2 * left_density(run, noise, below)) * below[0])
        edge = int((END_PERIODS / cutoff + abs(delay)) * rate)
        jerk = jerk[edge : len(jerk) - edge]
        segment = int(min(len(jerk) // SEGMENTS, LONGEST * rate))
        if segment < FEWEST or left < NEGLIGIBLE * float(np.mean(jerk**2)):
            return None
        mean, largest = periodograms(jerk, rate, segment)
        f: Array = np.arange(len(mean), dtype=np.float64) * (rate / segment)
        noise_density = (2.0 * np.pi * f) ** 2 * left_density(run, noise, f)
        with np.errstate(divide="ignore", invalid="ignore"):
            above, once = mean / noise_density, largest / noise_density
        motion: Flags = (above > STANDS_ABOVE) | (once > STANDS_ABOVE_ONCE)
        share = np.where(motion, 1.0 - 1.0 / np.maximum(above, STANDS_ABOVE), 0.0)
        share[: TREND + 1] = 1.0
        return cls(f, share, rate, edge)

    def at(self, f: Array) -> Array:
        """Share at frequencies, Hz."""
        return np.asarray(np.interp(f, self.f, self.share))

    def __call__(self, y: Array) -> Array:
        """Filter velocity or acceleration (n,) without phase; in the edges and beyond, what lies inside is mirrored.

        Smoothed noise is a second derivative; a mirrored acceleration has its low frequencies, a mirrored jerk has not.
        """
        edge = min(self.edge, (len(y) - 1) // 3)  # what is mirrored must be there
        inner = y[edge : len(y) - edge]
        n = min(len(inner) - 1, edge + 2 * len(self.f))
        padded = np.concatenate([inner[n:0:-1], inner, inner[-2 : -n - 2 : -1]])
        length = scipy.fft.next_fast_len(len(padded), real=True)
        spectrum = scipy.fft.rfft(padded - inner[0], length)
        spectrum *= self.at(np.asarray(np.fft.rfftfreq(length, 1.0 / self.rate), dtype=np.float64))
        begin = n - edge
        return np.asarray(scipy.fft.irfft(spectrum, length)[begin : begin + len(y)] + inner[0])


def periodograms(y: Array, rate: float, segment: int) -> tuple[Array, Array]:
    """One-sided densities of segments that overlap by half, behind a Hann window: their mean and, at each frequency,
    the largest, (segment // 2 + 1,) each."""
    window = cosine_window(segment)
    segments = np.lib.stride_tricks.sliding_window_view(y, segment)[:: segment - segment // 2]
    total, largest = np.zeros(segment // 2 + 1), np.zeros(segment // 2 + 1)
    for batch in batches(len(segments), BATCH):
        part = segments[batch]
        spectra = scipy.fft.rfft((part - part.mean(axis=1, keepdims=True)) * window, axis=1)
        density = 2.0 * (spectra.real**2 + spectra.imag**2) / (rate * float(window @ window))
        total += density.sum(axis=0)
        np.maximum(largest, density.max(axis=0), out=largest)
    return total / len(segments), largest


PASSED = 1.25
"""Corner of the low-pass of motion over its bandwidth, 1.4 times the highest frequency in it, where the model has
effects: it then passes that to 1e-4, of which a cubic makes three times as much. Without effects only columns are
evaluated on the motion, and harmonics that the model lacks lie above it."""
CORRECTION_LEFT = 1e-5
"""What a further correction for the effects may move, over the standard deviation of the acceleration."""
MOST_CORRECTIONS = 40
"""Corrections of the output for the effects; as many are needed where these exceed the acceleration."""


def corner_of(values: Values, cutoff: float) -> float:
    """Corner of the low-pass of a motion of a bandwidth, Hz, for a model at some values."""
    return cutoff if values.constant else PASSED * cutoff


@dataclass(frozen=True, slots=True)
class Thinning:
    """As few of the uniform times as a bandwidth needs, one step beyond the last."""

    t: Array
    """Times that are kept, s."""
    every: int

    @classmethod
    def of(cls, t: Array, step: float, cutoff: float) -> Thinning:
        """Thin times `t`, `step` s apart, for signals up to `cutoff` Hz."""
        every = max(1, int(1.0 / (step * GRID_PER_CUTOFF * cutoff)))
        return cls(np.arange(0, len(t) + every, every) * step + t[0], every)

    def thin(self, y: Array) -> Array:
        """Values at the kept times; the last one is held beyond the end."""
        y = y[:: self.every]
        return np.concatenate([y, np.full(len(self.t) - len(y), y[-1])])


@dataclass(frozen=True, slots=True)
class SmoothedMotion:
    """Motion of the stage at uniform times, (n,) each: m, m/s, m/s², m/s³."""

    p: Array
    v: Array
    a: Array
    jerk: Array


def smoothed_signals(
    run: PreparedRun,
    integrals: DriveIntegrals,
    smoothed: tuple[Array, Array, Array],
    noise: Noise,
    values: Values,
    before: Signals | None,
    cutoff: float | None = None,
    subtracted: Array | None = None,
) -> Signals:
    """Smoothed motion: corrected output plus the smoothed process noise.

    The smoothed noise is the optimal share of either channel at each frequency, so that the error of the signals is
    not correlated with what the replay regresses on them.

    Parameters
    ----------
    run, integrals : readings and output, and what drives the motion between readings.
    smoothed : position, velocity and noise of the output at the readings, by the filter over them.
    noise, values : those that the filter was run with.
    before : motion that non-constant effects are evaluated on; None while there is none yet.
    cutoff : bandwidth, Hz; by default that of the motion itself.
    subtracted : smoothed noise of the output at `uniform_times`, with the sign and scale of the stage, m/s²; by default
        that of the track.
    """
    p_smooth, v_smooth, wanted = smoothed
    del smoothed
    rate = 1.0 / run.accel_step
    t = uniform_times(run)
    output = cubic(run.undone.t, run.undone.y, values.stamps(t, run.origins.t))
    added = effects_at(run, t, values, before)
    if subtracted is None:
        wanted = np.interp(t, run.t, wanted)
        if np.any(integrals.extra_q):
            wanted *= 1.0 + held_after(integrals, t) / noise.q
    else:
        wanted = -subtracted
    gain, filters = run.rig.polarity / values.scale, run.filters
    crossover = run.crossover(noise)
    if cutoff is None:
        rough = gain * (output - added) - run.rig.gravity * filters.at_rest + wanted
        usual = noise.usual
        density = usual.r * run.reading_step
        cutoff, reach = motion_bandwidth(rough, rate, q=usual.q, reading_density=density, crossover=crossover)
        del rough
    else:
        reach = cutoff
    corner = corner_of(values, cutoff)
    gravity = run.gravity.behind_high_passes(t, run.accel_step, corner)
    tau = run.tau(values)
    if tau > 0.0:  # the effects act before the low-pass of the output
        output += tau * derivative(output, run.accel_step)
    output = low_pass(output - added, rate, corner)
    a = gain * output - gravity + filters.before_position(low_pass(wanted, rate, corner), run.accel_step)
    del output, added, wanted
    # Each array is thinned as soon as it is used up: those of an hour would not fit at once.
    grid = Thinning.of(t, run.accel_step, max(cutoff, values.fastest()))
    jerk = grid.thin(derivative(a, run.accel_step))
    v = integral(a, run.accel_step)
    a = grid.thin(a)
    unread = unread_spans(run, integrals, t)
    wanting = np.interp(t, run.t, v_smooth - np.interp(run.t, t, filters.behind_position(v, run.accel_step)))
    edge = int(rate / cutoff)  # next to a hole the acceleration itself is off; readings correct it best unfiltered
    for begin, end in unbroken_spans(run, integrals, t):
        if end - begin > 2 * edge:
            inner = slice(edge, end - begin - edge)
            wanting[begin:end][inner] = low_pass(wanting[begin:end], rate, corner)[inner]
    v += filters.before_position(wanting, run.accel_step)
    del wanting
    for hole in unread:
        v[hole] = np.interp(t[hole], run.t, v_smooth)
    p = integral(v, run.accel_step)
    v = grid.thin(v)
    missed = np.interp(t, run.t, p_smooth - np.interp(run.t, t, filters.behind_position(p, run.accel_step)))
    p += filters.before_position(missed, run.accel_step)
    for hole in unread:
        p[hole] = np.interp(t[hole], run.t, p_smooth)
    return shrunk(run, noise, values, grid, SmoothedMotion(grid.thin(p), v, a, jerk), cutoff, reach)


def given_signals(run: PreparedRun, noise: Noise, values: Values, motion: SmoothedMotion, cutoff: float) -> Signals:
    """Signals of a motion (n,) that was smoothed by other means, at `uniform_times`; its bandwidth in Hz."""
    grid = Thinning.of(uniform_times(run), run.accel_step, max(cutoff, values.fastest()))
    thinned = SmoothedMotion(*(grid.thin(y) for y in (motion.p, motion.v, motion.a, motion.jerk)))
    return shrunk(run, noise, values, grid, thinned, cutoff, cutoff)


def shrunk(
    run: PreparedRun, noise: Noise, values: Values, grid: Thinning, motion: SmoothedMotion, cutoff: float, reach: float
) -> Signals:
    """Signals of a motion on a thinned grid, shrunk where noise in it would bias what is regressed on it."""
    filters, v, a, jerk = run.filters, motion.v, motion.a, motion.jerk
    rate, corner = 1.0 / run.accel_step, corner_of(values, cutoff)
    shrinkage = Shrinkage.of(jerk, rate / grid.every, run, noise, cutoff, values.time_offset)
    if shrinkage is not None:
        v, a = shrinkage(v), shrinkage(a)
        jerk = derivative(a, grid.every * run.accel_step)
    p_std, v_std, a_std = smoothed_std(run, noise, corner, shrinkage)
    motion = SmoothedMotion(motion.p, v, a, jerk)
    if filters.blocking:
        blocked = np.interp(grid.t, run.t, run.blocked)
        motion = SmoothedMotion(*filters.recoupled((motion.p, v, a, jerk), blocked, float(grid.t[1] - grid.t[0])))
    smooth = sensor_signals(run, grid.t, motion, values, cutoff)
    return replace(smooth, reach=reach, p_std=p_std, v_std=v_std, a_std=a_std)


def held_after(integrals: DriveIntegrals, t: Array) -> Array:
    """Extra density of process noise at times `t`, that of the interval which each lies in."""
    return integrals.extra_q[np.minimum(np.searchsorted(integrals.t, t), len(integrals.t) - 1)]


def unread_spans(run: PreparedRun, integrals: DriveIntegrals, t: Array) -> list[slice]:
    """Spans of times `t` in which neither channel was read; a straight line bridges them.

    An integral over an interval without measurements would carry the motion far outside its range.
    """
    long = np.diff(run.t, prepend=run.t[0]) > HOLE * run.reading_step
    rows = np.flatnonzero(integrals.restart & long)
    return [slice(*np.searchsorted(t, run.t[[k - 1, k]])) for k in rows if k > 0]


def unbroken_spans(run: PreparedRun, integrals: DriveIntegrals, t: Array) -> list[tuple[int, int]]:
    """Spans of times `t` between which a channel was not read: a filter must not leak from one into the next."""
    rows = np.flatnonzero(integrals.restart[1:])
    edges = np.unique([0, *np.searchsorted(t, run.t[rows]), *np.searchsorted(t, run.t[rows + 1]), len(t)])
    return [(int(begin), int(end)) for begin, end in pairwise(edges)]


def smoothed_std(
    run: PreparedRun, noise: Noise, cutoff: float, shrinkage: Shrinkage | None = None
) -> tuple[float, float, float]:
    """Standard deviations of what smoothing leaves in p, v and a up to a bandwidth; v and a may be shrunk."""
    f: Array = np.linspace(cutoff / 400.0, cutoff, 400)
    w, density = 2.0 * np.pi * f, left_density(run, noise, f)
    level = density if shrinkage is None else density * shrinkage.at(f) ** 2
    p_std, v_std, a_std = (
        float(np.sqrt(np.sum(left / w**power) * f[0])) for left, power in ((density, 4), (level, 2), (level, 0))
    )
    return p_std, v_std, a_std


def uniform_times(run: PreparedRun) -> Array:
    """Times at the accelerometer's rate over all readings, s."""
    return even_times(run.t[0], run.t[-1] + 0.5 * run.accel_step, run.accel_step)


def effects_at(run: PreparedRun, t: Array, values: Values, signals: Signals | None) -> Array | float:
    """Bias and additive effects at times `t`, as the output shows them but for its one RC, (n,) m/s²."""
    bias = values.bias * run.filters.at_rest
    total = None if signals is None else values.total("output", signals)
    if signals is None or total is None:
        return bias
    blocked = run.filters.behind_high_passes(total, signals.step)
    return bias + cubic(signals.t + run.origins.t, blocked, t)


def output_at(run: PreparedRun, t: Array, corner: float, tau: float) -> Array:
    """Output at times `t` of its own clock, low-passed without phase at a corner, Hz, an RC filter of `tau` s undone,
    m/s²."""
    uniform = even_times(run.undone.t[0], run.undone.t[-1], run.accel_step)
    output = low_pass(np.interp(uniform, run.undone.t, run.undone.y), 1.0 / run.accel_step, corner)
    if tau > 0.0:
        output = output + tau * derivative(output, run.accel_step)
    return np.asarray(np.interp(t, uniform, output))


def output_signals(run: PreparedRun, values: Values, cutoff: float, motion: tuple[Array, Array]) -> Signals:
    """Signals whose acceleration comes from the corrected output alone, with a given position and velocity.

    Parameters
    ----------
    run : readings and output.
    values : coefficients of the model.
    cutoff : bandwidth, Hz.
    motion : position (m) and velocity (m/s) at `uniform_times`.
    """
    t = uniform_times(run)
    plain = output_at(run, values.stamps(t, run.origins.t), corner_of(values, cutoff), run.tau(values))
    grid = Thinning.of(t, run.accel_step, max(cutoff, values.fastest()))
    p, v = (grid.thin(y) for y in motion)
    gravity = run.gravity.behind_high_passes(t, run.accel_step, cutoff)

    def corrected(signals: Signals | None) -> Signals:
        output = plain - effects_at(run, t, values, signals)
        a = run.rig.polarity / values.scale * output - gravity
        jerk = derivative(a, run.accel_step)
        return sensor_signals(run, grid.t, SmoothedMotion(p, v, grid.thin(a), grid.thin(jerk)), values, cutoff)

    # Each correction gains the ratio of the effects to the acceleration, mostly a few percent: a whole correction is
    # added until one is larger than the last, as where effects change more than the acceleration; from there on halves.
    signals, moved, share = corrected(corrected(None)), math.inf, 1.0
    for _ in range(MOST_CORRECTIONS):
        before, signals = signals, corrected(signals)
        step = root_mean_square(signals.a - before.a)
        if step < CORRECTION_LEFT * float(np.std(signals.a)):
            break
        share = share if step < moved else 0.5 * share
        moved = step
        if share < 1.0:
            rest = 1.0 - share
            a, jerk = share * signals.a + rest * before.a, share * signals.jerk + rest * before.jerk
            signals = replace(signals, a=a, jerk=jerk)
    return signals


def side_channels_at(run: PreparedRun, t: Array) -> dict[str, Array]:
    """Side channels at times `t`, from the model's origin."""
    if not run.recording.side:
        return {}
    resampled = run.unchanged("side channels", (t,), lambda: resampled_side(run, t))
    return {name: y - run.origins.of(name) for name, y in resampled.items()}


def resampled_side(run: PreparedRun, t: Array) -> dict[str, Array]:
    """Side channels at times `t`, in their units."""
    side = run.recording.side
    turning = [channel for name, channel in side.items() if name in DERIVED]
    alike = len({len(channel) for channel in turning}) == 1  # all are made from the same places
    together = cubic(turning[0].t, np.stack([channel.y for channel in turning]), t) if alike else ()
    values = dict(zip((channel.name for channel in turning), together, strict=alike))
    values |= {name: resample(channel, t) for name, channel in side.items() if name not in values}
    return {name: values[name] for name in side}


def of_lever(side: Mapping[str, Array], values: Values) -> Array | float:
    """Acceleration along the input axis of the sensor against the tracked point of a turning body, m/s².

    Effects of the sensor are of the force at its own place.
    """
    distances = ((values.by_name.get(f"lever_arm.{part}", 0.0), name) for name, part in zip(LEVERS, "xyz", strict=True))
    return sum((r * side[name] for r, name in distances if r), start=0.0)


SLOPE_STEP = 0.05
"""Half the difference of two forces over which a slope is taken, of the standard deviation of the force."""
TINY_STEP = 1e-6
"""Least such half, m/s²."""


def slope_of(values: Values, s: Signals) -> Array | float:
    """Derivative of the effects of the output by the force at a sensor with a lever arm, (n,); 0 without one."""
    curved = [(t, c) for t, c in values.additive("output") if is_local(t.effect) and not t.effect.needs]
    if not curved or not any(term.effect.needs == LEVERS for term in values.terms):
        return 0.0
    terms, step = [term for term, _ in curved], max(SLOPE_STEP * float(np.std(s.a)), TINY_STEP)
    slope = np.zeros(len(s.t))
    for sign in (1.0, -1.0):
        columns = evaluate(terms, replace(s, a=s.a + sign * step))
        for (_, c), column in zip(curved, columns, strict=True):
            slope += sign * c / (2.0 * step) * column
    return slope


def sensor_signals(run: PreparedRun, t_grid: Array, motion: SmoothedMotion, values: Values, cutoff: float) -> Signals:
    """Motion of the stage as the sensor feels it, with side channels; acceleration and jerk of `motion` become those
    of the signals."""
    polarity, side = run.rig.polarity, side_channels_at(run, t_grid)
    gravity: Array | float = run.rig.gravity
    change: Array | float = 0.0
    if GRAVITY in side:
        full = uniform_times(run)
        gravity = np.interp(t_grid, full, run.gravity.within(full, run.accel_step, cutoff))
        side[GRAVITY] = gravity = gravity + polarity * of_lever(side, values)
        change = derivative(gravity, float(t_grid[1] - t_grid[0]))
    a, jerk = motion.a, motion.jerk
    a += gravity
    a *= polarity
    jerk += change
    jerk *= polarity
    signals = Signals(
        t=t_grid - run.origins.t,
        p=motion.p - run.origins.p,
        v=motion.v,
        a=a,
        jerk=jerk,
        scale=values.scale,
        bias=values.bias,
        coefficients=values.by_name,
        axis=run.recording.axis,
        rig=run.rig,
        cutoff=cutoff,
        side=side,
        side_origins=run.origins.side,
    )
    return replace(signals, slope=slope_of(values, signals))
