"""Lost samples are filled in so that their interpolation errors vanish, by a matrix or by transforms."""

import numpy as np
import pytest

from accelcal.diagnosis.noise import residuals
from accelcal.diagnosis.noise.residuals import (
    DENSE_MOST,
    REACH,
    BlockSpectra,
    InterpolationError,
    remaining_information,
)

N, RATE, EDGE = 4000, 1000.0, 150.0


@pytest.fixture
def series():
    """Coloured noise, and the filter that makes it white."""
    rng = np.random.default_rng(2007)
    y = np.convolve(rng.standard_normal(N + 2), [1.0, -0.6, 0.3], "valid")
    return y, InterpolationError.of(BlockSpectra.of(y, np.ones(N, dtype=bool), RATE, 1.3 * EDGE), N, RATE, EDGE)


@pytest.mark.parametrize("lost", [[700], [1200, 1201, 1202], [90, 95, 2000, 3999]])
def test_filled_in_samples_have_no_interpolation_error(series, lost):
    y, interpolation = series
    y[lost] += 30.0
    errors, lost = interpolation(y), np.array(lost)
    left = interpolation(y - interpolation.correction(errors, lost))
    assert np.max(np.abs(left[lost])) < 1e-3 * np.max(np.abs(errors[lost]))  # conjugate gradients stop at 1e-4
    assert np.max(np.abs(interpolation(y)[lost])) > 10.0 * np.median(np.abs(errors))


def test_few_lost_samples_are_filled_in_like_many(series, monkeypatch):
    y, interpolation = series
    lost = np.sort(np.random.default_rng(7).choice(N, 60, replace=False))
    by_matrix = interpolation.correction(interpolation(y), lost)
    monkeypatch.setattr(residuals, "DENSE_MOST", 0)
    assert len(lost) < DENSE_MOST
    np.testing.assert_allclose(
        interpolation.correction(interpolation(y), lost), by_matrix, atol=1e-12
    )  # sums of 4000 terms near 1
    assert np.max(np.abs(by_matrix)) > 0.1


@pytest.mark.parametrize("share", [0.02, 0.3])
def test_information_next_to_lost_samples_is_what_the_others_leave(share):
    """Of Gaussian noise with precision matrix R the conditional variance given the kept neighbours within reach."""
    rng = np.random.default_rng(3)
    n = 300
    spectrum = np.clip((np.abs(np.fft.fftfreq(n)) - 0.1) / 0.05, 0.0, 1.0) * (1.0 + np.abs(np.fft.fftfreq(n)))
    response = np.fft.ifft(spectrum).real
    response = response[: 2 * REACH + 1] / response[0]
    lost = np.sort(rng.choice(n, int(share * n), replace=False))
    affected, information = remaining_information(response, lost, n)
    distance = np.abs(np.arange(n)[:, None] - np.arange(n))
    assert set(affected) == set(np.flatnonzero((distance[:, lost] <= REACH).any(axis=1))) - set(lost)
    for place, result in zip(affected, information, strict=True):
        near = lost[(np.abs(lost - place) <= REACH)]
        together = np.union1d(near, place)
        R = response[np.minimum(distance[np.ix_(together, together)], 2 * REACH)] + 1e-9 * np.eye(len(together))
        nearest = np.searchsorted(together, place)
        assert result == pytest.approx(
            1.0 / np.linalg.inv(R)[nearest, nearest], abs=1e-5
        )  # 1e-9 over eigenvalues of 1e-4
    assert np.min(information) < (0.97 if share < 0.1 else 0.5)


def test_a_long_gap_costs_what_its_ends_cost(monkeypatch):
    """Solutions are counted: of a gap of ten thousand samples the samples beside it are solved for, none inside."""
    n, solved = 20_000, []
    monkeypatch.setattr(residuals.np.linalg, "solve", lambda R, c: solved.append(len(R)) or np.zeros_like(c))
    affected, _ = remaining_information(np.r_[1.0, np.zeros(2 * REACH)], np.arange(5000, 15_000), n)
    assert sum(solved) == len(affected) == 2 * REACH
