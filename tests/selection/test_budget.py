"""A search ends within its budget and says so with the best answer so far; within the budget nothing changes."""

import dataclasses
import itertools

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.policy import SEARCH_MODELS, SEARCH_SECONDS
from accelcal.diagnosis.select import stepwise
from accelcal.diagnosis.select.stepwise import MARGIN, SearchBudget
from accelcal.simulation import CXL02_RIG


def record(seconds=16.0, **more):
    rng = np.random.default_rng(9)
    truth = {"bias": 0.05, "quadratic": 1e-3, **more}
    return ac.simulate("interleaved", seconds=seconds, rig=CXL02_RIG, parameters=truth, rng=rng).recording


@pytest.fixture
def no_time(monkeypatch):
    monkeypatch.setattr(stepwise, "SEARCH_SECONDS", 0.0)
    monkeypatch.setattr(stepwise, "SEARCH_MODELS", 0)


def test_no_model_is_begun_that_would_exceed_the_budget():
    ticks = itertools.chain([0.0, 2.0, 4.0, 9.0, 11.9, 12.0])
    search = SearchBudget(15.0, clock=lambda: next(ticks))
    assert search.allows_another()  # 2 s of the base model: 2 + 3 s
    assert search.allows_another()
    assert not search.allows_another()  # 5 s for the last one: 9 + 7.5 s
    assert not search.allows_another()  # and none after that
    assert (search.models, search.stopped, search.longest) == (3, True, 5.0)
    assert MARGIN >= 1.0


def test_there_is_time_for_some_models_however_dear_they_are():
    ticks = itertools.chain([0.0, 20.0, 41.0, 65.0, 70.0])
    search = SearchBudget(22.0, clock=lambda: next(ticks))
    assert search.allows_another()  # the base model took 20 s: five of those
    assert search.seconds == SEARCH_MODELS * 20.0
    assert search.allows_another()
    assert not search.allows_another()  # 24 s for the last one: 65 + 36 s
    assert (search.models, search.seconds) == (3, 100.0)


def test_the_budget_grows_with_length_and_samples_together():
    made = record()
    assert SearchBudget.of([made]).seconds == SEARCH_SECONDS
    accel = made.accel

    def of(samples, span):
        t = np.linspace(0.0, span, samples)
        return dataclasses.replace(made, accel=dataclasses.replace(accel, t=t, y=np.zeros(samples)))

    assert SearchBudget.of([of(400_000, 60.0)]).seconds == SEARCH_SECONDS
    assert SearchBudget.of([of(10_000, 6000.0)]).seconds == SEARCH_SECONDS
    assert SearchBudget.of([of(400_000, 180.0)]).seconds == pytest.approx(3.0 * SEARCH_SECONDS)


def test_a_stopped_search_says_so_with_the_best_answer_so_far(request):
    made = record()
    whole = ac.improve(made)
    assert whole.effects == ("quadratic",)
    assert "search_stopped" not in [r.code for r in whole.diagnosis.remarks]
    request.getfixturevalue("no_time")
    stopped = ac.improve(made)
    assert stopped.effects == ()
    assert stopped.verdict == "unexplained"
    assert [r.code for r in stopped.diagnosis.remarks] == ["search_stopped", "not_added"]
    assert stopped.diagnosis.remarks[1].values["effect"] == "quadratic"
    # The base model is the one of the whole search.
    assert stopped.steps[0].fit.estimates == whole.steps[0].fit.estimates


def test_a_search_that_has_nothing_to_add_is_never_said_to_be_stopped(no_time):
    found = ac.improve(record(quadratic=0.0))
    assert (found.verdict, found.diagnosis.remarks) == ("adequate", ())
