"""The class of an effect that entered: which rivals are confounded with it, and which of its columns the model
contains."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from scipy import special

from accelcal._support.result import Storable
from accelcal.data import Array, Recording, RecordingError, batches
from accelcal.data.units import coefficient
from accelcal.diagnosis.policy import (
    CLASS_WEIGHT,
    RESOLVED_MEMORIES,
    RESOLVED_WAVE_PERIODS,
)
from accelcal.diagnosis.search.beam import BlockScatter, SearchRules
from accelcal.diagnosis.search.homogeneity import PartSizes
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.scores import DEGENERATE_MIX, CandidateScores, scale_of, score_gain
from accelcal.effects import BUILT_IN, Effect, SizePrior, find, is_local
from accelcal.estimation.run_state import RunState
from accelcal.model import Model, Prior
from accelcal.signals.signals import Signals

CLASS_ODDS = math.log(CLASS_WEIGHT / (1.0 - CLASS_WEIGHT))
"""Log-evidence within which the worse of two alternatives belongs to the class of the better."""
TIED_CORRELATION = math.sqrt(1.0 - 2.0 * CLASS_ODDS / 10.0**2)
"""Correlation of signatures from which one effect at ten standard deviations belongs to the class of the other."""
SAME_CORRELATION = 0.99
"""Correlation with a product from which the memory of its driver adds nothing to it."""
EMPTY_COLUMN = 1e-8
"""Share of the power of a hypothesis's strongest column below which another column counts as empty."""
CHUNK = 1 << 18
"""Samples at which an effect without memory is evaluated at a time."""


@dataclass(frozen=True, slots=True)
class Weights:
    """Posterior weights of one effect among those that explain the same."""

    by_record: float = math.nan
    """All of them equally likely before the record, whatever their sizes; nan where it was not examined."""
    with_sheets: float = math.nan
    """Among the members of its class, with the priors of their sizes; nan without priors."""
    source: str = ""
    """Where the prior of its size comes from; empty for that of the catalogue."""


def size_priors(
    recordings: Sequence[Recording], prior: Mapping[str, Prior] | Literal["none"] | None
) -> dict[str, SizePrior] | None:
    """Priors of sizes by effect that stand in place of the catalogue's; None where weights are to go without any.

    Parameters
    ----------
    recordings : with the sizes that their sidecars declare.
    prior : of coefficients by name, as of a fleet, before those; those of effects of several columns are left out.

    Raises
    ------
    RecordingError
        Naming sidecar and key, if there is no such effect, its unit is of another dimension, or two of them differ.
    """
    if prior == "none":
        return None
    sizes: dict[str, SizePrior] = {}
    for recording in recordings:
        sidecar = recording.origin.sidecar or recording.title
        for name, text in recording.prior_sizes.items():
            try:
                effect = find(name)
                size = replace(effect.prior, scale=coefficient(text, effect.unit), source=Path(sidecar).name)
            except ValueError as error:
                raise RecordingError(f"{sidecar}: prior.{name}: {error}") from None
            if (other := sizes.setdefault(name, size)).scale != size.scale:
                raise RecordingError(f"{sidecar}: prior.{name}: found {text}, but {other.source} has another; keep one")
    of_one = {name: p for name, p in (prior or {}).items() if find(name.partition(".")[0]).name == name}
    return sizes | {name: SizePrior(p.std, "fleet", (1.0,), p.mean) for name, p in of_one.items()}


@dataclass(frozen=True, slots=True)
class DetectedEffect(Storable):
    """An effect that entered, with its confounding class and the experiment that separates the class."""

    derived: ClassVar[tuple[str, ...]] = ("members",)

    effect: str
    shape: Mapping[str, float]
    weights: Mapping[str, Weights]
    """Posterior weights of the members of its confounding class, itself first."""
    experiment: str
    prior_std: float | None = None
    """Intensity of a random-walk or Gauss-Markov bias; None for constant coefficients."""
    fixed: tuple[str, ...] = ()
    """Columns held at 0: those that the model already contains, and those that a coarse curve does without."""
    parts: PartSizes = field(default_factory=PartSizes.none)
    """Its sizes in the parts of the runs."""
    bands: PartSizes = field(default_factory=PartSizes.none)
    """Its sizes in bands of frequency."""
    largest: float = 0.0
    """Its largest contribution over the runs, m/s² (m at the encoder)."""

    @property
    def members(self) -> tuple[str, ...]:
        """Its confounding class on this record, itself first."""
        return tuple(self.weights)

    @property
    def unequal(self) -> PartSizes | None:
        """Sizes that are not the same everywhere; None where all are."""
        return next((sizes for sizes in (self.parts, self.bands) if not sizes.homogeneous), None)

    def enter(self, model: Model) -> Model:
        """Return the model with this effect; a coarse curve of the model becomes the finer one."""
        if self.effect in model.effects:
            terms = (term.name for term in model.terms if term.effect.name == self.effect)
            return model.release(*(name for name in terms if name in model.fixed and name not in self.fixed))
        shapes = {self.effect: dict(self.shape)} if self.shape else None
        grown = model.add(self.effect, shapes=shapes)
        if self.prior_std is not None:
            std = self.prior_std
            names = [t.name for t in grown.terms if t.effect.name == self.effect]
            grown = model.add(self.effect, shapes=shapes, priors={n: Prior(0.0, std) for n in names})
        return grown.freeze(**dict.fromkeys(self.fixed, 0.0)) if self.fixed else grown


def confounding_class(
    evidence: CandidateScores, scatter: BlockScatter, i: int, others: Sequence[int], rules: SearchRules
) -> dict[str, Weights]:
    """Effects that are confounded with hypothesis `i` on this record, itself first, with their posterior weights.

    The smallest set that holds `CLASS_WEIGHT` of their posterior weight, all of them equally likely before the record.
    A nonparametric curve counts if its variable is not the effect's.
    """
    G, _ = evidence.given(others)
    gains, dofs = evidence.gains(others)
    _, _, estimate, _ = evidence.gain(i, others)
    item = evidence.items[i]
    inflation = scatter.inflation(i, others)
    specific = item.effect.family is None and item.effect.port != "process"
    log_evidence: dict[str, float] = {}
    best: dict[str, int] = {}
    for j, rival in enumerate(evidence.items):
        name = rival.effect.name
        if j in others or not dofs[j] or (specific and rival.effect.family and not beats(rival.effect, item.effect)):
            continue
        product = rival.effect.mechanism and item.effect.name in rival.effect.search.includes
        if product and contribution_correlation(evidence, G, i, j, estimate) > SAME_CORRELATION:
            continue  # its memory is too short to be one
        gain = float(gains[j]) / inflation
        value = rules.net_gain(gain, int(dofs[j]), rival, evidence.cost(j, others)) / 2.0
        if value > log_evidence.get(name, -math.inf):
            log_evidence[name], best[name] = value, j
    weights_of_all = dict(zip(log_evidence, special.softmax(list(log_evidence.values())).tolist(), strict=True))
    members = credible_set(log_evidence)
    names = [item.effect.name, *(name for name in members if name != item.effect.name)]
    with_sizes = [rules.evidence_with_size(evidence, best[name], others, inflation) for name in names]
    sources = {name: prior.source for name, prior in (rules.priors or {}).items()}
    return {
        name: Weights(weights_of_all.get(name, 0.0), with_sheets, sources.get(name, ""))
        for name, with_sheets in zip(names, special.softmax(with_sizes).tolist(), strict=True)
    }


def with_members(weights: Mapping[str, Weights], others: Iterable[str]) -> dict[str, Weights]:
    """A class with further members, which no weights have."""
    return {**weights, **{name: Weights() for name in others if name not in weights}}


def credible_set(log_evidence: Mapping[str, float]) -> dict[str, float]:
    """The smallest set of alternatives with `CLASS_WEIGHT` of the posterior weight, likeliest first, and the weights;
    all are equally likely before."""
    ranked = sorted(log_evidence, key=lambda name: -log_evidence[name])
    weights = special.softmax([log_evidence[name] for name in ranked]) if ranked else []
    count = 1 + int(np.searchsorted(np.cumsum(weights), CLASS_WEIGHT))
    return dict(zip(ranked[:count], weights, strict=False))


def likeliest(
    evidence: CandidateScores, scatter: BlockScatter, chosen: tuple[int, ...], rules: SearchRules
) -> tuple[int, ...]:
    """A set in which the first member that given the others is not in its own confounding class gives way to the
    likeliest one that is significant in its place; what is then no longer significant, or deferred, leaves.

    What fits best as a set may be a wrong effect and a random process that repairs it.
    """
    for position, i in enumerate(chosen):
        others, name = chosen[:position] + chosen[position + 1 :], evidence.items[i].effect.name
        weights = confounding_class(evidence, scatter, i, others, rules)
        best = max(weights, key=lambda rival: weights[rival].by_record)
        if 1.0 - weights[name].by_record > CLASS_WEIGHT and name != best:
            trials = [j for j, item in enumerate(evidence.items) if item.effect.name == best and j not in others]
            j = max(trials, key=lambda trial: rules.net_gain_given(evidence, None, trial, others))
            if rules.net_gain_given(evidence, scatter, j, others) > -math.inf:
                return rules.undeferred(evidence, rules.significant_members(evidence, scatter, (*others, j)))
    return chosen


def plainest(
    evidence: CandidateScores, scatter: BlockScatter, chosen: tuple[int, ...], rules: SearchRules
) -> tuple[int, ...]:
    """A set in which the plainest effect stands for those that look the same and explain as much: what an effect
    includes, and the plainest power of the acceleration. What adds to it significantly does not look the same.

    Where the specific force keeps its sign, as on a vertical axis, even and odd powers are alike, and chance decides
    which gains more. The bias and the scale factor, which are those at zero specific force, depend on the power.
    """
    for position, i in enumerate(chosen):
        others, effect = chosen[:position] + chosen[position + 1 :], evidence.items[i].effect
        plainer = [j for j, item in enumerate(evidence.items) if j not in others and is_plainer(item.effect, effect)]
        gains, dofs = evidence.gains(others)
        inflation = scatter.inflation(i, others)
        net_gains = {
            j: rules.net_gain(float(gains[j]) / inflation, int(dofs[j]), evidence.items[j], evidence.cost(j, others))
            for j in (i, *plainer)
        }
        for j in plainer:
            tied = dofs[j] and net_gains[i] - net_gains[j] < 2.0 * CLASS_ODDS
            if tied and rules.net_gain_given(evidence, scatter, i, (*others, j)) <= 0.0:
                chosen = (*chosen[:position], j, *chosen[position + 1 :])
                break
    return chosen


def is_plainer(other: Effect, effect: Effect) -> bool:
    """Whether an effect is the plainer one of two that look the same; of a process and what it is said to follow, the
    process."""
    if effect.mechanism is not None and other.port == "process":
        return other.traits.changes == effect.mechanism.carrier
    static, plain = effect.traits.static, other.traits.static
    if other.name in effect.search.includes or static is None or plain is None:
        return other.name in effect.search.includes
    return (
        plain.thermal == static.thermal
        and plain.odd != static.odd
        and not plain.mirrored
        and plain.power <= static.power
    )


def beats(curve: Effect, effect: Effect) -> bool:
    """Whether an effect has to beat a nonparametric curve: that of any one variable of which it is no function."""
    return bool(curve.function_of) and effect.name not in curve.covers


def contribution_correlation(evidence: CandidateScores, G: Array, i: int, j: int, estimate: Array) -> float:
    """Correlation between the contribution of hypothesis `i` and the nearest contribution of hypothesis `j`."""
    a, b = evidence.columns[i], evidence.columns[j]
    if "process" in (evidence.items[i].effect.port, evidence.items[j].effect.port):
        return 0.0
    power = float(estimate @ G[a, a] @ estimate)
    gain, dof, _, _ = score_gain(G[b, b], G[b, a] @ estimate, evidence.G[b, b])
    return math.sqrt(max(0.0, gain / power)) if power > 0.0 and dof else 0.0


def detected_effect(
    evidence: CandidateScores, scatter: BlockScatter, chosen: tuple[int, ...], position: int, rules: SearchRules
) -> DetectedEffect:
    """The effect at one place of the set, with its confounding class and the experiment that separates it."""
    i = chosen[position]
    others = tuple(j for k, j in enumerate(chosen) if k != position)
    item = evidence.items[i]
    G, _ = evidence.given(others)
    _, _, estimate, _ = evidence.gain(i, others)
    process = item.effect.port == "process"
    parts, bands = scatter.part_sizes(i, others)
    return DetectedEffect(
        effect=item.effect.name,
        shape=dict(item.shape),
        weights=with_members(
            confounding_class(evidence, scatter, i, others, rules),
            smooth_rivals(item, evidence.runs[0].column_filter.signals),
        ),
        experiment=item.effect.experiment.rstrip("."),
        prior_std=float(estimate[0]) if process else None,
        fixed=() if process else redundant(evidence, i, G),
        parts=parts,
        bands=bands,
        largest=max(largest(item, estimate, run.state) for run in evidence.runs),
    )


def largest(item: Hypothesis, estimate: Array, state: RunState) -> float:
    """Largest contribution of an effect over a run, m/s² (m at the encoder)."""
    s = state.signals
    stretch = CHUNK if is_local(item.effect) else len(s.t)
    maximum = 0.0
    for rows in batches(len(s.t), stretch):
        part = s.part(rows)
        columns = item.effect.column(part, **item.shape).reshape(len(part.t), -1)
        if item.effect.port == "process":
            size = estimate[0] * np.max(np.linalg.norm(columns, axis=1))
        else:
            size = np.max(np.abs(columns[:, : len(estimate)] @ estimate))
        maximum = max(maximum, float(size))
    return maximum


def smooth_rivals(item: Hypothesis, s: Signals) -> tuple[str, ...]:
    """What an effect is confounded with while the record shows a part of it alone, which is any smooth function.

    A wave over position with curves of it until the travel holds two periods; what follows the memory of a driver with
    drifts of its carrier until the record holds three time constants.
    """
    of = item.effect.mechanism
    if of is not None and RESOLVED_MEMORIES * item.shape["tau"] > s.length:
        drifts = (e for e in BUILT_IN if e.traits.changes == of.carrier and e.port != "process")
        return tuple(e.name for e in drifts if "instant" not in e.shapes)
    if RESOLVED_WAVE_PERIODS * item.shape.get("period", 0.0) <= float(np.ptp(s.p)):
        return ()
    return tuple(family.name for family in BUILT_IN if item.effect.name in family.covers)


def redundant(evidence: CandidateScores, i: int, G: Array) -> tuple[str, ...]:
    """Columns that a hypothesis does without, or that the base and its other columns contain (pivoted Cholesky)."""
    columns = evidence.columns[i]
    names = [term.name for term in evidence.items[i].terms]
    held = tuple(term.name for term in evidence.items[i].held)
    if len(names) == 1:
        return held
    power = np.diag(evidence.G[columns, columns])
    size = scale_of(power)
    A = G[columns, columns] / np.outer(size, size)
    independent: list[int] = []
    empty = power < EMPTY_COLUMN * np.max(power)
    for _ in names:
        left = np.diag(A).copy()
        left[independent] = left[empty] = 0.0
        k = int(np.argmax(left))
        if left[k] < DEGENERATE_MIX:
            break
        A = A - np.outer(A[:, k], A[k]) / A[k, k]
        independent.append(k)
    return (*(name for k, name in enumerate(names) if k not in independent), *held)
