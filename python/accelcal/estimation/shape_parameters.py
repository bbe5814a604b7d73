"""Shape parameters of the effects in a model (time constants, instants, periods), estimated with the coefficients; and
coefficients over a run, as processes and mechanisms move them.

A coefficient is linear, a shape parameter is not: its column is the difference of the effect's contribution one
standard deviation to either side. With that column it takes part in the normal equations like any coefficient, so
its uncertainty reaches the coefficients, and no other effect is credited for correcting a shape that is a little off.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from accelcal.data import Array, unit_diagonal
from accelcal.effects import Effect, find, has_time_constant
from accelcal.effects.drift import in_time
from accelcal.effects.mechanisms import driver_of, memory
from accelcal.estimation.gauss_newton import Solution, iterate
from accelcal.estimation.rows import information, normal_equations
from accelcal.estimation.run_state import RunState
from accelcal.estimation.values import Values
from accelcal.model import Estimate, Model, Term, terms_of
from accelcal.signals.processing import derivative
from accelcal.signals.signals import Signals

STEPS = 4
"""Trials of the width of a difference."""
FIRST, NARROWEST, WIDEST = 1e-3, 1e-7, 0.25
"""Half widths of a difference as shares of the span: the first tried, and the limits."""
ROUNDS = 3
"""Times that shape parameters move and the coefficients follow."""
CONVERGED = 0.2
"""Shape parameters that would move by less than this share of their standard deviation stay."""
AT_BOUND = 0.003
"""Share of its range, within which a shape parameter lies on a bound."""
INDIFFERENT = 0.1
"""A gain of twice the log-likelihood below this does not move a shape parameter."""
RUNAWAY = 5.0
"""A coefficient that grows by more than this factor is not determined apart from its shape: a few readings set both."""
DOUBLINGS = 9
"""Trial values lie half a standard deviation to either side and at this many doublings of it, less one."""
INSTANTS = 201
"""Instants at which a coefficient that moves is evaluated."""
REFINEMENTS, FINER = 2, 7
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
    """Its column: what the output gains per unit of the shape parameter; at other values of those beside it, where they
    are given."""

    @property
    def name(self) -> str:
        """As in `Model.fixed` and in tables: creep.tau."""
        return f"{self.effect}.{self.shape}"

    @property
    def prior_std(self) -> float:
        """Standard deviation of a value that may lie anywhere in the span."""
        return (self.span[1] - self.span[0]) / math.sqrt(12.0)


def linearised(model: Model, state: RunState) -> list[LinearisedShape]:
    """Free shape parameters of a model, each linearised over about one standard deviation of its own."""
    gradients = []
    for name in model.added:
        effect = find(name)
        if effect.port in ("process", "noise"):
            continue
        for shape, declared in effect.shapes.items():
            if declared.refined and f"{name}.{shape}" not in model.fixed:
                share = FIRST
                for _ in range(STEPS):
                    trial = linearised_shape(model, state.values, state.signals, effect, shape, share)
                    squared = information(state, trial.term) * (share * (trial.span[1] - trial.span[0])) ** 2
                    if not 0.0 < squared < math.inf:  # the square of the half width in standard deviations
                        break
                    share = min(max(share / math.sqrt(squared), NARROWEST), WIDEST)
                gradients.append(trial)
    return gradients


def linearised_shape(
    model: Model, values: Values, signals: Signals, effect: Effect, shape: str, share: float
) -> LinearisedShape:
    """A shape parameter linearised by a difference of a share of its span to either side."""
    given, declared = model.shapes[effect.name], effect.shapes[shape]
    low, high = declared.span(signals)
    if declared.width:
        reach = min(declared.width(signals, given[shape]), 0.5 * given[shape])
        low, high = given[shape] - reach, given[shape] + reach
    coefficients = np.array([values.by_name.get(term.name, 0.0) for term in terms_of(effect, given)])
    if declared.beyond_size:  # a fit that has it too large takes what that leaves for noise, and with it its bound up
        low = min(low, float(np.max(np.abs(coefficients))))
    span = (min(low, given[shape]), max(high, given[shape]))
    below = max(given[shape] - share * (span[1] - span[0]), span[0])
    above = min(given[shape] + share * (span[1] - span[0]), span[1])
    trial = beside_offset(effect, given, model)

    def difference(s: Signals, **moved: float) -> Array:
        change = trial.column(s, **{**given, **moved, shape: above})
        change = change - trial.column(s, **{**given, **moved, shape: below})
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


def beside_offset(effect: Effect, given: Mapping[str, float], model: Model) -> Effect:
    """The effect with a column that allows for the time offset, which gives way as much as its time constant grows.

    The column of the offset is the jerk of the motion, not of what the low-pass makes of it. A low-pass and an offset
    differ by terms of second order alone, and those that this leaves out make a step of the time constant, and its
    uncertainty, half as large as they are. The column of a trial therefore is the output that it makes, moved back by
    what the time constant grew, less what the column of the offset holds of that.
    """
    moves_together = effect.traits.delay_class and effect.port == "output" and "tau" in effect.shapes
    if not moves_together or "time_offset" not in {term.name for term in model.free}:
        return effect

    def moved(s: Signals, **shape: float) -> Array:
        e, back = effect.column(s, **shape), shape["tau"] - given["tau"]
        slope = derivative(s.scale * s.a + e, s.step)
        return np.asarray(e + back * (slope - s.scale * s.jerk) + 0.5 * back**2 * derivative(slope, s.step))

    return replace(effect, function=moved)


def refine_shapes(solution: Solution) -> Solution:
    """The solution at the most likely shape parameters, with their uncertainty in the covariance."""
    estimates, stuck = ShapeEstimates.of(solution), set[str]()
    for _ in range(ROUNDS * len(estimates.linear) if estimates else 0):
        assert estimates is not None
        far: dict[str, tuple[float, dict[str, float]]] = {}
        for shape, std in zip(estimates.linear, estimates.std.tolist(), strict=True):
            if shape.name not in stuck and 0.0 < std < np.inf:
                likely = most_likely(solution, shape, std, estimates.linear)
                far[shape.name] = abs(likely[shape.name] - shape.value) / std, likely
        furthest = max(far, key=lambda name: far[name][0], default="")
        if not furthest or far[furthest][0] < CONVERGED:
            break
        moved = far[furthest][1]  # other effects lean on it
        runs, bands = [state.run for state in solution.states], [state.band for state in solution.states]
        try:
            trial = replace(iterate(solution.model.reshaped(**moved), runs, bands), chosen=solution.chosen)
        except ValueError:
            stuck.add(furthest)
            continue
        after = ShapeEstimates.of(trial)
        believed = np.abs(solution.layout.prior_mean(solution.model))
        expected = np.abs(solution.x) + np.sqrt(np.diag(estimates.covariance)) + believed
        grown = np.abs(trial.x) > RUNAWAY * expected
        if trial.log_likelihood >= solution.log_likelihood:  # other coefficients may have been far off before
            grown &= [term.effect.name == furthest.rpartition(".")[0] for term, _ in solution.layout.slots]
        if after is None or grown.any():
            stuck.add(furthest)
            continue
        solution, estimates = trial, after
    return (
        solution
        if estimates is None
        else replace(solution, covariance=estimates.covariance, shapes=estimates.estimates, joint=estimates.joint)
    )


@dataclass(frozen=True, slots=True)
class ShapeEstimates:
    """Shape parameters and coefficients at a solution, linearised."""

    linear: Sequence[LinearisedShape]
    joint: Array
    """Covariance of the m coefficients, then of the b shape parameters, (m + b, m + b)."""

    @classmethod
    def of(cls, solution: Solution) -> ShapeEstimates | None:
        """Normal equations of coefficients and shapes together; None where no shape parameter is free."""
        layout, model = solution.layout, solution.model
        linear = [linearised(model, state) for state in solution.states]
        if not linear[0]:
            return None
        m, b = len(layout.slots), len(linear[0])
        total = np.diag([*layout.prior_information(model), *(shape.prior_std**-2.0 for shape in linear[0])])
        for index, (state, shapes) in enumerate(zip(solution.states, linear, strict=True)):
            rows = [*layout.rows(index), *range(m, m + b)]
            terms = [*model.free, *(shape.term for shape in shapes)]
            total[np.ix_(rows, rows)] += normal_equations(state, terms).gram
        whole, plain = inverse(total), inverse(total[:m, :m])
        # What was added to the covariance for noise that is not white stays.
        whole[:m, :m] += solution.covariance - plain
        return cls(linear[0], whole)

    @property
    def std(self) -> Array:
        """Standard deviations of the shape parameters, (b,)."""
        return np.asarray(np.sqrt(np.diag(self.joint)[-len(self.linear) :]))

    @property
    def covariance(self) -> Array:
        """Covariance of the coefficients, with the uncertainty of the shapes, (m, m)."""
        return self.joint[: -len(self.linear), : -len(self.linear)]

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Values and standard deviations."""
        return tuple(
            Estimate(shape.name, shape.shape, shape.unit, shape.value, float(std), find(shape.effect).owner)
            for shape, std in zip(self.linear, self.std, strict=True)
        )


def most_likely(
    solution: Solution, shape: LinearisedShape, std: float, every: Sequence[LinearisedShape]
) -> dict[str, float]:
    """Most likely value of a shape parameter, over wide brackets, then ever finer ones, and of the others of its
    effect, which move with it; all coefficients are profiled."""
    value, away = shape.value, std * 2.0 ** np.arange(-1, DOUBLINGS)
    others = [other for other in every if other.effect == shape.effect and other is not shape]
    grid = find(shape.effect).shapes[shape.shape].grid(solution.states[0].signals)
    tried = np.unique(np.clip([*(value - away), value, *(value + away), *grid], *shape.span))
    gains, steps = profile(solution, shape, tried, others)
    if np.max(gains) - gains[np.argmin(np.abs(tried - value))] < INDIFFERENT:
        return {shape.name: value}
    for _ in range(REFINEMENTS):
        k = int(np.argmax(gains))
        low, high = tried[max(k - 1, 0)], tried[min(k + 1, len(tried) - 1)]
        tried = np.unique([tried[k], *np.linspace(low, high, FINER)])
        gains, steps = profile(solution, shape, tried, others)
    k = int(np.argmax(gains))
    beside = zip(others, steps[k].tolist(), strict=True)
    return {other.name: float(np.clip(other.value + step, *other.span)) for other, step in beside} | {
        shape.name: float(tried[k])
    }


def profile(
    solution: Solution, shape: LinearisedShape, values: Array, others: Sequence[LinearisedShape]
) -> tuple[Array, Array]:
    """Twice the log-likelihood gained with an effect at trial values of a shape parameter, up to a constant, (n,), and
    how far the others of the effect move with it, (n, others)."""
    layout, model = solution.layout, solution.model
    effect, given = find(shape.effect), model.shapes[shape.effect]
    trial = beside_offset(effect, given, model)
    m = len(layout.slots)
    columns = [i for i, (term, _) in enumerate(layout.slots) if term.effect.name == shape.effect]
    rest, width = [i for i in range(m) if i not in columns], len(columns) + len(others)
    belief, mean = layout.prior_information(model), layout.prior_mean(model)
    weights = [other.prior_std**-2.0 for other in others]
    total = np.diag([*belief, *[*belief[columns], *weights] * len(values)])  # coefficients, then those of each trial
    score = np.array(
        [*belief * (mean - solution.x), *[*(belief * mean)[columns], *np.zeros(len(others))] * len(values)]
    )
    shapes = [{**given, shape.shape: float(value)} for value in values]
    for index, state in enumerate(solution.states):
        trials = [
            (m + number * width + k, Term(trial, layout.slots[i][0].part, tried))
            for number, tried in enumerate(shapes)
            for k, i in enumerate(columns)
            if index in layout.slots[i][1]
        ]
        trials += [
            (m + number * width + k, replace(other.term, shape={shape.shape: tried[shape.shape]}))
            for number, tried in enumerate(shapes)
            for k, other in enumerate(others, start=len(columns))
        ]
        rows = [*layout.rows(index), *(row for row, _ in trials)]
        normal = normal_equations(state, [*model.free, *(term for _, term in trials)])
        total[np.ix_(rows, rows)] += normal.gram
        score[rows] += normal.score
    score += total[:, columns] @ solution.x[columns]  # subtract the effect before each trial adds it
    gains, steps = np.empty(len(values)), np.zeros((len(values), len(others)))
    for number in range(len(values)):
        for free in dict.fromkeys((width, len(columns))):  # the others move with it, or stay where they would leave
            chosen = [*rest, *range(m + number * width, m + number * width + free)]
            step = inverse(total[np.ix_(chosen, chosen)]) @ score[chosen]
            before, after = solution.x[columns], step[len(rest) : m]
            moves = step[m:] * (before @ after) / max(float(after @ after), 1e-300)  # their columns have the old size
            beside = zip(others, moves.tolist(), strict=False)
            if all(other.span[0] <= other.value + move <= other.span[1] for other, move in beside):
                break
        gains[number] = score[chosen] @ step
        steps[number, : len(moves)] = moves
    return gains, steps


def inverse(information: Array) -> Array:
    """Inverse of a symmetric matrix whose rows have units of their own; empty or collinear rows add nothing."""
    scaled, size = unit_diagonal(information)
    rcond = 1e-10 / max(len(size), 1)  # of the largest: what the iteration takes for determined stays
    return np.asarray(np.linalg.pinv(scaled, rcond=rcond, hermitian=True) / np.outer(size, size))


def on_bounds(solution: Solution) -> list[str]:
    """Sentences on shape parameters that ended on a bound of where they are searched for.

    A wave that a noise test finds may be shorter than the trials.
    """
    s, names, model = solution.states[0].signals, [], solution.model
    moving = (effect for effect in map(find, model.added) if has_time_constant(effect))
    taus = ((f"{e.name}.tau", model.shapes[e.name]["tau"]) for e in moving if f"{e.name}.tau" not in model.fixed)
    for name, value in (*((e.name, e.value) for e in solution.shapes), *taus):
        effect, _, shape = name.rpartition(".")
        declared = find(effect).shapes[shape]
        low, high = declared.span(s)
        scaled = math.log if declared.spacing == "log" else float
        place = (scaled(value) - scaled(low)) / (scaled(high) - scaled(low)) if low < high else 0.5
        if min(math.inf if declared.width else abs(place), abs(1.0 - place)) < AT_BOUND:
            names.append(
                f"{name} ended at {value:.4g} {declared.unit}, on a bound of its range of {low:.4g} to {high:.4g} "
                f"{declared.unit}: the record sets no value for it; hold it at one that is known, or drop the effect"
            )
    return names


def held_shapes(model: Model) -> Iterator[Estimate]:
    """Shape parameters that the model holds."""
    for name, value in model.fixed.items():
        effect, _, shape = name.partition(".")
        if effect in model.effects and shape in find(effect).shapes:
            yield Estimate(name, shape, find(effect).shapes[shape].unit, value, 0.0, find(effect).owner)


def moves(term: Term) -> str:
    """Name of the coefficient that a term moves in time; empty where it is none of a process or mechanism."""
    if term.effect.mechanism is not None:
        return term.effect.mechanism.carrier
    return term.effect.traits.changes if term.effect.port == "process" else ""


@dataclass(frozen=True, slots=True)
class MovedCoefficient:
    """A coefficient over one run, linearised about its estimates: at some instants and, last, at its mean."""

    t: Array
    """Instants from the model's origin, (n,) s."""
    terms: tuple[Term, ...]
    """The coefficient itself, and what moves it."""
    columns: Array
    """Factor of each term, (n + 1, terms)."""
    size: Array
    """Estimate of each term, (terms,)."""
    std: Array
    """Standard deviation, with that of the shape parameters, (n + 1,)."""
    itself_std: float
    """Standard deviation of the coefficient itself, where its drivers are at zero."""

    @property
    def value(self) -> Array:
        """Sum of the terms, (n + 1,)."""
        return self.columns @ self.size

    @classmethod
    def of(cls, solution: Solution, coefficient: str, index: int = 0) -> MovedCoefficient:
        """A coefficient over the run `index` of a solution."""
        state, model = solution.states[index], solution.model
        s, values = state.signals, state.values.by_name
        terms = tuple(term for term in model.terms if coefficient in (term.name, moves(term)))
        rows = np.unique(np.linspace(0, len(s.t) - 1, INSTANTS).astype(np.intp))
        columns = np.column_stack([_factor(term, s, rows) for term in terms])
        joint = solution.covariance if solution.joint is None else solution.joint
        gradient = np.zeros((len(rows) + 1, len(joint)))
        place = dict(zip((term.name for term in model.free), solution.layout.rows(index), strict=True))
        for k, term in enumerate(terms):
            if term.name in place:
                gradient[:, place[term.name]] = columns[:, k]
        for k, e in enumerate(solution.shapes, start=len(solution.covariance)):
            name, _, shape = e.name.rpartition(".")
            for term in terms:
                if term.effect.name == name and term.effect.mechanism is not None:
                    gradient[:, k] += values[term.name] * _by_shape(term, shape, STEP * e.std, s, rows)
        variance = np.einsum("nk,kl,nl->n", gradient, joint, gradient)
        alone = joint[place[coefficient], place[coefficient]] if coefficient in place else 0.0
        size = np.array([values[term.name] for term in terms])
        return cls(s.t[rows], terms, columns, size, np.sqrt(np.maximum(variance, 0.0)), math.sqrt(alone))


STEP = 1e-3
"""Half width of a difference over a shape parameter of a memory, in its standard deviations."""


def _factor(term: Term, s: Signals, rows: NDArray[np.intp]) -> Array:
    """Factor of a term in the coefficient that it moves, (rows + 1,): at rows of `s`, and at the mean of the run."""
    effect, shape = term.effect, term.shape
    if effect.mechanism is not None:
        u = memory(s, driver_of(effect.mechanism.driver), shape["tau"], shape["start"])
        return np.append(u[rows], np.mean(u))
    if effect.port != "process":
        return np.ones(len(rows) + 1)
    times = {name: shape[name] for name in ("start", "length", *(["tau"] if has_time_constant(effect) else []))}
    y = in_time(s.t[rows], **times)[:, term.part]
    return np.append(y, np.mean(y))


def _by_shape(term: Term, shape: str, half: float, s: Signals, rows: NDArray[np.intp]) -> Array:
    """Derivative of the factor of a mechanism by a shape parameter of its memory, (rows + 1,), 0 for any other."""
    if shape not in ("tau", "start") or not 0.0 < half < math.inf:
        return np.zeros(len(rows) + 1)
    low, high = ({**term.shape, shape: term.shape[shape] + side * half} for side in (-1.0, 1.0))
    low["tau"] = max(low["tau"], 0.5 * term.shape["tau"])
    ends = [_factor(replace(term, shape=at), s, rows) for at in (low, high)]
    return (ends[1] - ends[0]) / (high[shape] - low[shape])


def at_means(solution: Solution) -> tuple[Estimate, ...]:
    """Coefficients that mechanisms of a solution move, at the mean of each run: the coefficient plus c times the mean
    of the memory, with the uncertainty of both and of the memory."""
    carriers = dict.fromkeys(moves(term) for term in solution.model.terms if term.effect.mechanism is not None)
    several = len(solution.states) > 1
    means = []
    for name in carriers:
        effect = find(name)
        for index in range(len(solution.states)):
            moved = MovedCoefficient.of(solution, name, index)
            value, std, run = float(moved.value[-1]), float(moved.std[-1]), index if several else None
            means.append(Estimate(name, effect.symbol, effect.unit, value, std, effect.owner, run))
    return tuple(means)
