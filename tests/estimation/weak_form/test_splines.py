"""Test functions of the weak form against scipy's B-splines, and their sums against closed integrals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from accelcal.estimation.weak_form.channel import DEGREE, SampledChannel, Splines
from accelcal.estimation.weak_form.covariance import bands

SPLINES = Splines(0.5, 0.01, 180)
"""From 0.5 s to 2.39 s."""


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_test_functions_are_b_splines(order: int) -> None:
    t = np.random.default_rng(1).uniform(0.4, 2.5, 300)
    result = SPLINES.weights(t, order, np.ones_like(t)).toarray()
    for k in (0, 7, SPLINES.count - 1):
        knots = SPLINES.begins[k] + SPLINES.step * np.arange(DEGREE + 2.0)
        expected = np.nan_to_num(BSpline.basis_element(knots, extrapolate=False).derivative(order)(t))
        assert np.max(np.abs(result[k] - expected)) < 1e-12 * SPLINES.step**-order


def test_bands_are_the_covariance() -> None:
    t = np.arange(0.4, 2.5, 0.003)
    variance = np.random.default_rng(2).uniform(0.5, 2.0, len(t))
    weights = SPLINES.weights(t, 2, np.full(len(t), 0.003))
    whole = (weights * variance) @ weights.T
    diagonals = bands(weights, variance)
    for k in range(DEGREE + 1):
        assert np.allclose(diagonals[k, : SPLINES.count - k], whole.diagonal(-k), rtol=1e-12)
    assert np.max(np.abs(whole.toarray()[np.tril_indices(SPLINES.count, -DEGREE - 1)])) == 0.0


def stamps(kind: str, step: float) -> np.ndarray:
    """Even stamps, stamps with jitter, or every fifth of them lost at random."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 3.0, step)
    if kind == "jittered":
        return t + rng.uniform(-0.3, 0.3, len(t)) * step
    return t[rng.random(len(t)) < 0.8] if kind == "lost" else t


@pytest.mark.parametrize(("kind", "most"), [("even", 1e-12), ("jittered", 1e-11), ("lost", 5e-9)])
def test_a_sum_over_samples_is_the_integral(kind: str, most: float) -> None:
    """<phi'', z> of a motion at 4 Hz is <phi, z''>, to a few nanometres in 0.1 m whatever the stamps."""
    step, w = 0.002, 2.0 * np.pi * 4.0
    t = stamps(kind, step)
    channel = SampledChannel.of(t, 0.1 * np.sin(w * t), step, 1.0 / SPLINES.step)
    rows, weights = channel.against(SPLINES, 2)
    result = channel.sums(SPLINES, 2, weights, rows)
    middle = SPLINES.begins + 0.5 * SPLINES.support
    # The Fourier transform of a cardinal B-spline: a power of sinc, times its step.
    passed = SPLINES.step * np.sinc(w * SPLINES.step / (2.0 * np.pi)) ** (DEGREE + 1)
    expected = -(w**2) * passed * 0.1 * np.sin(w * middle)
    worst = float(np.max(np.abs(result - expected))) / (w**2 * passed)
    print(f"{kind} stamps: {worst:.1e} m in 0.1 m (at most {most:.0e})")
    assert 0.0 < worst < most


def test_the_plain_sum_over_uneven_stamps_is_not() -> None:
    step, w = 0.002, 2.0 * np.pi * 4.0
    t = stamps("jittered", step)
    weights = SPLINES.weights(t, 2, np.gradient(t))
    middle = SPLINES.begins + 0.5 * SPLINES.support
    passed = SPLINES.step * np.sinc(w * SPLINES.step / (2.0 * np.pi)) ** (DEGREE + 1)
    wrong = weights @ (0.1 * np.sin(w * t)) + w**2 * passed * 0.1 * np.sin(w * middle)
    assert np.max(np.abs(wrong)) / (w**2 * passed) > 1e-6
