"""A fit with further effects that begins where another one came to rest."""

import numpy as np
import pytest

from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.gauss_newton import estimated
from accelcal.estimation.run_state import RunState
from accelcal.model import Model
from accelcal.simulation.sensor import CXL02_RIG, simulate


@pytest.fixture(scope="module")
def linear():
    rng = np.random.default_rng(2)
    truth = {"bias": 0.05, "quadratic": 1e-3}
    recording = simulate("interleaved", seconds=30.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording
    return solve_runs(Model.linear(), [recording])


def test_it_ends_where_a_fit_of_its_own_does_and_asks_the_filter_less_often(linear, monkeypatch):
    asked, refresh = [], RunState.refresh
    monkeypatch.setattr(RunState, "refresh", lambda state, **how: (asked.append(state), refresh(state, **how))[1])
    model = linear.model.add("quadratic")
    own = estimated(model, [RunState.begin(state.run, model, None) for state in linear.passes])
    alone = len(asked)
    grown = estimated(model, [state.grown(model) for state in linear.passes], grown=True)
    std = np.sqrt(np.diag(own.covariance))
    assert np.all(np.abs(grown.x - own.x) < 0.05 * std)  # both stop at a hundredth, the noise a little apart
    np.testing.assert_allclose(np.sqrt(np.diag(grown.covariance)), std, rtol=0.02)
    assert len(asked) - alone < alone
    assert abs(grown.x[-1] / std[-1]) > 10.0  # and there is something to find


def test_its_first_step_uses_filter_and_signals_of_the_other(linear):
    model = linear.model.add("quadratic")
    state = linear.passes[0]
    begun = state.grown(model)
    assert begun.track is state.track
    assert begun.values.by_name == {**state.values.by_name, "quadratic": 0.0}
    assert begun.normal.gram.shape == (len(model.free), len(model.free))
    np.testing.assert_array_equal(begun.normal.gram[:-1, :-1], state.normal_equations(state.terms).gram)
