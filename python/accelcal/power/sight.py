"""Smallest detectable size of every effect, and what could not be told apart.

The distance at which an effect stands from nothing is d = |theta| sqrt(A), A = its information once the base is
projected out (discovery 3.5). A depends on the motion and the noise alone; what was measured does not enter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import special

from accelcal.breaks import usable
from accelcal.diagnose import (
    ALPHA,
    NAMELESS,
    RIVAL_CORRELATION,
    Evidence,
    Item,
    Known,
    Search,
    block_length,
    candidates_for,
    largest,
    shared,
    variance_gain,
)
from accelcal.effects import Effect
from accelcal.fit import Pass, solve_runs
from accelcal.model import Model
from accelcal.recording import Array, Recording

SCHEMA = "accelcal/power/1"
SURE = 0.95
"""Probability with which the smallest detectable size is detected."""
WANDERS = 40
"""Random walks that the smallest detectable intensity of a wandering bias is read from."""
DRAWS = 4000
"""Draws of all scores that a probability of detection is read from; it errs by 0.8 points at most."""


@dataclass(frozen=True, slots=True)
class Sight:
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
    """Largest contribution at that size (of the part that is seen best), m/s² (m at the encoder)."""
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

    sights: tuple[Sight, ...]
    """In the order of the catalogue."""
    ties: tuple[Group, ...]
    examined: int
    """Alternatives that `diagnose` would look at."""
    blocks: int
    """Effective blocks."""
    alpha: float
    name: str = ""
    correlation: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False)
    """Of the signatures of all alternatives that have one column, at each of their trial shapes, (n, n)."""
    row: Mapping[str, int] = field(default_factory=dict)
    """Row of each effect in it, at the shape at which it is seen best."""

    def __getitem__(self, effect: str) -> Sight:
        """Return how well `effect` is seen."""
        for sight in self.sights:
            if sight.effect == effect:
                return sight
        known = ", ".join(s.effect for s in self.sights)
        raise KeyError(f"{effect!r} is in the model or cannot be tested on this record; it has {known}")

    def detection(self, effect: str, size: float) -> float:
        """Probability that something enters when an effect of one column is there at a given size.

        Its rivals share its signature in part and have their own share of the noise, so they enter where it just fails:
        from `DRAWS` fixed draws of the scores of all one-column alternatives. `predicted_detection` is the probability
        that the effect enters on its own, a few points lower.
        """
        if effect not in self.row:
            return predicted_detection(
                abs(size) * self[effect].d[0],
                self.examined,
                self.alpha,
                dof=len(self[effect].parts),
                blocks=self.blocks,
            )
        values, vectors = np.linalg.eigh(self.correlation)
        noise = np.random.default_rng(0).standard_normal((DRAWS, len(values)))
        scores = noise * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
        scores += abs(size) * self[effect].d[0] * self.correlation[self.row[effect]]
        needed = entry_gain(Search(self.examined, self.blocks, self.alpha), 1)
        return float(np.mean(np.max(scores**2, axis=1) > needed))

    def to_dict(self) -> dict[str, Any]:
        """Content of `power --json`."""
        return {
            "schema": SCHEMA,
            "name": self.name,
            "candidates_examined": self.examined,
            "blocks": self.blocks,
            "alpha": self.alpha,
            "probability": SURE,
            "effects": [sight_to_dict(s) for s in self.sights],
            "ties": [
                {"members": list(g.members), "correlation": g.correlation, "experiment": g.experiment}
                for g in self.ties
            ],
        }


def sight_to_dict(sight: Sight) -> dict[str, Any]:
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
        "class": list(sight.members),
        "experiment": sight.experiment,
    }


def power(
    source: Recording | Pass,
    model: Model | None = None,
    *,
    extra: Sequence[Effect] = (),
    alpha: float = ALPHA,
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
    if isinstance(source, Pass):
        return sight_of(source, model, extra, alpha)
    if start is None and end is None:
        whole = usable(source)
        start, end = whole.start, whole.end
    solution = solve_runs(model, [source], start=start, end=end)
    return sight_of(solution.passes[0], model, extra, alpha)


def sight_of(one: Pass, model: Model, extra: Sequence[Effect] = (), alpha: float = ALPHA) -> Power:
    """What the motion and the noise of one run can see."""
    items = candidates_for(one, model, extra)
    rules = rules_for(one, len(items), alpha)
    evidence = evidence_of(one, model, items)
    best: dict[str, tuple[int, tuple[float, ...], tuple[float, ...]]] = {}
    for i, item in enumerate(items):
        d, smallest = sizes(evidence, i, rules)
        name = item.effect.name
        if name not in best or min(smallest) < min(best[name][2]):
            best[name] = (i, d, smallest)
    for name, (i, d, _) in best.items():
        if items[i].effect.port == "process":
            best[name] = (i, d, (intensity(evidence, i, rules),))
    contributions = {name: largest_at(items[i], s, one) for name, (i, _, s) in best.items()}
    blind = {name for name, (i, _, _) in best.items() if contributions[name] > whole_motion(items[i], one)}
    firsts = {name: i for name, (i, _, _) in best.items() if name not in blind}
    related = {name: rivals(evidence, i, firsts) for name, i in firsts.items()}
    sights = tuple(
        Sight(
            effect=name,
            unit=items[i].effect.unit,
            shape=dict(items[i].shape),
            parts=items[i].effect.parts if len(d) > 1 else ("",),
            d=d,
            smallest=(math.inf,) * len(smallest) if name in blind else smallest,
            largest=math.inf if name in blind else contributions[name],
            members=(name, *related.get(name, {})),
            experiment=items[i].effect.experiment,
        )
        for name, (i, d, smallest) in best.items()
    )
    single = [i for i, item in enumerate(items) if item.effect.width == 1 and item.effect.port != "process"]
    rows = [
        evidence.columns[i].start for i in single if evidence.G[evidence.columns[i], evidence.columns[i]][0, 0] > 0.0
    ]
    size = np.sqrt(np.diag(evidence.G)[rows])
    return Power(
        sights=sights,
        ties=groups(sights, related),
        examined=len(items),
        blocks=rules.blocks,
        alpha=alpha,
        name=one.run.recording.name,
        correlation=evidence.G[np.ix_(rows, rows)] / np.outer(size, size),
        row={
            n: rows.index(evidence.columns[i].start)
            for n, i in firsts.items()
            if evidence.columns[i].start in rows and items[i].effect.width == 1
        },
    )


def rules_for(one: Pass, examined: int, alpha: float) -> Search:
    """Rules by which an effect would enter, as `diagnose` would apply them."""
    seconds = float(np.sum(one.counts)) * one.run.reading_step
    return Search(examined, int(seconds / block_length(one)), alpha)


def evidence_of(one: Pass, model: Model, items: Sequence[Item]) -> Evidence:
    """Gram matrix of the candidates with everything that the model leaves free projected out."""
    return Evidence([Known(one, [t for t in model.terms if t.name not in model.fixed])], items)


def entry_gain(rules: Search, dof: int, *, family: bool = False) -> float:
    """Gain beyond which an effect enters: significant over all alternatives, and worth its price."""
    significant = 2.0 * float(special.gammainccinv(dof / 2.0, math.exp(rules.threshold)))
    cost = dof * math.log(max(rules.blocks, 2)) + 2.0 * math.log(max(rules.examined, 2))
    return max(significant, cost / (NAMELESS if family else 1.0))


def predicted_detection(
    d: float, examined: int, alpha: float = ALPHA, *, dof: int = 1, blocks: int = 2, family: bool = False
) -> float:
    """Probability that an effect enters: its gain is noncentral chi-square with noncentrality d².

    Parameters
    ----------
    d : standard deviations at which the effect stands from nothing.
    examined : alternatives that are looked at.
    alpha : family-wise false-alarm rate.
    dof : coefficients of the effect.
    blocks : effective blocks of the record, which set the price of a coefficient.
    family : whether it is a shape without a name.

    Examples
    --------
    >>> [round(predicted_detection(d, examined=96), 2) for d in (0.0, 3.0, 4.05, 10.0)]
    [0.0, 0.15, 0.5, 1.0]
    """
    gain = entry_gain(Search(examined, blocks, alpha), dof, family=family)
    return 1.0 - float(special.chndtr(gain, dof, d**2))


def sizes(evidence: Evidence, i: int, rules: Search) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Standard deviations per unit coefficient of each part, and the sizes that are detected with certainty `SURE`."""
    effect, A = evidence.items[i].effect, evidence.G[evidence.columns[i], evidence.columns[i]]
    information = [float(np.trace(A))] if effect.port == "process" else [float(v) for v in np.diag(A)]
    dof = 1 if effect.port == "process" else effect.width
    needed = math.sqrt(float(special.chndtrinc(entry_gain(rules, dof, family=effect.family), dof, 1.0 - SURE)))
    d = tuple(math.sqrt(max(v, 0.0)) for v in information)
    return d, tuple(needed / x if x > 0.0 else math.inf for x in d)


def intensity(evidence: Evidence, i: int, rules: Search) -> float:
    """Least intensity s of a wandering bias that enters in 95 % of its walks: scores b ~ N(0, A + s² A²).

    From `WANDERS` fixed walks; their gain at the wanted probability is that of normal gains' square roots.
    """
    A = evidence.G[evidence.columns[i], evidence.columns[i]]
    needed = math.sqrt(entry_gain(rules, 1))
    values, vectors = np.linalg.eigh(A)
    values = np.maximum(values, 0.0)
    z = np.random.default_rng(0).standard_normal((WANDERS, len(values)))

    def short(log_s: float) -> bool:
        spread = np.sqrt(values + math.exp(2.0 * log_s) * values**2)
        roots = [math.sqrt(variance_gain(A, vectors @ (spread * one))[0]) for one in z]
        return float(np.quantile(roots, 1.0 - SURE)) < needed

    low = -0.5 * math.log(float(np.max(values, initial=1e-300)))
    high = low + math.log(1e3)  # a thousand standard deviations of the mode that is seen best
    if short(high):
        return math.inf
    for _ in range(8):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if short(middle) else (low, middle)
    return math.exp(0.5 * (low + high))


def largest_at(item: Item, smallest: tuple[float, ...], one: Pass) -> float:
    """Largest contribution of the part that is seen best, at its smallest detectable size."""
    if not math.isfinite(min(smallest)):
        return math.inf
    estimate = np.zeros(1 if item.effect.port == "process" else item.effect.width)
    k = int(np.argmin(smallest))
    estimate[k] = smallest[k]
    return largest(item, estimate, one)


def whole_motion(item: Item, one: Pass) -> float:
    """Largest acceleration of a run, m/s²; its travel, m, for effects at the encoder."""
    s = one.signals
    assert s is not None
    return float(np.ptp(s.p)) if item.effect.port == "position" else float(np.max(np.abs(s.a)))


def rivals(evidence: Evidence, i: int, firsts: Mapping[str, int]) -> dict[str, float]:
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
        if rho > max(RIVAL_CORRELATION, found.get(name, 0.0)):
            found[name] = min(rho, 1.0)
    return dict(sorted(found.items(), key=lambda pair: -pair[1]))


def strongest(evidence: Evidence, i: int) -> Array:
    """The mixture of an item's columns that is seen best."""
    A = evidence.G[evidence.columns[i], evidence.columns[i]]
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    return np.asarray(np.linalg.eigh(A / np.outer(size, size))[1][:, -1] / size)


def groups(sights: Sequence[Sight], related: Mapping[str, Mapping[str, float]]) -> tuple[Group, ...]:
    """Effects with all that they are tied to, largest first; a group that another one holds whole is left out."""
    kept: list[Group] = []
    for sight in sorted(sights, key=lambda s: -len(s.members)):
        if len(sight.members) == 1 or any(set(sight.members) <= set(g.members) for g in kept):
            continue
        kept.append(Group(sight.members, min(related[sight.effect].values()), sight.experiment))
    return tuple(kept)
