"""Lost samples among their neighbours: filled in so that they surprise nobody, by a matrix or by transforms."""

import numpy as np
import pytest

from accelcal.diagnosis.noise_tests import interpolation_error
from accelcal.diagnosis.noise_tests.block_spectra import BlockSpectra
from accelcal.diagnosis.noise_tests.interpolation_error import FEW, REACH, InterpolationError, knowledge

N, RATE, EDGE = 4000, 1000.0, 150.0


@pytest.fixture
def series():
    """Coloured noise, and the filter that makes it white."""
    rng = np.random.default_rng(2007)
    y = np.convolve(rng.standard_normal(N + 2), [1.0, -0.6, 0.3], "valid")
    return y, InterpolationError.of(BlockSpectra.of(y, np.ones(N, dtype=bool), RATE, 1.3 * EDGE), N, RATE, EDGE)


@pytest.mark.parametrize("lost", [[700], [1200, 1201, 1202], [90, 95, 2000, 3999]])
def test_lost_samples_that_are_filled_in_surprise_nobody(series, lost):
    y, one = series
    y[lost] += 30.0
    off, lost = one(y), np.array(lost)
    left = one(y - one.correction(off, lost))
    assert np.max(np.abs(left[lost])) < 1e-3 * np.max(np.abs(off[lost]))  # conjugate gradients stop at 1e-4
    assert np.max(np.abs(one(y)[lost])) > 10.0 * np.median(np.abs(off))


def test_few_lost_samples_are_filled_in_like_many(series, monkeypatch):
    y, one = series
    lost = np.sort(np.random.default_rng(7).choice(N, 60, replace=False))
    by_matrix = one.correction(one(y), lost)
    monkeypatch.setattr(interpolation_error, "FEW", 0)
    assert len(lost) < FEW
    np.testing.assert_allclose(one.correction(one(y), lost), by_matrix, atol=1e-12)  # sums of 4000 terms near 1
    assert np.max(np.abs(by_matrix)) > 0.1


def test_what_is_known_beside_lost_samples_is_what_all_others_leave():
    rng = np.random.default_rng(3)
    reach, n = rng.uniform(0.0, 0.02, REACH), 500
    lost = np.sort(rng.choice(n, 40, replace=False))
    near, known = knowledge(reach, lost, n)
    flags = np.zeros(n)
    flags[lost] = 1.0
    expected = 1.0 - np.convolve(flags, [*reach[::-1], 0.0, *reach], "same")
    np.testing.assert_allclose(known, expected[near], atol=1e-14)  # sums of at most 32 terms below 1
    assert np.all(np.delete(expected, near) == 1.0)
    assert np.min(known) < 0.97
