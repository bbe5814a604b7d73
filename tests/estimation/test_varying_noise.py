"""Noise that grows along a record: the likelihood finds both shares, and the parameters of the mean know of it."""

import numpy as np
import pytest

import accelcal as ac
from accelcal.effects import found_by
from accelcal.estimation.drive import DriveIntegrals, run_filter
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.noise import VarianceFunction, most_likely, with_growth
from accelcal.estimation.run_state import RunState
from accelcal.estimation.values import Noise, NoiseGrowth
from accelcal.simulation import ADXL105_RIG

GROWS = found_by("noise over speed")


@pytest.fixture(scope="module")
def state() -> RunState:
    """A simulated run, for its settings alone."""
    rng = np.random.default_rng(3)
    simulation = ac.simulate("tones", seconds=40.0, rig=ADXL105_RIG, parameters={}, rng=rng)
    return solve_runs(ac.Model.linear(), [simulation.recording]).states[0]


def drawn(state: RunState, noise: Noise, function: VarianceFunction, rng: np.random.Generator) -> DriveIntegrals:
    """Readings of the two-state model itself, with noise that grows as stated: an exact draw."""
    plain = state.drive
    t, growth = plain.t, noise.growth[0]
    h = np.diff(t, prepend=t[0])
    q, r = noise.q + growth.q * function.before, noise.r + growth.r * function.at
    p, v, z = 0.0, 0.0, np.empty(len(t))
    a, b = rng.standard_normal((2, len(t)))
    for k in range(len(t)):
        p += h[k] * v + np.sqrt(q[k] * h[k] ** 3) * (a[k] / 2.0 + b[k] / np.sqrt(12.0))
        v += np.sqrt(q[k] * h[k]) * a[k]
        z[k] = p
    z += np.sqrt(r) * rng.standard_normal(len(t))
    zero = np.zeros(len(t))
    return DriveIntegrals(t, z, zero, zero, np.arange(len(t)) == 0, zero)


def test_both_shares_are_found_and_innovations_are_white_and_even(state):
    """Against the model itself: shares within 25 %, ten bins of innovations even (p > 1e-4), the twin uneven."""
    rng = np.random.default_rng(5)
    t = state.drive.t
    h = 1.0 + np.sin(0.7 * t) + 0.3 * np.sin(3.1 * t)
    function = VarianceFunction(GROWS, np.maximum(h, 0.0), np.maximum(h, 0.0))
    true = Noise(2e-6, 1e-12, (NoiseGrowth(GROWS, 8e-6, 4e-12),))
    record = drawn(state, true, function, rng)
    start = Noise(4e-6, 2e-12, (NoiseGrowth(GROWS),))
    result = most_likely(state.run, record, start, [function])
    for estimate, other in ((result, true), (result.growth[0], true.growth[0])):
        assert estimate.q == pytest.approx(other.q, rel=0.25)
        assert estimate.r == pytest.approx(other.r, rel=0.25)

    def unevenness(noise: Noise) -> float:
        track = run_filter(state.run, with_growth(record, noise, [function]), noise)
        y = (track.series("e") ** 2 / track.series("S"))[500:]
        bins = np.array_split(y[np.argsort(function.at[500:], kind="stable")], 10)
        return float(sum((estimate.mean() - 1.0) ** 2 / (2.0 / len(estimate)) for estimate in bins))

    assert unevenness(result) < 35.6  # chi-square with 10 degrees of freedom at 1e-4
    assert unevenness(Noise(result.q + 8e-6, result.r + 4e-12, (NoiseGrowth(GROWS),))) > 35.6


def test_growth_scales_with_its_noise():
    noise = Noise(2.0, 3.0, (NoiseGrowth(GROWS, 4.0, 5.0),)).scaled(10.0, 100.0)
    assert (noise.q, noise.r, noise.growth[0].q, noise.growth[0].r) == (20.0, 300.0, 40.0, 500.0)


def test_a_variance_that_is_the_same_all_along_does_not_grow(state):
    constant = found_by("reading outliers")
    noise = Noise(1e-6, 1e-12, (NoiseGrowth(constant), NoiseGrowth(GROWS)))
    from accelcal.estimation.noise import variance_functions

    assert [f.effect.name for f in variance_functions(state.run, noise, state.signals)] == [GROWS.name]
    assert variance_functions(state.run, noise, None) == []
