"""Rows of the weak form of one run, whitened by their exact covariance: what `ColumnFilter` offers, made without a
filter."""

from __future__ import annotations

import copy
import math
import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np
import scipy
from scipy.sparse import csr_array as Sparse

from accelcal.data import POSITION_ORDER, Array, Flags, batches, median_step, within_spans
from accelcal.data.clocks import decimal_step
from accelcal.data.orientation import HOLE
from accelcal.estimation.columns import MOST_READINGS, MOST_SUMS, OVERSAMPLING, column_parts, remembers
from accelcal.estimation.run import MOST_CROSSOVER
from accelcal.estimation.run_state import RunState
from accelcal.estimation.smoothing import (
    SmoothedMotion,
    corner_of,
    given_signals,
    held_after,
    smoothed_signals,
    uniform_times,
)
from accelcal.estimation.values import Noise
from accelcal.estimation.weak_form.channel import DEGREE, SampledChannel, Splines, covering
from accelcal.estimation.weak_form.covariance import (
    Covariance,
    NoWeakForm,
    Whitening,
    bands,
    constant_diagonals,
    factor,
    solved,
)
from accelcal.model import Term
from accelcal.signals.processing import cubic, derivative, low_pass
from accelcal.signals.series import lagrange_weights
from accelcal.signals.signals import Signals

TOGETHER = 4096
"""Test functions whose sums are taken at a time."""
COPIES = 4
"""Of the columns of a stretch, on their way through the whitening."""
FEWEST_ROWS = 64
"""Fewer rows than this are no regression."""
LEAST_STEPS = 400
"""Steps of the test functions in a record, least: half a test function is lost at either end, 1 % of it each."""
PROBED = 32
"""Test functions on either side of the middle of a record, whose covariance is that of all where clocks are even."""
RESOLVED = 1.2
"""Steps of a channel between two test functions, least, where it is no whole number: aliases then stay below 1e-8."""
WHOLE = 1e-3
"""Distance from a whole number that counts as one."""
RESOLVING = 0.05
"""Frequency over the slower of both rates up to which test functions resolve the noise, most: closer to them a sum
stands on a few samples, and of the noise nothing more is told."""
MOVING = 0.2
"""The same of a motion that lies beyond: without it no parameter is told at all."""
WITHIN = 0.02
"""Share of the power of the motion below which test functions of the usual width resolve nothing of it."""
TWICE_DIFFERENTIATED = 7
"""Degree of the splines through the readings whose second derivatives are taken."""
LOST = 1.5
"""Spacing of output samples, in their steps, beyond which no test function crosses it."""


class WeakRows:
    """Innovations and columns of the weak form of one run (derivations 6.15).

    For a test function phi and noise-free channels <phi'', z> = <phi, p''>; what the model takes for p'' leaves
    <phi'', z> - <phi, p''(u)> = noise, whose covariance over overlapping test functions is known exactly.

    Parameters
    ----------
    state : a run at given coefficients; its smoothed motion makes the columns, its noise whitens them.

    Raises
    ------
    NoWeakForm
        If the run is too short or broken, its output has passed a high-pass, or its position a filter while only some
        readings are used.
    """

    def __init__(self, state: RunState) -> None:
        self._state: Callable[[], RunState | None] = lambda: state
        self.signals: Signals = state.signals
        run, values = state.run, state.values
        if run.filters.blocking and run.order == POSITION_ORDER:
            raise NoWeakForm("the output has passed a high-pass, whose state at the start is not known")
        if run.filters.acts and run.read is not None and run.order == POSITION_ORDER:
            raise NoWeakForm("the position is filtered, and only some of its readings are used")
        self._clock = float(run.t[0])  # a small offset would be lost in the last digits of a clock from 1970
        stamps = values.instants(run.driving.t - self._clock, run.origins.t - self._clock)
        if len(stamps) <= DEGREE:
            raise NoWeakForm("the record is too short")
        self._tau = run.tau(values)
        self.order = run.order
        """How many derivatives of the reference make an acceleration."""
        t, z = self._read()
        self.reading_step = median_step(t)
        begin, end = max(t[0], stamps[0]), min(t[-1], stamps[-1], run.t[-1] - self._clock)
        self.splines = splines_over(float(begin), float(end), self._step(float(end - begin)))
        self._gain = run.rig.polarity / values.scale
        last = 4.0 * float(np.spacing(abs(self._clock) + t[-1]))
        written = [max(last, decimal_step(stamps)) for stamps in (run.all_readings[0], run.driving.t)]
        self._zero = float(np.mean(z)) if self.order else 0.0
        self._readings = run.unchanged(
            "readings",
            (t, z - self._zero, self.rate),
            lambda: SampledChannel.of(t, z - self._zero, self.reading_step, self.rate, written[0]),
        )
        output = run.driving.y - values.bias * run.filters.at_rest
        self._output = SampledChannel.of(stamps, output, run.accel_step, self.rate, written[1])
        self._kept = self._whole_ones(stamps)
        if int(np.count_nonzero(self._kept)) < FEWEST_ROWS:
            raise NoWeakForm("the record is too short, or breaks off too often")
        self.raw, self.covariance = self._summed()
        self.noise = self._of_reference(state.noise)
        if run.read is not None or self.order != POSITION_ORDER:
            # the smoothed motion of fewer readings, or of other noise, has noise that these rows would regress on
            self.signals = self._smoothed()
            self.__dict__.pop("at_readings", None)

    @property
    def state(self) -> RunState:
        """The run, at the coefficients that these rows are of."""
        state = self._state()
        assert state is not None, "rows that a run holds live no longer than the run"
        return state

    def held(self) -> WeakRows:
        """These rows, to be held by their run: they refer to it weakly, so that both are freed as soon as nobody uses
        the run."""
        self._state = weakref.ref(self.state)
        return self

    def _of_reference(self, noise: Noise) -> Noise:
        """The noise of the filter over positions, with the variance of a reading of the reference in its own unit.

        Of a velocity it is the one whose crossover is the same. An acceleration has none: as many times the noise of
        the output as the variance of a position is larger than at `_even`.
        """
        run, order = self.state.run, self.order
        if order == POSITION_ORDER:  # the band of the noise is that of fewer readings
            return noise if self.state.band is None else noise.scaled(1.0, run.reading_step / self.reading_step)
        radians = 2.0 * np.pi * run.crossover(noise)
        per_rate = radians**-2 if order else (self._even / radians) ** 4
        return replace(noise, r=noise.q * per_rate / self.reading_step, growth=())

    @property
    def of_positions(self) -> Noise:
        """The noise, with the variance of a position for the filter; `_of_reference` leads back."""
        if self.order == POSITION_ORDER:
            return self.noise
        q, per_rate = self.noise.q, self.noise.r * self.reading_step / self.noise.q
        fourth = per_rate**2 if self.order else per_rate / self._even**4
        return replace(self.noise, r=q * fourth / self.state.run.reading_step)

    @property
    def _even(self) -> float:
        """Crossover of a position that stands for an acceleration as noisy as the output, rad/s."""
        return 2.0 * math.pi * self.state.run.confirmed

    def least_reading_variance(self, q: float) -> float:
        """Least variance of a reading of the reference at a density of process noise."""
        run, step = self.state.run, self.reading_step
        if self.order == POSITION_ORDER:
            return run.reading_variance_floor(q, step)
        return q * step ** (2 * self.order - 1) / (2.0 * np.pi * MOST_CROSSOVER) ** (2 * self.order)

    def at_noise(self, noise: Noise) -> WeakRows:
        """The same rows, whitened at another noise."""
        rows_copy = copy.copy(self)
        rows_copy.noise = noise
        for name in ("factor", "whitened"):
            rows_copy.__dict__.pop(name, None)
        return rows_copy

    def moved(self, state: RunState, signals: Signals) -> WeakRows:
        """The rows of a run that differs in its signals alone, held by it: columns are of them, noise and innovations
        stay."""
        rows_copy = copy.copy(self)
        rows_copy._state, rows_copy.signals = weakref.ref(state), signals
        rows_copy._gain = state.run.rig.polarity / state.values.scale
        rows_copy.__dict__.pop("at_readings", None)
        return rows_copy

    def _read(self) -> tuple[Array, Array]:
        """Times, from the first that is used on, and positions of all readings, what the model adds to them taken off,
        as `drive` does; readings that are too good for the replay need not be thinned out here."""
        run = self.state.run
        if self.order != POSITION_ORDER:
            t, z = run.reference_readings
            return t - self._clock, z - run.filters.blocked(t, z)
        if run.read is None:
            return run.t - self._clock, self.state.drive.z
        t, z = run.read
        added = self._added_to_position()
        return t - self._clock, z if added is None else z - added

    def _step(self, span: float) -> float:
        """Spacing of the test functions over a span, s: as narrow as the motion and the crossover ask for, and the
        channels allow."""
        run, noise = self.state.run, self.state.noise.usual
        if self.order == POSITION_ORDER:
            crossover = (noise.q / (noise.r * self.reading_step)) ** 0.25 / (2.0 * np.pi)
        else:  # of two accelerations neither is the better one beyond the motion
            crossover = run.crossover(noise) if self.order else 0.0
        rate = 1.0 / max(self.reading_step, run.accel_step)
        highest = min(max(self.signals.cutoff, crossover), RESOLVING * rate)
        if self.signals.cutoff > highest and self._share_below(highest) < WITHIN:
            highest = min(self.signals.cutoff, MOVING * rate)
        widest = min(1.0 / (OVERSAMPLING * highest), span / LEAST_STEPS)
        every = max(1, int(widest / self.reading_step))
        while not resolved(every * self.reading_step / run.accel_step):
            every += 1
        return every * self.reading_step

    def _share_below(self, frequency: float) -> float:
        """Share of the power of the motion below a frequency, Hz, where rows may be."""
        s = self.signals
        moving = s.a[s.t > s.t[0] + self._unsettled] if s.t[-1] > s.t[0] + self._unsettled else s.a
        moving = moving - np.mean(moving)
        return float(np.mean(low_pass(moving, 1.0 / s.step, frequency) ** 2) / max(np.mean(moving**2), 1e-300))

    @property
    def _unsettled(self) -> float:
        """Time behind a start in which a high-pass of the output, applied to readings, has not settled, s."""
        filters = self.state.run.filters
        return filters.unsettled if filters.blocking else 0.0

    @property
    def rate(self) -> float:
        """Of the rows, Hz; those that a break takes away are not missed."""
        return 1.0 / self.splines.step

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.raw)

    @property
    def times(self) -> Array:
        """Middle of the test function of each row, (rows,) s."""
        return (self._clock + self.splines.begins + 0.5 * self.splines.support)[self._kept]

    @cached_property
    def factor(self) -> Array:
        """Cholesky factor of the covariance at the noise, by its diagonals."""
        return factor(self.covariance.at(self.noise.q, self.noise.r))

    @cached_property
    def whitened(self) -> Array:
        """Innovations, (rows,)."""
        return solved(self.factor, self.raw[:, None])[:, 0]

    @cached_property
    def at_readings(self) -> Signals:
        """The motion at the times of the readings, where effects of the encoder are evaluated."""
        return self.signals.resampled(self.state.run.all_readings[0] - self.state.run.origins.t)

    def stretches(self, terms: Sequence[Term]) -> Iterator[tuple[slice, Array]]:
        """Whitened columns, stretch by stretch.

        Yields
        ------
        The rows of the stretch, and the columns (terms, rows of the stretch) in the order of the terms.
        """
        ports = {term.port for term in terms}
        with_memory = [k for k, term in enumerate(terms) if remembers(self.state.run, term.effect)]
        whiten, begin = Whitening(self.factor, len(terms)), 0
        finest = min(self.reading_step, self.state.run.accel_step)
        most = min(int(MOST_READINGS * finest / self.splines.step), MOST_SUMS // COPIES // max(1, len(terms)))
        most = max(DEGREE + 1, most)
        parts = batches(self.splines.count, most)
        together = max(1, MOST_SUMS // max(1, len(with_memory) * most))
        for number, part in enumerate(parts):
            if number % together == 0:
                remembered = self._remembered([terms[k] for k in with_memory], parts[number : number + together])
                first_row = begin
            against: dict[str, tuple[slice, Sparse]] = {port: self._against(port, part) for port in ports}
            columns = np.empty((int(np.count_nonzero(self._kept[part])), len(terms)), order="F")
            grid, readings = (against[port][0] if port in against else slice(0) for port in ("output", "position"))
            for here, port, columns_part in column_parts(
                self.state.run, self.signals, terms, grid, readings, lambda: self.at_readings, with_memory
            ):
                columns[:, here] = against[port][1] @ np.column_stack(columns_part)
            rows = slice(begin, begin + len(columns))
            columns[:, with_memory] = remembered[rows.start - first_row : rows.stop - first_row]
            yield rows, whiten(rows, columns).T
            begin = rows.stop
        if len(self._readings.t) > MOST_READINGS:
            self.__dict__.pop("at_readings", None)  # memory

    def _remembered(self, terms: Sequence[Term], parts: Sequence[slice]) -> Array:
        """Columns over successive stretches, (rows, terms), each evaluated over the whole run once."""
        remembered = np.empty((sum(int(np.count_nonzero(self._kept[part])) for part in parts), len(terms)))
        whole = slice(None)
        for here, port, columns in column_parts(
            self.state.run, self.signals, terms, whole, whole, lambda: self.at_readings, ()
        ):
            begin = 0
            for part in parts:
                rows, weights = self._against(port, part)
                sums = weights @ np.column_stack([column[rows] for column in columns])
                remembered[begin : begin + len(sums), here] = sums
                begin += len(sums)
            del columns  # as long as the run is, while the next are evaluated
        return remembered

    def _against(self, port: str, part: slice) -> tuple[slice, Sparse]:
        """Rows of the signals, or readings, within the test functions of a stretch, and their weights in its rows."""
        usable, output = self._kept[part], port == "output"
        near, weights = self._of_grid(part) if output else self._of_readings(part, POSITION_ORDER)
        return near, (weights if usable.all() else weights[usable]) * (-self._gain if output else 1.0)

    def _smoothed(self) -> Signals:
        """The motion smoothed by these rows: the share of either channel is then that of the innovations, so that the
        error of the regressors is not correlated with them.

        The noise that the rows show of a channel is taken off it; of the readings, where they are the better ones
        throughout, so that errors of the sums are small against the noise that is left.
        """
        run, state = self.state.run, self.state
        weight = np.zeros(self.splines.count)
        weight[self._kept] = scipy.linalg.cho_solve_banded((self.factor, True), self.raw)
        # beyond what the rows resolve nothing tells motion from noise of the output
        cutoff = min(self.signals.cutoff, self.rate / OVERSAMPLING)
        t = uniform_times(run)
        whole = self.order == POSITION_ORDER and not len(self._readings.carrier_t) and self._unbroken
        if whole and cutoff < run.crossover(self.of_positions):
            motion = self._of_smoothed_readings(weight, cutoff, t - self._clock)
            signals = given_signals(run, state.noise, state.values, motion, cutoff)
        else:
            noise = self._noise_of_output(weight, t)
            signals = smoothed_signals(
                run, state.drive, state.smoothed(), state.noise, state.values, self.signals, cutoff, noise
            )
        return replace(signals, reach=self.signals.reach)

    def _noise_of_output(self, weight: Array, t: Array) -> Array:
        """Noise of the output at times `t`, s, as the weighted rows show it, with the sign and scale of the stage."""
        noise = np.zeros(len(t))
        for part in batches(self.splines.count, TOGETHER):
            splines = self.splines.part(part.start, part.stop)
            near = covering(t - self._clock, splines)
            noise[near] -= splines.weights(t[near] - self._clock, 0, np.ones(near.stop - near.start)).T @ weight[part]
        return noise * (self.noise.q + held_after(self.state.drive, t))

    def _of_smoothed_readings(self, weight: Array, cutoff: float, t: Array) -> SmoothedMotion:
        """Motion at times `t` from the readings without the noise that the weighted rows show of them."""
        readings = self._readings
        noise = np.zeros(len(readings.t))
        for part in batches(self.splines.count, TOGETHER):
            rows, weights = self._of_readings(part, self.order)
            noise[rows] += weights.T @ weight[part]
        extra_r = self.state.drive.extra_r
        added = np.interp(self._clock + readings.t, self.state.run.t, extra_r) if len(extra_r) else 0.0
        smooth = readings.on_ticks(readings.y - (self.noise.r + added) * noise)
        ticks = readings.t if readings.ticks is None else readings.ticks
        rate, corner = (len(ticks) - 1) / float(ticks[-1] - ticks[0]), corner_of(self.state.values, cutoff)
        # filtered first: at its two ends the derivative of a curve through noisy readings would be anything
        curve = scipy.interpolate.make_interp_spline(ticks, low_pass(smooth, rate, corner), k=TWICE_DIFFERENTIATED)
        p, v, a = (cubic(ticks, np.asarray(curve(ticks, order)), t) for order in (0, 1, 2))
        return SmoothedMotion(p + self._zero, v, a, derivative(a, self.state.run.accel_step))

    @property
    def _unbroken(self) -> bool:
        """Whether no row is missing between the first and the last."""
        used = np.flatnonzero(self._kept)
        return bool(used[-1] - used[0] + 1 == len(used))

    def _whole_ones(self, stamps: Array) -> Flags:
        """Test functions that no break of a channel and no new zero of the position lies in, (count,)."""
        run, begins = self.state.run, self.splines.begins
        lost = np.flatnonzero(np.diff(stamps) > LOST * run.accel_step)
        spans = [self._output.around(stamps[lost], stamps[lost + 1], self.rate)]
        t, step = self._readings.t, self.reading_step
        widest = HOLE * step if self._readings.ticks is not None else max(self.splines.step, LOST * step)
        lost = np.flatnonzero(np.diff(t) > min(widest, HOLE * step))
        spans.append(self._readings.around(t[lost], t[lost + 1], self.rate))
        again = np.flatnonzero(self.state.drive.restart[1:])
        used = run.t - self._clock
        spans.append(self._readings.around(used[again], used[again + 1], self.rate))
        if self._unsettled > 0.0:
            starts = t[np.append(0, np.flatnonzero(run.filters.gaps(t)))]
            spans.append(np.column_stack([starts, starts + self._unsettled]))
        reached = np.concatenate(spans) - [self.splines.support, 0.0]
        return ~within_spans(np.searchsorted(begins, reached), self.splines.count)

    def _summed(self) -> tuple[Array, Covariance]:
        """<phi'', z> - <phi, p''(u)> of all rows, and their covariance."""
        run, s = self.state.run, self.signals
        total = self.state.values.total("output", s)
        added = np.zeros(len(s.t)) if total is None else run.filters.behind(total, s.step)
        if run.gravity.channel is None:
            added += run.gravity.constant * run.filters.at_rest / self._gain
        else:
            at = np.asarray(run.gravity.at(s.t + run.origins.t))
            added += run.filters.behind(at, s.step) / self._gain
        acts = bool(np.any(added))
        extra_q = held_after(self.state.drive, self._clock + self._output.t)
        extra_r = self.state.drive.extra_r if self.order == POSITION_ORDER else np.empty(0)
        if len(extra_r):
            extra_r = np.interp(self._clock + self._readings.t, run.t, extra_r)
        moved = self._added_to_position() if self.order != POSITION_ORDER else None
        constant = self._constant_variances()
        y = np.empty(np.count_nonzero(self._kept))
        covariance, begin = Covariance.of(len(y), constant), 0
        for part in batches(self.splines.count, TOGETHER):
            # The covariance reaches DEGREE rows beyond the part.
            wide = slice(part.start, min(part.stop + DEGREE, self.splines.count))
            usable = self._kept[wide]
            inner = int(np.count_nonzero(self._kept[part]))
            rows, begin = slice(begin, begin + inner), begin + inner
            samples, of_output = self._of_output(wide, self._tau)
            readings, of_readings = self._of_readings(wide, self.order)
            splines = self.splines.part(part.start, part.stop)
            count = splines.count
            sums = (-1.0) ** self.order * self._readings.sums(splines, self.order, of_readings[:count], readings)
            if moved is not None:
                near, of_effects = self._of_readings(part, POSITION_ORDER)
                sums -= of_effects @ moved[near]
            sums -= self._gain * self._output.sums(splines, 0, of_output[:count], samples, self._tau)
            if acts:
                grid, of_grid = self._of_grid(part)
                sums += self._gain * (of_grid @ added[grid])
            y[rows] = sums[self._kept[part]]
            of_noise = self._of_output(wide, 0.0)[1] if self._tau else of_output
            of_noise, of_readings, step = of_noise[usable], of_readings[usable], run.accel_step
            if constant is None:
                covariance.of_output[:, rows] = bands(of_noise, 1.0 / step)[:, :inner]
                among = self._readings, self.splines.step, wide.start, usable
                variances = run.unchanged(("variances", part.start), among, partial(bands, of_readings))
                covariance.of_readings[:, rows] = variances[:, :inner]
            if np.any(extra_q[samples]):
                covariance.extra[:, rows] += bands(of_noise, extra_q[samples] / step)[:, :inner]
            if len(extra_r) and np.any(extra_r[readings]):
                covariance.extra[:, rows] += bands(of_readings, extra_r[readings])[:, :inner]
        return y, covariance

    @property
    def reference_sums(self) -> Array:
        """<phi, reference> of all rows, of a reference that is an acceleration, (rows,)."""
        sums = []
        for part in batches(self.splines.count, TOGETHER):
            readings, weights = self._of_readings(part, 0)
            splines = self.splines.part(part.start, part.stop)
            sums.append(self._readings.sums(splines, 0, weights, readings)[self._kept[part]])
        return np.concatenate(sums)

    def _constant_variances(self) -> tuple[Array, Array] | None:
        """Covariance of a row with itself and those that follow it, (DEGREE + 1,), from unit noise of the output and of
        the readings; None where it is not the same along the record."""
        if not (self._output.even and self._readings.even and self._unbroken):
            return None
        middle = self.splines.count // 2
        probe = slice(max(0, middle - PROBED), min(middle + PROBED, self.splines.count))
        of_output = constant_diagonals(bands(self._of_output(probe, 0.0)[1], 1.0 / self.state.run.accel_step))
        of_readings = constant_diagonals(bands(self._of_readings(probe, self.order)[1]))
        return None if of_output is None or of_readings is None else (of_output, of_readings)

    def _of_output(self, part: slice, tau: float) -> tuple[slice, Sparse]:
        """Samples within some test functions, and their weights: <phi - tau phi', u> undoes a low-pass of tau.

        White noise in front of the low-pass is then <phi, noise>.
        """
        return self._output.against(self.splines.part(part.start, part.stop), 0, tau)

    def _added_to_position(self) -> Array | None:
        """What the model adds to the position, at the times of the readings, m; None where it adds nothing."""
        run, values = self.state.run, self.state.values
        if not any(values.additive("position")):
            return None
        added = values.total("position", self.at_readings)
        return None if added is None else run.filters.behind_at(run.all_readings[0], added)

    def _of_readings(self, part: slice, order: int) -> tuple[slice, Sparse]:
        """Readings within some test functions, and their weights in a derivative."""
        return self._readings.against(self.splines.part(part.start, part.stop), order)

    def _of_grid(self, part: slice) -> tuple[slice, Sparse]:
        """Rows of the signals within some test functions, and their weights; refined where the grid is coarse."""
        splines, s = self.splines.part(part.start, part.stop), self.signals
        t = s.t + (self.state.run.origins.t - self._clock)
        near = covering(t, splines)
        grid = slice(max(0, near.start - 2), min(len(t), near.stop + 2))
        between = math.ceil(RESOLVED * s.step / splines.step)
        if between <= 1:
            return grid, splines.weights(t[grid], 0, np.full(grid.stop - grid.start, s.step))
        fine, filled = refined(t[grid], between)
        return grid, (splines.weights(fine, 0, np.full(len(fine), s.step / between)) @ filled).tocsr()


def splines_over(begin: float, end: float, step: float) -> Splines:
    """Test functions that lie within a span, s."""
    return Splines(begin, step, max(0, int((end - begin) / step) - DEGREE))


def resolved(steps: float) -> bool:
    """Whether test functions so many samples apart take sums for integrals."""
    return steps >= RESOLVED or (round(steps) >= 1 and abs(steps - round(steps)) < WHOLE)


def refined(t: Array, between: int) -> tuple[Array, Sparse]:
    """Times with so many steps in place of one, and the matrix that leads there from the samples by cubics."""
    n = len(t)
    place = np.arange((n - 1) * between + 1) / between
    cell = np.clip(place.astype(np.intp) - 1, 0, n - 4)
    weights = np.column_stack(lagrange_weights([cell + k - place for k in range(4)]))
    rows = np.repeat(np.arange(len(place)), 4)
    columns = (cell[:, None] + np.arange(4)).ravel()
    fine = t[0] + place * float((t[-1] - t[0]) / (n - 1))
    return fine, Sparse((weights.ravel(), (rows, columns)), shape=(len(place), n))
