"""Parts of a recording: nothing is invented, and what is cut is bridged without harm."""

import numpy as np
import pytest

import accelcal as ac
from accelcal.estimation.estimate import solve_runs
from accelcal.simulation import CXL02_RIG

TRUTH = {"bias": 0.05, "scale_factor": 0.01}


@pytest.fixture(scope="module")
def whole():
    simulation = ac.simulate("interleaved", seconds=40.0, rig=CXL02_RIG, parameters=TRUTH, rng=np.random.default_rng(5))
    return simulation.recording


def test_part_and_the_rest_are_the_whole(whole):
    part, rest = whole.part(10.0, 20.0), whole.without((10.0, 20.0))
    for name in ("accel", "position"):
        inside, outside, all_of_it = (getattr(r, name) for r in (part, rest, whole))
        order = np.argsort(np.concatenate([inside.t, outside.t]))
        np.testing.assert_array_equal(np.concatenate([inside.t, outside.t])[order], all_of_it.t)
        np.testing.assert_array_equal(np.concatenate([inside.y, outside.y])[order], all_of_it.y)
        assert inside.t[0] >= 10.0
        assert inside.t[-1] <= 20.0
    assert len({whole.digest, part.digest, rest.digest}) == 3
    assert whole.part(10.0, 20.0).digest == part.digest


def test_nothing_left_is_refused(whole):
    with pytest.raises(ac.RecordingError, match="nothing is left"):
        whole.without((-1.0, 100.0))
    with pytest.raises(ac.RecordingError, match="nothing is left"):
        whole.part(50.0, 60.0)
    with pytest.raises(ac.RecordingError, match="give start before end"):
        whole.part(20.0, 10.0)


def test_smoothed_motion_stays_within_the_travel_across_a_hole(whole):
    cut = whole.without((12.0, 22.0))
    state = solve_runs(ac.Model.linear(), [cut]).states[0]
    travel = np.ptp(whole.position.y)
    assert np.ptp(state.signals.p) < 1.01 * travel  # an integral through 10 s of hole leaves it by metres
    inside = (state.signals.t > 12.1) & (state.signals.t < 21.9)
    assert inside.any()
    bend = np.diff(state.signals.p[inside], 2)
    assert np.abs(bend).max() < 1e-9  # a straight line, m; the motion itself bends by 1e-6 a step


def test_a_held_parameter_is_released():
    model = ac.Model.cubic().freeze(bias=0.1, cubic=0.0)
    assert dict(model.release("bias").fixed) == {"cubic": 0.0}
    with pytest.raises(ValueError, match="'quadratic' is not held; held are bias, cubic"):
        model.release("quadratic")
