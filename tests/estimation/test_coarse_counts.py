"""A resting coarse encoder gives an interval, not hundreds of measurements; where noise dithers, nothing changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from accelcal import improve
from accelcal.data.recording import Channel
from accelcal.diagnosis.noise.noise_test import POSITION_JUMPS
from accelcal.estimation import run as runs
from accelcal.estimation.readings import distinct_readings
from accelcal.estimation.run import prepare
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
