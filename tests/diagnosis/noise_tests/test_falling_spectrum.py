"""What stands out of the tail of a motion is found there; kinks, which fall with frequency, are not taken for it.

Each null below alarms with a probability of 1e-4 a test; 12 records of two tests each, 0.2 % in all.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accelcal.diagnosis.clean_fit import run_noise_tests
from accelcal.diagnosis.noise.noise_test import LINE, VIBRATION, NoiseTest
from accelcal.diagnosis.noise.residuals import Residuals
from accelcal.diagnosis.noise.spectra import excess_trend_test
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.run_state import RunState
from accelcal.io import load
from accelcal.model import Model
from tests.regimes.regimes import TABLE

SECONDS, CORNER, ALPHA = 40.0, 159.0, 1e-4
RAMPS = ("a-cosine-cxl02", "a-minjerk-cxl02")
"""Raised-cosine ramps of the speed and quintic moves: steps of the jerk, beside a sensor of 20 ug/sqrt(Hz)."""


def fitted(
    folder: Path, name: str, seed: int, *, vibration: float = 0.0, hum: float = 0.0, frequency: float = 230.0
) -> RunState:
    """The linear model on a record of a regime, to which a vibration that grows with v², or a constant line, is added.

    Their sizes are m/s² at the sensor, in front of its low-pass.
    """
    record = TABLE[name].build(seed, seconds=SECONDS)
    v = record.motion.velocity(record.t_accel)
    amplitude = (vibration * (v / np.max(np.abs(v))) ** 2 + hum) / np.hypot(1.0, frequency / CORNER)
    wave = amplitude * np.cos(2.0 * np.pi * frequency * record.t_accel)
    recording = load(replace(record, accel=record.accel + wave).write(folder))
    return solve_runs(Model.linear(), [recording]).states[0]


def significant(state: RunState) -> dict[str, NoiseTest]:
    """Lines and vibration that the noise tests find."""
    return {t.effect: t for t in run_noise_tests(state) if t.effect in (LINE, VIBRATION) and t.p_value < ALPHA}


@pytest.mark.parametrize("seed", [311, 312])
@pytest.mark.parametrize("name", RAMPS)
def test_vibration_is_found_and_measured_where_the_motion_has_a_tail(tmp_path: Path, name: str, seed: int):
    state = fitted(tmp_path, name, seed, vibration=0.2)
    assert 2.0 * Residuals(state).reach > 230.0  # below twice where the tail vanishes: the case at hand
    tests = significant(state)
    assert set(tests) == {VIBRATION}
    assert tests[VIBRATION].estimate == pytest.approx(0.2, rel=0.15)
    assert tests[VIBRATION].parts["frequency"] == pytest.approx(230.0, abs=5.0)  # a fifth of a bin


@pytest.mark.parametrize("name", RAMPS)
def test_a_constant_line_in_the_tail_is_a_tone(tmp_path: Path, name: str):
    tests = significant(fitted(tmp_path, name, 313, hum=0.01, frequency=211.3))
    assert set(tests) == {LINE}
    assert tests[LINE].parts["frequency"] == pytest.approx(211.3, abs=0.02)
    assert tests[LINE].estimate == pytest.approx(0.01, rel=0.15)


@pytest.mark.parametrize("name", [*RAMPS, "a-seg7-cxl02", "a-cosine-servo", "a-cosine-str60", "a-seg7-str150"])
def test_kinks_alone_are_neither(tmp_path: Path, name: str):
    for seed in (314, 315):
        assert significant(fitted(tmp_path, name, seed)) == {}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_kinks_that_go_with_speed_need_both_comparisons(sign: float):
    """Kinks at full speed, or at rest: power as it is, or less that of lower bins, alone says vibration."""
    rng = np.random.default_rng(316)
    x, jerk = rng.random((2, 6000))
    kinks = np.where(rng.random(6000) < 0.5, 5.0 * (x if sign > 0.0 else 1.0 - x), 0.0)
    inside = (1.0 + 0.5 * kinks) * rng.exponential(size=6000)
    below = (1.0 + kinks) * rng.gamma(3.0, 1.0 / 3.0, 6000)
    level = np.maximum(below, 1.0)[:, None]
    plain, beyond = (float(excess_trend_test(y[:, None], level, x, jerk)[1][0]) for y in (inside, inside - below))
    assert min(plain, beyond) < ALPHA
    assert max(plain, beyond) > 0.01


@pytest.mark.parametrize("share", [1.0, 0.02])
def test_probabilities_are_no_smaller_than_they_say(share: float):
    """2000 draws of noise and kinks, a variable that is large in all blocks or in few: at most 2 % below 1 % (4.5
    standard deviations), and scores that scatter by half of what they may at least."""
    rng = np.random.default_rng(317)
    x, jerk = rng.exponential(size=400) * (rng.random(400) < share), rng.random(400)
    kinks = 1.0 + 10.0 * (rng.random((400, 1)) < 0.1)
    below = kinks * rng.gamma(3.0, 1.0 / 3.0, (400, 2000))
    excess = kinks * rng.exponential(size=(400, 2000)) - below
    z, p = excess_trend_test(excess, np.maximum(below, 1.0), x, jerk)
    assert np.mean(p < 0.01) < 0.02
    assert np.std(z) > 0.5  # nor so cautious that nothing is found
