"""Deviation from the best straight line: closed forms of single terms, and uncertainty by drawing coefficients."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from accelcal.calibration.characteristic import straight_line
from accelcal.estimation.estimate import Fit, estimate
from accelcal.estimation.tracks import POINTS
from accelcal.model import Model
from accelcal.simulation.sensor import ADXL105_RIG, simulate

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "quadratic": -1e-3, "cubic": 1e-4}
A = 8.0


@pytest.fixture(scope="module")
def fitted() -> Fit:
    rng = np.random.default_rng(3)
    record = simulate("tones", seconds=20.0, rig=ADXL105_RIG, parameters=TRUTH, rng=rng).recording
    return estimate(Model.cubic(), record)


def with_values(fit: Fit, **values: float) -> Fit:
    """The fit with other estimates."""
    return replace(
        fit, estimates=tuple(replace(e, value=values[e.name]) if e.name in values else e for e in fit.estimates)
    )


def test_single_terms_leave_what_least_squares_says(fitted: Fit) -> None:
    """Over -A to A the best line of a² is A²/3, that of a³ is 3/5 A² a."""
    discrete = 4.0 / POINTS  # sums over points in place of integrals
    for values, offset, slope, end in (
        ({"quadratic": 1e-3}, 1e-3 * A**2 / 3, 1.0, 1e-3 * A**2 * 2 / 3),
        ({"cubic": 1e-4}, 0.0, 1.0 + 1e-4 * 0.6 * A**2, 1e-4 * 0.4 * A**3),
        ({"bias": 0.2, "scale_factor": 0.1}, 0.2, 1.1, 0.0),
    ):
        given = dict.fromkeys(TRUTH, 0.0) | values
        line = straight_line(with_values(fitted, **given), -A, A)
        assert line.offset == pytest.approx(offset, rel=discrete, abs=1e-12)
        assert line.slope == pytest.approx(slope, rel=discrete)
        assert line.deviation[-1] == pytest.approx(end, rel=discrete, abs=1e-12)
        np.testing.assert_allclose(line.offset + line.slope * line.a + line.deviation, line.output, atol=1e-12)


def test_uncertainty_is_the_spread_of_drawn_coefficients(fitted: Fit) -> None:
    count, at = 4000, [0, 60, 100, 200]
    names = [e.name for e in fitted.free]
    rng = np.random.default_rng(9)
    drawn = rng.multivariate_normal([e.value for e in fitted.free], fitted.covariance, size=count)
    lines = [straight_line(with_values(fitted, **dict(zip(names, row, strict=True)))) for row in drawn.tolist()]
    line = straight_line(fitted)
    # False alarm: eight standard deviations of 4000 draws, each within 4.5 of its own 1.1 %: 6e-5.
    for stated, result in (
        (line.output_std, [item.output for item in lines]),
        (line.deviation_std, [item.deviation for item in lines]),
    ):
        np.testing.assert_allclose(np.std(result, axis=0)[at], stated[at], rtol=4.5 / np.sqrt(2 * count))
    assert np.all(line.deviation_std[at] != line.output_std[at])  # the twin that must fail: bands are not the same


def test_a_linear_model_is_its_own_line(fitted: Fit) -> None:
    line = straight_line(with_values(replace(fitted, model=Model.linear()), bias=0.1, scale_factor=0.02))
    assert not np.any(line.deviation)
    assert not np.any(line.deviation_std)
    assert np.all(line.output_std > 0.0)


def test_one_acceleration_has_no_line(fitted: Fit) -> None:
    with pytest.raises(ValueError, match="is empty"):
        straight_line(fitted, 2.0, 2.0)
