"""Outliers of output and encoder: single samples that the noise excludes, and noise with heavy tails.

Derivations 7.11. A sample is normal with the noise of its channel, or, with a small probability, with a far larger
variance. The few that exceed what the noise allows determine both: their number the share, their heights the size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal._support.values import amount_of
from accelcal.data import Array, Flags, Recording, in_usual_unit
from accelcal.diagnosis.noise.growing import total_with_std
from accelcal.diagnosis.noise.noise_test import OUTPUT_OUTLIERS, READING_OUTLIERS, NoiseTest
from accelcal.diagnosis.noise.residuals import (
    REACH,
    InterpolationError,
    Residuals,
    isolated_peaks,
    outliers,
    power_fit,
    spread_of,
)
from accelcal.diagnosis.policy import EXAMINED_SIGMA, NOISE_TEST_ALPHA, NOISE_TEST_LEAST_BLOCKS
from accelcal.effects import Effect
from accelcal.estimation.noise import NoiseEffect, NoiseScore
from accelcal.signals.series import widened
from accelcal.signals.unresolved import ISOLATED, jumps_at, local_maxima

BESIDE = np.arange(-2, 3)
"""Samples beside one that stands out about which a jump is looked for: wrong samples are tried as far."""


def motion_noise_level(residuals: Residuals, interpolation: InterpolationError) -> Array:
    """Standard deviation of the interpolation errors as a function of the motion, (n,) m/s².

    Power of the blocks behind the filter = s² + c1 v² + c2 v⁴ + c3 j², interpolated to every sample; noise that follows
    the motion is no outlier, whatever causes it.
    """
    spectra = residuals.spectra
    if len(spectra.power) < NOISE_TEST_LEAST_BLOCKS:
        return np.ones(residuals.n)
    gain, response = interpolation.gain, interpolation.response[: REACH + 1] ** 2
    f = np.linspace(0.0, 0.5 * residuals.rate, len(gain))
    power = spectra.power @ np.interp(spectra.f, f, gain**2) * (2.0 / len(spectra.window))
    c, _ = power_fit(power, np.column_stack([np.ones(len(power)), *residuals.motion_blocks(spectra)]))
    v, jerk = residuals.motion
    v2 = v**2
    behind = c[2] * v2
    behind += c[1]
    behind *= v2
    np.square(jerk, out=v2)
    v2 *= c[3]
    behind += v2
    behind += c[0]
    del v, v2, jerk
    residuals.release()
    np.maximum(behind, 0.1 * float(np.median(power)) + 1e-300, out=behind)
    spread = np.concatenate([response[:0:-1], response])
    behind = np.pad(behind, len(spread) // 2, mode="symmetric")
    behind = np.convolve(behind, spread / spread.sum(), "valid")  # each error holds noise of its neighbours
    return np.asarray(np.sqrt(behind, out=behind))


def motion_jumps(residuals: Residuals, sampled: Flags, y: Array, spread: Array) -> Flags:
    """Which of the sampled uniform times lie at a jump of the motion, by the samples about each error `y` that is large
    beside its spread."""
    scores, marked = np.zeros(residuals.n), np.zeros(residuals.n, dtype=np.bool_)
    scores[sampled] = np.abs(y) / np.maximum(spread, 1e-300)
    peaks = local_maxima(scores, 2 * ISOLATED, EXAMINED_SIGMA)  # the filter rings about a wrong sample
    del scores
    run, stamps = residuals.run, residuals.t_u[np.searchsorted(residuals.place, peaks)]
    places = np.unique(np.searchsorted(run.accel.t, stamps)[:, None] + BESIDE)
    if len(places) == 0:
        return marked[sampled]
    jumps = jumps_at(run.accel.t, run.accel.y, run.sample_noise, places, run.accel_step, run.rig.lowpass_tau)
    at = np.rint((jumps.t - residuals.t_u[0]) / residuals.step).astype(np.intp)
    marked[np.clip(at, 0, residuals.n - 1)] = True
    return np.asarray(widened(marked, 2 * ISOLATED)[sampled])


@dataclass(frozen=True, slots=True)
class SampleErrors:
    """What each sample differs by from what the others of its channel say of it."""

    t: Array
    """(m,) s"""
    y: Array
    """(m,)"""
    spread: Array
    """Standard deviation that the noise allows, (m,)."""
    dof: float
    """Degrees of freedom of that."""


def output_errors(residuals: Residuals) -> SampleErrors:
    """Interpolation errors of the samples of the output, m/s²; none about a jump of the motion."""
    y, interpolation = residuals.interpolation_errors
    sampled = residuals.sampled & np.isfinite(y)
    usual = motion_noise_level(residuals, interpolation)[sampled]
    y = y[sampled]
    y /= usual
    spread, dof = spread_of(y)
    spread *= usual
    y *= usual
    del usual
    np.hypot(spread, math.sqrt(residuals.white_floor * float(np.mean(interpolation.gain**2))), out=spread)
    steady = ~motion_jumps(residuals, sampled, y, spread)
    if not steady.all():
        y, spread = y[steady], spread[steady]
        sampled[sampled] = steady
    return SampleErrors(residuals.t[sampled], y, spread, dof)


def accelerometer_outliers(residuals: Residuals) -> NoiseTest:
    """Test for single samples of the output that its local noise does not allow."""
    errors = output_errors(residuals)
    flagged = outliers(errors.y, errors.spread, len(errors.y), errors.dof)
    text = (
        flagged.sentence("samples of the output", "m/s²")
        if flagged.p_value < NOISE_TEST_ALPHA
        else "the output has no outliers"
    )
    n = len(residuals.u)
    at = tuple(float(instant) for instant in errors.t[flagged.peaks])
    std = math.sqrt(max(flagged.count, 1.0)) / n
    return NoiseTest(
        OUTPUT_OUTLIERS, flagged.score, flagged.p_value, flagged.count / n, "", std, text, flagged.parts, at
    )


def encoder_outliers(residuals: Residuals) -> NoiseTest:
    """Test for single readings that the smoothed position does not allow; those skipped by the replay count too."""
    flagged = residuals.reading_outliers
    left_out = residuals.run.left_out
    n = len(residuals.readings) + left_out
    p = 0.0 if left_out else flagged.p_value
    count = flagged.count + left_out
    at = tuple(float(t) for t in residuals.run.t[residuals.state.counts][flagged.peaks]) if p < NOISE_TEST_ALPHA else ()
    how_many = amount_of(int(count), "reading of the encoder is an outlier", "readings of the encoder are outliers")
    text = (
        how_many + f" of up to {in_usual_unit(flagged.size, 'm', 2)}" * (flagged.size > 0.0)
        if p < NOISE_TEST_ALPHA
        else "the encoder has no outliers"
    )
    parts = {**flagged.parts, "count": count, "left_out": float(left_out)}
    std = math.sqrt(max(count, 1.0)) / max(1, n)
    return NoiseTest(READING_OUTLIERS, flagged.score, p, count / max(1, n), "", std, text, parts, at)


LIMIT = 6.0
"""Standard deviations of the noise beyond which a sample is an outlier: normal noise has one in 5e8."""
BESIDE_TAIL = 8
"""Samples next to an outlier whose own errors it disturbs."""
WIDEST = 1e6
"""Largest size of outliers, in standard deviations of the noise."""
MOST_RATIO = 1e6
"""Largest ratio of events that is told."""


@dataclass(frozen=True, slots=True)
class Exceedances:
    """Errors of a channel over what its noise allows, those disturbed by an outlier beside them left out."""

    score: Array
    """(m,) standard deviations."""
    outlying: Flags
    """(m,)"""
    scale: float
    """Usual standard deviation, in the unit of the channel."""

    @classmethod
    def of(cls, errors: SampleErrors) -> Exceedances:
        """Of a channel."""
        score = errors.y / np.maximum(errors.spread, 1e-300)
        peaks = isolated_peaks(np.abs(score), np.flatnonzero(np.abs(score) > LIMIT))
        outlying = np.zeros(len(score), dtype=np.bool_)
        outlying[peaks] = True
        exceeding = (outlying | ~widened(outlying, BESIDE_TAIL)) & ((np.abs(score) <= LIMIT) | outlying)
        return cls(score[exceeding], outlying[exceeding], float(np.median(errors.spread)))

    @classmethod
    def joined(cls, several: Sequence[Exceedances]) -> Exceedances:
        """Of several records."""
        score, outlying = (np.concatenate(y) for y in zip(*((e.score, e.outlying) for e in several), strict=True))
        return cls(score, outlying, float(np.median([e.scale for e in several])))


def reading_errors(residuals: Residuals, recording: Recording) -> SampleErrors:
    """Errors of all readings of a recording, also of those that were left out or rejected, against the smoothed
    position of the rest, m.

    Parameters
    ----------
    residuals : of the run without outliers.
    recording : with them.
    """
    state, run = residuals.state, residuals.run
    settled = run.t[state.counts]
    t, z = recording.position.t, recording.position.y
    inside = (t >= settled[0]) & (t <= settled[-1]) & np.isfinite(z)
    _, velocity, _ = state.smoothed()
    smooth = scipy.interpolate.CubicHermiteSpline(run.t, residuals.smooth_position, velocity)
    added = np.interp(t[inside], run.t, run.readings - state.drive.z)
    y = z[inside] - smooth(t[inside]) - added
    y -= np.median(y)
    spread, dof = spread_of(y, run.least_step)
    return SampleErrors(t[inside], y, spread, dof)


def tail_probability(size: float) -> float:
    """Probability that an outlier of this size, in standard deviations of the noise, exceeds the limit."""
    return math.erfc(LIMIT / math.sqrt(2.0 * (1.0 + size**2)))


def log_likelihood(share: float, size: float, exceedances: Exceedances) -> float:
    """Of the number of outliers and their heights."""
    x, n = exceedances.score[exceedances.outlying], len(exceedances.score)
    variance = 1.0 + size**2
    heights = -0.5 * x**2 / variance - 0.5 * math.log(2.0 * math.pi * variance)
    return float(np.sum(math.log(share) + heights)) + (n - len(x)) * math.log1p(-share * tail_probability(size))


def outlying_noise(channel: str, effect: Effect, several: Sequence[SampleErrors]) -> NoiseEffect:
    """Share and size of the outliers of a channel; the coefficient is the share times the mean square height."""
    exceedances = Exceedances.joined([Exceedances.of(errors) for errors in several])
    x, n = exceedances.score[exceedances.outlying], max(1, len(exceedances.score))
    if len(x) == 0:
        return NoiseEffect(effect.name, effect.symbol, effect.unit, 0.0, math.inf, effect.owner, 1.0, "no outliers")

    def share_of(size: float) -> float:
        return min(0.5, len(x) / (n * tail_probability(size)))

    best = scipy.optimize.minimize_scalar(
        lambda log: -log_likelihood(share_of(math.exp(log)), math.exp(log), exceedances),
        bounds=(0.0, math.log(WIDEST)),
        method="bounded",
    )
    size = math.exp(float(best.x))
    share = share_of(size)
    at, h = np.array([math.log(share), math.log(size)]), 0.02
    hessian = np.array([[second_difference(at, i, j, h, exceedances) for j in (0, 1)] for i in (0, 1)])
    covariance = np.linalg.pinv(-hessian)
    relative = math.sqrt(max(0.0, float(np.array([1.0, 2.0]) @ covariance @ np.array([1.0, 2.0]))))
    height = size * exceedances.scale
    value = share * height**2
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    particulars = {
        "share": share,
        "share_std": share * float(stds[0]),
        "size": height,
        "size_std": height * float(stds[1]),
        "noise": exceedances.scale,
        "count": float(len(x)),
        "position": float(channel == "position"),
    }
    text = f"{len(x)} of {n} samples of {channel}: a share of {share:.2g} with a standard deviation of {height:.3g}"
    p = float(scipy.special.gammainc(len(x), 2.0 * n * float(scipy.special.ndtr(-LIMIT))))
    return NoiseEffect(
        effect.name, effect.symbol, effect.unit, value, relative * value, effect.owner, p, text, particulars
    )


def second_difference(at: Array, i: int, j: int, h: float, exceedances: Exceedances) -> float:
    """Second derivative of the log-likelihood by the logarithms of share and size."""

    def value(a: float, b: float) -> float:
        x = at.copy()
        x[i] += a * h
        x[j] += b * h
        return log_likelihood(math.exp(x[0]), math.exp(x[1]), exceedances)

    return (value(1, 1) - value(1, -1) - value(-1, 1) + value(-1, -1)) / (4.0 * h**2)


def score_of_tails(errors: SampleErrors, effect: NoiseEffect) -> NoiseScore:
    """Gain of the log density of the samples of a channel by outliers of a known share and size, over normal noise of
    the variance that the samples have."""
    exceedances = Exceedances.of(errors)
    share, size = effect.particulars["share"], effect.particulars["size"] / max(exceedances.scale, 1e-300)
    wide = math.sqrt(1.0 + size**2)
    usual, rare = normal_log_density(exceedances.score, 1.0), normal_log_density(exceedances.score, wide)
    plain = normal_log_density(exceedances.score, math.sqrt(float(np.mean(exceedances.score**2))))
    gain = np.logaddexp(math.log1p(-share) + usual, math.log(share) + rare) - plain
    total, std = total_with_std(gain)
    n, events = len(gain), int(np.sum(exceedances.outlying))
    expected = n * share * tail_probability(size)
    without = n * tail_probability(math.sqrt(share) * size)
    channel = "position" if effect.particulars["position"] else "accel"
    ratio, ratio_without = (min(MOST_RATIO, events / max(expectation, 1e-300)) for expectation in (expected, without))
    return NoiseScore(effect.name, channel, total, std, n, ratio, ratio_without, "number of outliers")


def normal_log_density(x: Array, sigma: float) -> Array:
    """Of zero mean."""
    return np.asarray(-0.5 * (x / sigma) ** 2 - math.log(sigma) - 0.5 * math.log(2.0 * math.pi))
