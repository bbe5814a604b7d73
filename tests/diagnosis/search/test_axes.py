"""Constants of a transverse channel and of the specific force: what is named beside them, and what sizes mean."""

import dataclasses
import json

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.scores import BaseProjection, CandidateScores
from accelcal.effects import find
from accelcal.effects.guard import read_only
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.run import prepare
from accelcal.estimation.smoothing import side_channels_at
from accelcal.filters.live_model import CausalSignals
from accelcal.signals.signals import Origins
from tests.diagnosis.search.axes import G, sideways, vertical


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("axes")


@pytest.fixture(scope="module")
def improved(folder):
    """The same record without a constant on its transverse channel, and with gravity there."""
    return {constant: ac.improve(sideways(41, folder, constant=constant).recording) for constant in (0.0, G)}


def test_gravity_across_the_axis_hides_nothing(improved, folder):
    truth = sideways(41, folder, constant=G).truth
    for result in improved.values():
        assert [group.members for group in result.classes] == [("cross_axis",)]
        size = result.best["cross_axis"]
        assert abs(size.value - truth["cross_axis"]) < 4.0 * size.std  # false alarm 6e-5
        assert result.diagnosis.verdict == "adequate"
        drifts = [step.heldout.coast_rms[1.0] for step in result.steps]
        assert drifts[1] < drifts[0]
    plain, in_gravity = (result.best["cross_axis"] for result in improved.values())
    assert in_gravity.value == pytest.approx(plain.value, rel=1e-3)


def test_the_bias_is_that_at_the_mean_of_the_channel(improved, folder):
    fit, truth = improved[G].best, sideways(41, folder, constant=G).truth
    assert fit.origins.side["a_y"] == pytest.approx(G, abs=0.05)
    expected = truth["bias"] + truth["cross_axis"] * fit.origins.side["a_y"]
    assert abs(fit["bias"].value - expected) < 4.0 * fit["bias"].std
    low, high = fit.validity["a_y"]
    assert low < G < high  # as it was recorded


def test_a_model_file_keeps_the_means(improved, tmp_path):
    path = tmp_path / "m.json"
    improved[G].best.save(path)
    assert ac.load_model(path).origins == improved[G].best.origins
    content = json.loads(path.read_text())
    assert content["stands_for"]["bias"].endswith("+ cross_axis at the mean of a_y")


def test_the_mean_is_that_of_the_model_on_any_record_and_of_the_fitted_runs(folder):
    first, second = (sideways(seed, folder, constant=constant).recording for seed, constant in ((43, 9.0), (44, 7.0)))
    fit = ac.fit([first, second])
    together = np.concatenate([run.side["a_y"].y for run in (first, second)])
    assert fit.origins.side["a_y"] == pytest.approx(np.mean(together), rel=1e-3)  # of what both channels cover
    there = side_channels_at(prepare(second, fit.origins), second.position.t)["a_y"]
    assert np.mean(there) == pytest.approx(np.mean(second.side["a_y"].y) - fit.origins.side["a_y"], abs=1e-9)


def test_rates_have_a_zero_of_their_own_and_effects_of_the_user_get_what_was_recorded(folder):
    run = sideways(45, folder, constant=G).recording
    turning = Channel("rate_i", run.accel.t, np.full(len(run.accel.t), 0.3), "rad/s")
    changed = dataclasses.replace(run, side={**run.side, "rate_i": turning})
    state = solve_runs(ac.Model.linear(), [changed]).states[0]
    assert np.allclose(state.signals.side["rate_i"], 0.3)
    assert abs(np.mean(state.signals.side["a_y"])) < 0.01
    assert np.mean(read_only(state.signals).side["a_y"]) == pytest.approx(G, abs=0.05)


@pytest.mark.parametrize(("seed", "shaker"), [(51, False), (52, False), (53, True)])
def test_a_quadratic_is_named_on_a_vertical_axis_with_bias_and_scale_at_zero_force(seed, shaker, folder):
    hidden = vertical(seed, folder, shaker=shaker)
    improvement = ac.improve(hidden.recording)
    assert improvement.effects == ("quadratic",)
    assert shaker or {"cubic", "odd_quadratic"} <= set(improvement.classes[0].members)
    for name, value in hidden.truth.items():
        assert abs(improvement.best[name].value - value) < 4.0 * improvement.best[name].std
    assert improvement.diagnosis.verdict == "adequate"
    assert not [remark for remark in improvement.diagnosis.remarks if remark.code == "heldout_rises"]
    base, last = (step.heldout.coast_rms[5.0] for step in improvement.steps)
    assert last < 1.1 * base


def test_nothing_is_named_on_a_plain_lift(folder):
    improvement = ac.improve(vertical(54, folder, hidden="").recording)
    assert (improvement.verdict, improvement.effects) == ("adequate", ())


def test_powers_of_the_force_are_testable_together_or_not_at_all(folder):
    state = solve_runs(ac.Model.linear(), [vertical(57, folder, hidden="").recording]).states[0]
    items = [Hypothesis(find(name), {}) for name in ("quadratic", "cubic", "odd_quadratic", "scale_asymmetry")]
    scores = CandidateScores([BaseProjection(state, ac.Model.linear())], items)
    assert scores.gains()[1].tolist() == [1, 1, 1, 0]  # |a| is the scale factor where the force keeps its sign
    shares = np.diag(scores.G) / scores.power
    assert np.max(shares) < 1e-4  # of a power about zero force: what the bias and the scale factor take up


def test_a_live_filter_counts_channels_from_the_means_of_the_model():
    signals = CausalSignals(ac.Rig(), Origins(side={"a_y": G}), step=1e-3, q=1e-8)
    there = signals.over(0.1, np.zeros(2), np.zeros(4), np.ones(4), {"a_y": G + 0.5, "supply": 5.0})
    assert np.allclose(there.side["a_y"], 0.5)
    assert np.allclose(there.side["supply"], 5.0)
    assert np.allclose(read_only(there).side["a_y"], G + 0.5)
