"""The level against which a spectral line is tested follows noise that falls with frequency."""

from __future__ import annotations

import numpy as np
import scipy

from accelcal.diagnosis.noise import spectra
from accelcal.diagnosis.noise.spectra import spectral_peaks
from accelcal.signals import processing
from accelcal.signals.processing import quintic

RATE, SAMPLES = 833.0, 35_000


def noise(seed: int, corner: float) -> np.ndarray:
    """White noise of unit variance, and 1/f noise that equals it at a corner, Hz."""
    y = np.random.default_rng(seed).standard_normal(SAMPLES)
    f = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    f[0] = f[1]
    return np.fft.irfft(np.fft.rfft(y) * np.sqrt(1.0 + corner / f), SAMPLES)


def least_p(y: np.ndarray) -> float:
    peaks, bins = spectral_peaks(y, RATE, 0.0, 0.45 * RATE)
    return min(1.0, bins * min(chance for _, _, chance in peaks))


def test_flicker_noise_has_no_lines(monkeypatch):
    """60 series at 1e-3 each; against a level that is constant at low frequencies, most have a line."""
    series = [noise(seed, 5.0) for seed in range(60)]
    assert min(map(least_p, series)) > 1e-3 / len(series)
    monkeypatch.setattr(spectra, "falling_level", lambda part, f: np.zeros(len(part)))
    assert sum(least_p(y) < 1e-3 for y in series[:20]) > 10


def test_a_line_in_white_noise_is_as_significant_as_before(monkeypatch):
    t = np.arange(SAMPLES) / RATE
    series = [noise(seed, 0.0) + 0.1 * np.sin(2.0 * np.pi * f * t) for seed, f in enumerate((0.9, 3.0, 7.0, 15.0))]
    now = [least_p(y) for y in series]
    monkeypatch.setattr(spectra, "falling_level", lambda part, f: np.zeros(len(part)))
    before = [least_p(y) for y in series]
    assert max(now) < 1e-4
    assert np.all(np.log(now) < 0.8 * np.log(before))


def test_interpolated_motion_has_no_image_that_passes_for_a_line():
    """25 Hz of 15 m/s² on every fourth sample: its image lies below 1e-5 m/s², a line of a quiet sensor."""
    rate = 1667.03
    t = np.arange(0.0, 30.0, 4.0 / rate)
    at = np.arange(1.0, 29.0, 1.0 / rate)
    window = np.hanning(len(at)) / np.hanning(len(at)).sum()

    def image(y: np.ndarray) -> float:
        return 2.0 * abs(np.sum(window * y * np.exp(2j * np.pi * (rate / 4.0 - 25.0) * at)))

    motion = 15.0 * np.sin(2.0 * np.pi * 25.0 * t)
    assert image(quintic(t, motion, at)) < 1e-5
    assert image(scipy.interpolate.CubicSpline(t, motion)(at)) > 1e-5  # the twin that must fail


def test_a_long_record_is_interpolated_as_a_short_one(monkeypatch):
    t = np.arange(0.0, 20.0, 2.4e-3)
    at = np.sort(np.random.default_rng(1).uniform(-1e-3, 20.0, 20_000))
    y = np.sin(150.0 * t)
    whole = quintic(t, y, at)
    monkeypatch.setattr(processing, "SPLINE_STRETCH", 1000)
    np.testing.assert_allclose(quintic(t, y, at), whole, atol=1e-12)
