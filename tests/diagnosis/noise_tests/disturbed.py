"""Simulated records with one disturbance that leaves the mean unchanged, added to the simulated rig by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from accelcal.data.recording import Channel, Recording
from accelcal.data.rig import Rig
from accelcal.diagnosis.clean_fit import run_noise_tests
from accelcal.diagnosis.noise.noise_test import NoiseTest
from accelcal.estimation.gauss_newton import iterate
from accelcal.estimation.run import prepare
from accelcal.estimation.run_state import RunState
from accelcal.model import Model
from accelcal.simulation.sensor import Simulated, Vibration, simulate

PARAMETERS = {"bias": 0.1, "scale_factor": 0.02, "time_offset": 1e-3}
"""Parameters of every sensor here; the base model estimates all three."""


def good(motion: str, rig: Rig, seed: int, **more: object) -> Simulated:
    """A record of 60 s in which the base model is right, 10 % of the samples missing."""
    rng = np.random.default_rng(seed)
    return simulate(motion, seconds=60.0, rig=rig, parameters=PARAMETERS, rng=rng, missing=0.1, **more)


def fitted(recording: Recording) -> RunState:
    """The base model at its fixed point."""
    return iterate(Model.linear(), [prepare(recording)], [None]).states[0]


def findings(recording: Recording) -> dict[str, NoiseTest]:
    """By effect; of several lines the most significant."""
    results: dict[str, NoiseTest] = {}
    for test in run_noise_tests(fitted(recording)):
        results.setdefault(test.effect, test)
    return results


def with_output(record: Recording, y: np.ndarray) -> Recording:
    """Another output."""
    return replace(record, accel=Channel("accel", record.accel.t, y, "m/s²"))


def with_position(record: Recording, y: np.ndarray) -> Recording:
    """Another encoder."""
    return replace(record, position=Channel("position", record.position.t, y, "m"))


def vibration(motion: str, rig: Rig, seed: int) -> Recording:
    """0.2 m/s² at 230 Hz at top speed, amplitude as v² (paper II-F)."""
    return good(motion, rig, seed, vibration=Vibration(0.2, 230.0)).recording


def accelerometer_outliers(motion: str, rig: Rig, seed: int) -> Recording:
    """One output in a thousand wrong by 0.3 to 1 m/s²."""
    record, rng = good(motion, rig, seed).recording, np.random.default_rng(seed + 1000)
    n = len(record.accel)
    wrong = (rng.random(n) < 1e-3) * rng.choice([-1.0, 1.0], n) * rng.uniform(0.3, 1.0, n)
    return with_output(record, record.accel.y + wrong)


def encoder_outliers(motion: str, rig: Rig, seed: int) -> Recording:
    """One reading in a thousand wrong by 12 to 40 um."""
    record, rng = good(motion, rig, seed).recording, np.random.default_rng(seed + 1000)
    n = len(record.position)
    wrong = (rng.random(n) < 1e-3) * rng.choice([-1.0, 1.0], n) * rng.uniform(12e-6, 40e-6, n)
    return with_position(record, record.position.y + wrong)


def encoder_cyclic(motion: str, rig: Rig, seed: int, *, amplitude: float, period: float) -> Recording:
    """Encoder that errs periodically in position, before its noise and rounding."""
    s, rng = good(motion, rig, seed), np.random.default_rng(seed + 1000)
    p = s.truth.motion.position(s.recording.position.t)
    wrong = p + amplitude * np.sin(2.0 * np.pi * p / period + 0.4) + 1e-6 * rng.standard_normal(len(p))
    return with_position(s.recording, 1e-6 * np.round(wrong / 1e-6))


def hum(motion: str, rig: Rig, seed: int, *, amplitude: float, frequency: float) -> Recording:
    """A line in the sensed acceleration, behind the RC filter of 159 Hz."""
    record = good(motion, rig, seed).recording
    left = amplitude / math.sqrt(1.0 + (frequency / 159.0) ** 2)
    return with_output(record, record.accel.y + left * np.sin(2.0 * np.pi * frequency * record.accel.t + 1.0))


def coarse_converter(motion: str, rig: Rig, seed: int) -> Recording:
    """A converter of 0.1 m/s² per step."""
    return good(motion, rig, seed, lsb=0.1).recording


def jitter(motion: str, rig: Rig, seed: int, *, std: float) -> Recording:
    """Samples at other instants than their time stamps: to first order an error of jerk times jitter."""
    s, rng = good(motion, rig, seed), np.random.default_rng(seed + 1000)
    t = s.recording.accel.t
    late = PARAMETERS["time_offset"] + 1.0 / (2.0 * math.pi * 159.0)
    jerk = (s.truth.motion.acceleration(t - late + 1e-4) - s.truth.motion.acceleration(t - late - 1e-4)) / 2e-4
    slope = (1.0 + PARAMETERS["scale_factor"]) * jerk
    return with_output(s.recording, s.recording.accel.y + slope * std * rng.standard_normal(len(t)))


World = Callable[[str, Rig, int], Recording]
