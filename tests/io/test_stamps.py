"""Stamps on a grid and held samples: the clock behind them is found, and nothing is found where there is none."""

import re

import numpy as np
import pytest

from accelcal.data.clocks import decimal_step, stamp_grid, uniform_clock, usual_step
from accelcal.data.quality import HELD, ROUNDED, Samples, clean
from accelcal.data.rig import Rig

N = 12_000


def check(t, y=None, name="position"):
    y = np.random.default_rng(2).standard_normal(len(t)) if y is None else y
    unit = {"accel": "m/s^2", "position": "m"}[name]
    channel, findings = clean(Samples("run.csv", name, t, y, unit, lambda i: f"row {i + 2}"), Rig())
    return channel, {finding.kind: finding for finding in findings}


def clock(rate, n=N):
    return 0.00123 + np.arange(n) / rate


def with_holes(t):
    return t[np.random.default_rng(3).random(len(t)) > 0.1]


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize(("rate", "step"), [(200.7, 1e-3), (120.0, 1e-3), (1667.03, 1e-4), (30.0, 1e-2)])
def test_rounded_stamps_give_their_clock_back(rate, step, holes):
    t = with_holes(clock(rate)) if holes else clock(rate)
    rounded = step * np.rint(t / step)
    channel, result = check(rounded)
    assert result[ROUNDED].size == pytest.approx(step, rel=1e-9)
    assert result[ROUNDED].jitter == 0.0
    error = channel.t - t
    assert np.ptp(error) < 1e-3 * step  # the stamps err over a whole step
    # A period that is a multiple of a third of the step hides the third in which the clock lies; said as such.
    assert abs(np.mean(error)) <= np.sqrt(3.0) * result[ROUNDED].common + 1e-3 * step
    assert result[ROUNDED].common == pytest.approx(
        (1.0 - (2 / 3 if rate in (120.0, 30.0) else 1.0)) * step / 12**0.5, abs=2e-3 * step
    )


@pytest.mark.parametrize("kind", ["exact", "holes", "jitter", "multiple", "fine"])
def test_nothing_is_said_of_stamps_that_are_not_rounded(kind):
    t = clock(200.7)
    if kind == "holes":
        t = with_holes(clock(250.0))
    elif kind == "jitter":
        t = t + 1e-3 * np.clip(np.random.default_rng(4).standard_normal(N), -2, 2)
    elif kind == "multiple":
        t = 1e-3 * np.rint(clock(200.0) / 1e-3)
    elif kind == "fine":
        t = 1e-5 * np.rint(t / 1e-5)
    channel, result = check(t)
    assert ROUNDED not in result
    np.testing.assert_array_equal(channel.t, t)


def test_rounded_stamps_of_an_uneven_clock_are_kept_and_said():
    t = np.sort(clock(100.3) + 2e-3 * np.clip(np.random.default_rng(5).standard_normal(N), -2, 2))
    rounded = 1e-3 * np.rint(t / 1e-3)
    channel, result = check(rounded)
    np.testing.assert_array_equal(channel.t, rounded)
    assert result[ROUNDED].jitter == pytest.approx(1e-3 / 12**0.5)
    assert np.std(rounded - t) == pytest.approx(result[ROUNDED].jitter, rel=0.03)
    assert not uniform_clock(rounded).explains(stamp_grid(rounded))


@pytest.mark.parametrize(("logger", "sensor"), [(1000.3, 400.0), (200.7, 100.0), (50_000.0, 26_667.0)])
def test_held_samples_get_the_instants_of_the_sensor(logger, sensor):
    t = clock(logger)
    renewed = np.floor((t - 3.1e-5) * sensor).astype(int)
    values = np.random.default_rng(6).standard_normal(renewed[-1] + 1)
    channel, result = check(t, values[renewed], "accel")
    assert result[HELD].size == pytest.approx(1.0 / logger)
    match = re.search(r"renews its value at (\S+) Hz", result[HELD].text)
    assert match
    assert float(match[1]) == pytest.approx(sensor, rel=1e-4)
    inner = np.arange(renewed[0] + 1, renewed[-1] + 1)  # the first began before the record
    np.testing.assert_array_equal(channel.y, values[inner])
    instants = 3.1e-5 + inner / sensor
    np.testing.assert_allclose(channel.t, instants, atol=np.sqrt(3.0) * result[HELD].common + 0.03 / logger)


def test_the_period_of_uneven_stamps_keeps_step_with_them():
    uneven = np.sort(clock(100.3) + 2e-3 * np.clip(np.random.default_rng(9).standard_normal(N), -2, 2))
    slipped = abs(np.median(np.diff(uneven)) * 100.3 - 1.0) * N
    assert slipped > 10.0  # samples over the record, by the median
    assert abs(usual_step(uneven) * 100.3 - 1.0) * N < 0.5
    for t in (clock(100.3), with_holes(clock(100.3))):
        assert usual_step(t) == np.median(np.diff(t))


def test_held_samples_of_a_sensor_without_a_steady_clock_are_late_by_half_a_tick():
    t = clock(1000.3)
    stamps = np.cumsum(2.5e-3 + 4e-4 * np.clip(np.random.default_rng(7).standard_normal(N), -2, 2))
    renewed = np.searchsorted(stamps, t) - 1
    values = np.random.default_rng(8).standard_normal(N)
    rows = renewed >= 0
    channel, result = check(t[rows], values[renewed[rows]], "accel")
    assert result[HELD].jitter == pytest.approx(result[HELD].size / 12**0.5)
    late = channel.t - stamps[np.searchsorted(stamps, channel.t + 0.5 * result[HELD].size) - 1]
    assert np.mean(late) == pytest.approx(0.0, abs=0.03 * result[HELD].size)
    assert np.std(late) == pytest.approx(result[HELD].jitter, rel=0.05)


@pytest.mark.parametrize("decimals", [3, 6, 9])
def test_decimals_of_stamps_are_counted(decimals):
    t = np.round(np.arange(2000) / 1667.5, decimals)
    assert decimal_step(t) == pytest.approx(10.0**-decimals)
    assert decimal_step(np.arange(2000) / 1667.5) == 0.0
