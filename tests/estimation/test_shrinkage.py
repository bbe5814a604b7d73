"""Columns of a motion that hardly excites them hold the motion and not noise, so that errors are as large as stated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy

from accelcal.estimation import smoothing
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.smoothing import Shrinkage
from accelcal.io import load
from accelcal.model import Model
from accelcal.signals.processing import Bandwidth
from tests.regimes.regimes import TABLE

RECORDS = 6


def squares(folder: Path) -> np.ndarray:
    """Squared standardised errors of k and the time offset on creep of 1 mm/s, summed over the records."""
    total = np.zeros(2)
    for seed in range(RECORDS):
        record = TABLE["l-creep-cxl02"].build(900 + seed)
        solution = solve_runs(Model.linear(), [load(record.write(folder, f"run{seed}"))])
        results = {e.name: e for e in solution.layout.estimates(solution.x, solution.covariance, solution.model)}
        names = ("scale_factor", "time_offset")
        total += [((results[n].value - record.truth[n]) / results[n].std) ** 2 for n in names]
    return total


def test_errors_on_creep_are_as_large_as_stated(tmp_path, monkeypatch):
    """Chi-square of six records at 1e-4 for each parameter; without shrinkage, and up to the crossover, the delay must
    fail."""
    limit = scipy.stats.chi2.isf(1e-4, RECORDS)
    assert np.all(squares(tmp_path) < limit)
    monkeypatch.setattr(smoothing.Shrinkage, "of", classmethod(lambda cls, *_: None))
    wide = lambda *_, crossover, **__: Bandwidth(0.65 * crossover, 0.65 * crossover)  # noqa: E731
    monkeypatch.setattr(smoothing, "motion_bandwidth", wide)
    assert squares(tmp_path)[1] > limit


def state_of(name: str, seed: int, folder: Path):
    return solve_runs(Model.linear(), [load(TABLE[name].build(seed, seconds=20.0).write(folder))]).states[0]


@pytest.mark.parametrize("name", ["a-random-adxl105", "a-hand-adxl105", "c-phone-100", "a-cosine-servo"])
def test_motion_that_excites_everything_is_left_as_it_is(name, tmp_path):
    s = (state := state_of(name, 3, tmp_path)).signals
    assert Shrinkage.of(s.jerk, 1.0 / s.step, state.run, state.noise, s.cutoff, 0.0) is None


def test_the_motion_passes_and_noise_does_not(tmp_path):
    """A sine of 0.4 Hz in noise of the density that smoothing leaves: kept to 1 %; its jerk alone is ten times less."""
    state = state_of("l-creep-cxl02", 4, tmp_path)
    cutoff, rate, rng = state.signals.cutoff, 16.0 * state.signals.cutoff, np.random.default_rng(1)
    t = np.arange(0.0, 60.0, 1.0 / rate)
    f = np.fft.rfftfreq(len(t), 1.0 / rate)
    density = smoothing.left_density(state.run, state.noise, f) * (f < cutoff)
    phases = rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))
    noise = np.fft.irfft(np.sqrt(density * rate * len(t) / 4.0) * phases, len(t))
    a = 3e-4 * np.sin(2.0 * np.pi * 0.4 * t)
    jerk = np.gradient(a + noise, 1.0 / rate)
    shrinkage = Shrinkage.of(jerk, rate, state.run, state.noise, cutoff, 0.0)
    assert shrinkage is not None
    inside = slice(len(t) // 10, -len(t) // 10)
    assert np.std((shrinkage(a) - a)[inside]) < 0.01 * np.std(a)
    left = np.gradient(shrinkage(a + noise) - a, 1.0 / rate)[inside]
    assert np.std(left) < 0.1 * np.std(np.gradient(noise, 1.0 / rate)[inside])


@pytest.mark.parametrize("edge", [0, 30, 99, 200])
def test_as_many_samples_come_out_as_go_in(edge):
    """A delay of half a record makes its edges longer than what lies between them."""
    y = np.cumsum(np.random.default_rng(2).standard_normal(200))
    shrinkage = Shrinkage(np.linspace(0.0, 50.0, 9), np.ones(9), 100.0, edge)
    assert shrinkage(y).shape == y.shape
    inside = slice(edge if edge < 67 else 67, len(y) - (edge if edge < 67 else 67))
    assert shrinkage(y)[inside] == pytest.approx(y[inside], abs=1e-9)
