"""Trial shapes that a record proposes: ripples over acceleration, waves over position, jumps of the encoder."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from accelcal.diagnosis.search.hypotheses import hypotheses_for, jump_response, jumps, ripples, waves
from accelcal.estimation.drive import run_filter
from accelcal.estimation.estimate import solve_runs
from accelcal.model import Model
from accelcal.simulation.sensor import Simulated
from tests.diagnosis.search.records import fitted


@pytest.mark.parametrize("period", [0.7, 1.3])
def test_a_ripple_over_acceleration_is_tried_at_its_period(plain: Simulated, period: float) -> None:
    motion = plain.truth.motion
    state = fitted(plain, lambda t: 0.01 * np.sin(2.0 * np.pi * motion.acceleration(t) / period))
    none, result = ripples(state)
    assert none.value == 0.0
    assert result.value == pytest.approx(period, rel=0.03)
    shapes = [item.shape["ripple"] for item in hypotheses_for(state, Model.linear()) if "ripple" in item.shape]
    assert shapes == [0.0, result.value, 0.0]  # the last is the coarse one, which has no ripple


@pytest.mark.parametrize(("period", "sharp"), [(7e-3, 1.3), (2.8e-3, 1.3), (0.0175, 1.8)])
def test_a_wave_over_position_is_tried_near_its_period(plain: Simulated, period: float, sharp: float) -> None:
    motion = plain.truth.motion  # its stroke is 0.04 m: a wave of nearly half of it is seen less sharply
    state = fitted(plain, lambda t: 0.01 * np.sin(2.0 * np.pi * motion.position(t) / period))
    near = [shape.bracket for shape in waves(state) if shape.bracket is not None]
    assert any(low < period < high and high / low < sharp for low, high in near)


@pytest.mark.parametrize("reading", [9_000, 15_001, 20_002])
def test_a_jump_of_the_encoder_is_tried_at_the_reading_behind_it(plain: Simulated, reading: int) -> None:
    position = plain.recording.position
    jumped = position.y + np.where(np.arange(len(position.t)) >= reading, 1e-5, 0.0)
    recording = dataclasses.replace(plain.recording, position=dataclasses.replace(position, y=jumped))
    state = solve_runs(Model.linear(), [recording]).states[0]
    instants = np.array([shape.value for shape in jumps(state)]) + state.run.origins.t
    assert np.any((position.t[reading - 1] < instants) & (instants < position.t[reading]))


def test_what_a_jump_leaves_in_the_innovations_is_what_the_filter_makes_of_it(plain: Simulated) -> None:
    state = fitted(plain, np.zeros_like)
    reading = 12_000
    jump = np.where(np.arange(len(state.run.t)) >= reading, 1.0, 0.0)
    before, after = (
        run_filter(state.run, dataclasses.replace(state.drive, z=state.run.z + y), state.noise) for y in (0.0, jump)
    )
    left = (after.series("e") - before.series("e"))[reading:]
    response = jump_response(state)
    np.testing.assert_allclose(response, left[: len(response)], atol=0.01)
    np.testing.assert_allclose(left[len(response) : 2 * len(response)], 0.0, atol=0.03)
