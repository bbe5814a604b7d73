"""Each finding has a sister record in which there is nothing to find."""

import numpy as np
import pytest
import scipy

from accelcal.data.quality import Samples, clean, reading_step, require_overlap
from accelcal.data.recording import Channel, RecordingError
from accelcal.data.rig import Rig, Sensor

UNITS = {"accel": "m/s^2", "a_y": "m/s^2", "position": "m", "temperature": "degC"}


def check(t, y, name="accel", rig=None):
    t, y = np.asarray(t, dtype=float), np.asarray(y, dtype=float)
    return clean(Samples("run.csv", name, t, y, UNITS[name], lambda i: f"row {i + 2}"), rig or Rig())


def kinds(findings):
    return [finding.kind for finding in findings]


def noisy(n=4000, quantum=0.0, sigma=1.0, seed=0):
    y = sigma * np.random.default_rng(seed).standard_normal(n)
    return quantum * np.round(y / quantum) if quantum else y


def clock(n, rate=1000.0):
    return np.arange(n) / rate


def low_passed(n=100_000, sigma=1.3, keep=0.55, seed=0):
    """Codes of a sensor at rest whose noise, behind a low-pass, is little more than one of them."""
    shocks = np.random.default_rng(seed).standard_normal(n) * sigma * np.sqrt(1.0 - keep**2)
    return np.round(scipy.signal.lfilter([1.0], [1.0, -keep], shocks))


# Held repeats


@pytest.mark.parametrize("held", [2, 3])
def test_codes_behind_a_low_pass_that_are_written_several_times_are_found(held):
    y = np.repeat(low_passed(), held)
    assert "held_repeats" in kinds(check(clock(len(y)), y)[1])


@pytest.mark.parametrize(("logger", "sensor"), [(50_000, 26_667), (1000, 950), (1000, 500), (1000, 100)])
@pytest.mark.parametrize("quantum", [0.0, 0.01, 0.1])
def test_held_repeats_are_dropped_down_to_the_rate_of_the_sensor(logger, sensor, quantum):
    n = 20_000
    t = clock(n, logger)
    counts = np.floor(t * sensor + 1e-9).astype(int)
    fresh = noisy(counts[-1] + 1, quantum)
    channel, findings = check(t, fresh[counts])
    assert "held_repeats" in kinds(findings)
    first = np.flatnonzero(np.diff(counts, prepend=-1))
    assert np.mean(np.isin(first, np.searchsorted(t, channel.t))) > 0.95  # chance repeats cost some at quantum 0.1
    assert len(channel) == pytest.approx(len(first), rel=0.05)


@pytest.mark.parametrize(
    "y",
    [
        noisy(),
        noisy(quantum=0.1),
        noisy(quantum=1.0),
        noisy(quantum=4.0),
        np.concatenate([noisy(2000, 1.0, 0.1), noisy(2000, 1.0, 30.0)]),
        np.round(100 * np.sin(clock(4000) * 40)),
        np.sin(clock(4000) * 2 * np.pi * 10),
        np.clip(noisy(sigma=2.0), -1.0, 1.0),
        low_passed(),
        low_passed(sigma=0.9),
        np.concatenate([low_passed(50_000, sigma=1.3), low_passed(50_000, sigma=4.0)]),
    ],
    ids=[
        *("double", "fine", "coarse", "very coarse", "rest then motion", "quantised sine", "sine", "clipped"),
        *("noise of a code", "less than a code", "noise of one and of four"),
    ],
)
def test_repeats_that_quantisation_or_clipping_explains_are_kept(y):
    channel, findings = check(clock(len(y)), y)
    assert "held_repeats" not in kinds(findings)
    assert len(channel) == len(y)


def test_repeats_of_position_and_temperature_are_kept():
    y = 1e-3 * np.repeat(noisy(500), 4)
    for name, expected in (("position", ["position_repeats"]), ("temperature", [])):
        channel, findings = check(clock(len(y)), y, name)
        assert kinds(findings) == expected
        assert len(channel) == len(y)


def test_readings_on_a_grid_coarser_than_the_declared_resolution_are_said_and_the_grid_is_used():
    rig = Rig(resolution=1e-6)
    coarse, fine, few = noisy(500, 3.0), noisy(500, 1.0), np.repeat([0.0, 3.0, 9.0, 3.0], 100)
    for counts, expected in ((coarse, 3e-6), (fine, 1e-6), (few, 1e-6), (noisy(500), 1e-6)):
        y = 1e-6 * (counts + 5e4)
        assert reading_step(y, rig.resolution) == pytest.approx(expected, rel=1e-6)
        _, findings = check(clock(len(y)), y, "position", rig)
        assert ("coarse_grid" in kinds(findings)) == (expected > 1e-6)
    assert reading_step(1e-6 * coarse, None) == pytest.approx(3e-6, rel=1e-6)
    assert reading_step(1e-6 * noisy(500), None) == 0.0


# Stamps


def test_duplicate_stamps_with_one_value_keep_one():
    channel, findings = check([0.0, 0.1, 0.1, 0.2], [1.0, 2.0, 2.0, 3.0])
    assert channel.t.tolist() == [0.0, 0.1, 0.2]
    assert kinds(findings) == ["duplicate_stamps"]
    assert findings[0].text.endswith("1 sample repeats the time stamp before (first at t = 0.1 s): one of each is kept")
    assert findings[0].severity == "note"


def test_few_contradictory_stamps_are_averaged_with_a_warning():
    t, y = clock(1000), noisy(1000)
    t[501] = t[500]
    channel, findings = check(t, y)
    assert len(channel) == 999
    assert channel.y[500] == pytest.approx((y[500] + y[501]) / 2, rel=1e-15)
    assert findings[0].severity == "warning"
    assert "where the values differ (1 stamps) their mean is used" in findings[0].text


def test_stamps_coarser_than_the_sampling_are_refused():
    with pytest.raises(
        RecordingError, match=r"carry several different values .* coarser than the sampling: export them"
    ):
        check(np.floor(clock(1000) * 100) / 100, noisy(1000))


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_gaps_are_counted_and_the_longest_is_named(jitter):
    t = clock(1000) + jitter * 1e-3 * np.random.default_rng(0).uniform(-1, 1, 1000)
    y = noisy(1000)
    assert not check(t, y)[1]
    remaining = np.ones(1000, dtype=bool)
    remaining[100:105] = remaining[500:600] = False
    _, findings = check(t[remaining], y[remaining])
    assert kinds(findings) == ["gap"]
    assert findings[0].count == 2
    assert findings[0].first == pytest.approx(0.099, abs=1e-3)
    assert "the longest 0.10" in findings[0].text


# Clipping


def test_readings_at_the_declared_range_are_clipped():
    y = noisy()
    y[[7, 9]] = 49.0, -60.0
    rig = Rig(sensor=Sensor(range=49.03))
    _, findings = check(clock(len(y)), y, rig=rig)
    assert kinds(findings) == ["saturated"]
    assert (findings[0].count, findings[0].first, findings[0].severity) == (2, 0.007, "warning")
    assert not check(clock(len(y)), noisy(), rig=rig)[1]
    assert not check(clock(len(y)), y, name="a_y", rig=rig)[1]


def test_an_output_that_is_beyond_the_range_throughout_lacks_its_zero():
    y, rig = noisy() + 122.6, Rig(sensor=Sensor(range=49.03))
    _, (finding,) = check(clock(len(y)), y, rig=rig)
    assert f"{len(y)} of {len(y)} samples" in finding.text
    assert "declare the zero" in finding.text
    assert "saturated" not in finding.text


@pytest.mark.parametrize("quantum", [0.0, 0.02])
@pytest.mark.parametrize("sign", [1, -1])
def test_readings_piled_up_at_the_extreme_are_clipped(quantum, sign):
    y = sign * np.minimum(noisy(quantum=quantum), 1.0)
    _, findings = check(clock(len(y)), y)
    assert kinds(findings) == ["saturated"]
    assert f"piled up at the extreme {sign}" in findings[0].text


@pytest.mark.parametrize("amplitude", [20, 100, 1000.3])
@pytest.mark.parametrize("frequency", [1.0, 7.3, 50.0])
def test_extremes_of_a_quantised_sine_are_not_clipped(amplitude, frequency):
    y = np.round(amplitude * np.sin(2 * np.pi * frequency * clock(20_000)))
    assert "saturated" not in kinds(check(clock(20_000), y)[1])


# The rest


def test_constant_channel_is_warned_about():
    _, findings = check(clock(100), np.full(100, 3.0), "position")
    assert kinds(findings) == ["constant"]
    assert findings[0].text == "position: all 100 samples read 3; the channel carries no information"


@pytest.mark.parametrize(("scale", "expected"), [(1.0, []), (1000.0, ["implausible_travel", "implausible_speed"])])
def test_millimetres_read_as_metres_are_warned_about(scale, expected):
    y = scale * 0.1 * np.sin(2 * np.pi * 20 * clock(1000))
    assert kinds(check(clock(1000), y, "position")[1]) == expected


def test_side_channel_with_one_sample_is_kept():
    channel, findings = check([1.0], [20.0], "temperature")
    assert len(channel) == 1
    assert kinds(findings) == ["constant"]


def test_overlap_is_required():
    early, late = (Channel("x", np.array(t), np.zeros(2), "m") for t in ([0.0, 1.0], [1.0, 2.0]))
    require_overlap("run.csv", early, early)
    for a, b in ((early, late), (late, early)):
        with pytest.raises(RecordingError, match="share no stretch of time"):
            require_overlap("run.csv", a, b)
