"""Scores of columns of which the model contains a part."""

from __future__ import annotations

import numpy as np
import pytest

from accelcal.diagnosis.search.hypotheses import hypotheses_for
from accelcal.diagnosis.search.scores import BaseProjection, CandidateScores, score_gain
from accelcal.estimation.estimate import solve_runs
from accelcal.model import Model
from accelcal.simulation.sensor import Simulated


@pytest.mark.parametrize("text", ["velocity", "cubic"])
def test_a_column_that_the_model_contains_leaves_the_others_their_gain(plain: Simulated, text: str) -> None:
    """Of a shape's columns one is what `known` is already: nothing of it is left, and nothing else suffers."""
    model = Model.linear().add(text)
    state = solve_runs(model, [plain.recording]).states[0]
    items = [item for item in hypotheses_for(state, model) if item.effect.family and item.leading is None]
    evidence = CandidateScores([BaseProjection(state, model)], items)
    for i, item in enumerate(items):
        gain, _, estimate, covariance = evidence.gain(i)
        assert 0.0 <= gain < 80.0, item.effect.name  # of noise alone; 12 coefficients exceed it once in 1e11
        assert np.all(np.abs(estimate) < 1e9)
        assert np.all(np.abs(covariance) < 1e18)
    assert any(np.diag(evidence.G)[part].min() == 0.0 for part in evidence.columns) == (text == "velocity")


@pytest.mark.parametrize("empty", [0, 1, 4, 8])
def test_a_column_of_which_nothing_is_left_gets_no_estimate(empty: int) -> None:
    rng = np.random.default_rng(empty)
    X = rng.standard_normal((200, 9))
    A, b = X.T @ X, X.T @ rng.standard_normal(200)
    others = np.delete(np.arange(9), empty)
    expected = score_gain(A[np.ix_(others, others)], b[others])
    A[empty], A[:, empty], b[empty] = 0.0, 0.0, 0.0
    gain, dof, estimate, covariance = score_gain(A, b)
    assert (gain, dof) == (pytest.approx(expected[0], rel=1e-9), 8)
    np.testing.assert_allclose(estimate[others], expected[2], rtol=1e-9)
    assert abs(estimate[empty]) < 1e-12
    assert abs(covariance[empty, empty]) < 1e-12
