"""An arm that steps through twelve speeds: the fit and generalised least squares on dense matrices give the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import cholesky, solve_triangular

import accelcal as ac
from accelcal import _core
from accelcal.estimation import gauss_newton
from accelcal.estimation.columns import evaluated
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.gauss_newton import Solution

from .arms import Rigged, record

CENTRIFUGE = Rigged(motion="steps", seconds=24.0, rate=200.0, delay=0.0, quadratic=2e-3, seed=12)
MODEL = ac.Model.linear().add("quadratic").freeze(time_offset=0.0)


def changes(t: np.ndarray, gained: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """What accelerations add to the first reading, to the rate behind it, and to the changes of rate, (n, ...).

    Parameters
    ----------
    t : (n,) s.
    gained, moved : velocity, and position beyond that at the velocity before, of the interval that ends at each
        reading, (n, ...). No sum over time is formed.
    """
    rates = moved[1:] / np.diff(t).reshape(-1, *[1] * (moved.ndim - 1))
    return np.concatenate([0.0 * moved[:1], rates[:1], gained[1:-1] + np.diff(rates, axis=0)])


def of_readings(t: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The first reading, the rate behind it, and the changes of rate, (n, ...)."""
    rates = np.diff(z, axis=0) / np.diff(t).reshape(-1, *[1] * (z.ndim - 1))
    return np.concatenate([z[:1], rates[:1], np.diff(rates, axis=0)])


def dense(solution: Solution, factor: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Estimate and covariance by least squares under the dense covariance of all readings, linearised at a solution.

    z = p + e, p'' = (output - K0 - K2 a² ...) / (1 + k) - g + w with white e and w. Rows are differenced twice: their
    covariance is then so well conditioned that its Cholesky factor is exact to 1e-12. `factor` is a factor of the
    variance of w.
    """
    (state,), model, layout = solution.states, solution.model, solution.layout
    run, s, r, q = state.run, state.signals, state.noise.r, factor * state.noise.q
    t = run.t - run.t[0]
    h, grid, columns = np.diff(t, prepend=t[0]), s.t + run.origins.t - run.t[0], []
    for column in map(np.ascontiguousarray, evaluated(state, model.free)):
        gained, moved, covered = _core.drive(grid, column, t, how="cubic", tau=0.0, delay=0.0, hole=np.inf)
        assert covered[1:].all()
        columns.append(-changes(t, gained, moved) / s.scale)
    v, pp, pv, vv = run.prior(r)
    y = of_readings(t, run.z - run.z[0]) - changes(t, state.drive.first, state.drive.second)
    y[1] -= v
    eye = np.eye(len(t))
    read, once, twice = of_readings(t, eye), changes(t, eye, 0.0 * eye), changes(t, 0.0 * eye, eye)
    mixed = once * (0.5 * h**2) @ twice.T
    V = r * read @ read.T + q * (once * h @ once.T + mixed + mixed.T + twice * (h**3 / 3.0) @ twice.T)
    V[:2, :2] += [[pp, pv], [pv, vv]]
    rows = solve_triangular(cholesky(V, lower=True), np.column_stack([*columns, y]), lower=True)[state.counts]
    trust = np.sqrt(layout.prior_information(model))
    beliefs = np.column_stack([np.diag(trust), trust * (layout.prior_mean(model) - solution.x)])
    orthogonal, triangle = np.linalg.qr(np.concatenate([rows[:, :-1], beliefs[:, :-1]]))
    inverse = np.linalg.inv(triangle)
    step = inverse @ (orthogonal.T @ np.concatenate([rows[:, -1], beliefs[:, -1]]))
    return solution.x + step, inverse @ inverse.T


@pytest.mark.parametrize("axle", ["horizontal", "vertical"])
def test_twelve_speeds_give_the_quadratic_of_generalised_least_squares(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, axle: str
) -> None:
    recording = record(replace(CENTRIFUGE, axle=axle), tmp_path)
    monkeypatch.setattr(gauss_newton, "CONVERGED", 1e-9)
    # The force at the sensor follows the lever arm a round later: 12 rounds reach 1e-6 alone, and what has not settled
    # has the mean covariance of the rounds instead of that of the solution.
    monkeypatch.setattr(gauss_newton, "MAX_ROUNDS", 40)
    solution = solve_runs(MODEL, [recording])
    (x, covariance), std = dense(solution), np.sqrt(np.diag(solution.covariance))
    k2 = [term.name for term in solution.model.free].index("quadratic")
    assert x[k2] == pytest.approx(solution.x[k2], rel=1e-9)
    assert np.max(np.abs(x - solution.x) / std) < 1e-6
    np.testing.assert_allclose(covariance, solution.covariance, rtol=1e-5)
    assert abs(dense(solution, 2.0)[0][k2] / solution.x[k2] - 1.0) > 1e-8  # the twin: twice the noise
    assert abs(solution.x[k2] - CENTRIFUGE.quadratic) < 4.0 * std[k2]


@pytest.mark.parametrize("error", [0.0, 0.002])
def test_the_quadratic_is_as_uncertain_as_the_length_of_the_arm(tmp_path: Path, error: float) -> None:
    """Where no gravity turns the force is as wrong as the length, K2 twice that: it was 18 standard deviations off."""
    recording = record(replace(CENTRIFUGE, axle="vertical", arm_error=error), tmp_path)
    fit = ac.fit(recording, model=MODEL)
    assert abs(fit["quadratic"].value - CENTRIFUGE.quadratic) < 4.5 * fit["quadratic"].std  # false alarm: 1e-5
    of_arm = 2.0 * fit["lever_arm.x"].std / CENTRIFUGE.arm
    assert fit["quadratic"].std / fit["quadratic"].value == pytest.approx(of_arm, rel=0.05)


def test_what_an_arm_does_not_separate_is_said_of_an_arm(tmp_path: Path) -> None:
    """It was that of a level stage: bias with tilt, scale factor with the scale of the encoder."""
    sentences = {}
    for axle in ("vertical", "horizontal"):
        recording = record(Rigged(motion="turns", axle=axle, seed=3, seconds=15.0), tmp_path)
        fit = ac.fit(recording)
        sentences[axle] = [tie.members for tie in ac.diagnose(fit, recording).inseparable]
        assert "readings of angle" in fit.table().sentence
    assert sentences == {"vertical": [("scale_factor", "lever_arm.x")], "horizontal": []}
