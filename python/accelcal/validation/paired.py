"""Change of an error from one model to another on the same data, with its standard error: paired in time.

Both models are run from the same start points, so that their errors share the noise. Windows that overlap are not
independent; they are averaged over stretches of two horizons, and the scatter of these averages counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.validation.comparison import Comparison, RmsInterval

LEAST_STRETCHES = 5
"""Fewer stretches than this do not determine a standard error."""
HORIZONS_APART = 2.0
"""Length of a stretch in horizons: windows that begin in one hardly reach into the next but one."""


@dataclass(frozen=True, slots=True)
class HeldOutChange:
    """Change of a held-out error between two models."""

    measure: str
    before: float
    """Rms error of the first model."""
    after: float
    """Rms error of the second one, the same unit."""
    std: float
    """Standard error of the difference of the mean squares."""
    stretches: int

    @property
    def sigma(self) -> float:
        """Rise in paired standard errors; negative where the error falls."""
        rise = self.after**2 - self.before**2
        return rise / self.std if self.std > 0.0 else 0.0

    @property
    def percent(self) -> float:
        """Rise of the rms error in percent."""
        return 100.0 * (self.after / self.before - 1.0) if self.before > 0.0 else 0.0

    @property
    def percent_std(self) -> float:
        """Its standard error, in percent."""
        both = (self.before + self.after) * self.before
        return 100.0 * self.std / both if both > 0.0 else math.inf


def paired_change(measure: str, t: Array, before: Array, after: Array, stretch: float) -> HeldOutChange | None:
    """Change of the mean square of errors that are paired in time; None where there are too few independent ones.

    Parameters
    ----------
    measure : what the errors are, for people.
    t : instants, rising, (n,) s.
    before, after : errors of two models at these instants, (n,) each.
    stretch : time over which errors are averaged, s; longer than they depend on each other.
    """
    if not len(t):
        return None
    block = ((t - t[0]) / stretch).astype(np.intp)
    difference = after**2 - before**2
    number = np.bincount(block)
    some = number > 0
    means = np.bincount(block, difference)[some] / number[some]
    if len(means) < LEAST_STRETCHES:
        return None
    weights = number[some] / number.sum()
    middle = float(weights @ means)
    std = math.sqrt(float(np.sum(weights**2 * (means - middle) ** 2)) * len(means) / (len(means) - 1))
    rms = [float(np.sqrt(np.mean(y**2))) for y in (before, after)]
    return HeldOutChange(measure, rms[0], rms[1], std, len(means))


def heldout_change(before: Comparison, after: Comparison, horizon: float | None = None) -> HeldOutChange | None:
    """Change of the drift from one comparison to another on the same data.

    Parameters
    ----------
    before, after : comparisons under one ruler.
    horizon : s; by default the longest one for which the data hold enough independent windows.

    Returns
    -------
    The change of the drift; of the one-step error where no horizon is short enough; None where that is too short too.
    """
    for chosen in sorted(before.drifts, reverse=True) if horizon is None else [horizon]:
        (t1, e1), (t2, e2) = before.drifts[chosen], after.drifts[chosen]
        both, i, k = np.intersect1d(t1, t2, return_indices=True)
        found = paired_change(f"drift after {chosen:g} s", both, e1[i], e2[k], HORIZONS_APART * chosen)
        if found is not None:
            return found
    if horizon is not None:
        return None
    (t, e1), (_, e2) = before.residual, after.residual
    if len(e1) == len(e2):  # start-up counts by its uncertainty, which both share
        e1, e2 = e1 / before.residual_std, e2 / before.residual_std
    span = float(t[-1] - t[0]) if len(t) else 0.0
    return paired_change("one-step error", t, e1, e2, span / 20.0) if len(e1) == len(e2) and span > 0.0 else None


def drift_spread(seen: Comparison, horizon: float | None) -> RmsInterval | None:
    """Rms drift with its 95 % interval over the start points; None for a simulation, or where there are too few.

    Mean squares of stretches of two horizons count as independent; the interval is that of their mean.
    """
    if horizon is None or horizon not in seen.drifts:
        return None
    t, error = seen.drifts[horizon]
    if not len(t):
        return None
    block = ((t - t[0]) / (HORIZONS_APART * horizon)).astype(np.intp)
    number = np.bincount(block)
    means = np.bincount(block, error**2)[number > 0] / number[number > 0]
    count, middle = len(means), float(np.mean(error**2))
    if count < LEAST_STRETCHES or not middle > 0.0:
        return None
    reach = scipy.stats.t.ppf(0.975, count - 1) * float(np.std(means, ddof=1)) / math.sqrt(count) / middle
    value = math.sqrt(middle)
    return RmsInterval(value, value * math.exp(-0.5 * reach), value * math.exp(0.5 * reach))


def best_step(steps: Sequence[Comparison]) -> tuple[int, HeldOutChange] | None:
    """The step with the least held-out error, and the rise from it to the last step.

    `steps` are comparisons under one ruler, in order; None where the last one is the best, or the data are too short.
    """
    rises = [(number, heldout_change(step, steps[-1])) for number, step in enumerate(steps[:-1])]
    known = [(number, change) for number, change in rises if change is not None and change.before < change.after]
    return min(known, key=lambda each: each[1].before, default=None)
