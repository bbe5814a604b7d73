"""Spectra and medians taken all at once are those taken one after the other."""

from itertools import pairwise

import numpy as np
import pytest
import scipy
from hypothesis import given, strategies as st

from accelcal.diagnosis.noise.motion_noise import strongest_band
from accelcal.diagnosis.noise.residuals import BlockSpectra
from accelcal.diagnosis.noise.spectra import medians_between
from accelcal.signals.processing import spectral_density


@pytest.mark.parametrize(("n", "segment"), [(4000, 256), (1001, 501), (300, 300)])
def test_density_is_that_of_welch(n, segment):
    y = np.cumsum(np.random.default_rng(n).standard_normal(n)) + 100.0
    f, density = spectral_density(y, 50.0, segment)
    expected_f, expected = scipy.signal.welch(y, fs=50.0, nperseg=segment)
    np.testing.assert_array_equal(f, expected_f)
    np.testing.assert_allclose(density, expected, rtol=1e-9)  # a mean of 100 taken off in double precision


@given(st.lists(st.integers(1, 9), min_size=1, max_size=12), st.integers(0, 99))
def test_medians_between_edges_are_those_of_each_stretch(lengths, seed):
    edges = np.cumsum([0, *lengths])
    y = np.random.default_rng(seed).standard_normal(edges[-1])
    expected = [np.median(y[a:b]) for a, b in pairwise(edges)]
    np.testing.assert_array_equal(medians_between(y, edges), expected)


@pytest.mark.parametrize("bins", [slice(3, 5), slice(10, 14), slice(19, 20)])
def test_the_band_whose_power_follows_the_motion_is_the_strongest(bins):
    """Blocks of unit noise, chi square; in some bins power grows with the square of the speed."""
    rng = np.random.default_rng(bins.start)
    power, speed = 0.5 * rng.chisquare(2.0, (400, 24)), rng.uniform(0.0, 1.0, 400)
    power[:, bins] *= 1.0 + 4.0 * speed[:, None] ** 2
    spectra = BlockSpectra(np.arange(24.0), power, np.ones(400, dtype=np.bool_), np.ones(48))
    band, _, p = strongest_band(spectra, (speed**2,), 0.0)
    assert (max(band.start, bins.start), min(band.stop, bins.stop)) == (band.start, band.stop)
    assert p < 1e-6
    power[:, bins] /= 1.0 + 4.0 * speed[:, None] ** 2
    assert strongest_band(spectra, (speed**2,), 0.0)[2] > 1e-3
