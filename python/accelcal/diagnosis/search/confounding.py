"""An effect that entered: what cannot be told from it, and what of it the model already holds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array
from accelcal.diagnosis.policy import (
    CLEAR_LOG_EVIDENCE,
    CONFOUNDED_CORRELATION,
    CONFOUNDED_LOG_EVIDENCE,
    RESOLVED_WAVE_PERIODS,
)
from accelcal.diagnosis.search.beam import Robust, Search
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.likelihood_gain import DEGENERATE_MIX, scale_of, score_gain
from accelcal.diagnosis.search.scores import CandidateScores
from accelcal.effects import HOUSE
from accelcal.model import Model, Prior
from accelcal.signals.signals import Signals

EMPTY = 1e-8
"""Share of the power of an item's strongest column below which another is taken for empty."""


@dataclass(frozen=True, slots=True)
class DetectedEffect:
    """An effect that entered, with its equivalence class and the experiment that would separate it."""

    effect: str
    shape: Mapping[str, float]
    members: tuple[str, ...]
    experiment: str
    prior_std: float | None = None
    """Intensity of a wandering bias; None for constant coefficients."""
    fixed: tuple[str, ...] = ()
    """Columns that are held at 0: what the model already contains, and what a coarse shape does without."""

    def enter(self, model: Model) -> Model:
        """Return the model with this effect; one that has its coarse shape gets the finer one."""
        if self.effect in model.effects:
            own = (term.name for term in model.terms if term.effect.name == self.effect)
            return model.release(*(name for name in own if name in model.fixed and name not in self.fixed))
        shapes = {self.effect: dict(self.shape)} if self.shape else None
        grown = model.add(self.effect, shapes=shapes)
        if self.prior_std is not None:
            std = self.prior_std
            names = [t.name for t in grown.terms if t.effect.name == self.effect]
            grown = model.add(self.effect, shapes=shapes, priors={n: Prior(0.0, std) for n in names})
        return grown.freeze(**dict.fromkeys(self.fixed, 0.0)) if self.fixed else grown


def members(evidence: CandidateScores, robust: Robust, i: int, others: Sequence[int], rules: Search) -> tuple[str, ...]:
    """Effects that cannot be told from item `i` on this record, itself first."""
    G, _ = evidence.after(others)
    gains, dofs = evidence.gains(others)
    gain, dof, estimate, _ = evidence.gain(i, others)
    item = evidence.items[i]
    inflation = robust.inflation(i, others)
    own = rules.price(gain / inflation, dof, item)
    reach = CONFOUNDED_LOG_EVIDENCE + max(0.0, CLEAR_LOG_EVIDENCE - own / 2.0)
    rivals: list[tuple[float, str]] = []
    for j, rival in enumerate(evidence.items):
        vague = item.effect.family or item.effect.port == "process"
        if j == i or j in others or (rival.effect.family and not vague):
            continue
        theirs, their_dof = float(gains[j]), int(dofs[j])
        if their_dof == 0:
            continue
        gap = (own - rules.evidence(theirs / inflation, their_dof, rival)) / 2.0
        if gap < reach or shared(evidence, G, i, j, estimate) > CONFOUNDED_CORRELATION:
            rivals.append((gap, rival.effect.name))
    return (item.effect.name, *(name for _, name in sorted(rivals)))


def shared(evidence: CandidateScores, G: Array, i: int, j: int, estimate: Array) -> float:
    """Correlation between what item `i` contributes and the nearest contribution of item `j`."""
    a, b = evidence.columns[i], evidence.columns[j]
    if "process" in (evidence.items[i].effect.port, evidence.items[j].effect.port):
        return 0.0
    power = float(estimate @ G[a, a] @ estimate)
    gain, dof, _, _ = score_gain(G[b, b], G[b, a] @ estimate, evidence.G[b, b])
    return math.sqrt(max(0.0, gain / power)) if power > 0.0 and dof else 0.0


def describe(
    evidence: CandidateScores, robust: Robust, chosen: tuple[int, ...], position: int, rules: Search
) -> DetectedEffect:
    """The effect at one place of the set, with its class and what would separate it."""
    i = chosen[position]
    others = tuple(j for k, j in enumerate(chosen) if k != position)
    item = evidence.items[i]
    G, _ = evidence.after(others)
    _, _, estimate, _ = evidence.gain(i, others)
    process = item.effect.port == "process"
    return DetectedEffect(
        effect=item.effect.name,
        shape=dict(item.shape),
        members=(*members(evidence, robust, i, others, rules), *smooth_alike(item, evidence.runs[0].carrier.signals)),
        experiment=item.effect.experiment.rstrip("."),
        prior_std=float(estimate[0]) if process else None,
        fixed=() if process else redundant(evidence, i, G),
    )


def smooth_alike(item: Hypothesis, s: Signals) -> tuple[str, ...]:
    """Shapes without a name that a wave cannot be told from as long as less than two of its periods fit on the rail:
    a part of a wave is any smooth function."""
    if RESOLVED_WAVE_PERIODS * item.shape.get("period", 0.0) <= float(np.ptp(s.p)):
        return ()
    return tuple(family.name for family in HOUSE if item.effect.name in family.covers)


def redundant(evidence: CandidateScores, i: int, G: Array) -> tuple[str, ...]:
    """Columns of an item's effect that it does without, or that the base and the item's other columns already contain
    (pivoted Cholesky)."""
    columns = evidence.columns[i]
    names = [term.name for term in evidence.items[i].terms]
    held = tuple(term.name for term in evidence.items[i].held)
    if len(names) == 1:
        return held
    power = np.diag(evidence.G[columns, columns])
    size = scale_of(power)
    A = G[columns, columns] / np.outer(size, size)
    kept: list[int] = []
    empty = power < EMPTY * np.max(power)
    for _ in names:
        left = np.diag(A).copy()
        left[kept] = left[empty] = 0.0
        k = int(np.argmax(left))
        if left[k] < DEGENERATE_MIX:
            break
        A = A - np.outer(A[:, k], A[k]) / A[k, k]
        kept.append(k)
    return (*(name for k, name in enumerate(names) if k not in kept), *held)
