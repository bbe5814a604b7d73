"""Slow noise: its spectrum is fitted where there is any, and effects are judged against it."""

from __future__ import annotations

import numpy as np
import pytest

from accelcal.data.arrays import Array
from accelcal.diagnosis.search.scan import scan
from accelcal.diagnosis.search.slow_noise import slow_noise
from accelcal.estimation.noise import whitener
from accelcal.model import Model
from accelcal.simulation.sensor import Simulated
from tests.diagnosis.search.records import fitted
from tests.worlds.coloured import power_law

RATE, CROSSOVER, ROWS = 200.0, 30.0, 8000


def coloured(knee: float, exponent: float, seed: int) -> Array:
    """White rows of variance 1 and noise that equals them at the knee, Hz."""
    rng = np.random.default_rng(seed)
    density = np.sqrt(2.0 / RATE * knee**exponent)
    return rng.standard_normal(ROWS) + power_law(ROWS, RATE, density, exponent, rng)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
def test_the_spectrum_of_slow_noise_is_found(exponent: float) -> None:
    result = slow_noise(coloured(2.0, exponent, 3), RATE, CROSSOVER)
    assert result is not None
    f = np.array([0.2, 0.5, 1.0, 20.0])
    ratio = result(f) / (1.0 + (2.0 / f) ** exponent)
    assert np.all((ratio > 0.5) & (ratio < 2.0))
    assert 1.0 < result.knee < 4.0


def test_white_noise_has_no_slow_part() -> None:
    rng = np.random.default_rng(5)
    results = [slow_noise(rng.standard_normal(ROWS), RATE, CROSSOVER) is not None for _ in range(100)]
    assert sum(results) <= 4  # one in a hundred at most: 5 or more have a probability of 0.3 %


def test_whitened_rows_are_white() -> None:
    y = coloured(2.0, 1.0, 4)
    noise = slow_noise(y, RATE, CROSSOVER)
    assert noise is not None
    assert slow_noise(whitener(noise, RATE)(y[None])[0], RATE, CROSSOVER) is None
    assert slow_noise(whitener(None, RATE)(y[None])[0], RATE, CROSSOVER) is not None


def test_slow_noise_is_not_named_a_function_of_the_motion(plain: Simulated) -> None:
    accel = plain.recording.accel
    rng = np.random.default_rng(7)
    step = float(np.median(np.diff(accel.t)))
    slow = power_law(len(accel.t), 1.0 / step, 3e-3, 1.0, rng)
    result = scan([fitted(plain, lambda t: slow)], Model.linear())
    assert result.slow_noise
    assert {f.effect for f in result.detected} <= {"bias_gauss_markov", "bias_random_walk"}
    motion = plain.truth.motion
    both = scan([fitted(plain, lambda t: slow + 2e-3 * motion.acceleration(t) ** 3)], Model.linear())
    assert any("cubic" in f.members for f in both.detected)  # the twin: what is larger than the noise is found
