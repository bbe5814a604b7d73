"""Hypotheses: every effect that may be missing from a model, at each of its trial shapes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from accelcal.data import DERIVED, POSITION_ORDER
from accelcal.diagnosis.policy import FREE_SHAPE_PARAMETERS, RANDOM_PROCESS_COMPARISONS
from accelcal.diagnosis.search.initial_shapes import PROPOSALS, InitialShape
from accelcal.effects import BUILT_IN, Effect, find, side_channels, users_own
from accelcal.estimation.dwell_rows import acts_at_rest
from accelcal.estimation.dwell_rows import shown as dwells_show
from accelcal.estimation.run_state import RunState
from accelcal.estimation.shape_parameters import linearised
from accelcal.model import Model, Term, terms_of


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """An effect at given shape parameters: what can enter a set."""

    effect: Effect
    shape: Mapping[str, float]
    comparisons: int = 1
    """Alternatives among which this one was selected before it was tried."""
    brackets: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Intervals within which shape parameters that the record proposed may be refined."""
    leading: int | None = None
    """Number of its columns, where it is the coarse form of a curve."""

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its coefficients."""
        return terms_of(self.effect, self.shape)[: self.leading]

    @property
    def further(self) -> int:
        """Shape parameters that cost as much as a coefficient."""
        return max(0, sum(shape.refined for shape in self.effect.shapes.values()) - FREE_SHAPE_PARAMETERS)

    @property
    def held(self) -> tuple[Term, ...]:
        """Coefficients of its effect that it does without."""
        return terms_of(self.effect, self.shape)[len(self.terms) :]


def hypotheses_for(
    state: RunState, model: Model, extra: Sequence[Effect] | None = None, *, others: Sequence[RunState] = ()
) -> list[Hypothesis]:
    """Every effect that may be missing from a model on this record, at each of its trial shapes.

    Parameters
    ----------
    state : a fitted run.
    model : effects that it has are not offered again, but for the fine form of a coarse curve.
    extra : users' effects to consider besides the built-in catalogue; by default all that are registered.
    others : further runs: one whose position was read is enough for errors of it.
    """
    s, dwells = state.signals, state.run.recording.dwells
    recorded = [(name, channel.unit) for name, channel in state.run.recording.side.items() if name not in DERIVED]
    offered = (*BUILT_IN, *side_channels(recorded), *(users_own() if extra is None else extra))
    moving = {find(name).traits.changes for name in model.effects if find(name).port == "process"}
    time_functions = {e.name for e in BUILT_IN if e.port != "process" and e.traits.changes in moving - {""}}
    hypotheses: list[Hypothesis] = []
    for effect in offered:
        if may_be_refined(model, effect):
            hypotheses.append(Hypothesis(effect, model.shapes[effect.name]))
            continue
        shown = effect.traits.visible or (dwells is not None and effect.seen_by_sets)
        excluded = effect.name in model.effects or not shown or effect.port == "noise"
        premature = effect.search.beside and effect.search.beside not in model.effects
        unknown = dwells is not None and acts_at_rest(effect) and not dwells_show(dwells, effect)
        foreign = lacks_its_position(effect, (state, *others))
        if excluded or premature or unknown or foreign or any(name not in s.side for name in effect.needs):
            continue
        tried = {
            n: [InitialShape(float(v)) for v in shape.grid(s)] for n, shape in effect.shapes.items() if not shape.picked
        }
        tried |= {n: PROPOSALS[shape.picked](state) for n, shape in effect.shapes.items() if shape.picked}
        first = len(hypotheses)
        for trial in itertools.product(*tried.values()):
            chosen = dict(zip(tried, trial, strict=True))
            brackets = {name: proposed.bracket for name, proposed in chosen.items() if proposed.bracket}
            comparisons = math.prod(proposed.comparisons for proposed in trial) * (
                RANDOM_PROCESS_COMPARISONS if effect.name in time_functions else 1
            )
            shape = {name: proposed.value for name, proposed in chosen.items()}
            for proposed in trial:
                shape |= proposed.also
            hypotheses.append(Hypothesis(effect, shape, comparisons, brackets))
        if effect.coarse:
            hypotheses.append(replace(hypotheses[first], leading=effect.coarse))
    return hypotheses


def lacks_its_position(effect: Effect, states: Sequence[RunState]) -> bool:
    """Whether it is an error of a position as it is read, and no run has one.

    Behind a velocity or an acceleration none is looked for: the position is their integral, whose slow part is noise.
    """
    error = effect in BUILT_IN and effect.port == "position" and not effect.traits.of_any_reference
    return error and all(state.run.order != POSITION_ORDER for state in states)


def may_be_refined(model: Model, effect: Effect) -> bool:
    """Whether a model has an effect in its coarse form, so that the fine one may be missing."""
    if effect.name not in model.effects or not effect.coarse:
        return False
    inner = terms_of(effect, model.shapes[effect.name])[effect.coarse :]
    return all(model.fixed.get(term.name) == 0.0 for term in inner)


def nuisances(state: RunState, model: Model) -> list[tuple[Term, float]]:
    """Nuisance parameters of every test, each with its prior standard deviation.

    Shape parameters of the effects in the model are among them: an effect that only corrects the shape of another must
    not be credited for it. So is the time constant of the low-pass, with its declared tolerance, or with the five
    percent
    of the delay rule where none is declared: five percent of a millisecond exceed a delay when the motion is fast.
    """
    tolerance = state.run.rig.lowpass_tolerance
    known = [(Term(find("lowpass_error")), tolerance)] if tolerance > 0.0 else []
    return known + [(shape.term, shape.prior_std) for shape in linearised(model, state)]
