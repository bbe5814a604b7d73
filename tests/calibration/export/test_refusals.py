"""What is exported is the sensor's own; what cannot be is refused by name, and left out only knowingly."""

from dataclasses import replace

import numpy as np
import pytest

from accelcal.calibration.export import NotExportable, calibrate, header, module
from accelcal.calibration.export.approximate import READING_OUTSIDE, evaluate
from accelcal.effects import BUILT_IN, find, from_expression, side_channel
from accelcal.effects.registry import CATALOGUE

from .models import SHAPES, THERMAL, fit_of

BASE = {"bias": 0.05, "scale_factor": 0.01}
EXPORTED = {"bias", "scale_factor", "scale_asymmetry", "quadratic", "odd_quadratic", "cubic", "saturation", *THERMAL}


def named(effect):
    """A fit whose model has one more effect, with all its columns and shapes."""
    shapes = {**dict.fromkeys(effect.shapes, 1.0), **SHAPES.get(effect.name, {})}
    names = [effect.name] if effect.width == 1 else [f"{effect.name}.{part}" for part in effect.parts]
    base = fit_of(BASE, temperature=(15.0, 40.0))
    model = base.model.add(effect.name, shapes={effect.name: shapes})
    more = tuple(replace(base.estimates[0], name=n, owner=effect.owner, value=1e-4) for n in names)
    return replace(base, model=model, estimates=base.estimates + more, covariance=1e-12 * np.eye(3 + len(more)))


@pytest.mark.parametrize(
    "effect", [e for e in BUILT_IN if e.name not in EXPORTED and e.name != "time_offset"], ids=lambda e: e.name
)
def test_every_other_effect_is_left_out_or_refused_by_its_owner(effect):
    fit = named(effect)
    if effect.owner == "sensor" and effect.port == "output":
        with pytest.raises(NotExportable, match=rf"^{effect.name} ") as caught:
            calibrate(fit)
        assert f"--without {effect.name}" in str(caught.value)
        calibration = calibrate(fit, without=[effect.name])
        assert "left out by request" in next(
            missing.why for missing in calibration.left_out if missing.effect == effect.name
        )
    else:
        calibration = calibrate(fit)
    plain = calibrate(fit_of(BASE, temperature=(15.0, 40.0)))
    assert calibration.double.inverse == plain.double.inverse
    absent = [missing.effect for missing in calibration.left_out]
    assert absent == ["time_offset", effect.name]
    assert f"{effect.name} " in header(calibration, "sensor.h")
    assert f"{effect.name} " in module(calibration)


def test_every_exported_effect_changes_the_function():
    plain = calibrate(fit_of(BASE, temperature=(15.0, 40.0))).double.inverse
    for name in EXPORTED - {"bias", "scale_factor", "saturation"}:
        calibration = calibrate(fit_of({**BASE, name: 1e-4}, temperature=(15.0, 40.0)))
        assert calibration.double.inverse != plain, name
        assert name not in [missing.effect for missing in calibration.left_out]


def test_an_effect_of_the_user_s_own_is_refused_by_name():
    before = dict(CATALOGUE)
    try:
        effect = from_expression("fifth_power", "a**5")
        with pytest.raises(NotExportable, match="fifth_power is an effect of your own"):
            calibrate(named(replace(effect.effect, owner="sensor")))
    finally:
        CATALOGUE.clear()
        CATALOGUE.update(before)


def test_an_effect_that_its_name_made_is_not_the_user_s_own():
    with pytest.raises(NotExportable, match="scale_factor_follows_abs_a depends on earlier readings"):
        calibrate(named(find("scale_factor_follows_abs_a")))
    with pytest.raises(NotExportable, match="supply_scale depends on the channel supply"):
        calibrate(named(side_channel("supply", "V", "scale_factor")))


def test_only_what_cannot_be_exported_can_be_left_out():
    with pytest.raises(NotExportable, match="'quadratic' is not among what cannot be exported"):
        calibrate(fit_of({**BASE, "quadratic": 1e-4}), without=["quadratic"])


def test_saturation_ends_the_range():
    calibration = calibrate(fit_of({**BASE, "saturation": 1.0}))
    low, high = calibration.domain.acceleration
    assert high == pytest.approx((12.0 - 0.05) / 1.01)
    assert low == pytest.approx((-12.0 - 0.05) / 1.01)
    _, outside = evaluate(calibration.double.inverse, np.array([2.5 + 0.0255 * 12.001, 2.5 + 0.0255 * 11.999]))
    assert list(outside) == [READING_OUTSIDE, 0]
    assert any("saturates" in text for text in calibration.remarks)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"acceleration": None}, "does not state the range of accelerations"),
        ({"acceleration": (3.0, 3.0)}, "range of acceleration is empty"),
    ],
)
def test_a_fit_without_a_range_is_refused(changed, message):
    with pytest.raises(NotExportable, match=message):
        calibrate(fit_of(BASE, **changed))


def test_a_thermal_model_without_temperatures_is_refused():
    with pytest.raises(NotExportable, match="depends on temperature but its fit had none"):
        calibrate(fit_of({**BASE, "temperature_bias": 1e-3}))


def test_a_temperature_that_moves_the_output_more_than_acceleration_does_is_refused():
    with pytest.raises(NotExportable, match="fit a record with more motion"):
        calibrate(fit_of({**BASE, "temperature_scale": 5e-3}, acceleration=(9.0, 10.0), temperature=(0.0, 100.0)))
