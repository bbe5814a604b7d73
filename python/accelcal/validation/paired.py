"""Change of an error from one model to another on the same data, with its interval: paired in time.

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
from accelcal.validation.comparison import Evaluation, RmsInterval
from accelcal.validation.stretches import HORIZONS_APART, LEAST_STRETCHES, stretch_means

ONE_STEP_PARTS = 20.0
"""Stretches of a record over which one-step errors are averaged."""


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
    unit: str
    """m, or 1 for errors over their predicted standard deviation."""
    ratio_std: float
    """Standard error of the logarithm of the ratio of the mean squares."""

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
        return 50.0 * self.after / self.before * self.ratio_std if self.before > 0.0 else math.inf

    @property
    def percent_interval(self) -> tuple[float, float]:
        """The 95 % interval of the rise in percent, Student's with the scatter between stretches.

        It is symmetric in the logarithm of the ratio, so that no error falls by more than all of it.
        """
        if not (self.before > 0.0 and self.after > 0.0):
            return -100.0, math.inf
        reach = 0.5 * float(scipy.stats.t.ppf(0.975, self.stretches - 1)) * self.ratio_std
        ratio = self.after / self.before
        return 100.0 * (ratio * math.exp(-reach) - 1.0), 100.0 * (ratio * math.exp(reach) - 1.0)


@dataclass(frozen=True, slots=True)
class PairedStretches:
    """Mean squares of the errors of two models over stretches that hardly depend on each other."""

    measure: str
    unit: str
    number: Array
    """Errors in each stretch, (k,)."""
    before: Array
    after: Array
    """Mean squares, (k,) each."""

    @classmethod
    def of(cls, measure: str, t: Array, before: Array, after: Array, length: float, unit: str = "m") -> PairedStretches:
        """Errors at the instants `t` (n,) s, averaged over stretches of a length, s."""
        number, (first, second) = stretch_means(t, length, before**2, after**2)
        return cls(measure, unit, number.astype(float), first, second)

    @classmethod
    def joined(cls, several: Sequence[PairedStretches]) -> PairedStretches:
        """Stretches of several recordings; each counts by its number of errors."""
        columns = (np.concatenate([getattr(each, key) for each in several]) for key in ("number", "before", "after"))
        return cls(several[0].measure, several[0].unit, *columns)

    def change(self) -> HeldOutChange | None:
        """Change of the error; None where there are too few stretches."""
        n = len(self.number)
        if n < LEAST_STRETCHES:
            return None
        weights = self.number / self.number.sum()
        before, after = float(weights @ self.before), float(weights @ self.after)

        def scatter(y: Array) -> float:
            """Standard error of a weighted mean."""
            return math.sqrt(float(np.sum(weights**2 * (y - weights @ y) ** 2)) * n / (n - 1))

        std = scatter(self.after - self.before)
        ratio = scatter(self.after / after - self.before / before) if before > 0.0 and after > 0.0 else math.inf
        return HeldOutChange(self.measure, math.sqrt(before), math.sqrt(after), std, n, self.unit, ratio)


def paired_change(measure: str, t: Array, before: Array, after: Array, stretch: float) -> HeldOutChange | None:
    """Change of the mean square of errors that are paired in time; None where there are too few independent ones.

    Parameters
    ----------
    measure : what the errors are, for people.
    t : instants, rising, (n,) s.
    before, after : errors of two models at these instants, (n,) m each.
    stretch : time over which errors are averaged, s; longer than they depend on each other.
    """
    return PairedStretches.of(measure, t, before, after, stretch).change()


def paired_stretches(before: Evaluation, after: Evaluation, horizon: float | None) -> PairedStretches | None:
    """Errors of two comparisons on the same data under one ruler: drifts, or one-step errors for None.

    None where the two have no errors at the same instants.
    """
    if horizon is not None:
        (t1, e1), (t2, e2) = before.drifts[horizon], after.drifts[horizon]
        both, i, k = np.intersect1d(t1, t2, return_indices=True)
        length = HORIZONS_APART * horizon
        return PairedStretches.of(f"drift after {horizon:g} s", both, e1[i], e2[k], length) if len(both) else None
    (t, e1), (_, e2) = before.residual, after.residual
    span = float(t[-1] - t[0]) if len(t) else 0.0
    if len(e1) != len(e2) or not span > 0.0:
        return None
    # start-up counts by its uncertainty, which both share
    e1, e2 = e1 / before.residual_std, e2 / before.residual_std
    return PairedStretches.of("one-step error", t, e1, e2, span / ONE_STEP_PARTS, unit="1")


def heldout_change(before: Evaluation, after: Evaluation, horizon: float | None = None) -> HeldOutChange | None:
    """Change of the drift from one comparison to another on the same data.

    Parameters
    ----------
    before, after : comparisons under one ruler.
    horizon : s; by default the longest one for which the data hold enough independent windows.

    Returns
    -------
    The change of the drift; of the one-step error where no horizon is short enough; None where that is too short too.
    """
    tried = (*sorted(before.drifts, reverse=True), None) if horizon is None else (horizon,)
    several = (paired_stretches(before, after, each) for each in tried)
    changes = (each.change() for each in several if each is not None)
    return next((change for change in changes if change is not None), None)


def drift_spread(seen: Evaluation, horizon: float | None) -> RmsInterval | None:
    """Rms drift with its 95 % interval over the start points; None for a simulation, or where there are too few.

    Mean squares of stretches of two horizons count as independent; the interval is that of their mean.
    """
    if horizon is None or horizon not in seen.drifts:
        return None
    t, error = seen.drifts[horizon]
    _, (means,) = stretch_means(t, HORIZONS_APART * horizon, error**2)
    count = len(means)
    middle = float(np.mean(error**2)) if count else 0.0
    if count < LEAST_STRETCHES or not middle > 0.0:
        return None
    reach = scipy.stats.t.ppf(0.975, count - 1) * float(np.std(means, ddof=1)) / math.sqrt(count) / middle
    value = math.sqrt(middle)
    return RmsInterval(value, value * math.exp(-0.5 * reach), value * math.exp(0.5 * reach))


def best_step(steps: Sequence[Evaluation]) -> tuple[int, HeldOutChange] | None:
    """The step with the least held-out error, and the rise from it to the last step.

    `steps` are comparisons under one ruler, in order; None where the last one is the best, or the data are too short.
    """
    rises = [(number, heldout_change(step, steps[-1])) for number, step in enumerate(steps[:-1])]
    known = [(number, change) for number, change in rises if change is not None and change.before < change.after]
    return min(known, key=lambda each: each[1].before, default=None)
