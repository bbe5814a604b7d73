"""Cost of a diagnosis over that of a fit, and that its memory does not grow with the columns of a long record."""

import dataclasses
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from accelcal.data.arrays import Array
from accelcal.data.recording import Recording
from accelcal.diagnosis.search.hypotheses import hypotheses_for
from accelcal.diagnosis.search.scan import scan
from accelcal.effects import BUILT_IN, Effect, find, is_local
from accelcal.estimation.columns import CHUNK, ColumnFilter, whitened_columns
from accelcal.estimation.engines import whole_columns
from accelcal.estimation.estimate import estimate, solve_runs
from accelcal.estimation.run_state import RunState
from accelcal.model import Model, Term
from accelcal.signals.signals import Signals
from accelcal.simulation.sensor import ADXL105_RIG, simulate
from accelcal.verbs import diagnose
from tests.effects.motions import sines

PEAK = """
import json, sys
import numpy as np
from accelcal.diagnosis.search.scan import scan
from accelcal.estimation import columns
from accelcal.estimation.estimate import solve_runs
from accelcal.model import Model
from benches.fit import record
from benches.peak import megabytes
if sys.argv[2] == "unbounded":
    columns.MOST_SUMS = columns.MOST_READINGS = 1 << 40
made = record(int(sys.argv[1]))
solution = solve_runs(Model.linear(), [made])
before = megabytes()
scan(solution.states, Model.linear())
print(json.dumps({"before": before, "after": megabytes()}))
"""


GROWTH = 10.0
"""MB for each minute."""


@pytest.fixture(scope="module")
def recording() -> Recording:
    parameters = {"quadratic": 1e-3, "cubic": 1e-4}
    rng = np.random.default_rng(8)
    return simulate("bursts", seconds=60.0, rig=ADXL105_RIG, parameters=parameters, rng=rng).recording


@pytest.fixture(scope="module")
def fitted(recording: Recording) -> RunState:
    return solve_runs(Model.linear(), [recording]).states[0]


def plain_sums(state: RunState, terms: list[Term], group: int) -> Array:
    """The columns at the full rate, as a fit takes them, summed afterwards; (terms, rows)."""
    counted = np.concatenate([columns for _, columns in whitened_columns(state, terms)])
    rows = len(counted) // group
    return counted[: rows * group].reshape(rows, group, len(terms)).sum(axis=1).T / np.sqrt(group)


@pytest.mark.parametrize("readings", [1 << 18, 7001])
def test_sums_are_those_of_columns_at_the_full_rate_for_any_stretches(
    fitted: RunState, readings: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("accelcal.estimation.columns.MOST_READINGS", readings)
    assert readings == 7001 or len(fitted.run.t) > 2 * CHUNK  # the reference is put together from stretches too
    items = hypotheses_for(fitted, Model.linear())
    terms = [term for item in items for term in item.terms]
    column_filter = ColumnFilter(fitted)
    result, expected = whole_columns(column_filter, terms), plain_sums(fitted, terms, column_filter.group)
    assert result.shape == expected.shape
    size = np.sqrt(np.mean(expected**2, axis=1))
    worst = np.max(np.abs(result - expected), axis=1) / np.maximum(size, 1e-300)
    assert np.max(worst[size > 0.0]) < 1e-9  # both double, sums over a filter with a memory of a thousand readings
    shifted = plain_sums(fitted, terms[:3], column_filter.group + 1)
    assert shifted.shape[1] != result.shape[1]


def test_a_scan_says_the_same_in_one_stretch_and_in_many(fitted: RunState, monkeypatch: pytest.MonkeyPatch):
    whole = scan([fitted], Model.linear())
    monkeypatch.setattr("accelcal.estimation.columns.MOST_READINGS", 7001)
    parts = scan([fitted], Model.linear())
    assert whole.detected
    assert [f.effect for f in whole.detected] == [f.effect for f in parts.detected]
    assert [c.effect for c in whole.candidates] == [c.effect for c in parts.candidates]
    for a, b in zip(whole.candidates, parts.candidates, strict=True):
        assert a.gain == pytest.approx(b.gain, rel=1e-6)  # shapes are refined to a thousandth of their bracket
        assert a.members == b.members


def middle(effect: Effect, s: Signals) -> dict[str, float]:
    return {name: float(shape.grid(s)[len(shape.grid(s)) // 2]) for name, shape in effect.shapes.items()}


def off_in_a_part(effect: Effect) -> float:
    """How far an effect on a stretch is from the same stretch of the effect on the whole, over its size."""
    s = sines()
    rows = slice(len(s.t) // 3, 2 * len(s.t) // 3)
    shape = middle(effect, s)
    whole, part = effect.column(s, **shape)[rows], effect.column(s.part(rows), **shape)
    return float(np.max(np.abs(part - whole)) / max(float(np.max(np.abs(whole))), 1e-300))


@pytest.mark.parametrize("effect", [e for e in BUILT_IN if is_local(e)], ids=lambda e: e.name)
def test_an_effect_without_memory_has_its_values_on_any_stretch(effect: Effect):
    assert off_in_a_part(effect) == 0.0


@pytest.mark.parametrize("name", ["hysteresis", "creep", "self_heating", "encoder_backlash", "shape_since_reversal"])
def test_an_effect_with_memory_has_other_values_on_a_stretch(name: str):
    effect = find(name)
    assert not is_local(effect)
    assert off_in_a_part(effect) > 1e-6


def test_an_effect_outside_the_catalogue_counts_as_one_with_memory():
    changed = dataclasses.replace(find("quadratic"), name="quadratic")
    assert is_local(find("quadratic"))
    assert not is_local(changed)


def seconds(work: Callable[[], object]) -> float:
    """Processor time."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def test_a_diagnosis_costs_no_more_than_a_few_fits(recording: Recording):
    fit = estimate(Model.linear(), recording)
    ratios = [
        seconds(lambda: diagnose(fit, recording)) / seconds(lambda: estimate(Model.linear(), recording))
        for _ in range(5)
    ]  # side by side, the least counts: a busy machine can only add
    print(f"diagnose over fit: {min(ratios):.1f} of {[round(r, 1) for r in ratios]}")
    assert min(ratios) < 8.0  # 5 on an idle machine; 9 before columns were filtered in parallel


def growth(kind: str, short: int, long: int) -> float:
    """What a scan adds to the peak of the fit before it, MB for each further minute between two lengths in minutes."""
    extra = {}
    for minutes in (short, long):
        run = [sys.executable, "-c", PEAK, str(int(minutes * 60 * 1667)), kind]
        done = subprocess.run(run, cwd=Path(__file__).parents[3], capture_output=True, text=True, check=True)
        answer = json.loads(done.stdout)
        extra[minutes] = answer["after"] - answer["before"]
    return (extra[long] - extra[short]) / (long - short)


def test_memory_of_a_scan_grows_by_the_record_and_not_by_its_columns():
    """From five minutes on: before, stretches are not full, and a peak is off by twenty MB."""
    assert growth("bounded", 5, 10) < GROWTH


def test_memory_of_a_scan_would_grow_by_its_columns_if_stretches_had_no_bound():
    assert growth("unbounded", 3, 6) > GROWTH  # 45
