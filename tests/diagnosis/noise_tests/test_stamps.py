"""Rounded stamps and held samples are named as what they are, and jitter only beyond them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.noise.counts import repeated_share
from accelcal.diagnosis.policy import HELD_SHARE
from accelcal.diagnosis.verdict import Diagnosis
from tests.regimes.regimes import ADXL105, MOCAP, TABLE, phone
from tests.regimes.rig import Clocks, Record, Reference, Rig

PRECISE = replace(phone(100.3), density=20.0)
UNEVEN = Clocks(tolerance=5e-3, irregular=0.2)


def diagnosed(tmp_path: Path, rig: Rig, profile: str = "hand", seconds: float = 25.0) -> tuple[Diagnosis, Record]:
    """The base model on one record of a rig, and the record."""
    record = replace(TABLE["a-mixed-adxl105"], rig=rig, profile=profile, seconds=seconds).build(3)
    recording = ac.load(record.write(tmp_path))
    return ac.diagnose(ac.fit(recording), recording), record


def test_rounded_stamps_are_named_so_and_cost_nothing(tmp_path: Path) -> None:
    clocks = Clocks(tolerance=5e-3, rounding=1e-3)
    result, record = diagnosed(tmp_path / "a", Rig(phone(200.7), MOCAP, clocks), "tremor", 60.0)
    assert result.effects == ("rounded_stamps",)
    assert "accel to 1 ms" in result.sentence
    assert "rounding errs by 289 µs rms" in result.sentence
    exact, _ = diagnosed(tmp_path / "b", Rig(phone(200.7), MOCAP, replace(clocks, rounding=0.0)), "tremor", 60.0)
    assert exact.effects == ()
    for name in ("bias", "scale_factor"):
        assert result.fit[name].std == pytest.approx(exact.fit[name].std, rel=0.02)
        assert result.fit[name].value == pytest.approx(exact.fit[name].value, abs=0.3 * exact.fit[name].std)
    # 120 Hz in milliseconds is a pattern of three stamps: 1/3 ms of the clock's phase is nowhere in the record.
    offset = result.fit["time_offset"]
    assert offset.std > 9e-5 > 3.0 * exact.fit["time_offset"].std
    assert abs(offset.value - record.truth["time_offset"]) < 3.0 * offset.std


def test_rounding_of_an_uneven_clock_is_no_jitter_but_more_than_it_is(tmp_path: Path) -> None:
    rounded = replace(UNEVEN, rounding=1e-3)
    result, _ = diagnosed(tmp_path / "a", Rig(PRECISE, Reference(1e-5, None, 100.1), rounded))
    assert "rounded_stamps" in result.effects
    assert "timing_jitter" not in result.effects
    more, _ = diagnosed(tmp_path / "b", Rig(PRECISE, Reference(1e-5, None, 100.1), replace(rounded, jitter=1.5e-3)))
    assert {"rounded_stamps", "timing_jitter"} <= set(more.effects)


def test_held_samples_are_named_so_and_not_quantisation(tmp_path: Path) -> None:
    logger = replace(ADXL105, rate=1000.3, corner=None)
    result, record = diagnosed(tmp_path, Rig(logger, clocks=Clocks(held=400.0)), "mixed", 15.0)
    assert result.effects == ("held_samples",)
    assert "renews them at 400 Hz" in result.sentence
    for name, true in record.truth.items():
        assert abs(result.fit[name].value - true) < 4.0 * result.fit[name].std


@pytest.mark.parametrize("seed", range(3))
def test_codes_that_repeat_at_rest_behind_a_calibration_matrix_are_not_held(seed: int) -> None:
    rng = np.random.default_rng([seed, 29])
    t = np.arange(0.0, 20.0, 0.02)
    quiet = 0.5 * (1.0 + np.tanh(8.0 * np.sin(2.0 * np.pi * 0.4 * t)))  # a leg swings and stands
    swing = 6.0 * quiet * np.sin(2.0 * np.pi * np.array([[1.3], [1.7], [2.3]]) * t + rng.uniform(0.0, 6.0, (3, 1)))
    codes = np.round((swing + 0.12 * rng.standard_normal(swing.shape)) / 0.5)
    matrix = np.eye(3) + 0.03 * rng.standard_normal((3, 3))
    output = np.round(0.5 * matrix[0] @ codes, 6)
    assert np.mean(output[1:] == output[:-1]) > 0.04  # the record has them
    assert repeated_share(output) < 0.25 * HELD_SHARE


@pytest.mark.parametrize("faster", [1.3, 2.0, 2.7])
def test_a_logger_that_holds_repeats_in_motion(faster: float) -> None:
    t = np.arange(10_000) / 500.0
    newest = np.floor(t * 500.0 / faster).astype(int)
    fresh = np.sin(2.0 * np.pi * 1.3 * t) + 1e-3 * np.random.default_rng(30).standard_normal(len(t))
    share = repeated_share(fresh[newest])
    assert share == pytest.approx(1.0 - 1.0 / faster, abs=0.05)
    assert share > HELD_SHARE
