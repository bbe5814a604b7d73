"""Which effects deserve a closer look, and their shape parameters by likelihood."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from accelcal.diagnose.candidates import Item
from accelcal.diagnose.evidence import Evidence, Known
from accelcal.diagnose.gains import variance_gain
from accelcal.diagnose.multiples import sizes
from accelcal.diagnose.search import Search, chance
from accelcal.recording import Array

FINALISTS = 8
"""Effects whose shapes are refined and whose scores are checked block by block."""
EVALUATIONS = 14
"""Trials of each shape parameter."""


def shortlist(evidence: Evidence, sets: Sequence[tuple[int, ...]], rules: Search) -> list[int]:
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


def refine(evidence: Evidence, finalists: Sequence[int]) -> list[Item]:
    """Finalists, one for each effect, with shape parameters by likelihood."""
    items = evidence.items
    first = {items[i].effect.name: i for i in reversed(finalists)}
    names = dict.fromkeys(items[i].effect.name for i in finalists)
    return [refined(evidence.runs, items[first[name]], evidence.gain(first[name])[0]) for name in names]


def refined(runs: Sequence[Known], item: Item, gain: float) -> Item:
    """An item whose shape parameters lie where the likelihood is largest, each between its neighbours on the grid.

    `gain` is what it gains as it is.
    """
    s = runs[0].carrier.signals
    shape = dict(item.shape)
    for name, declared in item.effect.shapes.items():
        grid = declared.grid(s)
        bounds = item.near.get(name) or neighbours(grid, declared.span(s), shape[name])
        if len(grid) < 2 or bounds[0] == bounds[1]:
            continue
        loss = along(runs, item, shape, name)
        options = {"xatol": 1e-3 * (bounds[1] - bounds[0]), "maxiter": EVALUATIONS}
        best = scipy.optimize.minimize_scalar(loss, bounds=bounds, method="bounded", options=options)
        if -float(best.fun) > gain:
            shape[name], gain = float(best.x), -float(best.fun)
    return replace(item, shape=shape)


def along(runs: Sequence[Known], item: Item, shape: Mapping[str, float], name: str) -> Callable[[float], float]:
    """Minus the gain of an item as a function of one shape parameter, the others as in `shape`; columns that only grow
    and shrink with it are carried once."""
    if not (item.effect.basis and item.effect.port == "process"):
        return lambda value: -Evidence(runs, [replace(item, shape={**shape, name: value})]).gain(0)[0]
    s = runs[0].carrier.signals
    once, size = Evidence(runs, [replace(item, shape=dict(shape))]), sizes(item.effect, shape, s)

    def resized(value: float) -> float:
        times = (sizes(item.effect, {**shape, name: value}, s) / size)[: len(once.c)]
        return -variance_gain(once.G * np.outer(times, times), once.c * times)[0]

    return resized


def neighbours(grid: Array, span: tuple[float, float], value: float) -> tuple[float, float]:
    """Values of the trial grid on either side of one of them, or the end of the span."""
    k = int(np.argmin(np.abs(grid - value)))
    return float(grid[k - 1]) if k > 0 else span[0], float(grid[k + 1]) if k + 1 < len(grid) else span[1]
