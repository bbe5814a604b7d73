"""The loop's mechanics: adding, dropping, predicting without position, and what it prints. Its power is tested on
independent worlds in tests/hidden."""

import dataclasses
import json
from functools import partial

import numpy as np
import pytest

import accelcal as ac
from accelcal import verbs
from accelcal.cli import write_recording
from accelcal.diagnosis.search.scores import log_survival, score_gain, variance_gain
from accelcal.estimation.estimate import estimate, restored_states, solve_runs
from accelcal.estimation.rows import normal_equations
from accelcal.results import json as results_json, model_file
from accelcal.simulation import CXL02_RIG
from accelcal.verbs import add, diagnose, drop, improve
from tests import commands

TRUTH = {"bias": 0.05, "scale_factor": 0.01}


def record(seed, seconds=40.0, rig=CXL02_RIG, motion="interleaved", **more):
    rng = np.random.default_rng(seed)
    return ac.simulate(motion, seconds=seconds, rig=rig, parameters={**TRUTH, **more}, rng=rng).recording


@pytest.fixture(scope="module")
def plain():
    recording = record(1)
    return recording, estimate(ac.Model.linear(), recording)


@pytest.fixture(scope="module")
def nonlinear():
    return record(2, quadratic=1e-3), record(3, quadratic=1e-3)


def test_the_error_falls_to_the_floor_and_nothing_is_left(nonlinear):
    improvement = improve(nonlinear[0], holdout=nonlinear[1])
    assert improvement.effects == ("quadratic",)
    assert improvement.diagnosis.verdict == "adequate"
    before, after = (step.heldout for step in improvement.steps)
    assert after.coast_rms[10.0] < 0.5 * before.coast_rms[10.0]
    assert after.coast_rms[10.0] < 2.0 * after.coast_floor[10.0]


def test_nothing_is_added_where_nothing_is_missing(plain):
    # Family-wise 0.5 % per record; the worlds measure that rate.
    improvement = improve(plain[0])
    assert improvement.effects == ()
    assert improvement.diagnosis.verdict == "adequate"
    assert improvement.same_run
    assert improvement.diagnosis.scan.examined > 100
    assert improvement.diagnosis.scan.detection_limits["cubic"] > 0.0


def test_a_fit_is_resumed_as_it_ended():
    run = dataclasses.replace(record(6, cubic=1e-3), digest="six")
    fit = estimate(ac.Model.cubic(), run)
    left, resumed = solve_runs(fit.model, [run]).states[0], restored_states(fit, [run])[0]
    # Rounds of a fit end when a hundredth of a standard deviation moves nothing; so far may the two be apart.
    again, before = (normal_equations(state, fit.model.free) for state in (resumed, left))
    assert np.allclose(again.gram, before.gram, rtol=1e-4)
    assert resumed.log_likelihood == pytest.approx(left.log_likelihood, abs=1e-3)
    assert restored_states(fit, [dataclasses.replace(run, digest="seven")]) is None
    assert restored_states(fit, [run.part(0.0, 20.0)]) is None


def test_outliers_count_neither_in_a_fit_nor_when_an_effect_is_added():
    clean = dataclasses.replace(record(7, cubic=1e-3), digest="seven")
    spoiled = clean.accel.y.copy()
    spoiled[5_000:60_000:5_000] += 3.0
    run = dataclasses.replace(clean, accel=dataclasses.replace(clean.accel, y=spoiled))
    every, remaining = ac.fit(run, reject_outliers=False), ac.fit(run)
    assert every.noise().q > 2.0 * remaining.noise().q
    assert (
        remaining.remarks[0].sentence
        == "simulated interleaved: 11 of 66680 readings of accel were rejected as outliers"
    )
    grown, truth = add(remaining, run, "cubic"), add(verbs.fit(clean), clean, "cubic")
    assert grown.remarks[0] == remaining.remarks[0]
    assert grown["cubic"].value == pytest.approx(truth["cubic"].value, abs=0.5 * truth["cubic"].std)
    assert not any(remark.code == "outliers_rejected" for remark in truth.remarks)


def test_a_fit_of_a_record_without_outliers_is_that_of_all_readings():
    run = record(9)
    rejecting, every = ac.fit(run), estimate(ac.Model.linear(), run)
    assert [e.value for e in rejecting.estimates] == [e.value for e in every.estimates]
    np.testing.assert_array_equal(rejecting.covariance, every.covariance)
    assert rejecting.remarks == every.remarks


def test_a_delay_beyond_its_tolerance_is_named_first():
    improvement = improve(record(4, time_offset=2e-4), holdout=record(5, time_offset=2e-4))
    assert improvement.effects == ("time_offset",)
    assert [step.effects for step in improvement.steps] == [(), ("time_offset",)]
    assert set(improvement.classes[0].members) == {"time_offset", "sensor_lag", "sensor_resonance", "encoder_lag"}
    first, second = (step.heldout for step in improvement.steps)
    assert second.one_step_rms < first.one_step_rms


def test_a_delay_within_its_tolerance_is_not_named():
    recording = record(4, time_offset=2e-4)
    lax = dataclasses.replace(recording, rig=dataclasses.replace(recording.rig, offset_tolerance=3e-4))
    assert improve(lax).effects == ()


@pytest.mark.parametrize(
    "effect",
    ["velocity", "rail_curve", "coulomb", "hysteresis", "self_heating", "encoder_backlash", "bias_step", "cubic"],
)
def test_coasting_with_any_effect_never_looks_at_position(plain, effect):
    recording, fitted = plain
    grown = add(fitted, recording, effect)
    start = 20.0
    late = recording.position.t > start
    noise = np.random.default_rng(0).standard_normal(int(late.sum()))
    y = recording.position.y.copy()
    y[late] = noise
    blind = dataclasses.replace(recording, position=dataclasses.replace(recording.position, y=y))
    along, unseen = (ac.verbs.coast(grown, run, start, 5.0) for run in (recording, blind))
    np.testing.assert_array_equal(along.frozen, unseen.frozen)
    np.testing.assert_array_equal(along.rezeroed, unseen.rezeroed)
    # The sister: noise before the start does change the prediction.
    y = recording.position.y + 1e-5 * np.random.default_rng(1).standard_normal(len(recording.position))
    other = dataclasses.replace(recording, position=dataclasses.replace(recording.position, y=y))
    assert np.any(ac.verbs.coast(grown, other, start, 5.0).frozen != along.frozen)


def test_what_is_added_can_be_dropped(plain):
    recording, fitted = plain
    grown = add(fitted, recording, "cubic", "velocity")
    assert grown.model.added == ("cubic", "velocity")
    back = drop(grown, recording, "velocity", "cubic")
    for again, first in zip(back.estimates, fitted.estimates, strict=True):
        assert again.value == pytest.approx(first.value, abs=0.02 * again.std)  # both end within 1 % of a sigma


@pytest.mark.parametrize(
    ("name", "message"),
    [("cubik", "did you mean cubic"), ("temperature_bias", "needs the channel temperature"), ("bias", "already in")],
)
def test_what_cannot_be_added_is_said(plain, name, message):
    with pytest.raises(ValueError, match=message):
        add(plain[1], plain[0], name)


def test_a_model_with_shapes_survives_its_file(plain, tmp_path):
    grown = add(plain[1], plain[0], "self_heating")
    model_file.save(grown, tmp_path / "m.json")
    again = model_file.load(tmp_path / "m.json")
    assert model_file.to_dict(again) == model_file.to_dict(grown)
    assert again.model.shapes["self_heating"]["tau"] > 0.0


def test_a_diagnosis_has_its_documented_keys(nonlinear):
    fitted = estimate(ac.Model.linear(), nonlinear[0])
    content = results_json.content(diagnose(fitted, nonlinear[0]))
    keys = {"schema", "verdict", "sentence", "effects", "classes", "inseparable", "breaks", "used", "suspect", "scan"}
    assert keys | {"where", "importance"} <= set(content)
    first = content["scan"]["candidates"][0]
    assert {"effect", "estimate", "unit", "std", "p_value", "p_raw", "log_evidence", "members", "weights"} <= set(first)
    assert first["effect"] == "quadratic"
    assert abs(first["estimate"][0] - 1e-3) < 4.5 * first["std"][0]
    evidence = [c["log_evidence"] for c in content["scan"]["candidates"]]
    assert evidence == sorted(evidence, reverse=True)


def test_survival_does_not_saturate():
    # Against the closed form of two degrees of freedom, exp(-x/2), far beyond the range of floats.
    for gain in (1.0, 100.0, 5000.0, 1e5):
        assert log_survival(gain, 2) == pytest.approx(-gain / 2.0, rel=1e-9)
    assert log_survival(20.0, 1) > log_survival(2000.0, 1) > log_survival(1e6, 1)


def test_scores_are_those_of_least_squares():
    rng = np.random.default_rng(6)
    X, y = rng.standard_normal((200, 3)), rng.standard_normal(200)
    gain, dof, coefficients, covariance = score_gain(X.T @ X, X.T @ y)
    beta, left, *_ = np.linalg.lstsq(X, y)
    assert dof == 3
    np.testing.assert_allclose(coefficients, beta, rtol=1e-10)
    np.testing.assert_allclose(covariance, np.linalg.inv(X.T @ X), rtol=1e-9)
    assert gain == pytest.approx(float(y @ y - left[0]), rel=1e-9)


def test_a_variance_component_is_found_only_where_there_is_one():
    rng = np.random.default_rng(7)
    X = rng.standard_normal((400, 12))
    noise = rng.standard_normal(400)
    explained, _, s, _ = variance_gain(X.T @ X, X.T @ (X @ rng.standard_normal(12) * 0.5 + noise))
    unexplained, *_ = variance_gain(X.T @ X, X.T @ noise)
    assert explained > 30.0
    assert 0.25 < s[0] < 1.0  # 12 draws of a standard deviation of 0.5
    assert unexplained < 6.0


EFFECTS_FILE = '''
from accelcal.effects import effect


@effect("my_quintic", unit="(m/s²)⁻⁴", symbol="K5", scale=1e-6, source="a guess")
def my_quintic(s):
    """Fifth-order nonlinearity.

    Equation: e = K5 a⁵.
    Looks like: a fifth harmonic.
    Easily confused with: cubic.
    Separate by: three amplitudes.
    """
    return s.a**5
'''


def test_a_users_own_effect_is_ranked_first_on_data_that_contain_it(tmp_path):
    recording, other = record(8, motion="fast"), record(9, motion="fast")
    for name, data in (("run.csv", recording), ("other.csv", other)):
        inside = (data.accel.y - TRUTH["bias"]) / (1.0 + TRUTH["scale_factor"])
        y = data.accel.y + 2e-7 * inside**5  # the low-pass changes a⁵ of a slow motion by a few percent only
        write_recording(dataclasses.replace(data, accel=dataclasses.replace(data.accel, y=y)), tmp_path / name)
    (tmp_path / "mine.py").write_text(EFFECTS_FILE, encoding="utf-8")

    accelcal = partial(commands.accelcal, cwd=tmp_path)

    option = ("--effects-file", "mine.py")
    assert accelcal("fit", "run.csv", "-o", "m.json").returncode == 0
    diagnosed = accelcal("diagnose", "m.json", "run.csv", "--json", *option)
    assert diagnosed.returncode == 0, diagnosed.stderr
    assert json.loads(diagnosed.stdout)["scan"]["candidates"][0]["effect"] == "my_quintic"
    added = accelcal("add", "m.json", "run.csv", "--effect", "my_quintic", "-o", "m2.json", *option)
    assert added.returncode == 0, added.stderr
    compared = accelcal("compare", "m.json", "m2.json", "other.csv", "--json", *option)
    before, after = (evaluation["coast_rms"]["10.0"] for evaluation in json.loads(compared.stdout)["evaluations"][0])
    assert after < before
    lost = accelcal("compare", "m2.json", "other.csv")
    assert lost.returncode == 3
    assert "--effects-file" in lost.stderr
    absent = accelcal("diagnose", "m.json", "run.csv", "--effects-file", "gone.py")
    assert absent.returncode == 3
    assert "gone.py" in absent.stderr
