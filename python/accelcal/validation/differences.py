"""Models on the same recordings: the error of each, and how it differs from the error of the first model."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from accelcal._support.errors import AccelcalError
from accelcal._support.result import Result
from accelcal._support.values import face, immutable
from accelcal.estimation.estimate import Fit
from accelcal.validation.comparison import Evaluation, FigureName, NoiseFloor, RmsInterval
from accelcal.validation.paired import HeldOutChange, PairedStretches, drift_spread, paired_stretches
from accelcal.validation.pooled import pooled
from accelcal.validation.ruler import Ruler
from accelcal.validation.stretches import LEAST_STRETCHES, headline_horizon, quoted_error, stretch_count

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
        based = f"paired over {change.stretches} stretches"
        if verdict == "undecided":
            span = f"95 % interval {low:+.3g} to {high:+.3g} %"
            text = f"{unknown}{change.measure} {change.percent:+.3g} % ({span}), {based}"
        else:
            word, least, most = ("smaller", -high, -low) if verdict == "better" else ("larger", low, high)
            text = (
                f"{self.name} is {verdict} than {self.first}: {change.measure} {word} by {abs(change.percent):.3g} % "
                f"(95 % interval {least:.3g} to {most:.3g} %), {based}"
            )
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
    >>> made = ac.simulate("interleaved", seconds=20.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fits = [ac.fit(made.recording), ac.fit(made.recording, ac.Model.cubic())]
    >>> comparison = ac.compare(fits, made.recording)
    >>> comparison.differences[0].verdict, comparison.errors[1] < comparison.errors[0]
    ('better', True)
    """

    derived: ClassVar[tuple[str, ...]] = ("differences",)

    fits: tuple[Fit, ...]
    names: tuple[str, ...]
    """Name of each model, no two alike."""
    recordings: tuple[str, ...]
    seen: tuple[tuple[Evaluation, ...], ...]
    """For each recording the evaluation of each model."""
    same_run: bool = False
    """A recording belongs to a fitted run: set-up and slow-drift errors cannot show."""

    def __repr__(self) -> str:
        return f"Comparison({', '.join(self.names)} on {', '.join(name or 'recording' for name in self.recordings)})"

    def __len__(self) -> int:
        return len(self.fits)

    def __getitem__(self, number: int) -> Evaluation:
        """Return the evaluation of one model over all recordings; its curves are those of the first."""
        return pooled([each[number] for each in self.seen])

    def __iter__(self) -> Iterator[Evaluation]:
        return (self[number] for number in range(len(self)))

    def plot(
        self, figure: FigureName | Literal["", "error_reduction"] = "", *, theme: Literal["light", "dark"] = "light"
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
            drawn = face("plots").overlay(list(zip(self.names, self.seen[0], strict=True)), theme=theme)
        else:
            drawn = self.seen[0][-1].plot(name, theme=theme)
        return drawn

    @property
    def ruler(self) -> Ruler:
        """The filter that all evaluations share."""
        return Ruler.of(self.fits)

    @property
    def paired_horizon(self) -> float | None:
        """Longest horizon, s, at which every recording has enough stretches, or all together; None: one-step errors."""
        counts = {h: [stretch_count(each[0], h) for each in self.seen] for h in self.seen[0][0].drifts}
        alone = [h for h, stretches in counts.items() if min(stretches) >= LEAST_STRETCHES]
        together = [h for h, stretches in counts.items() if sum(stretches) >= LEAST_STRETCHES]
        return max(alone, default=max(together, default=None))

    @property
    def differences(self) -> tuple[ModelDifference, ...]:
        """Changes of the error from the first model to each other one."""
        return tuple(self._difference(k) for k in range(1, len(self.fits)))

    def _difference(self, k: int) -> ModelDifference:
        several = self._stretches(k, self.paired_horizon)
        every = [change_over(self._stretches(k, h)) for h in sorted(self.seen[0][0].drifts)]
        return ModelDifference(
            self.names[k],
            self.names[0],
            change_over(several),
            tuple(None if each is None else each.change() for each in several),
            tuple(change for change in every if change is not None),
        )

    def _stretches(self, k: int, horizon: float | None) -> list[PairedStretches | None]:
        """Errors of one model and of the first, for each recording."""
        return [paired_stretches(each[0], each[k], horizon) for each in self.seen]

    @property
    def horizon(self) -> float | None:
        """Time without position, s, after which the drift is quoted; None: too short, the free-running error is."""
        return headline_horizon(*(evaluation for each in self.seen for evaluation in each))

    @property
    def measure(self) -> str:
        """Name of the error that is quoted."""
        return "free-running error" if self.horizon is None else f"unaided drift after {self.horizon:g} s"

    @property
    def errors(self) -> tuple[float, ...]:
        """Rms unaided drift (or free-running error) of each model over all recordings, m."""
        horizon = self.horizon
        return tuple(quoted_error(evaluation, horizon) for evaluation in self)

    @property
    def intervals(self) -> tuple[RmsInterval | None, ...]:
        """Each error with its interval over the start points, m; None where there are too few."""
        horizon = self.horizon
        return tuple(drift_spread(evaluation, horizon) for evaluation in self)

    @property
    def noise_floor(self) -> NoiseFloor:
        """Errors that noise of the sensor alone would give: one floor for all models."""
        floor = self[0].noise_floor
        if floor is None:
            raise AccelcalError("the models were evaluated without a noise floor; accelcal.compare draws one for all")
        return floor

    @property
    def floor(self) -> RmsInterval:
        """The floor under `errors`, with the interval for records of this length, m."""
        return self.noise_floor.at(self.horizon) or self.noise_floor.simulated

    @property
    def shares(self) -> tuple[float | None, ...]:
        """Share of the first model's mean square above the floor that each step removes; None for the first model, or
        when noise alone may give an error as large as its error."""
        squares, floor = [error**2 for error in self.errors], self.floor
        if self.noise_floor.sensor.is_limit or not self.errors[0] > floor.high:
            return (None,) * len(squares)
        above = squares[0] - floor.value**2
        return (None, *((before - after) / above for before, after in itertools.pairwise(squares)))

    @property
    def at_floor(self) -> tuple[bool, ...]:
        """Whether noise alone may give the error of each model; never where only an upper limit of it is known."""
        known, high = not self.noise_floor.sensor.is_limit, self.floor.high
        return tuple(known and error <= high for error in self.errors)


def change_over(several: Sequence[PairedStretches | None]) -> HeldOutChange | None:
    """Change over all recordings; None where they hold too few stretches together."""
    known = [each for each in several if each is not None]
    return PairedStretches.joined(known).change() if known else None


def names_of(fits: Sequence[Fit]) -> tuple[str, ...]:
    """Effects of each model beyond the base, with a number where two models have the same ones."""
    names = [" + ".join(("base", *fit.model.added)) for fit in fits]
    if len(set(names)) == len(names):
        return tuple(names)
    return tuple(f"model {number} ({name})" for number, name in enumerate(names, start=1))
