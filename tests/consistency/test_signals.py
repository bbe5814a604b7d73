"""The smoothed motion is as good as its standard deviations say."""

from __future__ import annotations

import numpy as np

from accelcal.demo import TRUTH
from accelcal.fit import solve_runs
from accelcal.model import Model
from accelcal.simulate import ADXL105_RIG, simulate


def test_position_velocity_and_acceleration_scatter_as_they_say():
    made = simulate("bursts", seconds=30.0, rig=ADXL105_RIG, parameters=TRUTH, rng=np.random.default_rng(4))
    one = solve_runs(Model.linear(), [made.recording]).passes[0]
    s, true = one.signals, made.truth.motion
    assert s is not None
    t = s.t + one.run.origins.t
    inside = (t > t[0] + 1.0) & (t < t[-1] - 1.0)
    for name, found, exact, std in (
        ("p", s.p, true.position(t), s.p_std),
        ("v", s.v, true.velocity(t), s.v_std),
        ("a", s.a, true.acceleration(t), s.a_std),
    ):
        off = (found - exact)[inside]
        ratio = float(np.std(off)) / std
        print(f"scatter of {name} over what it says: {ratio:.2f} (0.75 to 1.4)")
        assert 0.75 < ratio < 1.4
