"""Which physical effect is missing: one pass of scores, a search over sets, ties and a verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import special

from accelcal.effects import HOUSE, Effect, Shape, side_channels
from accelcal.effects.memory import lagged
from accelcal.fit import Pass
from accelcal.model import Model, Prior, Term, terms_of
from accelcal.recording import Array
from accelcal.signals import Signals

Verdict = Literal["adequate", "named", "tied", "shape", "unexplained", "too_short"]

ALPHA = 0.005
"""Family-wise false-alarm rate of a record."""
DEPTH = 3
"""Effects that are searched for together."""
WIDTH = 5
"""Sets that are kept at each depth."""
RIVAL_EVIDENCE = 4.5
"""A rival within this log-evidence cannot be told apart."""
RIVAL_CORRELATION = 0.95
"""Nor can one whose signature is this correlated."""
LEAST_BLOCKS = 20
"""Fewer effective blocks than this are too short a record for any verdict."""
OVERSAMPLING = 6.0
"""Rate of the compressed record over the larger of crossover and bandwidth of the motion."""
NAMELESS = 0.95
"""Share of its gain that a shape without a name may claim: a named effect that explains nearly as much is preferred."""
DEGENERATE = 1e-5
"""Share of a column's power beyond base and chosen effects below which nothing of it is left to test."""
DEGENERATE_MIX = 1e-3
"""The same for a mixture of several columns, which picks the direction that errors of the smoothed motion favour."""
SHADOW = 0.1
"""An effect that explains less than this share of the strongest one waits until the model is fitted with that."""
JUMPS = 8
"""Instants at which a jump of the encoder is tried."""
GRAM_ROWS = 8192
"""Rows that one matrix product takes; many small products cost more than one large."""
FINALISTS = 8
"""Effects whose shapes are refined and whose scores are checked block by block."""
SECONDS_PER_BLOCK = 0.25
"""Length of a block, at least two periods of the crossover."""


@dataclass(frozen=True, slots=True)
class Item:
    """An effect at given shape parameters: what can enter a set."""

    effect: Effect
    shape: Mapping[str, float]
    looks: int = 1
    """Alternatives that this one was picked from before it was tried."""

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its coefficients."""
        return terms_of(self.effect, self.shape)


@dataclass(frozen=True, slots=True)
class Candidate:
    """What one effect explains, given the model and what entered before it."""

    effect: str
    shape: Mapping[str, float]
    estimate: tuple[float, ...]
    """One value for each column, in `unit`; for a wandering bias its one intensity."""
    std: tuple[float, ...]
    unit: str
    gain: float
    """Twice the log-likelihood gain, block-robust."""
    dof: int
    p_raw: float
    p_value: float
    """Family-wise, over everything that was looked at."""
    log_evidence: float
    largest: float
    """Largest contribution over the used range, m/s² (m at the encoder)."""
    members: tuple[str, ...] = ()
    """Effects that cannot be told from it on this record, itself included."""

    @property
    def snr(self) -> float:
        """Equivalent standard deviations, sqrt of the gain."""
        return math.sqrt(max(self.gain, 0.0))


@dataclass(frozen=True, slots=True)
class Finding:
    """An effect that entered, with its equivalence class and the experiment that would separate it."""

    effect: str
    shape: Mapping[str, float]
    members: tuple[str, ...]
    experiment: str
    prior_std: float | None = None
    """Intensity of a wandering bias; None for constant coefficients."""
    fixed: tuple[str, ...] = ()
    """Columns that the model already contains and that are held at 0."""

    def enter(self, model: Model) -> Model:
        """Return the model with this effect."""
        shapes = {self.effect: dict(self.shape)} if self.shape else None
        grown = model.add(self.effect, shapes=shapes)
        if self.prior_std is not None:
            std = self.prior_std
            names = [t.name for t in grown.terms if t.effect.name == self.effect]
            grown = model.add(self.effect, shapes=shapes, priors={n: Prior(0.0, std) for n in names})
        return grown.freeze(**dict.fromkeys(self.fixed, 0.0)) if self.fixed else grown


@dataclass(frozen=True, slots=True)
class Scan:
    """Everything that one pass over a record says about what its model lacks."""

    candidates: tuple[Candidate, ...]
    """By rank."""
    found: tuple[Finding, ...]
    """The set that explains most, in order of entry; empty when nothing is significant."""
    examined: int
    """Alternatives that were looked at."""
    blocks: int
    """Effective blocks of the record."""
    detection_limits: Mapping[str, float] = field(default_factory=dict)
    """Smallest coefficient that would have been seen with 95 % probability, by effect."""
    entered: tuple[Finding, ...] = ()
    """Effects that were asked for by name and can be evaluated, whatever they explain."""


def _lowpass_error(s: Signals, tau: float) -> Array:
    """The known low-pass has another time constant than declared: e = -dtau (1 + k) x, tau x' = jerk - x.

    Looks like: a delay, and above 1/(10 tau) a little more.
    Easily confused with: time_offset, sensor_lag.
    Separate by: measuring the filter.
    """
    return -s.scale * lagged(s.jerk, tau, s.step, 0.0)


LOWPASS_ERROR = Effect(
    name="lowpass_error",
    unit="s",
    port="output",
    owner="timing",
    symbol="dtau",
    scale=5e-5,
    source="declared tolerance of the low-pass",
    function=_lowpass_error,
    shapes={"tau": Shape("s", (1e-6, 1.0), trials=1)},
    visible=False,
)
"""Carried beside the base while others are judged, no larger than the declared tolerance allows."""


def nuisances(one: Pass) -> list[tuple[Term, float]]:
    """What is known not to be known, with its standard deviation."""
    tolerance = one.run.rig.lowpass_tolerance
    if tolerance <= 0.0:
        return []
    return [(Term(LOWPASS_ERROR, 0, {"tau": one.run.tau}), tolerance)]


def candidates_for(one: Pass, model: Model, extra: Sequence[Effect] = ()) -> list[Item]:
    """Every effect that could be missing from a model on this record, at each of its trial shapes."""
    s = one.signals
    assert s is not None
    recorded = [(name, channel.unit) for name, channel in one.run.recording.side.items()]
    offered = (*HOUSE, *side_channels(recorded), *extra)
    items = []
    for effect in offered:
        taken = effect.name in model.effects or not effect.visible or effect.port == "noise"
        if taken or any(name not in s.side for name in effect.needs):
            continue
        grids = {name: shape.grid(s) for name, shape in effect.shapes.items()}
        looks = 1
        if effect.port == "position" and "instant" in grids:
            grids["instant"] = jumps(one)
            looks = max(1, int(s.length * 2.0 * np.pi * one.run.crossover(one.noise)))
        for values in _product(grids):
            items.append(Item(effect, values, looks))
    return items


def jumps(one: Pass) -> Array:
    """Instants at which readings may have jumped, on the clock of the effects, s, (at most 8,).

    The filter forgets a jump within its own time constant, so no coarse grid of instants would meet it: those where
    innovations add up most over one time constant are tried.
    """
    span = max(1, int(1.0 / (2.0 * np.pi * one.run.crossover(one.noise) * one.run.reading_step)))
    y = np.where(one.counts, one.whitened, 0.0)
    loud = np.abs(np.convolve(y, np.ones(span), mode="full")[span - 1 :])
    found: list[float] = []
    for _ in range(JUMPS):
        k = int(np.argmax(loud))
        found.append(float(one.run.t[k] - 0.5 * one.run.reading_step - one.run.origins.t))
        loud[max(0, k - 4 * span) : k + 4 * span] = 0.0
    return np.array(sorted(found))


def _product(grids: Mapping[str, Array]) -> list[dict[str, float]]:
    combined: list[dict[str, float]] = [{}]
    for name, values in grids.items():
        combined = [{**old, name: float(value)} for old in combined for value in values]
    return combined


class Evidence:
    """Gram matrix and scores of the candidates with the base projected out, run by run, and what follows from them.

    The base is projected out of each run on its own, so no run's offset can pose as an effect in another.
    """

    def __init__(
        self, passes: Sequence[Pass], base: Sequence[Term], items: Sequence[Item], *, keep: bool = False
    ) -> None:
        self.items = items
        unsure = nuisances(passes[0])
        base = [*base, *(term for term, _ in unsure)]
        belief = np.array([*np.zeros(len(base) - len(unsure)), *(std**-2.0 for _, std in unsure)])
        terms = [*base, *(term for item in items for term in item.terms)]
        edges = np.cumsum([0, *(item.effect.width for item in items)])
        self.columns = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        m = len(terms) - len(base)
        self.G, self.c = np.zeros((m, m)), np.zeros(m)
        stretches: list[tuple[Array, Array, Array]] = []
        for number, one in enumerate(passes):
            gram, rows = compressed(one, terms, keep=keep)
            weights = projection(gram, belief)
            projected = gram[len(base) :, len(base) :] - gram[len(base) :, : len(base)] @ weights
            self.G += projected[:-1, :-1]
            self.c += projected[:-1, -1]
            if rows is not None:
                X, t = rows
                left = X[:, len(base) :] - X[:, : len(base)] @ weights
                stretches.append((left[:, :-1], left[:, -1], t - t[0] + 1e6 * number))
        nothing = [(np.empty((0, m)), np.empty(0), np.empty(0))]
        kept = stretches or nothing
        self.X: Array = np.concatenate([X for X, _, _ in kept])
        self.y: Array = np.concatenate([y for _, y, _ in kept])
        self.t: Array = np.concatenate([t for _, _, t in kept])

    def after(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Gram matrix and scores once some items have entered: constant coefficients first, then wandering states.

        A wandering state enters with the intensity that it has beside those before it. Free, it would leave to the
        others what it cannot explain and yet be paid for what it can.
        """
        G, c = self.G, self.c
        constant = [i for i in chosen if self.items[i].effect.port != "process"]
        if constant:
            columns = np.concatenate([np.arange(self.columns[i].start, self.columns[i].stop) for i in constant])
            G, c = without(G, c, columns)
        for i in chosen:
            if i not in constant:
                columns = np.arange(self.columns[i].start, self.columns[i].stop)
                _, _, intensity, _ = variance_gain(G[np.ix_(columns, columns)], c[columns])
                G, c = without(G, c, columns, float(intensity[0]))
        return G, c

    def gain(self, i: int, G: Array, c: Array) -> tuple[float, int, Array, Array]:
        """Twice the log-likelihood gain of item `i`, its degrees of freedom, estimate and covariance."""
        columns = self.columns[i]
        A, b = G[columns, columns], c[columns]
        if self.items[i].effect.port == "process":
            return variance_gain(A, b)
        gain, dof, estimate, covariance = score_gain(A, b, self.G[columns, columns])
        if self.items[i].effect.positive and estimate[0] < 0.0:
            return 0.0, 0, estimate, covariance
        return gain, dof, estimate, covariance


def without(G: Array, c: Array, columns: NDArray[np.intp], prior_std: float = math.inf) -> tuple[Array, Array]:
    """Gram matrix and scores with some columns projected out; their coefficients have mean zero and `prior_std`."""
    A = G[np.ix_(columns, columns)] + np.eye(len(columns)) / prior_std**2
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    A = A / np.outer(size, size) + 1e-9 * np.eye(len(columns))
    left = scipy.linalg.cho_solve(scipy.linalg.cho_factor(A), G[columns] / size[:, None]) / size[:, None]
    return G - G[:, columns] @ left, c - left.T @ c[columns]


def score_gain(A: Array, b: Array, before: Array | None = None) -> tuple[float, int, Array, Array]:
    """Gain b' A^-1 b of free coefficients; directions that others already contain are left out."""
    reference = np.diag(A if before is None else before)
    if len(b) == 1:
        if A[0, 0] <= DEGENERATE * reference[0] or A[0, 0] <= 0.0:
            return 0.0, 0, np.zeros(1), np.full((1, 1), np.inf)
        return float(b[0] ** 2 / A[0, 0]), 1, b / A[0, 0], 1.0 / A
    size = np.sqrt(np.maximum(reference, 1e-300))
    values, vectors = np.linalg.eigh(A / np.outer(size, size))
    good = values > DEGENERATE_MIX
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(size, size)
    return float(b @ inverse @ b), int(good.sum()), inverse @ b, inverse


def variance_gain(A: Array, b: Array) -> tuple[float, int, Array, Array]:
    """Gain of coefficients that are random with one unknown standard deviation s (discovery 3.4).

    2 log L = max_s [ b'(I/s² + A)^-1 b - log det(I + s² A) ].
    """
    values, vectors = np.linalg.eigh(A)
    values = np.maximum(values, 0.0)
    projected = (vectors.T @ b) ** 2

    def loss(log_s: float) -> float:
        s2 = math.exp(2.0 * log_s)
        return float(np.sum(np.log1p(s2 * values)) - np.sum(projected * s2 / (1.0 + s2 * values)))

    top = float(np.max(values, initial=1e-300))
    trials = -0.5 * math.log(top) + np.linspace(-2.0, 9.0, 23)
    losses = [loss(x) for x in trials]
    k = int(np.argmin(losses))
    low, high = trials[max(k - 1, 0)], trials[min(k + 1, len(trials) - 1)]
    best = scipy.optimize.minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 0.02})
    gain = max(0.0, -float(best.fun))
    s = math.exp(float(best.x))
    return (
        gain,
        1,
        np.array([s]),
        np.array([[s**2 / max(1.0, 2.0 * np.sum((s**2 * values / (1 + s**2 * values)) ** 2))]]),
    )


def projection(gram: Array, belief: Array) -> Array:
    """Weights with which the base, under its prior information, predicts every other column, (base, others)."""
    base = len(belief)
    A = gram[:base, :base] + np.diag(belief)
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    factor = scipy.linalg.cho_factor(A / np.outer(size, size) + 1e-12 * np.eye(base))
    return np.asarray(scipy.linalg.cho_solve(factor, gram[:base, base:] / size[:, None]) / size[:, None])


def compressed(one: Pass, terms: Sequence[Term], *, keep: bool) -> tuple[Array, tuple[Array, Array] | None]:
    """Gram matrix of [X y] with whitened samples summed in blocks; white stays white below a fraction of the rate.

    Returns
    -------
    Gram (m + 1, m + 1), and if they are kept the rows [X y] (n, m + 1) with their times (n,).
    """
    s = one.signals
    assert s is not None
    rate = 1.0 / one.run.reading_step
    factor = max(1, int(rate / (OVERSAMPLING * max(s.cutoff, one.run.crossover(one.noise)))))
    m = len(terms)
    gram = np.zeros((m + 1, m + 1))
    kept: list[tuple[Array, Array]] = []
    waiting: list[Array] = []
    for rows, columns in one.run.columns(one.track, one.drive, terms, s):
        good = one.counts[rows]
        whole = bool(np.all(good))
        full = (len(good) if whole else int(np.sum(good))) // factor * factor
        X = (columns if whole else columns[good])[:full].reshape(-1, factor, m)
        y = (one.whitened[rows] if whole else one.whitened[rows][good])[:full].reshape(-1, factor)
        Z = np.empty((full // factor, m + 1))
        np.sum(X, axis=1, out=Z[:, :m])
        np.sum(y, axis=1, out=Z[:, m])
        Z /= math.sqrt(factor)
        waiting.append(Z)
        if sum(map(len, waiting)) >= GRAM_ROWS:
            together = np.concatenate(waiting)
            gram += together.T @ together
            waiting.clear()
        if keep:
            times = one.run.t[rows] if whole else one.run.t[rows][good]
            kept.append((Z, times[:full:factor]))
    if waiting:
        together = np.concatenate(waiting)
        gram += together.T @ together
    if not keep:
        return gram, None
    return gram, (np.concatenate([z for z, _ in kept]), np.concatenate([t for _, t in kept]))


def log_survival(gain: float, dof: int) -> float:
    """Log of the probability that chi-square with `dof` exceeds `gain`; never saturates."""
    if dof == 0 or gain <= 0.0:
        return 0.0
    if dof == 1:
        return float(math.log(2.0) + special.log_ndtr(-math.sqrt(gain)))
    a, x = dof / 2.0, gain / 2.0
    if x < 600.0:
        return float(np.log(max(special.gammaincc(a, x), 1e-300)))
    series, term = 1.0, 1.0
    for k in range(1, 12):
        term *= (a - k) / x
        series += term
    return float((a - 1.0) * math.log(x) - x - special.gammaln(a) + math.log(series))


def scan(
    passes: Sequence[Pass],
    model: Model,
    *,
    extra: Sequence[Effect] = (),
    only: Sequence[Effect] = (),
    alpha: float = ALPHA,
) -> Scan:
    """Rank every effect that could be missing, and find the set that explains most.

    Parameters
    ----------
    passes : fitted runs.
    model : the model they were fitted with.
    extra : effects of the user's own.
    only : look at these effects alone, significant or not.
    alpha : family-wise false-alarm rate.

    Notes
    -----
    Scores through the filter (Friedland's two stages): no refit is needed to rank. Shape parameters of the finalists
    are refined by likelihood before effects are compared; scores of the finalists are checked block by block.
    """
    items = candidates_for(passes[0], model, extra)
    if only:
        names = {effect.name for effect in only}
        items = [item for item in items if item.effect.name in names]
        if not items:
            return Scan((), (), 0, 0)
    base = [t for t in model.terms if t.name not in model.fixed]
    length = max(block_length(one) for one in passes)
    blocks = int(sum(np.sum(one.counts) * one.run.reading_step for one in passes) / length)
    search_in = Search(len(items), blocks, alpha)
    evidence = Evidence(passes, base, items)
    finalists = shortlist(evidence, search_in.beam(evidence))
    refined = refine(passes, base, items, finalists)
    final = Evidence(passes, base, refined, keep=True)
    robust = Robust(final, length)
    chosen = search_in.best(final, robust)
    return Scan(
        rank(final, robust, chosen, search_in, passes),
        tuple(describe(final, robust, chosen, position, search_in) for position in range(len(chosen))),
        len(items),
        blocks,
        limits(evidence, search_in),
        tuple(
            describe(final, robust, (i,), 0, search_in)
            for i in range(len(refined))
            if only and final.gain(i, final.G, final.c)[1]
        ),
    )


def block_length(one: Pass) -> float:
    """Stretch of a record whose scores are independent of the next, s: two periods of the crossover, or 0.25 s."""
    periods = 2.0 / one.run.crossover(one.noise)
    span = float(one.run.t[-1] - one.run.t[0])
    return max(periods, min(SECONDS_PER_BLOCK, span / 80.0))


class Robust:
    """How much more the scores of the finalists scatter from block to block than the model says.

    Scatter is taken from what all finalists together leave over, so that one missing effect does not pass for
    uncertainty of another.
    """

    def __init__(self, evidence: Evidence, length: float) -> None:
        self.evidence = evidence
        self.block = np.unique(np.floor(evidence.t / length), return_inverse=True)[1]
        size = np.sqrt(np.maximum(np.diag(evidence.G), 1e-300))
        scaled = evidence.G / np.outer(size, size) + 1e-9 * np.eye(len(size))
        self.left: Array = evidence.y - evidence.X @ (np.linalg.solve(scaled, evidence.c / size) / size)
        self.known: dict[tuple[int, tuple[int, ...]], float] = {}

    def inflation(self, i: int, given: Sequence[int]) -> float:
        """Ratio of block scatter to model variance of an item's score, at least 1."""
        key = (i, tuple(sorted(given)))
        if key not in self.known:
            self.known[key] = self._inflation(*key)
        return self.known[key]

    def _inflation(self, i: int, given: tuple[int, ...]) -> float:
        e = self.evidence
        G, c = e.after(given)
        _, dof, estimate, _ = e.gain(i, G, c)
        if e.items[i].effect.port == "process" or dof == 0:
            return 1.0
        own = e.columns[i]
        direction = e.X[:, own] @ estimate
        if given:
            rows = np.concatenate([np.arange(e.columns[j].start, e.columns[j].stop) for j in given])
            weights, *_ = np.linalg.lstsq(e.G[np.ix_(rows, rows)], e.G[rows, own] @ estimate, rcond=1e-9)
            direction = direction - e.X[:, rows] @ weights
        power = float(direction @ direction)
        if power <= 0.0:
            return 1.0
        scores = np.bincount(self.block, weights=direction * self.left)
        return max(1.0, float(scores @ scores) / power)


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

    def significant(self, gain: float, dof: int, item: Item) -> bool:
        """Whether a gain is beyond what the best of all alternatives would show by chance."""
        return dof > 0 and log_survival(gain, dof) + math.log(item.looks) < self.threshold

    def price(self, gain: float, dof: int, item: Item) -> float:
        """Gain less what an effect pays for its freedom, for having been picked, and for having no name."""
        told = gain * (NAMELESS if item.effect.family else 1.0)
        looks = max(self.examined, 2) * item.looks
        return told - dof * math.log(max(self.blocks, 2)) - 2.0 * math.log(looks)

    def best(self, evidence: Evidence, robust: Robust | None = None) -> tuple[int, ...]:
        """The set whose gain exceeds its price most, every member significant beside all others, strongest first."""
        chosen = list(self.beam(evidence, robust)[0])
        while len(chosen) > 1:
            beside = [(self.told(evidence, robust, i, [j for j in chosen if j != i]), i) for i in chosen]
            idle = [(value, i) for value, i in beside if value == -math.inf]
            if not idle:
                break
            chosen.remove(min(idle, key=lambda one: self.told(evidence, None, one[1], ()))[1])
        ordered: list[int] = []
        while chosen:
            ordered.append(max(chosen, key=lambda i: self.told(evidence, None, i, ordered)))
            chosen.remove(ordered[-1])
        return tuple(ordered)

    def told(self, evidence: Evidence, robust: Robust | None, i: int, given: Sequence[int]) -> float:
        """Gain less price of an item beside others; minus infinity where it is not significant there."""
        G, c = evidence.after(given)
        gain, dof, _, _ = evidence.gain(i, G, c)
        sure = gain if robust is None else gain / robust.inflation(i, given)
        if robust is not None and not self.significant(sure, dof, evidence.items[i]):
            return -math.inf
        return self.price(gain, dof, evidence.items[i])

    def beam(self, evidence: Evidence, robust: Robust | None = None) -> list[tuple[int, ...]]:
        """Beam search: the best set, then every set that was kept on the way."""
        beam: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
        best: tuple[float, tuple[int, ...]] = (0.0, ())
        seen: list[tuple[int, ...]] = []
        for _ in range(DEPTH):
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

    def options(self, evidence: Evidence, chosen: tuple[int, ...], robust: Robust | None) -> list[tuple[float, int]]:
        """What may enter after a set, best first."""
        G, c = evidence.after(chosen)
        taken = {evidence.items[i].effect.name for i in chosen}
        found: list[tuple[float, int]] = []
        first = evidence.gain(chosen[0], evidence.G, evidence.c)[0] if chosen else 0.0
        for i, item in enumerate(evidence.items):
            if item.effect.name in taken:
                continue
            gain, dof, _, _ = evidence.gain(i, G, c)
            if not self.significant(gain, dof, item) or gain < SHADOW * first:
                continue
            if robust is not None and not self.significant(gain / robust.inflation(i, chosen), dof, item):
                continue
            found.append((self.price(gain, dof, item), i))
        return sorted(found, reverse=True)

    def diverse(
        self, evidence: Evidence, ranked: Sequence[tuple[float, tuple[int, ...]]]
    ) -> list[tuple[float, tuple[int, ...]]]:
        """The best sets, at most one for each choice of effects, so that trial shapes do not crowd the beam."""
        kept: dict[frozenset[str], tuple[float, tuple[int, ...]]] = {}
        for value, chosen in ranked:
            names = frozenset(evidence.items[i].effect.name for i in chosen)
            if names not in kept:
                kept[names] = (value, chosen)
            if len(kept) == WIDTH:
                break
        return list(kept.values())


def shortlist(evidence: Evidence, sets: Sequence[tuple[int, ...]]) -> list[int]:
    """Items worth refining: all that the search kept, and the strongest rivals at each place of its best set."""
    chosen = sets[0]
    kept = list(dict.fromkeys(i for one in sets for i in one))
    names = {evidence.items[i].effect.name for i in kept}
    for position in range(max(1, len(chosen))):
        G, c = evidence.after(tuple(i for k, i in enumerate(chosen) if k != position))
        best: dict[str, tuple[float, int]] = {}
        for i, item in enumerate(evidence.items):
            gain, dof, _, _ = evidence.gain(i, G, c)
            if dof and gain - dof > best.get(item.effect.name, (-math.inf, -1))[0]:
                best[item.effect.name] = (gain - dof, i)
        strongest = sorted(best.values(), reverse=True)[:FINALISTS]
        kept += [i for _, i in strongest if evidence.items[i].effect.name not in names]
        names |= {evidence.items[i].effect.name for _, i in strongest}
    return kept


def refine(passes: Sequence[Pass], base: Sequence[Term], items: Sequence[Item], finalists: Sequence[int]) -> list[Item]:
    """Shape parameters of the finalists by likelihood, each between its neighbours on the trial grid."""
    s = passes[0].signals
    assert s is not None
    refined: list[Item] = []
    done: set[str] = set()
    for i in finalists:
        item = items[i]
        if item.effect.name in done:
            continue
        done.add(item.effect.name)
        shape = dict(item.shape)
        for name, declared in item.effect.shapes.items():
            grid = declared.grid(s)
            if len(grid) < 2 or (item.effect.port == "position" and name == "instant"):
                continue
            low, high = declared.span(s)
            k = int(np.argmin(np.abs(grid - shape[name])))
            bounds = (float(grid[k - 1]) if k > 0 else low, float(grid[k + 1]) if k + 1 < len(grid) else high)

            def loss(value: float, name: str = name, shape: dict[str, float] = shape, item: Item = item) -> float:
                trial = Evidence(passes, base, [Item(item.effect, {**shape, name: value})])
                return -trial.gain(0, trial.G, trial.c)[0]

            tolerance = 1e-3 * (bounds[1] - bounds[0])
            options = {"xatol": tolerance, "maxiter": 14}
            best = scipy.optimize.minimize_scalar(loss, bounds=bounds, method="bounded", options=options)
            if float(best.fun) < loss(shape[name]):
                shape[name] = float(best.x)
        refined.append(Item(item.effect, shape, item.looks))
    return refined


def rank(
    evidence: Evidence, robust: Robust, chosen: tuple[int, ...], rules: Search, passes: Sequence[Pass]
) -> tuple[Candidate, ...]:
    """Every finalist as it stands in the first place, best evidence first."""
    others = chosen[1:]
    G, c = evidence.after(others)
    found = []
    for i, item in enumerate(evidence.items):
        if i in others:
            continue
        gain, dof, estimate, covariance = evidence.gain(i, G, c)
        if dof == 0:
            continue
        gain /= robust.inflation(i, others)
        log_p = log_survival(gain, dof)
        found.append(
            Candidate(
                effect=item.effect.name,
                shape=dict(item.shape),
                estimate=tuple(float(v) for v in estimate),
                std=tuple(float(v) for v in np.sqrt(np.diag(covariance))),
                unit=item.effect.unit,
                gain=gain,
                dof=dof,
                p_raw=math.exp(log_p),
                p_value=math.exp(min(0.0, log_p + math.log(rules.examined * item.looks))),
                log_evidence=rules.price(gain, dof, item) / 2.0,
                largest=max(largest(item, estimate, one) for one in passes),
                members=members(evidence, robust, i, others, rules),
            )
        )
    return tuple(sorted(found, key=lambda f: f.log_evidence, reverse=True))


def largest(item: Item, estimate: Array, one: Pass) -> float:
    """Largest contribution of an effect over a run, m/s² (m at the encoder)."""
    s = one.signals
    assert s is not None
    columns = np.column_stack([term.column(s) for term in item.terms])
    if item.effect.port == "process":
        return float(estimate[0] * np.max(np.linalg.norm(columns, axis=1)))
    return float(np.max(np.abs(columns @ estimate)))


def members(evidence: Evidence, robust: Robust, i: int, others: Sequence[int], rules: Search) -> tuple[str, ...]:
    """Effects that cannot be told from item `i` on this record, itself first."""
    G, c = evidence.after(others)
    gain, dof, estimate, _ = evidence.gain(i, G, c)
    item = evidence.items[i]
    inflation = robust.inflation(i, others)
    own = rules.price(gain / inflation, dof, item)
    rivals: list[tuple[float, str]] = []
    for j, rival in enumerate(evidence.items):
        if j == i or j in others or (rival.effect.family and not item.effect.family):
            continue
        theirs, their_dof, _, _ = evidence.gain(j, G, c)
        if their_dof == 0:
            continue
        gap = (own - rules.price(theirs / inflation, their_dof, rival)) / 2.0
        if gap < RIVAL_EVIDENCE or shared(evidence, G, i, j, estimate) > RIVAL_CORRELATION:
            rivals.append((gap, rival.effect.name))
    return (item.effect.name, *(name for _, name in sorted(rivals)))


def shared(evidence: Evidence, G: Array, i: int, j: int, estimate: Array) -> float:
    """Correlation between what item `i` contributes and the nearest contribution of item `j`."""
    a, b = evidence.columns[i], evidence.columns[j]
    if "process" in (evidence.items[i].effect.port, evidence.items[j].effect.port):
        return 0.0
    power = float(estimate @ G[a, a] @ estimate)
    gain, dof, _, _ = score_gain(G[b, b], G[b, a] @ estimate, evidence.G[b, b])
    return math.sqrt(max(0.0, gain / power)) if power > 0.0 and dof else 0.0


def describe(evidence: Evidence, robust: Robust, chosen: tuple[int, ...], position: int, rules: Search) -> Finding:
    """The effect at one place of the set, with its class and what would separate it."""
    i = chosen[position]
    others = tuple(j for k, j in enumerate(chosen) if k != position)
    item = evidence.items[i]
    G, c = evidence.after(others)
    _, _, estimate, _ = evidence.gain(i, G, c)
    process = item.effect.port == "process"
    return Finding(
        effect=item.effect.name,
        shape=dict(item.shape),
        members=members(evidence, robust, i, others, rules),
        experiment=item.effect.experiment.rstrip("."),
        prior_std=float(estimate[0]) if process else None,
        fixed=() if process else redundant(evidence, i, G),
    )


def redundant(evidence: Evidence, i: int, G: Array) -> tuple[str, ...]:
    """Columns of an item that the base and the item's other columns already contain (pivoted Cholesky)."""
    columns = evidence.columns[i]
    names = [term.name for term in evidence.items[i].terms]
    if len(names) == 1:
        return ()
    size = np.sqrt(np.maximum(np.diag(evidence.G[columns, columns]), 1e-300))
    A = G[columns, columns] / np.outer(size, size)
    kept: list[int] = []
    for _ in names:
        left = np.diag(A).copy()
        left[kept] = 0.0
        k = int(np.argmax(left))
        if left[k] < DEGENERATE_MIX:
            break
        A = A - np.outer(A[:, k], A[k]) / A[k, k]
        kept.append(k)
    return tuple(name for k, name in enumerate(names) if k not in kept)


def limits(evidence: Evidence, rules: Search) -> dict[str, float]:
    """Smallest coefficient of each one-column effect that this record would have shown with 95 % probability."""
    needed = -float(special.ndtri(rules.alpha / max(1, rules.examined) / 2.0)) + 1.645
    found: dict[str, float] = {}
    for item, columns in zip(evidence.items, evidence.columns, strict=True):
        information = float(evidence.G[columns.start, columns.start])
        if item.effect.width == 1 and item.effect.port in ("output", "position") and information > 0.0:
            size = needed / math.sqrt(information)
            found[item.effect.name] = min(size, found.get(item.effect.name, math.inf))
    return found
