"""Coherence of the residual with side channels: its band is said, and unrelated channels are not."""

from __future__ import annotations

import numpy as np
import scipy

from accelcal.diagnosis.checks import coherent_bands

T = np.arange(0.0, 60.0, 2e-3)


def trial(
    rng: np.random.Generator, sensitivity: float, through_motion: float = 0.0
) -> list[tuple[float, float, float]]:
    """Bands with their p-values, of a residual that follows the side channel between 5 and 8 Hz."""
    a, scatter = rng.standard_normal((2, len(T)))
    side = scatter + through_motion * a
    passing = scipy.signal.butter(2, [5.0, 8.0], "bandpass", fs=500.0, output="sos")
    residual = sensitivity * scipy.signal.sosfilt(passing, side) + 0.5 * a + 0.2 * rng.standard_normal(len(T))
    return [(band.low, band.high, band.p_value) for band in coherent_bands("a_y", side, T, residual, a, 50.0)]


def test_the_band_of_a_transverse_sensitivity_is_found() -> None:
    bands = [(low, high) for low, high, p in trial(np.random.default_rng(3), 0.5) if p < 1e-5]
    assert bands
    assert min(low for low, _ in bands) < 5.5
    assert max(high for _, high in bands) < 16.0


def test_what_both_share_with_the_motion_is_no_coherence() -> None:
    rng = np.random.default_rng(4)
    p = [p for _ in range(20) for _, _, p in trial(rng, 0.0, through_motion=1.0)]
    assert np.mean(np.array(p) < 0.05) < 0.08
    assert min(p) > 1e-5  # 260 bands: a smaller one has a probability of 0.3 %
