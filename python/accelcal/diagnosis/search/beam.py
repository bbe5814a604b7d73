"""Beam search over sets of effects: which enter, thresholds and price, and whether their scores scatter as modelled.

The gain of an effect with `dof` coefficients at a distance of d standard deviations from zero is noncentral chi-square
with noncentrality d² (derivations D3.5). The effect enters when its gain is significant over all alternatives and
exceeds its price.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy import optimize, special

from accelcal.data import Array
from accelcal.data.arrays import VANISHING
from accelcal.diagnosis.policy import (
    BEAM_WIDTH,
    BLOCK_SECONDS,
    DEFERRED_GAIN_SHARE,
    DETECTION_PROBABILITY,
    INDEPENDENT_PIECES,
    MODEL_NOISE_BLOCKS,
    SEARCH_DEPTH,
)
from accelcal.diagnosis.search.homogeneity import PartScores, PartSizes, direction_of, exempt
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.scores import CandidateScores, log_survival, scaled_gram
from accelcal.effects import SizePrior
from accelcal.estimation.run_state import RunState


def entry_gains(
    examined: int,
    blocks: int,
    alpha: float,
    *,
    dof: int = 1,
    comparisons: int = 1,
    trials: int = 1,
) -> tuple[float, float]:
    """Gain that is significant over all alternatives, and gain that equals its price; an effect needs both.

    Parameters
    ----------
    examined : number of alternatives.
    blocks : effective blocks of the record, which set the price of a coefficient.
    alpha : family-wise false-alarm rate.
    dof : coefficients of the effect.
    comparisons : alternatives among which the effect was selected before it was tried.
    trials : shapes of it that are tried, which share its price and of which each is one of `examined`.
    """
    tail = alpha / (max(1, examined) * comparisons)
    significant = 2.0 * float(special.gammainccinv(dof / 2.0, tail))
    price = dof * math.log(max(blocks, 2)) + 2.0 * math.log(max(examined, 2) * max(comparisons, trials))
    return significant, INDEPENDENT_PIECES * math.expm1(price / INDEPENDENT_PIECES)


def size_given_choice(z: float, threshold: float, share: float = 1.0) -> tuple[float, float, float]:
    """Median-unbiased size of an effect that entered because its estimate exceeded a threshold, and the ends of its
    exact 95 % interval, all in standard deviations of the estimate.

    Parameters
    ----------
    z : the estimate.
    threshold : what the estimate from the part that chose it had to exceed, on either side.
    share : of its information, that of that part; 1 where it is fitted to the data that chose it.

    Notes
    -----
    Distribution of an estimate given its selection (Lee et al. 2016; of a part, Tian and Taylor 2018): the normal
    density of z times the probability that the part exceeds the threshold. The medians of the first are Hedges's
    (1984) and Zhong and Prentice's (2008).

    Examples
    --------
    >>> [round(x, 2) for x in size_given_choice(4.5, 4.2)]
    [2.43, -0.24, 6.14]
    >>> [round(x, 2) for x in size_given_choice(8.0, 4.2)]
    [8.0, 6.03, 9.96]
    """
    edge, z = threshold / math.sqrt(share), abs(z)
    far = max(z, edge) + 20.0
    ends = sorted({-far, -edge, edge, z, far})
    u = np.concatenate([np.linspace(*pair, 2000) for pair in pairwise(ends)])
    width = math.sqrt(max(1.0 - share, 1e-12) / share)
    passed = special.ndtr((u - edge) / width) + special.ndtr((-u - edge) / width)
    beyond = 2000 * ends.index(z)

    def above(size: float) -> float:
        exponent = -0.5 * (u - size) ** 2
        density = passed * np.exp(exponent - np.max(exponent[passed > 0.0]))
        return float(np.trapezoid(density[beyond:], u[beyond:]) / np.trapezoid(density, u))

    def size_at(share_above: float) -> float:
        return float(optimize.brentq(lambda size: above(size) - share_above, -z - 8.0, z + 8.0))

    return size_at(0.5), size_at(0.025), size_at(0.975)


def saturated(gain: float) -> float:
    """Gain of a record whose shapes and motion are not exact: n log(1 + g/n), `INDEPENDENT_PIECES` for n."""
    return INDEPENDENT_PIECES * math.log1p(max(gain, 0.0) / INDEPENDENT_PIECES)


def distance_for_gain(gain: float, dof: int) -> float:
    """Distance from zero, in standard deviations, at which an effect of `dof` coefficients gains `gain` or more with
    probability `DETECTION_PROBABILITY`."""
    return math.sqrt(float(special.chndtrinc(gain, dof, 1.0 - DETECTION_PROBABILITY)))


@dataclass(frozen=True, slots=True)
class SearchRules:
    """Rules by which effects enter: significance over all alternatives, and the price of coefficients."""

    examined: int
    blocks: int
    alpha: float
    priors: Mapping[str, SizePrior] | None = field(default_factory=dict)
    """Priors of sizes by effect, in place of the catalogue's; None = weights are those by the record alone."""

    @classmethod
    def of(cls, state: RunState, examined: int, alpha: float) -> SearchRules:
        """Those of a run by itself."""
        seconds = float(np.sum(state.counts)) * state.run.reading_step
        return cls(examined, int(seconds / block_length(state)), alpha)

    @property
    def entry_sigma(self) -> float:
        """Standard deviations at which an effect of one coefficient enters."""
        return math.sqrt(max(entry_gains(self.examined, self.blocks, self.alpha)))

    @property
    def threshold(self) -> float:
        """Log probability below which one of the alternatives is significant."""
        return math.log(self.alpha / max(1, self.examined))

    def significant(self, gain: float, dof: int, item: Hypothesis) -> bool:
        """Whether a gain exceeds what the best of all alternatives reaches by chance."""
        return dof > 0 and log_chance(gain, dof, item) < self.threshold

    def net_gain(self, gain: float, dof: int, item: Hypothesis, cost: float = 0.0) -> float:
        """Twice the log-evidence: the gain less the price of coefficients and of the comparisons made.

        `cost` is the part of its price that the gain of a random process contains already.
        """
        return saturated(gain + cost) - cost - self.price(dof, item)

    def price(self, dof: int, item: Hypothesis) -> float:
        """Price of the coefficients of a hypothesis and of the comparisons made: each coefficient of a nonparametric
        curve is one, as each named effect is that explains the same."""
        comparisons = max(self.examined, 2) * item.alternatives
        chosen = max(dof, 1) if item.effect.family else 1
        return dof * math.log(max(self.blocks, 2)) + 2.0 * chosen * math.log(comparisons)

    def evidence_with_size(self, evidence: CandidateScores, i: int, given: Sequence[int], inflation: float) -> float:
        """Log-evidence of a hypothesis given others, with the prior of its size; nan without any priors."""
        if self.priors is None:
            return math.nan
        gain, dof, estimate, covariance = evidence.gain(i, given)
        item, cost = evidence.items[i], evidence.cost(i, given)
        if not dof:
            return -math.inf
        credited = saturated(gain / inflation + cost) - cost
        covariance = covariance * gain / max(credited, VANISHING)
        prior = self.priors.get(item.effect.name, item.effect.prior)
        return prior.log_evidence(estimate, covariance, credited) - math.log(item.alternatives)

    def required_gains(self, dof: int, item: Hypothesis) -> tuple[float, float]:
        """Gain at which a hypothesis is significant, and gain that is worth its price."""
        return entry_gains(
            self.examined, self.blocks, self.alpha, dof=dof, comparisons=item.comparisons, trials=item.trials
        )

    def best_set(self, evidence: CandidateScores, scatter: BlockScatter | None = None) -> tuple[int, ...]:
        """The set with the largest net gain, each member significant given all others, strongest first."""
        sets = {self.significant_members(evidence, scatter, chosen) for chosen in self.beam(evidence, scatter)}
        return max(sets, key=lambda chosen: self.net_gain_of_set(evidence, chosen))

    def significant_members(
        self, evidence: CandidateScores, scatter: BlockScatter | None, chosen: tuple[int, ...]
    ) -> tuple[int, ...]:
        """Members of a set that are significant given all others of them, strongest first."""
        members = sorted(chosen)
        while len(members) > 1:
            net_gains = [
                (self.net_gain_given(evidence, scatter, i, [j for j in members if j != i]), i) for i in members
            ]
            insignificant = [i for value, i in net_gains if value == -math.inf]
            if not insignificant:
                break
            members.remove(min(insignificant, key=lambda i: self.net_gain_given(evidence, None, i, ())))
        ordered: list[int] = []
        while members:
            ordered.append(max(members, key=lambda i: self.net_gain_given(evidence, None, i, ordered)))
            members.remove(ordered[-1])
        return tuple(ordered)

    def undeferred(self, evidence: CandidateScores, ordered: tuple[int, ...]) -> tuple[int, ...]:
        """Members of a set without those that gain too little beside the first to enter with it."""
        first = float(evidence.gains()[0][ordered[0]]) if ordered else 0.0
        return tuple(
            i for k, i in enumerate(ordered) if float(evidence.gains(ordered[:k])[0][i]) >= DEFERRED_GAIN_SHARE * first
        )

    def net_gain_of_set(self, evidence: CandidateScores, ordered: Sequence[int]) -> float:
        """Joint gain of a set less the prices of its members.

        Evidence that saturates would credit two members that share what they explain with more than the single effect
        that explains as much.
        """
        tables = [(i, *evidence.gains(ordered[:k])) for k, i in enumerate(ordered)]
        return sum(float(gains[i]) - self.price(int(dofs[i]), evidence.items[i]) for i, gains, dofs in tables)

    def net_gain_given(
        self, evidence: CandidateScores, scatter: BlockScatter | None, i: int, given: Sequence[int]
    ) -> float:
        """Net gain of a hypothesis given others; minus infinity where it is not significant."""
        gains, dofs = evidence.gains(given)
        gain, dof = float(gains[i]), int(dofs[i])
        robust_gain = gain if scatter is None else gain / scatter.inflation(i, given)
        if scatter is not None and not self.significant(robust_gain, dof, evidence.items[i]):
            return -math.inf
        return self.net_gain(gain, dof, evidence.items[i], evidence.cost(i, given))

    def beam(self, evidence: CandidateScores, scatter: BlockScatter | None = None) -> list[tuple[int, ...]]:
        """Beam search: the best set, then every set that was kept at any depth."""
        beam: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
        best: tuple[float, tuple[int, ...]] = (0.0, ())
        visited: list[tuple[int, ...]] = []
        for _ in range(SEARCH_DEPTH):
            extended: dict[frozenset[int], tuple[float, tuple[int, ...]]] = {}
            for total, chosen in beam:
                for value, i in self.extensions(evidence, chosen, scatter):
                    key = frozenset((*chosen, i))
                    if key not in extended or extended[key][0] < total + value:
                        extended[key] = (total + value, (*chosen, i))
            beam = self.distinct(evidence, sorted(extended.values(), reverse=True))
            if not beam:
                break
            best = max(best, beam[0])
            visited += [chosen for _, chosen in beam]
        return [best[1], *visited]

    def extensions(
        self, evidence: CandidateScores, chosen: tuple[int, ...], scatter: BlockScatter | None
    ) -> list[tuple[float, int]]:
        """Hypotheses that may enter after a set, with their net gains, best first."""
        gains, dofs = evidence.gains(chosen)
        present = {evidence.items[i].effect.name for i in chosen}
        extended: list[tuple[float, int]] = []
        first = float(evidence.gains()[0][chosen[0]]) if chosen else 0.0
        for i, item in enumerate(evidence.items):
            if item.effect.name in present:
                continue
            gain, dof = float(gains[i]), int(dofs[i])
            if gain < DEFERRED_GAIN_SHARE * first or not self.significant(gain, dof, item):
                continue
            if scatter is not None and not self.significant(gain / scatter.inflation(i, chosen), dof, item):
                continue
            extended.append((gain - self.price(dof, item), i))
        return sorted(extended, reverse=True)

    def distinct(
        self, evidence: CandidateScores, ranked: Sequence[tuple[float, tuple[int, ...]]]
    ) -> list[tuple[float, tuple[int, ...]]]:
        """The best sets, at most one for each choice of effects, so that trial shapes of one effect do not fill the
        beam."""
        best: dict[frozenset[str], tuple[float, tuple[int, ...]]] = {}
        for value, chosen in ranked:
            names = frozenset(evidence.items[i].effect.name for i in chosen)
            if names not in best:
                best[names] = (value, chosen)
            if len(best) == BEAM_WIDTH:
                break
        return list(best.values())


def log_chance(gain: float, dof: int, item: Hypothesis) -> float:
    """Log probability of a gain under the null, over the values among which the hypothesis was selected."""
    return log_survival(gain, dof) + math.log(item.comparisons)


def block_length(state: RunState) -> float:
    """Length of blocks whose scores are independent, s: two periods of the crossover, and at least 0.25 s.

    On a record of less than 20 s the least length is an 80th of the record.
    """
    periods = 2.0 / state.run.crossover(state.noise)
    span = float(state.run.t[-1] - state.run.t[0])
    return max(periods, min(BLOCK_SECONDS, span / 80.0))


class BlockScatter:
    """Ratio of the scatter of the finalists' scores from block to block to the variance that the model predicts.

    Scatter is taken from the residual of all finalists together, so that one missing effect does not count as
    uncertainty of another. An effect that lives in a few blocks, such as a step, has little scatter to measure: the
    fewer its blocks, the more the predicted variance counts.
    """

    def __init__(self, evidence: CandidateScores, length: float) -> None:
        self.evidence = evidence
        scaled, size = scaled_gram(evidence.G)
        every = self.every = np.linalg.solve(scaled + 1e-9 * np.eye(len(size)), evidence.c / size) / size
        parts = [block_sums(np.concatenate([X * (y - every @ X), X**2]), t, length) for t, y, X in evidence.rows()]
        _, block = np.unique(np.concatenate([blocks for blocks, _ in parts]), return_inverse=True)
        sums = np.zeros((2 * len(evidence.G), int(block[-1]) + 1))
        np.add.at(sums.T, block, np.concatenate([sums for _, sums in parts], axis=1).T)
        self.scores, self.powers = np.split(sums, 2)
        """Score of each column in each block, and its predicted variance, (m, blocks) each."""
        self.inflations: dict[tuple[int, tuple[int, ...]], float] = {}
        self._parts: PartScores | None = None

    def inflation(self, i: int, given: Sequence[int]) -> float:
        """Ratio of block scatter to predicted variance of a hypothesis's score, at least 1."""
        key = (i, tuple(sorted(given)))
        if key not in self.inflations:
            self.inflations[key] = self._inflation(*key)
        return self.inflations[key]

    def part_sizes(self, i: int, given: Sequence[int]) -> tuple[PartSizes, PartSizes]:
        """Sizes of a hypothesis in the parts of the runs, and in bands of frequency."""
        if self.evidence.items[i].effect.port == "process":
            return PartSizes.none(), PartSizes.none()
        if self._parts is None:
            self._parts = PartScores(self.evidence, self.every)
        arguments = i, given, self.inflation(i, given)
        once = exempt(self.evidence.items[i])
        return PartSizes.none() if once else self._parts.sizes(*arguments), self._parts.sizes_by_frequency(*arguments)

    def _inflation(self, i: int, given: tuple[int, ...]) -> float:
        e = self.evidence
        _, dof, estimate, _ = e.gain(i, given)
        if e.items[i].effect.port == "process" or dof == 0:
            return 1.0
        column = e.columns[i]
        direction = direction_of(e, i, given)
        power = float(direction @ e.G @ direction)
        if power <= VANISHING * float(estimate @ e.G[column, column] @ estimate):
            return 1.0
        scores = direction @ self.scores
        return float(shrunk_inflation(float(scores @ scores) / power, direction**2 @ self.powers))


def shrunk_inflation(ratio: float | Array, shares: Array) -> Array:
    """Ratio of block scatter to predicted variance, shrunk towards 1 and at least 1.

    `shares` are those of an effect's power in the blocks; the shrinkage is that of eight more blocks with the predicted
    variance.
    """
    blocks = float(np.sum(shares)) ** 2 / float(shares @ shares)
    return np.maximum(1.0, (blocks * np.asarray(ratio) + MODEL_NOISE_BLOCKS) / (blocks + MODEL_NOISE_BLOCKS))


def block_sums(rows: Array, t: Array, length: float) -> tuple[Array, Array]:
    """Numbers of the blocks that a stretch of time meets, and the sums over them of each row of (m, n), (m, blocks)."""
    block = np.floor(t / length)
    begins = np.flatnonzero(np.diff(block, prepend=-1.0))
    return block[begins], np.add.reduceat(rows, begins, axis=1)
