"""Lost motion of the reading head, by a simulator of its own: backlash alone, and jumps that are none remain faults.

Motions are sines, and moves from point to point with rests between them, as a test of a stage has them.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Recording
from accelcal.diagnosis.faults import Examined
from accelcal.diagnosis.search import scores
from accelcal.diagnosis.search.scan import scan
from accelcal.effects import find
from accelcal.effects.building_blocks import direction, play as play_of
from accelcal.estimation.estimate import state_at
from accelcal.estimation.run import prepare
from accelcal.signals.signals import Signals
from benches.mechanisms import play, scene, write

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


def moves(rng: np.random.Generator, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and acceleration of smooth moves of 5 to 50 mm either way, with rests of 0.2 to 1 s between them."""
    p, a = np.zeros_like(t), np.zeros_like(t)
    place, begin = 0.0, 0.5
    while begin < t[-1]:
        way = rng.uniform(5e-3, 5e-2) * (-1.0 if place > 0.0 else 1.0) * rng.choice([1.0, 1.0, -1.0])
        long = max(0.08, 1.875 * abs(way) / rng.uniform(0.05, 0.3))
        x = np.clip((t - begin) / long, 0.0, 1.0)
        p += way * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        a += way / long**2 * x * (60.0 - 180.0 * x + 120.0 * x**2)
        place, begin = place + way, begin + long + rng.uniform(0.2, 1.0)
    return p, a


def read_of(p: np.ndarray, play: float) -> np.ndarray:
    """What a head that hangs in a gap reads of the position."""
    z, head = p.copy(), p[0]
    for k, place in enumerate(p):
        z[k] = head = min(max(head, place - 0.5 * play), place + 0.5 * play)
    return z


def of_moves(
    seed: int, play: float, count: float, seconds: float = 14.0, output: float = 2e-3, reading: float = 7e-8
) -> Recording:
    """A record of moves with rests at 1 kHz; `count` of the encoder, m; noise of a sample and of a reading, m/s², m."""
    rng, t = np.random.default_rng(seed), np.arange(int(seconds * 1000.0)) / 1000.0
    p, a = moves(rng, t)
    u = 0.08 + 0.988 * a + rng.normal(0.0, output, t.size)
    z = count * np.rint((read_of(p, play) + rng.normal(0.0, reading, t.size)) / count)
    rig = ac.Rig(ac.Sensor(noise=output / np.sqrt(500.0)))
    return ac.Recording.from_arrays(t, u, z, units={"accel": "m/s^2", "position": "m"}, rig=rig)


def recorded(
    seed: int, play: float = PLAY, jumps: dict[float, float] | None = None, seconds: float = 40.0
) -> Recording:
    """A record; `jumps` are missed counts, m by the time, s."""
    rng, t = np.random.default_rng(seed), np.arange(int(seconds * RATE)) / RATE
    p, a = sines(rng, t)
    z = read_of(p, play)
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
    better = ac.improve(recorded(3, seconds=20.0))
    print(better.sentence)
    assert better.effects == ("encoder_backlash",)
    assert abs(abs(better.best["encoder_backlash"].value) - PLAY) < 0.1 * PLAY


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


def test_a_missed_count_is_a_fault_where_the_stage_never_turns() -> None:
    rng, t = np.random.default_rng(33), np.arange(20_000) / 1000.0
    w = 2.0 * np.pi * 0.7
    z = 0.05 * t + 0.025 / w * (1.0 - np.cos(w * t)) + 3e-4 * (t > 9.3) + 2e-7 * rng.standard_normal(t.size)
    u = 0.025 * w * np.cos(w * t) + 1e-3 * rng.standard_normal(t.size)
    rig = ac.Rig(ac.Sensor(noise=1e-3 / np.sqrt(500.0)))
    recording = ac.Recording.from_arrays(t, u, z, units={"accel": "m/s^2", "position": "m"}, rig=rig)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing is averaged over no reversal
        (jump,) = Examined(recording).source.recording.position_steps
    assert jump.time == pytest.approx(9.3, abs=2e-3)


@pytest.mark.slow
def test_play_far_above_the_noise_is_found_with_its_width(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit without it takes it for noise of the position, below which no width is sought. False alarm 6e-5 a size."""
    play = 1e-5
    monkeypatch.setattr(sys.modules[__name__], "NOISE", 2e-4)
    recording = recorded(5, play, seconds=12.0)
    fit = ac.add(ac.fit(recording), recording, "encoder_backlash")
    size, width = fit["encoder_backlash"], fit["encoder_backlash.width"]
    print(size, width)
    assert abs(size.value + play) < 4.0 * size.std < 0.1 * play
    assert abs(width.value - play) < 4.0 * width.std < play


@pytest.mark.slow
def test_play_is_found_with_its_width_behind_a_low_pass_and_coarse_counts(tmp_path: Path) -> None:
    """A width far off leaves noise that is not white; in the band that such noise asks for, no width can be told."""
    rng, width = np.random.default_rng(7004), 1e-5
    s = scene(rng)
    recording = ac.load(write(s, np.zeros_like(s.t), rng, tmp_path / "play.csv", play(s.p, width)))
    fit = ac.add(ac.fit(recording), recording, "encoder_backlash")
    assert "imposed_band" not in {note.code for note in fit.remarks}
    assert fit["encoder_backlash"].value == pytest.approx(-width, abs=4.0 * fit["encoder_backlash"].std)
    assert fit["encoder_backlash.width"].value == pytest.approx(width, rel=0.03)


def test_lost_motion_is_found_on_moves_with_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    """On counts as coarse as a third of it. In the twin all rests together say what one says."""
    count, effect = 1e-6, find("encoder_backlash")
    recording = of_moves(31, PLAY, count)
    base = ac.fit(recording)
    size = ac.add(base, recording, effect.name)[effect.name]
    print(size)
    assert abs(size.value + PLAY) < 3.0 * size.std < 0.3 * PLAY
    state = state_at(base, 0, prepare(recording))
    alone = scan([state], base.model, only=[effect])
    assert alone.candidates[0].snr > 10.0
    assert alone.detected[0].shape["width"] > abs(size.value) / 1.5
    unit_variance = (
        2.0 / 3.0 * count**2
    )  # variance step²/6 of a column that changes by one where a rest begins, by half of d
    monkeypatch.setattr(scores, "rounding_variances", lambda terms, runs, power: np.full(len(terms), unit_variance))
    assert scan([state], base.model, only=[effect]).candidates[0].snr < 5.0  # 5.3 enters among 180 candidates


def test_missed_counts_are_no_fault_however_clear_each_reversal_is() -> None:
    assert Examined(of_moves(32, PLAY, 1e-7)).source.recording.position_steps == ()


def test_a_drift_inside_the_gap_at_rest_takes_up_nothing() -> None:
    """The twin is the play operator of the position itself."""
    t = np.arange(4000) / 1000.0
    v = np.where(t < 1.0, 0.01, np.where((t > 3.0) & (t < 3.5), -0.01, 0.0)) - np.where(
        np.abs(t - 2.0) < 0.3, 2e-6, 0.0
    )
    p = np.cumsum(v) / 1000.0
    s = Signals(t, p, v, 0.0 * t, 0.0 * t, 1.0, ac.Rig(), p_std=2e-8, v_std=2e-6)
    column = direction(s, PLAY)
    rest = (t > 1.1) & (t < 3.0)
    np.testing.assert_allclose(column[rest], 1.0, atol=1e-9)
    assert column[-1] == pytest.approx(-1.0)
    plain = (p - play_of(p, PLAY, p[0])) / (0.5 * PLAY)
    assert np.min(plain[rest]) < 0.3
