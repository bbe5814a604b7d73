"""Saturated and stuck readings are left out of every estimate; honest repeats and peaks are not."""

from __future__ import annotations

import ast
from dataclasses import replace

import numpy as np
import pytest

from accelcal import verbs
from accelcal.data.recording import Channel, Recording
from accelcal.data.rig import ChannelFilter, LowPass
from accelcal.diagnosis.faults import faults
from accelcal.diagnosis.left_out import MOST_CUT, cut_without, without_wrong_readings
from accelcal.estimation.estimate import estimate
from accelcal.estimation.run import prepare
from accelcal.model import Model
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, simulate

RIGS = {"ADXL105": ADXL105_RIG, "CXL02": CXL02_RIG}
TRUTH = {"bias": 0.1, "scale_factor": 0.02}
RATE, LENGTH = 500.0, 24.0
KINDS = ("asleep", "held", "encoder hangs", "saturated")


def record(motion, rig, seed, seconds=45.0):
    rng = np.random.default_rng(seed)
    return simulate(motion, seconds=seconds, rig=rig, parameters=TRUTH, rng=rng).recording


def changed(recording, **channels):
    """The recording with other values of its channels."""
    return replace(
        recording,
        **{name: replace(getattr(recording, name), y=np.ascontiguousarray(y)) for name, y in channels.items()},
    )


def in_range(recording, limit):
    return replace(recording, rig=replace(recording.rig, sensor=replace(recording.rig.sensor, range=limit)))


def faulty(kind, good):
    """A recording with one fault of two seconds, or an output clipped at 70 % of its peak; channel and kind of it."""
    a, p = good.accel, good.position
    during, held = (abs(channel.t - 21.0) < 1.0 for channel in (a, p))
    if kind == "asleep":
        return changed(good, accel=np.where(during, 0.0, a.y)), ("accel", "stuck")
    if kind == "held":
        return changed(good, accel=np.where(during, a.y[np.argmax(during)], a.y)), ("accel", "stuck")
    if kind == "encoder hangs":
        return changed(good, position=np.where(held, p.y[np.argmax(held)], p.y)), ("position", "stuck")
    limit = 0.7 * float(np.max(np.abs(a.y)))
    return in_range(changed(good, accel=np.clip(a.y, -limit, limit)), limit), ("accel", "saturated")


@pytest.mark.parametrize(("kind", "rig"), list(zip(KINDS, ("ADXL105", "CXL02", "ADXL105", "CXL02"), strict=True)))
def test_wrong_readings_take_no_part_in_a_fit(kind, rig):
    """4 sigma of two parameters in 4 records: one false alarm in two thousand runs. The twin, a fit to every
    reading, is off by more."""
    bad, expected = faulty(kind, record("interleaved", RIGS[rig], 31))
    fit = verbs.fit(bad)
    errors = [(fit[name].value - value) / fit[name].std for name, value in TRUTH.items()]
    every = estimate(Model.linear(), bad)
    twin = max(abs(every[name].value - value) / fit[name].std for name, value in TRUTH.items())
    (fault,) = without_wrong_readings(bad).left_out
    print(f"{kind} {rig}: {np.round(errors, 1)} sigma, {twin:.0f} with them; {fault.count} of {fault.of}")
    assert max(np.abs(errors)) < 4.0
    assert twin > 5.0
    assert (fault.channel, fault.kind) == expected
    messages = [remark.sentence for remark in fit.remarks if "are left out" in remark.sentence]
    assert len(messages) == 1
    assert f"{fault.count} of {fault.of} readings of {fault.channel}" in messages[0]
    assert fit.tilt == 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_the_verdict_is_that_of_the_rest(kind):
    bad, (channel, code) = faulty(kind, record("interleaved", CXL02_RIG, 32))
    diagnosis = verbs.diagnose(verbs.fit(bad), bad)
    print(diagnosis.sentence)
    assert diagnosis.verdict == "adequate"
    assert diagnosis.effects == ()
    assert [remark.code for remark in diagnosis.remarks if remark.place == "data"] == [code]
    assert f"readings of {channel} " in diagnosis.suspect[0]


def test_a_hole_that_was_left_out_is_no_dropout():
    bad, _ = faulty("asleep", record("interleaved", CXL02_RIG, 33))
    whole = without_wrong_readings(bad)
    assert faults(whole, prepare(whole)) == ()


def test_held_out_data_leave_them_out_and_say_so():
    good = record("interleaved", CXL02_RIG, 34)
    bad, _ = faulty("held", record("interleaved", CXL02_RIG, 35))
    improvement = verbs.improve(good, holdout=bad, most=1)
    clean = verbs.improve(good, holdout=record("interleaved", CXL02_RIG, 35), most=1)
    rms = [step.steps[-1].heldout.coast_rms[1.0] for step in (improvement, clean)]
    print(f"drift after 1 s {rms[0]:.3g} m, without the fault {rms[1]:.3g} m")
    assert rms[0] < 1.3 * rms[1]
    assert any(text.startswith("held out, ") and "are left out" in text for text in improvement.diagnosis.suspect)
    evaluation = verbs.compare(improvement.steps[0].fit, bad)[0]
    assert len(evaluation.left_out) == 1
    assert evaluation.coast_rms[1.0] < 1.3 * rms[1]


@pytest.mark.parametrize("filters", ["RC", "second order"])
def test_readings_beside_a_limit_go_as_far_as_the_filters_reach(filters):
    good = record("interleaved", CXL02_RIG, 36)
    y, limit = good.accel.y.copy(), 1.5 * float(np.max(np.abs(good.accel.y)))
    y[10_000:10_020] = limit
    lowpass, output = LowPass(50.0), (ChannelFilter("butterworth", order=2, cutoff=50.0),)
    rig = replace(
        good.rig, lowpass=lowpass if filters == "RC" else None, output_filters=() if filters == "RC" else output
    )
    (fault,) = without_wrong_readings(in_range(replace(changed(good, accel=y), rig=rig), limit)).left_out
    begin, end = fault.stretches[0]
    reach = 18.0 * lowpass.tau
    before, after = good.accel.t[10_000] - begin, end - good.accel.t[10_019]
    print(f"{filters}: {1e3 * before:.1f} ms before, {1e3 * after:.1f} ms after")
    for beside in (before, after):
        assert reach < beside < 2.0 * reach


def test_an_element_at_its_limit_is_seen_through_the_low_pass():
    """Clipped before an RC that is slower than the clips, so that the output never comes to the limit."""
    step, limit, lowpass = 1.0 / RATE, 5.0, LowPass(15.0)
    t = np.arange(0.0, LENGTH, step)
    fine = np.arange(0.0, LENGTH, step / 20.0)
    force = np.where(abs(fine - 12.0) < 3.0, 8.0, 3.0) * np.sin(2.0 * np.pi * 20.0 * fine)
    clipped = np.clip(force, -limit, limit)
    decay = np.exp(-step / 20.0 / lowpass.tau)
    lagged = np.empty_like(clipped)
    lagged[0] = 0.0
    for k in range(1, len(fine)):
        lagged[k] = decay * lagged[k - 1] + (1.0 - decay) * 0.5 * (clipped[k] + clipped[k - 1])
    y = lagged[::20] + 1e-3 * np.random.default_rng(5).standard_normal(len(t))
    assert float(np.max(np.abs(y))) < 0.99 * limit
    good = in_range(record("tones", CXL02_RIG, 37, seconds=LENGTH), limit)
    bad = replace(good, accel=Channel("accel", t, y, "m/s^2"))
    declared, undeclared = (
        without_wrong_readings(replace(bad, rig=replace(bad.rig, lowpass=filters))).left_out
        for filters in (lowpass, None)
    )
    assert undeclared == ()
    (fault,) = declared
    print(fault.stretches[0], fault.stretches[-1])
    assert fault.kind == "saturated"
    assert fault.stretches[0][0] == pytest.approx(9.0, abs=20.0 * lowpass.tau)
    assert fault.stretches[-1][1] == pytest.approx(15.0, abs=20.0 * lowpass.tau)


def coarse(good):
    """Steps of 0.5 m/s²: long runs of one value while the stage moves."""
    return changed(good, accel=0.5 * np.rint(good.accel.y / 0.5))


def coarse_encoder(good):
    return changed(good, position=1e-4 * np.rint(good.position.y / 1e-4))


def drifting_at_rest(good):
    """A resting stage shows one count for as long as it rests, while the bias wanders."""
    t = good.accel.t
    quiet = changed(good, position=1e-6 * np.rint(good.position.y / 1e-6))
    return changed(quiet, accel=good.accel.y + 0.02 * np.sin(2.0 * np.pi * 0.03 * t))


def touched_at_rest(good):
    """The cable is touched while the stage rests."""
    p = 1e-6 * np.rint(good.position.y / 1e-6)
    longest = max(resting(p), key=lambda run: run[1] - run[0])
    middle = float(np.mean(good.position.t[list(longest)]))
    bump = 0.5 * np.exp(-0.5 * ((good.accel.t - middle) / 0.1) ** 2)
    return changed(good, position=p, accel=good.accel.y + bump)


def resting(p):
    edges = np.flatnonzero(np.diff(np.concatenate([[1], np.diff(p) != 0.0, [1]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def on_a_floor_that_shakes(good):
    """Encoder and scale move together with the floor, which the output alone shows."""
    quiet = changed(good, position=1e-6 * np.rint(good.position.y / 1e-6))
    return changed(quiet, accel=good.accel.y + 0.02 * np.sin(2.0 * np.pi * 5.0 * good.accel.t))


def beyond_the_range(good):
    """The declared range is another one: readings lie beyond it."""
    return in_range(good, 0.8 * float(np.max(np.abs(good.accel.y))))


def up_to_the_range(good):
    return in_range(good, 1.0001 * float(np.max(np.abs(good.accel.y))))


def clipped_without_a_range(good):
    """What clips is left to the effect `saturation` where noise enters behind it and no range is declared."""
    limit = 0.7 * float(np.max(np.abs(good.accel.y)))
    noise = 1e-3 * np.random.default_rng(6).standard_normal(len(good.accel))
    return in_range(changed(good, accel=np.clip(good.accel.y, -limit, limit) + noise), None)


HONEST = (
    coarse,
    coarse_encoder,
    drifting_at_rest,
    touched_at_rest,
    on_a_floor_that_shakes,
    beyond_the_range,
    up_to_the_range,
    clipped_without_a_range,
)


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("motion", ["interleaved", "rests", "tones"])
@pytest.mark.parametrize("build", HONEST, ids=lambda build: build.__name__)
def test_honest_records_lose_nothing(build, motion, rig):
    if build is touched_at_rest and motion == "tones":
        pytest.skip("no rest")
    remaining = build(record(motion, RIGS[rig], 38))
    assert without_wrong_readings(remaining) is remaining


def behind_one_count(size, shown=0.0):
    """Sines, and from 20 s to 30 s one period of a square wave of so many counts of the output, which shows others."""
    t, count = np.arange(0.0, 60.0, 0.01), 0.5
    square = count * np.where(t < 25.0, 1.0, -1.0)
    sines = 3.0 * np.sin(2.0 * np.pi * 0.7 * t) + 2.0 * np.sin(2.0 * np.pi * 1.1 * t)
    a, y = (np.where((t >= 20.0) & (t < 30.0), counts * square, sines) for counts in (size, shown))
    p = np.cumsum(np.cumsum(a)) * 0.01**2 + 1e-5 * np.random.default_rng(3).standard_normal(len(t))
    return Recording.from_arrays(t, count * np.rint(y / count), p, units={"accel": "m/s^2", "position": "m"})


def test_a_count_hides_a_motion_by_the_square_of_its_length():
    """A square wave below half a count for ten seconds moves the stage by metres, and is no fault; three counts are."""
    still = behind_one_count(0.49)
    assert without_wrong_readings(still) is still
    (fault,) = without_wrong_readings(behind_one_count(3.0)).left_out
    assert (fault.channel, fault.kind) == ("accel", "stuck")
    assert fault.stretches[0] == pytest.approx((20.0, 30.0), abs=0.2)


def denied(good):
    """Ten readings in motion that are ten times the largest: no position follows."""
    y = good.accel.y.copy()
    y[10_000:10_010] = 10.0 * float(np.max(np.abs(y)))
    return changed(good, accel=y)


@pytest.mark.parametrize("kind", [*KINDS, "denied"])
def test_what_is_left_out_does_not_depend_on_where_the_clock_begins(kind):
    """Stamps of a day, as loggers write them; a position far from zero, as a scale along a bench reads it."""
    good = record("interleaved", CXL02_RIG, 39)
    bad = denied(good) if kind == "denied" else faulty(kind, good)[0]
    accel, position = (replace(channel, t=channel.t + 65_536.0) for channel in (bad.accel, bad.position))
    later = replace(bad, accel=accel, position=replace(position, y=position.y + 3.0))
    here, there = (without_wrong_readings(recording).left_out for recording in (bad, later))
    assert here
    assert [(fault.kind, fault.count) for fault in there] == [(fault.kind, fault.count) for fault in here]
    stretches = [np.array([fault.stretches for fault in left]) for left in (here, there)]
    np.testing.assert_allclose(stretches[1] - 65_536.0, stretches[0], atol=1e-9)


def test_the_call_that_is_advised_takes_the_stretch_with_its_ends():
    """To a millisecond beyond either end; stretches that meet are one."""
    good = record("interleaved", CXL02_RIG, 40, seconds=10.0)
    clause = cut_without(good, [(3.0, 4.0), (6.0, 6.5), (4.001, 5.0)])
    rest = good.without(*ast.literal_eval("[" + clause.split("recording.without(")[1][:-1] + "]"))
    for channel in (rest.accel, rest.position):
        assert not np.any((channel.t >= 3.0) & (channel.t <= 5.0)), channel.name
        assert not np.any((channel.t >= 6.0) & (channel.t <= 6.5)), channel.name
        assert np.any((channel.t > 5.0) & (channel.t < 5.1)), channel.name
    assert clause.count("(") == 3
    assert cut_without(good, [(float(k), k + 0.5) for k in range(MOST_CUT + 1)]) == ""
