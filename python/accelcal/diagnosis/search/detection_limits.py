"""Detection limits: the smallest coefficient that a record would have shown, for `diagnose` and `power` alike."""

from __future__ import annotations

import math

import numpy as np

from accelcal.diagnosis.search.beam import SearchRules
from accelcal.diagnosis.search.likelihood_gain import DEGENERATE, score_gain
from accelcal.diagnosis.search.scores import CandidateScores
from accelcal.diagnosis.search.thresholds import distance_for_gain


def detectable_sizes(
    evidence: CandidateScores, i: int, rules: SearchRules
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Standard deviations per unit coefficient of each part of a hypothesis, and the sizes that are found with 95 %.

    A size is infinite where the part is not visible: the base contains it, or at that size it would move the readings
    as
    much as the motion itself. A random process has one part, with the information of all its columns.
    """
    item, columns = evidence.items[i], evidence.columns[i]
    A, own, left = evidence.G[columns, columns], evidence.own[columns], evidence.beyond_line[columns]
    dof = score_gain(A, evidence.c[columns])[1]
    information = np.diag(A)
    if item.effect.port == "process":
        information, own, left = (np.array([y.sum()]) for y in (information, own, left))
        dof = 1
    d = np.sqrt(np.maximum(information, 0.0))
    if dof == 0:
        return tuple(d.tolist()), (math.inf,) * len(d)
    distance = distance_for_gain(max(rules.required_gains(dof, item)), dof)
    beyond_motion = distance**2 * own > d**2 * (evidence.motion or math.inf)
    invisible = (information <= DEGENERATE * left) | beyond_motion
    return tuple(d.tolist()), tuple(
        math.inf if unseen else distance / x for unseen, x in zip(invisible.tolist(), d, strict=True)
    )


def detection_limits(evidence: CandidateScores, rules: SearchRules) -> dict[str, float]:
    """Smallest coefficient of each effect that this record would have shown with 95 % probability.

    Taken at the trial shape and for the part with the smallest limit; infinite where the effect is not visible on this
    record. Random processes are left to `power`.
    """
    found: dict[str, float] = {}
    for i, item in enumerate(evidence.items):
        if item.effect.port != "process" and item.leading is None:
            found[item.effect.name] = min(
                *detectable_sizes(evidence, i, rules)[1], found.get(item.effect.name, math.inf)
            )
    return found
