"""Nested models: the base of a model, then one more effect at a time, each fitted to the same recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from accelcal._support.values import listing
from accelcal.diagnosis.search.confounding import DetectedEffect
from accelcal.effects import find, spelled
from accelcal.estimation.estimate import Fit, result, solve_runs
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import Source
from accelcal.model import Model


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
    found: Sequence[DetectedEffect] = (),
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
    found : effects that the model lacks; they are added behind its own.
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
    for finding in found:
        try:
            model = finding.enter(model)
            enter(finding.effect, model)
            lacking += 1
        except ValueError as error:
            remarks.append(remark("not_fitted", text=f"{finding.effect} could not be added: {error}"))
            break
    return NestedFits(tuple(fits), tuple(names), lacking, tuple(remarks))


__dir__ = listing(globals())
