"""Motion that sampling does not resolve is no outlier and no jitter; wrong samples and jitter beside it are found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from accelcal.data.recording import Channel, Recording
from accelcal.diagnosis.checks import unresolved_motion
from accelcal.diagnosis.clean_fit import run_noise_tests
from accelcal.diagnosis.noise import outliers, position, residuals, spectra
from accelcal.diagnosis.noise.noise_test import JITTER, LINE, OUTPUT_OUTLIERS
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.run import PreparedRun, prepare
from accelcal.io import load
from accelcal.model import Model
from accelcal.signals.series import widened
from accelcal.signals.unresolved import NO_JUMPS
from accelcal.verbs import improve
from tests.regimes.regimes import TABLE
from tests.regimes.rig import Clocks
from tests.regimes.trials import Trial

SECONDS, ALPHA = 20.0, 1e-4
"""Each null below alarms with a probability of `ALPHA` a test."""


def recorded(tmp_path: Path, name: str, clocks: Clocks | None = None, seconds: float = SECONDS) -> Recording:
    """A record of one regime of tests/regimes, with other clocks if asked."""
    regime = TABLE[name]
    if clocks is not None:
        regime = replace(regime, rig=replace(regime.rig, clocks=clocks))
    return load(regime.build(4711, seconds=seconds).write(tmp_path))


def named_effects(recording: Recording) -> set[str]:
    """Effects that the noise tests find on the linear model."""
    state = solve_runs(Model.linear(), [recording]).states[0]
    return {test.effect for test in run_noise_tests(state) if test.p_value < ALPHA}


@pytest.mark.parametrize(
    "name", ["a-trap-cxl02", "a-trap-servo", "a-trap-adxl105", "a-seg7-servo", "a-cosine-cxl02", "a-trap-str150"]
)
def test_jumps_are_neither_outliers_nor_jitter(tmp_path: Path, name: str):
    assert not named_effects(recorded(tmp_path, name)) & {OUTPUT_OUTLIERS, JITTER}


def test_without_the_search_for_jumps_they_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(PreparedRun, "jumps", NO_JUMPS)
    monkeypatch.setattr(outliers, "jumps_at", lambda *_: NO_JUMPS)
    assert OUTPUT_OUTLIERS in named_effects(recorded(tmp_path, "a-trap-cxl02"))


@pytest.mark.parametrize("name", ["a-trap-cxl02", "a-cosine-cxl02", "a-smooth-adxl105"])
def test_wrong_samples_beside_jumps_are_found(tmp_path: Path, name: str):
    recording = recorded(tmp_path, name)
    rng = np.random.default_rng(5)
    y = recording.accel.y.copy()
    at = rng.choice(np.arange(500, len(y) - 500), 12, replace=False)
    y[at] += 12.0 * np.std(np.diff(recording.accel.y, 3)[: len(y) // 20]) * rng.choice([-1.0, 1.0], 12)
    spoiled = replace(recording, accel=Channel("accel", recording.accel.t, y, recording.accel.unit))
    assert OUTPUT_OUTLIERS in named_effects(spoiled)


@pytest.mark.parametrize("name", ["a-cosine-cxl02", "a-random-cxl02"])
def test_jitter_is_found_beside_kinks(tmp_path: Path, name: str):
    assert JITTER in named_effects(recorded(tmp_path, name, Clocks(jitter=1e-4)))


def test_the_remark_counts_the_jumps(tmp_path: Path):
    run = prepare(recorded(tmp_path, "a-trap-cxl02"))
    (message,) = unresolved_motion(SimpleNamespace(runs=[run]))
    assert message.code == "unresolved_motion"
    assert message.values["instants"] == len(run.jumps.t) > 50
    assert not [*unresolved_motion(SimpleNamespace(runs=[prepare(recorded(tmp_path, "a-smooth-cxl02"))]))]


def test_a_motion_beyond_the_sampling_is_not_judged(tmp_path: Path):
    improvement = improve(recorded(tmp_path, "q-100Hz-bumps", seconds=40.0))
    assert improvement.verdict == "unexplained"
    assert improvement.effects == ()
    assert "faster than the sampling resolves during" in improvement.sentence


def test_a_line_that_only_the_position_holds_is_no_tone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Steps of 20 um, crossed at the constant speeds of trapezoidal moves."""
    record = TABLE["h-coarse-trap"].build(Trial("h-coarse-trap", 5, 910).record_seed)
    recording = load(record.write(tmp_path))
    assert LINE not in named_effects(recording)
    monkeypatch.setattr(spectra, "output_lacks", lambda *_: False)
    assert LINE in named_effects(recording)


def test_jumps_leave_only_noise_beside_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Background next to 256 unfiltered steps, as far as a filter rings; twin: bridges over the steps themselves."""
    record = TABLE["a-trap-servo-norc"].build(Trial("a-trap-servo-norc", 1, 910).record_seed)
    state = solve_runs(Model.linear(), [load(record.write(tmp_path))]).states[0]

    def largest() -> float:
        state_residuals = residuals.Residuals(state)
        beside = widened(state_residuals.unresolved, 48) & state_residuals.sampled
        return float(
            np.max(np.abs(state_residuals.background[beside]))
            / np.std(state_residuals.background[state_residuals.sampled])
        )

    assert largest() < 5.5  # 20 000 samples exceed it in one record of 1300
    monkeypatch.setattr(residuals, "output_of", lambda _jumps, _begin, _step, n: np.zeros(n))
    assert largest() > 8.0


def test_many_lost_samples_are_no_outliers(tmp_path: Path):
    record = TABLE["k-accel30-adxl105"].build(Trial("k-accel30-adxl105", 0, 905).record_seed)
    assert OUTPUT_OUTLIERS not in named_effects(load(record.write(tmp_path)))


def test_rounding_of_a_coarse_encoder_is_no_colour(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Counts of 20 um that repeat while the stage moves; twin: colour tested over times that the filter averages."""
    record = TABLE["h-coarse-mixed"].build(Trial("h-coarse-mixed", 0, 912).record_seed)
    recording = load(record.write(tmp_path))
    assert "whiteness" not in named_effects(recording)
    monkeypatch.setattr(position, "shortest_scale", lambda _: 1.0)
    assert "whiteness" in named_effects(recording)
