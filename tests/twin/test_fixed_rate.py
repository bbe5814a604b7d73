"""Filters at a fixed rate from Python: records against steps, histories, errors, and what a call costs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from accelcal import filters
from accelcal._core import FilterError
from accelcal.data.recording import Channel
from accelcal.filters.choice import FilterChoice
from tests.twin.workloads import DT, WORKLOADS, cost, record, settings

N = 800


def fixed_rate(choice: FilterChoice, **more: Any) -> Any:
    return filters.fixed_rate(choice, dt=DT, **settings(choice) | more)


@pytest.mark.parametrize("name", sorted(WORKLOADS))
def test_steps_give_the_bits_of_a_record_and_both_what_stamps_give(name: str) -> None:
    choice = WORKLOADS[name]
    u, z = record(N)
    single, many = fixed_rate(choice), fixed_rate(choice)
    n = len(choice.states())
    states, variances = np.empty((N, n)), np.empty((N, n))
    innovations, spreads = np.empty(N), np.empty(N)
    single.run(u, z, states=states, variances=variances, innovations=innovations, innovation_variances=spreads)
    row = np.empty(n)
    for j in range(N):
        e = many.step(u[j], None if np.isnan(z[j]) else z[j])
        many.read(row, None)
        assert row.tobytes() == states[j].tobytes()
        assert (e is None) == np.isnan(innovations[j])
        if e is not None:
            assert (e, many.innovation_variance) == (innovations[j], spreads[j])
            assert many.nis == e * e / spreads[j]
    assert (single.x.tobytes(), single.covariance.tobytes()) == (many.x.tobytes(), many.covariance.tobytes())
    assert (single.samples, single.rejected) == (N, 0)

    t = np.arange(N) * DT
    read = ~np.isnan(z)
    stamped = filters.run(
        choice, Channel("accel", t, u, "m/s²"), Channel("position", t[read], z[read], "m"), **settings(choice)
    )
    sigma = np.sqrt(np.diag(stamped.covariance))
    # Stamps j dt and steps dt differ in the last bit of t; fused and plain arithmetic round apart.
    assert np.max(np.abs(single.x - stamped.states[-1]) / sigma) < 1e-9
    assert np.max(np.abs(single.covariance - stamped.covariance) / np.outer(sigma, sigma)) < 1e-9
    assert np.max(np.abs(variances[-1] - np.diag(single.covariance))) == 0.0
    assert single.log_likelihood == pytest.approx(stamped.log_likelihood, rel=1e-9)


def test_a_record_may_come_in_parts() -> None:
    u, z = record(N)
    whole, parts = fixed_rate(WORKLOADS["W2"]), fixed_rate(WORKLOADS["W2"])
    whole.run(u, z)
    for begin in range(0, N, 123):
        parts.run(u[begin : begin + 123], z[begin : begin + 123])
    assert whole.x.tobytes() == parts.x.tobytes()


@pytest.mark.parametrize(
    ("array", "text"),
    [
        (np.empty((N, 5)), r"shape \[800, 5\]"),
        (np.empty((N, 6), dtype=np.float32), "dtype float32"),
        (np.empty((6, N)).T, "not contiguous"),
        (np.broadcast_to(0.0, (N, 6)), "read-only"),
        ([0.0], "list"),
    ],
)
def test_an_array_that_cannot_take_a_history_is_refused_in_a_sentence(array: Any, text: str) -> None:
    u, z = record(N)
    expected = rf"states: give a writable, C-contiguous float64 array of shape \[800, 6\]; found .*{text}"
    with pytest.raises(ValueError, match=expected):
        fixed_rate(WORKLOADS["W2"]).run(u, z, states=array)


def test_channels_of_different_length_are_refused() -> None:
    u, z = record(N)
    with pytest.raises(ValueError, match="u has 800 samples, z 799; give NaN"):
        fixed_rate(WORKLOADS["W1"]).run(u, z[1:])


def test_a_sample_that_is_not_finite_is_refused_and_changes_nothing() -> None:
    u, z = record(N)
    live, same = fixed_rate(WORKLOADS["W2"]), fixed_rate(WORKLOADS["W2"])
    u[100], z[100] = np.nan, 0.0
    with pytest.raises(FilterError, match="not finite") as raised:
        live.run(u, z)
    assert (raised.value.kind, raised.value.event) == ("Innovation", 100)
    same.run(u[:100], z[:100])
    assert live.x.tobytes() == same.x.tobytes()
    live.step(1.0, z[98])


def test_a_failed_step_leaves_the_filter_as_it_was() -> None:
    u, z = record(N)
    choice = FilterChoice("aci", "cubic", "inverse", integrator="rk2")
    live, same = (fixed_rate(choice, P0=np.eye(6), q=0.0) for _ in range(2))
    with pytest.raises(FilterError) as first:
        live.run(8.0 * u, z)
    failed = live.samples
    assert first.value.kind in {"Variance", "Correlation", "InnovationVariance"}
    assert first.value.event == failed
    same.run(8.0 * u[:failed], z[:failed])
    for _ in range(2):
        assert (live.x.tobytes(), live.covariance.tobytes()) == (same.x.tobytes(), same.covariance.tobytes())
        assert (live.log_likelihood, live.samples) == (same.log_likelihood, same.samples)
        with pytest.raises(FilterError, match=r"RK2 at 1670 Hz .*p 1, v 1, .*choose integrator=.exact"):
            live.step(8.0 * u[failed], z[failed])


@pytest.mark.parametrize(
    ("choice", "more", "sentence"),
    [
        (FilterChoice("cwpa", carrier="factored"), {}, "use LiveFilter"),
        (FilterChoice("aci", integrator="rk4", carrier="factored"), {}, "use LiveFilter"),
        (FilterChoice("cwpa"), {"tau": 1e-3}, "no structured kernel|needs q_accel"),
        (FilterChoice("aci"), {"dt": -1.0}, "dt"),
        (FilterChoice("aci"), {"P0": -np.eye(4)}, "initial belief"),
    ],
)
def test_what_a_fixed_rate_cannot_do_is_refused(choice: FilterChoice, more: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        filters.fixed_rate(choice, **{"dt": DT} | settings(choice) | more)


def test_effects_come_with_their_columns() -> None:
    live = filters.fixed_rate_with_effects(dt=DT, q=1e-6, r_position=1e-12, x0=np.zeros(6), P0=np.eye(6))
    with pytest.raises(ValueError, match="tracks 2 effects"):
        live.step(0.0, 0.0)
    with pytest.raises(ValueError, match="step_with_effects"):
        live.run(np.zeros(2), np.zeros(2))
    with pytest.raises(ValueError, match=r"tracks 2 effects and watches 0; found columns of shape \[2, 2\]"):
        live.step_with_effects(0.0, 0.0, np.zeros((2, 2)), np.zeros(2))
    assert live.step_with_effects(0.0, 0.0, np.zeros((3, 2)), np.zeros(2)) == 0.0
    with pytest.raises(ValueError, match="up to 14 effects"):
        filters.fixed_rate_with_effects(dt=DT, q=1e-6, r_position=1e-12, x0=np.zeros(19), P0=np.eye(19))


def test_a_step_adds_few_empty_calls_to_the_work_of_its_filter() -> None:
    # What the filter computes depends on the processor and is a bench (benches/streaming.py): `run` does the same work
    # in one call, so the difference is what calling costs. Steps with stamps are the twin that is beyond the limit.
    measured = min((cost(WORKLOADS["W2"], rounds=30) for _ in range(3)), key=lambda cost: cost.step - cost.run)
    calling, stamped = ((step - measured.run) / measured.empty for step in (measured.step, measured.stamped))
    print(f"\nW2: a step adds {calling:.1f} empty calls, with a stamp {stamped:.1f}")
    assert calling <= 4.0 < stamped
