"""A jump of the position restarts the replay: the record is then judged as if the encoder had not jumped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel, Recording
from accelcal.diagnosis.faults import Examined
from accelcal.diagnosis.noise.noise_test import POSITION_JUMPS
from accelcal.estimation.estimate import estimate
from accelcal.simulation import CXL02_RIG
from accelcal.validation import evaluation

PARAMETERS = {"bias": 0.1, "scale_factor": 0.02}
JUMP = 33.3
"""s"""


def record(seed: int, motion: str = "interleaved") -> Recording:
    rng = np.random.default_rng(seed)
    rig = replace(CXL02_RIG, offset_tolerance=0.0)
    return ac.simulate(motion, seconds=60.0, rig=rig, parameters=PARAMETERS, rng=rng).recording


def zeroed(recording: Recording, at: float = JUMP) -> Recording:
    """The encoder is set to zero once, from one reading to the next."""
    t, z = recording.position.t, recording.position.y
    first = int(np.searchsorted(t, at))
    y = np.where(np.arange(len(t)) < first, z, z - z[first] + 3e-3)
    return replace(recording, position=Channel("position", t, y, "m"))


def test_estimates_are_those_of_the_record_without_the_jump():
    """The filter loses its memory once in 60 s: a hundredth of the information, a tenth of a standard deviation."""
    plain = record(5)
    jumped = zeroed(plain)
    names = ("bias", "scale_factor", "time_offset")
    before, after = ac.fit(plain), ac.fit(jumped)
    for name in names:
        assert abs(after[name].value - before[name].value) < 0.3 * before[name].std, name
        assert after[name].std == pytest.approx(before[name].std, rel=0.05), name
    left_in = estimate(ac.Model.linear(), jumped, band=5.0)  # the twin that must fail: nobody looked for the jump
    assert any(left_in[name].std > 2.0 * before[name].std for name in names)


def test_the_jump_is_named_and_nothing_else():
    improvement = ac.improve(zeroed(record(6)))
    assert improvement.effects == (POSITION_JUMPS,)
    assert any("stays" in text for text in improvement.diagnosis.suspect)
    assert improvement.diagnosis.sizes[POSITION_JUMPS].at_encoder


def test_held_out_errors_are_those_of_the_record_without_the_jump():
    plain, model = record(7), ac.fit(record(8))
    jumped = zeroed(plain)
    before, after = ac.compare(model, plain)[0], ac.compare(model, jumped)[0]
    assert after.accel_rms == pytest.approx(before.accel_rms, rel=0.02)
    assert after.one_step_rms == pytest.approx(before.one_step_rms, rel=0.02)
    assert after.coast_rms[1.0] == pytest.approx(before.coast_rms[1.0], rel=0.1)
    left_in = evaluation.compare(model, jumped)
    assert left_in.accel_rms > 3.0 * before.accel_rms


def test_no_jump_is_found_where_there_is_none():
    """8 records at a rate of 1e-6 each; `test_change_points.py` looks at 112 more."""
    for seed in range(4):
        for motion in ("interleaved", "moves"):
            assert Examined(record(seed, motion)).source.recording.position_steps == ()


def test_two_jumps_are_both_found_at_their_first_reading():
    plain = record(9)
    position_steps = Examined(zeroed(zeroed(plain, 20.0), 41.0)).source.recording.position_steps
    t = plain.position.t
    assert [step.time for step in position_steps] == [t[np.searchsorted(t, at)] for at in (20.0, 41.0)]
    assert max(step.p_value for step in position_steps) < 1e-6
