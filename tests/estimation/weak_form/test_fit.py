"""A fit by the weak form, from recording to verdict: what the replay finds, it finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import RecordingError
from accelcal.data.rig import ChannelFilter
from accelcal.diagnosis.independent_estimate import differences
from accelcal.estimation.engines import ENGINES
from accelcal.estimation.estimate import solve_runs
from accelcal.results import model_file
from accelcal.simulation import CXL02_RIG
from tests.hostile.case import case_rng

TRUTH = {"bias": 0.05, "cubic": 1e-3}


def recording(number: int, motion: str = "interleaved", rig: ac.Rig = CXL02_RIG, seconds: float = 20.0) -> ac.Recording:
    rng = case_rng("fit by the weak form", number)
    return ac.simulate(motion, seconds=seconds, rig=rig, parameters=TRUTH, rng=rng).recording


def apart(fit: ac.Fit, other: ac.Fit) -> np.ndarray:
    """Differences of two fits in standard deviations of the first."""
    return np.array([(b.value - a.value) / a.std for a, b in zip(fit.free, other.free, strict=True)])


def test_the_loop_by_the_weak_form(tmp_path) -> None:
    several = [recording(0), recording(1, "moves")]
    fit = ac.fit(several, method="weak")
    assert fit.method == "weak"
    model_file.save(fit, tmp_path / "m.json")
    remaining = model_file.load(tmp_path / "m.json")
    diagnosis = ac.diagnose(remaining, several)
    assert (diagnosis.effects, diagnosis.fit.method) == (("cubic",), "weak")
    grown = ac.add(remaining, several, "cubic")
    assert grown.method == "weak"
    assert abs(grown["cubic"].value - TRUTH["cubic"]) < 4.0 * grown["cubic"].std
    assert ac.diagnose(grown, several).verdict == "adequate"
    moved = apart(ac.fit(several, grown.model), grown)
    print(f"from the replay by {np.abs(moved).max():.2f} standard deviations (0.3)")
    assert np.max(np.abs(moved)) < 0.3


def test_a_fit_by_the_weak_form_is_checked_by_the_replay() -> None:
    solution = solve_runs(ac.Model.linear().add("cubic"), [recording(2)], engine=ENGINES["weak"])
    result = differences(solution)
    values = dict(zip([term.name for term, _ in solution.layout.slots], solution.x, strict=True))
    assert {"scale_factor", "time_offset"} <= {item.name for item in result} <= set(values)
    assert all(item.weak == values[item.name] != item.replay for item in result)
    assert max(abs(item.sigma) for item in result) < 4.0


def test_a_clock_from_1970_changes_nothing() -> None:
    here = recording(3)
    accel, position = (replace(channel, t=channel.t + 1.7e9) for channel in (here.accel, here.position))
    there = replace(here, accel=accel, position=position)
    fits = [ac.fit(data, method="weak") for data in (here, there)]
    moved = apart(*fits)
    print(f"moved by {np.abs(moved).max():.1e} standard deviations")
    assert np.max(np.abs(moved)) < 0.05


def test_repeated_counts_of_a_coarse_encoder_count_a_few_times() -> None:
    rig = replace(CXL02_RIG, resolution=2e-5)
    state = solve_runs(ac.Model.linear(), [recording(4, "moves", rig)], engine=ENGINES["weak"]).states[0]
    assert state.run.rounding > 0.0
    assert state.run.read is None
    fits = [ac.fit(recording(4, "moves", rig), method=method) for method in ("replay", "weak")]
    assert np.max(np.abs(apart(*fits))) < 1.5


def test_a_run_without_a_weak_form_is_refused_in_a_sentence() -> None:
    rig = replace(CXL02_RIG, output_filters=(ChannelFilter("RC", "highpass", 0.5),))
    with pytest.raises(RecordingError, match=r"no weak form: the output has passed a high-pass.*--method replay"):
        ac.fit(recording(5, "moves", rig), method="weak")


@pytest.mark.parametrize("method", ["weak", "replay"])
def test_a_model_without_a_free_coefficient_is_refused(method: str) -> None:
    simulation = ac.simulate(
        "moves", seconds=5.0, rig=CXL02_RIG, parameters={"bias": 0.0}, rng=np.random.default_rng(3)
    )
    held = ac.Model.linear().freeze(bias=0.0, scale_factor=0.0, time_offset=0.0)
    with pytest.raises(ValueError, match="no coefficient of the model is free: set one free to fit it"):
        ac.fit(simulation.recording, held, method=method)
