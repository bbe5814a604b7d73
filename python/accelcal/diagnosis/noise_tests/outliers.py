"""Outliers of the output and of the encoder: single samples that their noise does not allow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data import Array, Flags
from accelcal.diagnosis.noise_tests.block_spectra import power_fit
from accelcal.diagnosis.noise_tests.interpolation_error import REACH, InterpolationError
from accelcal.diagnosis.noise_tests.noise_test import OUTPUT_OUTLIERS, READING_OUTLIERS, NoiseTest
from accelcal.diagnosis.noise_tests.residuals import Residuals
from accelcal.diagnosis.noise_tests.robust import outliers, spread_of
from accelcal.diagnosis.policy import EXAMINED_SIGMA, NOISE_TEST_ALPHA, NOISE_TEST_LEAST_BLOCKS
from accelcal.signals.series import widened
from accelcal.signals.unresolved import ISOLATED, Places, jumps_at, local_maxima

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
    gain = interpolation.gain
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
    np.maximum(behind, 0.1 * float(np.median(power)) + 1e-300, out=behind)
    response = interpolation.response[: REACH + 1] ** 2
    spread = np.concatenate([response[:0:-1], response])
    behind = scipy.ndimage.convolve1d(behind, spread / spread.sum())  # each error holds noise of its neighbours
    return np.asarray(np.sqrt(behind, out=behind))


def motion_jumps(residuals: Residuals, known: Places, score: Array) -> Flags:
    """Which of some uniform times lie at a jump of the motion, by the samples about each score that is large."""
    scores, marked = np.zeros(residuals.n), np.zeros(residuals.n, dtype=np.bool_)
    scores[known] = score
    peaks = local_maxima(scores, 2 * ISOLATED, EXAMINED_SIGMA)  # the filter rings about a wrong sample
    run, stamps = residuals.run, residuals.t_u[np.searchsorted(residuals.place, peaks)]
    places = np.unique(np.searchsorted(run.accel.t, stamps)[:, None] + BESIDE)
    if len(places) == 0:
        return marked[known]
    found = jumps_at(run.accel.t, run.accel.y, run.sample_noise, places, run.accel_step, run.declared_tau)
    at = np.rint((found.t - residuals.t_u[0]) / residuals.step).astype(np.intp)
    marked[np.clip(at, 0, residuals.n - 1)] = True
    return np.asarray(widened(marked, 2 * ISOLATED)[known])


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
    known = np.flatnonzero(residuals.sampled & np.isfinite(y))
    usual = motion_noise_level(residuals, interpolation)[known]
    y = y[known]
    y /= usual
    spread, dof = spread_of(y)
    spread *= usual
    y *= usual
    del usual
    np.hypot(spread, math.sqrt(residuals.white_floor * float(np.mean(interpolation.gain**2))), out=spread)
    kept = ~motion_jumps(residuals, known, np.abs(y) / np.maximum(spread, 1e-300))
    return SampleErrors(residuals.t[known[kept]], y[kept], spread[kept], dof)


def accelerometer_outliers(residuals: Residuals) -> NoiseTest:
    """Test for single samples of the output that its local noise does not allow."""
    errors = output_errors(residuals)
    found = outliers(errors.y, errors.spread, len(errors.y), errors.dof)
    text = (
        found.sentence("samples of the output", "m/s²")
        if found.p_value < NOISE_TEST_ALPHA
        else "the output has no outliers"
    )
    n = len(residuals.u)
    at = tuple(float(instant) for instant in errors.t[found.peaks])
    std = math.sqrt(max(found.count, 1.0)) / n
    return NoiseTest(OUTPUT_OUTLIERS, found.score, found.p_value, found.count / n, "", std, text, found.parts, at)


def encoder_outliers(residuals: Residuals) -> NoiseTest:
    """Test for single readings that the smoothed position does not allow; those skipped by the replay count too."""
    found = residuals.reading_outliers
    left_out = residuals.run.left_out
    n = len(residuals.readings) + left_out
    p = 0.0 if left_out else found.p_value
    count = found.count + left_out
    at = tuple(float(t) for t in residuals.run.t[residuals.state.counts][found.peaks]) if p < NOISE_TEST_ALPHA else ()
    text = (
        f"{count:.0f} readings of the encoder are outliers of up to {found.size * 1e6:.2g} um"
        if p < NOISE_TEST_ALPHA
        else "the encoder has no outliers"
    )
    parts = {**found.parts, "count": count, "left_out": float(left_out)}
    std = math.sqrt(max(count, 1.0)) / max(1, n)
    return NoiseTest(READING_OUTLIERS, found.score, p, count / max(1, n), "", std, text, parts, at)
