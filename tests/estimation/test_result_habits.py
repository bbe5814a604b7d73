"""Habits from lmfit, statsmodels and scikit-learn on a fit: what is there, and what stands for the rest."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Finding
from accelcal.simulation import CXL02_RIG


@pytest.fixture(scope="module")
def fitted() -> tuple[ac.Fit, ac.Fit, ac.Recording]:
    truth = {"bias": 0.05, "cubic": 2e-3}
    run = ac.simulate(
        "interleaved", seconds=20.0, rig=CXL02_RIG, parameters=truth, rng=np.random.default_rng(3)
    ).recording
    base = ac.fit(run)
    return base, ac.add(base, run, "cubic"), run


def test_criteria_prefer_the_right_model(fitted: tuple[ac.Fit, ac.Fit, ac.Recording]) -> None:
    base, cubic, _ = fitted
    assert cubic.aic < base.aic
    assert cubic.bic < base.bic
    one_more = 2.0 * (cubic.log_likelihood - base.log_likelihood)
    assert base.aic - cubic.aic == pytest.approx(one_more - 2.0)
    assert base.bic - cubic.bic == pytest.approx(one_more - math.log(sum(run.readings for run in base.runs)))


def test_criteria_count_coefficients_two_noises_of_each_run_and_readings(
    fitted: tuple[ac.Fit, ac.Fit, ac.Recording],
) -> None:
    """By their definitions (Akaike 1974, Schwarz 1978), of one run and of two."""
    run = fitted[2].part(0.0, 6.0)
    for fit in (ac.fit(run), ac.fit([run, replace(run, name="again", digest="again")])):
        count = len(fit.free) + 2 * len(fit.runs)
        assert fit.aic == pytest.approx(2.0 * count - 2.0 * fit.log_likelihood)
        assert fit.bic == pytest.approx(math.log(sum(r.readings for r in fit.runs)) * count - 2.0 * fit.log_likelihood)


@pytest.mark.parametrize("verb", ["fit", "diagnose", "add", "improve", "power", "compare"])
def test_progress_rises_and_ends_at_most_at_the_whole(verb: str, fitted: tuple[ac.Fit, ac.Fit, ac.Recording]) -> None:
    base, run = fitted[0], fitted[2].part(0.0, 6.0)
    arguments = {
        "fit": (run,),
        "diagnose": (base, run),
        "add": (base, run, "cubic"),
        "improve": (run,),
        "power": (base, run),
        "compare": (base, run),
    }[verb]
    shares: list[float] = []
    getattr(ac, verb)(*arguments, progress=shares.append)
    assert shares
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] <= shares[-1] <= 1.0


def test_prediction_and_residual_add_up_to_the_output(fitted: tuple[ac.Fit, ac.Fit, ac.Recording]) -> None:
    base, cubic, run = fitted
    t, predicted = cubic.predict(run)
    again, left = cubic.residual(run)
    evaluation = ac.compare(cubic, run)[0]
    assert np.array_equal(t, again)
    np.testing.assert_allclose(predicted + left, evaluation.measured, rtol=0.0, atol=1e-12)
    assert np.std(left) < np.std(base.residual(run)[1])
    assert "cubic" in cubic.fit_report()
    with pytest.raises(TypeError, match=r"predict\(recording\): recording is an array"):
        cubic.predict(run.accel.y)  # type: ignore[arg-type]


def test_the_report_of_several_runs_gives_the_range_of_their_agreement(
    fitted: tuple[ac.Fit, ac.Fit, ac.Recording],
) -> None:
    (run,) = fitted[1].runs
    several = replace(fitted[1], runs=tuple(replace(run, nis=nis) for nis in (1.002, 0.97, 1.1)))
    assert several.fit_report().count("normalised innovation squared") == 1
    assert "normalised innovation squared 0.970 to 1.100 (1 when consistent)" in several.fit_report()


@pytest.mark.parametrize(
    ("name", "instead"),
    [
        ("params", "fit.estimates"),
        ("covar", "fit.covariance"),
        ("score", "fit_percent"),
        ("apply", "calibrate"),
    ],
)
def test_a_name_of_another_package_names_its_counterpart(
    fitted: tuple[ac.Fit, ac.Fit, ac.Recording], name: str, instead: str
) -> None:
    with pytest.raises(AttributeError, match=f"has no '{name}'; its counterpart is .*{instead}"):
        getattr(fitted[0], name)
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        fitted[0].nonsense  # noqa: B018


def test_estimates_and_recordings_name_counterparts_too(fitted: tuple[ac.Fit, ac.Fit, ac.Recording]) -> None:
    with pytest.raises(AttributeError, match=r"Estimate has no 'stderr'; its counterpart is estimate\.std"):
        fitted[0]["bias"].stderr  # type: ignore[attr-defined]  # noqa: B018
    with pytest.raises(AttributeError, match=r"Recording has no 'plot'; its counterpart is recording\.to_dataframe"):
        fitted[2].plot  # type: ignore[attr-defined]  # noqa: B018


def test_names_of_parameters_are_those_of_a_mapping(fitted: tuple[ac.Fit, ac.Fit, ac.Recording]) -> None:
    base, cubic, _ = fitted
    assert list(cubic) == ["bias", "scale_factor", "time_offset", "cubic"]
    assert "cubic" in cubic
    assert "cubic" not in base
    assert {name: cubic[name].value for name in cubic}["cubic"] == cubic["cubic"].value


def test_an_effect_of_several_coefficients_names_them(fitted: tuple[ac.Fit, ac.Fit, ac.Recording]) -> None:
    waved = ac.add(fitted[1], fitted[2], "tone")
    with pytest.raises(KeyError, match=r"'tone' has several coefficients: tone\.sin, tone\.cos"):
        waved["tone"]


def test_rounding_that_all_stamps_share_is_in_the_time_offset_alone(
    fitted: tuple[ac.Fit, ac.Fit, ac.Recording],
) -> None:
    base, _, run = fitted
    rounded = Finding("rounded_stamps", "accel", 1, 0.0, "stamps are rounded", common=2e-4)
    fit = ac.fit(replace(run, findings=(*run.findings, rounded)))
    for before, after in zip(base.free, fit.free, strict=True):
        common = 2e-4 if before.name == "time_offset" else 0.0
        assert after.std == pytest.approx(math.hypot(before.std, common), rel=1e-9)
