"""Long runs at a fixed rate: the covariance stays symmetric, positive and finite, and UD factors give the dense one."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from accelcal import filters
from accelcal._core import FixedRateFilter
from accelcal.filters.choice import FilterChoice
from accelcal.filters.stream import LiveFilter
from tests.twin.workloads import DT, TONES, WORKLOADS, settings

from .case import LONG, case_rng

PART = 50_000
"""Steps after which the covariance is looked at; each has its variances looked at."""
FEW = 100_000
ROUNDING = 1e-14
"""Of a product of factors, which is computed above and below the diagonal apart; a dense covariance has one value."""
APART = 1e-6
"""Most distance of UD factors from the dense covariance, in sigma."""


@dataclass(frozen=True)
class Run:
    """A filter that runs for long."""

    name: str
    choice: FilterChoice
    steps: int
    """In `make test-hostile`."""
    variances: float = 1.0
    """Of its prior, over those of the workloads."""


def factored(choice: FilterChoice) -> FilterChoice:
    return replace(choice, carrier="factored", integrator="exact")


RUNS = (
    Run("W2", WORKLOADS["W2"], 20_000_000),
    Run("W2 after a diffuse prior", replace(WORKLOADS["W2"], integrator="exact"), 5_000_000, 1e3),
    Run("W4", WORKLOADS["W4"], 5_000_000),
    Run("W2 in UD factors", factored(WORKLOADS["W2"]), 3_000_000),
)


def part(number: int, count: int = PART) -> tuple[np.ndarray, np.ndarray]:
    """Output and position (count,) of one part of an endless record, position at every second sample."""
    t = (np.arange(count) + number * count) * DT
    rng = case_rng("long runs", number)
    a = np.sum([A * np.sin(w * t) for A, w in TONES], axis=0)
    p = np.sum([-A / w**2 * np.sin(w * t) for A, w in TONES], axis=0)
    z = p + 1e-6 * rng.standard_normal(count)
    z[1::2] = np.nan
    return 0.05 + 1.01 * a + 1e-2 * rng.standard_normal(count), z


def given(run: Run) -> dict[str, Any]:
    prior = settings(run.choice)
    return prior | {"P0": run.variances * np.asarray(prior["P0"])}


def faults(filter: FixedRateFilter, variances: np.ndarray, lopsided: float = 0.0) -> list[str]:
    """What is wrong with the covariance of a filter, and with the variances (n, N) of its last steps.

    `lopsided` is the most by which the correlations above and below the diagonal may differ.
    """
    P = filter.covariance
    if not (np.all(np.isfinite(P)) and np.all(np.isfinite(variances)) and np.all(np.isfinite(filter.x))):
        return ["not finite"]
    sigma = np.sqrt(np.abs(np.diag(P)))
    apart = float(np.max(np.abs(P - P.T) / np.outer(sigma, sigma)))
    result = [] if apart <= lopsided else [f"not symmetric, by {apart:.1e}"]
    result += [] if np.all(variances > 0.0) else ["a variance that is not positive"]
    least = float(np.linalg.eigvalsh(P / np.outer(sigma, sigma))[0])
    return result + ([] if least > -1e-12 else [f"a correlation matrix with the eigenvalue {least:.1e}"])


@pytest.mark.parametrize("run", RUNS, ids=lambda run: run.name)
def test_a_long_run_keeps_a_covariance(run: Run) -> None:
    filter = filters.fixed_rate(run.choice, dt=DT, **given(run))
    lopsided = ROUNDING if run.choice.carrier == "factored" else 0.0
    variances = np.empty((PART, len(run.choice.states())))
    steps = run.steps if LONG else FEW
    results: list[str] = []
    for number in range(steps // PART):
        filter.run(*part(number), variances=variances)
        results += [f"step {filter.samples}: {fault}" for fault in faults(filter, variances, lopsided)]
    print(f"{run.name}: {filter.samples} steps, {len(results)} faults (threshold 0)")
    assert filter.samples == steps
    assert not results, results[:5]


def test_ud_factors_stay_with_the_dense_covariance() -> None:
    choice = replace(WORKLOADS["W2"], integrator="exact")
    dense, ud = (LiveFilter(item, **settings(choice)) for item in (choice, factored(choice)))
    steps, worst = 300_000 if LONG else 30_000, 0.0
    for number in range(steps // 10_000):
        u, z = part(number, 10_000)
        for j in range(len(u)):
            t, position = (number * len(u) + j) * DT, None if math.isnan(z[j]) else z[j]
            for live in (dense, ud):
                live.step(t, accel=u[j], position=position)
        sigma = np.sqrt(np.diag(dense.covariance))
        of_estimate = np.max(np.abs(dense.estimate - ud.estimate) / sigma)
        of_covariance = np.max(np.abs(dense.covariance - ud.covariance) / np.outer(sigma, sigma))
        worst = max(worst, float(of_estimate), float(of_covariance))
    print(f"UD against dense, {steps} steps: {worst:.1e} sigma (threshold {APART:.0e})")
    assert 0.0 < worst < APART


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (lambda P, v: P.__setitem__((0, 1), 2.0 * P[0, 1]), "not symmetric"),
        (lambda P, v: v.__setitem__((1, 1), 0.0), "a variance that is not positive"),
        (lambda P, v: v.__setitem__((1, 1), math.nan), "not finite"),
        (lambda P, v: P.__setitem__(slice(None), P - 2.0 * np.diag(np.diag(P))), "a correlation matrix"),
    ],
)
def test_every_fault_is_seen(spoil: Any, text: str) -> None:
    filter = filters.fixed_rate(WORKLOADS["W2"], dt=DT, **settings(WORKLOADS["W2"]))
    u, z = part(0, 500)
    variances = np.empty((500, 6))
    filter.run(u, z, variances=variances)
    assert faults(filter, variances) == []

    class Spoilt:
        covariance, x = filter.covariance.copy(), filter.x

    spoil(Spoilt.covariance, variances)
    assert text in " ".join(faults(Spoilt(), variances))  # type: ignore[arg-type]
