"""Models on the same recordings: the error of each, and how it differs from the error of the first model."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal._support.arguments import checked
from accelcal._support.errors import AccelcalError
from accelcal._support.result import Result
from accelcal._support.values import face, immutable
from accelcal.data import Array
from accelcal.estimation.estimate import Fit
from accelcal.validation.comparison import (
    TWO_SIDED,
    Evaluation,
    FigureName,
    NoiseFloor,
    Resolved,
    RmsInterval,
    SystematicError,
)
from accelcal.validation.noise_floor import Ruler
from accelcal.validation.prediction import rms

if TYPE_CHECKING:
    from matplotlib.figure import Figure


LEAST_STRETCHES = 5
"""Fewer stretches than this do not determine a standard error."""
HORIZONS_APART = 2.0
"""Length of a stretch in horizons: windows that begin in one hardly reach into the next but one."""


def stretch_means(t: Array, length: float, *squares: Array) -> tuple[NDArray[np.intp], list[Array]]:
    """Number of errors in each stretch of time that holds any, (k,), and the means of their squares, (k,) each.

    Parameters
    ----------
    t : instants, rising, (n,) s.
    length : of a stretch, s.
    squares : squared errors at these instants, (n,) each.
    """
    if not len(t):
        return np.empty(0, dtype=np.intp), [np.empty(0) for _ in squares]
    stretch = ((t - t[0]) / length).astype(np.intp)
    number = np.bincount(stretch)
    some = number > 0
    return number[some], [np.bincount(stretch, y)[some] / number[some] for y in squares]


def stretch_count(evaluation: Evaluation, horizon: float) -> int:
    """Stretches of two horizons among the start points of a drift; 0 where the record is too short for it."""
    if horizon not in evaluation.drifts:
        return 0
    return len(stretch_means(evaluation.drifts[horizon][0], HORIZONS_APART * horizon)[0])


def headline_horizon(*evaluations: Evaluation) -> float | None:
    """The drift that is quoted first: the longest horizon with enough independent stretches to have an interval.

    Parameters
    ----------
    evaluations : the comparisons that are shown together, at least one.

    Returns
    -------
    s; the shortest horizon that all of them allow where none has enough stretches, None where they allow none.
    """
    allowed = [
        h
        for h in evaluations[0].coast_rms
        if all(evaluation.coast_rms.get(h) is not None for evaluation in evaluations)
    ]
    sure = [h for h in allowed if all(stretch_count(evaluation, h) >= LEAST_STRETCHES for evaluation in evaluations)]
    return max(sure, default=min(allowed, default=None))


@dataclass(frozen=True, slots=True)
class Measure:
    """The error that is quoted first: the systematic one of the corrected output, else the drift."""

    band: float | None
    """Of the systematic error, Hz; None where a record is too short for it."""
    horizon: float | None
    """Time without position, s, after which the drift is quoted; None: too short, the free-running error is."""

    @classmethod
    def of(cls, evaluations: Sequence[Evaluation]) -> Measure:
        """The error that is quoted of comparisons that are shown together."""
        resolved = all(evaluation.resolved for evaluation in evaluations)
        band = min(evaluation.band for evaluation in evaluations) if resolved else None
        return cls(band, headline_horizon(*evaluations))

    @property
    def name(self) -> str:
        """Name of the error, for people."""
        if self.band is not None:
            return f"systematic error of the output below {self.band:.3g} Hz"
        return "free-running error" if self.horizon is None else f"unaided drift after {self.horizon:g} s"

    @property
    def unit(self) -> Literal["m/s²", "m"]:
        """Of the error."""
        return "m" if self.band is None else "m/s²"

    @property
    def alone(self) -> str:
        """Name of what noise alone gives, for people."""
        return "noise alone" if self.band is None else "limit of detection"

    def error(self, evaluation: Evaluation) -> float:
        """Rms error; below the limit of detection its upper bound, NaN where there is none."""
        if self.band is not None and (systematic := evaluation.systematic) is not None:
            return systematic.rms if systematic.detected else systematic.high
        value = evaluation.simulated_rms if self.horizon is None else evaluation.coast_rms.get(self.horizon)
        return math.nan if value is None else value

    def interval(self, evaluation: Evaluation) -> RmsInterval | None:
        """The error with its 95 % interval; None where there are too few start points."""
        if self.band is not None and (systematic := evaluation.systematic) is not None:
            return RmsInterval(systematic.rms, systematic.low, systematic.high)
        return drift_spread(evaluation, self.horizon)

    def floor(self, evaluation: Evaluation) -> RmsInterval | None:
        """Error by noise alone: up to the limit of detection, or drifts of so many records; None where unknown."""
        if self.band is not None and (systematic := evaluation.systematic) is not None:
            return RmsInterval(systematic.detection_limit, 0.0, systematic.detection_limit)
        return None if evaluation.noise_floor is None else evaluation.noise_floor.at(self.horizon)


APART = 4.0
"""Horizons between two recordings, so that no stretch of time over which errors are averaged holds both."""


def pooled(several: Sequence[Evaluation]) -> Evaluation:
    """Comparisons of one model with several recordings as one.

    Parameters
    ----------
    several : under one ruler, at least one.

    Returns
    -------
    Drifts, free-running and one-step errors and noise floor over all recordings; each start point, and each reading,
    counts the same. Curves, bins and what else is of one recording are those of the first.
    """
    first, *others = several
    if not others:
        return first
    readings = [len(evaluation.simulated[0]) for evaluation in several]
    innovations = [len(evaluation.residual[0]) for evaluation in several]
    drifts = {h: in_a_row([evaluation.drifts[h] for evaluation in several], APART * h) for h in first.drifts}
    return replace(
        first,
        recording=" and ".join(evaluation.recording for evaluation in several),
        drifts=drifts,
        coast_rms={horizon: rms(error) for horizon, (_, error) in drifts.items()},
        coast_starts={h: sum(evaluation.coast_starts[h] for evaluation in several) for h in first.coast_starts},
        coast_frozen_rms={h: over_starts(several, [s.coast_frozen_rms[h] for s in several], h) for h in drifts},
        coast_floor={h: over_starts(several, [s.coast_floor[h] for s in several], h) for h in drifts},
        simulated_rms=root_mean(zip((evaluation.simulated_rms for evaluation in several), readings, strict=True)),
        one_step_rms=root_mean(zip((evaluation.one_step_rms for evaluation in several), innovations, strict=True)),
        not_carried=tuple(dict.fromkeys(text for evaluation in several for text in evaluation.not_carried)),
        left_out=tuple(text for evaluation in several for text in evaluation.left_out),
        noise_scores=tuple(score for evaluation in several for score in evaluation.noise_scores),
        noise_floor=pooled_floor(several, readings),
        budget=None,
        resolved=tuple(part for evaluation in several for part in evaluation.resolved)
        if all(evaluation.resolved for evaluation in several)
        else (),
    )


def in_a_row(series: Sequence[tuple[Array, Array]], gap: float) -> tuple[Array, Array]:
    """Instants (n,) s and errors (n,) of several recordings one behind the other, `gap` s between them."""
    instants, begin = [], 0.0
    for t, _ in series:
        if len(t):
            instants.append(t - t[0] + begin)
            begin = float(instants[-1][-1]) + gap
    return np.concatenate(instants or [np.empty(0)]), np.concatenate([error for _, error in series])


def root_mean(weighted: Iterable[tuple[float | None, int]]) -> float:
    """Root of the mean square of values with their numbers; NaN where there is none."""
    finite = [(value, count) for value, count in weighted if value is not None and count]
    count = sum(count for _, count in finite)
    return math.sqrt(sum(count * value**2 for value, count in finite) / count) if count else math.nan


def over_starts(several: Sequence[Evaluation], values: Sequence[float | None], horizon: float) -> float | None:
    """Rms of values over the start points of a horizon; None where there are none."""
    rms = root_mean(zip(values, (evaluation.coast_starts[horizon] for evaluation in several), strict=True))
    return None if math.isnan(rms) else rms


def pooled_floor(several: Sequence[Evaluation], readings: Sequence[int]) -> NoiseFloor | None:
    """The floor under the errors of several recordings, whose noises are independent; None where one has none."""
    floors = [evaluation.noise_floor for evaluation in several]
    present = [floor for floor in floors if floor is not None]
    if len(present) < len(floors):
        return None
    drift = {}
    for horizon in present[0].drift:
        drifts = [
            (floor.drift[horizon], evaluation.coast_starts[horizon])
            for floor, evaluation in zip(present, several, strict=True)
        ]
        drift[horizon] = pooled_rms([(estimate, count) for estimate, count in drifts if estimate is not None and count])
    simulated = pooled_rms([(floor.simulated, count) for floor, count in zip(present, readings, strict=True)])
    limits = [floor for floor in present if floor.sensor.is_limit]
    return NoiseFloor((limits or present)[0].sensor, drift, simulated or present[0].simulated)


def pooled_rms(several: Sequence[tuple[RmsInterval, int]]) -> RmsInterval | None:
    """Independent root mean squares with their weights as one; the deviations of the squares add in quadrature."""
    total = sum(count for _, count in several)
    if not total:
        return None
    shares = [(estimate, count / total) for estimate, count in several]
    square = sum(share * estimate.value**2 for estimate, share in shares)
    above = math.sqrt(sum((share * (estimate.high**2 - estimate.value**2)) ** 2 for estimate, share in shares))
    below = math.sqrt(sum((share * (estimate.value**2 - estimate.low**2)) ** 2 for estimate, share in shares))
    return RmsInterval(math.sqrt(square), math.sqrt(max(0.0, square - below)), math.sqrt(square + above))


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
    interval: tuple[float, float] | None = None
    """Of the second error given the first, where it is not from the scatter between stretches; the same unit."""

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
        if self.interval is not None and self.before > 0.0:
            return 50.0 * (self.interval[1] - self.interval[0]) / (TWO_SIDED * self.before)
        return 50.0 * self.after / self.before * self.ratio_std if self.before > 0.0 else math.inf

    @property
    def percent_interval(self) -> tuple[float, float]:
        """The 95 % interval of the rise in percent, Student's with the scatter between stretches.

        It is symmetric in the logarithm of the ratio, so that no error falls by more than all of it.
        """
        if self.interval is not None and self.before > 0.0:
            low, high = self.interval
            return 100.0 * (low / self.before - 1.0), 100.0 * (high / self.before - 1.0)
        if not (self.before > 0.0 and self.after > 0.0):
            return -100.0, math.inf
        reach = 0.5 * float(scipy.special.stdtrit(self.stretches - 1, 0.975)) * self.ratio_std
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
        columns = (
            np.concatenate([getattr(stretches, key) for stretches in several]) for key in ("number", "before", "after")
        )
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


def systematic_change(before: Sequence[Resolved], after: Sequence[Resolved]) -> HeldOutChange | None:
    """Change of the systematic error between two models of one table; None where it is not resolved.

    The difference of the mean squares is (e1 - e2)'(e1 + e2) in the directions, in which the difference of the models
    is one: the noise of both is the same, and its own power is not in it.
    """
    first, second = SystematicError.of(before), SystematicError.of(after)
    if first is None or second is None:
        return None
    n, rise, variance = sum(part.samples for part in before), 0.0, 0.0
    for former, later in zip(before, after, strict=True):
        apart = later.coordinates - former.coordinates
        rise += float(apart @ (former.coordinates + later.coordinates))
        variance += 4.0 * float(apart @ former.covariance @ apart)
    square, std = first.rms**2 + rise / n, math.sqrt(variance) / n
    ends = [math.sqrt(max(0.0, square + sign * TWO_SIDED * std)) for sign in (-1.0, 1.0)]
    # where little is left its own interval is the narrower one
    low, high = min(ends, [second.low, second.high], key=lambda span: span[1] - span[0])
    return HeldOutChange("systematic error", first.rms, second.rms, std, 0, "m/s²", math.inf, (low, high))


def expected_distance(before: Sequence[Resolved], after: Sequence[Resolved]) -> float:
    """Standard deviations at which a record would show the difference of two models of one table, if it were there."""
    apart = [later.coordinates - former.coordinates for former, later in zip(before, after, strict=True)]
    size = sum(float(x @ x) for x in apart)
    variance = sum(float(x @ part.covariance @ x) for x, part in zip(apart, before, strict=True))
    return size / math.sqrt(variance) if variance > 0.0 else 0.0


def heldout_change(before: Evaluation, after: Evaluation, horizon: float | None = None) -> HeldOutChange | None:
    """Change of the error from one comparison to another on the same data.

    Parameters
    ----------
    before, after : comparisons under one ruler.
    horizon : s; the drift after it. By default the systematic error where that surely changes, else the drift at the
        longest horizon for which the data hold enough independent windows.

    Returns
    -------
    The change of the drift; of the one-step error where no horizon is short enough; None where that is too short too.
    """
    systematic = None if horizon is not None else systematic_change(before.resolved, after.resolved)
    if systematic is not None and verdict_of(systematic) != "undecided":
        return systematic
    tried = (*sorted(before.drifts, reverse=True), None) if horizon is None else (horizon,)
    several = (paired_stretches(before, after, h) for h in tried)
    changes = (stretches.change() for stretches in several if stretches is not None)
    return next((change for change in changes if change is not None), None)


def drift_spread(evaluation: Evaluation, horizon: float | None) -> RmsInterval | None:
    """Rms drift with its 95 % interval over the start points; None for a simulation, or where there are too few.

    Mean squares of stretches of two horizons count as independent; the interval is that of their mean.
    """
    if horizon is None or horizon not in evaluation.drifts:
        return None
    t, error = evaluation.drifts[horizon]
    _, (means,) = stretch_means(t, HORIZONS_APART * horizon, error**2)
    count = len(means)
    middle = float(np.mean(error**2)) if count else 0.0
    if count < LEAST_STRETCHES or not middle > 0.0:
        return None
    reach = scipy.special.stdtrit(count - 1, 0.975) * float(np.std(means, ddof=1)) / math.sqrt(count) / middle
    value = math.sqrt(middle)
    return RmsInterval(value, value * math.exp(-0.5 * reach), value * math.exp(0.5 * reach))


def best_step(steps: Sequence[Evaluation]) -> tuple[int, HeldOutChange] | None:
    """The step with the least held-out error, and the rise from it to the last step.

    `steps` are comparisons under one ruler, in order; None where the last one is the best, or the data are too short.
    """
    rises = [(number, heldout_change(step, steps[-1])) for number, step in enumerate(steps[:-1])]
    rises_known = [(number, change) for number, change in rises if change is not None and change.before < change.after]
    return min(rises_known, key=lambda rise: rise[1].before, default=None)


DifferenceVerdict = Literal["better", "worse", "undecided", "too_short"]
"""Of a model against the first one: decided where the 95 % interval of the change does not hold 0."""


def verdict_of(change: HeldOutChange | None) -> DifferenceVerdict:
    """Whether the second model of a change is better."""
    if change is None:
        return "too_short"
    low, high = change.percent_interval
    return "better" if high < 0.0 else "worse" if low > 0.0 else "undecided"


@dataclass(frozen=True, slots=True)
class ModelDifference:
    """The error of one model against that of the first one, start point by start point."""

    name: str
    first: str
    """Names of the two models."""
    pooled: HeldOutChange | None
    """Over all recordings; None where they are too short for an interval."""
    recordings: tuple[HeldOutChange | None, ...]
    """One for each recording; None where that one is too short for an interval of its own."""
    horizons: tuple[HeldOutChange, ...]
    """Drifts over all recordings at every horizon with enough stretches, the shortest first: the verdict does not use
    them."""

    @property
    def verdict(self) -> DifferenceVerdict:
        """Over all recordings."""
        return verdict_of(self.pooled)

    @property
    def disagree(self) -> bool:
        """Whether the model is surely better on one recording and surely worse on another."""
        return {"better", "worse"} <= set(map(verdict_of, self.recordings))

    @property
    def sentence(self) -> str:
        """Whether the model is better, and by how much."""
        change, verdict = self.pooled, self.verdict
        unknown = f"whether {self.name} is better than {self.first} cannot be said: "
        if change is None:
            return f"{unknown}the recordings are too short for an interval"
        low, high = change.percent_interval
        based = f"paired over {change.stretches} stretches" if change.stretches else "paired, sample by sample"
        if verdict == "undecided":
            span = f"95 % interval {low:+.3g} to {high:+.3g} %"
            text = f"{unknown}{change.measure} {change.percent:+.3g} % ({span}), {based}"
        else:
            word, least, most = ("smaller", -high, -low) if verdict == "better" else ("larger", low, high)
            size = f"{abs(change.percent):.3g} % (95 % interval {least:.3g} to {most:.3g} %)"
            if low <= -100.0:  # nothing is left that noise would not give
                size = f"at least {least:.3g} % (95 %)"
            text = f"{self.name} is {verdict} than {self.first}: {change.measure} {word} by {size}, {based}"
        return f"{text}; the recordings disagree" if self.disagree else text


@immutable
@dataclass(frozen=True, slots=True)
class Comparison(Result):
    """Models against recordings, all under one ruler: errors, their changes, where the residual is largest.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 2e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=20.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fits = [ac.fit(simulated.recording), ac.fit(simulated.recording, ac.Model.cubic())]
    >>> comparison = ac.compare(fits, simulated.recording)
    >>> comparison.differences[0].verdict, comparison.errors[1] < comparison.errors[0]
    ('better', True)
    """

    derived: ClassVar[tuple[str, ...]] = ("differences",)

    fits: tuple[Fit, ...]
    names: tuple[str, ...]
    """Name of each model, no two alike."""
    recordings: tuple[str, ...]
    evaluations: tuple[tuple[Evaluation, ...], ...]
    """For each recording the evaluation of each model."""
    same_run: bool = False
    """A recording belongs to a fitted run: set-up and slow-drift errors cannot show."""

    def __repr__(self) -> str:
        return f"Comparison({', '.join(self.names)} on {', '.join(name or 'recording' for name in self.recordings)})"

    def __len__(self) -> int:
        return len(self.fits)

    def __getitem__(self, number: int) -> Evaluation:
        """Return the evaluation of one model over all recordings; its curves are those of the first."""
        return pooled([evaluations[number] for evaluations in self.evaluations])

    def __iter__(self) -> Iterator[Evaluation]:
        return (self[number] for number in range(len(self)))

    @checked
    def plot(
        self, figure: Literal[FigureName, "", "error_reduction"] = "", *, theme: Literal["light", "dark"] = "light"
    ) -> Figure:
        """Draw one figure: by default the errors of several models, or one model over what was measured.

        Parameters
        ----------
        figure : "error_reduction", or a figure of the last model on the first recording; "overlay" shows all models.
        theme : "light" or "dark".

        Raises
        ------
        MissingExtra
            If matplotlib is not installed.
        ValueError
            If there is no such figure.
        """
        name = figure or ("error_reduction" if len(self) > 1 else "overlay")
        if name == "error_reduction":
            drawn: Figure = face("plots").error_reduction(self, theme=theme)
        elif name == "overlay" and len(self) > 1:
            drawn = face("plots").overlay(list(zip(self.names, self.evaluations[0], strict=True)), theme=theme)
        else:
            drawn = self.evaluations[0][-1].plot(name, theme=theme)
        return drawn

    @property
    def ruler(self) -> Ruler:
        """The filter that all evaluations share."""
        return Ruler.of(self.fits)

    @property
    def paired_horizon(self) -> float | None:
        """Longest horizon, s, at which every recording has enough stretches, or all together; None: one-step errors."""
        counts = {
            h: [stretch_count(evaluations[0], h) for evaluations in self.evaluations]
            for h in self.evaluations[0][0].drifts
        }
        alone = [h for h, stretches in counts.items() if min(stretches) >= LEAST_STRETCHES]
        together = [h for h, stretches in counts.items() if sum(stretches) >= LEAST_STRETCHES]
        return max(alone, default=max(together, default=None))

    @property
    def differences(self) -> tuple[ModelDifference, ...]:
        """Changes of the error from the first model to each other one."""
        return tuple(self._difference(k) for k in range(1, len(self.fits)))

    def _difference(self, k: int) -> ModelDifference:
        several = self._stretches(k, self.paired_horizon)
        alone = [systematic_change(row[0].resolved, row[k].resolved) for row in self.evaluations]
        together = systematic_change(self[0].resolved, self[k].resolved)
        if together is None or verdict_of(together) == "undecided":  # a recording may be too short for it
            together, alone = None, [None for _ in alone]
        every = [change_over(self._stretches(k, h)) for h in sorted(self.evaluations[0][0].drifts)]
        return ModelDifference(
            self.names[k],
            self.names[0],
            together or change_over(several),
            tuple(
                by_row or (None if stretches is None else stretches.change())
                for by_row, stretches in zip(alone, several, strict=True)
            ),
            tuple(change for change in every if change is not None),
        )

    def _stretches(self, k: int, horizon: float | None) -> list[PairedStretches | None]:
        """Errors of one model and of the first, for each recording."""
        return [paired_stretches(evaluations[0], evaluations[k], horizon) for evaluations in self.evaluations]

    @property
    def headline(self) -> Measure:
        """The error that is quoted."""
        return Measure.of([evaluation for evaluations in self.evaluations for evaluation in evaluations])

    @property
    def errors(self) -> tuple[float, ...]:
        """Rms error of each model over all recordings, in the unit of `headline`; below its limit of detection the
        bound."""
        return tuple(map(self.headline.error, self))

    @property
    def intervals(self) -> tuple[RmsInterval | None, ...]:
        """Each error with its interval; None where there are too few start points."""
        return tuple(map(self.headline.interval, self))

    @property
    def noise_floor(self) -> NoiseFloor:
        """Drifts that noise of the sensor alone would give in the last model."""
        floor = self[len(self) - 1].noise_floor
        if floor is None:
            raise AccelcalError("the models were evaluated without a noise floor; accelcal.compare draws one for all")
        return floor

    @property
    def floor(self) -> RmsInterval:
        """Error by noise alone in place of `errors`, with the interval for records of this length."""
        return self.headline.floor(self[len(self) - 1]) or self.noise_floor.simulated

    @property
    def shares(self) -> tuple[float | None, ...]:
        """Share of the first model's mean square above noise that each step removes; None for the first model, or when
        noise alone may give an error as large as its error."""
        headline, intervals = self.headline, self.intervals
        squares, floor = [error**2 for error in self.errors], self.floor
        above = squares[0] - floor.value**2
        if headline.band is not None:
            squares = [0.0 if interval is None else interval.value**2 for interval in intervals]
            above = squares[0]
        limited = headline.band is None and self.noise_floor.sensor.is_limit
        if limited or not self.errors[0] > floor.high or self.at_floor[0]:
            return (None,) * len(squares)
        return (None, *((before - after) / above for before, after in itertools.pairwise(squares)))

    @property
    def at_floor(self) -> tuple[bool, ...]:
        """Whether noise alone may give the error of each model; never where only an upper limit of it is known."""
        if self.headline.band is not None:
            return tuple(interval is not None and interval.low == 0.0 for interval in self.intervals)
        resolved, high = not self.noise_floor.sensor.is_limit, self.floor.high
        return tuple(resolved and error <= high for error in self.errors)


def change_over(several: Sequence[PairedStretches | None]) -> HeldOutChange | None:
    """Change over all recordings; None where they hold too few stretches together."""
    changes = [change for change in several if change is not None]
    return PairedStretches.joined(changes).change() if changes else None


def names_of(fits: Sequence[Fit]) -> tuple[str, ...]:
    """Effects of each model beyond the base, with a number where two models have the same ones."""
    names = [" + ".join(("base", *fit.model.added)) for fit in fits]
    if len(set(names)) == len(names):
        return tuple(names)
    return tuple(f"model {number} ({name})" for number, name in enumerate(names, start=1))
