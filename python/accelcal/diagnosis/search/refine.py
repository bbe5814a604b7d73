"""Which effects deserve a closer look, and their shape parameters by likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.diagnosis.search.beam import Search, chance
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.likelihood_gain import variance_gain
from accelcal.diagnosis.search.scores import BaseProjection, CandidateScores
from accelcal.estimation.columns import sizes
from accelcal.signals.signals import Signals

FINALISTS = 8
"""Effects whose shapes are refined and whose scores are checked block by block."""
BESIDE = 0.5
"""Share of the largest gain from which an effect is looked at beside its trial shapes as well."""
EVALUATIONS = 14
"""Trials of each shape parameter."""


def shortlist(evidence: CandidateScores, sets: Sequence[tuple[int, ...]], rules: Search) -> list[int]:
    """Items worth refining: all that the search kept, and the strongest rivals at each place of its best set.

    Each at the trial shape and fineness at which it exceeds its price most; where it never does, is least by chance.
    """
    chosen = sets[0]
    kept = list(dict.fromkeys(i for one in sets for i in one))
    names = {evidence.items[i].effect.name for i in kept}
    for position in range(max(1, len(chosen))):
        gains, dofs = evidence.gains(tuple(i for k, i in enumerate(chosen) if k != position))
        best: dict[str, int] = {}
        told = list(zip(gains.tolist(), dofs.tolist(), evidence.items, strict=True))
        worth = [(max(rules.price(*one), 0.0), -chance(*one)) for one in told]
        for i in np.flatnonzero(dofs).tolist():
            name = evidence.items[i].effect.name
            best[name] = max(best.get(name, i), i, key=lambda j: worth[j])
        strongest = sorted(best.values(), key=lambda i: told[i][0] - told[i][1], reverse=True)[:FINALISTS]
        kept += [i for i in strongest if evidence.items[i].effect.name not in names]
        names |= {evidence.items[i].effect.name for i in strongest}
    return kept


def starts(evidence: CandidateScores, finalists: Sequence[int], rules: Search) -> list[tuple[Hypothesis, ...]]:
    """Finalists to refine, one item for each effect: as the best set has them, and as each is most by itself.

    A rival that is not as sharp takes the place of an effect all of whose trials lie beside the right shape, and a set
    then holds what that leaves. Alone, effects are therefore looked at between their trials as well.
    """
    together: dict[str, Hypothesis] = {}
    for i in finalists:
        together.setdefault(evidence.items[i].effect.name, evidence.items[i])
    most = max((evidence.gain(i)[0] for i in finalists), default=0.0)
    more = [item for name in together for item in between_trials(evidence, name, BESIDE * most)]
    looked = [evidence, CandidateScores(evidence.runs, more)] if more else [evidence]
    worth: dict[str, float] = {}
    alone: dict[str, Hypothesis] = {}
    for one in looked:
        for item, gain, dof in zip(one.items, *one.gains(), strict=True):
            name, value = item.effect.name, rules.price(float(gain), int(dof), item)
            if name in together and value > worth.get(name, 0.0):
                worth[name], alone[name] = value, item
    s = evidence.runs[0].carrier.signals
    apart = {
        name: item if name not in alone or reaches(item, alone[name].shape, s) else alone[name]
        for name, item in together.items()
    }
    return [tuple(one.values()) for one in ([together] if apart == together else [together, apart])]


def reaches(item: Hypothesis, shape: Mapping[str, float], s: Signals) -> bool:
    """Whether refining an item looks at a shape."""
    for name, declared in item.effect.shapes.items():
        low, high = bounds_of(item, name, s) if declared.refined else (item.shape[name], item.shape[name])
        if not low <= shape[name] <= high:
            return False
    return True


def bounds_of(item: Hypothesis, name: str, s: Signals) -> tuple[float, float]:
    """Where a shape parameter of an item may be refined."""
    declared = item.effect.shapes[name]
    return item.near.get(name) or neighbours(declared.grid(s), declared.span(s), item.shape[name])


def between_trials(evidence: CandidateScores, name: str, enough: float) -> list[Hypothesis]:
    """Items between the trial shapes of an effect, beside those that gain enough."""
    trials = [(evidence.gain(j)[0], item) for j, item in enumerate(evidence.items) if item.effect.name == name]
    s = evidence.runs[0].carrier.signals
    found: dict[tuple[float | None, ...], Hypothesis] = {}
    for gain, item in trials:
        sought = item.effect.shapes.items() if gain > enough and item.effect.port != "process" else ()
        for shape, declared in sought:
            grid, value = declared.grid(s), item.shape[shape]
            if len(grid) < 2 or shape in item.near:
                continue
            before, after = neighbours(grid, (value, value), value)
            for low, high in ((before, value), (value, after)):
                if low < high:
                    middle = math.sqrt(low * high) if declared.spacing == "log" else 0.5 * (low + high)
                    there = {**item.shape, shape: middle}
                    near = {**item.near, shape: (low, high)}
                    found[(*there.values(), item.leading)] = replace(item, shape=there, near=near)
    return list(found.values())


def refine(runs: Sequence[BaseProjection], several: Sequence[Sequence[Hypothesis]]) -> list[list[Hypothesis]]:
    """Items of several lists with shape parameters by likelihood; who stands in more than one is refined once."""
    known: dict[int, Hypothesis] = {}
    for item in (item for some in several for item in some):
        known[id(item)] = known.get(id(item)) or refined(runs, item)
    return [[known[id(item)] for item in some] for some in several]


def refined(runs: Sequence[BaseProjection], item: Hypothesis) -> Hypothesis:
    """An item whose shape parameters lie where the likelihood is largest, each between its neighbours on the grid."""
    s = runs[0].carrier.signals
    shape, gain = dict(item.shape), math.nan
    for name, declared in item.effect.shapes.items():
        bounds = bounds_of(item, name, s)
        if not declared.refined or bounds[0] == bounds[1]:
            continue
        loss = direction(runs, item, shape, name)
        gain = -loss(shape[name]) if math.isnan(gain) else gain
        options = {"xatol": 1e-3 * (bounds[1] - bounds[0]), "maxiter": EVALUATIONS}
        best = scipy.optimize.minimize_scalar(loss, bounds=bounds, method="bounded", options=options)
        if -float(best.fun) > gain:
            shape[name], gain = float(best.x), -float(best.fun)
    return replace(item, shape=shape)


def direction(
    runs: Sequence[BaseProjection], item: Hypothesis, shape: Mapping[str, float], name: str
) -> Callable[[float], float]:
    """Minus the gain of an item as a function of one shape parameter, the others as in `shape`; columns that only grow
    and shrink with it are carried once."""
    if not (item.effect.basis and item.effect.port == "process"):
        return lambda value: -CandidateScores(runs, [replace(item, shape={**shape, name: value})]).gain(0)[0]
    s = runs[0].carrier.signals
    once, size = CandidateScores(runs, [replace(item, shape=dict(shape))]), sizes(item.effect, shape, s)

    def resized(value: float) -> float:
        times = (sizes(item.effect, {**shape, name: value}, s) / size)[: len(once.c)]
        return -variance_gain(once.G * np.outer(times, times), once.c * times)[0]

    return resized


def neighbours(grid: Array, span: tuple[float, float], value: float) -> tuple[float, float]:
    """Values of the trial grid on either side of one of them, or the end of the span."""
    k = int(np.argmin(np.abs(grid - value)))
    return float(grid[k - 1]) if k > 0 else span[0], float(grid[k + 1]) if k + 1 < len(grid) else span[1]
