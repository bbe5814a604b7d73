"""Smallest detectable size of every effect, and what could not be told apart.

The distance at which an effect stands from nothing is d = |theta| sqrt(A), A = its information once the base is
projected out (derivations D3.5). A depends on the motion and the noise alone; what was measured does not enter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.recording import Recording
from accelcal.diagnosis.change_points import usable
from accelcal.diagnosis.policy import CONFOUNDED_CORRELATION, DETECTION_PROBABILITY, FAMILYWISE_ALPHA
from accelcal.diagnosis.search.beam import Search
from accelcal.diagnosis.search.confounding import shared
from accelcal.diagnosis.search.detection_limits import sizes
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.likelihood_gain import scale_of, variance_gain
from accelcal.diagnosis.search.scan import largest
from accelcal.diagnosis.search.scores import CandidateScores
from accelcal.diagnosis.search.thresholds import entry_gains
from accelcal.effects import Effect
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.run_state import RunState
from accelcal.experiment.detection_probability import DetectionModel
from accelcal.model import Model

SCHEMA = "accelcal/power/1"
WANDERS = 40
"""Random walks that the smallest detectable intensity of a wandering bias is read from."""


@dataclass(frozen=True, slots=True)
class Detectability:
    """How well one effect can be seen, at the trial shape at which it is seen best."""

    effect: str
    unit: str
    shape: Mapping[str, float]
    parts: tuple[str, ...]
    """Names of its columns; one empty name where it has one, or where its one coefficient is an intensity."""
    d: tuple[float, ...]
    """Standard deviations per unit coefficient, by part, the base taken out."""
    smallest: tuple[float, ...]
    """Size that is detected with 95 % probability, by part, in `unit`; infinite where it is not seen at all."""
    largest: float
    """Largest contribution at that size, of the part that is seen best."""
    largest_unit: str
    """m/s², or m for what acts on the encoder."""
    members: tuple[str, ...]
    """Effects whose signature cannot be told from its own, itself first."""
    experiment: str
    """What would separate them."""

    @property
    def seen(self) -> bool:
        """Whether it is seen before it is as large as the motion itself."""
        return math.isfinite(min(self.smallest))


@dataclass(frozen=True, slots=True)
class Group:
    """Effects whose signatures are nearly one, and the experiment that would separate them."""

    members: tuple[str, ...]
    correlation: float
    """Least |rho| between the first and the others."""
    experiment: str


@dataclass(frozen=True, slots=True)
class Power:
    """What a record, or a planned motion, can see."""

    sights: tuple[Detectability, ...]
    """In the order of the catalogue."""
    ties: tuple[Group, ...]
    examined: int
    """Alternatives that `diagnose` would look at."""
    blocks: int
    """Effective blocks."""
    alpha: float
    contest: DetectionModel = field(repr=False, compare=False)
    """What a probability of detection is drawn from."""
    name: str = ""

    def __getitem__(self, effect: str) -> Detectability:
        """Return how well `effect` is seen."""
        for sight in self.sights:
            if sight.effect == effect:
                return sight
        known = ", ".join(s.effect for s in self.sights)
        raise KeyError(f"{effect!r} is in the model or cannot be tested on this record; it has {known}")

    def detection(self, effect: str, size: float | Sequence[float], shape: Mapping[str, float] | None = None) -> float:
        """Probability that something enters when an effect is there at a given size.

        Its rivals share its signature in part and have their own share of the noise, so they enter where it just
        fails; the search refines shapes and divides significance by the scatter of blocks. All of that is drawn
        (:mod:`accelcal.experiment.detection_probability`); `predicted_detection` is the probability that an effect
        enters on its own.

        Parameters
        ----------
        effect : name.
        size : coefficient in its unit, the intensity of a wandering bias; of several parts one value for each, or
            a single one for the part that is seen best.
        shape : its shape parameters; by default those at which it is seen best.
        """
        sight = self[effect]
        truth = self.contest.item(effect, sight.shape if shape is None else shape)
        sizes = np.atleast_1d(np.asarray(size, dtype=np.float64))
        if len(sizes) == 1 and len(sight.parts) > 1:
            sizes = sizes * (np.arange(len(sight.parts)) == int(np.argmax(sight.d)))
        if len(sizes) != len(sight.parts):
            raise ValueError(f"{effect!r} has {len(sight.parts)} parts ({', '.join(sight.parts)}), not {len(sizes)}")
        return self.contest.detection(truth, sizes)

    def to_dict(self) -> dict[str, Any]:
        """Content of `power --json`."""
        return {
            "schema": SCHEMA,
            "name": self.name,
            "candidates_examined": self.examined,
            "blocks": self.blocks,
            "alpha": self.alpha,
            "probability": DETECTION_PROBABILITY,
            "effects": [sight_to_dict(s) for s in self.sights],
            "ties": [
                {"members": list(g.members), "correlation": g.correlation, "experiment": g.experiment}
                for g in self.ties
            ],
        }


def sight_to_dict(sight: Detectability) -> dict[str, Any]:
    """One effect; what is not seen has null for its sizes."""

    def plain(values: tuple[float, ...]) -> Any:
        finite = [v if math.isfinite(v) else None for v in values]
        return finite[0] if len(finite) == 1 else finite

    return {
        "effect": sight.effect,
        "unit": sight.unit,
        "shape": dict(sight.shape),
        "parts": [part for part in sight.parts if part],
        "d_per_unit": plain(sight.d),
        "smallest_detectable": plain(sight.smallest),
        "largest_contribution": plain((sight.largest,)),
        "largest_contribution_unit": sight.largest_unit,
        "class": list(sight.members),
        "experiment": sight.experiment,
    }


def power(
    source: Recording | RunState,
    model: Model | None = None,
    *,
    extra: Sequence[Effect] = (),
    alpha: float = FAMILYWISE_ALPHA,
    start: float | None = None,
    end: float | None = None,
) -> Power:
    """What a record can see: the smallest detectable size of every effect, and the ties.

    Parameters
    ----------
    source : a recording, which is fitted first up to its first break, or a run that has been fitted.
    model : what is known already; the linear model by default. For a fitted run the model it was fitted with.
    extra : effects of the user's own, beside the catalogue.
    alpha : family-wise false-alarm rate of `diagnose`.
    start, end : s, optional; only this part of a recording is used.

    Raises
    ------
    NotIdentifiable
        If the motion does not excite what the model already contains.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> made = ac.simulate("bursts", seconds=20.0, rig=ac.ADXL105_RIG, parameters={}, rng=np.random.default_rng(1))
    >>> seen = power(made.recording)
    >>> seen.detection("quadratic", seen["quadratic"].smallest[0]) > 0.94
    True
    """
    model = Model.linear() if model is None else model
    if isinstance(source, RunState):
        return detectability_of(source, model, extra, alpha)
    if start is None and end is None:
        whole = usable(source)
        start, end = whole.start, whole.end
    solution = solve_runs(model, [source], start=start, end=end)
    return detectability_of(solution.passes[0], model, extra, alpha)


def detectability_of(
    one: RunState, model: Model, extra: Sequence[Effect] = (), alpha: float = FAMILYWISE_ALPHA
) -> Power:
    """What the motion and the noise of one run can see."""
    contest = DetectionModel.of(one, model, extra, alpha)
    items, rules, evidence = contest.items, contest.rules, contest.evidence
    best: dict[str, tuple[int, tuple[float, ...], tuple[float, ...]]] = {}
    for i, item in enumerate(items):
        d, smallest = sizes(evidence, i, rules)
        name = item.effect.name
        if name not in best or min(smallest) < min(best[name][2]):
            best[name] = (i, d, smallest)
    for name, (i, d, _) in best.items():
        if items[i].effect.port == "process":
            best[name] = (i, d, (intensity(evidence, i, rules),))
    blind = {name for name, (_, _, smallest) in best.items() if not math.isfinite(min(smallest))}
    firsts = {name: i for name, (i, _, _) in best.items() if name not in blind}
    related = {name: rivals(evidence, i, firsts) for name, i in firsts.items()}
    sights = tuple(
        Detectability(
            effect=name,
            unit=items[i].effect.unit,
            shape=dict(items[i].shape),
            parts=items[i].effect.parts if len(d) > 1 else ("",),
            d=d,
            smallest=smallest,
            largest=largest_at(items[i], smallest, one),
            largest_unit="m" if items[i].effect.port == "position" else "m/s²",
            members=(name, *related.get(name, {})),
            experiment=items[i].effect.experiment,
        )
        for name, (i, d, smallest) in best.items()
    )
    return Power(
        sights=sights,
        ties=groups(sights, related),
        examined=rules.examined,
        blocks=rules.blocks,
        alpha=alpha,
        name=one.run.recording.name,
        contest=contest,
    )


def intensity(evidence: CandidateScores, i: int, rules: Search) -> float:
    """Least intensity s of a wandering bias that enters in 95 % of its walks: scores b ~ N(0, A + s² A²).

    From `WANDERS` fixed walks; their gain at the wanted probability is that of normal gains' square roots.
    """
    A = evidence.G[evidence.columns[i], evidence.columns[i]]
    needed = math.sqrt(max(entry_gains(rules.examined, rules.blocks, rules.alpha)))
    values, vectors = np.linalg.eigh(A)
    values = np.maximum(values, 0.0)
    z = np.random.default_rng(0).standard_normal((WANDERS, len(values)))

    def short(log_s: float) -> bool:
        spread = np.sqrt(values + math.exp(2.0 * log_s) * values**2)
        roots = [math.sqrt(variance_gain(A, vectors @ (spread * one))[0]) for one in z]
        return float(np.quantile(roots, 1.0 - DETECTION_PROBABILITY)) < needed

    low = -0.5 * math.log(float(np.max(values, initial=1e-300)))
    high = low + math.log(1e3)  # a thousand standard deviations of the mode that is seen best
    if short(high):
        return math.inf
    for _ in range(8):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if short(middle) else (low, middle)
    return math.exp(0.5 * (low + high))


def largest_at(item: Hypothesis, smallest: tuple[float, ...], one: RunState) -> float:
    """Largest contribution of the part that is seen best, at its smallest detectable size."""
    if not math.isfinite(min(smallest)):
        return math.inf
    estimate = np.zeros(1 if item.effect.port == "process" else len(item.terms))
    k = int(np.argmin(smallest))
    estimate[k] = smallest[k]
    return largest(item, estimate, one)


def rivals(evidence: CandidateScores, i: int, firsts: Mapping[str, int]) -> dict[str, float]:
    """Effects whose signature at one of their trial shapes is that of item `i`, with |rho|."""
    item = evidence.items[i]
    if item.effect.family:
        return {}
    direction = strongest(evidence, i)
    found: dict[str, float] = {}
    for j, rival in enumerate(evidence.items):
        name = rival.effect.name
        if name == item.effect.name or name not in firsts or rival.effect.family:
            continue
        rho = shared(evidence, evidence.G, i, j, direction)
        if rho > max(CONFOUNDED_CORRELATION, found.get(name, 0.0)):
            found[name] = min(rho, 1.0)
    return dict(sorted(found.items(), key=lambda pair: -pair[1]))


def strongest(evidence: CandidateScores, i: int) -> Array:
    """The mixture of an item's columns that is seen best."""
    A = evidence.G[evidence.columns[i], evidence.columns[i]]
    size = scale_of(np.diag(A))
    return np.asarray(np.linalg.eigh(A / np.outer(size, size))[1][:, -1] / size)


def groups(sights: Sequence[Detectability], related: Mapping[str, Mapping[str, float]]) -> tuple[Group, ...]:
    """Effects with all that they are tied to, largest first; a group that another one holds whole is left out."""
    kept: list[Group] = []
    for sight in sorted(sights, key=lambda s: -len(s.members)):
        if len(sight.members) == 1 or any(set(sight.members) <= set(g.members) for g in kept):
            continue
        kept.append(Group(sight.members, min(related[sight.effect].values()), sight.experiment))
    return tuple(kept)
