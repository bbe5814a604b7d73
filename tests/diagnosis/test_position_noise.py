"""Noise of the position that is not white is said to be the position's; a noisier sensor is not excused by it."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
import scipy

import accelcal as ac
from accelcal.data.recording import Channel
from accelcal.data.rig import Rig, Sensor
from accelcal.diagnosis import checks

DENSITY = 1.5e-3
"""Of the sensor, (m/s²)/sqrt(Hz)."""


def record(seed, *, process=0.0, tau=20.0, sensor=1.0, seconds=300.0):
    """A hand at 0.3 to 2 Hz, position at 10 Hz with white noise of 5 mm and a Gauss-Markov process."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0.0, seconds, 0.002)
    f = np.fft.rfftfreq(len(fine), 0.002)
    a = np.fft.irfft(np.where((f > 0.3) & (f < 2.0), np.fft.rfft(rng.standard_normal(len(fine))), 0.0), len(fine))
    a *= 1.5 / np.std(a)
    p = np.fft.irfft(np.fft.rfft(a) * np.where(f > 0.2, -1.0 / (2.0 * np.pi * np.maximum(f, 0.2)) ** 2, 0.0), len(fine))
    t, u = np.arange(0.0, seconds - 1, 1 / 100.3), np.arange(0.0, seconds - 1, 0.1)
    y = scipy.interpolate.CubicSpline(fine, a)(t) + sensor * DENSITY * np.sqrt(100.3 / 2) * rng.standard_normal(len(t))
    keep = np.exp(-0.1 / tau)
    coloured = scipy.signal.lfilter([process * np.sqrt(1 - keep**2)], [1.0, -keep], rng.standard_normal(len(u)))
    z = scipy.interpolate.CubicSpline(fine, p)(u) + coloured + 5e-3 * rng.standard_normal(len(u))
    rig = Rig(sensor=Sensor(noise=DENSITY), offset_tolerance=5e-3)
    return ac.Recording(Channel("accel", t, y, "m/s²"), Channel("position", u, z, "m"), rig=rig, name="run.csv")


def remark_on(recording):
    """The remark on a record, whatever its noise is over that of the data sheet."""
    scan, span = SimpleNamespace(enough=True), (0.0, float(recording.position.t[-1]))
    evidence = SimpleNamespace(fit=ac.fit(recording), recording=recording, sources=[recording], span=span, scan=scan)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(checks, "noise_ratio", lambda fit: math.inf)
        return next(checks.coloured_position(evidence), None)


def test_coloured_noise_is_found_with_the_intensity_of_its_random_walk():
    # Odds of e^6 to 1: by Whittle's likelihood 8 of 8 here; a record in a hundred may miss.
    results = [remark_on(record(seed, process=0.015)) for seed in range(8)]
    assert sum(test is not None for test in results) >= 7
    # Above its corner only the variance over the correlation time shows.
    ratio = [test.values["rms"] ** 2 / test.values["tau"] for test in results if test is not None]
    assert np.median(ratio) == pytest.approx(0.015**2 / 20.0, rel=0.4)


@pytest.mark.parametrize("more", [{}, {"sensor": 3.0}])
def test_white_noise_of_either_channel_is_not_coloured(more):
    # Odds of e^6 to 1 against: none in 8 records, once in 50 runs of this test at the most.
    assert [remark_on(record(100 + seed, **more)) for seed in range(8)] == [None] * 8


def test_the_verdict_blames_the_position_and_not_the_sensor():
    improvement = ac.improve(record(3, process=0.015))
    assert (improvement.verdict, improvement.effects) == ("adequate", ())
    assert "coloured_position" in [remark.code for remark in improvement.diagnosis.remarks]
    assert "The noise of the position is not white" in improvement.sentence
    assert "data sheet" not in improvement.sentence
    noisy = ac.improve(record(3, sensor=3.0))
    assert noisy.verdict == "unexplained"
    assert "times the sensor noise of the data sheet" in noisy.sentence


def test_without_a_declared_noise_nothing_is_compared():
    recording = record(1, process=0.015, seconds=60.0)
    assert remark_on(dataclasses.replace(recording, rig=Rig())) is None
