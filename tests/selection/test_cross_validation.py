"""Blocked cross-validation: equal to fits without each block, it refuses what harms and spares what is true."""

import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel
from accelcal.diagnosis.select.cross_validation import (
    PairedChange,
    alike,
    belongs_to_its_time,
    cross_validate,
    drift_rows,
    left_out,
    paired,
    pieces,
    refusing,
    rows_of,
)
from accelcal.effects import find
from accelcal.estimation.columns import whitened_columns
from accelcal.estimation.estimate import solve_runs
from accelcal.simulation import CXL02_RIG

BASE = {"bias": 0.05, "scale_factor": 0.01}


def record(seed, motion="interleaved", random_walk=0.0, coulomb=0.0, **truth):
    """A record of 40 s; `random_walk` is the density of a random walk of the bias, (m/s²)/sqrt(s)."""
    rng = np.random.default_rng(seed)
    simulated = ac.simulate(motion, seconds=40.0, rig=CXL02_RIG, parameters={**BASE, **truth}, rng=rng)
    changed, t = simulated.recording, simulated.recording.accel.t
    if coulomb:
        friction = coulomb * np.sign(simulated.truth.motion.velocity(t))
        changed = dataclasses.replace(changed, accel=Channel("accel", t, changed.accel.y + friction, "m/s²"))
    if not random_walk:
        return changed
    added = random_walk * np.cumsum(rng.standard_normal(len(t))) * np.sqrt(np.median(np.diff(t)))
    return dataclasses.replace(changed, accel=Channel("accel", t, changed.accel.y + added, "m/s²"))


def fitted(recordings, *names, **shapes):
    return solve_runs(ac.Model.linear().add(*names, shapes=shapes), recordings)


def test_leaving_a_block_out_equals_a_fit_without_it():
    solution = fitted([record(1, cubic=1e-3)], "cubic")
    (state,) = solution.states
    terms = solution.model.free
    fine, _, readings = pieces(state, terms, rows_of(solution, 0, 0), len(terms), 16)
    blocks = alike(readings, np.zeros(len(readings)), 1, 16)
    grams = np.add.reduceat(fine, blocks)
    result, _ = left_out(
        grams, (grams, grams), np.ones(len(terms), dtype=bool), np.zeros(len(terms)), np.zeros(len(terms))
    )
    X = np.concatenate([columns for _, columns in whitened_columns(state, terms)])
    y, t = state.whitened[state.counts], state.run.t[state.counts]
    edges = np.quantile(t, np.linspace(0.0, 1.0, len(grams) + 1))
    block = np.clip(np.searchsorted(edges[1:-1], t, side="right"), 0, len(grams) - 1)
    for number in (0, 7, 15):
        inside = block == number
        x = np.linalg.lstsq(X[~inside], y[~inside], rcond=None)[0]
        alone = np.sum((y[inside] - X[inside] @ x) ** 2)
        assert result[number] == pytest.approx(alone, rel=1e-6)


@pytest.mark.parametrize("name", ["velocity", "quadratic"])
def test_what_follows_slow_noise_only_predicts_no_other_block_and_is_refused(name):
    # Four of six seeds refuse all of four such effects; the seed is fixed.
    changes = cross_validate(fitted([record(2, random_walk=3e-3)], name), (name,))
    assert refusing(changes) is not None
    assert all(change.sigma > 0.0 for change in changes)


@pytest.mark.parametrize("truth", [{"cubic": 4e-4}, {"coulomb": 2e-3}, {"quadratic": 1e-4}])
def test_a_true_effect_lets_the_error_fall_and_enters(truth):
    (name,) = truth
    changes = cross_validate(fitted([record(3, **truth)], name), (name,))
    assert [change.measure for change in changes] == ["one-step error", "drift"]
    assert refusing(changes) is None
    assert changes[0].sigma < -1.5


def test_two_runs_are_cut_into_blocks_together():
    runs = [record(4, quadratic=1e-3), record(5, quadratic=1e-3)]
    step, drift = cross_validate(fitted(runs, "quadratic"), ("quadratic",))
    assert step.blocks == 16
    assert step.sigma < -3.0
    assert drift.ratio < 0.9


def test_blocks_share_time_and_power_alike():
    readings, energy = np.full(256, 10.0), np.zeros(256)
    energy[100:104] = 1.0  # of the first run; the second run shows nothing of the effect
    blocks = alike(readings, energy, 2, 16)
    sums = np.add.reduceat(energy, blocks)
    assert len(blocks) == len(np.unique(blocks)) <= 32
    assert 128 in blocks
    assert np.max(sums) <= 1.0  # a piece is the least that a block can be
    assert np.max(np.diff([*blocks, 256])) <= 17  # and twice the average length the most
    even = alike(readings, np.zeros(256), 2, 16)
    assert np.all(np.diff(even) == 8)


def burst(seed, **truth):
    """A record of 40 s whose motion comes in bursts."""
    rng = np.random.default_rng(seed)
    recording = ac.simulate("bursts", seconds=40.0, rig=CXL02_RIG, parameters={**BASE, **truth}, rng=rng).recording
    return recording


def test_an_effect_that_a_burst_shows_is_spread_over_blocks():
    changes = cross_validate(fitted([burst(7, cubic=4e-4)], "cubic"), ("cubic",))
    print(changes)
    assert changes[0].spread > 4.0
    assert refusing(changes) is None


def test_an_effect_of_one_block_is_not_refused_for_that():
    # Without its block nothing determines it; the difference is as large as its own scatter.
    rng = np.random.default_rng(1)
    rows, blocks = 50, 16
    X = rng.standard_normal((blocks, rows, 2))
    X[np.arange(blocks) != 3, :, 1] = 0.0
    y = X @ np.array([0.0, 0.5]) + rng.standard_normal((blocks, rows))
    whole = np.concatenate([X, y[:, :, None]], axis=2)
    grams = np.einsum("bri,brj->bij", whole, whole)
    with_it, _ = left_out(grams, (grams, grams), np.array([True, True]), np.zeros(2), np.zeros(2))
    without, _ = left_out(grams, (grams, grams), np.array([True, False]), np.zeros(2), np.zeros(2))
    assert with_it[3] == pytest.approx(without[3])  # an undetermined coefficient stays at zero
    assert np.allclose(np.delete(with_it, 3), np.delete(without, 3), rtol=0.2)


def test_a_rise_is_refused_and_a_fall_or_a_scatter_is_not():
    rises = PairedChange("drift", 1.0, 1.5, 0.1, 16, 0.05, 8.0)
    small = PairedChange("drift", 1.0, 1.05, 0.01, 16, 0.05, 8.0)  # 2.5 % of the rms
    falls = PairedChange("one-step error", 1.0, 0.9, 0.02, 16, 0.0, 8.0)
    scatters = PairedChange("one-step error", 1.0, 1.1, 0.1, 16, 0.0, 1.2)
    assert rises.rises
    assert not any(item.rises for item in (small, falls, scatters))
    level = PairedChange("one-step error", 1.0, 0.99, 0.1, 16, 0.0, 8.0)
    assert refusing([level, rises]) is rises
    assert refusing([falls, rises]) is None  # the drift alone refuses nothing
    assert refusing([falls, small]) is None
    assert refusing([scatters]) is None  # one block holds it: that says nothing
    assert refusing([]) is None


@pytest.mark.parametrize(
    ("name", "shapes"), [("bias_step", {"instant": 17.0}), ("scale_step", {"instant": 17.0}), ("warm_up", {"tau": 5.0})]
)
def test_what_belongs_to_its_time_is_fitted_anew_in_each_block(name, shapes):
    # It predicts no other block; what it does to all other coefficients counts, and nothing becomes worse by it here.
    changes = cross_validate(fitted([record(6, random_walk=3e-4)], name, **{name: shapes}), (name,))
    assert all(change.ratio < 1.02 for change in changes)
    assert refusing(changes) is None


def test_effects_of_one_instant_or_of_time_are_recognised():
    exempt = {"bias_step", "warm_up", "bias_drift", "bias_gauss_markov", "time_offset_step", "shape_of_time", "creep"}
    judged = {"cubic", "coulomb", "rail_wave", "encoder_nonlinearity", "shape_of_position", "hysteresis", "sensor_lag"}
    assert all(belongs_to_its_time(find(name)) for name in exempt)
    assert not any(belongs_to_its_time(find(name)) for name in judged)


def test_a_change_has_its_standard_error_from_two_blocks_on():
    before, after = np.array([4.0, 9.0, 6.0]), np.array([3.0, 6.0, 7.0])
    changes = [paired("prediction", before, after, np.arange(3) < count, 0.0, 0.0) for count in range(4)]
    assert [change.blocks for change in changes] == [0, 1, 2, 3]
    assert [change.std for change in changes] == [np.inf, np.inf, pytest.approx(1.0), pytest.approx(2.0 / np.sqrt(3.0))]
    assert (changes[2].before, changes[2].after) == (6.5, 4.5)


def test_drifts_are_those_of_second_differences_a_quarter_of_a_horizon_apart():
    """Of three readings each, and every stretch of the record is in eight of them."""
    state = fitted([record(19)]).states[0]
    t, columns = drift_rows(state, (), 2.0)
    np.testing.assert_allclose(np.diff(t), 0.5, rtol=1e-9)
    assert (t[0], t[-1]) == pytest.approx((state.run.t[0] + 2.0, state.run.t[-1] - 2.0), abs=0.5)
    assert columns.shape == (len(t), 1)
