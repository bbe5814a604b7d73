"""Filters, windows and spectra of uniform samples against SciPy, whose import takes longer than a fit."""

import numpy as np
import pytest
import scipy.ndimage
import scipy.signal
import scipy.stats

from accelcal.data import Array
from accelcal.diagnosis.noise.motion_noise import ranks
from accelcal.signals.processing import (
    ORDER,
    correlated,
    cosine_window,
    low_pass,
    recursive_filter,
    spectral_density,
)
from accelcal.signals.series import TOGETHER, running_median, widened

Y: Array = np.random.default_rng(20).normal(size=3001) + np.linspace(-3.0, 5.0, 3001)


@pytest.mark.parametrize(
    ("b", "a"),
    [([0.2, 0.1], [1.0, -0.7]), ([1.0], [1.0, -0.99]), ([1.0, -1.0], [1.0, -1.9, 0.95]), ([1, 2, 1], [1, 0.2, 0.5])],
)
def test_a_recursive_filter_is_that_of_scipy(b: list[float], a: list[float]) -> None:
    np.testing.assert_allclose(recursive_filter(b, a, Y), scipy.signal.lfilter(b, a, Y), rtol=1e-12, atol=1e-12)
    other = [a[0], -0.999 * a[1], *a[2:]]
    assert np.max(np.abs(recursive_filter(b, other, Y) - scipy.signal.lfilter(b, a, Y))) > 1e-3


def test_a_recursive_filter_goes_on_from_a_state_and_reads_any_view() -> None:
    b, a = [0.2, 0.1], [1.0, -0.7]
    expected, _ = scipy.signal.lfilter(b, a, Y[::-2], zi=[0.4])
    np.testing.assert_allclose(recursive_filter(b, a, Y[::-2], (0.4, 0.0)), expected, rtol=1e-13)


@pytest.mark.parametrize("n", [8, 30, 501, 20_000])
@pytest.mark.parametrize("cutoff", [3.0, 40.0, 200.0])
def test_the_low_pass_is_that_of_scipy(n: int, cutoff: float) -> None:
    y = np.random.default_rng(n).standard_normal(n)
    sections = scipy.signal.butter(ORDER, cutoff, fs=500.0, output="sos")
    padding = int(min(n - 1, 3 * 500.0 / cutoff))
    expected = scipy.signal.sosfiltfilt(sections, y, padlen=padding)
    # the last bits are those of the processor: a transcendental function of NumPy, a solver
    np.testing.assert_allclose(low_pass(y, 500.0, cutoff), expected, rtol=0.0, atol=1e-10)
    assert np.max(np.abs(low_pass(y, 500.0, 1.01 * cutoff) - expected)) > 1e-8


def test_a_cutoff_near_the_nyquist_frequency_leaves_samples_alone() -> None:
    y = np.random.default_rng(1).standard_normal(100)
    assert low_pass(y, 500.0, 225.0) is y


def test_windows_spectra_and_ranks_are_those_of_scipy() -> None:
    np.testing.assert_array_equal(cosine_window(32), scipy.signal.windows.hann(32, sym=False))
    harris = cosine_window(128, (0.35875, 0.48829, 0.14128, 0.01168))
    np.testing.assert_array_equal(harris, scipy.signal.windows.blackmanharris(128, sym=False))
    for segment in (64, 101):
        for ours, theirs in zip(
            spectral_density(Y, 50.0, segment), scipy.signal.welch(Y, 50.0, nperseg=segment), strict=True
        ):
            np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-13)
    tied = np.round(Y[:200])
    np.testing.assert_array_equal(ranks(tied), scipy.stats.rankdata(tied))
    assert not np.array_equal(ranks(tied), scipy.stats.rankdata(tied, method="min"))


def test_a_correlation_is_the_sum_of_products() -> None:
    response = np.random.default_rng(21).normal(size=70)
    expected = scipy.signal.correlate(Y, response, mode="full")[len(response) - 1 :]
    np.testing.assert_allclose(correlated(Y, response), expected, atol=1e-10)
    assert not np.allclose(correlated(Y, response[::-1]), expected, atol=1e-3)


@pytest.mark.parametrize("n", [3, 20, TOGETHER, TOGETHER + 1, 20_000])
@pytest.mark.parametrize("reach", [1, 5, 16])
def test_a_running_median_and_a_wider_mask_are_those_of_scipy(n: int, reach: int) -> None:
    y, window = np.random.default_rng(n + reach).normal(size=n), 2 * reach + 1
    held = scipy.ndimage.median_filter(y, window, mode="nearest")
    np.testing.assert_array_equal(running_median(y, reach, "edge"), held)
    np.testing.assert_array_equal(
        running_median(y, reach, "symmetric"), scipy.ndimage.median_filter(y, window, mode="reflect")
    )
    for marked in (y > 2.5, y > 9.0, y < 9.0):
        np.testing.assert_array_equal(widened(marked, reach), scipy.ndimage.binary_dilation(marked, iterations=reach))
    assert n < 100 or np.any(running_median(y, reach + 1, "edge") != held)
