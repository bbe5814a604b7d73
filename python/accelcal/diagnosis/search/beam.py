"""Beam search over sets of effects: what enters, at what price, checked block by block."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array
from accelcal.diagnosis.policy import (
    BEAM_WIDTH,
    BLOCK_SECONDS,
    DEFERRED_GAIN_SHARE,
    FAMILY_DISCOUNT,
    MODEL_NOISE_BLOCKS,
    RANDOM_BIAS_DISCOUNT,
    SEARCH_DEPTH,
)
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.likelihood_gain import log_survival, scale_of
from accelcal.diagnosis.search.scores import CandidateScores
from accelcal.diagnosis.search.thresholds import entry_gains
from accelcal.estimation.run_state import RunState

NOTHING_LEFT = 1e-9
"""Share of an item's power below which those before it contain it."""


@dataclass(frozen=True, slots=True)
class Search:
    """Rules by which effects enter: significance over all alternatives, and what freedom costs."""

    examined: int
    blocks: int
    alpha: float

    @property
    def threshold(self) -> float:
        """Log probability below which one of the alternatives is significant."""
        return math.log(self.alpha / max(1, self.examined))

    def significant(self, gain: float, dof: int, item: Hypothesis) -> bool:
        """Whether a gain is beyond what the best of all alternatives would show by chance."""
        return dof > 0 and chance(gain, dof, item) < self.threshold

    def price(self, gain: float, dof: int, item: Hypothesis) -> float:
        """Gain less what an effect pays for its freedom, for having been picked, and for having no name or course."""
        return self.evidence(gain * (RANDOM_BIAS_DISCOUNT if item.effect.port == "process" else 1.0), dof, item)

    def evidence(self, gain: float, dof: int, item: Hypothesis) -> float:
        """The same of a bias that wanders as if it had a course: who follows any course cannot be told from it."""
        told = gain * (FAMILY_DISCOUNT if item.effect.family else 1.0)
        looks = max(self.examined, 2) * item.looks
        return told - (dof + item.further) * math.log(max(self.blocks, 2)) - 2.0 * math.log(looks)

    def needed(self, dof: int, item: Hypothesis) -> tuple[float, float]:
        """Gain of an item that is significant, and gain that is worth its price."""
        share = FAMILY_DISCOUNT if item.effect.family else 1.0
        return entry_gains(
            self.examined, self.blocks, self.alpha, dof=dof, looks=item.looks, share=share, further=item.further
        )

    def best(self, evidence: CandidateScores, robust: Robust | None = None) -> tuple[int, ...]:
        """The set whose gain exceeds its price most, every member significant beside all others, strongest first."""
        sets = {self.sound(evidence, robust, one) for one in self.beam(evidence, robust)}
        return max(sets, key=lambda one: self.worth(evidence, one))

    def sound(self, evidence: CandidateScores, robust: Robust | None, chosen: tuple[int, ...]) -> tuple[int, ...]:
        """Those of a set that are significant beside all others of them, strongest first."""
        kept = sorted(chosen)
        while len(kept) > 1:
            beside = [(self.told(evidence, robust, i, [j for j in kept if j != i]), i) for i in kept]
            idle = [i for value, i in beside if value == -math.inf]
            if not idle:
                break
            kept.remove(min(idle, key=lambda i: self.told(evidence, None, i, ())))
        ordered: list[int] = []
        while kept:
            ordered.append(max(kept, key=lambda i: self.told(evidence, None, i, ordered)))
            kept.remove(ordered[-1])
        return tuple(ordered)

    def worth(self, evidence: CandidateScores, ordered: Sequence[int]) -> float:
        """Gain less price of a set, one after the other."""
        return sum(self.told(evidence, None, i, ordered[:k]) for k, i in enumerate(ordered))

    def told(self, evidence: CandidateScores, robust: Robust | None, i: int, given: Sequence[int]) -> float:
        """Gain less price of an item beside others; minus infinity where it is not significant there."""
        gains, dofs = evidence.gains(given)
        gain, dof = float(gains[i]), int(dofs[i])
        sure = gain if robust is None else gain / robust.inflation(i, given)
        if robust is not None and not self.significant(sure, dof, evidence.items[i]):
            return -math.inf
        return self.price(gain, dof, evidence.items[i])

    def beam(self, evidence: CandidateScores, robust: Robust | None = None) -> list[tuple[int, ...]]:
        """Beam search: the best set, then every set that was kept on the way."""
        beam: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
        best: tuple[float, tuple[int, ...]] = (0.0, ())
        seen: list[tuple[int, ...]] = []
        for _ in range(SEARCH_DEPTH):
            grown: dict[frozenset[int], tuple[float, tuple[int, ...]]] = {}
            for total, chosen in beam:
                for value, i in self.options(evidence, chosen, robust):
                    key = frozenset((*chosen, i))
                    if key not in grown or grown[key][0] < total + value:
                        grown[key] = (total + value, (*chosen, i))
            beam = self.diverse(evidence, sorted(grown.values(), reverse=True))
            if not beam:
                break
            best = max(best, beam[0])
            seen += [chosen for _, chosen in beam]
        return [best[1], *seen]

    def options(
        self, evidence: CandidateScores, chosen: tuple[int, ...], robust: Robust | None
    ) -> list[tuple[float, int]]:
        """What may enter after a set, best first."""
        gains, dofs = evidence.gains(chosen)
        taken = {evidence.items[i].effect.name for i in chosen}
        found: list[tuple[float, int]] = []
        first = float(evidence.gains()[0][chosen[0]]) if chosen else 0.0
        for i, item in enumerate(evidence.items):
            if item.effect.name in taken:
                continue
            gain, dof = float(gains[i]), int(dofs[i])
            if gain < DEFERRED_GAIN_SHARE * first or not self.significant(gain, dof, item):
                continue
            if robust is not None and not self.significant(gain / robust.inflation(i, chosen), dof, item):
                continue
            found.append((self.price(gain, dof, item), i))
        return sorted(found, reverse=True)

    def diverse(
        self, evidence: CandidateScores, ranked: Sequence[tuple[float, tuple[int, ...]]]
    ) -> list[tuple[float, tuple[int, ...]]]:
        """The best sets, at most one for each choice of effects, so that trial shapes do not crowd the beam."""
        kept: dict[frozenset[str], tuple[float, tuple[int, ...]]] = {}
        for value, chosen in ranked:
            names = frozenset(evidence.items[i].effect.name for i in chosen)
            if names not in kept:
                kept[names] = (value, chosen)
            if len(kept) == BEAM_WIDTH:
                break
        return list(kept.values())


def chance(gain: float, dof: int, item: Hypothesis) -> float:
    """Log probability of a gain where nothing is, over the values that the item was picked from."""
    return log_survival(gain, dof) + math.log(item.looks)


def block_length(one: RunState) -> float:
    """Stretch of a record whose scores are independent of the next, s: two periods of the crossover, or 0.25 s."""
    periods = 2.0 / one.run.crossover(one.noise)
    span = float(one.run.t[-1] - one.run.t[0])
    return max(periods, min(BLOCK_SECONDS, span / 80.0))


class Robust:
    """How much more the scores of the finalists scatter from block to block than the model says.

    Scatter is taken from what all finalists together leave over, so that one missing effect does not pass for
    uncertainty of another. An effect that lives in a few blocks, such as a step, has little scatter to measure: the
    fewer they are, the more the noise of the model counts.
    """

    def __init__(self, evidence: CandidateScores, length: float) -> None:
        self.evidence = evidence
        size = scale_of(np.diag(evidence.G))
        scaled = evidence.G / np.outer(size, size) + 1e-9 * np.eye(len(size))
        every = np.linalg.solve(scaled, evidence.c / size) / size
        parts = [block_sums(np.concatenate([X * (y - every @ X), X**2]), t, length) for t, y, X in evidence.rows()]
        _, block = np.unique(np.concatenate([blocks for blocks, _ in parts]), return_inverse=True)
        sums = np.zeros((2 * len(evidence.G), int(block[-1]) + 1))
        np.add.at(sums.T, block, np.concatenate([sums for _, sums in parts], axis=1).T)
        self.scores, self.powers = np.split(sums, 2)
        """Score of each column in each block, and what it may vary by, (m, blocks) each."""
        self.known: dict[tuple[int, tuple[int, ...]], float] = {}

    def inflation(self, i: int, given: Sequence[int]) -> float:
        """Ratio of block scatter to model variance of an item's score, at least 1."""
        key = (i, tuple(sorted(given)))
        if key not in self.known:
            self.known[key] = self._inflation(*key)
        return self.known[key]

    def _inflation(self, i: int, given: tuple[int, ...]) -> float:
        e = self.evidence
        _, dof, estimate, _ = e.gain(i, given)
        if e.items[i].effect.port == "process" or dof == 0:
            return 1.0
        own = e.columns[i]
        direction = np.zeros(len(e.G))
        direction[own] = estimate
        if given:
            rows = np.concatenate([np.arange(e.columns[j].start, e.columns[j].stop) for j in given])
            weights, *_ = np.linalg.lstsq(e.G[np.ix_(rows, rows)], e.G[rows, own] @ estimate, rcond=1e-9)
            direction[rows] = -weights
        power = float(direction @ e.G @ direction)
        if power <= NOTHING_LEFT * float(estimate @ e.G[own, own] @ estimate):
            return 1.0
        scores = direction @ self.scores
        return float(tempered(float(scores @ scores) / power, direction**2 @ self.powers))


def tempered(ratio: float | Array, shares: Array) -> Array:
    """What is believed of a ratio of block scatter to model variance, at least 1, where the blocks hold these shares of
    an effect's power: as if eight more had scattered as the model says."""
    blocks = float(np.sum(shares)) ** 2 / float(shares @ shares)
    return np.maximum(1.0, (blocks * np.asarray(ratio) + MODEL_NOISE_BLOCKS) / (blocks + MODEL_NOISE_BLOCKS))


def block_sums(rows: Array, t: Array, length: float) -> tuple[Array, Array]:
    """Numbers of the blocks of time that a stretch meets, and the sums of each row of (m, n) over them, (m, blocks)."""
    block = np.floor(t / length)
    begins = np.flatnonzero(np.diff(block, prepend=-1.0))
    return block[begins], np.add.reduceat(rows, begins, axis=1)
