"""A search ends at its limit of models and says so with the best answer so far; within the limit nothing changes."""

from functools import partial

import numpy as np
import pytest

import accelcal as ac
from accelcal import verbs
from accelcal.diagnosis.policy import SEARCH_MODELS
from accelcal.diagnosis.select.stepwise import SearchBudget
from accelcal.simulation import CXL02_RIG


def record(seconds=16.0, **more):
    rng = np.random.default_rng(9)
    truth = {"bias": 0.05, "quadratic": 1e-3, **more}
    return ac.simulate("interleaved", seconds=seconds, rig=CXL02_RIG, parameters=truth, rng=rng).recording


@pytest.fixture
def base_alone(monkeypatch):
    monkeypatch.setattr(verbs, "SearchBudget", partial(SearchBudget, 1))


def test_no_model_is_begun_beyond_the_limit():
    search = SearchBudget()
    assert sum(search.allows_another() for _ in range(2 * SEARCH_MODELS)) == SEARCH_MODELS - 1  # and the base model
    assert (search.models, search.stopped) == (SEARCH_MODELS, True)


def test_a_stopped_search_says_so_with_the_best_answer_so_far(request):
    recording = record()
    whole = ac.improve(recording)
    assert whole.effects == ("quadratic",)
    assert "search_stopped" not in [r.code for r in whole.diagnosis.remarks]
    request.getfixturevalue("base_alone")
    stopped = ac.improve(recording)
    assert stopped.effects == ()
    assert stopped.verdict == "unexplained"
    assert [r.code for r in stopped.diagnosis.remarks] == ["search_stopped", "not_added"]
    assert stopped.diagnosis.remarks[1].values["effect"] == "quadratic"
    # The base model is the one of the whole search.
    assert stopped.steps[0].fit.estimates == whole.steps[0].fit.estimates


def test_a_search_that_has_nothing_to_add_is_never_said_to_be_stopped(base_alone):
    improved = ac.improve(record(quadratic=0.0))
    assert (improved.verdict, improved.diagnosis.remarks) == ("adequate", ())


def test_the_verdict_of_a_search_coasts_as_that_of_a_diagnosis():
    recording = record()
    improved = ac.improve(recording, holdout=recording)
    where, alone = improved.diagnosis.where, ac.diagnose(improved.steps[-1].fit, recording).where
    assert where.coast_starts == alone.coast_starts
    assert where.coast_rms == pytest.approx(alone.coast_rms, rel=1e-6)
