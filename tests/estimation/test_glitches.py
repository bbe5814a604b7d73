"""Glitches of the encoder are left out; a transient that the output saw is motion, however rare."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.arrays import Array
from accelcal.data.recording import Channel
from accelcal.diagnosis.faults import examine
from accelcal.estimation.readings import spikes
from accelcal.simulation import ADXL105_RIG

RATE = 50.0
GROUND_NOISE = 1e-8
"""Motion of the ground before an earthquake, m."""


def burst(x: Array, f: float) -> Array:
    """Position `x` s after the onset of a decaying oscillation, (n,) m."""
    y = np.maximum(x, 0.0)
    return np.asarray(1e-3 * y**3 * np.exp(-6.0 * y) * np.sin(2.0 * np.pi * f * y))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("delay", [0.0, 0.0075])
def test_the_onset_of_an_earthquake_is_no_glitch(seed: int, delay: float) -> None:
    rng = np.random.default_rng(seed)
    t: Array = np.arange(0.0, 300.0, 1.0 / RATE)
    f, onset = rng.uniform(3.0, 9.0), rng.uniform(150.0, 151.0)
    position = burst(t - onset, f) + GROUND_NOISE * rng.standard_normal(len(t))
    fine: Array = np.arange(0.0, 300.0, 1e-3)
    acceleration = np.gradient(np.gradient(burst(fine - onset - delay, f), 1e-3), 1e-3)
    output = Channel("accel", t, np.interp(t, fine, acceleration) + 1e-6 * rng.standard_normal(len(t)), "m/s^2")
    blind = Channel("accel", t, 1e-6 * rng.standard_normal(len(t)), "m/s^2")
    assert not spikes(t, position, output).any()
    assert spikes(t, position, blind).any()  # the twin: the same readings, which the output did not see


@pytest.mark.parametrize("length", [1, 2, 5, 20, 60])
@pytest.mark.parametrize("seed", range(3))
def test_a_glitch_is_found_in_motion(length: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rate = 1667.0
    t: Array = np.arange(0.0, 12.0, 1.0 / rate)
    f, phase = rng.uniform(1.0, 20.0, 5), rng.uniform(0.0, 2.0 * np.pi, 5)
    a = rng.uniform(1.0, 5.0, 5)
    angle = 2.0 * np.pi * np.outer(f, t) + phase[:, None]
    output = Channel("accel", t, a @ np.sin(angle) + 0.1 * rng.standard_normal(len(t)), "m/s^2")
    z = -(a / (2.0 * np.pi * f) ** 2) @ np.sin(angle) + 1e-6 * rng.standard_normal(len(t))
    usual = np.quantile(np.abs(np.diff(z)), 0.98)
    at = int(rng.uniform(0.2, 0.8) * len(t))
    z[at : at + length] += (15.0 + 10.0 * length) * usual  # far beyond the motion meanwhile
    result = spikes(t, z, output)
    assert list(np.flatnonzero(result)) == list(range(at, at + length))


def test_a_glitch_is_said_with_its_readings_and_what_they_jump_by() -> None:
    recording = ac.simulate(
        "tones", seconds=8.0, rig=ADXL105_RIG, parameters={"bias": 0.05}, rng=np.random.default_rng(3)
    ).recording
    z = recording.position.y.copy()
    z[2000] -= 0.02
    z[5000:5003] += 0.02, 0.03, 0.025
    position = dataclasses.replace(recording.position, y=z)
    faults = {fault.time: fault for fault in examine(dataclasses.replace(recording, position=position)).faults}
    single, group = (faults[float(position.t[k])] for k in (2000, 5000))
    assert single.sentence.startswith("position: 1 reading jumps by -20")
    assert single.sentence.endswith("and returns")
    assert group.sentence.startswith("position: 3 readings jump by 30")
    assert group.sentence.endswith("and return")
    assert (single.size, group.size) == pytest.approx((-0.02, 0.03), abs=1e-4)
