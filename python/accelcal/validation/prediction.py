"""Prediction from any reading onwards, without position: the causal filter, the output, and simulated motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array, Flags
from accelcal.data.recording import Recording
from accelcal.effects import is_local
from accelcal.estimation.drive import DriveIntegrals, drive, run_filter
from accelcal.estimation.estimate import Fit, require_channels
from accelcal.estimation.run import PreparedRun, prepare
from accelcal.estimation.smoothing import output_at, output_signals, uniform_times
from accelcal.estimation.values import Noise, Values
from accelcal.signals.processing import derivative, integral
from accelcal.signals.signals import CORNER_NOISE, Signals

MOST_STARTS = 200
"""Start points of coasting, spread over the record."""
WARM_UP = 5.0
"""Seconds before the first start point; a quarter of shorter records."""
MEMORY = 10.0
"""Seconds before a start over which effects with memory are evaluated; others need the time from the start on."""


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


def rms(y: Array) -> float | None:
    """Root mean square; None of nothing."""
    return float(np.sqrt(np.mean(y**2))) if len(y) else None


class Prediction:
    """The causal filter over a run, ready to predict from any reading onwards."""

    def __init__(
        self, run: PreparedRun, values: Values, noise: Noise, cutoff: float, withheld: float = math.inf
    ) -> None:
        self.run, self.values, self.noise = run, values, noise
        self.crossover = run.crossover(noise)
        plain = drive(run, values, None)
        self.causal = None if values.constant else self._causal(plain, cutoff, withheld)
        self.drive: DriveIntegrals = plain if self.causal is None else drive(run, values, self.causal)
        track = run_filter(run, self.drive, noise)
        self.e, self.S = track.series("e"), track.series("S")
        gain_p, gain_v = track.series("gain_p"), track.series("gain_v")
        self.p = track.series("p") + gain_p * self.e
        self.v = track.series("v") + gain_v * self.e
        self.P = posterior(track.series("pp"), track.series("pv"), track.series("vv"), self.S, noise.r)
        del track  # free the old track before the next is made; each holds nine arrays
        self.counts: Flags = self.drive.settled(run.wait(noise))
        # Response to one unit of constant acceleration, and the running estimate of that constant.
        d = self.drive
        h = np.diff(d.t, prepend=d.t[0])
        once, twice = np.where(d.restart, 0.0, h), np.where(d.restart, 0.0, h**2 / 2.0)
        unit = DriveIntegrals(d.t, np.zeros_like(d.z), once, twice, d.restart, d.extra_q)
        response = run_filter(run, unit, noise)
        g = -response.series("e")
        self.unit_p = response.series("p") - gain_p * g
        self.unit_v = response.series("v") - gain_v * g
        information = np.where(self.counts, g**2 / self.S, 0.0)
        self.information = np.cumsum(information)
        self.evidence = np.cumsum(np.where(self.counts, g * self.e / self.S, 0.0))
        self.travelled, self.moved = accumulated(plain, h)
        since = d.t - d.t[0]
        self.unknown = np.cumsum(np.where(d.restart, 0.0, d.extra_q * h) * since ** np.arange(3.0)[:, None], axis=1)
        self.breaks = np.cumsum(d.restart)

    def _causal(self, plain: DriveIntegrals, cutoff: float, withheld: float) -> Signals:
        """Motion for the effects: acceleration from the output, position and velocity from the causal filter."""
        run = self.run
        track = run_filter(run, plain, self.noise)
        e = track.series("e")
        p = track.series("p") + track.series("gain_p") * e
        v = track.series("v") + track.series("gain_v") * e
        known = max(1, int(np.searchsorted(run.t, withheld, side="right")))
        p[known:], v[known:] = p[known - 1], v[known - 1]
        t = uniform_times(run)
        motion = np.interp(t, run.t, p), np.interp(t, run.t, v)
        spread = math.sqrt(max(float(np.median(track.series("vv")[:known])), 0.0))
        signals = replace(output_signals(run, self.values, cutoff, motion), v_std=spread)
        self.a_std = max(signals.a_std, signals.a_width / CORNER_NOISE)
        self.v_std = max(signals.v_std, signals.v_width / CORNER_NOISE)
        acting = [term for port in ("output", "position") for term, _ in self.values.additive(port)]
        self.memory = 0.0 if all(is_local(term.effect) for term in acting) else MEMORY
        at = self.values.stamps(signals.t + run.origins.t, run.origins.t)
        at_grid = output_at(run, at, cutoff, run.tau(self.values)) - self.values.bias * run.filters.at_rest
        self.gain = run.rig.polarity / self.values.scale
        gravity = run.gravity.behind_high_passes(t, run.accel_step, cutoff)
        if isinstance(gravity, np.ndarray):
            gravity = np.interp(signals.t + run.origins.t, t, gravity)
        self.bare: Array = self.gain * at_grid - gravity
        return signals

    @classmethod
    def of(
        cls,
        fit: Fit,
        recording: Recording,
        *,
        start: float | None = None,
        end: float | None = None,
        withheld: float = math.inf,
    ) -> Prediction:
        """Prepare a recording under a fit's parameters, noise and origins."""
        require_channels(fit, recording)
        run = prepare(recording, fit.origins, start=start, end=end, withheld=withheld)
        return cls(run, fit.values(), fit.noise(), fit.validity["frequency"][1], withheld)

    def constant_at(self, k: int) -> tuple[float, float]:
        """Constant acceleration estimated from the innovations up to reading `k`, with standard deviation, m/s²."""
        information = float(self.information[k])
        if information <= 0.0:
            return 0.0, math.inf
        return float(self.evidence[k]) / information, information**-0.5

    def predict(self, k: int, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Readings at `rows` predicted from reading `k`: frozen and rezeroed, (n,) m each."""
        h = self.run.t[rows] - self.run.t[k]
        driven = self.moved[rows] - self.moved[k] - h * self.travelled[k]
        frozen = self.p[k] + h * self.v[k] + driven
        if self.causal is not None:
            frozen = frozen + self.effects_ahead(self.causal, k, rows)
        delta, std = self.constant_at(k)
        if not math.isfinite(std):
            return frozen, frozen
        return frozen, frozen + delta * (self.unit_p[k] + h * self.unit_v[k] + h**2 / 2.0)

    def effects_ahead(self, known: Signals, k: int, rows: NDArray[np.intp]) -> Array:
        """Contribution of the model's effects to the readings at `rows`, from output and simulated motion, (n,) m."""
        run, origin, step = self.run, self.run.origins, known.step
        begin = self.run.t[k] - origin.t
        past = np.searchsorted(known.t, [begin - self.memory, begin], side="right")
        count = int((self.run.t[rows[-1]] - self.run.t[k]) / step) + 3
        t = begin + step * np.arange(count)
        bare = np.interp(t, known.t, self.bare)
        gravity = known.gravity if isinstance(known.gravity, float) else np.interp(t, known.t, known.gravity)
        total = np.zeros(count)
        history = slice(int(past[0]), int(past[1]))
        n = history.stop - history.start

        def joined(before: Array, after: Array) -> Array:
            return np.concatenate([before[history], after])

        for _ in range(3):  # each round gains the ratio of the effects to the motion
            a = bare - self.gain * total
            v = self.v[k] + integral(a, step)
            p = self.p[k] - origin.p + integral(v, step)
            sensed = run.rig.polarity * (a + gravity)
            ahead = replace(
                known,
                t=joined(known.t, t),
                p=joined(known.p, p),
                v=joined(known.v, v),
                a=joined(known.a, sensed),
                jerk=joined(known.jerk, derivative(sensed, step)),
                side={name: joined(y, np.interp(t, known.t, y)) for name, y in known.side.items()},
                a_std=self.a_std,
                v_std=self.v_std,
            )
            whole = self.values.total("output", ahead)
            total = total if whole is None else whole[n:]
        at = self.run.t[rows] - origin.t
        added = np.interp(at, t, -self.gain * integral(integral(total, step), step))
        direct = self.values.total("position", ahead)
        return np.asarray(added if direct is None else added + np.interp(at, t, direct[n:]))

    def floor(self, k: int, t: Array) -> Array:
        """Standard deviation of the prediction from noise, start state and what the samples do not hold, (n,) m.

        A velocity that is lost at an instant t_i, of variance w_i, moves the position by sum w_i (t - t_i)² until t.
        """
        pp, pv, vv = (entry[k] for entry in self.P)
        h = t - self.run.t[k]
        rows = np.searchsorted(self.run.t, t, side="right") - 1
        zeroth, first, second = self.unknown[:, rows] - self.unknown[:, [k]]
        since = t - self.run.t[0]
        lost = np.maximum(since**2 * zeroth - 2.0 * since * first + second, 0.0)
        return np.asarray(np.sqrt(self.noise.q * h**3 / 3.0 + lost + pp + 2.0 * h * pv + h**2 * vv))

    def starts(self, horizon: float) -> NDArray[np.intp]:
        """Start readings for a horizon: after the warm-up, evenly spread, with an unbroken record ahead."""
        t = self.run.t
        first = t[0] + min(WARM_UP, 0.25 * (t[-1] - t[0]))
        last = t[-1] - horizon
        if last < first:
            return np.empty(0, dtype=np.intp)
        k = np.unique(np.searchsorted(t, np.linspace(first, last, MOST_STARTS)))
        end = np.minimum(np.searchsorted(t, t[k] + horizon), len(t) - 1)
        return np.asarray(k[(self.breaks[end] == self.breaks[k]) & self.counts[k]])

    def at_horizon(self, horizon: float) -> Coasting:
        """Coasting errors at one horizon, from every start point that has an unbroken record ahead."""
        t = self.run.t
        starts = self.starts(horizon)
        ends = np.minimum(np.searchsorted(t, t[starts] + horizon), len(t) - 1)
        errors = np.empty((len(starts), 3))
        for i, (k, row) in enumerate(zip(starts, ends, strict=True)):
            frozen, rezeroed = self.predict(int(k), np.array([row]))
            errors[i] = (
                self.run.readings[row] - frozen[0],
                self.run.readings[row] - rezeroed[0],
                self.floor(int(k), t[[row]])[0],
            )
        return Coasting(starts, ends, *errors.T)

    def k_step(self, k: int) -> float | None:
        """Rms error of the prediction `k` readings ahead, m; None when the record is too short."""
        n = len(self.run.t)
        if n <= 4 * k:
            return None
        if k == 1:
            return float(np.sqrt(np.mean(self.e[self.counts] ** 2)))
        at = np.arange(0, n - k)
        at = at[self.counts[at] & (self.breaks[at + k] == self.breaks[at])]
        if self.causal is not None:
            at = at[:: max(1, len(at) // MOST_STARTS)]
            error = np.array([self.run.readings[i + k] - self.predict(int(i), np.array([i + k]))[0][0] for i in at])
        else:
            h = self.run.t[at + k] - self.run.t[at]
            driven = self.moved[at + k] - self.moved[at] - h * self.travelled[at]
            error = self.run.readings[at + k] - (self.p[at] + h * self.v[at] + driven)
        return float(np.sqrt(np.mean(error**2))) if len(error) else None

    def simulate(self) -> tuple[Array, Array, Array, Array]:
        """Run free from the first settled reading to the next hole or the end; position is never looked at again."""
        k = int(np.argmax(self.counts))
        same = np.flatnonzero(self.breaks == self.breaks[k])
        rows = same[same > k]
        frozen, _ = self.predict(k, rows)
        return self.run.t[rows], self.run.readings[rows], frozen, self.floor(k, self.run.t[rows])


def accumulated(drive: DriveIntegrals, h: Array) -> tuple[Array, Array]:
    """Velocity gained and position moved since the first reading by what drives the motion, (n,) m/s and m."""
    travelled = np.cumsum(drive.first)
    return travelled, np.cumsum(h * np.concatenate([[0.0], travelled[:-1]]) + drive.second)


def posterior(pp: Array, pv: Array, vv: Array, S: Array, r: float) -> tuple[Array, Array, Array]:
    """Covariance entries of (p, v) after each reading."""
    keep = r / S
    return pp * keep, pv * keep, vv - pv**2 / S
