"""Alarms of a live view: as rare as stated while the model holds, soon after it no longer holds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from accelcal.live.tracker import FALSE_ALARM, InnovationMonitor, chi_square_bounds, normal_bound

READINGS = 200
BLOCKS = 4000
RAISED = 0.02
"""False-alarm probability of a block at which alarms can be counted."""
OF_TEST = 1e-4
"""Probability that a test of counts fails by chance."""


def monitor(**given: float) -> InnovationMonitor:
    return InnovationMonitor(least_readings=READINGS, least_time=0.0, settling=0, **given)  # type: ignore[arg-type]


def alarms(tested: InnovationMonitor, innovations: np.ndarray) -> list[str]:
    found = (tested.add(float(i), e) for i, e in enumerate(innovations.tolist()))
    return [alarm.kind for alarm in found if alarm is not None]


def test_false_alarms_are_as_many_as_stated() -> None:
    rng = np.random.default_rng(1)
    found = alarms(monitor(false_alarm=RAISED, tolerance=0.0), rng.standard_normal(READINGS * BLOCKS))
    low, high = stats.binom.ppf([OF_TEST / 2, 1 - OF_TEST / 2], BLOCKS, RAISED)
    print(f"{len(found)} alarms in {BLOCKS} blocks, expected {RAISED * BLOCKS:g}, {low:g} to {high:g}")
    # Both tests are of the same numbers, so a few blocks raise one alarm in the place of two.
    assert 0.9 * low <= len(found) <= high
    assert {"mean", "nis"} == set(found)


@pytest.mark.parametrize("factor", [1.0 / 1.2, 1.2])
def test_noise_within_the_tolerance_raises_no_more(factor: float) -> None:
    rng = np.random.default_rng(2)
    scaled = np.sqrt(factor) * rng.standard_normal(READINGS * BLOCKS)
    found = alarms(monitor(false_alarm=RAISED), scaled)
    assert len(found) <= stats.binom.ppf(1 - OF_TEST, BLOCKS, RAISED)
    # The twin: without the tolerance the same noise is found out.
    assert len(alarms(monitor(false_alarm=RAISED, tolerance=0.0), scaled)) > 0.1 * BLOCKS


def test_no_alarm_at_the_rate_of_the_view() -> None:
    rng = np.random.default_rng(3)
    assert BLOCKS * FALSE_ALARM < 0.01  # the probability that this test fails by chance
    assert not alarms(monitor(), rng.standard_normal(READINGS * BLOCKS))


@pytest.mark.parametrize(
    ("shift", "factor", "kind"),
    [(0.6, 1.0, "mean"), (0.0, 4.0, "nis"), (0.0, 0.4, "nis")],
    ids=["mean", "more", "less"],
)
def test_a_model_that_does_not_hold_raises_an_alarm(shift: float, factor: float, kind: str) -> None:
    rng = np.random.default_rng(4)
    found = alarms(monitor(), shift + np.sqrt(factor) * rng.standard_normal(READINGS * 20))
    assert len(found) == 20
    assert set(found) == {kind}


def test_blocks_last_as_long_as_stated_and_the_first_readings_do_not_count() -> None:
    tested = InnovationMonitor(least_readings=10, least_time=1.0, settling=5)
    for i in range(5):
        tested.add(0.01 * i, 100.0)
    for i in range(5, 106):
        tested.add(0.01 * i, (-1.0) ** i)
    assert (tested.blocks, tested.alarms, tested.holds) == (1, 0, True)


def test_alarms_in_a_row_know_their_first() -> None:
    tested = monitor()
    found = [tested.add(float(i), 3.0) for i in range(2 * READINGS)]
    first, second = (alarm for alarm in found if alarm is not None)
    assert first.since == second.since == first.t
    assert "expected" in first.sentence


def test_bounds_are_those_of_scipy() -> None:
    for n in (1, 10, 1000):
        low, high = chi_square_bounds(n, 0.01)
        assert (low * n, high * n) == pytest.approx(stats.chi2.ppf([0.005, 0.995], n), rel=1e-9)
    assert normal_bound(0.05) == pytest.approx(1.959964, rel=1e-6)
    assert normal_bound(1e-20) == pytest.approx(stats.norm.isf(5e-21), rel=1e-9)


def test_an_innovation_that_is_no_number_is_an_alarm() -> None:
    tested = monitor()
    found = [tested.add(float(i), float("nan")) for i in range(READINGS)]
    assert found[-1] is not None
