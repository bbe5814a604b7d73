"""A low-pass that is not quite what was declared: the tolerance stands in the standard deviations, and in no verdict
twice. `benches/consistency.py` runs the whole of the first statistic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from accelcal import Model, simulate
from accelcal.data.recording import Recording
from accelcal.data.rig import LowPass
from accelcal.estimation.estimate import estimate
from accelcal.results import model_file
from accelcal.simulation import CXL02_RIG
from accelcal.verbs import improve
from tests.consistency.campaign import rms_region
from tests.consistency.toleranced import NAMES, TRUTH, normalised, record

RUNS = 24
PROBABILITY = 0.999


def rms(motion: str, tolerance: float, **how: bool) -> np.ndarray:
    values = np.array([normalised(seed, motion, tolerance, **how) for seed in range(RUNS)])
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def test_standard_deviations_are_honest_when_the_low_pass_is_off_within_its_tolerance() -> None:
    # 99.9 % for the three parameters together.
    result = rms("interleaved", 0.05)
    low, high = rms_region(RUNS, 1.0 - (1.0 - PROBABILITY) / len(NAMES))
    print(dict(zip(NAMES, result.round(3), strict=True)), f"in [{low:.2f}, {high:.2f}], {RUNS} fits")
    assert np.all((result > low) & (result < high))


def test_a_tolerance_that_is_not_declared_makes_scale_and_delay_overconfident() -> None:
    # The sister that must fail: same records, same statistic.
    result = rms("interleaved", 0.05, declared=False)
    _, high = rms_region(RUNS, PROBABILITY)
    print(dict(zip(NAMES, result.round(3), strict=True)), f"above {high:.2f}")
    assert np.all(result[1:] > 1.5 * high)


def test_motion_fast_enough_to_show_the_low_pass_finds_its_error() -> None:
    fast = estimate(Model.linear(), record(3, "fast", 0.05, declared=True))
    assert fast.rig.lowpass is not None
    prior = fast.rig.lowpass_prior
    assert fast["lowpass_error"].std < 0.2 * prior
    assert fast.model.priors["lowpass_error"].std == prior
    assert abs(fast["time_offset"].value - TRUTH["time_offset"]) < 5.0 * fast["time_offset"].std


def test_an_exact_low_pass_adds_nothing_to_the_model() -> None:
    exact = replace(CXL02_RIG, lowpass=LowPass(159.0, 0.0))
    simulation = simulate("tones", seconds=10.0, rig=exact, parameters=TRUTH, rng=np.random.default_rng(1))
    assert "lowpass_error" not in estimate(Model.linear(), simulation.recording).model.effects


def test_a_model_with_the_error_of_its_low_pass_survives_its_file(tmp_path) -> None:
    fit = estimate(Model.linear(), record(5, "tones", 0.05, declared=True, seconds=10.0))
    model_file.save(fit, tmp_path / "m.json")
    assert model_file.to_dict(model_file.load(tmp_path / "m.json")) == model_file.to_dict(fit)


def late(delay: float, slower: float = 0.0) -> Recording:
    """A record whose declared tolerance of 2 % of the low-pass, 20 us, stands beside a delay of the clock."""
    built = replace(CXL02_RIG, lowpass=LowPass(159.0 / (1.0 + slower)))
    truth = {**TRUTH, "time_offset": delay}
    simulation = simulate("interleaved", seconds=30.0, rig=built, parameters=truth, rng=np.random.default_rng(8))
    return replace(simulation.recording, rig=replace(CXL02_RIG, lowpass=LowPass(159.0, 0.02)))


@pytest.mark.parametrize(
    ("delay", "slower", "named"),
    [(30e-6, 0.0, True), (10e-6, 0.0, False), (0.0, 0.015, False), (10e-6, 0.015, True), (0.0, 0.04, True)],
)
def test_the_tolerance_is_subtracted_from_a_delay_once(delay: float, slower: float, named: bool) -> None:
    # The delay is known to 0.6 us; three standard deviations of the time constant would be 60 us. False alarms: 0.5 %.
    improvement = improve(late(delay, slower))
    assert ("time_offset" in improvement.effects) == named
    if named:
        before, after = improvement.steps[0].heldout, improvement.steps[-1].heldout
        assert before.one_step_rms > after.one_step_rms  # the first step is free to be neither late nor slow
        assert "lowpass_error" in improvement.steps[0].fit.model.fixed
