"""Two calibrations of one sensor: En against its definition and by simulation, verdicts, what changed between them."""

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.calibration.agreement import BEYOND_BY_CHANCE, agreement
from accelcal.calibration.characteristic import characteristic
from accelcal.data.recording import RunLabels
from accelcal.data.rig import Uncertainty
from accelcal.estimation.estimate import estimate
from accelcal.estimation.run_to_run import Spread
from accelcal.report import agreement_html
from accelcal.report.page import agreement_view
from accelcal.results import model_file
from accelcal.simulation import CXL02_RIG
from tests.report.reading import Page

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "cubic": 2e-3}


def measured(seed):
    recording = ac.simulate(
        "interleaved", seconds=12.0, rig=CXL02_RIG, parameters=TRUTH, rng=np.random.default_rng(seed)
    ).recording
    labels = RunLabels(20760.0 + seed, "holder 1", "A. Meier")
    recording = replace(recording, name=f"run{seed}.csv", digest=f"{seed:064x}", labels=labels)
    return estimate(ac.Model.linear().add("cubic"), recording)


@pytest.fixture(scope="module")
def fits():
    return measured(1), measured(2)


def moved(fit, **values):
    """Return the fit with other values of some coefficients, under another digest."""
    run = replace(fit.runs[0], digest="f" * 64, session="")
    estimates = tuple(replace(e, value=values.get(e.name, e.value)) for e in fit.estimates)
    return replace(fit, estimates=estimates, runs=(run,))


def drawn(fit, rng):
    """Return the fit with coefficients drawn from its own covariance."""
    values = rng.multivariate_normal([e.value for e in fit.free], fit.covariance)
    return moved(fit, **dict(zip([e.name for e in fit.free], values, strict=True)))


def test_en_is_the_difference_over_the_joint_expanded_uncertainty(fits):
    first, second = fits
    rows = {parameter.name: parameter for parameter in agreement(first, second).parameters}
    for name, parameter in rows.items():
        a, b = first[name], second[name]
        assert parameter.difference == b.value - a.value
        assert parameter.en == pytest.approx((b.value - a.value) / (2.0 * np.hypot(a.std, b.std)), rel=1e-12)


def test_declared_contributions_enter(fits):
    first, second = fits
    declared = replace(first.rig, uncertainty=Uncertainty(encoder_scale=1e-2, level=1e-3, misalignment=1e-3))
    wide = agreement(replace(first, rig=declared), second)
    narrow = agreement(first, second)
    both = [{parameter.name: parameter.joint for parameter in result.parameters} for result in (wide, narrow)]
    assert both[0]["scale_factor"] == pytest.approx(2.0 * 1.0e-2, rel=0.05)
    assert both[1]["scale_factor"] < 1e-3
    assert np.all(wide.characteristic.expanded > narrow.characteristic.expanded)


def test_equal_calibrations_differ_as_often_as_stated_and_the_characteristic_scatters_as_stated(fits):
    fit, rng, n = fits[0], np.random.default_rng(3), 400
    beyond, counted, spread = 0, 0, []
    for _ in range(n):
        result = agreement(drawn(fit, rng), drawn(fit, rng))
        beyond += len(result.differing)
        counted += len(result.compared)
        spread.append(result.characteristic.difference[::20])
    share = beyond / counted
    print(f"|En| > 1 in {beyond} of {counted}: {share:.3f}, stated {BEYOND_BY_CHANCE:.3f}")
    assert share == pytest.approx(BEYOND_BY_CHANCE, abs=0.03)  # 2.6 standard deviations if all were dependent
    ratio = 2.0 * np.std(spread, axis=0) / result.characteristic.expanded[::20]
    assert np.all(np.abs(ratio - 1.0) < 0.15)  # 4 standard deviations of 400


def test_a_calibration_agrees_with_itself_measured_again(fits):
    fit = fits[0]
    result = agreement(fit, moved(fit))
    assert result.verdict == "agree"
    assert agreement_view(result)["sentence"].startswith("The two calibrations agree in all 3 common parameters")
    assert result.shared == ()


def test_a_changed_coefficient_is_named(fits):
    fit = fits[0]
    far = fit["cubic"].value + 10.0 * fit["cubic"].std
    result = agreement(fit, moved(fit, cubic=far))
    assert result.verdict == "differ"
    assert [parameter.name for parameter in result.differing] == ["cubic"]
    assert result.differing[0].en == pytest.approx(10.0 / (2.0 * np.sqrt(2.0)), rel=1e-9)
    assert "differ in cubic (En 3.54)" in agreement_view(result)["sentence"]


def test_the_difference_of_characteristics_is_that_of_two_outputs(fits):
    first, second = fits
    curve = agreement(first, second).characteristic
    for a, difference in zip(curve.a[::40], curve.difference[::40], strict=True):
        outputs = [fit["bias"].value + (1 + fit["scale_factor"].value) * a + fit["cubic"].value * a**3 for fit in fits]
        assert difference == pytest.approx(outputs[1] - outputs[0], abs=1e-12)
    assert curve.a[0] == max(fit.validity["a"][0] for fit in fits)
    assert characteristic(first).forward(1.0) != characteristic(second).forward(1.0)


def test_a_shared_recording_another_sensor_and_another_model_are_said(fits):
    fit = fits[0]
    assert agreement(fit, fit).shared == ("run1.csv",)
    assert "not independent" in " ".join(agreement_view(agreement(fit, fit))["notes"])
    rigs = [replace(fit.rig, sensor=replace(fit.rig.sensor, serial=serial)) for serial in ("1", "2")]
    other = agreement(replace(fit, rig=rigs[0]), replace(moved(fit), rig=rigs[1]))
    assert "these are two sensors" in " ".join(agreement_view(other)["notes"])
    linear = replace(
        moved(fit),
        model=ac.Model.linear(),
        estimates=tuple(e for e in fit.estimates if e.name != "cubic"),
        covariance=fit.covariance[:3, :3],
    )
    view = agreement_view(agreement(fit, linear))
    assert "cubic (only in A)" in " ".join(view["notes"])
    assert ["effects of the model", "cubic", "base only"] in view["changes"]


def test_what_changed_is_listed_and_what_did_not_is_not(fits):
    changes = {what: (a, b) for what, a, b in agreement(*fits).changes}
    assert changes["date"] == ("2026-11-04", "2026-11-05")
    assert "operator" not in changes
    assert "mounting" not in changes
    assert "sensor" not in changes


def test_ranges_that_do_not_overlap_are_not_compared(fits):
    fit = fits[0]
    away = replace(moved(fit), validity={**fit.validity, "a": (100.0, 120.0)})
    result = agreement(fit, away)
    assert result.characteristic is None
    assert "do not overlap" in " ".join(agreement_view(result)["notes"])


def test_labels_are_kept_by_a_model_file(fits, tmp_path):
    path = tmp_path / "m.json"
    model_file.save(fits[0], path)
    assert model_file.load(path).runs[0].labels == fits[0].runs[0].labels


def test_the_page_shows_the_numbers_and_loads_nothing(fits):
    result = agreement(*fits, names=("<b>a.json</b>", "b.json"))
    page = Page(agreement_html(result))
    assert page.outside() == []
    assert "<b>a.json</b>" in page.text
    assert page.count("script") == 0
    view = agreement_view(result)
    for row in view["parameters"]:
        assert row["difference"] in page.text
        assert row["en"] in page.text


def test_an_uncertainty_that_is_not_known_is_said_and_no_difference(fits):
    fit = fits[0]
    cubic = fit["cubic"]
    spread = Spread("cubic", cubic.symbol, cubic.unit, 1e-4, 0.0, np.inf, 0.01, (cubic.value,), np.inf, np.inf)
    result = agreement(fit, replace(moved(fit, cubic=2.0 * cubic.value), spreads=(spread,)))
    first = next(row for row in agreement_view(result)["parameters"] if row["name"] == "cubic")
    assert first["second"].endswith("± not known")
    assert first["en"] == "0.00"
    assert "cubic" not in [item.name for item in result.differing]
