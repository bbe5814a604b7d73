"""What was understood of a recording, against numbers known by construction."""

import json

import numpy as np
import pytest

from accelcal.data.quality import describe, rest, summarise
from accelcal.data.recording import Channel, Finding, Recording
from accelcal.data.rig import Rig, Sensor

NO_OUTPUT = Channel("accel", np.arange(2.0), np.zeros(2), "m/s^2")


def recording(rate=1000.0, **options):
    t = np.arange(int(4 * rate)) / rate
    moving = (t >= 1) & (t < 2.5)
    position = np.where(moving, 0.01 * (1 - np.cos(2 * np.pi * 2 * (t - 1))), 0.0)
    remaining = (t < 3.2) | (t > 3.4)
    return Recording(
        accel=Channel("accel", t, np.where(moving, 2.0, 0.5), "m/s^2"),
        position=Channel("position", t[remaining], np.round(position, 6)[remaining], "m"),
        side={"temperature": Channel("temperature", t[:1], np.array([20.0]), "degC")},
        **({"rig": Rig(sensor=Sensor(range=4.0))} | options),
    )


@pytest.mark.parametrize("resolution", [None, 1e-6])
def test_rest_is_found_where_the_stage_stands(resolution):
    result = rest(recording(rig=Rig(resolution=resolution)))
    np.testing.assert_allclose(result, [(0.0, 1.0), (2.5, 4.0)], atol=0.1)  # judged on spans of 0.1 s


def test_a_shaker_at_a_high_frequency_is_not_at_rest():
    t = np.arange(0.0, 4.0, 2e-4)
    a = np.where(t < 2.0, np.sin(2.0 * np.pi * 5.0 * t), 10.0 * np.sin(2.0 * np.pi * 1000.0 * t)) * (t < 3.0)
    y = a + 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    x = np.where(t < 2.0, -a / (2.0 * np.pi * 5.0) ** 2, -a / (2.0 * np.pi * 1000.0) ** 2)
    shaken = Recording(Channel("accel", t, y, "m/s^2"), Channel("position", t, x, "m"), Rig())
    ((start, end),) = rest(shaken)
    assert 3.0 <= start < 3.2
    assert end == pytest.approx(t[-1])


def rested(rate, y):
    """A stage that moves from 5 s to 10 s of 15 s, with an output that has something beside the motion."""
    t = np.arange(0.0, 15.0, 1.0 / rate)
    moving = (t > 5.0) & (t < 10.0)
    x = np.where(moving, 0.03 * np.sin(2.0 * np.pi * 0.1 * (t - 5.0)) ** 3 * np.sin(2.0 * np.pi * (t - 5.0)), 0.0)
    a = np.gradient(np.gradient(x, t), t)
    return Recording(Channel("accel", t, y(t, a), "m/s^2"), Channel("position", t, x, "m"), Rig())


def test_an_output_that_toggles_between_two_codes_is_at_rest():
    noise = 2e-3 * np.random.default_rng(1).standard_normal(15_000)
    coarse = rested(1000.0, lambda t, a: 0.05 * np.rint((a + noise + 0.08 * t / 15.0) / 0.05))
    assert [(start < 0.1, end - start > 4.8) for start, end in rest(coarse)] == [(True, True), (False, True)]


def test_few_samples_of_noise_are_at_rest():
    # less than one record in a hundred is cut by chance
    for seed in range(20):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(1200)
        slow = rested(80.0, lambda t, a, noise=noise: a + noise)
        fine = np.arange(0.0, 15.0, 1e-3)
        position = Channel("position", fine, np.interp(fine, slow.position.t, slow.position.y), "m")
        stretches = rest(Recording(slow.accel, position, Rig()))
        assert [end - start > 4.8 for start, end in stretches] == [True, True]


def test_motion_without_pause_has_no_rest():
    t = np.arange(1000) / 1000
    moving = Channel("position", t, np.sin(30 * t), "m")
    assert rest(Recording(NO_OUTPUT, moving, Rig())) == []


def test_stage_that_never_moves_is_at_rest_throughout():
    t = np.arange(1000) / 1000
    still = Channel("position", t, np.zeros(1000), "m")
    assert rest(Recording(NO_OUTPUT, still, Rig())) == [(0.0, 0.999)]


def test_record_without_position_has_no_rest_to_judge():
    empty = Channel("position", np.empty(0), np.empty(0), "m")
    run = recording()
    assert describe(Recording(run.accel, empty, Rig()))["rest_s"] == []


def test_description_gives_rates_spans_and_ranges_as_json():
    answer = json.loads(json.dumps(describe(recording())))
    assert answer["range_used"] == 0.5
    position = answer["channels"]["position"]
    assert position["rate_hz"] == pytest.approx(1000.0, rel=1e-9)
    assert position["longest_interval_s"] == pytest.approx(0.202, rel=1e-9)
    assert answer["channels"]["temperature"]["rate_hz"] is None


def test_summary_says_warnings_before_notes_and_ends_with_assumptions():
    findings = (Finding("gap", "accel", 1, 0.0, "a gap"), Finding("clipping", "accel", 1, 0.0, "a clip", "warning"))
    text = summarise(
        recording(findings=findings, rig=Rig(assumptions=("level",), sensor=Sensor(range=4.0)), name="run.csv")
    )
    lines = text.splitlines()
    assert lines[0] == "run.csv"
    assert "  range used: 50% of ±4 m/s^2" in lines
    assert "  temperature: 1 samples, no rate" in text
    assert "  at rest: 2." in text
    assert [line.strip() for line in lines[-3:]] == ["warning: a clip", "note: a gap", "assumed: level"]


def test_summary_says_when_nothing_rests():
    t = np.arange(1000) / 1000
    moving = Channel("position", t, np.sin(30 * t), "m")
    assert "at rest: never" in summarise(Recording(NO_OUTPUT, moving, Rig()))
