"""Prediction from any reading onwards, without position: the causal filter, the output, and simulated motion."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from accelcal.data import Array, Flags, Recording, batches, median_step, root_mean_square, within_spans
from accelcal.effects import begins_rested, find, of_one_record
from accelcal.estimation.drive import DriveIntegrals, after_readings, drive, run_filter
from accelcal.estimation.estimate import Fit, require_channels, settled_state
from accelcal.estimation.noise import variance_functions, with_growth
from accelcal.estimation.run import PreparedRun, Source, prepare, prepared, recording_of
from accelcal.estimation.run_state import RunState
from accelcal.estimation.smoothing import corner_of, output_at, output_signals, uniform_times
from accelcal.estimation.values import Noise, Values
from accelcal.signals.processing import integral
from accelcal.signals.series import HOLE_LEAST
from accelcal.signals.signals import RESAMPLED, Signals
from accelcal.validation.comparison import ReferenceNoise
from accelcal.validation.dead_reckoning import MEMORY, DeadReckoning, Starts


def values_on(fit: Fit, recording: Recording) -> Values:
    """Coefficients as they apply to a recording.

    On another than its own, effects that follow the clock of their record are left out (derivations 6.9): steps, bias
    walks, warm-up. Elements with memory begin as after a long rest.
    """
    if is_fitted(fit, recording):
        same = [index for index, run in enumerate(fit.runs) if run.digest and run.digest == recording.digest]
        parts = [index for index, run in enumerate(fit.runs) if run.session and run.session == recording.session]
        return fit.values(same[0] if same else parts[0] if len(parts) == 1 else None)
    values = fit.values()
    terms = tuple(replace(term, shape=term.effect.rested(term.shape)) for term in values.terms)
    lost = {term.name for term in terms if of_one_record(term.effect)}
    return Values({name: 0.0 if name in lost else value for name, value in values.by_name.items()}, terms)


def left_out(fit: Fit, recording: Recording) -> tuple[str, ...]:
    """Sentences on what of a model is not carried to a recording."""
    if is_fitted(fit, recording):
        return ()
    names = [name for name in fit.model.added if of_one_record(find(name))]
    sentences = []
    if names:
        sentences.append(f"{' and '.join(names)}: follows the clock of the fitted recording; left out on this one")
    if rested := begins_rested(fit.model.added):
        sentences.append(rested)
    if offset_is_its_own(fit, recording):
        tolerance = 1e3 * recording.rig.offset_tolerance
        sentences.append(f"time_offset: estimated on this one, whose clocks agree within {tolerance:.3g} ms only")
    return tuple(sentences)


def offset_is_its_own(fit: Fit, recording: Recording) -> bool:
    """Whether a recording that was not fitted has a time offset of its own, as of two loggers."""
    free = any(term.name == "time_offset" for term in fit.model.free)
    return free and recording.rig.offset_tolerance > 0.0 and not is_fitted(fit, recording)


def with_offset_of(run: PreparedRun, values: Values, noise: Noise) -> Values:
    """Coefficients with the time offset of a run, within the tolerance of its clocks: Gauss-Newton on the innovations,
    all else as it is."""
    shift, least, most = run.accel_step, *(values.time_offset + x * run.rig.offset_tolerance for x in (-1.0, 1.0))
    for _ in range(OFFSET_ROUNDS):
        moved = [Values({**values.by_name, "time_offset": values.time_offset + x}, values.terms) for x in (0.0, shift)]
        integrals = [drive(run, at, None) for at in moved]
        counts = integrals[0].settled(run.wait(noise)) & ~integrals[1].restart
        before, behind = (run_filter(run, driven, noise) for driven in integrals)
        slope = (behind.series("e") - before.series("e"))[counts] / shift
        weighted = slope / before.series("S")[counts]
        offset = values.time_offset - float(weighted @ before.series("e")[counts]) / max(
            float(weighted @ slope), 1e-300
        )
        values = Values({**values.by_name, "time_offset": min(max(offset, least), most)}, values.terms)
    return values


OFFSET_ROUNDS = 3
"""Steps of Gauss and Newton to the time offset of a run; each leaves a hundredth."""


def is_fitted(fit: Fit, recording: Recording) -> bool:
    """Whether a recording has the clock of one that a fit was made from, or no digest to tell it from them."""
    return recording.session in {run.session for run in fit.runs}


def start_of_history(fit: Fit, recording: Recording, start: float) -> float:
    """Time from which elements with memory are to be followed up to `start`, s: they began with the fitted part of the
    same recording; on another one, and before that part, there is no history."""
    return min([start, *(run.start for run in fit.runs if run.session and run.session == recording.session)])


MOST_STARTS = 200
"""Start points of coasting, spread over the record."""
MOST_NODES, FEWEST_STARTS = 1 << 18, 10
"""Nodes of all start points, their histories too, on which effects that remember simulated motion are evaluated at a
time, and start points at least: of the usual ones only every so many."""
DIVERGED = 100.0
"""Largest error by effects that is told, as a multiple of the travel: effects that amplify what they act on grow
beyond every number."""
WARM_UP = 5.0
"""Seconds before the first start point; a quarter of shorter records."""


MOST_STEPS = 8.0
"""Steps from one reading to the next beyond which there is a hole."""


@dataclass(frozen=True, slots=True)
class Coasting:
    """Errors of predictions over one horizon, start point by start point."""

    starts: NDArray[np.intp]
    """Reading after which position is withheld, (n,)."""
    ends: NDArray[np.intp]
    """Reading at which the error is taken, (n,)."""
    frozen: Array
    """(n,) m"""
    rezeroed: Array
    """(n,) m"""
    floor: Array
    """Standard deviation from noise and start state, (n,) m."""
    open_floor: Array
    """The same as if no effect acted on simulated motion, (n,) m."""


def rms(y: Array) -> float | None:
    """Root mean square; None of nothing."""
    return root_mean_square(y) if len(y) else None


def within(limit: float, y: Array) -> Array:
    """Values of at most a limit, which also stands for those that are none."""
    return np.clip(np.nan_to_num(y, nan=limit, posinf=limit, neginf=-limit), -limit, limit)


class DrivenRun:
    """A run driven by its output under a model, its effects on the motion of the causal filter."""

    def __init__(
        self,
        run: PreparedRun,
        values: Values,
        noise: Noise,
        cutoff: float,
        withheld: float = math.inf,
        since: float = -math.inf,
    ) -> None:
        self.run, self.values, self.noise = run, values, noise
        self.since = max(float(run.t[0]), since)
        self.crossover = run.crossover(noise)
        plain = drive(run, values, None)
        self.cutoff = cutoff
        self.causal = None if values.constant else self._causal(plain, cutoff, withheld)
        self.drive: DriveIntegrals = plain if self.causal is None else drive(run, values, self.causal)
        if noise.growth:
            motion = self.causal or self._causal(plain, cutoff, withheld)
            self.drive = with_growth(self.drive, noise, variance_functions(run, noise, motion))
        self._filter(plain)

    @cached_property
    def settled(self) -> RunState:
        """State at the values of the model and the smoothed motion, for which nothing is withheld."""
        return settled_state(self.run, self.values, self.noise)

    def _filter(self, plain: DriveIntegrals) -> None:
        """What else is of the filter over that drive, from the one without effects, too: nothing."""

    def _causal(self, plain: DriveIntegrals, cutoff: float, withheld: float) -> Signals:
        """Motion for the effects: acceleration from the output, position and velocity from the causal filter."""
        run = self.run
        track = run_filter(run, plain, self.noise)
        _, p, v = after_readings(track)
        count = max(1, int(np.searchsorted(run.t, withheld, side="right")))
        p[count:], v[count:] = p[count - 1], v[count - 1]
        t = uniform_times(run)
        motion = np.interp(t, run.t, p), np.interp(t, run.t, v)
        spread = math.sqrt(max(float(np.median(track.series("vv")[:count])), 0.0))
        return replace(output_signals(run, self.values, cutoff, motion), v_std=spread)

    @classmethod
    def on(cls, fit: Fit, run: PreparedRun, withheld: float = math.inf, since: float = -math.inf) -> Self:
        """A run that was prepared at a fit's origins, under its parameters and noise; readings count from `since` on,
        s."""
        values, noise = values_on(fit, run.recording), noise_on(fit, run)
        if math.isinf(withheld) and offset_is_its_own(fit, run.recording):
            values = with_offset_of(run, values, noise)
        return cls(run, values, noise, fit.validity["frequency"][1], withheld, since)


class Prediction(DrivenRun):
    """The causal filter over a run, ready to predict from any reading onwards."""

    def _filter(self, plain: DriveIntegrals) -> None:
        run, noise, cutoff = self.run, self.noise, self.cutoff
        track = run_filter(run, self.drive, noise)
        self.S, (self.e, self.p, self.v) = track.series("S"), after_readings(track)
        variance = noise.r + (self.drive.extra_r if len(self.drive.extra_r) else 0.0)
        self.P = posterior(track.series("pp"), track.series("pv"), track.series("vv"), self.S, variance)
        del track  # free the old track before the next is made; each holds nine arrays
        wait = max(run.wait(noise), run.filters.settle if run.filters.blocking else 0.0)
        self.counts: Flags = self.drive.settled(wait) & (run.t >= self.since)
        # Response to one unit of constant acceleration, and the running estimate of that constant.
        d = self.drive
        h = np.diff(d.t, prepend=d.t[0])
        once, twice = np.where(d.restart, 0.0, h), np.where(d.restart, 0.0, h**2 / 2.0)
        unit = replace(d, z=np.zeros_like(d.z), first=once, second=twice)
        e, self.unit_p, self.unit_v = after_readings(run_filter(run, unit, noise))
        self.unit_e = g = -e
        information = np.where(self.counts, g**2 / self.S, 0.0)
        self.information = np.cumsum(information)
        self.evidence = np.cumsum(np.where(self.counts, g * self.e / self.S, 0.0))
        self.travelled, self.moved = accumulated(plain, h)
        self.unknown = np.empty((3, len(h)))
        lost, since = np.where(d.restart, 0.0, d.extra_q * h), d.t - d.t[0]
        for power in self.unknown:
            np.cumsum(lost, out=power)
            lost *= since
        self.breaks = np.cumsum(d.restart)
        self.ahead = None if self.causal is None else self._dead_reckoning(self.causal, cutoff)
        self.nodes_apart = self.ahead.motion.step if self.ahead is not None and self.ahead.remembers else 0.0
        """Spacing of nodes on which simulated motion is remembered, by this or another model of its table, s; 0 where
        none is."""

    def _dead_reckoning(self, signals: Signals, cutoff: float) -> DeadReckoning:
        """What the effects do to simulated motion; between readings the output drives it as it drives the filter."""
        run = self.run
        stamps = self.values.stamps(signals.t + run.origins.t, run.origins.t)
        output = (
            output_at(run, stamps, corner_of(self.values, cutoff), run.tau(self.values))
            - self.values.bias * run.filters.at_rest
        )
        t, full = signals.t + run.origins.t, uniform_times(run)
        gravity = run.gravity.behind_high_passes(full, run.accel_step, cutoff)
        bare = run.rig.polarity / self.values.scale * output
        bare -= gravity if isinstance(gravity, float) else np.interp(t, full, gravity)
        v = integral(bare, signals.step)
        v += np.interp(t, run.t, self.travelled - np.interp(run.t, t, v))
        p = integral(v, signals.step)
        p += np.interp(t, run.t, self.moved - np.interp(run.t, t, p))
        lost = np.interp(t, run.t, self.unknown[0])
        return DeadReckoning(self.values, signals, bare, (v, p), self.noise.q, lost, run.filters)

    @classmethod
    def of(
        cls,
        fit: Fit,
        source: Source,
        *,
        start: float | None = None,
        end: float | None = None,
        withheld: float = math.inf,
        remembers: bool = False,
    ) -> Prediction:
        """Prepare a recording under a fit's parameters, noise and origins.

        Where effects remember what was before `start`, the fitted part of the same recording before it is their
        history; it counts nowhere else.
        """
        recording = recording_of(source)
        require_channels(fit.model, recording)
        begin = start if start is None or not remembers else start_of_history(fit, recording, start)
        if math.isinf(withheld):
            run = prepared(source, fit.origins, start=begin, end=end)
        else:
            run = prepare(recording, fit.origins, start=begin, end=end, withheld=withheld)
        return cls.on(fit, run, withheld, -math.inf if start is None else start)

    @cached_property
    def reference_noise(self) -> ReferenceNoise:
        """Noise of the reference, whose acceleration is as noisy as that of the output at the crossover.

        An acceleration has no crossover: see `WeakRows`, which takes it for a position. Where readings were lost, those
        beside them stand for more time than one step, and noise averages out the less.
        """
        run, noise = self.run, self.noise.usual
        weight = np.minimum(np.gradient(run.t), MOST_STEPS * run.reading_step)  # nothing is integrated over a hole
        lost = float(weight @ weight) / (run.reading_step * float(np.sum(weight)))
        radians, output = 2.0 * np.pi * run.crossover(noise), 2.0 * noise.q * lost
        if run.order == 0:
            return ReferenceNoise(0, output * (2.0 * np.pi * run.confirmed / radians) ** 4)
        return ReferenceNoise(run.order, output / radians ** (2 * run.order))

    def constants(self, k: NDArray[np.intp]) -> tuple[Array, Array]:
        """Constant acceleration estimated from the innovations up to readings `k`, with standard deviation, (n,) m/s²:
        0 and infinite where there is nothing to estimate it from."""
        information = self.information[k]
        determined = information > 0.0
        value = np.divide(self.evidence[k], information, out=np.zeros(len(k)), where=determined)
        return value, np.where(determined, np.where(determined, information, 1.0) ** -0.5, math.inf)

    def along(self, k: int, rows: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Readings at `rows` predicted from reading `k`: frozen, rezeroed and standard deviation, (n,) m each."""
        frozen, rezeroed, std = self._predict(np.array([k]), rows[None, :])
        return frozen[0], rezeroed[0], std[0]

    def _predict(self, k: NDArray[np.intp], rows: NDArray[np.intp], rezero: bool = True) -> tuple[Array, Array, Array]:
        """Readings at `rows` (m, n) predicted from the readings `k` (m,): frozen, rezeroed and standard deviation; only
        the first is complete unless `rezero`."""
        t = self.run.t
        before = k[:, None]
        h = t[rows] - t[before]
        driven = self.moved[rows] - self.moved[before] - h * self.travelled[before]
        frozen = self.p[before] + h * self.v[before] + driven
        constant, _ = self.constants(k)
        unit_p, unit_v = self.unit_p[k], self.unit_v[k]
        rezeroed = frozen + constant[:, None] * (unit_p[:, None] + h * unit_v[:, None] + h**2 / 2.0)
        std = self._open_floor(k, t[rows])
        if self.ahead is None or rows.size == 0:
            return frozen, rezeroed, std
        origin, P = self.run.origins, np.stack([entry[k] for entry in self.P], axis=1)
        plain = Starts(t[k] - origin.t, self.p[k] - origin.p, self.v[k], np.zeros(len(k)), P)
        moved = replace(plain, p=plain.p + constant * unit_p, v=plain.v + constant * unit_v, constant=constant)
        # A constant of the effects, which the bias takes back, moves no path away.
        constant_move = 0.5 * abs(self.ahead.gain * float(np.mean(self.ahead.known_effects))) * float(np.max(h)) ** 2
        limit = DIVERGED * float(np.ptp(self.run.z) + np.max(std)) + constant_move
        for batch in self.ahead.batches(len(k), float(np.max(h))):
            at = t[rows[batch]] - origin.t
            followed = self.ahead.feeds_back and rezero
            added, variance = self.ahead.displacement(plain.part(batch), at, limit, floor=followed)
            frozen[batch] += within(limit, added)
            if followed:
                std[batch] = within(limit, np.sqrt(variance))
                added, _ = self.ahead.displacement(moved.part(batch), at, limit, floor=False)
            rezeroed[batch] += within(limit, added)
        return frozen, rezeroed, std

    def _open_floor(self, k: NDArray[np.intp], t: Array) -> Array:
        """Standard deviation of predictions from readings `k` (m,) to times `t` (m, n) from noise, start state and what
        the samples do not hold, where no effect depends on simulated motion, (m, n) m.

        A velocity that is lost at an instant t_i, of variance w_i, moves the position by sum w_i (t - t_i)² until t.
        """
        pp, pv, vv = (entry[k][:, None] for entry in self.P)
        rows = np.searchsorted(self.run.t, t, side="right") - 1
        zeroth, first, second = (block[rows] - block[k][:, None] for block in self.unknown)
        since = t - self.run.t[0]
        lost = np.maximum(since * (since * zeroth - 2.0 * first) + second, 0.0)
        del rows, zeroth, first, second, since  # as long as the record is
        h = t - self.run.t[k][:, None]
        return np.asarray(np.sqrt(h * (h * (self.noise.q * h / 3.0 + vv) + 2.0 * pv) + pp + lost))

    def starts(self, horizon: float) -> NDArray[np.intp]:
        """Start readings for a horizon: after the warm-up, evenly spread, with an unbroken record ahead."""
        t = self.run.t
        first = self.since + min(WARM_UP, 0.25 * (t[-1] - self.since))
        last = t[-1] - horizon
        if last < first:
            return np.empty(0, dtype=np.intp)
        k = np.unique(np.searchsorted(t, np.linspace(first, last, MOST_STARTS)))
        k = self._fewer(k, horizon)
        end = np.minimum(np.searchsorted(t, t[k] + horizon), len(t) - 1)
        return np.asarray(k[(self.breaks[end] == self.breaks[k]) & self.counts[k]])

    def _fewer(self, k: NDArray[np.intp], horizon: float) -> NDArray[np.intp]:
        """Every so many of the start readings where effects remember simulated motion."""
        if not self.nodes_apart:
            return k
        nodes = len(k) * (horizon + MEMORY) / self.nodes_apart
        return k[:: max(1, min(math.ceil(nodes / MOST_NODES), len(k) // FEWEST_STARTS))]

    def at_horizon(self, horizon: float) -> Coasting:
        """Coasting errors at one horizon, from every start point that has an unbroken record ahead."""
        t = self.run.t
        starts = self.starts(horizon)
        ends = np.minimum(np.searchsorted(t, t[starts] + horizon), len(t) - 1)
        rows = ends[:, None]
        frozen, rezeroed, floor = (y[:, 0] for y in self._predict(starts, rows))
        reading = self.run.readings[ends]
        # effects that hold simulated motion back, as friction does, hold noise back too
        held_back = self.ahead is not None and self.ahead.feeds_back
        unheld = self._open_floor(starts, t[rows])[:, 0] if held_back else floor
        return Coasting(starts, ends, reading - frozen, reading - rezeroed, floor, unheld)

    def along_measured(self) -> Prediction:
        """The same with the effects on the motion that was measured, in place of the simulated one."""
        other = copy.copy(self)
        other.travelled, other.moved = accumulated(self.drive, np.diff(self.drive.t, prepend=self.drive.t[0]))
        other.ahead = None
        return other

    @cached_property
    def steps(self) -> Flags:
        """Readings that count, and that no gap of either channel lies before: what leads across one is no one step."""
        run, t, stamps = self.run, self.run.t, self.run.whole.t
        behind = np.diff(t, prepend=t[0]) > HOLE_LEAST * run.reading_step
        gaps = np.flatnonzero(np.diff(stamps) > HOLE_LEAST * run.accel_step)
        ends = np.column_stack([np.searchsorted(t, stamps[gaps]), np.searchsorted(t, stamps[gaps + 1]) + 1])
        behind |= within_spans(ends, len(t))
        steps: Flags = self.counts & ~behind
        return steps if steps.any() else self.counts

    @property
    def one_step_rms(self) -> float:
        """Rms error of the prediction of the next reading, m."""
        return root_mean_square(self.e[self.steps])

    def k_step(self, k: int) -> float | None:
        """Rms error of the prediction `k` readings ahead, m; None when the record is too short."""
        n = len(self.run.t)
        if n <= 4 * k:
            return None
        if k == 1:
            return self.one_step_rms
        at = np.arange(0, n - k)
        at = at[self.counts[at] & (self.breaks[at + k] == self.breaks[at])]
        if self.ahead is not None:
            at = self._fewer(at[:: max(1, len(at) // MOST_STARTS)], k * self.run.reading_step)
        if len(at) == 0:
            return None
        squares = 0.0
        for batch in batches(len(at), RESAMPLED):
            starts = at[batch]
            ends = starts + k
            error = self.run.readings[ends] - self._predict(starts, ends[:, None], rezero=False)[0][:, 0]
            squares += float(error @ error)
        return math.sqrt(squares / len(at))

    def simulate(self) -> tuple[Array, Array, Array, Array]:
        """Run free from the first settled reading to the next hole or the end; position is never looked at again."""
        k = int(np.argmax(self.counts))
        same = np.flatnonzero(self.breaks == self.breaks[k])
        rows = same[same > k]
        frozen, _, std = self.along(k, rows)
        return self.run.t[rows], self.run.readings[rows], frozen, std


def noise_on(fit: Fit, run: PreparedRun) -> Noise:
    """Noise of a fit on a run. A position stands for an acceleration as far as the motion of that run goes."""
    noise = fit.noise()
    if run.order:
        return noise
    density = fit.runs[0].noise.all.reading ** 2 * median_step(run.reference_readings[0])
    return replace(noise, r=density / (2.0 * math.pi * run.confirmed) ** 4 / run.reading_step)


def accumulated(drive: DriveIntegrals, h: Array) -> tuple[Array, Array]:
    """Velocity gained and position moved since the first reading by what drives the motion, (n,) m/s and m."""
    travelled = np.cumsum(drive.first)
    moved = h.copy()
    moved[0] *= 0.0
    moved[1:] *= travelled[:-1]
    moved += drive.second
    return travelled, np.cumsum(moved, out=moved)


def posterior(pp: Array, pv: Array, vv: Array, S: Array, r: Array | float) -> tuple[Array, Array, Array]:
    """Covariance entries of (p, v) after each reading, from those before, its innovation's variance and its own."""
    keep = r / S
    return pp * keep, pv * keep, vv - pv**2 / S
