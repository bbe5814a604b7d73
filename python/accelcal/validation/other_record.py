"""What a fit says of a recording that it was not made from: without what belongs to its own recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from accelcal.data.recording import Recording
from accelcal.effects import Effect, find, of_one_record
from accelcal.estimation.estimate import Fit
from accelcal.estimation.values import Values


def values_on(fit: Fit, recording: Recording) -> Values:
    """Coefficients as they apply to a recording.

    On another than its own, effects that follow the clock of their record are left out (derivations 6.9): steps, bias
    walks, warm-up. Elements with memory begin as after a long rest.
    """
    if is_fitted(fit, recording):
        same = [index for index, run in enumerate(fit.runs) if run.digest and run.digest == recording.digest]
        parts = [index for index, run in enumerate(fit.runs) if run.session and run.session == recording.session]
        return fit.values(same[0] if same else parts[0] if len(parts) == 1 else None)
    values = fit.values()
    terms = tuple(replace(term, shape=at_rest(term.effect, term.shape)) for term in values.terms)
    lost = {term.name for term in terms if of_one_record(term.effect)}
    return Values({name: 0.0 if name in lost else value for name, value in values.by_name.items()}, terms)


def left_out(fit: Fit, recording: Recording) -> tuple[str, ...]:
    """Sentences on what of a model is not carried to a recording."""
    if is_fitted(fit, recording):
        return ()
    names = [name for name in fit.model.added if of_one_record(find(name))]
    anew = [name for name in fit.model.added if name not in names and at_rest(find(name), {})]
    sentences = []
    if names:
        sentences.append(f"{' and '.join(names)}: follows the clock of the fitted recording; left out on this one")
    if anew:
        sentences.append(f"{' and '.join(anew)}: begins on this recording as after a long rest")
    return tuple(sentences)


def is_fitted(fit: Fit, recording: Recording) -> bool:
    """Whether a recording has the clock of one that a fit was made from, or no digest to tell it from them."""
    return recording.session in {run.session for run in fit.runs}


def start_of_history(fit: Fit, recording: Recording, start: float) -> float:
    """Time from which elements with memory are to be followed up to `start`, s: they began with the fitted part of the
    same recording; on another one, and before that part, there is no history."""
    return min([start, *(run.start for run in fit.runs if run.session and run.session == recording.session)])


def at_rest(effect: Effect, shape: Mapping[str, float]) -> dict[str, float]:
    """Shape parameters of an effect, states of its element as after a long rest."""
    states = {name: declared.at_rest for name, declared in effect.shapes.items() if declared.at_rest is not None}
    return {**shape, **states}
