"""What could be missing: every effect of the catalogue at each of its trial shapes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from accelcal.diagnosis.search.initial_shapes import PICKS, InitialShape
from accelcal.effects import HOUSE, Effect, find, side_channels
from accelcal.estimation.run_state import RunState
from accelcal.estimation.shape_parameters import linearised
from accelcal.model import Model, Term, terms_of

FREE_SHAPES = 1
"""Shape parameters that the trials of an effect pay for already; each further one costs as much as a coefficient."""
WANDERED = 100
"""Looks at a course of time beside a bias that wanders: what is left of any wandering drifts and steps a little."""


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """An effect at given shape parameters: what can enter a set."""

    effect: Effect
    shape: Mapping[str, float]
    looks: int = 1
    """Alternatives that this one was picked from before it was tried."""
    near: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Where the shape parameters that were picked may be refined."""
    leading: int | None = None
    """Columns that it has, where it is the coarser shape of its effect."""

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its coefficients."""
        return terms_of(self.effect, self.shape)[: self.leading]

    @property
    def further(self) -> int:
        """Shape parameters that it pays for like coefficients."""
        return max(0, sum(shape.refined for shape in self.effect.shapes.values()) - FREE_SHAPES)

    @property
    def held(self) -> tuple[Term, ...]:
        """Coefficients of its effect that it does without."""
        return terms_of(self.effect, self.shape)[len(self.terms) :]


def candidates_for(one: RunState, model: Model, extra: Sequence[Effect] = ()) -> list[Hypothesis]:
    """Every effect that could be missing from a model on this record, at each of its trial shapes."""
    s = one.signals
    recorded = [(name, channel.unit) for name, channel in one.run.recording.side.items()]
    offered = (*HOUSE, *side_channels(recorded), *extra)
    wanders = any(find(name).port == "process" for name in model.effects)
    courses = find("shape_of_time").covers if wanders else ()
    items: list[Hypothesis] = []
    for effect in offered:
        if finer(model, effect):
            items.append(Hypothesis(effect, model.shapes[effect.name]))
            continue
        taken = effect.name in model.effects or not effect.visible or effect.port == "noise"
        early = effect.beside and effect.beside not in model.effects
        if taken or early or any(name not in s.side for name in effect.needs):
            continue
        tried = {
            n: [InitialShape(float(v)) for v in shape.grid(s)] for n, shape in effect.shapes.items() if not shape.picked
        }
        tried |= {n: PICKS[shape.picked](one) for n, shape in effect.shapes.items() if shape.picked}
        first = len(items)
        for picks in itertools.product(*tried.values()):
            chosen = dict(zip(tried, picks, strict=True))
            near = {name: pick.near for name, pick in chosen.items() if pick.near}
            looks = math.prod(pick.looks for pick in picks) * (WANDERED if effect.name in courses else 1)
            items.append(Hypothesis(effect, {name: pick.value for name, pick in chosen.items()}, looks, near))
        if effect.coarse:
            items.append(replace(items[first], leading=effect.coarse))
    return items


def finer(model: Model, effect: Effect) -> bool:
    """Whether a model has the coarse shape of an effect alone, so that the finer one may be missing."""
    if effect.name not in model.effects or not effect.coarse:
        return False
    inner = terms_of(effect, model.shapes[effect.name])[effect.coarse :]
    return all(model.fixed.get(term.name) == 0.0 for term in inner)


def nuisances(one: RunState, model: Model) -> list[tuple[Term, float]]:
    """What is known not to be known, with its standard deviation.

    The shape parameters of the effects that are in the model: an effect that mends the shape of one that is there
    must not be paid for it.

    The time constant of the low-pass is carried in every judgement, with the five percent of the delay rule where no
    tolerance is declared: five percent of a millisecond is more than a delay when the motion is fast.
    """
    tolerance = one.run.rig.lowpass_tolerance
    known = [(Term(find("lowpass_error")), tolerance)] if tolerance > 0.0 else []
    return known + [(shape.term, shape.prior_std) for shape in linearised(model, one)]
