"""Filters of signals, against the library."""

import numpy as np
import pytest
import scipy

from accelcal.signals.processing import ORDER, low_pass


@pytest.mark.parametrize("n", [8, 30, 501, 20_000])
@pytest.mark.parametrize("cutoff", [3.0, 40.0, 200.0])
def test_the_low_pass_is_the_librarys_bit_for_bit(n: int, cutoff: float) -> None:
    y = np.random.default_rng(n).standard_normal(n)
    sections = scipy.signal.butter(ORDER, cutoff, fs=500.0, output="sos")
    padding = int(min(n - 1, 3 * 500.0 / cutoff))
    np.testing.assert_array_equal(low_pass(y, 500.0, cutoff), scipy.signal.sosfiltfilt(sections, y, padlen=padding))


def test_a_cutoff_near_the_nyquist_frequency_leaves_samples_alone() -> None:
    y = np.random.default_rng(1).standard_normal(100)
    assert low_pass(y, 500.0, 225.0) is y
