"""The falling error of one model: its effects taken away and put back one by one, each fit judged on unseen data."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from accelcal.data.recording import Recording
from accelcal.diagnosis.change_points import usable
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import find
from accelcal.estimation.estimate import Fit, fit
from accelcal.model import Model
from accelcal.validation.comparison import HELD_OUT, Comparison
from accelcal.validation.evaluation import compare


@dataclass(frozen=True, slots=True)
class NestedModel:
    """One model on the way."""

    effect: str
    """What is new here; empty for the base."""
    in_model: bool
    """False for an effect that the model lacks and that the record asks for."""
    fit: Fit
    heldout: Comparison


@dataclass(frozen=True, slots=True)
class NestedModels:
    """Models of growing size on data that none of them was fitted to."""

    models: tuple[NestedModel, ...]
    """The base first."""
    same_run: bool
    """Unseen data are the end of the fitted run: set-up and slow-drift errors cannot show."""
    horizon: float | None
    """Time without position after which the drift is compared, s; None where the unseen data are too short for any."""
    remarks: tuple[str, ...] = ()
    """What could not be fitted, and why."""

    @property
    def errors(self) -> tuple[float, ...]:
        """Rms unaided drift (or free-running error) of each model, m."""
        return tuple(_error(member.heldout, self.horizon) for member in self.models)

    @property
    def floor(self) -> float:
        """What noise alone would give, m: the least of all models, for what is missing passes for noise."""
        return min(_floor(member.heldout, self.horizon) for member in self.models)

    @property
    def shares(self) -> tuple[float | None, ...]:
        """Share of the base's mean square above the floor that each member takes away; None for the base, or when the
        base is at the floor already."""
        squares = [e**2 for e in self.errors]
        above = squares[0] - self.floor**2
        if above <= 0.0:
            return (None,) * len(squares)
        return (None, *((before - after) / above for before, after in itertools.pairwise(squares)))

    @property
    def measure(self) -> str:
        """What is compared, in words."""
        if self.horizon is None:
            return "free-running error"
        return f"unaided drift after {self.horizon:g} s"


def nested_models(
    fitted: Fit, recording: Recording, diagnosis: Diagnosis | None = None, *, holdout: Recording | None = None
) -> NestedModels:
    """Fit the base of a model, then one effect more each time, and compare each with unseen data.

    Parameters
    ----------
    fitted : the model at the top; with `holdout` it stands there as it is.
    recording : what the other models are fitted to.
    diagnosis : of `fitted` on `recording`; effects it found stand above the model.
    holdout : unseen recording; by default the last 30 % of `recording`, which then is fitted without them.

    Raises
    ------
    NotIdentifiable
        If the record does not determine even the base.
    """
    begin, finish = diagnosis.used[0] if diagnosis is not None else _stretch(recording)
    same_run = holdout is None
    split = finish - HELD_OUT * (finish - begin) if same_run else finish
    unseen = recording if holdout is None else holdout
    test_begin, test_end = (split, finish) if holdout is None else _stretch(holdout)

    def member(effect: str, model: Model, in_model: bool, ready: Fit | None = None) -> NestedModel:
        found = ready
        if found is None:
            found = fit(model, recording, start=begin, end=split, origins=fitted.origins)
        return NestedModel(effect, in_model, found, compare(found, unseen, start=test_begin, end=test_end))

    # What turning the sensor or the tolerance of a low-pass brought in depends on the recordings, not on the model.
    brought = [name for name in fitted.model.added if not find(name).traits.visible]
    whole = fitted.model.drop(*brought)
    added = whole.added
    models, remarks = [], []
    for count in range(len(added) + 1):
        model = whole.drop(*added[count:])
        top = fitted if count == len(added) and not same_run else None
        try:
            models.append(member(added[count - 1] if count else "", model, True, top))
        except ValueError as error:
            if count == 0:
                raise
            remarks.append(f"without {', '.join(added[count:])} the model cannot be fitted here: {error}")
    model = whole
    for finding in diagnosis.scan.found if diagnosis is not None else ():
        try:
            model = finding.enter(model)
            models.append(member(finding.effect, model, False))
        except ValueError as error:
            remarks.append(f"{finding.effect} could not be added: {error}")
            break
    horizons = [h for h in models[0].heldout.coast_rms if all(r.heldout.coast_rms[h] is not None for r in models)]
    return NestedModels(tuple(models), same_run, max(horizons, default=None), tuple(remarks))


def _stretch(recording: Recording) -> tuple[float, float]:
    found = usable(recording)
    return found.start, found.end


def _error(seen: Comparison, horizon: float | None) -> float:
    value = seen.simulated_rms if horizon is None else seen.coast_rms[horizon]
    return math.nan if value is None else value


def _floor(seen: Comparison, horizon: float | None) -> float:
    value = float(np.sqrt(np.mean(seen.simulated_std**2))) if horizon is None else seen.coast_floor[horizon]
    return math.nan if value is None else value
