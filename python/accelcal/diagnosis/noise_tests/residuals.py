"""Residuals of a fitted run as the noise tests use them: the output above the motion, and whitened innovations."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy

from accelcal.data import POSITION_ORDER, Array, Flags
from accelcal.diagnosis.noise_tests.block_spectra import SHORT_BLOCKS, BlockSpectra
from accelcal.diagnosis.noise_tests.interpolation_error import REACH, InterpolationError, Places, high_passed
from accelcal.diagnosis.noise_tests.robust import Outliers, isolated_peaks, outliers, spread_of
from accelcal.diagnosis.policy import NOISE_TEST_ALPHA, OUTLIER_SIGMA
from accelcal.estimation.channel_filters import HOLE, LEAST_GAIN
from accelcal.estimation.rows import sums_of
from accelcal.estimation.run_state import RunState
from accelcal.signals.processing import low_pass, quintic
from accelcal.signals.series import bridged, grid_step, local_spread, widened
from accelcal.signals.signals import Signals
from accelcal.signals.transfer import Spectrum, noise_bandwidth
from accelcal.signals.unresolved import output_of

MOTION_FREE = 0.09
"""Share of the sampling rate above which motion is negligible: a stage that starts with a jump in snap leaves f^-3."""
SUBTRACTED = 1.2
"""Frequency, over the bandwidth of the smoothed motion, above which less than 6 % of the output is subtracted with it.
"""
FORGOTTEN_AFTER = 4.0
"""Time constants after which the filter has forgotten an outlier."""
TAIL = (0.1, 0.2)
"""Band, in sampling rates, where a motion that sampling does not resolve is stronger than above."""
LEAST_CHECK = 1e-4
"""Share of the reading noise in the variance of an innovation below which a reading is not checked by others."""
REPAIRS = 2
"""Rounds of filling in outlying samples; the noise spectrum that fills them in is more accurate without them."""


class Residuals:
    """Residuals of both channels beyond the fitted model, on uniform times."""

    def __init__(self, state: RunState) -> None:
        self.state, self.run = state, state.run
        self.signals: Signals = state.signals
        run, s = self.run, self.signals
        self.step = run.accel_step
        self.tau = run.tau(state.values)
        self.rate = 1.0 / self.step
        settling = 2.0 / s.cutoff if s.cutoff > 0.0 else 0.0
        settling = min(settling, 0.05 * float(run.t[-1] - run.t[0]))
        t = run.accel.t
        begin = int(np.searchsorted(t, run.t[0] + settling))
        inside = slice(begin, int(np.searchsorted(t, run.t[-1] - settling, side="right")))
        self.t_u, self.u = t[inside], run.accel.y[inside]
        place = self.place
        self.n = int(place[-1]) + 1
        self.sampled = np.zeros(self.n, dtype=np.bool_)
        self.sampled[place] = True
        self.edge = min(max(MOTION_FREE * self.rate, 2.0 * self.reach), 0.25 * self.rate)
        ends = int(4.0 * self.rate / self.edge)  # a spectrum takes the two ends of a record for a jump
        self.sampled[:ends] = self.sampled[self.n - ends :] = False
        self.sampled[widened(self.unresolved | self.holes, REACH)] = False

    @property
    def reads_position(self) -> bool:
        """Whether the reference is a position: of any other the filter over positions has no white innovations."""
        return self.run.order == POSITION_ORDER

    @cached_property
    def innovations(self) -> tuple[Array, float]:
        """What is white if the model is right, (m,), and its spacing, s: whitened innovations, or rows of the weak
        form."""
        if self.reads_position:
            return self.readings, self.run.reading_step
        sums = sums_of(self.state)
        y = sums.whitened
        limit = 5.0 * local_spread(y)
        return np.clip(y, -limit, limit), 1.0 / sums.rate

    @property
    def reach(self) -> float:
        """Frequency above which no motion is left in the output, Hz."""
        return max(self.signals.cutoff, self.signals.reach)

    @property
    def band(self) -> float:
        """Frequency from which on the residual holds the whole output, the tail of the motion included, Hz."""
        return SUBTRACTED * (self.reach if self.unresolved.any() else self.signals.cutoff)

    @property
    def place(self) -> Places:
        """Index of the uniform time of each sample, counted from the first."""
        return np.asarray(np.rint((self.t_u - self.t_u[0]) / self.step).astype(np.intp))

    @property
    def t(self) -> Array:
        """Uniform times, (n,) s."""
        return np.asarray(self.t_u[0] + self.step * np.arange(self.n))

    @property
    def model(self) -> Array:
        """Output that the model predicts at uniform times: smoothed motion through scale, effects, delay and RC."""
        s, values, run = self.signals, self.state.values, self.run
        grid = values.scale * s.a + values.bias
        for term, coefficient in values.additive("output"):
            grid = grid + coefficient * term.column(s)
        at = quintic(s.t + run.origins.t, grid, values.instants(self.t, run.origins.t))
        if self.tau > 0.0:  # exact for straight lines between samples
            x = self.step / self.tau
            d = math.exp(-x)
            b = [1.0 - (1.0 - d) / x, (1.0 - d) / x - d]
            at, _ = scipy.signal.lfilter(b, [1.0, -d], at, zi=[at[0] * (1.0 - b[0])])
        return np.asarray(run.filters.behind_output(at, self.step), dtype=np.float64)

    @cached_property
    def unresolved(self) -> Flags:
        """Uniform times about the jumps of the motion, (n,)."""
        jumps, begin = self.run.jumps, float(self.t_u[0])
        first = np.floor((jumps.t - jumps.before - begin) / self.step).astype(np.intp)
        last = np.ceil((jumps.t + jumps.after - begin) / self.step).astype(np.intp)
        edges = np.zeros(self.n + 1)
        np.add.at(edges, np.clip(first, 0, self.n), 1.0)
        np.add.at(edges, np.clip(last + 1, 0, self.n), -1.0)
        return np.asarray(np.cumsum(edges)[:-1] > 0.0)

    @property
    def holes(self) -> Flags:
        """Uniform times in gaps so long that the motion beside them is known to the position alone, (n,)."""
        length = np.diff(self.place, prepend=0)
        return np.concatenate([[False], np.repeat(length[1:] > HOLE, length[1:])])

    @cached_property
    def resolved_output(self) -> Array:
        """Output at uniform times without the jumps of the motion, the samples next to each bridged, (n,) m/s².

        A bridge over a jump would leave a fast slope, which no filter could tell from noise.
        """
        output = np.interp(np.arange(self.n), self.place, self.u)
        output -= output_of(self.run.jumps, float(self.t_u[0]), self.step, self.n)
        return bridged(output, self.unresolved)

    @cached_property
    def residual(self) -> Array:
        """Output minus model at uniform times, lost samples bridged by straight lines, (n,) m/s².

        Where the motion jumps, output and smoothed motion differ by more than noise: the jumps are bridged, and what
        is left is the output beyond the bandwidth of the motion.
        """
        if self.unresolved.any():
            return self.resolved_output - low_pass(self.resolved_output, self.rate, self.reach)
        place = self.place
        model = self.model
        slope = np.gradient(model, self.step)[place]
        r = self.u - model[place] - slope * (self.t_u - self.t_u[0] - self.step * place)
        return np.asarray(np.interp(np.arange(self.n), place, r))

    @cached_property
    def background(self) -> Array:
        """Residual above the band of any motion, (n,) m/s².

        Lost and outlying single samples are filled in from their neighbours, so that none rings in its block.
        """
        return self.above_motion(OUTLIER_SIGMA)

    def above_motion(self, limit: float) -> Array:
        """Residual above the band of any motion, samples beyond a limit in local deviations filled in, (n,) m/s².

        Without outliers the limit is infinite: short bursts of noise exceed what is usual about them, and are noise.
        """
        lost, correction = self.lost, np.zeros(self.n)
        for _ in range(REPAIRS):
            before = lost
            correction, lost = self.refilled(correction, before, limit)
            if lost is before:
                break
        return high_passed(self.residual - correction, self.rate, self.edge)

    def release(self) -> None:
        """Free `background` and `resolved_output` once their spectra are computed; reading them computes them again."""
        for name in ("background", "resolved_output"):
            vars(self).pop(name, None)

    def refilled(self, correction: Array, lost: Places, limit: float) -> tuple[Array, Places]:
        """Corrections (n,) of lost samples, from the noise left after earlier corrections; samples beyond a limit in
        local standard deviations count as lost."""
        whole = high_passed(self.residual - correction, self.rate, self.edge)
        interpolation = self.interpolation_filter(BlockSpectra.of(whole, self.sampled, self.rate, 1.3 * self.edge))
        del whole
        errors = interpolation(self.residual - np.mean(self.residual))
        correction = interpolation.correction(errors, lost)
        y = interpolation.corrected(errors, correction, lost)
        known = np.flatnonzero(self.sampled & np.isfinite(y))
        y = y[known]
        spread, _ = spread_of(y)
        np.hypot(spread, math.sqrt(self.white_floor * float(np.mean(interpolation.gain**2))), out=spread)
        score = np.abs(y)
        score /= np.maximum(spread, 1e-300)
        outlying = isolated_peaks(score, np.flatnonzero(score > limit))
        if len(outlying) == 0:
            return correction, lost
        outlying = known[outlying]
        lost = np.union1d(lost, np.clip(outlying[:, None] + np.arange(-1, 2), 0, self.n - 1))
        return interpolation.correction(errors, lost), lost

    def interpolation_filter(self, spectra: BlockSpectra) -> InterpolationError:
        """Filter that gives interpolation errors, for noise with these spectra."""
        return InterpolationError.of(spectra, self.n, self.rate, self.edge, self.least_power)

    @property
    def least_power(self) -> float:
        """Power of a sample below which declared filters leave none of the sensor's noise, (m/s²)²; 0 without any.

        What is seen there enters behind the filters: rounding, and errors of the model's own output.
        """
        return self.least_gain**2 * self.state.noise.usual.q * self.state.values.scale**2 * self.rate

    @property
    def lost(self) -> Places:
        """Indices of uniform times without a sample."""
        missing = np.ones(self.n, dtype=np.bool_)
        missing[self.place] = False
        return np.flatnonzero(missing)

    @cached_property
    def spectra(self) -> BlockSpectra:
        """Power of `background` in blocks."""
        return BlockSpectra.of(self.background, self.sampled, self.rate, 1.3 * self.edge)

    @cached_property
    def short_spectra(self) -> BlockSpectra:
        """Power of `background` in blocks as short as the peaks of a move's speed, where declared filters pass it."""
        return self.passed(BlockSpectra.of(self.background, self.sampled, self.rate, 1.3 * self.edge, SHORT_BLOCKS))

    def passed(self, spectra: BlockSpectra, highest: float = math.inf) -> BlockSpectra:
        """Some spectra at the frequencies that the declared filters pass, below the highest asked for, Hz."""
        passed = (spectra.f < highest) & (np.abs(self.gain(spectra.f)) >= self.least_gain)
        return replace(spectra, f=spectra.f[passed], power=spectra.power[:, passed])

    @property
    def interpolation_errors(self) -> tuple[Array, InterpolationError]:
        """Interpolation error of each sample of the residual given its neighbours, (n,) m/s², NaN where too few of them
        are left; the filter."""
        interpolation, lost = self.interpolation_filter(self.spectra), self.lost
        errors = interpolation(self.residual - np.mean(self.residual))
        return interpolation.corrected(errors, interpolation.correction(errors, lost), lost), interpolation

    @cached_property
    def motion(self) -> tuple[Array, Array]:
        """Velocity and jerk at the uniform times."""
        t = self.signals.t + self.run.origins.t
        return np.interp(self.t, t, self.signals.v), np.interp(self.t, t, self.signals.jerk)

    def motion_blocks(self, spectra: BlockSpectra) -> tuple[Array, Array, Array]:
        """Means of v², v⁴ and jerk² over the blocks of some spectra, (K,) each."""
        v, jerk = self.motion
        v2 = v**2
        return spectra.means(v2), spectra.means(v2**2), spectra.means(jerk**2)

    def tail_blocks(self, spectra: BlockSpectra) -> Array:
        """Power of the output over the blocks of some spectra in the band `TAIL`, below that of the tests, (K,)."""
        low, high = (share * self.rate for share in TAIL)
        output = self.resolved_output - low_pass(self.resolved_output, self.rate, 0.5 * low)
        tail = BlockSpectra.of(high_passed(output, self.rate, 0.8 * low), self.sampled, self.rate, low, spectra.window)
        return np.asarray(tail.power[:, tail.f < high].mean(axis=1))

    @cached_property
    def lsb(self) -> float:
        """Step of the grid on which the output lies, m/s²; 0 if it lies on none."""
        return grid_step(self.u)

    @property
    def white_floor(self) -> float:
        """Variance of a sample that enters behind every filter, (m/s²)²: rounding, and what the model's output errs by
        where declared filters leave nothing."""
        return self.lsb**2 / 12.0 + self.least_power

    @cached_property
    def smooth_position(self) -> Array:
        """RTS-smoothed position at the readings, m."""
        p, _, _ = self.state.track.smooth(*self.state.drive.arrays)
        return np.asarray(p)

    @property
    def at_jumps(self) -> Flags:
        """Settled readings so close to a jump of the motion that the integral of the output is uncertain there."""
        jumps, t = self.run.jumps, self.run.t[self.state.counts]
        begin, end = jumps.t - jumps.before - self.step, jumps.t + jumps.after + self.step
        open_ = np.searchsorted(np.sort(begin), t, side="right") - np.searchsorted(np.sort(end), t, side="left")
        return np.asarray(open_ > 0)

    @cached_property
    def reading_outliers(self) -> Outliers:
        """Outliers among the settled readings, against the smoothed position; see `outliers`.

        None where the readings alone determine the position: no other measurement checks them.
        """
        if self.state.noise.r < LEAST_CHECK * float(np.median(self.state.track.series("S"))):
            return Outliers(0.0, 0.0, np.empty(0, dtype=np.intp), 0.0, 1.0)
        z = (self.state.drive.z - self.smooth_position)[self.state.counts]
        certain = np.flatnonzero(~self.at_jumps)
        z = z[certain] - np.median(z)
        spread, dof = spread_of(z, self.run.least_step)
        found = outliers(z, spread, len(z), dof)
        return replace(found, peaks=certain[found.peaks])

    @cached_property
    def readings(self) -> Array:
        """Whitened innovations of settled readings, (m,); zero from an outlier on until the filter has forgotten it."""
        y = self.state.whitened[self.state.counts]
        limit = 5.0 * local_spread(y)
        y = np.clip(y, -limit, limit)
        peaks = self.reading_outliers.peaks
        if self.reading_outliers.p_value < NOISE_TEST_ALPHA:
            memory = FORGOTTEN_AFTER / (2.0 * math.pi * self.run.crossover(self.state.noise)) / self.run.reading_step
            forgotten = np.zeros(len(y) + 1)
            np.add.at(forgotten, peaks, 1.0)
            np.add.at(forgotten, np.minimum(peaks + int(memory) + 1, len(y)), -1.0)
            y = np.where(np.cumsum(forgotten)[:-1] > 0.0, 0.0, y)
        return y

    def lowpass_gain(self, frequency: float) -> float:
        """Gain of the declared filters of the output at a frequency, Hz."""
        return max(float(np.abs(self.gain(np.array([frequency]))[0])), self.least_gain)

    @property
    def least_gain(self) -> float:
        """Gain below which declared filters leave none of the sensor's noise; 0 for one RC alone."""
        return LEAST_GAIN if self.run.rig.output_filters else 0.0

    def gain(self, f: Array) -> Spectrum:
        """Complex gain of everything between sensing element and sample at frequencies (n,) Hz."""
        return np.asarray(self.run.filters.of_output(f) / (1.0 + 2j * math.pi * f * self.tau))


def is_coarse(residuals: Residuals) -> bool:
    """Whether the step of the converter exceeds the noise, so that the noise itself depends on the motion."""
    return residuals.lsb > 0.8 * sample_noise(residuals)


def sample_noise(residuals: Residuals) -> float:
    """Standard deviation of one sample: that of the fitted density with quantisation subtracted, m/s².

    Coarse steps leave nothing after subtraction; then the declared density counts, if there is one.
    """
    run, noise = residuals.run, residuals.state.noise
    bandwidth = 1.0 / (2.0 * residuals.tau) if residuals.tau > 0.0 else residuals.rate
    if run.rig.output_filters:
        bandwidth = noise_bandwidth(residuals.gain, residuals.rate)
    variance = noise.usual.q * residuals.state.values.scale**2 * bandwidth
    declared = 0.5 * (run.rig.sensor.noise or 0.0) ** 2 * bandwidth
    return math.sqrt(max(variance - residuals.lsb**2 / 12.0, 0.05 * variance, min(declared, variance)))
