"""Trial shapes that a record proposes: the ripple of a characteristic and the wave of a rail that are in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnose.candidates import candidates_for
from accelcal.diagnose.picks import ripples, waves
from accelcal.fit import solve_runs
from accelcal.loop import add
from accelcal.model import Model
from accelcal.passes import Pass
from accelcal.recording import Array
from accelcal.simulate import Simulated

TRUTH = {"bias": 0.05, "scale_factor": 0.01}


@pytest.fixture(scope="module")
def plain() -> Simulated:
    rng = np.random.default_rng(5)
    return ac.simulate("interleaved", seconds=40.0, rig=ac.CXL02_RIG, parameters=TRUTH, rng=rng)


def fitted(run: Simulated, more: Callable[[Array], Array]) -> Pass:
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
    assert shapes == [0.0, found.value]


def test_a_wave_over_position_is_tried_near_its_period(plain: Simulated) -> None:
    motion, period = plain.truth.motion, 7e-3
    one = fitted(plain, lambda t: 0.01 * np.sin(2.0 * np.pi * motion.position(t) / period))
    near = [pick.near for pick in waves(one) if pick.near is not None]
    assert any(low < period < high and high / low < 1.3 for low, high in near)


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
