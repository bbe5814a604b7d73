"""Beam search: scatter of scores, rivals of a weak effect, shapes between two trials."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.arrays import Array
from accelcal.diagnosis.search.beam import BlockScatter
from accelcal.diagnosis.search.hypotheses import Hypothesis, hypotheses_for
from accelcal.diagnosis.search.refine import between_trials
from accelcal.diagnosis.search.scan import scan
from accelcal.diagnosis.search.scores import BaseProjection, CandidateScores
from accelcal.effects import find
from accelcal.estimation.estimate import solve_runs
from accelcal.model import Model
from accelcal.simulation.sensor import Simulated
from tests.diagnosis.search.records import fitted
from tests.worlds import Hidden, World, at_d


def test_the_scatter_of_a_few_blocks_is_shrunk_to_the_noise_of_the_model() -> None:
    rng = np.random.default_rng(11)
    rows, length = 40_000, 200
    everywhere, once = rng.standard_normal(rows), np.where(np.arange(rows) // length == 60, 1.0, 0.0)
    noise_level = np.sqrt(1.0 + 3.0 * (np.arange(rows) // length % 2))  # noise of twice the size in every other block

    class Rows:
        """What `BlockScatter` reads of the scores: two columns, and more noise than the model predicts."""

        G = np.diag([float(everywhere @ everywhere), float(once @ once)])
        c = np.zeros(2)
        columns = (slice(0, 1), slice(1, 2))
        items = tuple(Hypothesis(find(name), {}) for name in ("quadratic", "cubic"))

        def rows(self) -> list[tuple[Array, Array, Array]]:
            return [(np.arange(rows) / length, noise_level * rng.standard_normal(rows), np.stack([everywhere, once]))]

        def gain(self, i: int, chosen: tuple[int, ...] = ()) -> tuple[float, int, Array, Array]:
            return 0.0, 1, np.ones(1), np.ones((1, 1))

    inflations = np.array([[BlockScatter(Rows(), 1.0).inflation(i, ()) for i in (0, 1)] for _ in range(20)])
    assert np.all(np.abs(inflations[:, 0] - 2.5) < 1.0)
    assert np.all(inflations[:, 1] < 2.0)
    assert inflations[:, 1].mean() < 1.4


def test_the_rivals_of_an_effect_of_little_evidence_have_more_weight(plain: Simulated) -> None:
    motion = plain.truth.motion
    weak, strong = (
        next(
            candidate
            for candidate in scan([fitted(plain, more)], Model.linear()).candidates
            if candidate.effect == "cubic"
        )
        for more in (lambda t: 5e-5 * motion.acceleration(t) ** 3, lambda t: 1.5e-4 * motion.acceleration(t) ** 3)
    )
    print(f"log evidence {weak.log_evidence:.1f}: {weak.weights}; {strong.log_evidence:.1f}: {strong.weights}")
    assert 0.0 < weak.log_evidence < 6.0 < strong.log_evidence
    assert 0.2 < weak.weights["cubic"].by_record < 0.9 < strong.weights["cubic"].by_record


def test_a_step_between_two_trials_does_not_lose_to_a_smooth_rival(tmp_path: Path) -> None:
    world = at_d(World("long_rest", "ADXL105", (Hidden("scale_step", -0.02, {"instant": 30.42}),), seed=9), 30.0)
    state = solve_runs(Model.linear(), [ac.load(world.record().write(tmp_path))]).states[0]
    found = scan([state], Model.linear())
    assert [f.effect for f in found.found] == ["scale_step"]
    assert found.found[0].shape["instant"] + state.run.origins.t == pytest.approx(30.42, abs=0.3)


def test_shapes_between_two_trials_are_tried_where_they_may_come_first(plain: Simulated) -> None:
    state = fitted(plain, lambda t: np.where(t > 17.0, 2e-4, 0.0))
    items = [item for item in hypotheses_for(state, Model.linear()) if item.effect.name in ("bias_step", "warm_up")]
    evidence = CandidateScores([BaseProjection(state, Model.linear())], items)
    between = between_trials(evidence, "bias_step", 0.5 * max(evidence.gain(i)[0] for i in range(len(items))))
    known = sorted(item.shape["instant"] for item in items if "instant" in item.shape)
    assert between
    for item in between:
        low, high = item.brackets["instant"]
        assert known[known.index(low) + 1] == high
        assert item.shape["instant"] == pytest.approx(0.5 * (low + high))
    assert between_trials(evidence, "bias_step", math.inf) == []
