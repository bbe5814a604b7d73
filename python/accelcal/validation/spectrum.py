"""Spectra of residuals, and those that the noise model predicts."""

from __future__ import annotations

import math

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.estimation.estimate import Fit
from accelcal.estimation.values import Noise
from accelcal.signals.processing import ORDER
from accelcal.validation.comparison import BINS, Bins, Evaluation, ReferenceNoise, Spectrum
from accelcal.validation.prediction import Prediction


def spectrum(ahead: Prediction, residual: Array, band: float) -> Bins:
    """Density of the residual over the predicted one, in bins of frequency up to the band."""
    rate = 1.0 / ahead.run.reading_step
    segment = int(min(len(residual), max(64, 2 ** round(math.log2(8.0 * BINS * rate / band)))))
    if segment < 16:
        return Bins("frequency", "Hz", np.linspace(0.0, band, BINS + 1), np.ones(BINS), np.zeros(BINS))
    f, density = scipy.signal.welch(residual, fs=rate, nperseg=segment)
    expected = predicted_density(f, ahead.noise, ahead.values.scale, ahead.reference_noise, band)
    edges = np.linspace(0.0, 0.8 * band, BINS + 1)
    ratio, std = np.ones(BINS), np.zeros(BINS)
    averages = max(1.0, 2.0 * len(residual) / segment - 1.0)
    for i in range(BINS):
        rows = (f > edges[i]) & (f <= edges[i + 1])
        if rows.any():
            ratio[i] = float(np.mean(density[rows] / expected[rows]))
            std[i] = 1.3 / math.sqrt(averages * float(rows.sum()))  # neighbours of a Hann window overlap
    return Bins("frequency", "Hz", edges, ratio, std)


def predicted_density(f: Array, noise: Noise, scale: float, reference: ReferenceNoise, band: float) -> Array:
    """One-sided density of the accelerometer-side residual under noise alone, (n,) (m/s²)²/Hz.

    Parameters
    ----------
    f : (n,) Hz.
    noise, scale : of the model; scale is 1 + k.
    reference : noise of what tells the motion.
    band : of the low-pass, Hz.
    """
    passed = 1.0 / (1.0 + (f / band) ** (2 * ORDER)) ** 2  # the low-pass ran forwards and backwards
    return np.asarray(scale**2 * (2.0 * noise.usual.q + reference.as_acceleration(f)) * passed)


def accel_spectrum(fit: Fit, comparison: Evaluation) -> Spectrum | None:
    """Spectra of the accelerometer-side residual and of the predicted noise; None where the record is too short."""
    if comparison.reference_noise is None:
        return None
    _t, residual = comparison.accel_residual
    step = float(np.median(np.diff(comparison.residual[0])))
    found = welch(residual, 1.0 / step)
    if found is None:
        return None
    f, density, low, high = found
    inside = (f > 0.0) & (f <= comparison.band)
    if int(inside.sum()) < FEWEST_LINES:
        return None
    scale, reference = fit.values().scale, comparison.reference_noise
    predicted = predicted_density(f[inside], fit.noise(), scale, reference, comparison.band)
    return Spectrum(f[inside], density[inside], predicted, low, high)


def one_step_spectrum(comparison: Evaluation) -> Spectrum | None:
    """Spectrum of one-step residuals over their predicted deviation, which is flat when nothing is missing, 1/Hz."""
    t, y = comparison.normalised
    rate = 1.0 / float(np.median(np.diff(t)))
    found = welch(y, rate)
    if found is None:
        return None
    f, density, low, high = found
    return Spectrum(f[1:], density[1:], np.full(len(f) - 1, 2.0 / rate), low, high)


FEWEST_LINES = 4
"""Frequencies without which a spectrum shows nothing."""
SEGMENTS = 24
"""Half-overlapping segments of a spectrum that is looked at."""
OVERLAP_LOSS = 1.0 + 2.0 / 36.0
"""Half-overlapping Hann segments are worth this many times fewer independent ones (Welch 1967)."""


def welch(y: Array, rate: float) -> tuple[Array, Array, float, float] | None:
    """Frequencies, one-sided density, and the 95 % region of its ratio to the true one; None below 64 samples."""
    if len(y) < 64:
        return None
    segment = int(min(len(y), max(64, 2 * len(y) // (SEGMENTS + 1))))
    f, density = scipy.signal.welch(y, fs=rate, nperseg=segment)
    worth = max(1.0, (2.0 * len(y) / segment - 1.0) / OVERLAP_LOSS)
    low, high = (float(scipy.special.gammaincinv(worth, p)) / worth for p in (0.025, 0.975))
    return f, density, low, high
