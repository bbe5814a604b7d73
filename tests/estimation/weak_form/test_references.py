"""A velocity and an acceleration as reference: estimates as right as they say, noise of the right kind."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

import accelcal as ac
from accelcal.data import Channel, ChannelFilter
from accelcal.data.recording import integrated
from accelcal.diagnosis.faults import examine
from accelcal.results import model_file
from accelcal.simulation import CXL02_RIG

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 3e-4}
RECORDS = 6
LEAST, MOST = chi2.ppf([0.0005, 0.9995], 3 * RECORDS)
"""Of the sum of squared z values; their false-alarm rate is 1e-3."""


def recordings(reference):
    for seed in range(RECORDS):
        rng = np.random.default_rng([7, seed])
        settings = {"seconds": 20.0, "rig": CXL02_RIG, "parameters": TRUTH, "rng": rng}
        yield ac.simulate("tones", reference=reference, **settings).recording


def squares(result):
    z = [(e.value - TRUTH[e.name]) / e.std for fitted in result for e in fitted.free]
    return float(np.sum(np.square(z)))


@pytest.mark.parametrize("reference", ["velocity", "reference_acceleration"])
def test_estimates_through_a_reference_are_as_right_as_they_say(reference):
    results = [ac.fit(recording) for recording in recordings(reference)]
    assert all(fitted.method == "weak" for fitted in results)
    assert LEAST < squares(results) < MOST
    noise = results[0].runs[0].noise
    assert noise.reference == reference
    assert noise.all.reading == pytest.approx({"velocity": 1e-4}.get(reference, 1e-2), rel=0.05)
    assert noise.ratio == pytest.approx(1.0, abs=0.15)


def test_a_reference_whose_scale_is_off_by_a_ten_thousandth_is_noticed():
    """The twin: some eleven standard deviations of the scale factor, in each record."""
    results = []
    for recording in recordings("velocity"):
        off = dataclasses.replace(recording.reference, y=1.0001 * recording.reference.y)
        results.append(ac.fit(dataclasses.replace(recording, reference=off, position=integrated(off))))
    assert squares(results) > MOST


def test_a_reference_that_is_cut_stays_one():
    first = next(recordings("velocity"))
    part = first.part(2.0, 12.0).without((5.0, 6.0))
    assert part.reference is not None
    assert np.array_equal(part.reference.t, part.position.t)
    fitted = ac.fit(part)
    assert fitted.free[1].value == pytest.approx(0.01, abs=5 * fitted.free[1].std)


def test_the_floor_of_the_error_has_the_noise_of_the_reference():
    """Simulated noise covers the error of the true model, whose readings are the integral of white noise."""
    first = next(recordings("velocity"))
    fitted = ac.fit(first)
    evaluation = ac.compare(fitted, first)[0]
    floor = evaluation.noise_floor.drift[1.0]
    assert floor.low < evaluation.coast_rms[1.0] < floor.high


def test_the_model_file_keeps_what_the_reference_is(tmp_path):
    fitted = ac.fit(next(recordings("velocity")))
    path = tmp_path / "model.json"
    model_file.save(fitted, path)
    assert model_file.load(path).runs[0].noise.reference == "velocity"


def vibration(reference, low, high, rate=2500.0, seconds=1.5, corners=(0.0, 0.0)):
    """A record of random motion of 15 m/s² rms between two frequencies, Hz, by sums of its lines: no simulator.

    It has lasted for ever behind the high-passes of output and reference, whose `corners` are in Hz.
    """
    rng = np.random.default_rng([11, round(low)])
    t = np.arange(0.0, seconds, 1.0 / rate)
    w = 2.0 * np.pi * np.arange(low, high, 2.0)[:, None]
    a = (15.0 / np.sqrt(len(w) / 2.0)) * np.exp(1j * (w * t + rng.uniform(0.0, 2.0 * np.pi, w.shape)))
    order = {"position": 2, "velocity": 1, "reference_acceleration": 0}[reference]
    behind = [a * 1j * w / (1j * w + 2.0 * np.pi * corner) for corner in corners]
    read = np.sum(np.real(behind[1] / (1j * w) ** order), axis=0)
    read += 1e-4 * np.std(read) * rng.standard_normal(len(t))
    output = 1.02 * np.sum(behind[0].real, axis=0) + 0.005 * rng.standard_normal(len(t))
    units = {"t": "s", "accel": "m/s^2", "position": "m"}
    if reference == "position":
        return ac.Recording.from_arrays(t, output, read, units=units)
    channel = Channel(reference, t, read, {"velocity": "m/s", "reference_acceleration": "m/s^2"}[reference])
    record = ac.Recording.from_arrays(t, output, np.zeros_like(t), units=units)
    return dataclasses.replace(record, reference=channel, position=integrated(channel))


@pytest.mark.parametrize("reference", ["position", "velocity", "reference_acceleration"])
def test_a_motion_that_lies_above_a_twentieth_of_the_rate_is_resolved(reference):
    """A shaker at a tenth of the sampling rate: the fit failed, or was off by 0.1 %."""
    fitted = ac.fit(vibration(reference, 200.0, 300.0))
    assert fitted["scale_factor"].value == pytest.approx(0.02, abs=5e-5)


def test_an_acceleration_behind_a_high_pass_is_a_reference_however_good():
    """It was refused, since the positions that are made of it were too good for the replay."""
    record = vibration("reference_acceleration", 10.0, 100.0, seconds=3.0)
    rig = dataclasses.replace(record.rig, position_filters=(ChannelFilter("RC", "highpass", 0.5),))
    fitted = ac.fit(dataclasses.replace(record, rig=rig), reject_outliers=False)
    assert fitted["scale_factor"].value == pytest.approx(0.02, abs=1e-3)


def test_readings_behind_a_high_pass_that_has_not_settled_are_related():
    """A record that begins in the middle of a vibration: what the start adds was taken for another stage's motion."""
    record = vibration("reference_acceleration", 10.0, 100.0, rate=500.0, seconds=24.0, corners=(0.3, 0.1))
    high = [(ChannelFilter("RC", "highpass", corner),) for corner in (0.3, 0.1)]
    record = dataclasses.replace(
        record, rig=dataclasses.replace(record.rig, output_filters=high[0], position_filters=high[1])
    )
    assert not examine(record).source.recording.left_out
