"""The stated bound against the exact inverse in forty digits, and proofs that must fail."""

from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from accelcal.calibration.characteristic import apply
from accelcal.calibration.export import NotExportable, calibrate
from accelcal.calibration.export.approximate import (
    MARGIN,
    READING_OUTSIDE,
    TEMPERATURE_OUTSIDE,
    _branches,
    approximation,
    chebyshev_rows,
    evaluate,
)
from accelcal.data.rig import Sensor

from .models import REFERENCE, VOLTS, exact, fit_of, fits

POINTS = 60
CUBIC = {"bias": 0.05, "scale_factor": 0.01, "quadratic": 1e-4, "cubic": 1e-5}
WARM = {**CUBIC, "temperature_bias": 1e-3, "temperature_scale": 1e-4}


def readings(code, rng):
    """Readings and temperatures over the whole range, ends included, as numbers of the format."""
    inverse = code.inverse
    w = inverse.warmth
    T = np.zeros(POINTS)
    if w is not None:
        T = w.centre + w.half * np.append(rng.uniform(-1.0, 1.0, POINTS - 2), [-1.0, 1.0])
    T = inverse.format.array(T)
    y = np.append(rng.uniform(inverse.low, inverse.high, POINTS - 4), [inverse.low, inverse.high] * 2)
    if w is not None:
        y = y + w.shift * (T.astype(float) - w.centre)
    return inverse.format.array(y), T


def off(fit, code, reading, T):
    """Largest distance from the exact inverse among the readings that are not flagged, m/s²."""
    a, outside = evaluate(code.inverse, reading, T)
    assert np.mean(outside == 0) > 0.9
    rows = zip(a[outside == 0], reading[outside == 0], T[outside == 0], strict=True)
    return float(max(abs(Decimal(float(x)) - exact(fit, float(y), float(t), float(x))) for x, y, t in rows))


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(fits())
def test_no_reading_inside_the_range_is_off_by_more_than_the_bound(fit):
    calibration = calibrate(fit)
    rng = np.random.default_rng(1)
    for code in calibration.codes:
        reading, T = readings(code, rng)
        assert off(fit, code, reading, T) <= code.bound
    a = max(abs(x) for x in calibration.domain.acceleration)
    zero = fit.rig.sensor.zero or 0.0
    # What a reading on a high zero costs is known: its own rounding, in m/s².
    size = a + abs(zero / (fit.rig.sensor.scale or 1.0))
    assert calibration.double.bound < 60 * 2.0**-53 * size
    assert calibration.single.bound < 60 * 2.0**-24 * size


def test_temperature_is_followed_to_roundoff_where_the_characteristic_is_flat():
    values = {"scale_factor": -0.2, "quadratic": 0.2, "temperature_scale": 5e-4}
    metres = replace(VOLTS, scale=1.0, zero=0.0)
    fit = fit_of(values, sensor=metres, acceleration=(-0.5, 0.5), temperature=(-40.0, 60.0))
    assert calibrate(fit).double.bound < 60 * 2.0**-53 * 0.5


@pytest.mark.parametrize("values", [CUBIC, WARM], ids=["cubic", "warm"])
def test_the_bound_is_not_a_multiple_of_what_is_seen(values):
    fit = fit_of(values, temperature=(15.0, 40.0))
    rng = np.random.default_rng(2)
    for code in calibrate(fit).codes:
        worst = max(off(fit, code, *readings(code, rng)) for _ in range(10))
        assert code.bound < 6 * worst


def test_a_wrong_coefficient_has_a_larger_bound_or_none():
    fit = fit_of(CUBIC)
    calibration = calibrate(fit)
    (branch,) = _branches(calibration.characteristic, fit.rig.sensor, calibration.domain, None)
    (segment,) = calibration.double.inverse.segments
    margin = MARGIN * (branch.high - branch.low)
    honest = approximation(segment, branch, margin, Fraction(0), Fraction(0))
    for row in range(4):
        wrong = [list(c) for c in segment.coefficients]
        wrong[row][0] += 1e-9
        bound = approximation(
            replace(segment, coefficients=tuple(map(tuple, wrong))), branch, margin, Fraction(0), Fraction(0)
        )
        assert 0.9e-9 < bound < 1.2e-9
        assert bound > 1e5 * honest
    wrong = [list(c) for c in segment.coefficients]
    wrong[1][0] *= 1.5
    with pytest.raises(ArithmeticError):
        approximation(replace(segment, coefficients=tuple(map(tuple, wrong))), branch, margin, Fraction(0), Fraction(0))


def test_chebyshev_coefficients_are_those_of_the_same_polynomial():
    powers = [[Fraction(3), Fraction(-1, 7)], [Fraction(0), Fraction(2)], [Fraction(5, 3), Fraction(1)]]
    series = chebyshev_rows(powers)
    T = (lambda x: Fraction(1), lambda x: x, lambda x: 2 * x * x - 1)
    for x, tau in ((Fraction(1, 3), Fraction(-2, 5)), (Fraction(-1), Fraction(1))):
        direct = sum(c * x**i * tau**j for i, row in enumerate(powers) for j, c in enumerate(row))
        assert sum(c * T[i](x) * T[j](tau) for i, row in enumerate(series) for j, c in enumerate(row)) == direct


def test_at_the_reference_temperature_it_is_the_report_s_worked_example():
    fit = fit_of(WARM, temperature=(15.0, 40.0))
    calibration = calibrate(fit)
    for output in (-12.0, 0.0, 3.7, 14.0):
        reading = VOLTS.zero + VOLTS.scale * output
        a, outside = evaluate(calibration.double.inverse, np.array([reading]), np.array([REFERENCE]))
        assert outside[0] == 0
        assert a[0] == pytest.approx(
            apply(fit, output).acceleration, abs=1e-12
        )  # Newton to rest, rounding of the reading


@pytest.mark.parametrize("scale", [0.0255, -0.0255])
def test_beyond_the_range_a_straight_line_goes_on_without_a_step(scale):
    fit = fit_of(WARM, sensor=replace(VOLTS, scale=scale), temperature=(15.0, 40.0))
    for code in calibrate(fit).codes:
        inverse = code.inverse
        T = np.full(4, inverse.warmth.centre)
        for end, way in ((inverse.low, -1.0), (inverse.high, 1.0)):
            length = inverse.high - inverse.low
            reading = inverse.format.array(
                [end, inverse.format.next(end, way), end + way * length, end + 2 * way * length]
            )
            a, outside = evaluate(inverse, reading, T)
            assert list(outside) == [0, READING_OUTSIDE, READING_OUTSIDE, READING_OUTSIDE]
            assert abs(a[1] - a[0]) <= code.tolerance
            # Equal steps of a straight line; and its slope is that of the curve at the end, 1/(1 + k) within a percent.
            assert a[3] - a[2] == pytest.approx(a[2] - a[0], rel=1e-5)
            assert (a[2] - a[0]) / (reading[2] - reading[0]) == pytest.approx(1.0 / (1.01 * scale), rel=0.02)


def test_beyond_the_temperatures_the_bias_goes_on_and_the_scale_is_held():
    fit = fit_of(WARM, temperature=(15.0, 40.0))
    inverse = calibrate(fit).double.inverse
    reading = np.full(5, 2.6)
    a, outside = evaluate(inverse, reading, np.array([40.0, 40.1, 50.0, 60.0, 14.0]))
    assert list(outside) == [0, *[TEMPERATURE_OUTSIDE] * 4]
    assert a[3] - a[2] == pytest.approx(-10.0 * WARM["temperature_bias"] / 1.0117, rel=2e-3)
    assert a[1] - a[0] == pytest.approx(-0.1 * WARM["temperature_bias"] / 1.0117, rel=2e-3)


def test_what_is_not_a_number_is_outside_and_stays_so():
    for values in (CUBIC, WARM):
        inverse = calibrate(fit_of(values, temperature=(15.0, 40.0))).double.inverse
        a, outside = evaluate(inverse, np.array([np.nan, 2.5, np.inf]), np.array([20.0, np.nan, 20.0]))
        assert np.isnan(a[0])
        assert outside[0] == READING_OUTSIDE
        assert outside[2] == READING_OUTSIDE
        assert a[2] == np.inf
        if inverse.warmth is not None:
            assert np.isnan(a[1])
            assert outside[1] == READING_OUTSIDE + TEMPERATURE_OUTSIDE


@pytest.mark.parametrize(
    ("values", "where"),
    [
        ({"quadratic": -0.04}, "17 m/s²"),
        ({"cubic": -2e-3}, "17 m/s²"),
        ({"scale_factor": -1.0}, "m/s²"),
        ({"scale_asymmetry": 1.5}, "-15 m/s²"),
    ],
)
def test_a_model_that_is_not_monotone_is_refused_with_the_place(values, where):
    with pytest.raises(NotExportable, match="not safely monotone") as caught:
        calibrate(fit_of({"bias": 0.05, **values}))
    assert where in str(caught.value)


def test_a_calibration_is_applied_to_arrays_as_the_code_does_it():
    cold = calibrate(fit_of({"bias": 0.2, "cubic": 1e-4}, sensor=Sensor()))
    a = np.linspace(-12.0, 12.0, 7)
    force, outside = cold.acceleration([*(a + 0.2 + 1e-4 * a**3), 40.0])
    np.testing.assert_allclose(force[:-1], a, rtol=0.0, atol=cold.double.bound + 1e-12)
    assert outside.tolist() == [0] * 7 + [1]

    warm = calibrate(fit_of({"temperature_bias": 0.01}, sensor=Sensor(), temperature=(10.0, 40.0)))
    np.testing.assert_allclose(warm.acceleration([1.0], 33.0)[0], 0.9, atol=1e-9)  # 10 K above the reference
    with pytest.raises(ValueError, match="depends on temperature; give it"):
        warm.acceleration([1.0])
    with pytest.raises(ValueError, match=r"temperatures of shape \(2,\); expected one temperature for all"):
        warm.acceleration([1.0, 1.0, 1.0], [20.0, 21.0])
