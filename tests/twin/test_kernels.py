"""Structured kernels against dense ones through the public filters, and batches against single runs."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from accelcal import filters
from accelcal._core import FilterError
from accelcal.data.recording import Channel
from accelcal.filters.choice import FilterChoice
from tests.twin.cases import Case, cases

DT = 1 / 1667


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("integrator", ["rk2", "rk4", "exact"])
@pytest.mark.parametrize("system", ["aci", "cwpa"])
def test_the_structured_kernel_equals_the_dense_one(system: str, integrator: str, order: int) -> None:
    # ACI reads behind a low-pass with its structured kernel; CWPA has none there.
    low_pass = {} if system == "aci" else {"low_pass": False}

    @given(case=cases(system=system, integrator=integrator, order=order, carrier="dense", **low_pass))
    def check(case: Case) -> None:
        same_filter(case)

    check()


def same_filter(case: Case) -> None:
    """Both kernels end in the same belief, or fail alike."""
    dense = dataclasses.replace(case, choice=dataclasses.replace(case.choice, kernel="dense"))
    try:
        expected = dense.run()
    except FilterError:
        with pytest.raises(FilterError):
            case.run()
        return
    outcome = case.run()
    sigma = np.sqrt(np.diag(expected.covariance))
    assert np.max(np.abs(outcome.states[-1] - expected.states[-1]) / sigma) < 1e-10  # two ways to round, 22 events
    assert np.max(np.abs(outcome.covariance - expected.covariance) / np.outer(sigma, sigma)) < 1e-10
    assert outcome.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-10)


def records(runs: int, n: int) -> tuple[Any, Any]:
    rng = np.random.default_rng(5)
    t = np.arange(n) * DT
    w = 20 + np.arange(runs)[:, None]
    accel = 0.05 + 1.01 * 6 * np.cos(w * t) + 0.01 * rng.standard_normal((runs, n))
    position = 6 / w**2 * (1 - np.cos(w * t)) + 1e-6 * rng.standard_normal((runs, n))
    position[:, 1::2] = np.nan
    return accel, position


@pytest.mark.parametrize(
    "choice",
    [
        FilterChoice("aci", "cubic", "inverse", integrator="rk4", order=2),
        FilterChoice("aci", "linear", "forward", interpolation="cubic"),
        FilterChoice("cwpa", "cubic", "forward", order=2),
    ],
)
def test_a_batch_gives_what_single_runs_give(choice: FilterChoice) -> None:
    runs, n = 9, 400
    accel, position = records(runs, n)
    names = choice.states()
    sigma = [{"p": 1e-5, "v": 3e-3, "a": 10.0, "K2": 1e-3, "K3": 1e-4}.get(name, 0.1) for name in names]
    cwpa = choice.system == "cwpa"
    given_: dict[str, Any] = {
        "q": 25.0 if cwpa else 1e-6,
        "r_position": 1e-12,
        "r_accel": 1e-4 if cwpa else None,
        "x0": np.zeros(len(names)),
        "P0": np.diag(np.square(sigma)),
    }
    batch = filters.run_batch(choice, accel, position, dt=DT, threads=2, **given_)
    again = filters.run_batch(choice, accel, position, dt=DT, threads=1, **given_)
    assert batch.states.tobytes() == again.states.tobytes()
    assert batch.faults == (None,) * runs
    t = np.arange(n) * DT
    for at in range(runs):
        u = Channel("accel", t, accel[at], "m/s²")
        z = Channel("position", t[::2], position[at, ::2], "m")
        outcome = filters.run(choice, u, z, **given_)
        deviation = np.sqrt(np.diag(outcome.covariance))
        # Stamps j dt and steps dt differ in the last bit of t: 1e-16 of a second times the fastest motion.
        assert np.max(np.abs(batch.states[at] - outcome.states[-1]) / deviation) < 1e-10
        off = np.abs(batch.covariances[at] - outcome.covariance) / np.outer(deviation, deviation)
        assert np.max(off) < 1e-10
        assert batch.log_likelihoods[at] == pytest.approx(outcome.log_likelihood, rel=1e-10)


def test_a_batch_whose_shapes_do_not_fit_is_refused() -> None:
    choice = FilterChoice("aci", "linear", "inverse")
    accel, position = records(3, 50)
    with pytest.raises(ValueError, match="do not fit"):
        filters.run_batch(choice, accel[:2], position, dt=DT, q=1e-6, r_position=1e-12, x0=np.zeros(4), P0=np.eye(4))
