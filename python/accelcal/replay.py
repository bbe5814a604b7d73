"""One recording through the replay: nominal motion, noise, smoothed signals, whitened columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from accelcal import _core
from accelcal.model import NOMINAL, Term, evaluate
from accelcal.recording import Array, Channel, Recording, RecordingError
from accelcal.signals import (
    GRID_PER_CUTOFF,
    Origins,
    Signals,
    derivative,
    integral,
    low_pass,
    motion_bandwidth,
    resample,
)

Flags = NDArray[np.bool_]

HOLE = 8.0
"""A spacing of accelerometer samples beyond this many periods is a hole; the replay starts anew behind it."""
SETTLE = 5.0
"""Time constants of the filter after a start whose innovations are not used."""
CHUNK = 4096
"""Readings whose columns are held in memory at a time."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Intensity of the two noises."""

    q: float
    """Two-sided density of the noise on acceleration, (m/s²)²/Hz."""
    r: float
    """Variance of one encoder reading, m²."""


@dataclass(frozen=True, slots=True)
class Values:
    """Coefficients of a model in forward sense, SI, by name."""

    by_name: Mapping[str, float]
    terms: tuple[Term, ...] = ()

    @property
    def scale(self) -> float:
        """1 + k."""
        return 1.0 + self.by_name.get("scale_factor", 0.0)

    @property
    def time_offset(self) -> float:
        """s"""
        return self.by_name.get("time_offset", 0.0)

    @property
    def bias(self) -> float:
        """m/s²"""
        return self.by_name.get("bias", 0.0)

    @property
    def lowpass_error(self) -> float:
        """By how much the low-pass is slower than declared, s."""
        return self.by_name.get("lowpass_error", 0.0)

    def additive(self, port: str) -> Iterator[tuple[Term, float]]:
        """Coefficients that add to the output beyond the nominal, or to the reading, and are not zero."""
        for term in self.terms:
            coefficient = self.by_name[term.name]
            if term.name not in NOMINAL and term.port == port and coefficient != 0.0:
                yield term, coefficient

    def total(self, port: str, s: Signals) -> Array | None:
        """What they add together at the times of `s`, (n,); None when there is nothing to add."""
        pairs = list(self.additive(port))
        if not pairs:
            return None
        total = np.zeros(len(s.t))
        for (_, c), column in zip(pairs, evaluate([term for term, _ in pairs], s), strict=True):
            total += c * column
        return total

    @property
    def constant(self) -> bool:
        """Whether nothing but the base acts on the output."""
        return next(self.additive("output"), None) is None and next(self.additive("position"), None) is None


class Run:
    """A recording made ready for the replay: the stretch that both channels cover, and its time scales.

    Parameters
    ----------
    recording : what was measured.
    origins : zero points of t, p and temperature.
    start, end : s, optional; only readings in [start, end] on the position clock are used.
    withheld : s; readings after this time are not looked at when glitches are sought.

    Raises
    ------
    RecordingError
        If the channels do not overlap or fewer than 16 readings remain.
    """

    def __init__(
        self,
        recording: Recording,
        origins: Origins | None = None,
        *,
        start: float | None = None,
        end: float | None = None,
        withheld: float = np.inf,
    ) -> None:
        self.recording = recording
        self.rig = recording.rig
        self.origins = origins if origins is not None else natural_origins(recording)
        accel, position = recording.accel, recording.position
        first = max(accel.t[0], position.t[0], -np.inf if start is None else start)
        last = min(accel.t[-1], position.t[-1], np.inf if end is None else end)
        inside = slice(*np.searchsorted(position.t, [first, np.nextafter(last, np.inf)]))
        kept = ~spikes(position.t[inside], np.where(position.t[inside] > withheld, np.nan, position.y[inside]))
        self.left_out = int(np.sum(~kept))
        rows = kept if self.left_out else slice(None)  # a view where there is nothing to leave out
        self.t: Array = np.ascontiguousarray(position.t[inside][rows])
        self.z: Array = np.ascontiguousarray(position.y[inside][rows])
        if len(self.t) < MIN_READINGS:
            raise RecordingError(
                f"{recording.name or 'recording'}: {len(self.t)} encoder readings between {first:.6g} s and "
                f"{last:.6g} s, at least {MIN_READINGS} are needed; record longer or widen --from/--to"
            )
        margin = 64 * float(np.median(np.diff(accel.t[:4096])))
        reach = slice(*np.searchsorted(accel.t, [self.t[0] - margin, self.t[-1] + margin]))
        self.accel = Channel(accel.name, accel.t[reach], accel.y[reach], accel.unit)
        self.accel_step = float(np.median(np.diff(self.accel.t)))
        self.reading_step = float(np.median(np.diff(self.t)))
        self.declared_tau = self.rig.lowpass.tau if self.rig.lowpass is not None else 0.0

    def tau(self, values: Values) -> float:
        """Time constant of the low-pass at the values of a model, s; 0 where there is none."""
        return max(0.0, self.declared_tau + values.lowpass_error)

    @cached_property
    def speed(self) -> float:
        """A speed that the stage surely does not exceed, m/s: for the diffuse start, from its first ten readings
        and what the output could add in a second; no later reading is looked at."""
        begin = min(10, len(self.t) - 1)
        at_first = abs(self.z[begin] - self.z[0]) / (self.t[begin] - self.t[0])
        return float(3.0 * at_first + np.ptp(self.accel.y))

    @cached_property
    def least_step(self) -> float:
        """Smallest step the encoder shows, or its declared resolution, m; 0 when neither is known."""
        steps = np.abs(np.diff(self.z))
        seen = float(np.min(steps[steps > 0.0], initial=np.inf))
        declared = self.rig.resolution
        if declared is not None:
            return declared
        on_grid = np.isfinite(seen) and float(np.max(np.abs(np.rint(steps / seen) - steps / seen))) < 0.05
        return seen if on_grid else 0.0

    @cached_property
    def reading_variance_guess(self) -> float:
        """Encoder variance from third differences, m²: white noise of variance R gives 20 R."""
        third = np.diff(self.z, 3)
        spread = float(np.median(np.abs(third - np.median(third)))) / 0.6745
        return max(spread**2 / 20.0, self.least_step**2 / 12.0, 1e-24)

    def prior(self, r: float) -> tuple[float, float, float, float]:
        """Mean of v and covariance (pp, pv, vv) before the first reading."""
        return 0.0, 1e4 * r, 0.0, self.speed**2 + r / self.reading_step**2

    def drive(self, values: Values, signals: Signals | None) -> Drive:
        """Integrals of the stage acceleration that output and model imply, interval by interval.

        Parameters
        ----------
        values : coefficients at which the model is taken.
        signals : smoothed motion that non-constant effects are evaluated on; None while there is none yet.
        """
        begin = self.t[0]  # a small offset would drown in the last digits of a clock that counts from 1970
        first, second, covered = _core.drive(
            self.accel.t - begin,
            self.accel.y,
            self.t - begin,
            how="cubic",
            tau=self.tau(values),
            delay=values.time_offset,
            hole=HOLE * self.accel_step,
        )
        h = np.diff(self.t, prepend=self.t[0])
        first -= values.bias * h
        second -= values.bias * h**2 / 2.0
        z = self.z
        if signals is not None:
            t_grid = signals.t + self.origins.t
            total = values.total("output", signals)
            if total is not None:
                once, twice, _ = _core.drive(t_grid, total, self.t, how="cubic", tau=0.0, delay=0.0, hole=np.inf)
                first -= once
                second -= twice
            if any(values.additive("position")):
                read = values.total("position", signals.resampled(self.t - self.origins.t))
                z = z if read is None else z - read
        gain = self.rig.polarity / values.scale
        restart = ~covered
        restart[0] = True
        first *= gain  # in place, as all of it: what is kept lies below what is not, and memory is given back
        first -= self.rig.gravity * h
        second *= gain
        second -= self.rig.gravity * h**2 / 2.0
        first[restart] = second[restart] = 0.0
        return Drive(self.t, z, first, second, restart)

    def crossover(self, noise: Noise) -> float:
        """Frequency at which both channels know the acceleration equally well, Hz (physics 3.4)."""
        return float((noise.q / (noise.r * self.reading_step)) ** 0.25 / (2.0 * np.pi))

    def wait(self, noise: Noise) -> float:
        """How long after a start innovations are not used, s: five time constants of the filter."""
        return SETTLE / (2.0 * np.pi * self.crossover(noise))

    def track(self, drive: Drive, noise: Noise) -> _core.ReplayTrack:
        """Run the two-state filter."""
        return _core.ReplayTrack(*drive.arrays, q=noise.q, r=noise.r, prior=self.prior(noise.r))

    def signals(
        self,
        drive: Drive,
        track: _core.ReplayTrack,
        noise: Noise,
        values: Values,
        before: Signals | None,
        cutoff: float | None = None,
    ) -> Signals:
        """Smoothed motion: corrected output plus the process noise that the readings ask for.

        The smoothed noise is the optimal share of either channel at each frequency, so that the error of the
        signals is not correlated with what the replay regresses on them.
        """
        p_smooth, v_smooth, wanted = track.smooth(*drive.arrays)
        rate = 1.0 / self.accel_step
        t = self.uniform_times()
        output = np.interp(t + values.time_offset, self.accel.t, self.accel.y)
        self.subtract(output, t, values, before)
        wanted = np.interp(t, self.t, wanted)
        gain = self.rig.polarity / values.scale
        crossover = self.crossover(noise)
        if cutoff is None:
            rough = gain * output - self.rig.gravity + wanted
            density = noise.r * self.reading_step
            cutoff = motion_bandwidth(rough, rate, q=noise.q, reading_density=density, crossover=crossover)
            del rough
        output = low_pass(output, rate, cutoff)
        tau = self.tau(values)
        if tau > 0.0:
            output = output + tau * derivative(output, self.accel_step)
        a = gain * output - self.rig.gravity + low_pass(wanted, rate, cutoff)
        del output, wanted
        # Each series is thinned as soon as it is used up: an hour of them would not fit side by side.
        grid = Thinning.of(t, self.accel_step, cutoff)
        jerk = grid.thin(derivative(a, self.accel_step))
        v = integral(a, self.accel_step)
        a = grid.thin(a)
        unread = self.unread(drive, t)
        wanting = np.interp(t, self.t, v_smooth - np.interp(self.t, t, v))
        edge = int(rate / cutoff)  # beside a hole the acceleration itself is off, which readings mend quickest uncut
        for begin, end in self.unbroken(drive, t):
            if end - begin > 2 * edge:
                inner = slice(edge, end - begin - edge)
                wanting[begin:end][inner] = low_pass(wanting[begin:end], rate, cutoff)[inner]
        v += wanting
        del wanting
        for hole in unread:
            v[hole] = np.interp(t[hole], self.t, v_smooth)
        p = integral(v, self.accel_step)
        v = grid.thin(v)
        p += np.interp(t, self.t, p_smooth - np.interp(self.t, t, p))
        for hole in unread:
            p[hole] = np.interp(t[hole], self.t, p_smooth)
        p_std, v_std, a_std = self.left_noise(noise, cutoff)
        smooth = self.on_grid(grid.t, Motion(grid.thin(p), v, a, jerk), values, cutoff)
        return replace(smooth, p_std=p_std, v_std=v_std, a_std=a_std)

    def unread(self, drive: Drive, t: Array) -> list[slice]:
        """Stretches of times `t` in which neither channel was read; a straight line bridges them.

        An integral over what nobody measured would carry the motion far outside its range.
        """
        long = np.diff(self.t, prepend=self.t[0]) > HOLE * self.reading_step
        rows = np.flatnonzero(drive.restart & long)
        return [slice(*np.searchsorted(t, self.t[[k - 1, k]])) for k in rows if k > 0]

    def unbroken(self, drive: Drive, t: Array) -> list[tuple[int, int]]:
        """Stretches of times `t` between which a channel was not read: nothing may leak from one into the next."""
        rows = np.flatnonzero(drive.restart[1:])
        edges = np.unique([0, *np.searchsorted(t, self.t[rows]), *np.searchsorted(t, self.t[rows + 1]), len(t)])
        return [(int(begin), int(end)) for begin, end in pairwise(edges)]

    def left_noise(self, noise: Noise, cutoff: float) -> tuple[float, float, float]:
        """Standard deviations of what smoothing leaves in p, v and a up to a bandwidth (channels in parallel)."""
        f = np.linspace(cutoff / 400.0, cutoff, 400)
        w = 2.0 * np.pi * f
        encoder = noise.r * self.reading_step * w**4
        density = 2.0 * noise.q * encoder / (noise.q + encoder)
        p_std, v_std, a_std = (float(np.sqrt(np.sum(density / w**power) * f[0])) for power in (4, 2, 0))
        return p_std, v_std, a_std

    def uniform_times(self) -> Array:
        """Times at the accelerometer's rate over all readings, s."""
        return np.arange(self.t[0], self.t[-1] + 0.5 * self.accel_step, self.accel_step)

    def subtract(self, output: Array, t: Array, values: Values, signals: Signals | None) -> None:
        """Take bias and additive effects off an output at times `t`, in place."""
        output -= values.bias
        total = None if signals is None else values.total("output", signals)
        if signals is not None and total is not None:
            output -= np.interp(t, signals.t + self.origins.t, total)

    def output_at(self, t: Array, cutoff: float, tau: float) -> Array:
        """Output at times `t` of its own clock, low-passed without phase, an RC filter of `tau` s undone, m/s²."""
        own = np.arange(self.accel.t[0], self.accel.t[-1], self.accel_step)
        output = low_pass(np.interp(own, self.accel.t, self.accel.y), 1.0 / self.accel_step, cutoff)
        if tau > 0.0:
            output = output + tau * derivative(output, self.accel_step)
        return np.asarray(np.interp(t, own, output))

    def output_signals(self, values: Values, cutoff: float, motion: tuple[Array, Array]) -> Signals:
        """Acceleration as the corrected output alone tells it, beside a given position and velocity.

        Parameters
        ----------
        values : coefficients of the model.
        cutoff : bandwidth, Hz.
        motion : position (m) and velocity (m/s) at `uniform_times`.
        """
        t = self.uniform_times()
        plain = self.output_at(t + values.time_offset, cutoff, self.tau(values))
        grid = Thinning.of(t, self.accel_step, cutoff)
        gain, (p, v) = self.rig.polarity / values.scale, (grid.thin(y) for y in motion)
        signals: Signals | None = None
        for _ in range(3):  # each pass gains the ratio of the effects to the acceleration, at most a few percent
            output = plain.copy()
            self.subtract(output, t, values, signals)
            a = gain * output - self.rig.gravity
            jerk = derivative(a, self.accel_step)
            signals = self.on_grid(grid.t, Motion(p, v, grid.thin(a), grid.thin(jerk)), values, cutoff)
        assert signals is not None
        return signals

    def side_at(self, t: Array) -> dict[str, Array]:
        """Side channels at times `t`; temperature from the model's origin."""
        side = {name: resample(channel, t) for name, channel in self.recording.side.items()}
        if "temperature" in side:
            side["temperature"] = side["temperature"] - self.origins.temperature
        return side

    def on_grid(self, t_grid: Array, motion: Motion, values: Values, cutoff: float) -> Signals:
        """Motion of the stage as the sensor feels it, with side channels."""
        polarity = self.rig.polarity
        return Signals(
            t=t_grid - self.origins.t,
            p=motion.p - self.origins.p,
            v=motion.v,
            a=polarity * (motion.a + self.rig.gravity),
            jerk=polarity * motion.jerk,
            scale=values.scale,
            bias=values.bias,
            rig=self.rig,
            cutoff=cutoff,
            side=self.side_at(t_grid),
        )

    def columns(
        self, track: _core.ReplayTrack, drive: Drive, terms: Sequence[Term], signals: Signals
    ) -> Iterator[tuple[slice, Array]]:
        """Whitened response of the predicted reading to one unit of each coefficient, stretch by stretch.

        Yields
        ------
        The readings of the stretch, and the columns (readings, terms).
        """
        inputs = [j for j, term in enumerate(terms) if term.port == "output"]
        direct = [j for j, term in enumerate(terms) if term.port == "position"]
        order = [*inputs, *direct]
        factor = -self.rig.polarity / signals.scale
        on_grid = list(evaluate([terms[j] for j in inputs], signals))
        at_readings = signals.resampled(self.t - self.origins.t) if direct else signals
        direct_columns = list(evaluate([terms[j] for j in direct], at_readings))
        grid = float(signals.t[0]) + self.origins.t, signals.step
        for readings, rows in filter_columns(track, self.t, drive.restart, grid, on_grid, factor, direct_columns):
            whitened = np.empty((readings.stop - readings.start, len(terms)))
            whitened[:, order] = rows.T
            yield readings, whitened


def filter_columns(
    track: _core.ReplayTrack,
    t: Array,
    restart: Flags,
    grid: tuple[float, float],
    inputs: Sequence[Array],
    factor: float,
    direct: Sequence[Array],
) -> Iterator[tuple[slice, Array]]:
    """Whitened responses to columns, stretch by stretch: accelerations on a grid times `factor`, then readings.

    Parameters
    ----------
    grid : first time and spacing of the grid on which `inputs` are sampled, s.

    Yields
    ------
    The readings of the stretch, and the responses (columns, readings).
    """
    start, step = grid
    inputs = [np.ascontiguousarray(y) for y in inputs]
    direct = [np.ascontiguousarray(y) for y in direct]
    m, counts = len(inputs), np.ones(len(t), dtype=np.bool_)
    state = np.zeros((m + len(direct), 2))
    for begin in range(0, len(t), CHUNK):
        end = min(begin + CHUNK, len(t))
        low = high = 0
        if inputs:
            # Two grid rows on either side shape the curve inside the cells that the stretch touches.
            low = max(0, int((t[max(begin - 1, 0)] - start) / step) - 2)
            high = min(len(inputs[0]), int((t[end - 1] - start) / step) + 4)
            low = max(0, min(low, high - 4))
        place = start + low * step, step, high - low
        bank = _core.Bank(track, t, restart, counts, grid=place, from_=begin, to=end, group=1)
        rows = np.empty((len(state), end - begin))
        bank.carry_inputs([y[low:high] for y in inputs], factor, state[:m], rows[:m])
        bank.carry_readings([y[begin:end] for y in direct], state[m:], rows[m:])
        yield slice(begin, end), rows


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
class Motion:
    """Motion of the stage at uniform times, (n,) each: m, m/s, m/s², m/s³."""

    p: Array
    v: Array
    a: Array
    jerk: Array


MIN_READINGS = 16
"""Fewer encoder readings than this are no record."""


@dataclass(frozen=True, slots=True)
class Drive:
    """Encoder readings and the integrals of acceleration between them."""

    t: Array
    z: Array
    first: Array
    """Velocity gained over the interval that ends at each reading, m/s."""
    second: Array
    """Position gained over it beyond v h, m."""
    restart: Flags
    """Where the accelerometer record does not reach across the interval."""

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array, Flags]:
        """In the order that the core takes them."""
        return self.t, self.z, self.first, self.second, self.restart

    def settled(self, wait: float) -> Flags:
        """Readings later than `wait` behind the last start; of a short stretch at least the last four fifths."""
        wait = min(wait, 0.2 * float(self.t[-1] - self.t[0]))
        begins = np.flatnonzero(self.restart)
        last = begins[np.searchsorted(begins, np.arange(len(self.t)), side="right") - 1]
        return np.asarray(self.t > self.t[last] + wait)

    def part(self, rows: slice) -> Drive:
        """A stretch of it, starting anew."""
        restart = self.restart[rows].copy()
        restart[0] = True
        return Drive(self.t[rows], self.z[rows], self.first[rows], self.second[rows], restart)


SPIKE_SPEED = 10.0
"""A step this many times faster than 98 % of all steps may not belong to the motion."""
SPIKE_READINGS = 64
"""And never longer than this many readings."""
SPIKE_JUMP = 0.25
"""A spike covers at least this share of its height in one step; motion takes many."""
SPIKE_SHARE = 0.01
"""A spike longer than this share of the record is not a spike."""


def spikes(t: Array, z: Array) -> Flags:
    """Readings that jump away and come back: glitches of the encoder, not motion, (n,)."""
    found = np.zeros(len(z), dtype=np.bool_)
    known = int(np.sum(np.isfinite(z)))
    t, z = t[:known], z[:known]
    if known < MIN_READINGS:
        return found
    steps = np.diff(z)
    speed = np.abs(steps) / np.diff(t)
    usual = float(np.quantile(speed, 0.98))
    fast = np.flatnonzero(speed > SPIKE_SPEED * usual) if usual > 0.0 else np.empty(0, dtype=np.intp)
    longest = min(max(1, int(SPIKE_SHARE * len(z))), SPIKE_READINGS)
    if len(fast) > 0.02 * len(z):
        return found
    k = 0
    while k < len(fast):
        out = fast[k]
        near = fast[k + 1 : np.searchsorted(fast, out + longest, side="right")]
        back = [int(b) for b in near if _jumps_back(z[out : b + 2])]
        if not back:
            k += 1
            continue
        found[out + 1 : back[-1] + 1] = True
        k = int(np.searchsorted(fast, back[-1], side="right"))
    return found


def _jumps_back(z: Array) -> bool:
    """Whether readings leave their first value in few steps and return to it with the last."""
    height = float(np.max(np.abs(z - z[0])))
    return bool(abs(z[-1] - z[0]) < 0.2 * height and np.max(np.abs(np.diff(z))) > SPIKE_JUMP * height)


FAR_FROM_ZERO = 3.0
"""An encoder whose zero is farther from the travel than this many travels is counted from the middle of it."""


def natural_origins(recording: Recording) -> Origins:
    """Zero points that suit a record: its first reading, the encoder's own zero, and its mean temperature."""
    temperature = recording.side.get("temperature")
    y = recording.position.y
    middle = float(np.mean(y))
    return Origins(
        t=float(recording.position.t[0]),
        p=middle if abs(middle) > FAR_FROM_ZERO * float(np.ptp(y)) else 0.0,
        temperature=float(np.mean(temperature.y)) if temperature is not None else 0.0,
    )
