"""A fit with further effects: it begins at the states of another one, and allows for the choice of what it adds."""

from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal import verbs
from accelcal.calibration.export.calibration import calibrate
from accelcal.estimation import run_state
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.gauss_newton import ROUNDS_OF_GROWN, estimated, initial_states
from accelcal.estimation.rows import normal_equations
from accelcal.model import Model
from accelcal.simulation.sensor import CXL02_RIG, simulate


@pytest.fixture(scope="module")
def linear():
    rng = np.random.default_rng(2)
    truth = {"bias": 0.05, "quadratic": 1e-3}
    recording = simulate("interleaved", seconds=30.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording
    return solve_runs(Model.linear(), [recording])


def test_it_ends_where_a_fit_of_its_own_does_and_runs_the_filter_less_often(linear, monkeypatch):
    filtered, run_filter = [], run_state.run_filter
    monkeypatch.setattr(run_state, "run_filter", lambda run, *more: (filtered.append(run), run_filter(run, *more))[1])
    model = linear.model.add("quadratic")
    separate = estimated(model, initial_states(model, [state.run for state in linear.states], [None]))
    alone = len(filtered)
    grown = estimated(model, [state.grown(model) for state in linear.states], least=ROUNDS_OF_GROWN)
    std = np.sqrt(np.diag(separate.covariance))
    assert np.all(np.abs(grown.x - separate.x) < 0.05 * std)  # both stop at a hundredth, the noise a little apart
    np.testing.assert_allclose(np.sqrt(np.diag(grown.covariance)), std, rtol=0.02)
    assert len(filtered) - alone < alone
    assert abs(grown.x[-1] / std[-1]) > 10.0  # and there is something to find


def test_its_first_step_uses_filter_and_signals_of_the_other(linear):
    model = linear.model.add("quadratic")
    state = linear.states[0]
    grown = state.grown(model)
    assert grown.filtered is state.filtered
    assert grown.values.by_name == {**state.values.by_name, "quadratic": 0.0}
    gram = normal_equations(grown, model.free).gram
    assert gram.shape == (len(model.free), len(model.free))
    np.testing.assert_array_equal(gram[:-1, :-1], normal_equations(state, linear.model.free).gram)


WEAK = 5.5e-5
"""Cubic, (m/s²)⁻², that 12 s of the record below name at about five standard deviations, where 4.2 are needed."""


def cubic_record(size: float, seed: int) -> ac.Recording:
    truth = {"bias": 0.05, "cubic": size}
    rng = np.random.default_rng(seed)
    return simulate("interleaved", seconds=12.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording


def allowances(fit: ac.Fit) -> list[str]:
    return [str(note.values["effect"]) for note in fit.remarks if note.code == "chosen"]


def test_the_size_of_an_effect_that_the_recording_named_allows_for_that_choice(tmp_path: Path) -> None:
    recording = cubic_record(WEAK, 3)
    named = ac.add(ac.fit(recording), recording, "cubic")
    assert allowances(named) == ["cubic"]
    raw, allowed = named["cubic"], named.given_choice["cubic"]
    assert raw.value - raw.std < allowed.value < raw.value
    assert allowed.std > raw.std
    shift = named.given_choice["scale_factor"].value - named["scale_factor"].value
    i, j = ([e.name for e in named.free].index(name) for name in ("scale_factor", "cubic"))
    slope = named.covariance[i, j] / named.covariance[j, j]
    assert shift == pytest.approx(slope * (allowed.value - raw.value))
    (row,) = (row for row in named.table().rows if row["name"] == "cubic")
    assert row["value"] == allowed.value
    named.save(tmp_path / "m.json")
    again = ac.load_model(tmp_path / "m.json")
    assert again.given_choice["cubic"].value == pytest.approx(allowed.value)
    assert calibrate(again).fit["cubic"].value == pytest.approx(allowed.value)
    more = ac.add(again, recording, "quadratic")
    assert "cubic" in allowances(more)
    assert allowances(ac.drop(more, recording, "quadratic")) == ["cubic"]
    assert allowances(ac.drop(named, recording, "cubic")) == []


@pytest.mark.parametrize("size", [2.5e-5, 2e-4])
def test_a_size_that_no_choice_has_changed_is_the_estimate(size: float) -> None:
    """It is not named at 2, and at 18 standard deviations the choice makes no difference."""
    recording = cubic_record(size, 3)
    fit = ac.add(ac.fit(recording), recording, "cubic")
    assert not allowances(fit)
    assert fit.given_choice is fit


def test_a_refit_is_remembered_with_its_recording():
    recording = cubic_record(WEAK, 3)
    named = ac.add(ac.fit(recording), recording, "cubic")
    again = verbs.refit(named, recording, named.model.freeze(time_offset=0.0))
    assert allowances(again) == ["cubic"]
    assert [source() for source in verbs._fitted_to[id(again)]] == [recording]
