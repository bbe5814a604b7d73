"""Hypotheses: what is offered to a model, what it pays for, and how fine a curve is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from accelcal.data.arrays import Array
from accelcal.data.recording import Reference
from accelcal.diagnosis.search.hypotheses import hypotheses_for
from accelcal.diagnosis.search.scan import scan
from accelcal.diagnosis.search.scores import BaseProjection, CandidateScores
from accelcal.effects import find
from accelcal.estimation.estimate import estimate, solve_runs
from accelcal.model import Model
from accelcal.simulation import CXL02_RIG
from accelcal.simulation.sensor import Simulated, simulate
from accelcal.verbs import add, diagnose
from tests.diagnosis.search.records import fitted

INNER = {f"shape_of_position.s{j}" for j in range(3, 9)}


def test_a_second_wave_is_offered_next_to_a_first_one_only(plain: Simulated) -> None:
    state = fitted(plain, np.zeros_like)
    held = Model.linear().add("rail_wave", shapes={"rail_wave": {"period": 0.03}})
    assert "rail_second_wave" not in {item.effect.name for item in hypotheses_for(state, Model.linear())}
    assert "rail_second_wave" in {item.effect.name for item in hypotheses_for(state, held)}
    with pytest.raises(ValueError, match="add that first"):
        add(estimate(Model.linear(), plain.recording), plain.recording, "rail_second_wave")


@pytest.mark.parametrize(("reference", "order"), [("position", 2), ("velocity", 1), ("reference_acceleration", 0)])
def test_errors_of_a_position_are_offered_where_one_is_read(plain: Simulated, reference: Reference, order: int) -> None:
    """A lag is that of any reference, and what users wrote themselves is offered to them."""
    simulated = simulate(
        "moves",
        seconds=20.0,
        rig=CXL02_RIG,
        parameters={"bias": 0.05, "scale_factor": 0.01},
        reference=reference,
        rng=np.random.default_rng(7),
    )
    state = solve_runs(Model.linear(), [simulated.recording]).states[0]
    assert state.run.order == order
    changed = replace(find("encoder_cyclic"), name="own_cyclic")
    offered = {item.effect.name for item in hypotheses_for(state, Model.linear(), [changed])}
    of_encoder = {"encoder_cyclic", "encoder_backlash", "encoder_nonlinearity", "encoder_step"}
    assert of_encoder & offered == (of_encoder if reference == "position" else set())
    assert {"encoder_lag", "own_cyclic", "quadratic"} <= offered
    with_position = hypotheses_for(state, Model.linear(), others=[fitted(plain, np.zeros_like)])
    assert of_encoder <= {item.effect.name for item in with_position}
    if reference != "position":
        with pytest.raises(ValueError, match="an error of a position as it is read"):
            add(estimate(Model.linear(), simulated.recording), simulated.recording, "encoder_cyclic")


def test_a_function_of_time_pays_for_more_comparisons_next_to_a_random_process(plain: Simulated) -> None:
    state = fitted(plain, np.zeros_like)
    random_process = Model.linear().add("bias_random_walk", shapes={"bias_random_walk": {"start": 0.0, "length": 40.0}})
    columns = sum(term.effect.name == "bias_random_walk" for term in random_process.terms)
    for name, more in (("bias_step", columns), ("warm_up", columns), ("cubic", 1)):
        alone, beside = (
            next(item.comparisons for item in hypotheses_for(state, model) if item.effect.name == name)
            for model in (Model.linear(), random_process)
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
def test_a_curve_is_as_fine_as_the_record_requires(
    plain: Simulated, hidden: Callable[[Array], Array], coarse: bool
) -> None:
    state = fitted(plain, lambda t: hidden(plain.truth.motion.position(t)))
    (result,) = scan([state], Model.linear(), only=(find("shape_of_position"),)).entered
    assert (set(result.fixed) >= INNER) == coarse


def test_a_coarse_curve_is_the_beginning_of_the_fine_one_and_costs_no_column(plain: Simulated) -> None:
    state = fitted(plain, np.zeros_like)
    offered = [item for item in hypotheses_for(state, Model.linear()) if item.effect.name == "shape_of_position"]
    fine, local, coarse = offered
    assert local.shape["width"] > 0.0
    runs = [BaseProjection(state, Model.linear())]
    both, alone = CandidateScores(runs, [coarse, fine]), CandidateScores(runs, [coarse])
    assert [part.stop - part.start for part in both.columns] == [3, 9]
    assert (len(both.terms), len(alone.terms)) == (9, 3)
    assert both.gain(0)[:2] == pytest.approx(alone.gain(0)[:2], rel=1e-9)


def test_a_coarse_curve_in_a_model_may_become_fine(plain: Simulated) -> None:
    state = fitted(plain, lambda t: 0.01 * np.sin(300.0 * plain.truth.motion.position(t)))
    run, s = state.run.recording, state.signals
    ends = {"shape_of_position": {"low": float(np.min(s.p)), "high": float(np.max(s.p))}}
    coarse = estimate(Model.linear().add("shape_of_position", shapes=ends).freeze(**dict.fromkeys(INNER, 0.0)), run)
    missing = diagnose(coarse, run)
    assert "shape_of_position" in missing.effects or "rail_wave" in missing.effects
    fine = add(coarse, run, "time_offset", "shape_of_position")  # of the base, passed over beside others alone
    assert len(fine.free) >= len(coarse.free) + len(INNER) - 1
    assert fine.log_likelihood > coarse.log_likelihood + 100.0
    with pytest.raises(ValueError, match="already in the model"):
        add(fine, run, "shape_of_position")
    with pytest.raises(ValueError, match="already in the model"):
        add(coarse, run, "time_offset")
