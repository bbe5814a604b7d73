"""Alarms of a live view: as rare as stated while the model holds, soon after it no longer holds, of the right cause."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from accelcal.filters.stream import Readings
from accelcal.live.tracker import (
    CAUSES,
    FALSE_ALARM,
    Alarm,
    InnovationMonitor,
    Tracker,
    chi_square_bounds,
    normal_bound,
)
from benches.monitoring import SETTINGS, Change, Record, null, settings

READINGS = 200
BLOCKS = 1500
RAISED = 0.02
"""False-alarm probability of a block at which alarms can be counted."""
OF_TEST = 1e-4
"""Probability that a test of counts fails by chance."""


def monitor(**given: float) -> InnovationMonitor:
    return InnovationMonitor(least_readings=READINGS, least_time=0.0, settling=0, **given)  # type: ignore[arg-type]


def readings(scores: np.ndarray, slope: float = 1.0) -> Readings:
    """White readings a second apart, of variance one, with the same slope by the bias, and none by the scale factor."""
    n = len(scores)
    table = np.zeros((n, 12))
    table[:, 0], table[:, 1], table[:, 2], table[:, 4] = np.arange(n), 1e3 * np.arange(n), scores, scores
    table[:, [3, 5, 6]] = 1.0
    table[:, 8], table[:, 10] = slope * scores, slope**2
    return Readings(table)


def test_false_alarms_are_as_many_as_stated() -> None:
    rng = np.random.default_rng(1)
    alarms = monitor(false_alarm=RAISED, tolerance=0.0).add(readings(rng.standard_normal(READINGS * BLOCKS)))
    # Of four tests with a quarter each, one may be 0.02 off, and less noise is no alarm: about 2.75 count.
    expected = 0.6875 * RAISED * BLOCKS
    low, high = stats.binom.ppf([OF_TEST / 2, 1 - OF_TEST / 2], BLOCKS, 0.6875 * RAISED)
    print(f"{len(alarms)} alarms in {BLOCKS} blocks, expected about {expected:g}, {low:g} to {high:g}")
    assert low <= len(alarms) <= high
    assert {"mean", "noise", "jump"} <= {alarm.kind for alarm in alarms}


def test_p_of_a_block_is_as_often_small_as_stated() -> None:
    """Honest rigs: rounding, lost rows, and noise that dominates; false alarm 1e-4."""
    lines = [null((at, 0, 77), hours=0.1 if at else 1.0) for at in (0, 4, 5, 8)]
    blocks, below = sum(line["blocks"] for line in lines), sum(line["below"][0] for line in lines)
    low, high = stats.binom.ppf([OF_TEST / 2, 1 - OF_TEST / 2], blocks, 1e-2)
    print(f"{below} of {blocks} blocks below 1e-2, {low:g} to {high:g}")
    assert low > 0
    assert low <= below <= high
    assert not any(line["alarms"] for line in lines)


def test_raw_innovations_are_not_what_the_tests_are_for() -> None:
    """The twin: where noise of the output dominates, e²/S is 0.8 with nothing wrong, and nearly no block holds."""
    rig, rng = SETTINGS[5], np.random.default_rng(3)
    chosen = settings(rig, rng)
    rows = Tracker(chosen).feed(Record(rig, rng).take(60_000))
    raw = rows.table.copy()
    raw[:, 4:6] = raw[:, 2:4]
    white, crude = InnovationMonitor(settling=5), InnovationMonitor(tolerance=0.0)
    assert not white.add(rows)
    crude.add(Readings(raw))
    assert crude.nis is not None
    assert crude.nis.value < 0.85
    assert crude.p is not None
    assert crude.p < 1e-6


@pytest.mark.parametrize("factor", [1.0 / 1.2, 1.2])
def test_noise_within_the_tolerance_raises_no_more(factor: float) -> None:
    rng = np.random.default_rng(2)
    scaled = readings(np.sqrt(factor) * rng.standard_normal(READINGS * BLOCKS))
    assert len(monitor(false_alarm=RAISED).add(scaled)) <= stats.binom.ppf(1 - OF_TEST, BLOCKS, RAISED)
    # The twin: without the tolerance the same noise is noticed; less of it is a remark alone.
    strict = monitor(false_alarm=RAISED, tolerance=0.0)
    alarms = strict.add(scaled)
    assert bool(len(alarms) > 0.1 * BLOCKS) == (factor > 1.0)


def test_no_alarm_at_the_rate_of_the_view() -> None:
    rng = np.random.default_rng(3)
    assert BLOCKS * FALSE_ALARM < 0.01  # the probability that this test fails by chance
    assert not monitor().add(readings(rng.standard_normal(READINGS * BLOCKS)))


@pytest.mark.parametrize(("shift", "factor", "kind"), [(0.6, 1.0, "mean"), (0.0, 4.0, "noise")])
def test_a_model_that_does_not_hold_raises_an_alarm(shift: float, factor: float, kind: str) -> None:
    rng = np.random.default_rng(4)
    alarms = monitor().add(readings(shift + np.sqrt(factor) * rng.standard_normal(READINGS * 20)))
    assert len(alarms) == 20
    assert {alarm.kind for alarm in alarms} == {kind}


def test_a_change_that_a_block_hardly_shows_is_shown_by_four(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four standard deviations of what a block tells; in the twin blocks alone are judged."""
    scores = np.random.default_rng(31).standard_normal(READINGS * 32) + 4.0 / math.sqrt(READINGS)

    def alarms() -> list[Alarm]:
        return [alarm for alarm in monitor().add(readings(scores)) if alarm.kind == "mean"]

    together = alarms()
    assert len(together) >= 8
    assert together[0].t < 4 * READINGS
    assert {alarm.readings for alarm in together} <= {k * READINGS for k in (1, 2, 3, 4)}
    monkeypatch.setattr("accelcal.live.tracker.POOLED", 1)
    assert len(alarms()) < 4


def test_less_noise_than_declared_is_a_remark() -> None:
    rng = np.random.default_rng(4)
    tested = monitor()
    assert not tested.add(readings(0.6 * rng.standard_normal(READINGS)))
    assert "more noise is declared than there is" in tested.remark
    assert tested.holds
    tested.add(readings(rng.standard_normal(READINGS)))
    assert not tested.remark


@pytest.mark.parametrize("at", [0, 5, 9])
@pytest.mark.parametrize(
    ("change", "size", "kind"), [("noise", 2.0, "noise"), ("bias", 0.3, "mean"), ("counts", 30.0, "jump")]
)
def test_an_alarm_says_the_cause(at: int, change: str, size: float, kind: str) -> None:
    rig, rng = SETTINGS[at], np.random.default_rng((9, at))
    chosen = replace(settings(rig, rng), covariance=np.diag([1e-4, 1e-3]) ** 2, theta=np.array([0.01, 0.05]))
    tracker, record = Tracker(chosen), Record(rig, rng, Change(change, 40.0, size))
    tested, alarms = InnovationMonitor(resolution=chosen.sharp_resolution), list[Alarm]()
    while record.rows < 60.0 * rig.rate:
        alarms += tested.add(tracker.feed(record.take(int(rig.rate))))
    assert alarms
    assert alarms[0].t >= 40.0
    assert Counter(alarm.kind for alarm in alarms).most_common(1)[0][0] == kind
    assert CAUSES[alarms[0].kind].split("; ")[1] in alarms[0].sentence


def followed(at: int, seconds: float, *, q: float = 1.0, frozen: float = math.inf, **changes: float) -> Any:
    """A rig from what a fit would tell, its output's noise declared `q` times as strong: monitor and alarms."""
    rig, rng = SETTINGS[at], np.random.default_rng((12, at))
    chosen = settings(rig, rng)
    start = {"covariance": np.diag([1e-4, 1e-3]) ** 2, "theta": np.array([0.01, 0.05]), "begun": True}
    chosen = replace(chosen, q=q * chosen.q, **start)
    tracker, record = Tracker(chosen), Record(rig, rng, Change("bias", **changes) if changes else None)
    tested, alarms = InnovationMonitor(resolution=chosen.sharp_resolution), list[Alarm]()
    while record.rows < seconds * rig.rate:
        rows = record.take(int(rig.rate))
        rows.position[rows.t >= frozen] = 0.125
        alarms += tested.add(tracker.feed(rows))
    return tested, alarms


@pytest.mark.parametrize("at", [0, 5, 9])
def test_an_encoder_that_stands_still_beside_a_moving_stage_raises_an_alarm(at: int) -> None:
    _, alarms = followed(at, 45.0, frozen=30.0)
    assert alarms
    assert 30.0 < alarms[0].t < 35.0


@pytest.mark.parametrize(("at", "q"), [(2, 9.0), (5, 25.0), (9, 9.0)])
def test_noise_of_the_sensor_that_is_declared_too_large_is_no_alarm(at: int, q: float) -> None:
    tested, alarms = followed(at, 40.0, q=q)
    assert not alarms
    assert "more noise is declared than there is" in tested.remark


@pytest.mark.parametrize("q", [1.0 / 1.2, 1.2])
def test_noise_of_the_output_that_dominates_may_be_as_far_off(q: float) -> None:
    """The slope by the scale factor holds the declared noise; without its tolerance 15 of 1188 blocks alarm."""
    tested, alarms = followed(7, 60.0, q=q)
    assert tested.blocks >= 55
    assert not alarms


def test_a_tone_makes_neighbours_correlate() -> None:
    rng = np.random.default_rng(5)
    scores = rng.standard_normal(READINGS) + 2.0 * np.sin(0.3 * np.arange(READINGS))
    scores /= np.std(scores)
    (alarm,) = monitor().add(readings(scores, slope=0.0))
    assert alarm.kind == "whiteness"


def test_blocks_last_as_long_as_stated_and_the_first_readings_do_not_count() -> None:
    tested = InnovationMonitor(least_readings=10, least_time=1.0, settling=1)
    table = readings(np.concatenate([np.full(5, 100.0), np.random.default_rng(1).standard_normal(210)])).table
    table[:, 0] *= 0.01
    for rows in np.array_split(table[:206], 9):  # in pieces, whose ends are no ends of blocks
        assert not tested.add(Readings(rows))
    assert (tested.blocks, tested.alarms, tested.holds) == (1, 0, True)


def test_readings_that_stay_on_a_count_are_not_judged_as_white() -> None:
    rng = np.random.default_rng(6)
    rows = readings(np.where(np.arange(READINGS) < 100, 1.2, rng.standard_normal(READINGS)), slope=0.0).table
    rows[:100, 1] = 7.0  # at rest: one rounding error
    resting, other = monitor(resolution=1.0), monitor()
    resting.add(Readings(rows))
    other.add(Readings(rows))
    assert (resting.alarms, other.alarms) == (0, 1)
    assert SETTINGS[3].gaussian == 0.5e-6  # half a count of other noise hides the rounding
    assert settings(SETTINGS[3], rng).sharp_resolution == 0.0
    assert settings(SETTINGS[0], rng).sharp_resolution == 1e-6


def test_alarms_in_a_row_know_their_first() -> None:
    first, second = monitor().add(readings(np.full(2 * READINGS, 3.0)))
    assert first.since == second.since == first.t
    assert "expected" in first.sentence


def test_bounds_are_those_of_scipy() -> None:
    for n in (1, 10, 1000):
        low, high = chi_square_bounds(n, 0.01)
        assert (low * n, high * n) == pytest.approx(stats.chi2.ppf([0.005, 0.995], n), rel=1e-9)
    assert normal_bound(0.05) == pytest.approx(1.959964, rel=1e-6)
    assert normal_bound(1e-20) == pytest.approx(stats.norm.isf(5e-21), rel=1e-9)


def test_an_innovation_that_is_no_number_is_an_alarm() -> None:
    assert monitor().add(readings(np.full(READINGS, np.nan)))
