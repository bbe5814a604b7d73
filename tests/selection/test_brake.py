"""The brake in a stepwise selection: a refused effect stays out and is said, a true one enters."""

import pytest

import accelcal as ac
from accelcal.diagnosis.faults import Examined
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA
from accelcal.diagnosis.select.stepwise import SearchBudget, StepwiseSelection
from tests.selection.test_cross_validation import record


def begin(recording):
    examined = Examined(recording, 0.0, 40.0)
    stretch = examined.stretch
    return StepwiseSelection.begin([examined.judged], stretch, stretch.end, (), FAMILYWISE_ALPHA, SearchBudget())


@pytest.fixture(scope="module")
def slow():
    """The bias walks at random, and nothing depends on the velocity."""
    return begin(record(2, random_walk=3e-3))


def test_an_effect_that_only_follows_slow_noise_is_refused_and_said(slow):
    fitted = slow.refit(ac.Model.linear().add("velocity"))
    assert slow.admitted(fitted, "velocity") is None
    assert set(slow.refused) == {"velocity"}
    verdict = slow.final_verdict("no fit with it is possible")
    (note,) = [remark for remark in verdict.remarks if remark.code.startswith("validation_")]
    assert note.sentence.startswith("velocity was not added: ")
    assert note.sentence in verdict.notes


def test_a_true_effect_is_admitted():
    selection = begin(record(3, coulomb=2e-3))
    step = selection.with_next()
    assert step is not None
    assert "coulomb" in step[0].members
    assert selection.refused == {}
