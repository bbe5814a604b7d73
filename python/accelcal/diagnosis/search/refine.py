"""Finalists of the search, and their shape parameters by maximum likelihood."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import scipy

from accelcal.data import Array
from accelcal.diagnosis.policy import BETWEEN_TRIALS_GAIN_SHARE, FINALISTS
from accelcal.diagnosis.search.beam import SearchRules, log_chance
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.scores import BaseProjection, CandidateScores, variance_gain
from accelcal.effects import has_time_constant
from accelcal.estimation.columns import sizes
from accelcal.estimation.run_state import RunState
from accelcal.model import Model, Prior
from accelcal.signals.signals import Signals

STARTS = 4
"""Best trials of several processes from which all are estimated."""
WIDE = 7.0
"""Furthest that an intensity grows at once, in logarithms."""
UNSEEN_SHARE = 1e-2
"""Information on its strongest column, in units of that of its prior, at which a process counts as not there."""
EVALUATIONS = 14
"""Evaluations of the likelihood for each shape parameter."""
ROOT_ROUNDING = math.sqrt(2.2e-16)
"""Square root of the rounding of a number: nearer to a minimum no loss tells one place from the next."""


def shortlist(evidence: CandidateScores, sets: Sequence[tuple[int, ...]], rules: SearchRules) -> list[int]:
    """Hypotheses worth refining: all that the beam search kept, and the strongest rivals at each place of its best set.

    Each at the trial shape and fineness with the largest net gain; where none is positive, at the least probable one.
    """
    chosen = sets[0]
    indices = list(dict.fromkeys(i for chosen_set in sets for i in chosen_set))
    names = {evidence.items[i].effect.name for i in indices}
    for position in range(max(1, len(chosen))):
        gains, dofs = evidence.gains(tuple(i for k, i in enumerate(chosen) if k != position))
        best: dict[str, int] = {}
        gains_of = list(zip(gains.tolist(), dofs.tolist(), evidence.items, strict=True))
        net_gains = [(max(rules.net_gain(*trial), 0.0), -log_chance(*trial)) for trial in gains_of]
        for i in np.flatnonzero(dofs).tolist():
            name = evidence.items[i].effect.name
            best[name] = max(best.get(name, i), i, key=lambda j: net_gains[j])
        strongest = sorted(best.values(), key=lambda i: gains_of[i][0] - gains_of[i][1], reverse=True)[:FINALISTS]
        indices += [i for i in strongest if evidence.items[i].effect.name not in names]
        names |= {evidence.items[i].effect.name for i in strongest}
    # What only sets of runs show is confounded among itself by design, whoever else is as strong.
    _, dofs = evidence.gains()
    indices += [
        i
        for i in np.flatnonzero(dofs).tolist()
        if evidence.items[i].effect.seen_by_sets and evidence.items[i].effect.name not in names
    ]
    return indices


def starting_points(
    evidence: CandidateScores, finalists: Sequence[int], rules: SearchRules
) -> list[tuple[Hypothesis, ...]]:
    """Finalists to refine, one hypothesis for each effect: as in the best set, and as each explains most by itself.

    A step between two trial instants loses to a smoother rival, and the set then holds what that rival leaves. So each
    effect is also refined from its own best trial, midpoints between trials included.
    """
    as_in_set: dict[str, Hypothesis] = {}
    for i in finalists:
        as_in_set.setdefault(evidence.items[i].effect.name, evidence.items[i])
    most = max((evidence.gain(i)[0] for i in finalists), default=0.0)
    between = [item for name in as_in_set for item in between_trials(evidence, name, BETWEEN_TRIALS_GAIN_SHARE * most)]
    score_tables = [evidence, CandidateScores(evidence.runs, between)] if between else [evidence]
    net_gain: dict[str, float] = {}
    best_alone: dict[str, Hypothesis] = {}
    for table in score_tables:
        for item, gain, dof in zip(table.items, *table.gains(), strict=True):
            name, value = item.effect.name, rules.net_gain(float(gain), int(dof), item)
            if name in as_in_set and value > net_gain.get(name, 0.0):
                net_gain[name], best_alone[name] = value, item
    s = evidence.runs[0].column_filter.signals
    separate = {
        name: item if name not in best_alone or covers(item, best_alone[name].shape, s) else best_alone[name]
        for name, item in as_in_set.items()
    }
    return [tuple(chosen.values()) for chosen in ([as_in_set] if separate == as_in_set else [as_in_set, separate])]


def covers(item: Hypothesis, shape: Mapping[str, float], s: Signals) -> bool:
    """Whether refining a hypothesis searches an interval that holds a shape."""
    for name, declared in item.effect.shapes.items():
        low, high = bounds_of(item, name, s) if declared.refined else (item.shape[name], item.shape[name])
        if not low <= shape[name] <= high:
            return False
    return True


def bounds_of(item: Hypothesis, name: str, s: Signals) -> tuple[float, float]:
    """Interval within which a shape parameter of a hypothesis may be refined."""
    declared = item.effect.shapes[name]
    return item.brackets.get(name) or grid_bracket(declared.grid(s), declared.span(s), item.shape[name])


def between_trials(evidence: CandidateScores, name: str, least: float) -> list[Hypothesis]:
    """Hypotheses midway between the trial shapes of an effect, next to trials that gain more than `least`."""
    trials = [(evidence.gain(j)[0], item) for j, item in enumerate(evidence.items) if item.effect.name == name]
    s = evidence.runs[0].column_filter.signals
    hypotheses: dict[tuple[float | None, ...], Hypothesis] = {}
    for gain, item in trials:
        shapes = item.effect.shapes.items() if gain > least and item.effect.port != "process" else ()
        for shape, declared in shapes:
            grid, value = declared.grid(s), item.shape[shape]
            if len(grid) < 2 or shape in item.brackets:
                continue
            before, after = grid_bracket(grid, (value, value), value)
            for low, high in ((before, value), (value, after)):
                if low < high:
                    midpoint = math.sqrt(low * high) if declared.spacing == "log" else 0.5 * (low + high)
                    shape_between = {**item.shape, shape: midpoint}
                    brackets = {**item.brackets, shape: (low, high)}
                    hypotheses[(*shape_between.values(), item.leading)] = replace(
                        item, shape=shape_between, brackets=brackets
                    )
    return list(hypotheses.values())


Result = TypeVar("Result")
Scored = tuple[CandidateScores, int]
"""A table of scores, and the index in it of the hypothesis that a search waits for."""
Search = Generator[Hypothesis, Scored, Result]
"""A search that yields hypotheses to score, and is sent where their scores are."""


def refine(runs: Sequence[BaseProjection], lists: Sequence[Sequence[Hypothesis]]) -> list[list[Hypothesis]]:
    """Hypotheses of several lists with shape parameters by likelihood; one that is in several lists is refined once."""
    unique = {id(item): item for hypotheses in lists for item in hypotheses}
    s = runs[0].column_filter.signals
    best = dict(zip(unique, in_step(runs, [refined(item, s) for item in unique.values()]), strict=True))
    return [[best[id(item)] for item in hypotheses] for hypotheses in lists]


def in_step(runs: Sequence[BaseProjection], searches: Sequence[Search[Result]]) -> list[Result]:
    """Results of several searches: the hypotheses that they wait for are scored together, in one pass over the runs."""
    results: dict[int, Result] = {}
    waiting: dict[int, Hypothesis] = {}

    def advance(k: int, scored: Scored | None) -> None:
        try:
            waiting[k] = next(searches[k]) if scored is None else searches[k].send(scored)
        except StopIteration as end:
            results[k] = end.value

    for k in range(len(searches)):
        advance(k, None)
    while waiting:
        asked, waiting = waiting, {}
        table = CandidateScores(runs, list(asked.values()))
        for i, k in enumerate(asked):
            advance(k, (table, i))
    return [results[k] for k in range(len(searches))]


def with_likely_processes(model: Model, states: Sequence[RunState]) -> tuple[Model, float, tuple[str, ...]]:
    """A model whose random processes have their most likely intensities and time constants, all at once.

    A process that enters first takes what a later one explains better; so they would depend on the order in which they
    entered. A model of fewer than two processes is as it is.

    Parameters
    ----------
    model : of which the processes are estimated anew, but for those whose coefficients are all held.
    states : runs that were fitted with the model.

    Returns
    -------
    The model; twice the log-likelihood that it gains over the one that is given; processes of which the runs show
    nothing beside the others, which keep the intensity at which they add next to nothing.
    """
    terms = [term for term in model.free if term.effect.port == "process"]
    effects = sorted({term.effect.name: term.effect for term in terms}.values(), key=lambda effect: effect.name)
    if len(effects) < 2:
        return model, 0.0, ()
    s = states[0].signals
    items = [Hypothesis(effect, model.shapes.get(effect.name, {})) for effect in effects]
    left = model.drop(*(effect.name for effect in effects))
    evidence = CandidateScores([BaseProjection(state, left, given_back=terms) for state in states], items)
    free = [e for e in effects if has_time_constant(e) and f"{e.name}.tau" not in model.fixed]
    spans = [np.log(effect.shapes["tau"].span(s)) for effect in free]
    given = np.log([model.shapes[effect.name]["tau"] for effect in free])
    unit = {effect.name: sizes(effect, item.shape, s) for effect, item in zip(effects, items, strict=True)}
    first = np.array([math.log(model.priors[f"{effect.name}.{effect.parts[0]}"].std) for effect in effects])
    # the intensity at which no column explains more than this share of its own variance
    power = [max(float(np.max(np.diag(evidence.G)[columns])), 1e-300) for columns in evidence.columns]
    least = 0.5 * np.log(UNSEEN_SHARE / np.array(power))

    def scaled(x: Array) -> Array:
        """Standard deviation of each column in units of those that were scored."""
        taus = dict(zip((effect.name for effect in free), np.exp(x[len(effects) :]), strict=True))
        stds = np.ones(len(evidence.c))
        for item, columns, size in zip(items, evidence.columns, np.exp(x), strict=False):
            name, shape = item.effect.name, item.shape
            ratio = sizes(item.effect, {**shape, "tau": taus[name]}, s) / unit[name] if name in taus else 1.0
            stds[columns] = size * ratio
        return stds

    def loss(x: Array) -> float:
        """Minus twice the log-likelihood: b' (I + A)^-1 b - log det (I + A) of the columns in units of their stds."""
        stds = scaled(x)
        b = stds * evidence.c
        factor = np.linalg.cholesky(np.eye(len(b)) + stds[:, None] * evidence.G * stds)
        half = scipy.linalg.solve_triangular(factor, b, lower=True)
        return float(2.0 * np.sum(np.log(np.diag(factor))) - half @ half)

    begin = np.maximum(first, least)
    bounds = [*((low, max(size, low) + WIDE) for low, size in zip(least, begin, strict=True)), *map(tuple, spans)]
    grids = [*(size + np.array([-2.0, 0.0, 2.0]) for size in begin), *(np.linspace(a, b, 4) for a, b in spans)]
    starts = sorted(map(np.array, itertools.product(*grids)), key=loss)[:STARTS]
    ends = [scipy.optimize.minimize(loss, x, bounds=bounds, method="L-BFGS-B") for x in starts]
    best = min(ends, key=lambda end: float(end.fun)).x
    stds = {effect.name: math.exp(size) for effect, size in zip(effects, best, strict=False)}
    priors = {t.name: Prior(0.0, float(stds[t.effect.name])) for t in terms if t.name in model.priors}
    taus = {f"{e.name}.tau": float(math.exp(x)) for e, x in zip(free, best[len(effects) :], strict=True)}
    unseen = tuple(e.name for e, x, low in zip(effects, best, least, strict=False) if x < low + math.log(2.0))
    gained = loss(np.concatenate([first, given])) - loss(best)
    return replace(model.reshaped(**taus), priors={**model.priors, **priors}), gained, unseen


def refined(item: Hypothesis, s: Signals) -> Search[Hypothesis]:
    """A hypothesis whose shape parameters maximise the likelihood, each between its neighbours on the grid."""
    shape, least = dict(item.shape), math.nan
    for name, declared in item.effect.shapes.items():
        low, high = bounds_of(item, name, s)
        if not declared.refined or low == high:
            continue
        loss = profile_loss(item, shape, name, s)
        if math.isnan(least):
            least = yield from loss(shape[name])
        value, lowest = yield from minimum(loss, low, high)
        if lowest < least:
            shape[name], least = value, lowest
    return replace(item, shape=shape)


def profile_loss(
    item: Hypothesis, shape: Mapping[str, float], name: str, s: Signals
) -> Callable[[float], Search[float]]:
    """Minus the gain of a hypothesis as a function of one shape parameter, the others as in `shape`.

    Columns that are only scaled by it are filtered once.
    """
    scaled = item.effect.basis and item.effect.port == "process"
    size = sizes(item.effect, shape, s) if scaled else np.ones(1)
    first: list[tuple[Array, Array]] = []

    def loss(value: float) -> Search[float]:
        if not scaled:
            table, i = yield replace(item, shape={**shape, name: value})
            return -table.gain(i)[0]
        if not first:
            table, i = yield replace(item, shape=dict(shape))
            columns = table.columns[i]
            first.append((table.G[columns, columns], table.c[columns]))
        G, c = first[0]
        ratio = (sizes(item.effect, {**shape, name: value}, s) / size)[: len(c)]
        return -variance_gain(G * np.outer(ratio, ratio), c * ratio)[0]

    return loss


GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
"""Share of an interval at which a golden section divides it."""


def minimum(loss: Callable[[float], Search[float]], low: float, high: float) -> Search[tuple[float, float]]:
    """Place and value of the minimum of a loss between two bounds, to a thousandth of their distance.

    Golden sections and parabolas through the best three points (Brent 1973, chapter 5).
    """
    tolerance = 1e-3 * (high - low)
    x = low + GOLDEN * (high - low)
    y = yield from loss(x)
    best = second = third = (y, x)
    step = before = 0.0
    for _ in range(EVALUATIONS - 1):
        (y, x), middle = best, 0.5 * (low + high)
        least = ROOT_ROUNDING * abs(x) + tolerance / 3.0
        if abs(x - middle) <= 2.0 * least - 0.5 * (high - low):
            break
        section = True
        if abs(before) > least:
            r, q = (x - second[1]) * (y - third[0]), (x - third[1]) * (y - second[0])
            p, q = (x - third[1]) * q - (x - second[1]) * r, 2.0 * (q - r)
            p, q = (-p if q > 0.0 else p), abs(q)
            before, usual = step, before
            if abs(p) < abs(0.5 * q * usual) and q * (low - x) < p < q * (high - x):
                section, step = False, p / q
                if min(x + step - low, high - x - step) < 2.0 * least:
                    step = math.copysign(least, middle - x)
        if section:
            before = (low if x >= middle else high) - x
            step = GOLDEN * before
        trial = x + math.copysign(max(abs(step), least), step)
        value = yield from loss(trial)
        if value <= y:
            low, high = (x, high) if trial >= x else (low, x)
            best, second, third = (value, trial), best, second
        else:
            low, high = (trial, high) if trial < x else (low, trial)
            if value <= second[0] or second[1] == x:
                second, third = (value, trial), second
            elif value <= third[0] or third[1] in (x, second[1]):
                third = value, trial
    return best[1], best[0]


def grid_bracket(grid: Array, span: tuple[float, float], value: float) -> tuple[float, float]:
    """Values of the trial grid on either side of one of them, or the end of the span."""
    k = int(np.argmin(np.abs(grid - value)))
    return float(grid[k - 1]) if k > 0 else span[0], float(grid[k + 1]) if k + 1 < len(grid) else span[1]
