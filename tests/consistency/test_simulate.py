"""The simulated rig against closed forms and laws; nothing here is compared with its own past output."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from accelcal.data.rig import STANDARD_GRAVITY, LowPass, Rig
from accelcal.simulation.motion import PROFILES, Motion, Tones, motion
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, PARAMETERS, Vibration, simulate

NOISE_FREE = replace(ADXL105_RIG, sensor=replace(ADXL105_RIG.sensor, noise=0.0), lowpass=None, resolution=None)
"""No noise, no low-pass, no rounding: what is left is the sensor model."""


def tone(amplitude: float, frequency: float, seconds: float = 10.0) -> Motion:
    """a = amplitude sin(w t)."""
    w = 2 * np.pi * frequency
    return Motion((Tones(np.array([-amplitude / w**2]), np.array([frequency]), np.zeros(1)),), seconds)


def output(stage: Motion, rig: Rig, parameters: Mapping[str, float], **settings: Any) -> tuple[np.ndarray, np.ndarray]:
    """Times and output of a noise-free record."""
    run = simulate(
        stage,
        seconds=stage.seconds,
        rig=rig,
        parameters=parameters,
        rng=np.random.default_rng(0),
        position_noise=0.0,
        **settings,
    )
    return run.recording.accel.t, run.recording.accel.y


@pytest.mark.parametrize("name", PROFILES)
def test_velocity_acceleration_and_jerk_are_the_derivatives_of_position(name: str) -> None:
    # six-point central differences at 0.1 ms
    stage = motion(name, 50.0, np.random.default_rng(5))
    t, h = np.sort(np.random.default_rng(6).uniform(0.1, 49.9, 4000)), 1e-4
    weights = np.array([-1 / 60, 3 / 20, -3 / 4, 0.0, 3 / 4, -3 / 20, 1 / 60]) / h
    stencil = np.stack([stage.derivatives(t + j * h) for j in range(-3, 4)])
    slopes = np.einsum("j,jkn->kn", weights, stencil)
    exact = stage.derivatives(t)
    for order in range(3):
        scale = np.max(np.abs(exact[order + 1])) + 1e-300
        # snap jumps where a move begins: a stencil across it errs by h times the jump in jerk, h² in acceleration
        tolerance = 1e-3 if order == 2 else 1e-5
        assert np.max(np.abs(slopes[order] - exact[order + 1])) <= tolerance * scale


@pytest.mark.parametrize("name", [name for name in PROFILES if name != "rest"])
def test_motion_meets_the_requested_rms_acceleration(name: str) -> None:
    stage = motion(name, 50.0, np.random.default_rng(8), a_rms=1.5)
    t = np.random.default_rng(9).uniform(0.0, 50.0, 400_000)
    # Monte-Carlo mean of a² over 400 000 instants
    assert np.sqrt(np.mean(stage.acceleration(np.sort(t)) ** 2)) == pytest.approx(1.5, rel=0.02)


@pytest.mark.parametrize("name", ["interleaved", "rests", "moves", "bursts", "chirp"])
def test_stage_profiles_stay_within_the_speed_of_the_encoder(name: str) -> None:
    for seed in range(5):
        assert motion(name, 60.0, np.random.default_rng(seed)).top_speed <= 0.1 * (1 + 1e-4)  # found on a 0.25 ms grid


def test_rests_stand_still_for_twenty_seconds_at_both_ends() -> None:
    stage = motion("rests", 60.0, np.random.default_rng(2))
    assert not np.any(stage.derivatives(np.linspace(0.0, 20.0, 500))[1:])
    assert not np.any(stage.derivatives(np.linspace(40.0, 60.0, 500))[1:])
    assert np.any(stage.derivatives(np.linspace(20.0, 40.0, 500))[1:])


@pytest.mark.parametrize(
    ("name", "seconds", "limits", "text"),
    [
        ("wobble", 10.0, {}, "not known"),
        ("tones", 0.0, {}, "must be positive"),
        ("rests", 30.0, {}, "too short"),
        ("moves", 1.0, {}, "too short"),
        ("rest", 10.0, {"a_rms": 1.0}, "does not move"),
        ("tones", 10.0, {"a_rms": 4.0, "v_max": 0.1}, "above the limit"),
    ],
)
def test_motion_says_what_it_cannot_do(name: str, seconds: float, limits: dict[str, float], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        motion(name, seconds, np.random.default_rng(0), **limits)


def test_output_is_the_sensor_model_of_the_late_acceleration() -> None:
    theta = {"bias": 0.3, "scale_factor": 0.02, "time_offset": 4e-4, "quadratic": -1e-3, "cubic": 1e-4}
    t, y = output(tone(5.0, 7.0), NOISE_FREE, theta)
    a = 5.0 * np.sin(2 * np.pi * 7.0 * (t - 4e-4))
    np.testing.assert_allclose(y, 0.3 + 1.02 * a - 1e-3 * a**2 + 1e-4 * a**3, atol=1e-12)  # sin at 440 rad: 1e-13


def test_low_pass_has_the_gain_and_lag_of_an_rc() -> None:
    for frequency in (5.0, 50.0, 300.0):
        t, y = output(tone(1.0, frequency), replace(NOISE_FREE, lowpass=LowPass(159.0)), {})
        response = 1.0 / (1.0 + 1j * frequency / 159.0)
        expected = np.imag(response * np.exp(2j * np.pi * frequency * t))
        # start-up exp(-25) = 1.4e-11; Gauss-Legendre, six nodes over 0.18 of a period at 300 Hz: below 1e-9
        np.testing.assert_allclose(y, expected, atol=1e-9)


@pytest.mark.parametrize("rate", [200.0, 1667.0, 20_000.0])
def test_low_pass_is_exact_at_any_rate(rate: float) -> None:
    t, y = output(
        tone(1.0, 20.0, 3.0), replace(NOISE_FREE, lowpass=LowPass(159.0)), {}, accel_rate=rate, accel_phase=0.123
    )
    expected = np.imag(np.exp(2j * np.pi * 20.0 * t) / (1.0 + 20j / 159.0))
    np.testing.assert_allclose(y, expected, atol=1e-10)  # start-up exp(-25)


def test_reversal_changes_the_sign_of_acceleration_and_gravity_but_not_of_the_bias() -> None:
    tilted = replace(NOISE_FREE, gravity_along_axis=0.2)
    _, normal = output(tone(2.0, 3.0), tilted, {"bias": 0.05})
    _, turned = output(tone(2.0, 3.0), replace(tilted, mount="reversed"), {"bias": 0.05})
    np.testing.assert_allclose(normal + turned, 0.1, atol=1e-14)  # rounding of values near 2
    assert np.mean(normal) == pytest.approx(0.25, abs=1e-3)  # whole periods up to one sample of 16 670


def test_roll_changes_the_sign_of_everything_across_the_axis() -> None:
    theta = {"scale_factor": 0.01, "cross_axis_gravity": 1e-3, "misalignment": 2e-3}
    t, normal = output(tone(2.0, 3.0), NOISE_FREE, theta)
    _, rolled = output(tone(2.0, 3.0), replace(NOISE_FREE, mount="rolled"), theta)
    a = 2.0 * np.sin(2 * np.pi * 3.0 * t)
    g = STANDARD_GRAVITY
    np.testing.assert_allclose((normal + rolled) / 2, 1.01 * a, atol=1e-12)  # sin at 190 rad
    np.testing.assert_allclose((normal - rolled) / 2, 1e-3 * g * a + 2e-3 * g, atol=1e-12)


def test_vibration_grows_with_the_square_of_the_speed() -> None:
    t, y = output(tone(3.0, 2.0), NOISE_FREE, {})
    _, shaken = output(tone(3.0, 2.0), NOISE_FREE, {}, vibration=Vibration(0.5, 230.0))
    expected = 0.5 * np.cos(2 * np.pi * 2.0 * t) ** 2 * np.sin(2 * np.pi * 230.0 * t)
    np.testing.assert_allclose(shaken - y, expected, atol=1e-5)  # top speed found on a 0.25 ms grid


def test_a_band_has_the_power_of_the_line_between_its_edges() -> None:
    t, y = output(tone(3.0, 2.0), NOISE_FREE, {})
    band, again, line = (
        output(tone(3.0, 2.0), NOISE_FREE, {}, vibration=Vibration(0.5, 200.0, width))[1] - y
        for width in (100.0, 100.0, 0.0)
    )
    assert np.array_equal(band, again)
    frequency, power = np.fft.rfftfreq(len(t), t[1] - t[0]), np.abs(np.fft.rfft(band)) ** 2
    inside = (frequency > 195.0) & (frequency < 305.0)  # the square of the speed adds 4 Hz on either side
    assert np.sum(power[inside]) > 0.999 * np.sum(power)
    # differences of tones meet the 4 and 8 Hz of the envelope: 3 % over generators, so ±4 sigma (false alarm 6e-5)
    assert np.mean(band**2) == pytest.approx(np.mean(line**2), rel=0.12)
    share = [np.sum(power[(frequency > low) & (frequency < low + 25.0)]) for low in (200.0, 225.0, 250.0, 275.0)]
    assert min(share) > 0.5 * max(share)  # flat; a line has all of it in one
    assert kurtosis(band / np.cos(2 * np.pi * 2.0 * t) ** 2, t) > 2.5  # 1.5 for a line


def kurtosis(y: np.ndarray, t: np.ndarray) -> float:
    """Kurtosis of the band alone, where the envelope is not small."""
    remaining = y[np.abs(np.cos(2 * np.pi * 2.0 * t)) > 0.5]
    return float(np.mean(remaining**4) / np.mean(remaining**2) ** 2)


@pytest.mark.parametrize("lowpass", [None, LowPass(159.0)])
def test_noise_has_the_declared_density_at_low_frequency(lowpass: LowPass | None) -> None:
    # mean of 0.2 s blocks: variance N²/(2 T) (1 - tau/T for the RC: within 0.5 %); 3000 blocks, so ±4 sigma is ±10.3 %
    # of the variance (false-alarm rate 6e-5)
    rig = replace(CXL02_RIG, lowpass=lowpass)
    run = simulate("rest", seconds=600.0, rig=rig, parameters={}, rng=np.random.default_rng(11), accel_rate=1000.0)
    blocks = run.recording.accel.y.reshape(3000, 200).mean(axis=1)
    density = np.sqrt(2 * 0.2 * np.var(blocks))
    assert density == pytest.approx(20e-6 * STANDARD_GRAVITY, rel=0.055)


def test_low_passed_noise_has_the_variance_and_correlation_of_an_rc() -> None:
    # derivations 3.4: sigma² = N² pi fc/2, lag one exp(-dt/tau).
    # 100 000 samples, about 30 000 independent: ±4 sigma is 3.3 %.
    run = simulate("rest", seconds=60.0, rig=ADXL105_RIG, parameters={}, rng=np.random.default_rng(12))
    y = run.recording.accel.y
    variance = (225e-6 * STANDARD_GRAVITY) ** 2 * np.pi / 2 * 159.0
    assert np.var(y) == pytest.approx(variance, rel=0.033)
    assert np.corrcoef(y[1:], y[:-1])[0, 1] == pytest.approx(np.exp(-2 * np.pi * 159.0 / 1667.0), abs=0.015)


def test_encoder_reads_position_with_noise_and_rounding() -> None:
    run = simulate("moves", seconds=60.0, rig=ADXL105_RIG, parameters={}, rng=np.random.default_rng(13))
    position = run.recording.position
    error = position.y - run.truth.motion.position(position.t)
    np.testing.assert_allclose(np.round(position.y / 1e-6) * 1e-6, position.y, rtol=0, atol=1e-15)  # multiples of 1 um
    # 1 um white and 1 um rounding: 13/12 um²; 50 000 samples, so ±4 sigma of the variance is ±2.5 %
    assert np.var(error) == pytest.approx(1e-12 * 13 / 12, rel=0.026)


def test_same_generator_same_record_and_other_noise_leaves_the_motion() -> None:
    def run(seed: int, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
        simulation = simulate("interleaved", seconds=5.0, rig=rig, parameters={}, rng=np.random.default_rng(seed))
        return simulation.recording.accel.y, simulation.recording.position.y

    first, again, other = run(1, ADXL105_RIG), run(1, ADXL105_RIG), run(1, CXL02_RIG)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], other[1])
    assert not np.array_equal(first[0], run(2, ADXL105_RIG)[0])


def test_missing_samples_are_absent_and_the_others_unchanged() -> None:
    settings = {"seconds": 30.0, "rig": ADXL105_RIG, "parameters": {}}
    full = simulate("tones", rng=np.random.default_rng(4), **settings).recording
    holed = simulate("tones", rng=np.random.default_rng(4), missing=0.1, **settings).recording
    for whole, part in ((full.accel, holed.accel), (full.position, holed.position)):
        # binomial: ±4 sigma is ±0.76 % of 25 005 and 50 010 samples at most
        assert len(part) / len(whole) == pytest.approx(0.9, abs=0.0076)
        np.testing.assert_array_equal(part.y, whole.y[np.isin(whole.t, part.t)])


def test_converter_rounds_and_clips() -> None:
    _, y = output(tone(5.0, 3.0), NOISE_FREE, {}, lsb=0.01, full_scale=3.0)
    assert np.max(np.abs(y)) == pytest.approx(3.0, abs=1e-12)  # 3 is a multiple of the step
    np.testing.assert_allclose(np.round(y / 0.01), y / 0.01, atol=1e-9)  # one division


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"parameters": {"biass": 1.0}}, "no sensor parameter"),
        ({"rig": Rig()}, "not declared"),
        ({"missing": 1.0}, "outside"),
        ({"motion": tone(1.0, 1.0), "a_rms": 1.0}, "scale a Motion"),
    ],
)
def test_simulate_says_what_is_wrong(change: dict[str, object], text: str) -> None:
    settings = {"motion": "tones", "seconds": 1.0, "rig": ADXL105_RIG, "parameters": {}, **change}
    with pytest.raises(ValueError, match=text):
        simulate(rng=np.random.default_rng(0), **settings)  # type: ignore[arg-type]


def test_truth_names_every_parameter() -> None:
    run = simulate("rest", seconds=1.0, rig=ADXL105_RIG, parameters={"bias": 1.0}, rng=np.random.default_rng(0))
    assert dict(run.truth.parameters) == {**dict.fromkeys(PARAMETERS, 0.0), "bias": 1.0}


def test_a_minute_takes_less_than_half_a_second() -> None:
    # processor time, the best of three: other programs on the machine do not count
    def cost(seed: int) -> float:
        begin = time.process_time()
        simulate("interleaved", seconds=60.0, rig=ADXL105_RIG, parameters={}, rng=np.random.default_rng(seed))
        return time.process_time() - begin

    assert min(cost(seed) for seed in range(3)) < 0.5
