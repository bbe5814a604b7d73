"""Jumps of the motion between samples: found, told from wrong samples, and their effect on the integral as stated."""

from __future__ import annotations

import math

import numpy as np
import pytest

from accelcal import _core
from accelcal.signals.series import bridged, fill_gaps
from accelcal.signals.unresolved import NO_FLAGS, NONE, Jumps, jumps, lost_velocity, output_of
from tests.regimes.profiles import PROFILES
from tests.worlds.numerics import stream

STEP, TAU, SIGMA = 6e-4, 1e-3, 2e-3
WRONG = 40


def output(profile: str, seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, output behind an RC of `TAU` with noise, and the knots at which the acceleration or the jerk jumps."""
    rng = np.random.default_rng(seed)
    motion = PROFILES[profile](seconds, stream(seed, 1))
    t = np.arange(0.1, seconds - 0.1, STEP)
    u = motion.a.behind([complex(-1.0 / TAU)])(t) + SIGMA * rng.standard_normal(len(t))
    return t, u, motion


@pytest.mark.parametrize("seed", [11, 12])
def test_steps_of_the_acceleration_are_found_where_they_are(seed: int):
    t, u, motion = output("trapezoid", 30.0, seed)
    result = jumps(t, u, STEP, TAU)
    assert len(result.t) > 60
    assert np.mean(result.of_jerk) < 0.05
    jumped = motion.a.at(result.t + 2.0 * STEP) - motion.a.at(result.t - 2.0 * STEP)
    assert np.all(np.abs(jumped) > 3.0 * SIGMA)  # the truth jumps there
    assert np.median(np.abs(result.size - jumped) / np.abs(jumped)) < 0.1


@pytest.mark.parametrize(
    ("profile", "size"), [("smooth", 8.0), ("trapezoid", 8.0), ("trapezoid", 100.0), ("hand", 20.0)]
)
def test_a_wrong_sample_is_not_called_a_jump(profile: str, size: float):
    t, u, _ = output(profile, 30.0, 21)
    before = jumps(t, u, STEP, TAU)
    rng = np.random.default_rng(1)
    at = rng.choice(np.arange(100, len(t) - 100, 25), WRONG, replace=False)
    at = np.array([k for k in at if not len(before.t) or np.min(np.abs(before.t - t[k])) > 0.02])
    u[at] += size * SIGMA * rng.choice([-1.0, 1.0], len(at))
    result = jumps(t, u, STEP, TAU)
    certain = result.t[result.certain]
    mistaken = [k for k in at if len(certain) and np.min(np.abs(certain - t[k])) < 4 * STEP]
    assert len(mistaken) <= 2  # of some 40: a rate of 1 % leaves more than two in 0.8 % of such records


@pytest.mark.parametrize("apart", [1.3, 2.0, 3.7])
def test_two_jumps_in_one_window_are_no_wrong_sample(apart: float):
    """The end of one ramp and the beginning of the next, a few samples apart."""
    rng = np.random.default_rng(7)
    t = STEP * np.arange(4000)
    u = SIGMA * rng.standard_normal(len(t))
    begins = STEP * (np.arange(100.0, 3900.0, 100.0) + rng.random(38))
    for begin in begins:
        for instant in (begin, begin + apart * STEP):
            u -= 200.0 * SIGMA * (t > instant) * (1.0 - np.exp(-np.maximum(t - instant, 0.0) / TAU))
    result = jumps(t, u, STEP, TAU)
    near = [np.min(np.abs(result.t - begin)) < 6 * STEP for begin in begins]
    assert np.mean(near) > 0.9
    both = [all(np.min(np.abs(result.t - begin - late)) < STEP for late in (0.0, apart * STEP)) for begin in begins]
    assert np.mean(both) > (0.8 if apart >= 2.0 else 0.2)  # those a sample apart are hardly two


def test_two_strong_jumps_are_found_behind_a_pole_that_is_not_quite_the_declared_one():
    rng = np.random.default_rng(9)
    t = STEP * np.arange(4000)
    u = 1e-4 * rng.standard_normal(len(t))
    begins = STEP * (np.arange(100.0, 3900.0, 100.0) + rng.random(38))
    for begin in begins:
        for instant in (begin, begin + 3.4 * STEP):
            u += 0.5 * (t > instant) * (1.0 - np.exp(-np.maximum(t - instant, 0.0) / (1.03 * TAU)))
    result = jumps(t, u, STEP, TAU)
    both = [all(np.min(np.abs(result.t - begin - late)) < STEP for late in (0.0, 3.4 * STEP)) for begin in begins]
    assert np.mean(both) > 0.9
    assert np.all(result.certain)


@pytest.mark.parametrize("tau", [0.0, TAU])
@pytest.mark.parametrize("of_jerk", [False, True])
def test_the_output_of_jumps_is_the_sum_of_their_responses(tau: float, of_jerk: bool):
    rng = np.random.default_rng(8)
    t, n, at, size = STEP * np.arange(500), 20, 0.3 * rng.random(20), rng.standard_normal(20)
    late = np.maximum(t[:, None] - at, 0.0)
    decay = np.exp(-late / tau) if tau else np.zeros_like(late)
    item = late - tau * (1.0 - decay) if of_jerk else (late > 0.0) * (1.0 - decay)
    ones, flags = np.ones(n), np.ones(n, dtype=bool)
    some = Jumps(at, size, flags & of_jerk, tau * ones, flags, ones, ones)
    np.testing.assert_allclose(output_of(some, 0.0, STEP, 500), item @ size, atol=1e-12)  # sums of 20 terms near 1


def test_two_wrong_samples_in_a_row_are_not_called_jumps():
    t, u, _ = output("smooth", 30.0, 31)
    at = np.random.default_rng(2).choice(np.arange(100, len(t) - 100, 25), WRONG, replace=False)
    u[at] += 20.0 * SIGMA
    u[at + 1] += 15.0 * SIGMA
    certain = jumps(t, u, STEP, TAU)
    certain_t = certain.t[certain.certain]
    mistaken = [k for k in at if len(certain_t) and np.min(np.abs(certain_t - t[k])) < 5 * STEP]
    assert len(mistaken) <= 4  # of 40: a rate of 3 % leaves more than four in 0.7 % of such records


def test_noise_holds_no_jumps():
    rng = np.random.default_rng(3)
    u = rng.standard_normal(400_000)
    result = jumps(STEP * np.arange(len(u)), u, STEP, TAU)
    assert len(result.t) <= 3  # 5.7e-7 a sample: 0.23 are expected, four in 1 of 10 000 series


@pytest.mark.parametrize("of_jerk", [False, True])
@pytest.mark.parametrize("tau", [0.0, 3e-4, 1e-3])
def test_the_lost_velocity_is_that_of_the_replay(of_jerk: bool, tau: float):
    """The integral of the interpolated output against the closed form, over phases of the jump."""
    t = STEP * np.arange(60)
    errors = []
    for phase in np.linspace(0.0, 1.0, 40, endpoint=False) + 0.0125:
        begin = t[25] + phase * STEP
        x = np.maximum(t - begin, 0.0)
        decay = np.exp(-x / tau) if tau else (x <= 0.0).astype(float)
        u = x - tau * (1.0 - decay) if of_jerk else (x > 0.0) * (1.0 - decay)
        first, _, _ = _core.drive(t, u, np.array([t[10], t[45]]), how="cubic", tau=tau, delay=0.0, hole=1.0)
        run = t[45] - begin
        errors.append(first[1] - (run**2 / 2.0 if of_jerk else run))
    if tau and not of_jerk:
        errors = [error + tau * math.exp(-(t[45] - t[25]) / tau) for error in errors]  # what the pole still holds
    values = np.array([1.0])
    jump = Jumps(values, values, np.array([of_jerk]), np.array([tau]), np.array([True]), values, values)
    assert np.std(errors) == pytest.approx(float(lost_velocity(jump, STEP)[0]), rel=0.1)
    assert len(lost_velocity(Jumps(NONE, NONE, NO_FLAGS, NONE, NO_FLAGS, NONE, NONE), STEP)) == 0


def test_lost_samples_are_filled_in_without_a_bias():
    """A cubic over a lost sample errs by (w h)^4/6 of a motion at 80 Hz; the polynomial of eight by (w h)^8/70."""
    t, w = STEP * np.arange(2000), 2.0 * math.pi * 80.0
    remaining = np.arange(2000) % 13 != 5
    result = fill_gaps(t[remaining], np.sin(w * t[remaining]), STEP)
    assert np.all(result.filled)
    at = t[~remaining][3:-3]
    filled = np.interp(at, result.t, result.y)
    cubic = np.array(
        [np.polyval(np.polyfit([-2, -1, 1, 2], np.sin(w * (x + STEP * np.array([-2, -1, 1, 2]))), 3), 0) for x in at]
    )
    assert np.max(np.abs(filled - np.sin(w * at))) < 2e-6
    assert np.max(np.abs(cubic - np.sin(w * at))) > 1e-3


@pytest.mark.parametrize("lost", [4, 10, 16])
def test_longer_gaps_are_filled_where_the_motion_allows(lost: int):
    """20 Hz at 1667 Hz; a step of the acceleration next to the gap, which no polynomial follows, leaves it open."""
    t, w = STEP * np.arange(400), 2.0 * math.pi * 20.0
    remaining = (t < t[200]) | (t >= t[200 + lost])
    noise = 1e-4 * np.random.default_rng(4).standard_normal(400)
    filled = fill_gaps(t[remaining], (np.sin(w * t) + noise)[remaining], STEP)
    assert np.all(filled.filled)
    missing = np.sin(w * t[~remaining]).mean()
    within = (filled.t > filled.begin[0]) & (filled.t < filled.end[0])
    assert np.count_nonzero(within) == lost
    std = 1e-4 * math.sqrt(float(filled.noise[0]) + lost) / lost
    assert abs(filled.y[within].mean() - missing) < 5.0 * std + (5e-4 if lost == 16 else 1e-5)  # (w gap)^8 at 16
    assert not fill_gaps(t[remaining], (np.sin(w * t) + noise + (t > t[203 + lost]))[remaining], STEP).filled.any()


@pytest.mark.parametrize("lost", [1, 2, 3, 6, 12])
def test_the_noise_of_a_gap_is_that_of_its_integral(lost: int):
    rng = np.random.default_rng(6)
    t = np.arange(300.0)
    remaining = (t < 150) | (t >= 150 + lost)
    at = np.array([130.0, 182.0])
    gained, whole = [], []
    for _ in range(4000):
        y = rng.standard_normal(300)
        filled = fill_gaps(t[remaining], y[remaining], 1.0)
        if not filled.filled[0]:  # the noise of so few samples is sometimes taken for less than it is
            continue
        noise = float(filled.noise[0])
        for times, values, sums in ((filled.t, filled.y, gained), (t, y, whole)):
            first, _, _ = _core.drive(times, values, at, how="cubic", tau=0.0, delay=0.0, hole=20.0)
            sums.append(first[1])
    assert len(gained) > 3900
    assert np.var(gained) == pytest.approx(np.var(whole) + noise, rel=0.15)  # 3 % a deviation


def test_a_bridge_continues_a_smooth_series():
    x = np.linspace(0.0, 6.0, 600)
    hidden = np.zeros(600, dtype=bool)
    hidden[200:215] = hidden[597:] = True
    filled = bridged(np.where(hidden, 50.0, np.sin(x)), hidden)
    assert np.max(np.abs(filled - np.sin(x))[:590]) < 1e-6
