"""Detectability: probability that an effect enters by the rules of the search, and results of a power analysis.

The scores of all alternatives are normal, c ~ N(G theta, G) with G = their Gram matrix given the base, so the search is
run on draws of c and no record is needed: every alternative at its trial shapes, the strongest ones also at shapes
between those, the price of coefficients, and the scatter of scores from block to block, by which significance is
divided.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import product
from typing import Annotated, ClassVar

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal._support.result import NotStored, Result
from accelcal._support.values import immutable
from accelcal.data import Array
from accelcal.diagnosis.experiment.drift_bandwidth import DriftBandwidth
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA, FINALISTS
from accelcal.diagnosis.search.beam import SearchRules, block_length, shrunk_inflation
from accelcal.diagnosis.search.hypotheses import Hypothesis, hypotheses_for
from accelcal.diagnosis.search.refine import grid_bracket
from accelcal.diagnosis.search.scores import DEGENERATE_MIX, BaseProjection, CandidateScores, scaled_gram
from accelcal.effects import Effect
from accelcal.estimation.run_state import RunState
from accelcal.model import Model

SHAPES_BETWEEN = 6
"""Shapes between two neighbouring trial shapes; the search finds the best one there by likelihood."""
INTENSITIES = np.linspace(-2.0, 9.0, 45)
"""Trial intensities of a random process: logarithms, in units of the one that its most visible mode needs."""


@dataclass(frozen=True, slots=True)
class DetectionModel:
    """Everything that takes part in the search of one run, before its residual is known."""

    state: RunState
    model: Model
    items: Sequence[Hypothesis]
    evidence: CandidateScores
    """Of `items`."""
    rules: SearchRules

    @classmethod
    def of(
        cls, state: RunState, model: Model, extra: Sequence[Effect] | None = None, alpha: float = FAMILYWISE_ALPHA
    ) -> DetectionModel:
        """All hypotheses that `diagnose` would examine on a run."""
        offered = hypotheses_for(state, model, extra)
        items = evenly_placed([item for item in offered if item.leading is None], state)
        return cls(state, model, items, evidence_of(state, model, items), SearchRules.of(state, len(offered), alpha))

    def item(self, effect: str, shape: Mapping[str, float]) -> Hypothesis:
        """An effect at its own shape, which need not be one of the trials; what the record determines is kept."""
        trials = [item for item in self.items if item.effect.name == effect]
        truth_term = trials[len(trials) // 2]
        return replace(truth_term, shape={**truth_term.shape, **shape})

    def distance(self, truth: Hypothesis, sizes: Array) -> float:
        """Distance of an effect from zero in standard deviations, the base projected out."""
        A = self.evidence_of([truth]).G
        theta = coefficients(truth, sizes)[0]
        return math.sqrt(float(theta @ A @ theta))

    def detection(self, truth: Hypothesis, sizes: Array, draws: int = 4000) -> float:
        """Probability that any effect enters when one is present.

        Parameters
        ----------
        truth : the effect at its own shape, which need not be one of the trials.
        sizes : (width,) its coefficients; for a random process (1,), its intensity.
        draws : number of simulated sets of scores.
        """
        finalists = self.finalists(truth, sizes)
        refined = [other for item in finalists for other in shapes_between(item, self.state)]
        evidence = self.evidence_of([*self.items, *refined, truth])
        rng = np.random.default_rng(0)
        scores = drawn_scores(evidence.G, rng, draws)
        scores += coefficients(truth, sizes, rng, draws) @ evidence.G[evidence.columns[-1]]
        deviate = rng.standard_normal(draws)
        scatter = self.scatter(finalists, truth, sizes, deviate)
        entered = np.zeros(draws, dtype=bool)
        for item, columns in zip(evidence.items, evidence.columns, strict=True):
            if item is truth and not proposed_by_record(truth):
                continue
            gain, dof = drawn_gains(item, evidence.G[columns, columns], scores[:, columns])
            if dof > 0:
                significant, worth = self.rules.required_gains(dof, item)
                entered |= (gain > significant * scatter.get(item.effect.name, 1.0)) & (gain > worth)
        return float(np.mean(entered))

    def evidence_of(self, items: Sequence[Hypothesis]) -> CandidateScores:
        """Gram matrix of hypotheses with the model's free parameters projected out."""
        return evidence_of(self.state, self.model, items)

    def finalists(self, truth: Hypothesis, sizes: Array) -> list[Hypothesis]:
        """The effects with the largest expected gain when the truth is present, each at its best trial shape."""
        nearest = min(
            (i for i, item in enumerate(self.items) if item.effect.name == truth.effect.name),
            key=lambda i: sum(abs(v - truth.shape[k]) / max(abs(v), 1e-12) for k, v in self.items[i].shape.items()),
        )
        G, columns = self.evidence.G, self.evidence.columns
        expected = coefficients(truth, sizes) @ G[columns[nearest]]
        best: dict[str, tuple[float, int]] = {}
        for i, item in enumerate(self.items):
            gain, dof = drawn_gains(item, G[columns[i], columns[i]], expected[:, columns[i]])
            if dof > 0:
                name = item.effect.name
                best[name] = max(best.get(name, (-math.inf, -1)), (float(gain[0]), i))
        return [self.items[i] for _, i in sorted(best.values(), reverse=True)[:FINALISTS]]

    def scatter(
        self, finalists: Sequence[Hypothesis], truth: Hypothesis, sizes: Array, deviate: Array
    ) -> dict[str, Array]:
        """Draws of the ratio by which significance of each finalist is divided, at least 1; (draws,) by effect.

        Block scores s of a finalist's direction, taken from the residual of all finalists, have the covariance S =
        diag(w) - U U', w the share of each block in the direction's power and U what the finalists explain. Their sum
        of squares is a weighted sum of chi-squares: by its first two moments (Satterthwaite 1946) a multiple of one,
        drawn with the cube-root law (Wilson, Hilferty 1931). All rivals see one noise, hence one `deviate` for all of
        them.
        """
        named = [truth if item.effect.name == truth.effect.name else item for item in finalists]
        remaining = self.evidence_of([*named, truth])
        t, _, columns_of = (np.concatenate(parts, axis=-1) for parts in zip(*remaining.rows(), strict=True))
        X = columns_of.T
        expected = coefficients(truth, sizes) @ remaining.G[remaining.columns[-1]]
        length = block_length(self.state)
        edges = np.flatnonzero(np.diff(np.floor(t / length), prepend=-1.0))
        scaled, size = scaled_gram(remaining.G)
        values, vectors = np.linalg.eigh(scaled)
        good = values > 1e-9
        Q = (X / size) @ (vectors[:, good] / np.sqrt(values[good]))
        scatters = {}
        for item, columns in zip(named, remaining.columns, strict=False):
            if item.effect.port == "process":
                continue
            weights = np.linalg.pinv(remaining.G[columns, columns], rcond=DEGENERATE_MIX) @ expected[0, columns]
            x = X[:, columns] @ weights
            power = float(x @ x)
            if power <= 0.0:
                continue
            w = np.add.reduceat(x**2, edges) / power
            U = np.add.reduceat(x[:, None] * Q, edges) / math.sqrt(power)
            S = np.diag(w) - U @ U.T
            mean, variance = float(np.trace(S)), 2.0 * float(np.sum(S**2))
            a = variance / mean**2 / 9.0  # 2/(9 nu), nu = 2 mean²/variance
            scatters[item.effect.name] = shrunk_inflation(mean * (1.0 - a + deviate * math.sqrt(a)) ** 3, w)
        return scatters


def evidence_of(state: RunState, model: Model, items: Sequence[Hypothesis]) -> CandidateScores:
    """Gram matrix of the hypotheses with the model's free parameters projected out."""
    return CandidateScores([BaseProjection(state, model)], items)


def evenly_placed(items: Sequence[Hypothesis], state: RunState) -> list[Hypothesis]:
    """Hypotheses with the shapes that a record would propose replaced by values spread evenly over their span."""
    s = state.signals
    assert s is not None
    picked = {item.effect.name: [n for n, shape in item.effect.shapes.items() if shape.picked] for item in items}
    placed = [item for item in items if not item.brackets or not picked[item.effect.name]]
    for item in {item.effect.name: item for item in items if item.brackets}.values():
        for name in picked[item.effect.name]:
            grid = item.effect.shapes[name].grid(s)
            placed += [replace(item, shape={**item.shape, name: float(value)}, brackets={}) for value in grid]
    return placed


def proposed_by_record(item: Hypothesis) -> bool:
    """Whether trial instants are taken from the record, so that the true one is among them."""
    return item.effect.port == "position" and "instant" in item.shape


def shapes_between(item: Hypothesis, state: RunState) -> list[Hypothesis]:
    """The hypothesis at shapes between the neighbours of its trial shape, where the search refines it."""
    s = state.signals
    assert s is not None
    choices: list[list[tuple[str, float]]] = []
    for name, declared in item.effect.shapes.items():
        value = item.shape[name]
        grid = declared.grid(s)
        held = item.brackets.get(name) == (value, value)
        if len(grid) < 2 or held or proposed_by_record(item):
            choices.append([(name, value)])
            continue
        below, above = grid_bracket(grid, declared.span(s), value)
        choices.append([(name, float(v)) for v in np.linspace(below, above, SHAPES_BETWEEN + 2)[1:-1]])
    shapes = [dict(choice) for choice in product(*choices)]
    return [replace(item, shape=shape) for shape in shapes if shape != dict(item.shape)]


def drawn_scores(G: Array, rng: np.random.Generator, draws: int) -> Array:
    """Scores of noise alone, (draws, columns), with covariance `G`."""
    size = np.sqrt(np.maximum(np.diag(G), 0.0))
    values, vectors = np.linalg.eigh(scaled_gram(G)[0])
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(rng.standard_normal((draws, len(G))) @ root.T * size)


def coefficients(truth: Hypothesis, sizes: Array, rng: np.random.Generator | None = None, draws: int = 1) -> Array:
    """Coefficients of the truth in each draw, (draws, width) or (1, width); those of a random process are random."""
    if truth.effect.port != "process":
        return np.atleast_2d(sizes)
    if rng is None:
        return np.full((1, truth.effect.width), float(sizes[0]))
    return np.asarray(sizes[0] * rng.standard_normal((draws, truth.effect.width)))


def drawn_gains(item: Hypothesis, A: Array, b: Array) -> tuple[Array, int]:
    """Twice the log-likelihood gain of a hypothesis in each draw, (draws,), and its degrees of freedom.

    Computed as the search does for one record (`score_gain`, `variance_gain`).
    """
    if item.effect.port == "process":
        return random_process_gains(A, b), 1
    if item.effect.width == 1:
        if A[0, 0] <= 0.0:
            return np.zeros(len(b)), 0
        gain = b[:, 0] ** 2 / A[0, 0]
        return (np.where(b[:, 0] > 0.0, gain, 0.0) if item.effect.traits.positive else gain), 1
    scaled, size = scaled_gram(A)
    values, vectors = np.linalg.eigh(scaled)
    good = values > DEGENERATE_MIX
    return np.sum(((b / size) @ (vectors[:, good] / np.sqrt(values[good]))) ** 2, axis=1), int(np.sum(good))


def random_process_gains(A: Array, b: Array) -> Array:
    """max_s [b'(I/s² + A)^-1 b - log det(I + s² A)] in each draw, over a fine grid of s."""
    values, vectors = np.linalg.eigh(A)
    values = np.maximum(values, 0.0)
    s2 = np.exp(2.0 * INTENSITIES) / max(float(np.max(values)), 1e-300)
    weights = s2 / (1.0 + s2 * values[:, None])
    explained = (b @ vectors) ** 2 @ weights - np.sum(np.log1p(s2 * values[:, None]), axis=0)
    return np.asarray(np.maximum(np.max(explained, axis=1), 0.0))


@dataclass(frozen=True, slots=True)
class Detectability:
    """Detection limit of one effect, at the trial shape at which it is most visible."""

    effect: str
    unit: str
    shape: Mapping[str, float]
    parts: tuple[str, ...]
    """Names of its columns; one empty name where it has one column, or where its one coefficient is an intensity."""
    d: tuple[float, ...]
    """Standard deviations per unit coefficient, by part, the base projected out."""
    smallest: tuple[float, ...]
    """Size that is detected with 95 % probability, by part, in `unit`; infinite where the effect is not visible."""
    largest: float
    """Largest contribution at that size, of the most visible part."""
    largest_unit: str
    """m/s², or m for what acts on the encoder."""
    members: tuple[str, ...]
    """Effects whose signature is confounded with its own, itself first."""
    experiment: str
    """Experiment that separates them."""

    @property
    def visible(self) -> bool:
        """Whether it is visible before it is as large as the motion itself."""
        return math.isfinite(min(self.smallest))


@dataclass(frozen=True, slots=True)
class Group:
    """Effects whose signatures are nearly equal, and the experiment that separates them."""

    members: tuple[str, ...]
    correlation: float
    """Least |rho| between the first and the others."""
    experiment: str


@immutable
@dataclass(frozen=True, slots=True)
class Power(Result):
    """What a record, or a planned motion, can detect."""

    tables_in: ClassVar[str] = "results.experiments"

    detectabilities: tuple[Detectability, ...]
    """In the order of the catalogue."""
    ties: tuple[Group, ...]
    examined: int
    """Alternatives that `diagnose` would examine."""
    blocks: int
    """Effective blocks."""
    alpha: float
    detection_model: Annotated[
        DetectionModel | None, NotStored("accelcal.power(recording) makes it from the recording")
    ] = field(repr=False, compare=False)
    """Model from which probabilities of detection are simulated; None in one that was pickled."""
    name: str = ""
    drift: DriftBandwidth | None = None
    """Detectable drift bandwidth; None where a plan of several is only compared."""

    def __repr__(self) -> str:
        visible = sum(effect.visible for effect in self.detectabilities)
        return f"Power({self.name!r}: {visible} of {len(self.detectabilities)} effects are detectable)"

    @property
    def of_run(self) -> DetectionModel:
        """The model of the run.

        Raises
        ------
        ValueError
            If it was left behind when this was pickled.
        """
        if self.detection_model is None:
            raise AccelcalError("this was pickled, without the run; accelcal.power(model, recording) makes it anew")
        return self.detection_model

    def __getstate__(self) -> list[object]:
        """What a pickle holds: all but the model of the run, which is as large as the recording."""
        return [None if f.name == "detection_model" else getattr(self, f.name) for f in fields(self)]

    def __copy__(self) -> Power:
        return self

    def __deepcopy__(self, memo: object) -> Power:
        return self

    def _ipython_key_completions_(self) -> list[str]:
        """Names that a notebook offers behind power[."""
        return [effect.effect for effect in self.detectabilities]

    def __getitem__(self, effect: str) -> Detectability:
        """Return the detection limit of `effect`."""
        for detectability in self.detectabilities:
            if detectability.effect == effect:
                return detectability
        effects = ", ".join(s.effect for s in self.detectabilities)
        raise KeyError(f"{effect!r} is in the model or cannot be tested on this record; it has {effects}")

    def detection(self, effect: str, size: float | Sequence[float], shape: Mapping[str, float] | None = None) -> float:
        """Probability that any effect enters when `effect` is present at a given size.

        Rivals share its signature in part and have their own share of the noise, so one of them may enter where the
        effect just fails; the search refines shapes and divides significance by the scatter of blocks. All of that is
        simulated (:mod:`accelcal.diagnosis.experiment.detectability`).

        Parameters
        ----------
        effect : name.
        size : coefficient in its unit, the intensity of a random process; of several parts one value for each, or
            a single one for the most visible part.
        shape : its shape parameters; by default the most visible one.
        """
        detectability = self[effect]
        truth = self.of_run.item(effect, detectability.shape if shape is None else shape)
        sizes = np.atleast_1d(np.asarray(size, dtype=np.float64))
        if len(sizes) == 1 and len(detectability.parts) > 1:
            sizes = sizes * (np.arange(len(detectability.parts)) == int(np.argmax(detectability.d)))
        if len(sizes) != len(detectability.parts):
            raise AccelcalError(
                f"{effect!r} has {len(detectability.parts)} parts ({', '.join(detectability.parts)}), not {len(sizes)}"
            )
        return self.of_run.detection(truth, sizes)
