"""Process and reading noise by the likelihood of the rows of the weak form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.estimation.likelihood import blocks
from accelcal.estimation.values import Noise
from accelcal.estimation.weak_form.rows import NoWeakForm, WeakRows, factor, solved

BLOCK_ROWS = 2048
"""Rows of one of the blocks that the likelihood is taken over."""


def with_noise(rows: WeakRows, width: float = 0.3) -> WeakRows:
    """The rows at the noise that is most likely near theirs; first steps in log q and log r are `width`."""
    found = most_likely(rows, rows.noise, width)
    return rows.at_noise(found)


def most_likely(rows: WeakRows, start: Noise, width: float) -> Noise:
    """Most likely q and R given the nominal motion; what varies along the record stays as it is."""
    run, step = rows.state.run, rows.reading_step
    spread = blocks(rows.rows, BLOCK_ROWS)
    parts = [(rows.covariance.part(block), rows.raw[block][:, None]) for block in spread]

    def cost(x: Array) -> float:
        q = math.exp(x[0])
        least = math.log(run.reading_variance_floor(q, step))
        r = math.exp(max(x[1], least))
        total = 1e3 * max(0.0, least - float(x[1]))
        for covariance, y in parts:
            try:
                L = factor(covariance.at(q, r))
            except NoWeakForm:
                return math.inf
            white = solved(L, y)
            total += 0.5 * float(np.sum(white**2)) + float(np.sum(np.log(L[0])))
        return total

    x0 = np.log([start.q, max(start.r, run.reading_variance_floor(start.q, step) * 1.01)])
    simplex = x0 + width * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    best = scipy.optimize.minimize(
        cost,
        x0,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 3e-3, "fatol": 0.02, "maxfev": 120},
    )
    q = float(np.exp(best.x[0]))
    return replace(start, q=q, r=max(float(np.exp(best.x[1])), run.reading_variance_floor(q, step)))
