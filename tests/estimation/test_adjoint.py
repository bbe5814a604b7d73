"""The transposed filter against the filter itself: y·(A d) = (Aᵀ y)·d for every error d and innovations y."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from accelcal.estimation.columns import gradient_in_output, gradient_in_readings


def run_with(gains, step, remaining):
    """Readings at uniform times of which some were taken, under a filter that has settled."""
    return SimpleNamespace(
        run=SimpleNamespace(t=3.0 + step * np.flatnonzero(remaining), reading_step=step),
        counts=np.ones(int(remaining.sum()), dtype=bool),
        series=lambda name: np.full(len(remaining), gains[name]),
    )


def innovations(gains, step, output, readings):
    """The filter written out: a motionless stage, an output and readings that are off by so much, (n,) m."""
    p = v = 0.0
    results = []
    for u, z in zip(output, readings, strict=True):
        e = z - p
        results.append(e)
        p, v = p + gains["gain_p"] * e, v + gains["gain_v"] * e
        p, v = p + step * v + 0.5 * step**2 * u, v + step * u
    return np.array(results)


@settings(deadline=None)  # the first call loads SciPy
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 60), step=st.sampled_from([1e-3, 0.02, 0.7]))
@pytest.mark.parametrize("side", ["output", "readings"])
def test_what_is_asked_is_the_transpose_of_the_filter(side, seed, n, step):
    rng = np.random.default_rng(seed)
    gains = {"gain_p": rng.uniform(0.05, 0.9), "gain_v": rng.uniform(0.01, 0.3) / step}
    remaining = rng.random(n) < 0.8
    remaining[[0, -1]] = True
    error, y = (np.where(remaining, rng.normal(size=n), 0.0) for _ in range(2))
    nothing = np.zeros(n)

    if side == "output":  # it pushes the prediction up, so its innovation goes down
        adjoint = -innovations(gains, step, error, nothing)
        asked = gradient_in_output(run_with(gains, step, remaining), y[remaining])
    else:
        adjoint = innovations(gains, step, nothing, error)
        asked = gradient_in_readings(run_with(gains, step, remaining), y[remaining])

    assert asked @ error[remaining] == pytest.approx(y @ adjoint, rel=1e-9, abs=1e-9)  # both double, at most 60 steps
