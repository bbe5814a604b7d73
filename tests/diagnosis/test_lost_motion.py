"""Lost motion of the reading head, by a simulator of its own: backlash alone, and jumps that are none remain faults."""

from __future__ import annotations

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Recording
from accelcal.diagnosis.faults import Examined

RATE = 2000.0
NOISE = 9.8e-4
"""Of the sensor, (m/s²)/sqrt(Hz)."""
PLAY = 3e-6
"""m"""


def sines(rng: np.random.Generator, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and acceleration of a stage that never rests."""
    w = 2.0 * np.pi * np.array([0.31, 0.83, 1.7, 3.1])
    size, phase = np.array([20e-3, 8e-3, 3e-3, 1e-3]), rng.uniform(0.0, 2.0 * np.pi, 4)
    wave = size * np.sin(w * t[:, None] + phase)
    return wave.sum(axis=1), -(w**2 * wave).sum(axis=1)


def recorded(
    seed: int, play: float = PLAY, jumps: dict[float, float] | None = None, seconds: float = 40.0
) -> Recording:
    """A record; `jumps` are missed counts, m by the time, s."""
    rng, t = np.random.default_rng(seed), np.arange(int(seconds * RATE)) / RATE
    p, a = sines(rng, t)
    z, head = p.copy(), p[0]
    for k, place in enumerate(p):
        z[k] = head = min(max(head, place - 0.5 * play), place + 0.5 * play)
    for instant, size in (jumps or {}).items():
        z += size * (t >= instant)
    u = 0.08 + 0.988 * a + rng.normal(0.0, NOISE * np.sqrt(0.5 * RATE), t.size)
    z += rng.normal(0.0, 1e-7, t.size)
    units = {"accel": "m/s^2", "position": "m"}
    return ac.Recording.from_arrays(t, u, z, units=units, rig=ac.Rig(ac.Sensor(noise=NOISE)))


def turning(seed: int) -> float:
    """Time of a reversal in the middle of a record, s."""
    t = np.arange(int(40.0 * RATE)) / RATE
    p, _ = sines(np.random.default_rng(seed), t)
    reversals = np.flatnonzero(np.diff(np.sign(np.diff(p)))) + 1
    return float(t[reversals[len(reversals) // 2]])


@pytest.mark.slow
def test_lost_motion_is_backlash_alone_and_enters() -> None:
    """Without rests: behind a rest the head takes up part of its play before the stage surely moves."""
    found = ac.improve(recorded(3, seconds=20.0))
    print(found.sentence)
    assert found.effects == ("encoder_backlash",)
    assert abs(abs(found.best["encoder_backlash"].value) - PLAY) < 0.1 * PLAY


@pytest.mark.parametrize("seed", [3, 5, 11])
def test_a_step_at_every_reversal_is_no_fault(seed: int) -> None:
    assert Examined(recorded(seed)).source.recording.position_steps == ()


def test_missed_counts_are_a_fault_beside_play_and_at_a_reversal_without_it() -> None:
    (beside,) = Examined(recorded(3, jumps={20.1: 2e-5})).source.recording.position_steps
    assert beside.time == pytest.approx(20.1, abs=2e-3)
    at = turning(3)
    (without,) = Examined(recorded(3, 0.0, jumps={at: 2e-6})).source.recording.position_steps
    assert without.time == pytest.approx(at, abs=2e-3)
    (large,) = Examined(recorded(3, jumps={at: 2e-4})).source.recording.position_steps
    assert large.time == pytest.approx(at, abs=2e-3)
