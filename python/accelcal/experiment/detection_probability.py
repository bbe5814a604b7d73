"""How probable it is that anything enters when an effect is there: the rules of the search, applied to drawn scores.

The scores of all alternatives are normal, c ~ N(G theta, G) with G = their Gram matrix beside the base, so the search
is run on draws of c and no record is needed: every alternative at its trial shapes, the strongest ones at shapes
between those as well, the price of freedom, and the scatter of scores from block to block that significance is
divided by.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from accelcal.data.arrays import Array
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA, FINALISTS
from accelcal.diagnosis.search.beam import Search, block_length, tempered
from accelcal.diagnosis.search.hypotheses import Hypothesis, candidates_for
from accelcal.diagnosis.search.likelihood_gain import DEGENERATE_MIX, scale_of
from accelcal.diagnosis.search.scores import BaseProjection, CandidateScores
from accelcal.effects import Effect
from accelcal.estimation.run_state import RunState
from accelcal.model import Model

DRAWS = 4000
"""Draws that a probability is read from; it errs by 0.8 points at most."""
BETWEEN = 6
"""Shapes between two neighbours of a trial shape; the search finds the best one there by likelihood."""
INTENSITIES = np.linspace(-2.0, 9.0, 45)
"""Trial intensities of a wandering bias: logarithms, in units of the one that its best seen mode needs."""


@dataclass(frozen=True, slots=True)
class DetectionModel:
    """What takes part in the search of one run, before anything is known of its residual."""

    one: RunState
    model: Model
    items: Sequence[Hypothesis]
    evidence: CandidateScores
    """Of the items."""
    rules: Search

    @classmethod
    def of(
        cls, one: RunState, model: Model, extra: Sequence[Effect] = (), alpha: float = FAMILYWISE_ALPHA
    ) -> DetectionModel:
        """All that `diagnose` would look at on a run."""
        offered = candidates_for(one, model, extra)
        items = anywhere([item for item in offered if item.leading is None], one)
        return cls(one, model, items, evidence_of(one, model, items), rules_for(one, len(offered), alpha))

    def item(self, effect: str, shape: Mapping[str, float]) -> Hypothesis:
        """An effect at its own shape, which need not be one of the trials; what the record sets is left as it is."""
        trials = [item for item in self.items if item.effect.name == effect]
        known = trials[len(trials) // 2]
        return replace(known, shape={**known.shape, **shape})

    def distance(self, truth: Hypothesis, sizes: Array) -> float:
        """Standard deviations at which an effect stands from nothing, the base taken out."""
        A = self.evidence_of([truth]).G
        theta = coefficients(truth, sizes)[0]
        return math.sqrt(float(theta @ A @ theta))

    def detection(self, truth: Hypothesis, sizes: Array, draws: int = DRAWS) -> float:
        """Probability that anything enters when an effect is there.

        Parameters
        ----------
        truth : the effect at its own shape, which need not be one of the trials.
        sizes : (width,) its coefficients; for a wandering bias (1,), its intensity.
        draws : sets of scores that are drawn.
        """
        finalists = self.finalists(truth, sizes)
        closer = [other for item in finalists for other in between(item, self.one)]
        evidence = self.evidence_of([*self.items, *closer, truth])
        rng = np.random.default_rng(0)
        scores = drawn(evidence.G, rng, draws)
        scores += coefficients(truth, sizes, rng, draws) @ evidence.G[evidence.columns[-1]]
        luck = rng.standard_normal(draws)
        scatter = self.scatter(finalists, truth, sizes, luck)
        entered = np.zeros(draws, dtype=bool)
        for item, columns in zip(evidence.items, evidence.columns, strict=True):
            if item is truth and not picked(truth):
                continue
            gain, dof = gains(item, evidence.G[columns, columns], scores[:, columns])
            if dof > 0:
                significant, worth = self.rules.needed(dof, item)
                entered |= (gain > significant * scatter.get(item.effect.name, 1.0)) & (gain > worth)
        return float(np.mean(entered))

    def evidence_of(self, items: Sequence[Hypothesis]) -> CandidateScores:
        """Gram matrix of items beside what the model leaves free."""
        return evidence_of(self.one, self.model, items)

    def finalists(self, truth: Hypothesis, sizes: Array) -> list[Hypothesis]:
        """The effects that the truth lets gain most, each at the trial shape where it does."""
        nearest = min(
            (i for i, item in enumerate(self.items) if item.effect.name == truth.effect.name),
            key=lambda i: sum(abs(v - truth.shape[k]) / max(abs(v), 1e-12) for k, v in self.items[i].shape.items()),
        )
        G, columns = self.evidence.G, self.evidence.columns
        expected = coefficients(truth, sizes) @ G[columns[nearest]]
        best: dict[str, tuple[float, int]] = {}
        for i, item in enumerate(self.items):
            gain, dof = gains(item, G[columns[i], columns[i]], expected[:, columns[i]])
            if dof > 0:
                name = item.effect.name
                best[name] = max(best.get(name, (-math.inf, -1)), (float(gain[0]), i))
        return [self.items[i] for _, i in sorted(best.values(), reverse=True)[:FINALISTS]]

    def scatter(
        self, finalists: Sequence[Hypothesis], truth: Hypothesis, sizes: Array, luck: Array
    ) -> dict[str, Array]:
        """Draws of the ratio by which significance of each finalist is divided, at least 1; (draws,) by effect.

        Block scores s of a finalist's direction, taken from what all finalists leave over, have the covariance
        S = diag(w) - U U', w the share of each block in the direction's power and U what the finalists take. Their
        sum of squares is a weighted sum of chi-squares: by its first two moments (Satterthwaite 1946) a multiple of
        one, drawn with the cube-root law (Wilson, Hilferty 1931). Rivals see the same noise, hence one `luck`.
        """
        named = [truth if item.effect.name == truth.effect.name else item for item in finalists]
        kept = self.evidence_of([*named, truth])
        t, _, columns_of = (np.concatenate(each, axis=-1) for each in zip(*kept.rows(), strict=True))
        X = columns_of.T
        expected = coefficients(truth, sizes) @ kept.G[kept.columns[-1]]
        length = block_length(self.one)
        edges = np.flatnonzero(np.diff(np.floor(t / length), prepend=-1.0))
        values, vectors = np.linalg.eigh(unit(kept.G))
        good = values > 1e-9
        size = scale_of(np.diag(kept.G))
        Q = (X / size) @ (vectors[:, good] / np.sqrt(values[good]))
        found = {}
        for item, columns in zip(named, kept.columns, strict=False):
            if item.effect.port == "process":
                continue
            weights = np.linalg.pinv(kept.G[columns, columns], rcond=DEGENERATE_MIX) @ expected[0, columns]
            x = X[:, columns] @ weights
            power = float(x @ x)
            if power <= 0.0:
                continue
            w = np.add.reduceat(x**2, edges) / power
            U = np.add.reduceat(x[:, None] * Q, edges) / math.sqrt(power)
            S = np.diag(w) - U @ U.T
            mean, variance = float(np.trace(S)), 2.0 * float(np.sum(S**2))
            a = variance / mean**2 / 9.0  # 2/(9 nu), nu = 2 mean²/variance
            found[item.effect.name] = tempered(mean * (1.0 - a + luck * math.sqrt(a)) ** 3, w)
        return found


def evidence_of(one: RunState, model: Model, items: Sequence[Hypothesis]) -> CandidateScores:
    """Gram matrix of the candidates with everything that the model leaves free projected out."""
    return CandidateScores([BaseProjection(one, model)], items)


def anywhere(items: Sequence[Hypothesis], one: RunState) -> list[Hypothesis]:
    """Items in which picked shapes stand evenly over their span, not where this record happened to be loud."""
    s = one.signals
    assert s is not None
    found = [item for item in items if not item.near]
    for item in {item.effect.name: item for item in items if item.near}.values():
        for name in item.near:
            grid = item.effect.shapes[name].grid(s)
            found += [replace(item, shape={**item.shape, name: float(value)}, near={}) for value in grid]
    return found


def rules_for(one: RunState, examined: int, alpha: float) -> Search:
    """Rules by which an effect would enter, as `diagnose` would apply them."""
    seconds = float(np.sum(one.counts)) * one.run.reading_step
    return Search(examined, int(seconds / block_length(one)), alpha)


def picked(item: Hypothesis) -> bool:
    """Whether the search tries the instants at which a record is loud, and so meets the very instant of the truth."""
    return item.effect.port == "position" and "instant" in item.shape


def between(item: Hypothesis, one: RunState) -> list[Hypothesis]:
    """The item at shapes between the neighbours of its trial shape, where the search refines it."""
    s = one.signals
    assert s is not None
    choices: list[list[tuple[str, float]]] = []
    for name, declared in item.effect.shapes.items():
        value = item.shape[name]
        grid = declared.grid(s)
        if len(grid) < 2 or picked(item):
            choices.append([(name, value)])
            continue
        k = int(np.argmin(np.abs(grid - value)))
        low, high = declared.span(s)
        below = float(grid[k - 1]) if k > 0 else low
        above = float(grid[k + 1]) if k + 1 < len(grid) else high
        choices.append([(name, float(v)) for v in np.linspace(below, above, BETWEEN + 2)[1:-1]])
    shapes = [dict(choice) for choice in product(*choices)]
    return [replace(item, shape=shape) for shape in shapes if shape != dict(item.shape)]


def drawn(G: Array, rng: np.random.Generator, draws: int) -> Array:
    """Scores that noise alone gives, (draws, columns), with covariance `G`."""
    size = np.sqrt(np.maximum(np.diag(G), 0.0))
    values, vectors = np.linalg.eigh(unit(G))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(rng.standard_normal((draws, len(G))) @ root.T * size)


def unit(G: Array) -> Array:
    """A Gram matrix scaled to a diagonal of ones."""
    size = scale_of(np.diag(G))
    return np.asarray(G / np.outer(size, size))


def coefficients(truth: Hypothesis, sizes: Array, rng: np.random.Generator | None = None, draws: int = 1) -> Array:
    """Coefficients of the truth in each draw, (draws, width) or (1, width); those of a wandering bias are random."""
    if truth.effect.port != "process":
        return np.atleast_2d(sizes)
    if rng is None:
        return np.full((1, truth.effect.width), float(sizes[0]))
    return np.asarray(sizes[0] * rng.standard_normal((draws, truth.effect.width)))


def gains(item: Hypothesis, A: Array, b: Array) -> tuple[Array, int]:
    """Twice the log-likelihood gain of an item in each draw, (draws,), and its degrees of freedom.

    As the search computes them for one record (`score_gain`, `variance_gain`).
    """
    if item.effect.port == "process":
        return wandering_gains(A, b), 1
    if item.effect.width == 1:
        if A[0, 0] <= 0.0:
            return np.zeros(len(b)), 0
        gain = b[:, 0] ** 2 / A[0, 0]
        return (np.where(b[:, 0] > 0.0, gain, 0.0) if item.effect.traits.positive else gain), 1
    values, vectors = np.linalg.eigh(unit(A))
    good = values > DEGENERATE_MIX
    size = scale_of(np.diag(A))
    return np.sum(((b / size) @ (vectors[:, good] / np.sqrt(values[good]))) ** 2, axis=1), int(np.sum(good))


def wandering_gains(A: Array, b: Array) -> Array:
    """max_s [b'(I/s² + A)^-1 b - log det(I + s² A)] in each draw, over a fine grid of s."""
    values, vectors = np.linalg.eigh(A)
    values = np.maximum(values, 0.0)
    s2 = np.exp(2.0 * INTENSITIES) / max(float(np.max(values)), 1e-300)
    weights = s2 / (1.0 + s2 * values[:, None])
    told = (b @ vectors) ** 2 @ weights - np.sum(np.log1p(s2 * values[:, None]), axis=0)
    return np.asarray(np.maximum(np.max(told, axis=1), 0.0))
