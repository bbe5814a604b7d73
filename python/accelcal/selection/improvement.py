"""Results of improving a model: its steps, and the error reduction of several models."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from accelcal._support.notebook_repr import notebook_repr
from accelcal.diagnosis.contribution import Importance, split
from accelcal.diagnosis.verdict import Confounded, Diagnosis
from accelcal.estimation.estimate import Fit
from accelcal.validation.comparison import Comparison


@dataclass(frozen=True, slots=True)
class Step:
    """One model of the selection, on the data it was fitted to and on held-out data."""

    effects: tuple[str, ...]
    fit: Fit
    train: Comparison
    heldout: Comparison


@notebook_repr
@dataclass(frozen=True, slots=True)
class Improvement:
    """The error reduction: every step, and what the last model still lacks."""

    steps: tuple[Step, ...]
    diagnosis: Diagnosis
    """Of the last model."""
    classes: tuple[Confounded, ...]
    """One for each effect that was added."""
    examined: int
    same_run: bool
    """Held-out data are the end of the fitted run: set-up and slow-drift errors cannot show."""

    def __repr__(self) -> str:
        return f"Improvement({' + '.join(('base', *self.effects))}; {self.diagnosis.sentence})"

    @property
    def importance(self) -> Importance | None:
        """Which effects matter under the declared tolerance; None where none is declared."""
        return split(self.effects, self.diagnosis.sizes, self.diagnosis.fit.rig.tolerance)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names in the order added."""
        return self.steps[-1].effects


@notebook_repr
@dataclass(frozen=True, slots=True)
class History:
    """Models in the order of their selection, each compared with one recording: the error reduction."""

    fits: tuple[Fit, ...]
    steps: tuple[Comparison, ...]
    """One for each fit."""

    def __repr__(self) -> str:
        each = (
            f"{name}: {comparison.simulated_rms:.3g} m" for name, comparison in zip(self.names, self.steps, strict=True)
        )
        return f"History(rms free-running error of {', '.join(each)})"

    def __len__(self) -> int:
        return len(self.steps)

    def __iter__(self) -> Iterator[Comparison]:
        return iter(self.steps)

    def __getitem__(self, index: int) -> Comparison:
        return self.steps[index]

    @property
    def names(self) -> tuple[str, ...]:
        """Effects of each model beyond the base, as in "base + cubic"."""
        return tuple(" + ".join(("base", *fit.model.added)) for fit in self.fits)
