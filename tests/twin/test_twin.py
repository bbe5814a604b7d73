"""The compiled filters equal the NumPy twin on any model, any choice and any record."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given

from accelcal._core import FilterError
from tests.twin import reference
from tests.twin.cases import Case, cases

BAR = 1e-10  # of max(|x|, sigma) and of sigma_i sigma_j: about 1e3 operations per event, at most 30 events
WORST: dict[str, tuple[float, int, int]] = {}


@pytest.fixture(scope="module", autouse=True)
def figures() -> Iterator[None]:
    """Print what was reached, how often it was tried, and the bar."""
    yield
    for name, (worst, count, refused) in sorted(WORST.items()):
        print(f"\n{name}: worst {worst:.1e} over {count} examples, {refused} refused alike (bar {BAR:.0e})", end="")


def state_scale(x: np.ndarray, variance: np.ndarray) -> np.ndarray:
    return np.maximum(np.maximum(np.abs(x), np.sqrt(np.maximum(variance, 0.0))), 1e-30)


def run_or_failure(case: Case) -> reference.TwinRun | reference.StepFailed:
    try:
        return case.run_reference()
    except reference.StepFailed as failure:
        return failure


def disagreement(case: Case) -> float | None:
    """The largest scaled difference; None if both twins refuse the same step for the same reason."""
    expected = run_or_failure(case)
    if isinstance(expected, reference.StepFailed):
        with pytest.raises(FilterError) as raised:
            case.run()
        assert (raised.value.kind, raised.value.event) == (expected.kind, expected.event)
        return None
    got = case.run()
    x, P = np.array(expected.x), np.array(expected.P)
    variance = np.array([np.diag(p) for p in P])
    scale = state_scale(x, variance)
    sigma = np.sqrt(np.maximum(variance[-1], 1e-60))
    assert got.times.tolist() == expected.t
    innovations = np.abs(got.innovations - expected.e) / np.sqrt(expected.s)
    return max(
        float(np.max(np.abs(got.states - x) / scale)),
        float(np.max(np.abs(got.variances - variance) / np.maximum(variance, 1e-60))),
        float(np.max(np.abs(got.covariance - P[-1]) / np.outer(sigma, sigma))),
        float(np.nanmax(innovations, initial=0.0)) * 1e-2,  # a difference of readings, against its own deviation
        abs(got.log_likelihood - expected.log_likelihood) / max(1.0, abs(expected.log_likelihood)) * 1e-2,
    )


def compare(name: str, case: Case) -> None:
    difference = disagreement(case)
    worst, count, refused = WORST.get(name, (0.0, 0, 0))
    WORST[name] = (max(worst, difference or 0.0), count + 1, refused + (difference is None))
    assert difference is None or difference < BAR


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("model", ["linear", "cubic"])
@pytest.mark.parametrize("system", ["aci", "cwpa"])
def test_rust_equals_the_reference(system: str, model: str, order: int) -> None:
    @given(case=cases(system=system, model=model, order=order))
    def check(case: Case) -> None:
        compare(f"{system} {model} order {order}", case)

    check()


@pytest.mark.parametrize("system", ["aci", "cwpa"])
def test_consider_parameters_equal_the_blocks_of_schmidt(system: str) -> None:
    @given(case=cases(system=system, carrier="dense", consider=True))
    def check(case: Case) -> None:
        compare(f"{system} with consider parameters", case)

    check()


@given(case=cases(integrator="exact"))
def test_smoother_equals_rauch_tung_striebel(case: Case) -> None:
    rows = run_or_failure(case)
    if isinstance(rows, reference.StepFailed):
        return
    x, variance = reference.smooth(rows)
    got = case.run(smooth=True)
    assert got.smoothed_states is not None
    assert got.smoothed_variances is not None
    scale = state_scale(x, variance)
    # The recursion of Rauch, Tung and Striebel inverts predictions of condition 1e10 and more, once per event.
    assert np.max(np.abs(got.smoothed_states - x) / scale) < 1e-6
