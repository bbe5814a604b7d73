"""How small an effect a record would still have shown: what diagnosis and `power` both say."""

from __future__ import annotations

import math

import numpy as np

from accelcal.diagnosis.search.beam import Search
from accelcal.diagnosis.search.likelihood_gain import DEGENERATE, score_gain
from accelcal.diagnosis.search.scores import CandidateScores
from accelcal.diagnosis.search.thresholds import surely_beyond


def sizes(evidence: CandidateScores, i: int, rules: Search) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Standard deviations per unit coefficient of each part of an item, and the sizes that are found with 95 %.

    A size is infinite where the part is not visible: the base swallows it, or at that size it would move the readings
    as much as the motion itself. A wandering bias has one part, with the information of all its columns.
    """
    item, columns = evidence.items[i], evidence.columns[i]
    A, own = evidence.G[columns, columns], evidence.own[columns]
    dof = score_gain(A, evidence.c[columns])[1]
    information = np.diag(A)
    if item.effect.port == "process":
        information, own, dof = np.sum(information, keepdims=True), np.sum(own, keepdims=True), 1
    d = np.sqrt(np.maximum(information, 0.0))
    if dof == 0:
        return tuple(d.tolist()), (math.inf,) * len(d)
    needed = surely_beyond(max(rules.needed(dof, item)), dof)
    loud = needed**2 * own > d**2 * (evidence.motion or math.inf)
    hidden = (information <= DEGENERATE * own) | loud
    return tuple(d.tolist()), tuple(math.inf if no else needed / x for no, x in zip(hidden.tolist(), d, strict=True))


def limits(evidence: CandidateScores, rules: Search) -> dict[str, float]:
    """Smallest coefficient of each effect that this record would have shown with 95 % probability.

    At the trial shape and of the part that is seen best; infinite where it is not visible on this record. What
    `power` says too; a wandering bias is left to it.
    """
    found: dict[str, float] = {}
    for i, item in enumerate(evidence.items):
        if item.effect.port != "process" and item.leading is None:
            found[item.effect.name] = min(*sizes(evidence, i, rules)[1], found.get(item.effect.name, math.inf))
    return found
