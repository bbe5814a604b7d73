"""The uncertainty budget against Monte-Carlo draws of what was declared, and the calibration applied to readings."""

import math
from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.calibration.characteristic import OutsideRange, apply, budget, characteristic, example
from accelcal.data.rig import STANDARD_GRAVITY, Sensor, Uncertainty
from accelcal.estimation.estimate import estimate
from accelcal.estimation.run_to_run import Spread
from accelcal.simulation import CXL02_RIG

DECLARED = Uncertainty(encoder_scale=2e-4, level=1e-3, misalignment=4e-3)
VALUES = {"bias": 0.05, "scale_factor": 0.02, "time_offset": 1e-4, "quadratic": 3e-4, "cubic": 1e-3}
STD = {"bias": 2e-3, "scale_factor": 1e-5, "time_offset": 1e-6, "quadratic": 2e-7, "cubic": 1e-7}
DRAWS = 200_000


@pytest.fixture(scope="module")
def cubic():
    """Build a fit of round numbers; nothing in it comes from a filter."""
    run = ac.simulate(
        "tones", seconds=10.0, rig=CXL02_RIG, parameters={"bias": 0.05}, rng=np.random.default_rng(1)
    ).recording
    fit = estimate(ac.Model.cubic(), run)
    estimates = tuple(replace(e, value=VALUES[e.name], std=STD[e.name]) for e in fit.estimates)
    covariance = np.diag([STD[e.name] ** 2 for e in fit.free])
    return replace(fit, estimates=estimates, covariance=covariance, validity={"a": (-6.0, 5.0)})


def on(fit, **rig):
    return replace(fit, rig=replace(fit.rig, uncertainty=DECLARED, **rig))


FURTHER = {"temperature_bias": 0, "temperature_scale": 1, "scale_asymmetry": 1, "odd_quadratic": 2}
"""Power of the acceleration that each multiplies."""


def drawn(fit):
    """Spread of each parameter over drawn encoder scales, levels and misalignments, each calibrated without error."""
    rng = np.random.default_rng(2)
    e, level, off = (
        s * rng.standard_normal(DRAWS) for s in (DECLARED.encoder_scale, DECLARED.level, DECLARED.misalignment)
    )
    # Gravity along a stage axis with inclination phi is g0 sin(phi); the input axis is off by a further angle.
    phi = math.asin(fit.rig.gravity / STANDARD_GRAVITY)
    gravity = STANDARD_GRAVITY * np.sin(phi + level) + STANDARD_GRAVITY * (np.sin(phi + off) - np.sin(phi))
    spread = {"bias": gravity}
    for name, n in {"scale_factor": 1, "quadratic": 2, "cubic": 3, **FURTHER}.items():
        size = 1.0 + VALUES[name] if name == "scale_factor" else fit[name].value
        spread[name] = size * (np.cos(off) * (1.0 + e)) ** n
    return {name: math.hypot(float(np.std(y)), fit[name].std) for name, y in spread.items()}


@pytest.mark.parametrize("axis", ["level", "up"])
def test_combined_uncertainty_is_that_of_drawn_rigs(cubic, axis):
    fit = on(cubic, axis=axis)
    further = (replace(fit["cubic"], name=name, value=2e-3, std=1e-7) for name in FURTHER)
    fit = replace(fit, estimates=(*fit.estimates, *further))
    expected = drawn(fit)
    lines = {line.estimate.name: line for line in budget(fit).lines}
    assert set(lines) == set(expected)
    for name, line in lines.items():
        assert line.combined == pytest.approx(expected[name], rel=0.02)  # 200 000 draws know it to 0.3 %
        assert line.expanded == 2.0 * line.combined
        assert line.components[0].kind == "A"
        assert line.components[0].contribution == fit[name].std


def test_a_wrong_power_would_be_seen(cubic):
    # The sister: a cubic that took the encoder scale once, not three times, would be outside.
    fit = on(cubic)
    line = next(line for line in budget(fit).lines if line.estimate.name == "cubic")
    once = math.hypot(STD["cubic"], DECLARED.encoder_scale * VALUES["cubic"])
    assert not math.isclose(line.combined, once, rel_tol=0.1)


def test_what_is_not_declared_is_listed(cubic):
    assert budget(replace(cubic, rig=replace(cubic.rig, uncertainty=Uncertainty()))).missing == (
        "uncertainty.encoder_scale",
        "uncertainty.level",
        "uncertainty.misalignment",
    )
    partly = replace(cubic, rig=replace(cubic.rig, uncertainty=replace(DECLARED, level=None)))
    assert budget(partly).missing == ("uncertainty.level",)
    assert budget(partly).lines == ()
    assert budget(on(cubic)).missing == ()


def test_a_separated_tilt_needs_no_level(cubic):
    tilted = replace(on(cubic), model=cubic.model.add("tilt"))
    partly = replace(tilted, rig=replace(tilted.rig, uncertainty=replace(DECLARED, level=None)))
    assert budget(partly).missing == ()
    bias = next(line for line in budget(partly).lines if line.estimate.name == "bias")
    assert "level of the stage axis" not in [c.source for c in bias.components]


def test_two_clocks_of_which_none_is_trusted_are_in_the_budget(cubic):
    skewed = replace(cubic["cubic"], name="clock_skew", value=-3e-5, std=1e-7)
    fit = replace(on(cubic), estimates=(*cubic.estimates, skewed))
    rates = {}
    for trusted, declared in ((None, None), ("position", None), ("accel", None), (None, 1e-6)):
        rig = replace(fit.rig, trusted_clock=trusted, uncertainty=replace(DECLARED, clock_rate=declared))
        line = next(x for x in budget(replace(fit, rig=rig)).lines if x.estimate.name == "scale_factor")
        rates[trusted, declared] = {c.source: c.input_std for c in line.components}.get("rate of the clock", 0.0)
    assert rates == {(None, None): 3e-5, ("position", None): 0.0, ("accel", None): 0.0, (None, 1e-6): 1e-6}


@pytest.mark.parametrize(("reference", "order"), [("position", 2), ("velocity", 1), ("reference_acceleration", 0)])
def test_the_clock_enters_as_often_as_the_reference_is_differentiated(cubic, reference, order):
    (run,) = cubic.runs
    rig = replace(cubic.rig, uncertainty=replace(DECLARED, clock_rate=1e-3))
    fit = replace(cubic, rig=rig, runs=(replace(run, noise=replace(run.noise, reference=reference)),))
    line = next(x for x in budget(fit).lines if x.estimate.name == "scale_factor")
    clock = sum(c.contribution for c in line.components if c.source == "rate of the clock")
    assert clock == pytest.approx(order * 1e-3 * fit.values().scale)


def test_a_corrected_reading_has_the_uncertainty_of_the_rig(cubic):
    alone, whole = apply(replace(cubic, rig=replace(cubic.rig, uncertainty=Uncertainty())), 2.0), apply(on(cubic), 2.0)
    assert alone.combined == alone.std == whole.std
    rng, fit, spread = np.random.default_rng(3), on(cubic), []
    sizes = (DECLARED.level, DECLARED.misalignment, DECLARED.encoder_scale)
    for level, off, e in rng.standard_normal((2000, 3)) * sizes:
        bias = VALUES["bias"] + STANDARD_GRAVITY * (math.sin(level) + math.sin(off))
        estimates = tuple(replace(item, value=bias) if item.name == "bias" else item for item in fit.estimates)
        spread.append(apply(replace(fit, estimates=estimates), 2.0).acceleration * (1.0 - e))
    assert whole.declared == pytest.approx(np.std(spread), rel=0.1)  # 2000 draws know it to 1.6 %


def test_scatter_from_run_to_run_is_independent_per_parameter(cubic):
    spreads = tuple(
        Spread(name, name, cubic[name].unit, 1e-2, 0.0, 1.0, 0.01, (), 0.0, 2e-2) for name in ("bias", "scale_factor")
    )
    exact = Uncertainty(encoder_scale=0.0, level=0.0, misalignment=0.0)
    fit = replace(cubic, spreads=spreads, rig=replace(cubic.rig, uncertainty=exact))
    parts = [line.components[1].contribution for line in budget(fit).lines if line.estimate.name != "time_offset"][:2]
    reading = apply(fit, 2.0)
    slope = characteristic(fit).slope(reading.acceleration)
    expected = math.hypot(parts[0], parts[1] * reading.acceleration) / slope
    assert reading.declared == pytest.approx(expected)


@pytest.mark.parametrize("a", [-5.0, -0.3, 0.0, 2.0, 6.0])
def test_applying_inverts_the_forward_model(cubic, a):
    output = 1.02 * a + 0.05 + 3e-4 * a**2 + 1e-3 * a**3
    result = apply(cubic, output)
    assert result.acceleration == pytest.approx(a, rel=1e-12, abs=1e-13)  # Newton to rest, well-conditioned
    rng = np.random.default_rng(3)
    draws = []
    for _ in range(2000):
        off = tuple(replace(e, value=e.value + e.std * rng.standard_normal()) for e in cubic.estimates)
        draws.append(apply(replace(cubic, estimates=off), output).acceleration)
    assert np.std(draws) == pytest.approx(result.std, rel=0.08)  # five sigma of 2000 draws


def test_an_output_beyond_the_turning_point_is_refused(cubic):
    falling = replace(
        cubic, estimates=tuple(replace(e, value=-5e-3) if e.name == "cubic" else e for e in cubic.estimates)
    )
    assert apply(falling, 3.0).acceleration > 2.9
    with pytest.raises(OutsideRange, match="monotone"):
        apply(falling, 30.0)


def test_the_example_starts_from_what_the_instrument_shows(cubic):
    sensor = Sensor(scale=0.025, scale_unit="V", zero=2.5)
    result = example(on(cubic, sensor=sensor))
    assert result.raw_unit == "V"
    assert result.raw == float(f"{result.raw:.5g}")
    assert result.output == pytest.approx((result.raw - 2.5) / 0.025, rel=1e-9)
    assert -6.0 < result.acceleration < 5.0
    assert ("time_offset", "timing") in result.left_out
    assert example(cubic).raw is None
