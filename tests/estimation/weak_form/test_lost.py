"""Readings that an even clock lost: filled from their neighbours, sums and covariances stay exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel
from accelcal.estimation.weak_form.channel import NEIGHBOURS, SampledChannel, Splines, from_neighbours
from accelcal.simulation import CXL02_RIG
from tests.hostile.case import case_rng

STEP = 1.0 / 833.0
SPLINES = Splines(0.1, 2.0 * STEP, 300)


def lost(share: float, n: int = 1200) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the ticks that are left, and their times."""
    rng = case_rng("lost readings", round(100 * share))
    there = rng.random(n) >= share
    there[[0, -1]] = True
    number = np.flatnonzero(there)
    return number, STEP * number


def test_polynomials_are_filled_exactly():
    number, _ = lost(0.3)
    filled = from_neighbours(number, 1200)
    x = np.linspace(-1.0, 1.0, 1200)
    for degree in range(2 * NEIGHBOURS):
        np.testing.assert_allclose(filled @ x[number] ** degree, x**degree, atol=1e-12)
    beyond = x ** (2 * NEIGHBOURS)
    assert np.max(np.abs(filled @ beyond[number] - beyond)) > 1e-15


def test_the_weights_of_the_samples_are_those_of_the_sums():
    """By what white noise in the samples makes of the sums: their variance is that of the weights."""
    number, t = lost(0.1)
    rng = case_rng("lost readings", 1)
    draws, result = [], None
    for _ in range(400):
        noise = rng.standard_normal(len(t))
        channel = SampledChannel.of(t, noise, STEP, 1.0 / SPLINES.step)
        assert channel.ticks is not None
        assert len(channel.ticks) == number[-1] + 1
        rows, result = channel.against(SPLINES, 2)
        draws.append(channel.sums(SPLINES, 2, result, rows))
    variance = np.asarray(result.multiply(result).sum(axis=1)).ravel()
    ratio = float(np.mean(np.var(draws, axis=0) / variance))
    print(f"variance over that of the weights: {ratio:.3f} (0.97 to 1.03)")
    assert 0.97 < ratio < 1.03


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_lost_readings_cost_what_they_tell_and_no_more(share):
    """The weak form is as sure as the replay, which a lost reading does not stop."""
    rng = case_rng("lost readings of a record", round(100 * share))
    simulation = ac.simulate("interleaved", seconds=20.0, rig=CXL02_RIG, parameters={"bias": 0.05}, rng=rng).recording
    remaining = rng.random(len(simulation.position.t)) >= share
    position = Channel("position", simulation.position.t[remaining], simulation.position.y[remaining], "m")
    recording = replace(simulation, position=position)
    weak, replay = (ac.fit(recording, method=item) for item in ("weak", "replay"))
    for name in ("scale_factor", "bias"):
        ratio = weak[name].std / replay[name].std
        print(f"{name}: {ratio:.3f} of the replay (0.95 to 1.05)")
        assert 0.95 < ratio < 1.05
        assert abs(weak[name].value - replay[name].value) < 0.5 * replay[name].std
