"""What a bias that differs from run to run goes with: rates over campaigns, closed forms, whole fits."""

import dataclasses
from datetime import UTC, datetime

import numpy as np
import pytest
from scipy import stats

import accelcal as ac
from accelcal.data.recording import RunLabels, days_of
from accelcal.estimation.run_to_run import (
    REMARK_ALPHA,
    BetweenRuns,
    Covariate,
    best_likelihood,
    covariates_of,
    goes_with,
    likelihood,
    size_of,
)
from accelcal.simulation import CXL02_RIG
from tests.tiers import drawn

V = 1e-6
"""Variance of one run."""


def campaign(rng, runs, kind="", d=10.0):
    """Dates, mountings and temperatures drawn at random; the bias differs by chance, and with one of them at d."""
    t = np.sort(rng.uniform(0.0, 100.0, runs))
    mounting = rng.permutation(np.arange(runs) % 2)
    warm = rng.normal(23.0, 2.0, runs)
    D = V * 10.0 ** rng.uniform(1.0, 4.0)
    b = np.sqrt(D) * rng.standard_normal(runs)
    column = {"line": t, "mounting": 1.0 * mounting, "temperature": warm}.get(kind)
    if column is not None:
        away = column - np.mean(column)
        b = b + d * np.sqrt(D) * away / np.linalg.norm(away)
    v = V * np.exp(0.5 * rng.standard_normal(runs))
    y = b + np.sqrt(v) * rng.standard_normal(runs)
    away = t - t[0]
    every = [
        Covariate("line", away[:, None]),
        Covariate("logarithm", np.log(away + 1.0)[:, None]),
        Covariate("walk", np.empty((runs, 0)), np.minimum.outer(away, away) / np.mean(away)),
        Covariate("mounting", 1.0 * mounting[:, None]),
        Covariate("temperature", warm[:, None]),
    ]
    return BetweenRuns.of(np.diag(1.0 / v), y / v, range(runs)), every


@drawn(100)
def test_campaigns_that_differ_by_chance_go_with_nothing(draws):
    """At a stated rate of 1 % over campaigns of 4 to 12 runs; the tests below are the twin."""
    result = 0
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        data, every = campaign(rng, int(rng.integers(4, 13)))
        result += data.p_value < REMARK_ALPHA and goes_with("bias", data, every) is not None
    allowed = stats.binom.ppf(0.975, draws, REMARK_ALPHA)
    print(f"{result} of {draws} campaigns without a cause go with one ({REMARK_ALPHA:g} stated, {allowed:g} allowed)")
    assert result <= allowed


@drawn(40)
@pytest.mark.parametrize("kind", ["line", "mounting", "temperature"])
def test_a_cause_of_ten_standard_deviations_is_named(kind, draws):
    named, z = 0, []
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        data, every = campaign(rng, int(rng.integers(7, 13)), kind)
        result = goes_with("bias", data, every)
        named += result is not None and kind in result.members
        if result is not None and result.covariate == kind:
            z.append(result.slope / result.std)
    print(f"{kind}: named in {named} of {draws} campaigns (95 %), {np.median(np.abs(z)):.1f} sigma")
    assert named >= stats.binom.ppf(0.025, draws, 0.95)
    assert 5.0 < np.median(np.abs(z)) < 20.0


@pytest.mark.statistics
def test_a_random_change_over_the_dates_is_no_chance():
    members = result = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        changed, every = campaign(rng, 12)
        t = every[0].columns[:, 0]
        walk = np.concatenate([[0.0], np.cumsum(np.sqrt(np.diff(t)) * rng.standard_normal(11))])
        changed = dataclasses.replace(changed, y=changed.turn @ walk)
        message = goes_with("bias", changed, every)
        result += message is not None
        members += message is not None and ("walk" in message.members or message.covariate in ("line", "logarithm"))
    print(f"a walk: {result} of 30 told, {members} as a change over the dates")
    assert members >= 15
    assert result - members <= 3


def test_the_likelihood_is_that_of_the_dense_mixed_model():
    rng = np.random.default_rng(5)
    data, every = campaign(rng, 8)
    y, x = data.turn.T @ data.y, every[0].columns[:, 0]
    V = data.turn.T @ np.diag(data.v + 1e-5) @ data.turn
    X = np.column_stack([np.ones(8), x])
    beta = np.linalg.solve(X.T @ np.linalg.solve(V, X), X.T @ np.linalg.solve(V, y))
    dense = stats.multivariate_normal(X @ beta, V).logpdf(y) + 4.0 * np.log(2.0 * np.pi)
    assert likelihood(data.y[None], data, every[0], 1e-5)[0] == pytest.approx(dense, rel=1e-9)
    grid = np.array([0.0, 1e-6, 1e-5])
    assert best_likelihood(data.y[None], data, every[0], grid)[0] >= dense


def test_the_slope_of_exact_runs_is_that_of_ordinary_least_squares():
    rng = np.random.default_rng(6)
    x, b = rng.standard_normal((2, 9))
    between = BetweenRuns(b, np.full(9, 1e-9), np.ones(9), np.eye(9))
    slope, std, left = size_of(between, Covariate("temperature", x[:, None]), np.geomspace(0.05, 20.0, 2001))
    line = stats.linregress(x, b)
    assert (slope, std) == pytest.approx((line.slope, line.stderr), rel=4e-3)
    missed = b - line.intercept - line.slope * x
    assert left == pytest.approx(missed @ missed / 7, rel=4e-3)


def test_dates_are_read_as_toml_and_as_text():
    noon = datetime(2026, 11, 3, 12, tzinfo=UTC)
    assert days_of(noon) == pytest.approx(20760.5)
    assert days_of("2026-11-03") == 20760.0
    assert days_of(noon.date()) == 20760.0
    with pytest.raises(ValueError, match="expected a date such as"):
        days_of("yesterday")


def labelled(number, bias, **labels):
    simulation = ac.simulate(
        "tones",
        seconds=8.0,
        rig=CXL02_RIG,
        parameters={"bias": bias, "scale_factor": 0.01},
        rng=np.random.default_rng(number),
    )
    return dataclasses.replace(simulation.recording, name=f"run{number}", labels=RunLabels(**labels))


def test_a_fit_tells_that_the_bias_drifts_over_the_dates():
    rng = np.random.default_rng(3)
    days = [0.0, 11.0, 30.0, 47.0, 58.0, 80.0, 92.0]
    runs = [
        labelled(k, 0.05 + 1e-3 * day + 2e-3 * rng.standard_normal(), date=day, mounting="AB"[k % 2])
        for k, day in enumerate(days)
    ]
    fit = ac.fit(runs)
    result = fit.goes_with[0]
    print(result.sentence)
    assert "line" in result.members
    assert result.parameter == "bias"
    assert any("drift" in remark.sentence for remark in fit.remarks)
    if result.covariate == "line":
        assert abs(result.slope - 1e-3) < 4.0 * result.std
    judged = ac.diagnose(fit, runs)
    assert "goes_with" in {remark.code for remark in judged.remarks}


def test_what_is_the_same_in_all_runs_or_not_declared_is_not_tried():
    runs = [labelled(k, 0.05, date=float(k), mounting="A", operator="AB"[k % 2]) for k in range(4)]
    names = {item.name for item in covariates_of(runs, "m/s²")}
    assert names == {"line", "logarithm", "walk", "operator"}
    assert covariates_of([*runs[:3], labelled(4, 0.05)], "m/s²") == []
