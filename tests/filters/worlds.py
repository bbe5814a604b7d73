"""Records for live filters: a simulated rig, and effects added to its output by their formulas, not the catalogue."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from accelcal.data.recording import Channel, Recording
from accelcal.data.rig import Rig, Sensor
from accelcal.filters.live_model import LiveModel
from accelcal.model import Model
from accelcal.signals.signals import Origins
from accelcal.simulation.sensor import simulate

RATE = 1667.0
NOISE = 2e-4
"""One-sided density of the sensor, (m/s²)/sqrt(Hz)."""
READING = 1e-6
"""Standard deviation of a position reading, m."""
RIG = Rig(sensor=Sensor(noise=NOISE))
TRUE = {
    "bias": 0.05,
    "scale_factor": 0.01,
    "quadratic": 1e-3,
    "temperature_bias": 2e-3,
    "rail_slope": 0.05,
    "velocity": 5e-3,
}
MODEL = Model.linear().add("quadratic", "temperature_bias", "rail_slope", "velocity").freeze(time_offset=0.0)
ORIGINS = Origins(temperature=25.0)


@dataclass(frozen=True)
class World:
    """A recording, position at every second sample of the output, and what a live filter is fed."""

    recording: Recording
    u: np.ndarray
    z: np.ndarray
    temperature: np.ndarray


def world(seed: int, *, seconds: float = 12.0, rig: Rig = RIG) -> World:
    """Bursts of 5 m/s² rms; temperature swings by 3 K."""
    given = {name: TRUE[name] for name in ("bias", "scale_factor", "quadratic")}
    rng = np.random.default_rng(seed)
    simulation = simulate(
        "bursts", seconds=seconds, rig=rig, parameters=given, rng=rng, a_rms=5.0, position_noise=READING
    )
    t = simulation.recording.accel.t
    p, v, _, _ = simulation.truth.motion.derivatives(t)
    temperature = 25.0 + 3.0 * np.sin(0.9 * t + seed)
    u = simulation.recording.accel.y + TRUE["temperature_bias"] * (temperature - 25.0)
    u += rig.polarity * (TRUE["rail_slope"] * p + TRUE["velocity"] * v)
    z = np.full(len(t), np.nan)
    z[::2] = simulation.recording.position.y
    recording = replace(
        simulation.recording,
        accel=Channel("accel", t, u, "m/s²"),
        side={"temperature": Channel("temperature", t, temperature, "degC")},
    )
    return World(recording, u, z, temperature)


def followed(model: Model, truth: World, *, rig: Rig = RIG) -> LiveModel:
    """The live filter at the end of a record."""
    live = LiveModel(
        model,
        rig,
        rate=RATE,
        q=NOISE**2 / 2,
        r_position=READING**2,
        position=float(truth.z[0]),
        origins=ORIGINS,
    )
    live.run(truth.u, truth.z, temperature=truth.temperature)
    return live
