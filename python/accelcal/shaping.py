"""Shape parameters of the effects in a model (time constants, instants, periods): estimated beside the coefficients.

A coefficient is linear, a shape parameter is not: its column is the difference of the effect's contribution one
standard deviation to either side. With that column it takes part in the normal equations like any coefficient, so
its doubt reaches the coefficients, and no other effect is paid for mending a shape that is a little off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from accelcal.effects import Effect, find
from accelcal.model import Model, Term, terms_of
from accelcal.recording import Array
from accelcal.replay import Values
from accelcal.signals import Signals

STEPS = 4
"""Trials of the width of a difference."""
FIRST, NARROWEST, WIDEST = 1e-3, 1e-7, 0.25
"""Half widths of a difference as shares of the span: the first tried, and the limits."""


@dataclass(frozen=True, slots=True)
class Bend:
    """One shape parameter of one effect in a model, linearised about its value."""

    effect: str
    shape: str
    unit: str
    value: float
    span: tuple[float, float]
    term: Term
    """Its column: what the output gains per unit of the shape parameter."""

    @property
    def name(self) -> str:
        """As in `Model.fixed` and in tables: creep.tau."""
        return f"{self.effect}.{self.shape}"

    @property
    def belief(self) -> float:
        """Standard deviation of a value that may lie anywhere in the span."""
        return (self.span[1] - self.span[0]) / math.sqrt(12.0)

    def moved(self, step: float) -> float:
        """The value after a step, kept within the span."""
        return min(max(self.value + step, self.span[0]), self.span[1])


def linearised(model: Model, values: Values, signals: Signals, power: Callable[[Term], float]) -> list[Bend]:
    """Free shape parameters of a model, each linearised over about one standard deviation of its own.

    Parameters
    ----------
    model, values : effects, and the coefficients at hand.
    signals : the motion.
    power : information that the record holds on the coefficient of a term.
    """
    found = []
    for name in model.added:
        effect = find(name)
        if effect.port in ("process", "noise"):
            continue
        for shape, declared in effect.shapes.items():
            if declared.refined and f"{name}.{shape}" not in model.fixed:
                share = FIRST
                for _ in range(STEPS):
                    one = bend(model, values, signals, effect, shape, share)
                    seen = power(one.term) * (share * (one.span[1] - one.span[0])) ** 2
                    if not 0.0 < seen < math.inf:
                        break
                    share = min(max(share / math.sqrt(seen), NARROWEST), WIDEST)
                found.append(one)
    return found


def bend(model: Model, values: Values, signals: Signals, effect: Effect, shape: str, share: float) -> Bend:
    """A shape parameter linearised by a difference of a share of its span to either side."""
    given, declared = model.shapes[effect.name], effect.shapes[shape]
    low, high = declared.span(signals)
    span = (min(low, given[shape]), max(high, given[shape]))
    below = max(given[shape] - share * (span[1] - span[0]), span[0])
    above = min(given[shape] + share * (span[1] - span[0]), span[1])
    coefficients = np.array([values.by_name.get(term.name, 0.0) for term in terms_of(effect, given)])

    def difference(s: Signals) -> Array:
        one, two = ({**given, shape: value} for value in (below, above))
        change = effect.column(s, **two) - effect.column(s, **one)
        return np.asarray(change.reshape(len(s.t), -1) @ coefficients / (above - below))

    tangent = replace(
        effect,
        name=f"{effect.name}.{shape}",
        unit=f"m/s² per {declared.unit}",
        function=difference,
        shapes={},
        parts=("",),
        positive=False,
        memory=True,
    )
    return Bend(effect.name, shape, declared.unit, given[shape], span, Term(tangent))
