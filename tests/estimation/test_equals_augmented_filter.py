"""The replay and the augmented Kalman filter agree to 1e-6 standard deviations when the model is linear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from numpy.typing import NDArray

from accelcal import _core
from tests.estimation.augmented import augmented_filter

Array = NDArray[np.float64]

INPUTS, DIRECT = 3, 1


@dataclass(frozen=True)
class Case:
    """A record, its drive, and four columns: three that drive the motion, one that adds to the reading."""

    t: Array
    z: Array
    first: Array
    second: Array
    grid: Array
    start: float
    step: float
    at_readings: Array
    q: float
    R: float
    prior: tuple[float, float, float, float]
    precision: Array


def case(seed: int, *, n: int = 300, jitter: float = 0.4, gaps: int = 2) -> Case:
    """A record with uneven times and gaps; columns on a grid that shares nothing with the readings."""
    rng = np.random.default_rng(seed)
    h = 1.2e-3 * (1.0 + jitter * rng.uniform(-1.0, 1.0, n))
    h[rng.integers(1, n, gaps)] *= rng.uniform(20.0, 60.0, gaps)  # the encoder falls silent
    t = np.cumsum(h) + rng.uniform(-1.0, 1.0)
    q, R = 10.0 ** rng.uniform(-8.0, -4.0), 10.0 ** rng.uniform(-13.0, -10.0)
    f = rng.uniform(1.0, 9.0, INPUTS)

    step = rng.uniform(0.7e-3, 3e-3)
    grid_t = t[0] - 0.3 * step + step * np.arange(int((t[-1] - t[0]) / step) + 4)
    grid = np.column_stack([np.ones_like(grid_t), *(np.sin(2 * np.pi * w * grid_t) for w in f[1:])])
    at_readings = np.column_stack([1e-3 * np.cos(2 * np.pi * f[0] * t)])

    a_t = np.arange(t[0] - 0.01, t[-1] + 0.01, 0.6e-3)
    output = 2.0 * np.sin(2 * np.pi * f[1] * a_t) + rng.standard_normal(len(a_t))
    first, second, _ = _core.drive(a_t, output, t, how="cubic", tau=1e-3, delay=2e-4, hole=np.inf)
    # The readings need not come from the model: the two computations must agree on anything.
    z = np.cumsum(h * np.cumsum(first)) + 1e-5 * np.sin(40.0 * t) + np.sqrt(R) * rng.standard_normal(n)
    prior = (rng.normal(0.0, 0.1), 100.0 * R, 0.0, 0.5)
    precision = 1.0 / np.array([0.3, 0.1, 0.05, 0.02]) ** 2
    return Case(t, z, first, second, grid, float(grid_t[0]), float(step), at_readings, q, R, prior, precision)


def by_replay(c: Case, *, restart: Array | None = None) -> tuple[Array, Array]:
    """Estimate and covariance from the normal equations of the replay, every reading counted."""
    n, m = len(c.t), INPUTS + DIRECT
    begins = np.zeros(n, dtype=np.bool_) if restart is None else restart
    begins[0] = True
    track = _core.ReplayTrack(
        c.t, c.z, c.first, c.second, begins, np.zeros(n), np.empty(0), q=c.q, r=c.R, prior=c.prior
    )
    grid = c.start, c.step, len(c.grid)
    bank = _core.Bank(track, c.t, begins, np.ones(n, dtype=np.bool_), grid=grid, from_=0, to=n, group=1)
    rows, response = np.empty((m, n)), np.zeros((m, 2))
    bank.carry_inputs(list(np.ascontiguousarray(c.grid.T)), 1.0, response[:INPUTS], rows[:INPUTS])
    bank.carry_readings(list(np.ascontiguousarray(c.at_readings.T)), response[INPUTS:], rows[INPUTS:])
    X = rows.T
    y = track.series("e") / np.sqrt(track.series("S"))
    covariance = np.linalg.inv(X.T @ X + np.diag(c.precision))
    return covariance @ (X.T @ y), covariance


def by_filter(c: Case, *, scale: float = 1.0) -> tuple[Array, Array]:
    """Estimate and covariance by the augmented filter; `scale` spoils its first column."""
    n, m = len(c.t), INPUTS + DIRECT
    once, twice, direct = np.zeros((n, m)), np.zeros((n, m)), np.zeros((n, m))
    grid_t = c.start + c.step * np.arange(len(c.grid))
    for j in range(INPUTS):
        column = np.ascontiguousarray(c.grid[:, j])
        once[:, j], twice[:, j], covered = _core.drive(
            grid_t, column, c.t, how="cubic", tau=0.0, delay=0.0, hole=np.inf
        )
        assert covered[1:].all()
    once[:, 0] *= scale
    twice[:, 0] *= scale
    direct[:, INPUTS:] = c.at_readings
    v, pp, pv, vv = c.prior
    motion = np.array([c.z[0], v]), np.array([[pp, pv], [pv, vv]])
    return augmented_filter(
        c.t, c.z, (c.first, c.second), (once, twice), direct, q=c.q, R=c.R, motion=motion, precision=c.precision
    )


def difference(c: Case, first: tuple[Array, Array], two: tuple[Array, Array]) -> tuple[float, float]:
    """Largest difference of estimates in sigma, and of covariances relative to sigma_i sigma_j."""
    sigma = np.sqrt(np.diag(two[1]))
    return (
        float(np.max(np.abs(first[0] - two[0]) / sigma)),
        float(np.max(np.abs(first[1] - two[1]) / np.outer(sigma, sigma))),
    )


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(40, 400),
    jitter=st.sampled_from([0.0, 0.3, 0.9]),
    gaps=st.integers(0, 4),
)
def test_replay_equals_the_augmented_filter_on_linear_models(seed: int, n: int, jitter: float, gaps: int) -> None:
    c = case(seed, n=n, jitter=jitter, gaps=gaps)
    estimate, covariance = difference(c, by_replay(c), by_filter(c))
    # Joseph form in double, readings of 1 m against sigmas of 1e-6 m: what is left is its rounding.
    assert estimate < 1e-6
    assert covariance < 1e-6


def test_a_column_one_part_in_a_thousand_off_is_noticed() -> None:
    c = case(7)
    estimate, covariance = difference(c, by_replay(c), by_filter(c, scale=1.001))
    assert max(estimate, covariance) > 1e-4  # the twin: the check sees a hundred times its tolerance


def test_the_prior_takes_part() -> None:
    c = case(11)
    estimate, covariance = by_replay(c)
    free = np.linalg.inv(np.linalg.inv(covariance) - np.diag(c.precision))
    assert np.all(np.diag(free) > np.diag(covariance))
    assert np.all(np.isfinite(estimate))


@pytest.mark.parametrize("seed", range(3))
def test_a_restart_adds_information_of_two_records(seed: int) -> None:
    c = case(seed)
    cut = 130
    restart = np.zeros(len(c.t), dtype=np.bool_)
    restart[cut] = True
    _, whole = by_replay(c, restart=restart)
    parts = np.zeros_like(whole)
    for rows in (slice(0, cut), slice(cut, None)):
        part = Case(
            c.t[rows],
            c.z[rows],
            c.first[rows],
            c.second[rows],
            c.grid,
            c.start,
            c.step,
            np.ascontiguousarray(c.at_readings[rows]),
            c.q,
            c.R,
            c.prior,
            c.precision,
        )
        parts += np.linalg.inv(by_replay(part)[1]) - np.diag(c.precision)
    np.testing.assert_allclose(np.linalg.inv(whole) - np.diag(c.precision), parts, rtol=1e-9)  # 4 x 4 inverses
