"""A fit with further effects that begins at the states of another one."""

import numpy as np
import pytest

from accelcal.estimation import run_state
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.gauss_newton import ROUNDS_OF_GROWN, estimated, initial_states
from accelcal.estimation.rows import normal_equations
from accelcal.model import Model
from accelcal.simulation.sensor import CXL02_RIG, simulate


@pytest.fixture(scope="module")
def linear():
    rng = np.random.default_rng(2)
    truth = {"bias": 0.05, "quadratic": 1e-3}
    recording = simulate("interleaved", seconds=30.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording
    return solve_runs(Model.linear(), [recording])


def test_it_ends_where_a_fit_of_its_own_does_and_runs_the_filter_less_often(linear, monkeypatch):
    filtered, run_filter = [], run_state.run_filter
    monkeypatch.setattr(run_state, "run_filter", lambda run, *more: (filtered.append(run), run_filter(run, *more))[1])
    model = linear.model.add("quadratic")
    own = estimated(model, initial_states(model, [state.run for state in linear.states], [None]))
    alone = len(filtered)
    grown = estimated(model, [state.grown(model) for state in linear.states], least=ROUNDS_OF_GROWN)
    std = np.sqrt(np.diag(own.covariance))
    assert np.all(np.abs(grown.x - own.x) < 0.05 * std)  # both stop at a hundredth, the noise a little apart
    np.testing.assert_allclose(np.sqrt(np.diag(grown.covariance)), std, rtol=0.02)
    assert len(filtered) - alone < alone
    assert abs(grown.x[-1] / std[-1]) > 10.0  # and there is something to find


def test_its_first_step_uses_filter_and_signals_of_the_other(linear):
    model = linear.model.add("quadratic")
    state = linear.states[0]
    grown = state.grown(model)
    assert grown.track is state.track
    assert grown.values.by_name == {**state.values.by_name, "quadratic": 0.0}
    gram = normal_equations(grown, model.free).gram
    assert gram.shape == (len(model.free), len(model.free))
    np.testing.assert_array_equal(gram[:-1, :-1], normal_equations(state, linear.model.free).gram)
