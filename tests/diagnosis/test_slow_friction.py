"""Friction on a slow motion is named, though its column comes from a motion that it spoils."""

from __future__ import annotations

import numpy as np

import accelcal as ac
from accelcal.data.rig import STANDARD_GRAVITY, Rig, Sensor

DENSITY = 100e-6 * STANDARD_GRAVITY


def slow_record(friction: float, seconds: float = 30.0) -> ac.Recording:
    """A vertical axis in three slow tones, with friction (m/s²) in the output."""
    rng, t = np.random.default_rng([1, 34]), np.arange(0.0, seconds, 1e-3)
    size, w = np.array([0.2, 0.1, 0.02]), 2.0 * np.pi * np.array([0.11, 0.23, 0.61])
    x = np.outer(w, t) + rng.uniform(0.0, 2.0 * np.pi, (3, 1))
    p, v, a = size @ np.sin(x), (size * w) @ np.cos(x), -(size * w**2) @ np.sin(x)
    u = 0.05 + 1.01 * (a + STANDARD_GRAVITY) + friction * np.sign(v)
    u = u + DENSITY * np.sqrt(500.0) * rng.standard_normal(len(t))
    z = np.round((p + 1e-6 * rng.standard_normal(len(t))) / 1e-6) * 1e-6
    rig = Rig(sensor=Sensor(noise=DENSITY), axis="up", resolution=1e-6)
    return ac.Recording.from_arrays(t, u, z, units={"accel": "m/s^2", "position": "m"}, rig=rig, name="run.csv")


def test_friction_on_a_slow_motion_is_named_and_is_no_tilt():
    record = slow_record(0.03)
    diagnosis = ac.diagnose(ac.fit(record), record)
    assert diagnosis.effects == ("coulomb",)
    assert "turning_sensor" not in {remark.code for remark in diagnosis.remarks}
