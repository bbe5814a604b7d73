"""Nested models: effects of one model removed and added again one by one, each fit compared on held-out data."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

from accelcal._support.listing import listing
from accelcal.data.recording import Recording
from accelcal.diagnosis.change_points import usable
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import find
from accelcal.estimation.estimate import Fit, engine_of, estimate
from accelcal.model import Model
from accelcal.validation.comparison import HELD_OUT, Comparison, NoiseFloor, RmsInterval
from accelcal.validation.evaluation import compare
from accelcal.validation.noise_floor import noise_floor
from accelcal.validation.paired import drift_spread
from accelcal.validation.ruler import Ruler
from accelcal.validation.stretches import headline_horizon, quoted_error


@dataclass(frozen=True, slots=True)
class NestedModel:
    """One model of the series."""

    effect: str
    """Effect that is new here; empty for the base."""
    in_model: bool
    """False for an effect that the model lacks and that the record requires."""
    fit: Fit
    heldout: Comparison


@dataclass(frozen=True, slots=True)
class NestedModels:
    """Models of growing size on data to which none of them was fitted."""

    models: tuple[NestedModel, ...]
    """Base first."""
    same_run: bool
    """Held-out data are a part of the fitted run: set-up and slow-drift errors cannot show."""
    horizon: float | None
    """Time without position after which drifts are compared, s: the longest with an interval, see `headline_horizon`;
    None where the held-out data are too short for any."""
    remarks: tuple[str, ...] = ()
    """Models that could not be fitted, and why."""

    @property
    def errors(self) -> tuple[float, ...]:
        """Rms unaided drift (or free-running error) of each model, m."""
        return tuple(quoted_error(member.heldout, self.horizon) for member in self.models)

    @property
    def noise_floor(self) -> NoiseFloor:
        """Errors that noise of the sensor alone would give: one floor for all models."""
        found = self.models[0].heldout.noise_floor
        if found is None:
            raise ValueError("models were compared without a noise floor; use nested_models or compare_models")
        return found

    @property
    def floor(self) -> RmsInterval:
        """The floor under `errors`, with the interval for a record of this length, m."""
        return self.noise_floor.at(self.horizon) or self.noise_floor.simulated

    @property
    def intervals(self) -> tuple[RmsInterval | None, ...]:
        """Each error with its interval over the start points, m; None where there are too few."""
        return tuple(drift_spread(member.heldout, self.horizon) for member in self.models)

    @property
    def shares(self) -> tuple[float | None, ...]:
        """Share of the base's mean square above the floor that each model removes; None for the base, or when noise
        alone may give an error as large as that of the base."""
        squares = [e**2 for e in self.errors]
        if self.noise_floor.sensor.is_limit or not self.errors[0] > self.floor.high:
            return (None,) * len(squares)
        above = squares[0] - self.floor.value**2
        return (None, *((before - after) / above for before, after in itertools.pairwise(squares)))

    @property
    def at_floor(self) -> tuple[bool, ...]:
        """Whether noise alone may give the error of each model; never where only an upper limit of it is known."""
        known = not self.noise_floor.sensor.is_limit
        return tuple(known and error <= self.floor.high for error in self.errors)

    @property
    def measure(self) -> str:
        """Name of the error that is compared."""
        if self.horizon is None:
            return "free-running error"
        return f"unaided drift after {self.horizon:g} s"


def nested_models(
    fitted: Fit, recording: Recording, diagnosis: Diagnosis | None = None, *, holdout: Recording | None = None
) -> NestedModels:
    """Fit the base of a model, then one more effect at a time, and compare each with held-out data.

    Parameters
    ----------
    fitted : the largest model; with `holdout` it is used as it is.
    recording : what the other models are fitted to.
    diagnosis : of `fitted` on `recording`; effects it found are added to the model.
    holdout : unseen recording; by default the last 30 % of `recording`, which then is fitted without them.

    Raises
    ------
    NotIdentifiable
        If the record does not determine even the base.
    """
    begin, finish = diagnosis.used[0] if diagnosis is not None else _stretch(recording)
    split = finish - HELD_OUT * (finish - begin) if holdout is None else finish
    unseen = recording if holdout is None else holdout
    test_begin, test_end = (split, finish) if holdout is None else _stretch(holdout)

    def member(effect: str, model: Model, in_model: bool, ready: Fit | None = None) -> tuple[str, bool, Fit]:
        found = ready
        if found is None:
            found = estimate(model, recording, start=begin, end=split, origins=fitted.origins, method=engine_of(fitted))
        return effect, in_model, found

    # Effects that a turned sensor or the tolerance of a low-pass added depend on the recordings, not on the model.
    set_by_recordings = [name for name in fitted.model.added if not find(name).traits.visible]
    whole = fitted.model.drop(*set_by_recordings)
    added = whole.added
    fits, remarks = [], []
    for count in range(len(added) + 1):
        model = whole.drop(*added[count:])
        ready_fit = fitted if count == len(added) and holdout is not None else None
        try:
            fits.append(member(added[count - 1] if count else "", model, True, ready_fit))
        except ValueError as error:
            if count == 0:
                raise
            remarks.append(f"without {', '.join(added[count:])} the model cannot be fitted here: {error}")
    model = whole
    for finding in diagnosis.scan.found if diagnosis is not None else ():
        try:
            model = finding.enter(model)
            fits.append(member(finding.effect, model, False))
        except ValueError as error:
            remarks.append(f"{finding.effect} could not be added: {error}")
            break
    ruler = Ruler.of([fit for _, _, fit in fits])
    floor = noise_floor(ruler, fits[0][2], unseen, start=test_begin, end=test_end)

    def judged(fit: Fit) -> Comparison:
        return replace(compare(fit, unseen, start=test_begin, end=test_end, ruler=ruler), noise_floor=floor)

    sessions = {recording.session, *(run.session for run in fitted.runs)}
    same_run = holdout is None or (bool(holdout.session) and holdout.session in sessions)
    models = [NestedModel(effect, in_model, fit, judged(fit)) for effect, in_model, fit in fits]
    return NestedModels(tuple(models), same_run, headline_horizon(*(each.heldout for each in models)), tuple(remarks))


def _stretch(recording: Recording) -> tuple[float, float]:
    found = usable(recording)
    return found.start, found.end


__dir__ = listing(globals())
