"""Rows of the weak form: white where the model is right, and of the same information as those of the replay."""

from __future__ import annotations

import weakref
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import scipy

import accelcal as ac
from accelcal.data.rig import ChannelFilter
from accelcal.effects.registry import find
from accelcal.estimation import engines
from accelcal.estimation.engines import ENGINES, sums_of, whole_columns, with_noise
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.values import Noise
from accelcal.estimation.weak_form import rows as weak
from accelcal.estimation.weak_form.covariance import NoWeakForm, factor, solved
from accelcal.estimation.weak_form.rows import WeakRows, refined
from accelcal.model import Term, terms_of
from accelcal.simulation import CXL02_RIG
from tests.hostile.case import case_rng

MODEL = ac.Model.linear().add("cubic")
TRUTH = {"bias": 0.05, "scale_factor": 0.01, "cubic": 1e-3}
MOTIONS = ("interleaved", "tones", "moves")


def recording(motion: str, number: int, rig: ac.Rig = CXL02_RIG) -> ac.Recording:
    rng = case_rng(f"weak form {motion}", number)
    return ac.simulate(motion, seconds=30.0, rig=rig, parameters=TRUTH, rng=rng).recording


@cache
def solution(motion: str, number: int = 0) -> Solution:
    return solve_runs(MODEL, [recording(motion, number)])


def gap(channel: ac.Channel, begin: float, end: float) -> ac.Channel:
    remaining = (channel.t < begin) | (channel.t > end)
    return replace(channel, t=channel.t[remaining], y=channel.y[remaining])


@pytest.mark.parametrize("motion", MOTIONS)
def test_innovations_are_white_and_of_unit_variance(motion: str) -> None:
    rows = WeakRows(solution(motion).states[0])
    y, n = rows.whitened, rows.rows
    variance, correlation = float(np.mean(y**2)), float(np.mean(y[1:] * y[:-1]))
    # Noise was estimated by the replay, whose own innovations leave it to a few per cent.
    print(f"{motion}: variance {variance:.3f} (0.9 to 1.1), correlation of neighbours {correlation:+.3f} of {n} rows")
    assert 0.9 < variance < 1.1
    assert abs(correlation) < 5.0 / np.sqrt(n)


def test_noise_that_is_not_that_of_the_rows_is_seen() -> None:
    state = solution("moves").states[0]
    rows = WeakRows(state)
    wrong = rows.at_noise(replace(state.noise, r=4.0 * state.noise.r)).whitened
    assert float(np.mean(wrong**2)) < 0.8


@pytest.mark.parametrize("motion", MOTIONS)
def test_estimates_and_uncertainties_are_those_of_the_replay(motion: str) -> None:
    """A step from the estimates of the replay at the noise of the weak form's own likelihood goes nowhere."""
    result = solution(motion)
    rows = with_noise(WeakRows(result.states[0]))
    X, y = whole_columns(rows, result.model.free), rows.whitened
    covariance = np.linalg.inv(X @ X.T)
    std = np.sqrt(np.diag(result.covariance))
    moved, ratio = covariance @ (X @ y) / std, np.sqrt(np.diag(covariance)) / std
    print(f"{motion}: moved by {np.abs(moved).max():.3f} standard deviations (0.3), ratio {np.round(ratio, 3)} (5 %)")
    assert np.max(np.abs(moved)) < 0.3
    assert np.all(np.abs(ratio - 1.0) < 0.05)


def test_the_covariance_is_that_of_drawn_noise() -> None:
    """Sums of drawn samples, over many draws, have the covariance that is claimed for them."""
    state = solution("interleaved").states[0]
    rows, draws, rng = WeakRows(state), 400, case_rng("weak form drawn", 0)
    part = slice(0, 200)
    samples, of_output = rows._of_output(part, 0.0)
    readings, of_readings = rows._of_readings(part, rows.order)
    q, r, step = state.noise.q, state.noise.r, state.run.accel_step
    noise = of_readings @ rng.normal(0.0, np.sqrt(r), (readings.stop - readings.start, draws))
    noise -= of_output @ rng.normal(0.0, np.sqrt(q / step), (samples.stop - samples.start, draws))
    whitened = solved(factor(rows.covariance.part(part).at(q, r)), noise)
    chi2 = float(np.sum(whitened**2))
    low, high = scipy.stats.chi2.ppf([1e-4, 1.0 - 1e-4], whitened.size)
    print(f"chi-square {chi2:.0f} of {whitened.size} ({low:.0f} to {high:.0f})")
    assert low < chi2 < high


def test_stretches_are_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums, covariance, innovations and columns do not depend on how many test functions are taken together."""
    simulation = recording("moves", 1)
    broken = replace(simulation, position=gap(simulation.position, 10.0, 11.0), accel=gap(simulation.accel, 20.0, 20.5))
    state = solve_runs(MODEL, [broken]).states[0]
    monkeypatch.setattr(weak, "TOGETHER", 10**6)
    rows = WeakRows(state)
    terms = [*with_memory("self_heating", "encoder_lag"), *MODEL.terms, *with_memory("hysteresis")]
    X, y = whole_columns(rows, terms), rows.whitened
    monkeypatch.setattr(weak, "TOGETHER", 500)
    monkeypatch.setattr(weak, "MOST_READINGS", 2000)
    monkeypatch.setattr(weak, "MOST_SUMS", 3 * rows.rows // 2)
    again = WeakRows(state)
    parts = list(again.stretches(terms))
    assert len(parts) > 8
    assert np.allclose(again.whitened, y, rtol=0.0, atol=1e-6)
    assert np.allclose(np.concatenate([part for _, part in parts], axis=1), X, rtol=1e-6, atol=1e-6)


def with_memory(*names: str) -> list[Term]:
    """Terms of effects with memory at some value of their first shape parameter."""
    shapes = {name: dict.fromkeys(find(name).shapes, 0.0) | {next(iter(find(name).shapes)): 1e-3} for name in names}
    return [term for name in names for term in terms_of(find(name), shapes[name])]


def test_an_effect_with_memory_is_evaluated_once_for_many_stretches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over the whole record, whatever their number: the time of a long record is linear in its length."""
    rows, times = WeakRows(solution("moves").states[0]), []
    lag = find("encoder_lag")
    counted = replace(lag, function=lambda s, tau: times.append(len(s.t)) or lag.function(s, tau))
    terms = terms_of(counted, {"tau": 1e-3})
    monkeypatch.setattr(weak, "MOST_READINGS", 2000)
    assert len(list(rows.stretches(terms))) > 8
    assert times == [len(rows.state.run.all_readings[0])]
    monkeypatch.setattr(weak, "MOST_SUMS", rows.rows // 3)  # memory for no more than a third of its column
    times.clear()
    list(rows.stretches(terms))
    assert 3 <= len(times) <= 5


def test_even_clocks_have_the_same_covariance_all_along(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is found from a few rows, and is that of all; of uneven stamps, or beside a break, it is not taken for so."""
    simulation = recording("moves", 3)
    state = solve_runs(MODEL, [simulation]).states[0]
    covariance = WeakRows(state).covariance
    assert covariance.of_output.strides[1] == covariance.of_readings.strides[1] == 0
    stamps = simulation.accel.t + case_rng("weak form stamps", 3).uniform(-3e-5, 3e-5, len(simulation.accel.t))
    for other in (
        replace(simulation, accel=replace(simulation.accel, t=stamps)),
        replace(simulation, position=gap(simulation.position, 10.0, 11.0)),
    ):
        assert WeakRows(solve_runs(MODEL, [other]).states[0]).covariance.of_output.strides[1] != 0
    monkeypatch.setattr(weak, "constant_diagonals", lambda diagonals: None)
    summed = WeakRows(state).covariance
    assert summed.of_output.strides[1] != 0
    noise, y = (state.noise.q, state.noise.r), WeakRows(state).raw[:, None]
    first, second = (solved(factor(item.at(*noise)), y) for item in (covariance, summed))
    assert np.allclose(first, second, rtol=0.0, atol=1e-6)


def test_a_run_and_the_rows_that_it_holds_are_freed_together() -> None:
    """Without waiting for a collection of cycles, which for an hour of record comes too late."""
    state = solve_runs(MODEL, [recording("moves", 0)], engine=ENGINES["weak"]).states[0]
    held = weakref.ref(sums_of(state))
    assert isinstance(held(), WeakRows)
    del state
    assert held() is None


def test_no_row_crosses_a_break() -> None:
    simulation = recording("moves", 1)
    broken = replace(simulation, position=gap(simulation.position, 10.0, 11.0), accel=gap(simulation.accel, 20.0, 20.5))
    rows = WeakRows(solve_runs(MODEL, [broken]).states[0])
    half = 0.5 * rows.splines.support
    for begin, end in ((10.0, 11.0), (20.0, 20.5)):
        inside = (rows.times + half > begin + 0.01) & (rows.times - half < end - 0.01)
        assert not np.any(inside)
    assert rows.rows > 0.8 * rows.splines.count
    assert abs(float(np.mean(rows.whitened**2)) - 1.0) < 0.1


def test_a_run_behind_a_high_pass_has_none() -> None:
    rig = replace(CXL02_RIG, output_filters=(ChannelFilter("RC", "highpass", 0.5),))
    state = solve_runs(ac.Model.linear(), [replace(recording("moves", 2), rig=rig)]).states[0]
    with pytest.raises(NoWeakForm, match="high-pass"):
        WeakRows(state)


def test_a_refined_grid_holds_cubics() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    fine, matrix = refined(t, 3)
    assert np.allclose(matrix @ (t**3 - t), fine**3 - fine, atol=1e-13)


def test_nothing_to_divide_never_reaches_lapack(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a row, or with more rows than the factor has, dtbtrs writes where it must not."""

    def refused(*given: object, **named: object) -> None:
        raise AssertionError("dtbtrs was called")

    monkeypatch.setattr(scipy.linalg.lapack, "dtbtrs", refused)
    assert solved(np.empty((10, 0)), np.empty((0, 3))).shape == (0, 3)
    assert solved(np.ones((10, 2)), np.empty((2, 0))).shape == (2, 0)
    with pytest.raises(ValueError, match="2 rows of a factor, 1 of what it divides"):
        solved(np.ones((10, 2)), np.ones((1, 3)))


@pytest.mark.parametrize(
    ("declared", "measured", "density"),
    [
        (2.0, None, 0.5 * (2.0 / 1.25) ** 2),  # one-sided, of the output; the noise is that of the acceleration
        (40.0, None, 0.9 * 12.0),  # more than there is
        (None, (50.0, 1e-3), 12.0 - 50.0 / 50.0),
        (None, (5e3, 1e-3), 0.01 * 12.0),  # all of it in the readings
        (None, (0.5, 1e3), 6.0),  # not known
    ],
)
def test_noise_of_two_accelerations_adds_up_to_what_the_innovations_have(declared, measured, density, monkeypatch):
    rate, both = 50.0, 12.0
    rows = SimpleNamespace(
        state=SimpleNamespace(
            run=SimpleNamespace(rig=SimpleNamespace(sensor=SimpleNamespace(noise=declared))),
            values=SimpleNamespace(scale=1.25),
        ),
        reading_step=1.0 / rate,
        whitened=np.tile([2.0, -2.0], 100),
        noise=Noise(q=1.0, r=2.0 * rate),
    )
    monkeypatch.setattr(engines, "common_variance", lambda rows: measured)
    noise = engines.shared(rows)
    assert noise.q == pytest.approx(density)
    assert noise.q + noise.r / rate == pytest.approx(both)


def test_noise_that_two_records_share_has_the_scatter_of_its_blocks():
    """Standard deviation of 200 deviations within the 99 % interval of chi-square. Weights from the same blocks take
    3 % of the shared variance where rows are as few as here: less than 1.5 of its standard deviations."""
    rng, deviations = np.random.default_rng(31), []
    for _ in range(200):
        shared, raw, read = rng.standard_normal((3, 64 * engines.FEWEST_ROWS)) * [[2.0], [3.0], [1.0]]
        covariance = SimpleNamespace(of_readings=[np.full(4, 2.0)])  # of one unit of the readings' variance
        rows = SimpleNamespace(rows=len(raw), raw=raw + shared, reference_sums=read + shared, covariance=covariance)
        r, std = engines.common_variance(rows)
        deviations.append((r - 2.0) / std)
    print(f"{np.std(deviations):.3f}, {np.mean(deviations):.3f}")
    assert 0.87 < np.std(deviations) < 1.13
    assert abs(np.mean(deviations)) < 1.5
