"""The search of a minimum that advances in step with others, against SciPy's."""

import math
from typing import Any

import numpy as np
import pytest
import scipy

from accelcal.diagnosis.search.refine import EVALUATIONS, Search, minimum


def result(search: Search[Any]) -> Any:
    """Of a search that waits for nothing."""
    with pytest.raises(StopIteration) as end:
        next(search)
    return end.value.value


def test_it_is_that_of_scipy_place_by_place() -> None:
    rng = np.random.default_rng(5)
    for _ in range(300):
        c = rng.normal(size=4)
        low = float(rng.normal())
        high = low + 3.0 * float(rng.exponential())
        asked: list[float] = []

        def loss(x: float, c: np.ndarray = c, asked: list[float] = asked) -> Search[float]:
            asked.append(x)
            return float(c[0] * math.sin(3.0 * c[1] * x) + c[2] * x + 0.1 * c[3] * x * x)
            yield

        place, value = result(minimum(loss, low, high))
        ours, asked[:] = list(asked), []
        theirs = scipy.optimize.minimize_scalar(
            lambda x, loss=loss: result(loss(x)),
            bounds=(low, high),
            method="bounded",
            options={"xatol": 1e-3 * (high - low), "maxiter": EVALUATIONS},
        )
        assert (place, value) == (theirs.x, theirs.fun)
        assert ours == asked
