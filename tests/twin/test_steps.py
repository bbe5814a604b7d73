"""Single steps of the compiled filters against closed forms, and the failures that must be reported."""

from __future__ import annotations

import dataclasses
import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from accelcal import filters
from accelcal._core import FilterError, FilterStream, FixedRateFilter, Parts, run_filter
from accelcal.data.recording import Channel
from accelcal.filters.choice import FilterChoice, GaussMarkov, core_samples, core_setup
from accelcal.filters.stream import LiveFilter
from tests.twin.cases import Case, cases

CORE = Path(__file__).parents[2] / "crates" / "ekf-core" / "src"
DT = 1 / 1667


def tone(n: int = 200, *, a: float = 8.0) -> tuple[Channel, Channel]:
    """A 5 Hz motion seen by a sensor with 1 % scale error, position at every second sample."""
    t = np.arange(n) * DT
    w = 2 * np.pi * 5
    u = 0.05 + 1.01 * a * np.sin(w * t)
    z = -a / w**2 * np.sin(w * t[::2])
    return Channel("accel", t, u, "m/s²"), Channel("position", t[::2], z, "m")


def settings(choice: FilterChoice, *, sigma: float = 0.1, **more: Any) -> dict[str, Any]:
    names = choice.states(low_pass=more.get("tau", 0.0) != 0)
    start = {"v": -8 / (2 * np.pi * 5)}
    sigmas = [{"p": 1e-5, "v": 0.1, "a": 10.0, "y": 10.0}.get(name, sigma) for name in names]
    cwpa = choice.system == "cwpa"
    given = {
        "q": 1e3 if cwpa else 1e-6,
        "r_position": 1e-12,
        "r_accel": 1e-4 if cwpa else None,
        "x0": [start.get(name, 0.0) for name in names],
        "P0": np.diag(np.square(sigmas)),
    }
    return given | more


@given(
    case=cases(system="aci", interpolation="hold", integrator="rk4", carrier="dense"),
    order=st.sampled_from([1, 2]),
)
def test_rk4_equals_the_exact_step_under_hold(case: Case, order: int) -> None:
    accel = Channel("accel", case.accel.t[:2], case.accel.y[:2], "m/s²")
    now, then = accel.t
    position = Channel("position", np.array([then]), np.array([0.0]), "m")
    alone = case.settings | {"parameters": {}, "r_position": 1e12, "gate": None}  # the reading teaches nothing

    def step(integrator: Any) -> filters.FilterRun:
        choice = dataclasses.replace(case.choice, integrator=integrator, order=order)
        return filters.run(choice, accel, position, **alone)

    rk4, exact = step("rk4"), step("exact")
    sigma = np.sqrt(np.diag(exact.covariance))
    scale = np.maximum(np.abs(exact.states[-1]), sigma)
    assert then > now
    assert np.max(np.abs(rk4.states[-1] - exact.states[-1]) / scale) < 1e-12
    assert np.max(np.abs(rk4.covariance - exact.covariance) / np.outer(sigma, sigma)) < 1e-12


@pytest.mark.parametrize("model", ["linear", "cubic"])
def test_rk2_reports_the_loss_of_positive_definiteness(model: Any) -> None:
    accel, position = tone()
    choice = FilterChoice("aci", model, integrator="rk2")
    with pytest.raises(FilterError, match="positive") as raised:
        filters.run(choice, accel, position, **settings(choice, sigma=1.0, q=0.0))
    assert raised.value.kind in {"Variance", "Correlation", "InnovationVariance"}
    print(f"\nRK2, {model}, unit priors: {raised.value}")
    for sound in (
        dataclasses.replace(choice, integrator="rk4"),
        dataclasses.replace(choice, integrator="exact"),
        dataclasses.replace(choice, carrier="factored"),
    ):
        run = filters.run(sound, accel, position, **settings(sound, sigma=1.0, q=0.0))
        assert np.all(run.variances >= 0)


@given(case=cases())
def test_a_stream_gives_the_bits_of_a_record(case: Case) -> None:
    try:
        run = case.run()
    except FilterError:
        return
    live = LiveFilter(case.choice, **case.settings)
    samples = [(t, 0, u) for t, u in zip(case.accel.t, case.accel.y, strict=True)]
    samples += [(t, 1, z) for t, z in zip(case.position.t, case.position.y, strict=True)]
    for t, kind, value in sorted(samples):
        live.step(t, position=value) if kind else live.step(t, accel=value)
    live.finish()
    assert live.estimate.tobytes() == run.states[-1].tobytes()
    assert live.covariance.tobytes() == run.covariance.tobytes()
    assert live.log_likelihood == run.log_likelihood
    assert live.rejected == len(run.rejections)
    assert live.waiting == 0


def test_a_step_returns_the_innovation_as_soon_as_it_can_be_made() -> None:
    accel, position = tone(6)
    choice = FilterChoice("aci", "linear", interpolation="linear")
    run = filters.run(choice, accel, position, **settings(choice))
    live = LiveFilter(choice, **settings(choice))
    assert live.step(accel.t[0], accel=accel.y[0], position=position.y[0]) is None
    assert live.step(accel.t[1], accel=accel.y[1]) == run.innovations[1]


@pytest.mark.parametrize(("system", "form"), list(itertools.product(["aci", "cwpa"], ["inverse", "forward"])))
@pytest.mark.parametrize("order", [1, 2])
def test_every_system_finds_the_scale_error_and_the_bias(system: Any, form: Any, order: Any) -> None:
    accel, position = tone(3000)
    choice = FilterChoice(system, "linear", form, order=order)
    run = filters.run(choice, accel, position, **settings(choice, r_accel=1e-6 if system == "cwpa" else None))
    result = filters.forward_parameters(run)
    deviation = np.sqrt(np.diag(result.covariance))
    assert np.all(np.abs(result.values - [0.01, 0.05]) < 5 * deviation + 1e-4)  # linear interpolation costs 3e-5 of k


def test_constant_parameters_are_smoothed_to_their_last_filtered_value() -> None:
    accel, position = tone()
    for choice in (FilterChoice("aci", "cubic"), FilterChoice("cwpa", "linear")):
        run = filters.run(choice, accel, position, **settings(choice), smooth=True)
        assert run.smoothed_states is not None
        m = len(filters.PARAMETERS[choice.model])
        last, sigma = run.states[-1, -m:], np.sqrt(run.variances[-1, -m:])
        assert np.max(np.abs(run.smoothed_states[:, -m:] - last) / sigma) < 1e-6  # sums of 200 terms of mixed sign


def test_the_low_pass_output_is_discretised_with_its_exponential() -> None:
    accel, position = tone(2)
    choice = FilterChoice("cwpa", "linear")
    tau, sigma_y = 1e-3, 7.0
    given = settings(choice, tau=tau, q_accel=0.0, q=0.0, r_position=1e18, r_accel=1e18)
    P0 = np.zeros((6, 6))
    P0[3, 3] = sigma_y**2
    run = filters.run(choice, accel, position, **given | {"P0": P0})
    covariance = sigma_y**2 * np.exp(-2 * DT / tau)
    assert run.variances[-1, 3] == pytest.approx(covariance, rel=1e-12)  # R = 1e18 teaches nothing


@pytest.mark.parametrize("system", ["aci", "cwpa"])
def test_a_declared_low_pass_is_undone(system: Any) -> None:
    tau, w, a = 1e-3, 2 * np.pi * 5, 8.0
    t = np.arange(4000) * DT
    lag, gain = np.arctan(w * tau), 1 / np.hypot(1, w * tau)
    accel = Channel("accel", t, 0.05 + 1.01 * gain * a * np.sin(w * t - lag), "m/s²")
    position = Channel("position", t[::2], -a / w**2 * np.sin(w * t[::2]), "m")
    choice = FilterChoice(system, "linear", interpolation="cubic")
    cwpa = system == "cwpa"

    def error(**low_pass: Any) -> float:
        names = choice.states(low_pass=bool(low_pass))
        sigma = [{"p": 1e-3, "v": 0.1, "a": 10.0, "y": 10.0}.get(name, 0.1) for name in names]
        given = settings(choice, r_accel=1e-8 if cwpa else None, **low_pass) | {"P0": np.diag(np.square(sigma))}
        return filters.run(choice, accel, position, **given).estimate["k"] - 0.01

    # Noise-free data: declared, only the four-point interpolation's error is left; undeclared, part of (w tau)² = 1e-3.
    assert abs(error(tau=tau, **({"q_accel": 1e-9} if cwpa else {}))) < 3e-6
    assert abs(error()) > 2e-5


def test_a_gate_rejects_an_outlier_and_reports_it() -> None:
    accel, position = tone()
    z = position.y.copy()
    z[40] += 1e-3
    choice = FilterChoice("aci", "linear")
    run = filters.run(choice, accel, Channel("position", position.t, z, "m"), **settings(choice, gate=100.0))
    assert run.times[run.rejections].tolist() == [position.t[40]]
    assert run.from_position[run.rejections].all()


def failing(kind: str) -> None:
    """Make the filter fail with the given kind of step error."""
    accel, position = tone()
    aci = FilterChoice("aci", "linear")
    live = LiveFilter(aci, **settings(aci))
    match kind:
        case "InnovationVariance":
            filters.run(aci, accel, position, **settings(aci, r_position=0.0, q=0.0) | {"P0": np.zeros((4, 4))})
        case "Innovation":
            live.step(0.0, accel=float("nan"))
        case "Mean":
            late = Channel("accel", accel.t * 1e6, accel.y, "m/s²")
            later = Channel("position", position.t * 1e6, position.y, "m")
            filters.run(aci, late, later, **settings(aci, x0=[0.0, 1e308, 0.0, 0.0]))  # overflows before a reading
        case "Variance":
            late = Channel("accel", accel.t * 1e6, accel.y, "m/s²")
            later = Channel("position", position.t * 1e6, position.y, "m")
            filters.run(aci, late, later, **settings(aci) | {"P0": np.diag([1, 1e308, 1, 1])})  # overflows
        case "Correlation":
            rough = dataclasses.replace(aci, integrator="rk2")
            filters.run(rough, accel, position, **settings(rough, sigma=1.0, q=0.0))
        case "Domain":
            cubic = FilterChoice("aci", "cubic")
            start = settings(cubic, sigma=0.0) | {"x0": [0.0, 0.0, 0.0, 0.0, -0.1, 0.0]}  # turns over at 5 m/s²
            filters.run(cubic, accel, position, **start)
        case "TimeOrder":
            live.step(1.0, accel=0.0)
            live.step(0.5, position=0.0)
        case "Backlog":
            for i in range(300):
                live.step(float(i), position=0.0)


def variants(enum: str) -> set[str]:
    body = re.search(rf"pub enum {enum} \{{(.*?)\n\}}", (CORE / "error.rs").read_text(), re.DOTALL)
    assert body
    return set(re.findall(r"^    (\w+)[ ({,]", body[1], re.MULTILINE))


@pytest.mark.parametrize("kind", sorted(variants("StepError")))
def test_every_step_error_is_raised(kind: str) -> None:
    with pytest.raises(FilterError) as raised:
        failing(kind)
    assert raised.value.kind == kind
    assert raised.value.event is not None


def unusable(kind: str) -> None:
    accel, position = tone()
    aci = FilterChoice("aci", "linear")
    given = settings(aci)
    t, z = position.t, position.y
    match kind:
        case "Setting":
            filters.run(aci, accel, position, **given | {"r_position": -1.0})
        case "Prior":
            filters.run(aci, accel, position, **given | {"P0": -np.eye(4)})
        case "TooFew":
            filters.run(aci, accel, Channel("position", t[:0], z[:0], "m"), **given)
        case "Belief":
            hidden = np.diag([1.0, 1.0, 1.0, 0.0])
            hidden[0, 3] = hidden[3, 0] = 1e-20  # beside a variance of zero, below the rounding of a pivot
            filters.run(aci, accel, position, **given | {"P0": hidden})
        case "Lengths":
            setup = core_setup(aci, 1e-6, 1e-12, None, None, 0.0, None, None)
            short = np.ascontiguousarray(t[:3]), np.ascontiguousarray(z[:2])
            run_filter(setup, np.zeros(4), np.eye(4), core_samples(accel), short, False)
        case "NotFinite":
            filters.run(aci, accel, Channel("position", t, np.where(t > 0.01, np.nan, z), "m"), **given)
        case "NotRising":
            filters.run(aci, accel, Channel("position", t[::-1], z, "m"), **given)
        case "Size":
            setup = core_setup(aci, 1e-6, 1e-12, None, None, 0.0, None, None)
            FilterStream(setup, np.zeros(3), np.eye(3))
        case "Consider":
            considering = FilterChoice("aci", "linear", consider=("k",))
            FixedRateFilter(
                core_setup(considering, 1e-6, 1e-12, None, None, 0.0, None, None), np.zeros(4), np.eye(4), DT
            )


@pytest.mark.parametrize("kind", sorted(variants("SetupError") - {"NoKernel"}))  # which no setup of Python reaches
def test_every_setup_error_is_raised(kind: str) -> None:
    with pytest.raises(FilterError) as raised:
        unusable(kind)
    assert raised.value.kind == kind
    assert raised.value.event is None


def test_one_output_sample_is_too_few() -> None:
    accel, position = tone()
    aci = FilterChoice("aci", "linear")
    with pytest.raises(FilterError, match="at least 2"):
        filters.run(aci, Channel("accel", accel.t[:1], accel.y[:1], "m/s²"), position, **settings(aci))


def test_what_a_system_ignores_is_refused() -> None:
    accel, position = tone()
    aci = FilterChoice("aci", "linear")
    with pytest.raises(ValueError, match="has no use for r_accel"):
        filters.run(aci, accel, position, **settings(aci, r_accel=1.0))
    with pytest.raises(ValueError, match="K2"):
        filters.run(aci, accel, position, **settings(aci, parameters={"K2": GaussMarkov(1.0)}))


CHOICES = {
    "form": {"inverse", "forward"},
    "interpolation": {"hold", "held", "interpolate", "interpolation"},
    "integrator": {"rk2", "rk4", "exact", "runge", "kutta"},
    "order": {"first", "second"},
    "carrier": {"dense", "factored", "joseph", "ud"},
}


def test_no_function_name_contains_two_choices() -> None:
    names = [
        name
        for path in [*CORE.rglob("*.rs"), *(CORE.parents[1] / "accelcal-py/src").rglob("*.rs"), Path(filters.__file__)]
        for name in re.findall(
            r"^\s*(?:pub )?(?:fn|def) (\w+)", path.read_text().split("#[cfg(test)]")[0], re.MULTILINE
        )
    ]
    assert len(names) > 50
    for name in names:
        words = set(name.lower().split("_"))
        assert sum(bool(words & spellings) for spellings in CHOICES.values()) <= 1, name


def test_a_log_likelihood_that_is_no_number_is_an_error() -> None:
    # 1e160 m has a double, its square has none: each filter would return -inf.
    choice, far = FilterChoice("aci"), 1e160
    accel, position = tone()
    z = np.where(np.arange(len(position.y)) == 7, far, position.y)
    with pytest.raises(FilterError, match="or its square over its variance, is not finite"):
        filters.run(choice, accel, dataclasses.replace(position, y=z), **settings(choice))
    live = filters.fixed_rate(choice, dt=DT, **settings(choice))
    live.step(0.0, 0.0)
    before = live.log_likelihood
    with pytest.raises(FilterError, match="or its square over its variance, is not finite"):
        live.step(0.0, far)
    assert live.log_likelihood == before  # the filter is what it was
    stamped = LiveFilter(choice, **settings(choice))
    stamped.step(0.0, accel=0.0)
    stamped.step(DT, position=far)
    with pytest.raises(FilterError, match="or its square over its variance, is not finite"):
        stamped.step(2 * DT, accel=0.0)
    batch = filters.run_batch(choice, np.zeros((1, 20)), np.full((1, 20), far), dt=DT, **settings(choice))
    assert batch.faults[0]
    nothing = np.zeros(8)
    start = np.arange(8) == 0
    record = (np.arange(8.0), np.where(start, 0.0, far), nothing, nothing, start, nothing, nothing)
    parts = Parts([(record, np.ones(8, dtype=bool))])
    with pytest.raises(ValueError, match="the log-likelihood is -inf: check the units"):
        parts.log_likelihood(q=1e-6, r=1e-12, prior=(0.0, 1e-10, 0.0, 1e-2))


def test_variances_without_a_product_are_an_error_of_the_likelihood() -> None:
    choice = FilterChoice("aci")
    live = filters.fixed_rate(choice, dt=DT, **settings(choice, r_position=1e60))
    for _ in range(16):
        live.step(0.0, 0.0)
    with pytest.raises(ValueError, match="outside 1e-38 to 1e38 m²"):
        _ = live.log_likelihood
