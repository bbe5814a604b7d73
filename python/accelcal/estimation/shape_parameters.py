"""Shape parameters of the effects in a model (time constants, instants, periods): estimated beside the coefficients.

A coefficient is linear, a shape parameter is not: its column is the difference of the effect's contribution one
standard deviation to either side. With that column it takes part in the normal equations like any coefficient, so
its doubt reaches the coefficients, and no other effect is paid for mending a shape that is a little off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from accelcal.data.arrays import Array
from accelcal.effects import Effect, find
from accelcal.estimation.gauss_newton import Solution, iterate
from accelcal.estimation.run_state import RunState
from accelcal.estimation.values import Values
from accelcal.model import Estimate, Model, Term, terms_of
from accelcal.signals.signals import Signals

STEPS = 4
"""Trials of the width of a difference."""
FIRST, NARROWEST, WIDEST = 1e-3, 1e-7, 0.25
"""Half widths of a difference as shares of the span: the first tried, and the limits."""
ROUNDS = 3
"""Times that shape parameters move and the coefficients follow."""
CONVERGED = 0.2
"""Shape parameters that would move by less than this share of their standard deviation stay."""
INDIFFERENT = 0.1
"""Twice the log-likelihood that is not worth a move."""
RUNAWAY = 5.0
"""A coefficient that grows by more than this on the way trades places with its shape: a few readings set both."""
REACH = 9
"""Values are tried out to two to the power of this, less one, standard deviations."""
REFINEMENTS, FINER = 3, 7
"""Times that the bracket of the best value is divided, and into how many."""


@dataclass(frozen=True, slots=True)
class LinearisedShape:
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


def linearised(model: Model, values: Values, signals: Signals, power: Callable[[Term], float]) -> list[LinearisedShape]:
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
                    one = linearised_shape(model, values, signals, effect, shape, share)
                    seen = power(one.term) * (share * (one.span[1] - one.span[0])) ** 2
                    if not 0.0 < seen < math.inf:
                        break
                    share = min(max(share / math.sqrt(seen), NARROWEST), WIDEST)
                found.append(one)
    return found


def linearised_shape(
    model: Model, values: Values, signals: Signals, effect: Effect, shape: str, share: float
) -> LinearisedShape:
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
        traits=replace(effect.traits, positive=False, memory=True),
    )
    return LinearisedShape(effect.name, shape, declared.unit, given[shape], span, Term(tangent))


def refine_shapes(solution: Solution) -> Solution:
    """The solution at the shape parameters that the record is most likely at, with their doubt in the covariance."""
    bent = ShapeEstimates.of(solution)
    for _ in range(ROUNDS):
        if bent is None:
            return solution
        moved = {b.name: most_likely(solution, b, float(std)) for b, std in zip(bent.bends, bent.std, strict=True)}
        if all(abs(moved[b.name] - b.value) < CONVERGED * s for b, s in zip(bent.bends, bent.std, strict=True)):
            break
        runs, bands = [one.run for one in solution.passes], [one.band for one in solution.passes]
        try:
            trial = replace(iterate(solution.model.reshaped(**moved), runs, bands), chosen=solution.chosen)
        except ValueError:
            break
        after = ShapeEstimates.of(trial)
        believed = np.abs(solution.layout.prior_mean(solution.model))
        expected = np.abs(solution.x) + np.sqrt(np.diag(bent.covariance)) + believed
        if after is None or np.any(np.abs(trial.x) > RUNAWAY * expected):
            break
        solution, bent = trial, after
    return solution if bent is None else replace(solution, covariance=bent.covariance, shapes=bent.estimates)


@dataclass(frozen=True, slots=True)
class ShapeEstimates:
    """Shape parameters beside the coefficients at a solution, linearised."""

    bends: Sequence[LinearisedShape]
    std: Array
    """(b,)"""
    covariance: Array
    """Of the coefficients, the doubt of the shapes included, (m, m)."""

    @classmethod
    def of(cls, solution: Solution) -> ShapeEstimates | None:
        """Normal equations of coefficients and shapes together; None where no shape parameter is free."""
        layout, model = solution.layout, solution.model
        linear = [linearised(model, one.values, signals_of(one), one.information) for one in solution.passes]
        if not linear[0]:
            return None
        m, b = len(layout.slots), len(linear[0])
        information = np.diag([*layout.prior_information(model), *(one.belief**-2.0 for one in linear[0])])
        for index, (one, bends) in enumerate(zip(solution.passes, linear, strict=True)):
            rows = [*layout.rows(index), *range(m, m + b)]
            normal = one.normal_equations([*one.terms, *(linearised_shape.term for linearised_shape in bends)])
            information[np.ix_(rows, rows)] += normal.gram
        whole, plain = inverse(information), inverse(information[:m, :m])
        # What was added to the covariance for noise that is not white stays.
        covariance = solution.covariance + whole[:m, :m] - plain
        return cls(linear[0], np.sqrt(np.diag(whole)[m:]), covariance)

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Values and standard deviations."""
        return tuple(
            Estimate(b.name, b.shape, b.unit, b.value, float(std), find(b.effect).owner)
            for b, std in zip(self.bends, self.std, strict=True)
        )


def most_likely(solution: Solution, linearised_shape: LinearisedShape, std: float) -> float:
    """Where a shape parameter is most likely, all coefficients profiled: far out, then ever finer."""
    away = std * 2.0 ** np.arange(-1, REACH)
    tried = np.unique(
        np.clip(
            [*(linearised_shape.value - away), linearised_shape.value, *(linearised_shape.value + away)],
            *linearised_shape.span,
        )
    )
    for _ in range(REFINEMENTS):
        gains = profile(solution, linearised_shape, tried)
        k = int(np.argmax(gains))
        if gains[k] - gains[np.argmin(np.abs(tried - linearised_shape.value))] < INDIFFERENT:
            return linearised_shape.value
        low, high = tried[max(k - 1, 0)], tried[min(k + 1, len(tried) - 1)]
        best = float(tried[k])
        tried = np.unique([best, *np.linspace(low, high, FINER)])
    return best


def profile(solution: Solution, linearised_shape: LinearisedShape, values: Array) -> Array:
    """Twice the log-likelihood gained with an effect at trial values of a shape parameter, up to a constant, (n,)."""
    layout, model = solution.layout, solution.model
    effect, given = find(linearised_shape.effect), model.shapes[linearised_shape.effect]
    m = len(layout.slots)
    own = [i for i, (term, _) in enumerate(layout.slots) if term.effect.name == linearised_shape.effect]
    rest = [i for i in range(m) if i not in own]
    belief, mean = layout.prior_information(model), layout.prior_mean(model)
    every = [*range(m), *own * len(values)]  # coefficients, then those of the effect once for each trial
    information = np.diag(belief[every])
    score = belief[every] * mean[every]
    score[:m] -= belief * solution.x
    shapes = [{**given, linearised_shape.shape: float(value)} for value in values]
    for index, one in enumerate(solution.passes):
        trials = [
            (m + number * len(own) + k, Term(effect, layout.slots[i][0].part, shape))
            for number, shape in enumerate(shapes)
            for k, i in enumerate(own)
            if layout.slots[i][1] in (None, index)
        ]
        rows = [*layout.rows(index), *(row for row, _ in trials)]
        normal = one.normal_equations([*one.terms, *(term for _, term in trials)])
        information[np.ix_(rows, rows)] += normal.gram
        score[rows] += normal.score
    score += information[:, own] @ solution.x[own]  # the effect is taken out before it is tried anew
    gains = np.empty(len(values))
    for number in range(len(values)):
        chosen = [*rest, *range(m + number * len(own), m + (number + 1) * len(own))]
        gains[number] = score[chosen] @ inverse(information[np.ix_(chosen, chosen)]) @ score[chosen]
    return gains


def inverse(information: Array) -> Array:
    """Inverse of a symmetric matrix whose rows have units of their own; what is empty or double adds nothing."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scale = np.outer(size, size)
    return np.asarray(np.linalg.pinv(information / scale, rcond=1e-10, hermitian=True) / scale)


def signals_of(one: RunState) -> Signals:
    """The smoothed motion of a run that has been iterated."""
    assert one.signals is not None
    return one.signals


def held_shapes(model: Model) -> Iterator[Estimate]:
    """Shape parameters that the model holds."""
    for name, value in model.fixed.items():
        effect, _, shape = name.partition(".")
        if effect in model.effects and shape in find(effect).shapes:
            yield Estimate(name, shape, find(effect).shapes[shape].unit, value, 0.0, find(effect).owner)
