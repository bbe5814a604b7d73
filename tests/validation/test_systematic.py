"""The systematic error of the output: unbiased, with intervals that hold, and bounds where noise is as large."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.effects import find
from accelcal.simulation import CXL02_RIG
from accelcal.validation.comparison import Resolved, SystematicError
from accelcal.validation.differences import systematic_change, verdict_of
from accelcal.validation.systematic import Grid, MeasuredNoise, added_variables
from benches.ruler import DENSITY, ERRORS, LEVELS, RATE, Case, motion, noise, outcome, resolved, shape
from tests.worlds import Hidden, World


def test_intervals_and_bounds_hold_in_closed_form() -> None:
    # 60 two-sided intervals of 95 %: fewer than 51 have a chance of 2e-3; 60 bounds of 95 %: fewer than 51 as well.
    worlds = [Case(level, number, 11) for level in LEVELS for number in range(20)]
    cases = [outcome(world) for world in worlds]
    large = [case for case in cases if LEVELS[case["level"]] >= 2.0]
    small = [case for case in cases if LEVELS[case["level"]] <= 1.0]
    held = sum(case["low"] <= case["truth"] <= case["high"] for case in large)
    bounded = sum(case["truth"] <= case["high"] for case in small)
    print(f"{held} of {len(large)} intervals, {bounded} of {len(small)} bounds hold")
    assert held >= 51
    assert bounded >= 51


def test_power_of_the_noise_that_is_left_in_would_be_an_error() -> None:
    # The twin: without the subtraction of what noise has in the directions, no interval holds an error of zero.
    rng = np.random.default_rng(4)
    s = motion(rng, 40.0)
    (part,) = resolved(s, noise(rng, len(s.t)))
    naive = float(np.sqrt(part.coordinates @ part.coordinates / part.samples))
    estimate = SystematicError.of([part])
    assert estimate is not None
    assert naive > 1.5 * estimate.detection_limit
    assert estimate.high < naive


def test_a_false_effect_is_no_improvement_and_a_right_one_is() -> None:
    for level, verdict in (("right", {"better"}), ("false", {"undecided", "worse"})):
        assert {outcome(Case(level, number, 12))["verdict"] for number in range(8)} <= verdict


def test_recordings_count_by_their_samples() -> None:
    short = Resolved(np.array([3.0, 0.0]), 0.01 * np.eye(2), 0.0, 1.0, 1.0, 0.1, 100)
    long = Resolved(np.array([0.0, 1.0]), 0.01 * np.eye(2), 0.0, 1.0, 1.0, 0.1, 300)
    both = SystematicError.of([short, long])
    assert both is not None
    assert both.rms == pytest.approx(np.sqrt((9.0 + 1.0 - 0.04) / 400.0))
    assert SystematicError.of([]) is None
    change = systematic_change([short], [Resolved(np.array([1.0, 0.0]), 0.01 * np.eye(2), 0.0, 1.0, 1.0, 0.1, 100)])
    assert change is not None
    assert change.after < change.before
    assert verdict_of(change) == "better"


def test_models_that_differ_by_their_noise_alone_make_no_direction() -> None:
    # Readings over another scale factor: the difference is the noise itself, and would be resolved whole.
    rng = np.random.default_rng(5)
    s = motion(rng, 40.0)
    present = noise(rng, len(s.t))
    error = 1e-3 * shape(s, ERRORS["cubic"])
    alone, _ = resolved(s, error + present, 1.0001 * present)
    (single,) = resolved(s, error + present)
    assert np.linalg.norm(alone.coordinates) == pytest.approx(np.linalg.norm(single.coordinates), rel=0.02)


def test_error_falls_on_another_recording_and_lies_on_the_line_of_the_effect() -> None:
    rng = np.random.default_rng(6)
    truth = {"bias": 0.05, "scale_factor": 0.01, "cubic": 2e-3}
    train, other = (
        ac.simulate("interleaved", seconds=40.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording for _ in range(2)
    )
    base = ac.fit(train)
    better = ac.add(base, train, "cubic")
    before, after = ac.compare([base, better], other)
    assert before.systematic is not None
    assert after.systematic is not None
    assert before.systematic.detected
    assert after.systematic.high < before.systematic.low / 3.0
    walk = (find("bias_random_walk"), {"start": 0.0, "length": 40.0}, [1.0])
    lacking = [(find("cubic"), {}, [better["cubic"].value]), (find("quadratic"), {}, [1e-3]), walk]
    drawn, rival, of_time = added_variables(before, base, lacking)
    assert drawn is not None
    assert rival is not None
    assert drawn.slope == pytest.approx(1.0, abs=0.1)  # the motion is smoothed under the model that lacks the effect
    assert drawn.explained > 0.9
    assert rival.explained < 0.2
    assert of_time is None


def test_noise_that_no_direction_leaves_is_the_assumed_one() -> None:
    """A band of 2 Hz over 20 s has 80 values, as many as the directions: nothing is left to measure noise by."""
    n, band, step = 500, 2.0, 0.04
    at, f = np.arange(n), np.arange(1, 41) / 20.0
    waves = [wave(2.0 * np.pi * step * line * at) for line in f for wave in (np.sin, np.cos)]
    directions = np.linalg.qr(np.stack([np.ones(n), *waves], axis=1))[0].T
    grid = Grid(at, at, 1, step, band)

    def measured(directions: np.ndarray, rest: np.ndarray) -> MeasuredNoise:
        return MeasuredNoise.of(rest, directions, grid, lambda f: np.where(f <= band, 1e-6, 1e-300))

    rest = np.full(n, 1e-12)
    with np.errstate(all="raise", under="ignore"):
        noise = measured(directions, rest)
    assert noise.kinds.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert noise.levels.tolist() == [1.0]
    assert noise.density(np.array([1.0])) == pytest.approx(1e-6)
    white = np.random.default_rng(1).normal(0.0, np.sqrt(4e-6 / (2.0 * step)), n)  # four times the assumed density
    lines = np.where(np.fft.rfftfreq(n, step) <= band, np.fft.rfft(white), 0.0)
    assert measured(directions[:5], np.fft.irfft(lines, n)).density(np.array([1.5])) == pytest.approx(4e-6, rel=0.6)


def test_density_of_the_noise_is_the_declared_one() -> None:
    y = np.concatenate([noise(np.random.default_rng(seed), 8000) for seed in range(10)])
    f = np.fft.rfftfreq(len(y), 1.0 / RATE)
    low = (f > 0.5) & (f < 20.0)
    power = 2.0 * np.abs(np.fft.rfft(y)[low]) ** 2 / (RATE * len(y))
    assert np.mean(power) == pytest.approx(DENSITY**2, rel=0.1)


def test_a_wave_of_the_encoder_is_an_error_of_the_reference(tmp_path: Path) -> None:
    rig = World("fast", "ADXL105", (Hidden("encoder_cyclic", 0.3e-6),), seed=611).settled()
    train, other = (ac.load(w.record().write(tmp_path, str(w.seed))) for w in (rig, rig.again("interleaved", 612)))
    base = ac.fit(train)
    comparison = ac.compare([base, ac.add(base, train, "encoder_cyclic")], other)
    lacking, right = (evaluation.reference for evaluation in comparison.evaluations[0])
    assert lacking is None  # it corrects nothing
    assert right is not None
    without, left = right
    truth, std = 0.3e-6 / np.sqrt(2.0), (without.high - without.low) / 3.92
    assert abs(without.value - truth) < 3.0 * std < 0.2 * truth
    assert left.high < 0.15 * truth
    assert any(note.startswith("Error of the reference: 2") for note in comparison.table().notes)
