"""A resting coarse encoder gives an interval, not hundreds of measurements; where noise dithers, nothing changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal import improve
from accelcal.data.recording import Channel
from accelcal.diagnosis.noise.noise_test import POSITION_JUMPS
from accelcal.estimation import run as runs
from accelcal.estimation.readings import distinct_readings
from accelcal.estimation.run import PreparedRun, prepare
from accelcal.io import load
from tests.regimes.regimes import TABLE

COUNT = 20e-6
T = np.arange(4000) / 833.0


def rests(sigma: float) -> np.ndarray:
    """Ten rests with moves of 20 mm between them, rounded to counts; noise in counts."""
    place = np.repeat(np.random.default_rng(2).uniform(0.0, 2e-2, 10), 400) / COUNT
    noise = sigma * np.random.default_rng(3).standard_normal(len(place))
    return COUNT * np.rint(place + noise)


def test_a_rest_is_worth_as_many_readings_as_it_has_memories():
    """Ten rests of 400 readings, a memory of 30: 14 readings of each, evenly spread, none beyond its rest."""
    t, z = distinct_readings(T, rests(0.0), 30)
    assert len(t) == 140
    np.testing.assert_array_equal(z, rests(0.0)[::400].repeat(14))
    assert np.max(np.abs(t.reshape(10, 14).mean(axis=1) - T.reshape(10, 400).mean(axis=1))) < 1.0 / 833.0
    assert np.all(np.diff(t) > 0.0)


def test_dithered_readings_and_short_runs_are_left_as_they_are():
    for z in (rests(0.5), rests(1.0), np.sin(T)):
        t, left = distinct_readings(T, z, 30)
        assert t is T
        assert left is z
    moving = COUNT * np.floor(T * 833.0 / 10.0)  # ten readings of each count
    t, left = distinct_readings(T, moving, 30)
    np.testing.assert_allclose(t, T, atol=1e-12)
    np.testing.assert_array_equal(left, moving)


def test_nothing_is_named_on_a_resting_coarse_encoder(tmp_path, monkeypatch):
    """At a rate of 0.5 %; with every reading taken for a measurement, effects of the encoder are asked for."""
    recording = load(TABLE["h-coarse-smooth"].build(700).write(tmp_path))
    improvement = improve(recording)
    assert improvement.effects == ()
    assert "encoder" not in str(improvement)
    monkeypatch.setattr(runs, "without_repeated_counts", lambda run: run)
    assert "encoder" in str(improve(recording))


def test_lost_counts_are_found_on_a_resting_coarse_encoder(tmp_path):
    recording = load(TABLE["h-coarse-smooth"].build(710).write(tmp_path))
    t, z = recording.position.t, recording.position.y
    run = prepare(recording).complete
    gaps = np.diff(z) == 0.0
    at = float(t[1:][gaps][np.argmin(np.abs(t[1:][gaps] - 30.0))])  # while it rests
    jumped = replace(recording, position=Channel("position", t, z + 15 * COUNT * (t > at), "m"))
    assert len(run.t) > len(prepare(recording).t)
    assert improve(jumped).effects == (POSITION_JUMPS,)


def test_counts_of_a_stage_that_goes_and_returns_are_not_those_of_noise():
    """A hundred slow counts forth and a hundred back turn once: the rests of forty readings are thinned."""
    forth = np.arange(100).repeat(40)
    z = COUNT * np.concatenate([forth, forth[::-1]])
    t, left = distinct_readings(np.arange(len(z)) / 833.0, z, 30)
    assert len(t) == 99 * 2 * 2 + 3  # at the turn one count for eighty readings
    np.testing.assert_array_equal(np.unique(left), np.unique(z))


def moves_and_rests(density: float) -> ac.Recording:
    """Thirty moves of a second with rests of three between them, in closed form; an encoder of 10 um without noise."""
    rng, t = np.random.default_rng(7), np.arange(120_000) / 1000.0
    p, a = np.zeros((2, len(t)))
    for k, stroke in enumerate(rng.uniform(0.05, 0.1, 30) * np.tile([1.0, -1.0], 15)):
        x = np.clip(t - 4.0 * k - 3.0, 0.0, 1.0)
        p += stroke * x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)
        a += stroke * 420.0 * x**2 * (1.0 - x) ** 2 * (1.0 - 2.0 * x)
    y = 0.05 + 1.01 * a + density * np.sqrt(500.0) * rng.standard_normal(len(t))
    z = 1e-5 * np.rint((p + 3e-6)[::4] / 1e-5)
    return ac.Recording.from_arrays(t, y, z, position_t=t[::4], units={"accel": "m/s^2", "position": "m"})


@pytest.mark.parametrize("shared", [True, False])
def test_noise_at_rest_is_that_of_the_output(monkeypatch, shared):
    """Within four standard deviations. The twin takes the rounding errors of a rest for white ones: 8 % too little."""
    if not shared:
        monkeypatch.setattr(PreparedRun, "resolved_variance", lambda run, q, step=None: run.least_reading_variance)
    rest = ac.fit(moves_and_rests(1e-3)).runs[0].noise.rest
    assert rest.density_std < 1.6e-5
    assert (abs(rest.density - 1e-3) < 4.0 * rest.density_std) == shared
