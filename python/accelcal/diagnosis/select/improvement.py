"""Improvement: the steps of a model, what the last still lacks, and nested models compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

from accelcal._support.result import Result
from accelcal._support.values import immutable, listing
from accelcal.diagnosis.findings import Confounded, Finding, Importance, in_model, in_noise, split, with_findings
from accelcal.diagnosis.policy import CONTRADICTED_D, CONTRADICTED_SIGMA
from accelcal.diagnosis.search.confounding import DetectedEffect
from accelcal.diagnosis.search.scan import Verdict
from accelcal.diagnosis.select.cross_validation import belongs_to_its_time
from accelcal.diagnosis.verdict import Case, Diagnosis, judgement
from accelcal.effects import find, spelled
from accelcal.estimation.estimate import Fit, result, solve_runs
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import Source
from accelcal.model import Model
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import HeldOutChange, expected_distance, heldout_change, systematic_change


@immutable
@dataclass(frozen=True, slots=True)
class Step:
    """One model of the selection, on the data it was fitted to and on held-out data."""

    effects: tuple[str, ...]
    fit: Fit
    train: Evaluation
    heldout: Evaluation

    def __repr__(self) -> str:
        return f"Step({' + '.join(('base', *self.effects))}: {self.heldout!r})"


@immutable
@dataclass(frozen=True, slots=True)
class Improvement(Result):
    """The error reduction: every step, and what the last model still lacks.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> improvement = ac.improve(simulated.recording, most=1)
    >>> improvement.best["cubic"].std > 0.0
    True
    """

    derived: ClassVar[tuple[str, ...]] = ("verdict", "sentence", "effects", "detected", "left", "importance", "changes")

    steps: tuple[Step, ...]
    best: Fit
    """The last model, which has every effect that was found, fitted to all but a recording that is held out."""
    diagnosis: Diagnosis
    """Of the last model, before the effects on its noise entered it."""
    classes: tuple[Confounded, ...]
    """One for each effect that was added."""
    examined: int
    same_run: bool
    """Held-out data are the end of the fitted run: set-up and slow-drift errors cannot show."""

    def __repr__(self) -> str:
        return f"Improvement({' + '.join(('base', *self.effects))}; {self.sentence})"

    @property
    def detected(self) -> tuple[Finding, ...]:
        """Every effect that was found, in the order added."""
        last, groups = self.diagnosis, {group.effect: group for group in self.classes}
        in_the_model = {"time_offset", *last.fit.model.effects}
        return tuple(
            in_model(last.fit, groups[name], last.sizes)
            if name in in_the_model
            else in_noise(last.channels, groups[name], last.sizes)
            for name in self.effects
        )

    @property
    def verdict(self) -> Verdict:
        """On the recording as a whole: what was found counts; `left` is on the last model alone."""
        if self.left[0] in ("unexplained", "too_short") or not self.effects:
            return self.left[0]
        if any(find(name).family for name in self.effects):
            return "shape"
        return "tied" if any(len(group.members) > 1 for group in self.classes) else "named"

    @property
    def left(self) -> tuple[Verdict, str]:
        """The verdict on what the last model lacks, and the sentence on it; what was found in its noise is not
        missing."""
        last = self.diagnosis
        if last.verdict not in ("named", "tied") or last.scan.detected or not last.channels:
            return last.verdict, last.left
        tests = [test for test in last.channels if test.effect not in self.effects]
        return judgement(Case(last.fit, last.scan, tests, last.unnamed, last.classes, last.remarks))

    @property
    def sentence(self) -> str:
        """What was found, then what is left, and the best step where the last one is worse on held-out data."""
        text = with_findings(self.detected, self.left[1], self.diagnosis.fit.rig.tolerance)
        rises = [remark.sentence for remark in self.diagnosis.remarks if remark.code == "heldout_rises"]
        return " ".join([text, *(f"{sentence}." for sentence in rises)])

    @property
    def changes(self) -> tuple[HeldOutChange | None, ...]:
        """Paired change of the held-out error from each step to the next; None where the data are too short for one."""
        return tuple(heldout_change(step.heldout, other.heldout) for step, other in pairwise(self.steps))

    @property
    def importance(self) -> Importance | None:
        """Which effects matter under the declared tolerance; None where none is declared."""
        return split(self.effects, self.diagnosis.sizes, self.diagnosis.fit.rig.tolerance)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names in the order added."""
        return self.steps[-1].effects


def contradicted(steps: Sequence[Step]) -> Remark | None:
    """The remark on the first effect that the held-out record contradicts; None where it contradicts none.

    It does where it would show the effect and its systematic error rises with it; a true effect lets that fall. It says
    nothing of what belongs to the time of one record. An effect that a later step replaced is none of the last model.
    """
    last = steps[-1].fit.model.added
    for before, after in pairwise(steps):
        change = systematic_change(before.heldout.resolved, after.heldout.resolved)
        if change is None or change.sigma <= CONTRADICTED_SIGMA or not {*before.effects} <= {*after.effects}:
            continue
        estimated = {term.effect.name for term in after.fit.model.free}
        entered = [name for name in after.fit.model.added if name not in before.fit.model.added and name in last]
        entered = [name for name in entered if name in estimated and not belongs_to_its_time(find(name))]
        d = expected_distance(before.heldout.resolved, after.heldout.resolved)
        if entered and d >= CONTRADICTED_D:
            return remark("contradicted", effect=entered[0], d=d, percent=change.percent, sigma=change.sigma)
    return None


@dataclass(frozen=True, slots=True)
class NestedFits:
    """Fits of growing size."""

    fits: tuple[Fit, ...]
    """Base first."""
    names: tuple[str, ...]
    """The base, then the effect that is new, or the finer form of a curve."""
    lacking: int
    """Number of fits at the end with effects that the model itself lacks."""
    remarks: tuple[Remark, ...]
    """Models that could not be fitted, and why."""


def nested_fits(
    fitted: Fit,
    sources: Sequence[Source],
    detected: Sequence[DetectedEffect] = (),
    *,
    start: float | None = None,
    end: float | None = None,
    refit: bool = False,
) -> NestedFits:
    """Fit the base of a model, then one more effect at a time.

    Parameters
    ----------
    fitted : the largest model.
    sources : one or several recordings that the models are fitted to.
    detected : effects that the model lacks; they are added behind its own.
    start, end : s, optional; only this part is used.
    refit : whether the largest model is fitted again, too: to a part of its recordings.

    Raises
    ------
    NotIdentifiable
        If the recordings do not determine even the base.
    """

    fits, names, remarks, lacking = list[Fit](), list[str](), list[Remark](), 0

    def enter(effect: str, model: Model) -> None:
        if model is not whole or refit:
            engine = fitted.engine
            solution = solve_runs(model, sources, start=start, end=end, origins=fitted.origins, engine=engine)
            fits.append(result(solution))
        else:
            fits.append(fitted)
        name = f"+ {spelled(effect)}" if effect else "base"
        names.append(f"{name}, finer" if name in names else name)

    # Effects that a turned sensor or the tolerance of a low-pass added depend on the recordings, not on the model.
    set_by_recordings = [name for name in fitted.model.added if not find(name).traits.visible]
    model = whole = fitted.model.drop(*set_by_recordings)
    added = model.added
    for count in range(len(added) + 1):
        try:
            enter(added[count - 1] if count else "", model.drop(*added[count:]) if count < len(added) else model)
        except ValueError as error:
            if count == 0:
                raise
            text = f"without {', '.join(added[count:])} the model cannot be fitted here: {error}"
            remarks.append(remark("not_fitted", text=text))
    for finding in detected:
        try:
            model = finding.enter(model)
            enter(finding.effect, model)
            lacking += 1
        except ValueError as error:
            remarks.append(remark("not_fitted", text=f"{finding.effect} could not be added: {error}"))
            break
    return NestedFits(tuple(fits), tuple(names), lacking, tuple(remarks))


__dir__ = listing(globals())
