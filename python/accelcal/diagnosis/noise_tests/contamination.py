"""Robust noise level where a share of the samples is contaminated, and a test for contamination."""

from __future__ import annotations

import math

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.diagnosis.policy import FAST_SCATTER_RATIO, STEADY_SCATTER_RATIO

# ---- samples that noise does not allow ---------------------------------------------------------------------------

FINE = 64
"""Samples over which no noise changes much."""
STEADY = ((16384, 3200.0, 2), (1024, 200.0, 8), (256, 100.0, 8))
"""Longer spans that a scale may be taken over where the scatter is steady, the degrees of freedom it then has, and how
many of them show that it is."""
DRAWN = 1 << 16
"""Samples whose scale is drawn at a time between those of spans."""
SCATTER = 0.0213
"""Variance of the logarithm of the median of 64 absolute normal deviates."""
WIDTHS = (2.5, 5.0, 10.0, 30.0, 100.0, 1000.0)
"""Sizes of outliers that are tried, in standard deviations of the noise."""
SHARES = (1e-5, 1e-4, 1e-3, 3e-3)
"""Shares of samples that are tried."""
CORE = 3.0
"""Deviations up to here are counted in bins."""


def steady_spread(y: Array) -> tuple[Array, float] | None:
    """Robust standard deviation about each sample, (n,), over as long a span as the scatter is steady, and its degrees
    of freedom; None where it changes too quickly for any span."""
    K = len(y) // FINE
    longest = STEADY[-1][0] // FINE
    if 8 * longest > K:
        return None
    medians = np.median(np.abs(y[: K * FINE].reshape(K, FINE)), axis=1, overwrite_input=True)
    usual = float(np.median(medians))
    if usual <= 0.0:
        return None
    logs = np.log(np.where(medians > 0.0, medians, usual))
    between = 0.5 * float(np.mean(np.diff(logs) ** 2))
    if between > FAST_SCATTER_RATIO * SCATTER:
        return None
    for span, dof, enough in STEADY:
        m = span // FINE
        groups = logs[: len(logs) // m * m].reshape(-1, m)
        if len(groups) >= enough and float(np.mean(groups.var(axis=1, ddof=1))) < STEADY_SCATTER_RATIO * between:
            own = np.abs(y[: len(groups) * span].reshape(-1, span))
            own = np.median(own, axis=1, overwrite_input=True) / 0.6745
            own = np.where(own > 0.0, own, usual / 0.6745)
            centres = (np.arange(len(own)) + 0.5) * span
            spread = np.empty(len(y))
            for begin in range(0, len(y), DRAWN):
                rows = np.arange(begin, min(begin + DRAWN, len(y)), dtype=np.float64)
                spread[begin : begin + DRAWN] = np.interp(rows, centres, own)
            return spread, dof
    return None


def contamination_test(score: Array, dof: float) -> tuple[float, float]:
    """Share of samples with a wider scatter than the rest, and the chance of such a sample of noise.

    Likelihood ratio of (1 - share) t(dof) + share N(0, 1 + width²) to t(dof), averaged over a grid of shares and
    widths. The expectation of that average without outliers is one, so it exceeds 1/p with a chance of at most p
    (Markov); nothing is taken from asymptotics, which rare outliers do not obey.
    """
    size = np.abs(score)
    edges = np.linspace(0.0, CORE, 301)
    count, _ = np.histogram(size, edges)
    tail = size[size > CORE]
    x = np.append(0.5 * (edges[1:] + edges[:-1]), tail)
    count = np.append(count, np.ones(len(tail)))
    clean = scipy.special.gammaln(0.5 * (dof + 1.0)) - scipy.special.gammaln(0.5 * dof)
    clean += -0.5 * math.log(math.pi * dof) - 0.5 * (dof + 1.0) * np.log1p(x**2 / dof)
    gains = np.empty((len(WIDTHS), len(SHARES)))
    for i, width in enumerate(WIDTHS):
        variance = 1.0 + width**2
        wide = -0.5 * x**2 / variance - 0.5 * math.log(2.0 * math.pi * variance)
        for j, share in enumerate(SHARES):
            gains[i, j] = count @ np.logaddexp(math.log1p(-share), math.log(share) + wide - clean)
    evidence = float(scipy.special.logsumexp(gains)) - math.log(gains.size)
    return SHARES[int(np.argmax(gains)) % len(SHARES)], min(1.0, math.exp(-max(evidence, 0.0)))
