"""Several models on the same recordings: how the error of each differs from that of the first, with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from accelcal._support.immutable import immutable
from accelcal._support.result import Result
from accelcal.estimation.estimate import Fit
from accelcal.validation.comparison import Comparison
from accelcal.validation.paired import HeldOutChange, PairedStretches, paired_stretches
from accelcal.validation.ruler import Ruler
from accelcal.validation.stretches import LEAST_STRETCHES, stretch_count

if TYPE_CHECKING:
    pass

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
class PairedComparison(Result):
    """Several models on the same recordings, and the difference of their errors.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 2e-3}
    >>> rng = np.random.default_rng(1)
    >>> made = ac.simulate("interleaved", seconds=20.0, rig=ac.CXL02_RIG, parameters=truth, rng=rng)
    >>> fits = [ac.fit(ac.Model.linear(), made.recording), ac.fit(ac.Model.cubic(), made.recording)]
    >>> ac.compare_paired(fits, made.recording).differences[0].verdict
    'better'
    """

    derived: ClassVar[tuple[str, ...]] = ("differences",)

    fits: tuple[Fit, ...]
    names: tuple[str, ...]
    """Of the models, each another."""
    recordings: tuple[str, ...]
    seen: tuple[tuple[Comparison, ...], ...]
    """For each recording one comparison for each model, all under one ruler."""
    horizon: float | None
    """Time without position after which drifts are compared, s; None: one-step errors, as the recordings are short."""

    def __repr__(self) -> str:
        return f"PairedComparison({'; '.join(each.sentence for each in self.differences)})"

    @property
    def ruler(self) -> Ruler:
        """The filter that all comparisons share."""
        return Ruler.of(self.fits)

    @property
    def differences(self) -> tuple[ModelDifference, ...]:
        """Of every model but the first against the first."""
        return tuple(self._difference(k) for k in range(1, len(self.fits)))

    def _difference(self, k: int) -> ModelDifference:
        several = self._stretches(k, self.horizon)
        every = [pooled(self._stretches(k, h)) for h in sorted(self.seen[0][0].drifts)]
        return ModelDifference(
            self.names[k],
            self.names[0],
            pooled(several),
            tuple(None if each is None else each.change() for each in several),
            tuple(change for change in every if change is not None),
        )

    def _stretches(self, k: int, horizon: float | None) -> list[PairedStretches | None]:
        """Errors of one model and of the first, for each recording."""
        return [paired_stretches(each[0], each[k], horizon) for each in self.seen]


def pooled(several: Sequence[PairedStretches | None]) -> HeldOutChange | None:
    """Change over all recordings; None where they hold too few stretches together."""
    known = [each for each in several if each is not None]
    return PairedStretches.joined(known).change() if known else None


def names_of(fits: Sequence[Fit]) -> tuple[str, ...]:
    """Effects of each model beyond the base, with a number where two models have the same ones."""
    names = [" + ".join(("base", *fit.model.added)) for fit in fits]
    if len(set(names)) == len(names):
        return tuple(names)
    return tuple(f"model {number} ({name})" for number, name in enumerate(names, start=1))


def paired_horizon(seen: Sequence[Sequence[Comparison]]) -> float | None:
    """The longest horizon at which every recording has enough stretches, or all recordings together; None without one.

    Parameters
    ----------
    seen : for each recording the comparisons of all models.
    """
    counts = {h: [stretch_count(each[0], h) for each in seen] for h in seen[0][0].drifts}
    each = [h for h, found in counts.items() if min(found) >= LEAST_STRETCHES]
    together = [h for h, found in counts.items() if sum(found) >= LEAST_STRETCHES]
    return max(each, default=max(together, default=None))
