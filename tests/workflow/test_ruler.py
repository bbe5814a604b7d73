"""One filter for all rows of a table, paired changes with their standard error, and the best step by name."""

import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal import verbs
from accelcal.diagnosis.select.improvement import Step
from accelcal.estimation.estimate import estimate
from accelcal.simulation import CXL02_RIG
from accelcal.validation.differences import PairedStretches, heldout_change
from accelcal.validation.noise_floor import Ruler
from accelcal.verbs import heldout_rises

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "cubic": 2e-3}


def record(seed, seconds=40.0):
    rng = np.random.default_rng(seed)
    return ac.simulate("interleaved", seconds=seconds, rig=CXL02_RIG, parameters=TRUTH, rng=rng).recording


@pytest.fixture(scope="module")
def table():
    """A base model and a cubic one, each with a noise of its own, on another recording."""
    train, unseen = record(1), record(2)
    fits = [estimate(model, train) for model in (ac.Model.linear(), ac.Model.cubic())]
    return fits, unseen, verbs.compare(fits, unseen)


def test_all_rows_have_one_filter_one_band_and_the_same_start_points(table):
    fits, unseen, history = table
    assert fits[0].noise().q > 2.0 * fits[1].noise().q  # what the base lacks is noise to it
    first, second = history
    assert first.band == second.band
    assert np.allclose(first.residual_std[100:], second.residual_std[100:], rtol=1e-6)  # start-up depends on the delay
    assert all(np.array_equal(first.drifts[h][0], second.drifts[h][0]) for h in first.drifts)
    alone = [ac.compare(fit, unseen)[0] for fit in fits]
    assert alone[0].band != alone[1].band  # without a ruler each has its own


def test_all_rows_have_the_start_points_of_a_model_that_remembers_motion():
    train, unseen = record(3, 12.0), record(4, 5.0)
    lags = ac.Model.linear().add("shape_since_reversal")
    held = {term.name: 1e-3 for term in lags.terms if term.effect.name == "shape_since_reversal"}
    fits = [estimate(model, train) for model in (ac.Model.linear(), lags.freeze(**held))]
    first, second = verbs.compare_models(fits, unseen, Ruler.of(fits), horizons=(0.5,))
    assert len(first.drifts[0.5][0]) < 100
    assert np.array_equal(first.drifts[0.5][0], second.drifts[0.5][0])
    (alone,) = verbs.compare_models(fits[:1], unseen, Ruler.of(fits[:1]), horizons=(0.5,))
    assert len(alone.drifts[0.5][0]) > 150


def test_the_ruler_is_that_of_the_model_with_the_least_noise(table):
    fits, _, history = table
    assert Ruler.of(fits).noise == Ruler.of(fits[::-1]).noise == fits[1].noise()
    change = heldout_change(*history)
    assert change is not None
    assert change.percent < -20.0
    with pytest.raises(ValueError, match="at least one"):
        Ruler.of([])


def test_a_paired_change_is_as_uncertain_as_it_says():
    # 400 pairs of equal errors that share most of their noise: beyond two standard errors in 5 %, 7.5 % with 17 degrees
    # of freedom; more than 11 % has a chance of 0.5 %.
    rng = np.random.default_rng(1)
    t, alarms = np.arange(900) * 0.01, 0
    for _ in range(400):
        shared = rng.standard_normal(900)
        before, after = (shared + 0.2 * rng.standard_normal(900) for _ in range(2))
        alarms += abs(PairedStretches.of("drift", t, before, after, 0.5).change().sigma) > 2.0
    assert alarms <= 44
    worse = PairedStretches.of("drift", t, shared, 1.2 * shared, 0.5).change()
    assert worse.sigma > 5.0
    assert worse.percent == pytest.approx(20.0)


def test_too_few_stretches_give_no_standard_error(table):
    _, _, history = table
    assert heldout_change(history[0], history[1], 10.0) is None
    change = heldout_change(history[0], history[1])
    assert change is not None
    assert change.measure == "systematic error"
    change = heldout_change(*(dataclasses.replace(evaluation, resolved=()) for evaluation in history[:2]))
    assert change is not None
    assert change.measure == "drift after 1 s"
    assert change.sigma < -2.0


def test_a_last_step_that_is_worse_is_said_and_the_best_is_named(table):
    fits, _, (base, cubic) = table
    steps = [
        Step(names, fit, evaluation, evaluation)
        for names, fit, evaluation in zip(((), ("cubic",)), fits, (base, cubic), strict=True)
    ]
    assert heldout_rises(steps) == []
    # the same two models in the other order: the last step is the one that lacks the effect
    (note,) = heldout_rises([dataclasses.replace(steps[1]), dataclasses.replace(steps[0], effects=("cubic", "tone"))])
    assert note.code == "heldout_rises"
    assert "the best step is base + cubic" in note.sentence
    assert heldout_rises(steps[:1]) == []
