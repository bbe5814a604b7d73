"""Which values of a series stand out from their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data.arrays import Array
from accelcal.diagnosis.local_spread import LOCAL, local_spread
from accelcal.diagnosis.noise_tests.contamination import contamination_test, steady_spread
from accelcal.diagnosis.policy import NOISE_TEST_ALPHA, OUTLIER_MOST_SAMPLES, OUTLIER_SIGMA


@dataclass(frozen=True, slots=True)
class Outliers:
    """What stands out of a series."""

    size: float
    """Of the largest, in the unit of the series."""
    score: float
    """The largest in local standard deviations."""
    peaks: NDArray[np.intp]
    """Where the sure ones are."""
    count: float
    """How many there are: the sure ones, or where none is sure the number that the scatter implies."""
    p_value: float

    def sentence(self, what: str, unit: str) -> str:
        """How many and how large."""
        return f"{self.count:.0f} {what} stand out by up to {self.size:.2g} {unit}"

    @property
    def parts(self) -> dict[str, float]:
        """Particulars."""
        return {"count": self.count, "largest": self.size}


def spread_of(y: Array, step: float = 0.0) -> tuple[Array, float]:
    """Local scale (n,) and its degrees of freedom: over a long span where the scatter is steady, else over a short.

    Values on a grid of spacing `step` have medians on it: they are blurred by one step, whose variance is taken off.
    """
    if step > 0.0:
        golden = np.modf(0.6180339887498949 * np.arange(len(y)))[0]
        y = y + step * (golden - 0.5)
    steady = steady_spread(y)
    spread, dof = steady if steady is not None else (local_spread(y), 0.7 * LOCAL)
    if step == 0.0:
        return spread, dof
    return np.sqrt(np.maximum(spread**2 - step**2 / 12.0, step**2 / 12.0)), dof


def outliers(y: Array, spread: Array, n: int, dof: float = 0.7 * LOCAL) -> Outliers:
    """Samples that do not belong to the rest, p value over n samples.

    Null: samples over a local spread that is itself estimated, Student's t with `dof` degrees of freedom. Three looks
    share the error: the largest of all, the number beyond 5.5 (Poisson), and the likelihood of contamination.
    """
    if n < 8 * LOCAL:
        return Outliers(0.0, 0.0, np.empty(0, dtype=np.intp), 0.0, 1.0)
    score = np.abs(y)
    score /= np.maximum(spread, 1e-300)
    share, p_share = contamination_test(score, dof)
    peaks = isolated(score, np.flatnonzero(score > OUTLIER_SIGMA))
    if len(peaks) == 0:
        largest = float(np.max(np.abs(y))) if p_share < NOISE_TEST_ALPHA else 0.0
        return Outliers(largest, float(np.max(score, initial=0.0)), peaks, share * n, min(1.0, 3.0 * p_share))
    top = int(peaks[np.argmax(score[peaks])])
    p_top = min(1.0, 2.0 * n * float(scipy.special.stdtr(dof, -score[top])))
    expected = 2.0 * n * float(scipy.special.stdtr(dof, -OUTLIER_SIGMA))
    p_count = float(scipy.special.gammainc(len(peaks), expected))
    limit = -float(scipy.special.stdtrit(dof, 0.5 * NOISE_TEST_ALPHA / max(n, 1)))
    sure = peaks[score[peaks] > limit]
    chosen = sure if len(sure) else peaks
    p_value = min(1.0, 3.0 * min(p_top, p_count, p_share))
    return Outliers(float(np.abs(y[top])), float(score[top]), chosen, float(len(chosen)), p_value)


def isolated(score: Array, loud: NDArray[np.intp]) -> NDArray[np.intp]:
    """Peaks of short runs of loud samples; what a filter rings with around a peak belongs to it."""
    if len(loud) == 0:
        return loud
    groups = np.split(loud, np.flatnonzero(np.diff(loud) > 8) + 1)
    kept = []
    for group in groups:
        peak = group[int(np.argmax(score[group]))]
        if int(np.sum(score[group] > 0.5 * score[peak])) <= OUTLIER_MOST_SAMPLES:
            kept.append(peak)
    return np.asarray(kept, dtype=np.intp)
