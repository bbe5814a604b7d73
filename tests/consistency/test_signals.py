"""The smoothed motion is as good as its standard deviations say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from accelcal.demo import TRUTH
from accelcal.estimation.estimate import estimate, solve_runs
from accelcal.model import Model
from accelcal.simulation.sensor import ADXL105_RIG, simulate


def test_position_velocity_and_acceleration_scatter_as_they_say():
    simulation = simulate("bursts", seconds=30.0, rig=ADXL105_RIG, parameters=TRUTH, rng=np.random.default_rng(4))
    state = solve_runs(Model.linear(), [simulation.recording]).states[0]
    s, true = state.signals, simulation.truth.motion
    t = s.t + state.run.origins.t
    inside = (t > t[0] + 1.0) & (t < t[-1] - 1.0)
    for name, result, exact, std in (
        ("p", s.p, true.position(t), s.p_std),
        ("v", s.v, true.velocity(t), s.v_std),
        ("a", s.a, true.acceleration(t), s.a_std),
    ):
        off = (result - exact)[inside]
        ratio = float(np.std(off)) / std
        print(f"scatter of {name} over what it says: {ratio:.2f} (0.75 to 1.4)")
        assert 0.75 < ratio < 1.4


@pytest.mark.parametrize("channels", [("accel", "position"), ("accel",)])
@pytest.mark.parametrize("hole", [0.05, 0.5, 1.0])
def test_nothing_leaks_from_a_hole_into_the_velocity_beside_it(hole, channels):
    simulation = simulate("bursts", seconds=15.0, rig=ADXL105_RIG, parameters=TRUTH, rng=np.random.default_rng(4))
    begin, end = 7.0, 7.0 + hole
    cut = {}
    for name in channels:
        channel = getattr(simulation.recording, name)
        remaining = (channel.t < begin) | (channel.t > end)
        cut[name] = replace(channel, t=channel.t[remaining], y=channel.y[remaining])
    state = solve_runs(Model.linear(), [replace(simulation.recording, **cut)]).states[0]
    s = state.signals
    t = s.t + state.run.origins.t
    off = np.abs(s.v - simulation.truth.motion.velocity(t)) / s.v_std
    beside = ((t > begin - 0.2) & (t < begin - 0.01)) | ((t > end + 0.01) & (t < end + 0.2))
    most = float(np.max(off[beside]))
    print(f"a hole of {hole} s in {' and '.join(channels)}: {most:.1f} standard deviations beside it (12)")
    assert most < 12.0


def test_a_record_that_breaks_off_every_second_is_fitted():
    simulation = simulate("bursts", seconds=15.0, rig=ADXL105_RIG, parameters=TRUTH, rng=np.random.default_rng(4))
    cut = {}
    for name in ("accel", "position"):
        channel = getattr(simulation.recording, name)
        remaining = channel.t % 1.0 > 0.15
        cut[name] = replace(channel, t=channel.t[remaining], y=channel.y[remaining])
    fit = estimate(Model.linear(), replace(simulation.recording, **cut))
    assert abs(fit["scale_factor"].value - TRUTH["scale_factor"]) < 4.5 * fit["scale_factor"].std
