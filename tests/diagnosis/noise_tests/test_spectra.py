"""Spectra and medians taken all at once are those taken one after the other."""

from itertools import pairwise

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

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
