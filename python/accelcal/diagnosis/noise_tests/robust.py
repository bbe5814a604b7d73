"""Robust statistics of noise: local scale, a test for contamination, and the samples that are outliers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import Array
from accelcal.diagnosis.policy import (
    FAST_SCATTER_RATIO,
    NOISE_TEST_ALPHA,
    OUTLIER_MOST_SAMPLES,
    OUTLIER_SIGMA,
    STEADY_SCATTER_RATIO,
)
from accelcal.signals.series import LOCAL, local_spread

LONG_SPANS = ((16384, 3200.0, 2), (1024, 200.0, 8), (256, 100.0, 8))
"""Longer spans over which a scale may be taken where the scatter is steady, the degrees of freedom it then has, and how
many such spans show that it is steady."""
CHUNK = 1 << 16
"""Samples at which the scale is interpolated between spans at a time."""
LOG_MEDIAN_VARIANCE = 0.0213
"""Variance of the logarithm of the median of 64 absolute normal deviates."""
WIDTHS = (2.5, 5.0, 10.0, 30.0, 100.0, 1000.0)
"""Sizes of outliers that are tried, in standard deviations of the noise."""
SHARES = (1e-5, 1e-4, 1e-3, 3e-3)
"""Shares of outliers that are tried."""
BINNED = 3.0
"""Deviations up to here are counted in bins."""


@dataclass(frozen=True, slots=True)
class Outliers:
    """Outliers of a series."""

    size: float
    """Of the largest, in the unit of the series."""
    score: float
    """The largest in local standard deviations."""
    peaks: NDArray[np.intp]
    """Indices of the certain ones."""
    count: float
    """Number of certain ones; where none is certain, the number that the scatter implies."""
    p_value: float

    def sentence(self, what: str, unit: str) -> str:
        """How many and how large."""
        return f"{self.count:.0f} {what} are outliers of up to {self.size:.2g} {unit}"

    @property
    def parts(self) -> dict[str, float]:
        """Particulars."""
        return {"count": self.count, "largest": self.size}


def steady_spread(y: Array) -> tuple[Array, float] | None:
    """Robust standard deviation about each sample, (n,), over the longest span on which the scatter is steady, and its
    degrees of freedom; None where the scatter changes too fast for any span."""
    K = len(y) // LOCAL
    longest = LONG_SPANS[-1][0] // LOCAL
    if 8 * longest > K:
        return None
    medians = np.median(np.abs(y[: K * LOCAL].reshape(K, LOCAL)), axis=1, overwrite_input=True)
    usual = float(np.median(medians))
    if usual <= 0.0:
        return None
    logs = np.log(np.where(medians > 0.0, medians, usual))
    between = 0.5 * float(np.mean(np.diff(logs) ** 2))
    if between > FAST_SCATTER_RATIO * LOG_MEDIAN_VARIANCE:
        return None
    for span, dof, enough in LONG_SPANS:
        m = span // LOCAL
        groups = logs[: len(logs) // m * m].reshape(-1, m)
        if len(groups) >= enough and float(np.mean(groups.var(axis=1, ddof=1))) < STEADY_SCATTER_RATIO * between:
            own = np.abs(y[: len(groups) * span].reshape(-1, span))
            own = np.median(own, axis=1, overwrite_input=True) / 0.6745
            own = np.where(own > 0.0, own, usual / 0.6745)
            centres = (np.arange(len(own)) + 0.5) * span
            spread = np.empty(len(y))
            for begin in range(0, len(y), CHUNK):
                rows = np.arange(begin, min(begin + CHUNK, len(y)), dtype=np.float64)
                spread[begin : begin + CHUNK] = np.interp(rows, centres, own)
            return spread, dof
    return None


def spread_of(y: Array, step: float = 0.0) -> tuple[Array, float]:
    """Local scale (n,) and its degrees of freedom: over a long span where the scatter is steady, else over a short one.

    Values on a grid of spacing `step` have medians on the grid: they are blurred by one step, whose variance is
    subtracted again.
    """
    if step > 0.0:
        golden = np.modf(0.6180339887498949 * np.arange(len(y)))[0]
        y = y + step * (golden - 0.5)
    steady = steady_spread(y)
    spread, dof = steady if steady is not None else (local_spread(y), 0.7 * LOCAL)
    if step == 0.0:
        return spread, dof
    return np.sqrt(np.maximum(spread**2 - step**2 / 12.0, step**2 / 12.0)), dof


def contamination_test(score: Array, dof: float) -> tuple[float, float]:
    """Share of samples with a wider distribution than the rest, and the probability of such samples under the null.

    Likelihood ratio of (1 - share) t(dof) + share N(0, 1 + width²) to t(dof), averaged over a grid of shares and
    widths. Without outliers the expectation of that average is one, so it exceeds 1/p with a probability of at most p
    (Markov); nothing is taken from asymptotics, which rare outliers do not obey.
    """
    size = np.abs(score)
    edges = np.linspace(0.0, BINNED, 301)
    count, _ = np.histogram(size, edges)
    tail = size[size > BINNED]
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


def outliers(y: Array, spread: Array, n: int, dof: float = 0.7 * LOCAL) -> Outliers:
    """Samples that do not belong to the distribution of the rest, p value over n samples.

    Null: samples over a local spread that is itself estimated, Student's t with `dof` degrees of freedom. Three tests
    share the error probability: the largest sample, the number beyond 5.5 sigma (Poisson), and the likelihood of
    contamination.
    """
    if n < 8 * LOCAL:
        return Outliers(0.0, 0.0, np.empty(0, dtype=np.intp), 0.0, 1.0)
    score = np.abs(y)
    score /= np.maximum(spread, 1e-300)
    share, p_share = contamination_test(score, dof)
    peaks = isolated_peaks(score, np.flatnonzero(score > OUTLIER_SIGMA))
    if len(peaks) == 0:
        largest = float(np.max(np.abs(y))) if p_share < NOISE_TEST_ALPHA else 0.0
        return Outliers(largest, float(np.max(score, initial=0.0)), peaks, share * n, min(1.0, 3.0 * p_share))
    top = int(peaks[np.argmax(score[peaks])])
    p_top = min(1.0, 2.0 * n * float(scipy.special.stdtr(dof, -score[top])))
    expected = 2.0 * n * float(scipy.special.stdtr(dof, -OUTLIER_SIGMA))
    p_count = float(scipy.special.gammainc(len(peaks), expected))
    limit = -float(scipy.special.stdtrit(dof, 0.5 * NOISE_TEST_ALPHA / max(n, 1)))
    certain = peaks[score[peaks] > limit]
    chosen = certain if len(certain) else peaks
    p_value = min(1.0, 3.0 * min(p_top, p_count, p_share))
    return Outliers(float(np.abs(y[top])), float(score[top]), chosen, float(len(chosen)), p_value)


def isolated_peaks(score: Array, large: NDArray[np.intp]) -> NDArray[np.intp]:
    """Peaks of short runs of `large` samples; a filter's ringing around a peak belongs to that peak."""
    if len(large) == 0:
        return large
    groups = np.split(large, np.flatnonzero(np.diff(large) > 8) + 1)
    kept = []
    for group in groups:
        peak = group[int(np.argmax(score[group]))]
        if int(np.sum(score[group] > 0.5 * score[peak])) <= OUTLIER_MOST_SAMPLES:
            kept.append(peak)
    return np.asarray(kept, dtype=np.intp)
