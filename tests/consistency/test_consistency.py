"""Consistency statistics against printed numbers, closed forms, and sequences that must fail."""

from __future__ import annotations

import numpy as np
import pytest

from accelcal.validation.consistency import chi_square_region, consistency, coverage, nees, nis, rms_error, whiteness


@pytest.mark.parametrize(
    ("dof", "runs", "low", "high"),
    [
        (1, 100, 0.742, 1.296),
        (2, 50, 1.484, 2.591),
        (4, 5, 1.918, 6.834),
        (4, 50, 3.255, 4.821),
        (4, 100, 3.465, 4.573),
        (5, 50, 4.162, 5.914),
        (6, 50, 5.078, 6.997),
        (7, 50, 6.001, 8.074),
    ],
)
def test_chi_square_region_equals_the_printed_table(dof: int, runs: int, low: float, high: float) -> None:
    # Bar-Shalom sec. 5.4, evaluated to three decimals
    assert chi_square_region(dof, runs) == pytest.approx((low, high), abs=5e-4)


def test_chi_square_region_is_normal_for_many_scalars() -> None:
    low, high = chi_square_region(1, 200_000)
    half = 1.959964 * np.sqrt(2 / 200_000)
    assert (low, high) == pytest.approx((1 - half, 1 + half), abs=2e-5)  # skewness of chi-square, order 1/K


@pytest.mark.parametrize(("dof", "runs", "probability"), [(0, 1, 0.95), (1, 0, 0.95), (1, 1, 1.0), (1, 1, 0.0)])
def test_chi_square_region_refuses_what_has_no_region(dof: int, runs: int, probability: float) -> None:
    with pytest.raises(ValueError, match="no region"):
        chi_square_region(dof, runs, probability)


def test_nees_is_exact_for_states_of_very_different_units() -> None:
    sigma = np.array([1e-7, 1e-4, 1e-2, 1e-6])
    correlation = np.full((4, 4), 0.9) + 0.1 * np.eye(4)
    covariance = correlation * np.outer(sigma, sigma)
    # a' C^-1 a for C = 0.1 I + 0.9 11': (a'a - 0.9 (1'a)²/(0.1 + 3.6))/0.1
    a = np.array([1.0, -2.0, 0.5, 1.5])
    expected = (a @ a - 0.9 * a.sum() ** 2 / 3.7) / 0.1
    assert nees(a * sigma, covariance) == pytest.approx(expected, rel=1e-13)  # a 4x4 solve, condition 37


def test_nees_refuses_a_variance_that_is_not_positive() -> None:
    with pytest.raises(ValueError, match="positive variances"):
        nees(np.ones(2), np.diag([1.0, 0.0]))


def test_consistency_accepts_honest_errors_and_rejects_a_quarter_of_the_variance() -> None:
    # false-alarm rate 1e-4 (probability 0.9999), 100 runs of 4 states
    rng = np.random.default_rng(1)
    root = rng.standard_normal((4, 4))
    covariance = root @ root.T
    errors = rng.standard_normal((100, 4)) @ root.T
    assert consistency(nees(errors, covariance), 4, 0.9999).verdict == "consistent"
    assert consistency(nees(errors, covariance / 4), 4, 0.9999).verdict == "overconfident"
    assert consistency(nees(errors, covariance * 4), 4, 0.9999).verdict == "underconfident"


def test_a_nan_is_never_consistent() -> None:
    assert consistency(np.array([1.0, np.nan]), 1).verdict == "overconfident"


def test_nis_is_the_square_over_the_variance() -> None:
    np.testing.assert_array_equal(nis(np.array([2.0, -3.0]), np.array([4.0, 1.0])), [1.0, 9.0])


def test_whiteness_accepts_white_noise_and_rejects_a_low_pass() -> None:
    # false-alarm rate 1e-4
    rng = np.random.default_rng(2)
    white = rng.standard_normal(5000)
    assert whiteness(white, alpha=1e-4).verdict == "white"
    assert whiteness(white[1:] + 0.2 * white[:-1], alpha=1e-4).verdict == "coloured"


def test_whiteness_equals_the_closed_form_of_an_alternating_sequence() -> None:
    K = 10
    result = whiteness((-1.0) ** np.arange(K), lags=2)
    np.testing.assert_allclose(result.autocorrelation, [-0.9, 0.8], rtol=1e-15)  # ten products of ±1
    assert result.ljung_box == pytest.approx(K * (K + 2) * (0.81 / 9 + 0.64 / 8), rel=1e-14)  # a few operations


def test_whiteness_rejects_as_often_as_it_says() -> None:
    # 2000 white sequences at alpha 5 %: 100 ± 9.7 alarms; 61..139 is ±4 sigma (false-alarm rate 6e-5)
    rng = np.random.default_rng(3)
    alarms = sum(whiteness(rng.standard_normal(400), lags=10, alpha=0.05).verdict == "coloured" for _ in range(2000))
    assert 61 <= alarms <= 139


@pytest.mark.parametrize(("sequence", "text"), [(np.ones(5), "more than 20"), (np.zeros(50), "zeros")])
def test_whiteness_refuses_what_it_cannot_judge(sequence: np.ndarray, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        whiteness(sequence)


def test_rms_error_is_equation_15() -> None:
    estimates = np.array([[1.0, 2.0], [3.0, 2.0]])
    np.testing.assert_allclose(rms_error(estimates, [1.0, 0.0]), [np.sqrt(2.0), 2.0], rtol=1e-15)  # one square root


def test_coverage_judges_honest_short_and_long_intervals() -> None:
    # false-alarm rate 1e-4
    error = np.random.default_rng(4).standard_normal(2000)
    assert coverage(error, np.ones(2000), probability=0.9999).verdict == "consistent"
    assert coverage(error, np.full(2000, 0.8), probability=0.9999).verdict == "overconfident"
    assert coverage(error, np.full(2000, 1.3), probability=0.9999).verdict == "underconfident"


def test_coverage_interval_equals_clopper_pearson() -> None:
    # all of n inside: the lower limit solves low^n = tail
    result = coverage(np.zeros(10), np.ones(10), probability=0.95)
    assert (result.inside, result.high) == (10, 1.0)
    assert result.low == pytest.approx(0.025**0.1, rel=1e-12)  # inverse incomplete beta


def test_coverage_needs_a_fit() -> None:
    with pytest.raises(ValueError, match="at least one"):
        coverage(np.empty(0), np.empty(0))
