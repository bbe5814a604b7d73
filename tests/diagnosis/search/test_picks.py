"""Trial shapes: the ripple of a characteristic and the wave of a rail that are in a record, and how fine a curve is."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.arrays import Array
from accelcal.diagnosis.search.beam import Robust
from accelcal.diagnosis.search.hypotheses import Hypothesis, candidates_for
from accelcal.diagnosis.search.initial_shapes import after_jump, jumps, ripples, waves
from accelcal.diagnosis.search.likelihood_gain import score_gain
from accelcal.diagnosis.search.refine import between_trials
from accelcal.diagnosis.search.scan import scan
from accelcal.diagnosis.search.scores import BaseProjection, CandidateScores
from accelcal.effects import find
from accelcal.estimation.drive import run_filter
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.run_state import RunState
from accelcal.model import Model
from accelcal.simulation.sensor import Simulated
from accelcal.workflow import add, diagnose
from tests.worlds import Hidden, World, at_d

INNER = {f"shape_of_position.s{j}" for j in range(3, 9)}
TRUTH = {"bias": 0.05, "scale_factor": 0.01}


@pytest.fixture(scope="module")
def plain() -> Simulated:
    rng = np.random.default_rng(5)
    return ac.simulate("interleaved", seconds=40.0, rig=ac.CXL02_RIG, parameters=TRUTH, rng=rng)


def fitted(run: Simulated, more: Callable[[Array], Array]) -> RunState:
    """The base fitted to a recording with a contribution to its output, a function of the times of its samples."""
    accel = run.recording.accel
    return solve_runs(
        Model.linear(),
        [dataclasses.replace(run.recording, accel=dataclasses.replace(accel, y=accel.y + more(accel.t)))],
    ).passes[0]


@pytest.mark.parametrize("period", [0.7, 1.3])
def test_a_ripple_over_acceleration_is_tried_at_its_period(plain: Simulated, period: float) -> None:
    motion = plain.truth.motion
    one = fitted(plain, lambda t: 0.01 * np.sin(2.0 * np.pi * motion.acceleration(t) / period))
    none, found = ripples(one)
    assert none.value == 0.0
    assert found.value == pytest.approx(period, rel=0.03)
    shapes = [item.shape["ripple"] for item in candidates_for(one, Model.linear()) if "ripple" in item.shape]
    assert shapes == [0.0, found.value, 0.0]  # the last is the coarse one, which has no ripple


@pytest.mark.parametrize(("period", "sharp"), [(7e-3, 1.3), (2.8e-3, 1.3), (0.0175, 1.8)])
def test_a_wave_over_position_is_tried_near_its_period(plain: Simulated, period: float, sharp: float) -> None:
    motion = plain.truth.motion  # its stroke is 0.04 m: a wave of nearly half of it is seen less sharply
    one = fitted(plain, lambda t: 0.01 * np.sin(2.0 * np.pi * motion.position(t) / period))
    near = [pick.near for pick in waves(one) if pick.near is not None]
    assert any(low < period < high and high / low < sharp for low, high in near)


@pytest.mark.parametrize("reading", [9_000, 15_001, 20_002])
def test_a_jump_of_the_encoder_is_tried_at_the_reading_behind_it(plain: Simulated, reading: int) -> None:
    position = plain.recording.position
    jumped = position.y + np.where(np.arange(len(position.t)) >= reading, 1e-5, 0.0)
    recording = dataclasses.replace(plain.recording, position=dataclasses.replace(position, y=jumped))
    one = solve_runs(Model.linear(), [recording]).passes[0]
    instants = np.array([pick.value for pick in jumps(one)]) + one.run.origins.t
    assert np.any((position.t[reading - 1] < instants) & (instants < position.t[reading]))


def test_what_a_jump_leaves_in_the_innovations_is_what_the_filter_makes_of_it(plain: Simulated) -> None:
    one = fitted(plain, np.zeros_like)
    reading = 12_000
    jump = np.where(np.arange(len(one.run.t)) >= reading, 1.0, 0.0)
    before, after = (
        run_filter(one.run, dataclasses.replace(one.drive, z=one.run.z + y), one.noise) for y in (0.0, jump)
    )
    left = (after.series("e") - before.series("e"))[reading:]
    response = after_jump(one)
    np.testing.assert_allclose(response, left[: len(response)], atol=0.01)
    np.testing.assert_allclose(left[len(response) : 2 * len(response)], 0.0, atol=0.03)


def test_the_scatter_of_a_few_blocks_is_not_believed_over_the_noise_of_the_model() -> None:
    rng = np.random.default_rng(11)
    rows, length = 40_000, 200
    everywhere, once = rng.standard_normal(rows), np.where(np.arange(rows) // length == 60, 1.0, 0.0)
    loud = np.sqrt(1.0 + 3.0 * (np.arange(rows) // length % 2))  # noise of twice the size in every other block

    class Rows:
        """What `Robust` asks of the evidence: two columns and noise that is louder than the model says."""

        G = np.diag([float(everywhere @ everywhere), float(once @ once)])
        c = np.zeros(2)
        columns = (slice(0, 1), slice(1, 2))
        items = tuple(Hypothesis(find(name), {}) for name in ("quadratic", "cubic"))

        def rows(self) -> list[tuple[Array, Array, Array]]:
            return [(np.arange(rows) / length, loud * rng.standard_normal(rows), np.stack([everywhere, once]))]

        def gain(self, i: int, chosen: tuple[int, ...] = ()) -> tuple[float, int, Array, Array]:
            return 0.0, 1, np.ones(1), np.ones((1, 1))

    inflations = np.array([[Robust(Rows(), 1.0).inflation(i, ()) for i in (0, 1)] for _ in range(20)])
    assert np.all(np.abs(inflations[:, 0] - 2.5) < 1.0)
    assert np.all(inflations[:, 1] < 2.0)
    assert inflations[:, 1].mean() < 1.4


def test_what_hardly_entered_is_told_with_what_nearly_did(plain: Simulated) -> None:
    motion = plain.truth.motion
    weak, strong = (
        next(one for one in scan([fitted(plain, more)], Model.linear()).candidates if one.effect == "cubic")
        for more in (lambda t: 5e-5 * motion.acceleration(t) ** 3, lambda t: 1.5e-4 * motion.acceleration(t) ** 3)
    )
    print(f"log evidence {weak.log_evidence:.1f}: {weak.members}; {strong.log_evidence:.1f}: {strong.members}")
    assert 0.0 < weak.log_evidence < 6.0 < strong.log_evidence
    assert len(weak.members) > len(strong.members)


def test_a_step_between_two_trials_is_not_left_to_a_smooth_rival(tmp_path: Path) -> None:
    world = at_d(World("long_rest", "ADXL105", (Hidden("scale_step", -0.02, {"instant": 30.42}),), seed=9), 30.0)
    one = solve_runs(Model.linear(), [ac.load(world.record().write(tmp_path))]).passes[0]
    found = scan([one], Model.linear())
    assert [f.effect for f in found.found] == ["scale_step"]
    assert found.found[0].shape["instant"] + one.run.origins.t == pytest.approx(30.42, abs=0.3)


def test_what_lies_between_two_trials_is_looked_at_where_it_may_come_first(plain: Simulated) -> None:
    one = fitted(plain, lambda t: np.where(t > 17.0, 2e-4, 0.0))
    items = [item for item in candidates_for(one, Model.linear()) if item.effect.name in ("bias_step", "warm_up")]
    evidence = CandidateScores([BaseProjection(one, Model.linear())], items)
    between = between_trials(evidence, "bias_step", 0.5 * max(evidence.gain(i)[0] for i in range(len(items))))
    known = sorted(item.shape["instant"] for item in items if "instant" in item.shape)
    assert between
    for item in between:
        low, high = item.near["instant"]
        assert known[known.index(low) + 1] == high
        assert item.shape["instant"] == pytest.approx(0.5 * (low + high))
    assert between_trials(evidence, "bias_step", math.inf) == []


def test_a_second_wave_is_sought_beside_a_first_one_only(plain: Simulated) -> None:
    one = fitted(plain, np.zeros_like)
    held = Model.linear().add("rail_wave", shapes={"rail_wave": {"period": 0.03}})
    assert "rail_second_wave" not in {item.effect.name for item in candidates_for(one, Model.linear())}
    assert "rail_second_wave" in {item.effect.name for item in candidates_for(one, held)}
    with pytest.raises(ValueError, match="add that first"):
        add(ac.fit(Model.linear(), plain.recording), plain.recording, "rail_second_wave")


def test_a_course_of_time_beside_a_bias_that_wanders_has_been_looked_for_more_often(plain: Simulated) -> None:
    one = fitted(plain, np.zeros_like)
    wandering = Model.linear().add("bias_random_walk", shapes={"bias_random_walk": {"start": 0.0, "length": 40.0}})
    for name, more in (("bias_step", 100), ("warm_up", 100), ("cubic", 1)):
        alone, beside = (
            next(item.looks for item in candidates_for(one, model) if item.effect.name == name)
            for model in (Model.linear(), wandering)
        )
        assert (alone, beside) == (1, more)


@pytest.mark.parametrize(
    ("hidden", "coarse"),
    [
        (lambda p: 20.0 * p**2, True),
        (lambda p: 20.0 * p**3, True),
        (lambda p: 0.01 * np.sin(2.0 * np.pi * p / 0.02), False),
    ],
    ids=["square", "cube", "wave"],
)
def test_a_curve_is_as_fine_as_the_record_pays_for(
    plain: Simulated, hidden: Callable[[Array], Array], coarse: bool
) -> None:
    one = fitted(plain, lambda t: hidden(plain.truth.motion.position(t)))
    (found,) = scan([one], Model.linear(), only=(find("shape_of_position"),)).entered
    assert (set(found.fixed) >= INNER) == coarse


def test_a_coarse_curve_is_the_beginning_of_the_fine_one_and_costs_no_column(plain: Simulated) -> None:
    one = fitted(plain, np.zeros_like)
    offered = [item for item in candidates_for(one, Model.linear()) if item.effect.name == "shape_of_position"]
    fine, coarse = offered
    runs = [BaseProjection(one, Model.linear())]
    both, alone = CandidateScores(runs, [coarse, fine]), CandidateScores(runs, [coarse])
    assert [part.stop - part.start for part in both.columns] == [3, 9]
    assert (len(both.terms), len(alone.terms)) == (9, 3)
    assert both.gain(0)[:2] == pytest.approx(alone.gain(0)[:2], rel=1e-9)


def test_a_coarse_curve_in_a_model_may_become_fine(plain: Simulated) -> None:
    one = fitted(plain, lambda t: 0.01 * np.sin(300.0 * plain.truth.motion.position(t)))
    run, s = one.run.recording, one.signals
    assert s is not None
    ends = {"shape_of_position": {"low": float(np.min(s.p)), "high": float(np.max(s.p))}}
    coarse = ac.fit(Model.linear().add("shape_of_position", shapes=ends).freeze(**dict.fromkeys(INNER, 0.0)), run)
    missing = diagnose(coarse, run)
    assert "shape_of_position" in missing.effects or "rail_wave" in missing.effects
    fine = add(coarse, run, "shape_of_position")
    assert len(fine.free) >= len(coarse.free) + len(INNER) - 1
    assert fine.log_likelihood > coarse.log_likelihood + 100.0
    with pytest.raises(ValueError, match="already in the model"):
        add(fine, run, "shape_of_position")


@pytest.mark.parametrize("known", ["velocity", "cubic"])
def test_a_column_that_the_model_contains_leaves_the_others_their_gain(plain: Simulated, known: str) -> None:
    """Of a shape's columns one is what `known` is already: nothing of it is left, and nothing else suffers."""
    model = Model.linear().add(known)
    one = solve_runs(model, [plain.recording]).passes[0]
    items = [item for item in candidates_for(one, model) if item.effect.family and item.leading is None]
    evidence = CandidateScores([BaseProjection(one, model)], items)
    for i, item in enumerate(items):
        gain, _, estimate, covariance = evidence.gain(i)
        assert 0.0 <= gain < 80.0, item.effect.name  # of noise alone; 12 coefficients exceed it once in 1e11
        assert np.all(np.abs(estimate) < 1e9)
        assert np.all(np.abs(covariance) < 1e18)
    assert any(np.diag(evidence.G)[part].min() == 0.0 for part in evidence.columns) == (known == "velocity")


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
