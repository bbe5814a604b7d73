"""A record at rest throughout is refused in one sentence whatever its noise; a weak motion is not taken for rest."""

import contextlib
import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel
from accelcal.diagnosis.one_axis import at_rest
from accelcal.estimation.run import prepare


def record(motion, seed, *, position_noise=1e-6, output_noise=0.06, seconds=20.0, rates=(1667.03, 1000.09), step=1e-6):
    """Both channels of a motion p(t) with its acceleration, white noise on either."""
    rng = np.random.default_rng(seed)
    t, u = (np.arange(int(seconds * rate)) / rate for rate in rates)
    _, a = motion(t)
    p, _ = motion(u)
    z = p + position_noise * rng.standard_normal(len(u))
    z = np.round(z / step) * step if step else z
    accel = Channel("accel", t, a + 0.1 + output_noise * rng.standard_normal(len(t)), "m/s²")
    rig = dataclasses.replace(ac.Rig(), resolution=step or None)
    return ac.Recording(accel=accel, position=Channel("position", u, z, "m"), rig=rig, name="run.csv")


def still(t):
    return np.zeros_like(t), np.zeros_like(t)


def sine(size, frequency):
    """A sine of an acceleration amplitude, m/s², and a frequency, Hz."""
    w = 2.0 * np.pi * frequency
    return lambda t: (-size / w**2 * np.sin(w * t), size * np.sin(w * t))


# Each of 60 records at rest would pass for motion once in ten million.
@pytest.mark.parametrize("position_noise", [1e-9, 1e-6, 3e-4])
@pytest.mark.parametrize("output_noise", [1e-3, 0.06])
def test_rest_is_rest_whatever_the_noise(position_noise, output_noise):
    for seed in range(10):
        recording = record(still, seed, position_noise=position_noise, output_noise=output_noise, seconds=8.0)
        assert at_rest(prepare(recording))


def test_a_steady_drift_of_the_position_is_rest_and_coloured_noise_of_it_too():
    drift = record(lambda t: (1e-4 * t, np.zeros_like(t)), 1)
    assert at_rest(prepare(drift))
    rng = np.random.default_rng(2)
    recording = record(still, 2, position_noise=5e-3, rates=(100.3, 10.0), seconds=200.0, step=None)
    steps = 0.01 * np.sqrt(2 * 0.1 / 20.0) * rng.standard_normal(len(recording.position))
    coloured = np.array([y := 0.0, *(y := y * np.exp(-0.1 / 20.0) + s for s in steps[1:])])
    y = recording.position.y + coloured
    assert at_rest(prepare(dataclasses.replace(recording, position=dataclasses.replace(recording.position, y=y))))


@pytest.mark.parametrize(
    ("motion", "more"),
    [
        (sine(0.01, 0.5), {}),  # a millimetre, hidden from the output
        (sine(1.0, 100.0), {}),  # 2.5 um, a quarter of a sigma beyond the noise, but the output sees it
        (sine(1.0, 0.7), {"rates": (100.3, 1.0), "seconds": 60.0, "step": None}),  # readings slower than the motion
    ],
)
def test_motion_that_either_channel_sees_is_no_rest(motion, more):
    assert not at_rest(prepare(record(motion, 3, **more)))


def test_the_verbs_refuse_a_record_at_rest_before_any_fit():
    recording = record(still, 4, seconds=8.0)
    for verb in (ac.improve, lambda run: ac.fit(run)):
        with pytest.raises(
            ac.NotIdentifiable, match=r"^run\.csv: at rest throughout.*Record a run in which the stage moves"
        ):
            verb(recording)
    # A bias alone can be estimated at rest.
    held = ac.fit(recording, ac.Model.linear().freeze(scale_factor=0.0, time_offset=0.0))
    assert held["bias"].value == pytest.approx(0.1, abs=5.0 * held["bias"].std)


@pytest.mark.parametrize(
    ("rate", "noise", "seed"), [(50.0, 0.008, 500), (50.0, 0.012, 503), (50.0, 0.02, 502), (100.0, 0.03, 508)]
)
def test_a_motion_that_the_noise_hides_is_not_excited(rate, noise, seed):
    """In one record of twelve the iteration runs to where the sensor sees nothing and the crossover of both channels
    tends to zero: no low-pass has such a corner."""
    rng = np.random.default_rng(seed)
    t, w = np.arange(0.0, 20.0, 1.0 / rate), 2.0 * np.pi * np.array([[2.1], [3.3], [4.7]])
    sines = 3e-5 * np.sin(w * t + rng.uniform(0.0, 6.0, (3, 1)))
    u = 0.02 + 1.01 * np.sum(-(w**2) * sines, axis=0) + noise * rng.standard_normal(len(t))
    z = np.sum(sines, axis=0) + 2e-8 * rng.standard_normal(len(t))
    recording = ac.Recording.from_arrays(t, u, z, units={"accel": "m/s^2", "position": "m"}, rig=ac.Rig(axis="level"))
    # where the iteration ends depends on the last bits of the processor's functions: refused, or told with its doubt
    with contextlib.suppress(ac.NotIdentifiable):
        k = ac.fit(recording)["scale_factor"]
        assert abs(k.value - 0.01) < 4.0 * k.std
        assert k.std > 0.05
