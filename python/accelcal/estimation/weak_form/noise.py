"""Process and reading noise by the likelihood of the rows of the weak form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from accelcal.data.references import POSITION_ORDER
from accelcal.estimation.likelihood import blocks
from accelcal.estimation.noise import most_likely_noise
from accelcal.estimation.values import Noise
from accelcal.estimation.weak_form.covariance import NoWeakForm, factor, solved
from accelcal.estimation.weak_form.rows import WeakRows

MOST_OF_BOTH = 0.9
"""Largest share of the sensor in the noise of two accelerations."""
READINGS_KNOWN = math.log(3.0)
"""Standard deviation of what the readings themselves tell of the logarithm of their variance."""
BLOCK_ROWS = 2048
"""Rows of one of the blocks that the likelihood is taken over."""


def with_noise(rows: WeakRows, width: float = 0.3) -> WeakRows:
    """The rows at the noise that is most likely near theirs; first steps in log q and log r are `width`.

    What varies along the record stays as it is. Readings so good that the rows do not show their noise have the one
    that their neighbours do not predict.
    """
    start, told = rows.noise, rows.state.run.unpredicted.reading
    if rows.order == 0:
        return rows.at_noise(shared(rows))
    known = 2.0 * math.log(told) if told > 0.0 and rows.order == POSITION_ORDER else None
    parts = [(rows.covariance.part(block), rows.raw[block][:, None]) for block in blocks(rows.rows, BLOCK_ROWS)]

    def log_likelihood(log_q: float, log_r: float) -> float:
        total = 0.0 if known is None else -0.5 * ((log_r - known) / READINGS_KNOWN) ** 2
        for covariance, y in parts:
            try:
                L = factor(covariance.at(math.exp(log_q), math.exp(log_r)))
            except NoWeakForm:
                return -math.inf
            total -= 0.5 * float(np.sum(solved(L, y) ** 2)) + float(np.sum(np.log(L[0])))
        return total

    found = most_likely_noise(log_likelihood, rows.least_reading_variance, start, width)
    return rows.at_noise(replace(start, q=found.q, r=found.r))


def shared(rows: WeakRows) -> Noise:
    """Noise of the output and of a reference that is an acceleration, of which the rows show the sum alone.

    The sensor has what is declared of it, if that is less than all, and half of it where nothing is.
    """
    run, step = rows.state.run, rows.reading_step
    both = float(np.mean(rows.whitened**2)) * (rows.noise.q + rows.noise.r * step)
    declared = run.rig.sensor.noise
    q = both / 2.0 if declared is None else 0.5 * (declared / rows.state.values.scale) ** 2
    q = min(q, MOST_OF_BOTH * both)
    return replace(rows.noise, q=q, r=(both - q) / step)
