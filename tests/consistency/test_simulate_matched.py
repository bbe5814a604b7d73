"""Records drawn from the filters' own models: their noise against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from accelcal.data.recording import Channel
from papers.stakkeland2007.filter_consistency import matched_aci, matched_cwpa


def still(seconds: float, rate: float) -> Channel:
    t = np.arange(round(seconds * rate)) / rate
    return Channel("accel", t, np.zeros(len(t)), "m/s²")


def test_aci_scatters_as_its_process_noise_says() -> None:
    # var v = q t, var p = q t³/3, cov = q t²/2; 4000 draws: ±4 sigma of a variance is ±9 % (false-alarm rate 6e-5 each)
    q, T = 0.5, 1.5
    control, end = still(T, 20.0), np.array([T])
    rng = np.random.default_rng(1)
    start = np.zeros(4)
    ends = np.array(
        [
            matched_aci(control, end, start, process_density=q, position_variance=0.0, rng=rng).state[-1]
            for _ in range(4000)
        ]
    )
    covariance = np.cov(ends[:, :2].T)
    expected = q * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    np.testing.assert_allclose(covariance, expected, rtol=0.09)


def test_cwpa_scatters_as_its_process_noise_says() -> None:
    # integrals of white jerk of density q over T (derivations 4.1); 4000 draws: ±4 sigma of a variance is ±9 %
    q, T = 2.0, 0.8
    t = np.linspace(0.0, T, 9)
    rng = np.random.default_rng(2)
    ends = np.array(
        [
            matched_cwpa(t, t, np.zeros(5), jerk_density=q, position_variance=0.0, accel_variance=0.0, rng=rng).state[
                -1
            ]
            for _ in range(4000)
        ]
    )
    covariance = np.cov(ends[:, :3].T)
    expected = q * np.array([[T**5 / 20, T**4 / 8, T**3 / 6], [T**4 / 8, T**3 / 3, T**2 / 2], [T**3 / 6, T**2 / 2, T]])
    np.testing.assert_allclose(covariance, expected, rtol=0.09)


def test_aci_without_noise_integrates_the_held_control_exactly() -> None:
    # constant control: p = g t²/2, v = g t, with g from the cubic inverse model (6)
    t = np.arange(11) / 10.0
    control = Channel("accel", t, np.full(11, 2.0), "m/s²")
    k, K0, K2, K3 = 0.1, 0.5, 0.01, -0.02
    w = 2.0 - K0
    g = (1 - k) * w + K2 * w**2 + K3 * w**3
    rng = np.random.default_rng(0)
    position_t = np.array([0.05, 0.55, 0.97])
    motion = matched_aci(
        control,
        position_t,
        np.array([1.0, -1.0, k, K0, K2, K3]),
        process_density=0.0,
        position_variance=0.0,
        rng=rng,
    )
    # a dozen additions of numbers near one
    np.testing.assert_allclose(motion.recording.position.y, 1.0 - position_t + g * position_t**2 / 2, rtol=1e-13)
    np.testing.assert_allclose(motion.at(1.0)[:2], [g / 2, g - 1.0], atol=1e-13)
    np.testing.assert_array_equal(motion.at(0.97)[2:], [k, K0, K2, K3])


def test_cwpa_reads_the_forward_model() -> None:
    t = np.arange(5) / 10.0
    k, K0, K2, K3 = 0.1, 0.5, 0.01, -0.02
    motion = matched_cwpa(
        t,
        t + 0.01,
        np.array([0.0, 0.0, 3.0, k, K0, K2, K3]),
        jerk_density=0.0,
        position_variance=0.0,
        accel_variance=0.0,
        rng=np.random.default_rng(0),
    )
    output = K0 + (1 + k) * 3.0 + K2 * 9.0 + K3 * 27.0
    np.testing.assert_allclose(motion.recording.accel.y, output, rtol=1e-15)  # one polynomial
    np.testing.assert_allclose(motion.recording.position.y, 1.5 * (t + 0.01) ** 2, rtol=1e-13)  # five steps


def test_readings_carry_the_variance_that_was_asked_for() -> None:
    # 20 000 readings: ±4 sigma of a variance is ±4 %
    t = np.arange(20_000) / 1000.0
    motion = matched_cwpa(
        t,
        t,
        np.zeros(5),
        jerk_density=0.0,
        position_variance=4.0,
        accel_variance=9.0,
        rng=np.random.default_rng(3),
    )
    assert np.var(motion.recording.position.y) == pytest.approx(4.0, rel=0.04)
    assert np.var(motion.recording.accel.y) == pytest.approx(9.0, rel=0.04)
