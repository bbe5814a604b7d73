"""References that are too good for the replay: which engine is taken, and how right its estimates are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import accelcal as ac
from accelcal.data.rig import ChannelFilter
from accelcal.estimation import engines, run
from accelcal.estimation.estimate import Fit
from accelcal.io import load
from benches.crossovers import errors
from tests.worlds import CATALOGUE, SENSORS, Hidden, Nuisances, World, at_d
from tests.worlds.world import ACCEL_RATE

SIGNIFICANCE = 1e-3


def world(crossover: float, number: int) -> World:
    """A stage whose crossover is so many sampling rates, with readings lost in every second record."""
    density = SENSORS["ADXL105"].noise ** 2 / 2.0
    deviation = float(np.sqrt(density * ACCEL_RATE / (2.0 * np.pi * crossover * ACCEL_RATE) ** 4))
    nuisances = Nuisances(missing=0.1 * (number % 2), lowpass_tolerance=0.05, clock_tolerance=20e-6)
    return World(
        ("interleaved", "moves", "bursts")[number % 3],
        seconds=20.0,
        seed=7100 + number,
        nuisances=nuisances,
        encoder_rate=ACCEL_RATE * 1.0003,
        encoder_noise=deviation,
        resolution=deviation,
    )


def fitted(folder, crossover: float, number: int, method="auto") -> tuple[Fit, dict[str, float], int]:
    """The fit, normalised errors, and the number of readings that the record holds."""
    record = world(crossover, number).record()
    fit = ac.fit(load(record.write(folder, f"r{number}")), method=method)
    return fit, errors(fit, record.world), int(np.count_nonzero(np.isfinite(record.position)))


def test_estimates_are_right_however_good_the_reference(tmp_path):
    """False alarms: 1e-3."""
    z = []
    for number, crossover in enumerate((0.2, 0.5, 1.0, 3.0, 10.0, 10.0)):
        fit, off, readings = fitted(tmp_path, crossover, number)
        assert fit.method == "weak"
        assert not fit.remarks
        assert readings - 4 < fit.runs[0].readings <= readings  # but at the ends; the replay takes one in so many
        z.extend(off.values())
    total, most = float(np.sum(np.square(z))), float(chi2.isf(SIGNIFICANCE, len(z)))
    print(f"sum of z^2 {total:.1f} of {len(z)} (at most {most:.1f})")
    assert total < most


@pytest.mark.parametrize(("name", "crossover"), [("quadratic", 0.3), ("coulomb", 3.0)])
def test_what_is_hidden_is_found_and_added(tmp_path, name, crossover):
    """At a rate and length at which the search must have time for it; missed in less than one record of a thousand."""
    hidden = replace(world(crossover, 4), seconds=60.0, hidden=(Hidden(name, CATALOGUE[name].typical),))
    hidden = replace(hidden, nuisances=replace(hidden.nuisances, lowpass_tolerance=0.0))
    improvement = ac.improve(load(at_d(hidden, 30.0).record().write(tmp_path)))
    print(improvement.effects, improvement.sentence)
    assert improvement.steps[0].fit.method == "weak"
    assert improvement.effects == (name,)


def test_the_replay_of_all_readings_would_be_wrong(tmp_path, monkeypatch):
    """The twin: what the output does between its samples is then assumed, not known."""
    for module, limit in ((run, "TOO_GOOD"), (engines, "NEAR_RATE")):
        monkeypatch.setattr(module, limit, np.inf)
    z = []
    for number, crossover in enumerate((1.0, 3.0, 10.0)):
        fit, off, _ = fitted(tmp_path, crossover, number)
        assert fit.method == "replay"
        z.extend(off.values())
    total, most = float(np.sum(np.square(z))), float(chi2.isf(SIGNIFICANCE, len(z)))
    print(f"sum of z^2 {total:.1f} of {len(z)}")
    assert total > most


@pytest.mark.parametrize(("crossover", "method"), [(0.03, "replay"), (0.5, "weak")])
def test_the_engine_that_suits_fits(tmp_path, crossover, method):
    assert fitted(tmp_path, crossover, 0)[0].method == method


def test_a_record_without_a_weak_form_is_fitted_by_the_replay(tmp_path):
    recording = load(world(0.5, 0).record().write(tmp_path))
    blocked = replace(recording, rig=replace(recording.rig, output_filters=(ChannelFilter("RC", "highpass", 0.5),)))
    assert ac.fit(recording).method == "weak"
    assert ac.fit(blocked).method == "replay"
