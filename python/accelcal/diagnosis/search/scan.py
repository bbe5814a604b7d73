"""One pass over a record: score every hypothesis, search for the set that is missing, and find what is confounded with
it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from accelcal._support.result import Storable
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA, VERDICT_LEAST_BLOCKS
from accelcal.diagnosis.search.beam import BlockScatter, SearchRules, block_length, distance_for_gain
from accelcal.diagnosis.search.confounding import (
    DetectedEffect,
    Weights,
    confounding_class,
    detected_effect,
    largest,
    likeliest,
    plainest,
)
from accelcal.diagnosis.search.hypotheses import Hypothesis, hypotheses_for, mechanisms_for
from accelcal.diagnosis.search.refine import refine, shortlist, starting_points
from accelcal.diagnosis.search.scores import DEGENERATE, BaseProjection, CandidateScores, log_survival, score_gain
from accelcal.diagnosis.search.slow_noise import SlowNoise
from accelcal.effects import BUILT_IN, Effect, SizePrior, find, users_own
from accelcal.estimation.gauss_newton import ROUNDS_OF_GROWN, estimated
from accelcal.estimation.run_state import RunState
from accelcal.model import Model, Term


def detectable_sizes(
    evidence: CandidateScores, i: int, rules: SearchRules
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Standard deviations per unit coefficient of each part of a hypothesis, and the sizes that are found with 95 %.

    A size is infinite where the part is not visible: the base contains it, or at that size it would move the readings
    as
    much as the motion itself. A random process has one part, with the information of all its columns.
    """
    item, columns = evidence.items[i], evidence.columns[i]
    A, diagonal, left = evidence.G[columns, columns], evidence.power[columns], evidence.beyond_line[columns]
    dof = score_gain(A, evidence.c[columns])[1]
    information = np.diag(A)
    if item.effect.port == "process":
        information, diagonal, left = (np.array([y.sum()]) for y in (information, diagonal, left))
        dof = 1
    d = np.sqrt(np.maximum(information, 0.0))
    if dof == 0:
        return tuple(d.tolist()), (math.inf,) * len(d)
    distance = distance_for_gain(max(rules.required_gains(dof, item)), dof)
    beyond_motion = distance**2 * diagonal > d**2 * (evidence.motion or math.inf)
    invisible = (information <= DEGENERATE * left) | beyond_motion
    return tuple(d.tolist()), tuple(
        math.inf if unseen else distance / x for unseen, x in zip(invisible.tolist(), d, strict=True)
    )


def detection_limits(evidence: CandidateScores, rules: SearchRules) -> dict[str, float]:
    """Smallest coefficient of each effect that this record would have shown with 95 % probability.

    Taken at the trial shape and for the part with the smallest limit; infinite where the effect is not visible on this
    record. Random processes are left to `power`.
    """
    limits: dict[str, float] = {}
    for i, item in enumerate(evidence.items):
        if item.effect.port != "process" and item.leading is None:
            limits[item.effect.name] = min(
                *detectable_sizes(evidence, i, rules)[1], limits.get(item.effect.name, math.inf)
            )
    return limits


Verdict = Literal["adequate", "named", "tied", "shape", "unexplained", "too_short"]


@dataclass(frozen=True, slots=True)
class Candidate(Storable):
    """What one effect explains, given the model and the effects that entered before it."""

    derived: ClassVar[tuple[str, ...]] = ("members",)

    effect: str
    shape: Mapping[str, float]
    estimate: tuple[float, ...]
    """One value for each column that it has, in `unit`; for a random process its one intensity."""
    std: tuple[float, ...]
    unit: str
    gain: float
    """Twice the log-likelihood gain, block-robust."""
    dof: int
    p_raw: float
    p_value: float
    """Family-wise, over all alternatives examined."""
    log_evidence: float
    largest: float
    """Largest contribution over the used range, m/s² (m at the encoder)."""
    weights: Mapping[str, Weights] = field(default_factory=dict)
    """Posterior weights of its confounding class on this record, itself included."""
    comparisons: int = 1
    """Values of a shape parameter among which the record was searched for this one."""

    @property
    def members(self) -> tuple[str, ...]:
        """Its confounding class on this record, itself included."""
        return tuple(self.weights)

    @property
    def chance(self) -> float:
        """Probability of such a gain under the null, had this effect been the only alternative."""
        return min(1.0, self.p_raw * self.comparisons)

    @property
    def snr(self) -> float:
        """Equivalent standard deviations: square root of the gain."""
        return math.sqrt(max(self.gain, 0.0))


@dataclass(frozen=True, slots=True)
class Scan:
    """Result of one pass over a record: what the model lacks."""

    candidates: tuple[Candidate, ...]
    """By rank."""
    detected: tuple[DetectedEffect, ...]
    """The set that explains most, in order of entry; empty when nothing is significant or the record too short."""
    examined: int
    """Alternatives examined."""
    blocks: int
    """Effective blocks of the record."""
    detection_limits: Mapping[str, float] = field(default_factory=dict)
    """Smallest coefficient that is found with 95 % probability, by effect; infinite where the record cannot show it."""
    entered: tuple[DetectedEffect, ...] = ()
    """Effects that were requested by name and can be evaluated, whether significant or not."""
    rivals: tuple[DetectedEffect, ...] = ()
    """Named effects that are confounded with what comes first, nearest first."""
    changing: tuple[DetectedEffect, ...] = ()
    """Effects that would enter if they had one size in all parts of the runs and bands, or happened only once."""
    slow_noise: tuple[SlowNoise, ...] = ()
    """Slow noise against which the finalists were judged, of those runs that have any."""

    @property
    def enough(self) -> bool:
        """Whether the record is long enough for a verdict, so that an effect or a delay may be named."""
        return self.blocks >= VERDICT_LEAST_BLOCKS

    def nearest_rival(self, effect: str) -> str:
        """The sentence on what explains most beside a named effect of the search; empty where nothing does."""
        ranked = {candidate.effect: candidate for candidate in reversed(self.candidates)}
        first = ranked.pop(effect, None)
        rival = max(ranked.values(), key=lambda rival: rival.log_evidence, default=None)
        if first is None or rival is None:
            return ""
        worse = first.log_evidence - rival.log_evidence
        # The search may have found the effect otherwise than by its gain in this table.
        if worse < 0.5 or rival.log_evidence <= 0.0:
            return ""
        return f" Its nearest rival is {rival.effect}, worse by {worse:.0f} in log-evidence."


def scan(
    passes: Sequence[RunState],
    model: Model,
    *,
    extra: Sequence[Effect] | None = None,
    only: Sequence[Effect] = (),
    separate: Sequence[Term] = (),
    alpha: float = FAMILYWISE_ALPHA,
    priors: Mapping[str, SizePrior] | None = MappingProxyType({}),
    progress: Callable[[float], None] = lambda share: None,
) -> Scan:
    """Rank every effect that may be missing, and find the set that explains most.

    Parameters
    ----------
    passes : fitted runs.
    model : the model they were fitted with.
    extra : users' effects to consider besides the built-in catalogue; by default all that are registered.
    only : test these effects alone, whether significant or not.
    separate : contributions that other tests report, such as spectral lines; no effect is credited for explaining them.
    alpha : family-wise false-alarm rate.
    priors : of sizes by effect, in place of the catalogue's, for the second set of weights; None = no such set.
    progress : called with the share of the work that is done, 0 to 1.

    Notes
    -----
    Scores pass through the filter (Friedland's two stages), so that no refit is needed to rank. Shape parameters of the
    finalists are refined by likelihood before effects are compared; their scores are checked block by block.
    """
    if only:
        further = users_own() if extra is None else tuple(extra)
        extra = (*further, *(e for e in only if e not in further and e not in BUILT_IN and (e.axis or not e.product)))
    items = hypotheses_for(passes[0], model, extra, others=passes[1:])
    if only:
        names = {effect.name for effect in only}
        items = [item for item in items if item.effect.name in names]
        if not items:
            return Scan((), (), 0, 0)
    length = max(block_length(state) for state in passes)
    blocks = int(sum(np.sum(state.counts) * state.run.reading_step for state in passes) / length)
    rules = SearchRules(len(items), blocks, alpha, priors)
    runs = [BaseProjection(state, model, separate) for state in passes]
    progress(0.1)
    evidence = CandidateScores(runs, items, progress=lambda share: progress(0.1 + 0.5 * share))
    best = BestSet.among(evidence, length, rules)
    progress(0.7)
    mechanisms = [] if only or not best.chosen else mechanisms_for(passes[0], model, passes[1:])
    if mechanisms:
        rules = replace(rules, examined=rules.examined + len(mechanisms))
        place = {item.effect.name: k for k, item in enumerate(items)}
        refined = sorted(best.evidence.items, key=lambda item: place[item.effect.name])
        refined += [item for item in items if item.effect.mechanism]
        best = BestSet.among(CandidateScores(runs, [*refined, *mechanisms]), length, rules)
    progress(0.9)
    enough = blocks >= VERDICT_LEAST_BLOCKS
    entering, changing = best.divided(evidence, rules) if enough else ((), ())
    lead = next((effect for effect in (*entering, *changing) if effect.effect == best.first), None)
    again = None if lead is None else relinearised(passes, model, lead, separate, length, rules)
    if again is not None:
        entering = (again, *(effect for effect in entering if effect is not lead))
        changing = tuple(effect for effect in changing if effect is not lead)
    final, scatter, chosen = best.evidence, best.scatter, best.chosen
    progress(1.0)
    return Scan(
        rank(final, scatter, chosen, rules, passes),
        entering,
        rules.examined,
        blocks,
        detection_limits(evidence, rules),
        tuple(
            detected_effect(final, scatter, (i,), 0, rules)
            for i in range(len(final.items))
            if only and final.gain(i)[1]
        ),
        rivals_of_first(final, scatter, chosen, rules),
        changing,
        best.slow_noise,
    )


def relinearised(
    passes: Sequence[RunState],
    model: Model,
    lead: DetectedEffect,
    separate: Sequence[Term],
    length: float,
    rules: SearchRules,
) -> DetectedEffect | None:
    """An effect that has one size about a fit with it; None for random processes, and where it has none.

    It spoils the smoothed motion, from which its own column and shape come, as an error of the reading does, or
    friction where the stage reverses slowly: what the search takes for its sizes may then differ from part to part.
    Where it takes a shape for less than the effect can have, the fit that starts from there does not settle and rejects
    good readings.
    """
    effect, again = find(lead.effect), lead
    free = [name for name, shape in effect.shapes.items() if shape.refined and shape.spacing == "log"]
    bounded = [name for name in free if effect.shapes[name].beyond_size]
    for _ in range(RELINEARISED if effect.port != "process" and (bounded or lead.unequal) else 0):
        grown = again.enter(model)
        try:
            states = estimated(grown, [state.grown(grown) for state in passes], least=ROUNDS_OF_GROWN).states
        except ValueError:
            return None
        terms = [term for term in states[0].values.terms if term.effect.name == lead.effect]
        size = max(abs(state.values.by_name[term.name]) for state in states for term in terms)
        if any(again.shape[name] < SHAPE_LEAST * size for name in bounded):
            again = replace(again, shape={**again.shape, **dict.fromkeys(bounded, SHAPE_SETTLES * size)})
            continue
        runs = [BaseProjection(state, model, separate, terms) for state in states]
        about = {name: (again.shape[name] / SHAPE_RATIO, again.shape[name] * SHAPE_RATIO) for name in free}
        ((item,),) = refine(runs, [[Hypothesis(effect, again.shape, brackets=about)]])
        evidence = CandidateScores(runs, [item])
        if not evidence.gains(())[1][0]:  # about that fit it is not told from the base
            return None
        again = detected_effect(evidence, BlockScatter(evidence, length), (0,), 0, rules)
        if again.unequal is None:
            return replace(again, weights=lead.weights)
    return None


RELINEARISED, SHAPE_RATIO = 4, 3.0
"""Fits about which the sizes of an effect are compared, and the ratio by which each may change a shape parameter."""
SHAPE_LEAST, SHAPE_SETTLES = 0.9, 1.5
"""Ratios of a shape that is never below the size of its coefficient: what noise may make of it, and where the next fit
starts that found it smaller."""


def recurs(
    trials: CandidateScores, final: CandidateScores, chosen: tuple[int, ...], i: int, rules: SearchRules
) -> bool:
    """Whether what happens once by its equation happens again: at another instant it is significant given the set."""
    item = final.items[i]
    if "instant" not in item.shape:
        return False
    others = [other for other in trials.items if other.effect.name == item.effect.name]
    table = CandidateScores(final.runs, [*(final.items[k] for k in chosen), *others])
    given = tuple(range(len(chosen)))
    gains, dofs = table.gains(given)
    return any(
        rules.significant(float(gains[k]), int(dofs[k]), table.items[k]) for k in range(len(chosen), len(table.items))
    )


@dataclass(frozen=True, slots=True)
class BestSet:
    """Refined hypotheses, and the set of them that explains most."""

    evidence: CandidateScores
    scatter: BlockScatter
    chosen: tuple[int, ...]
    slow_noise: tuple[SlowNoise, ...] = ()
    """Slow noise that the hypotheses leave."""

    @property
    def first(self) -> str:
        """Name of the effect that explains most; empty where none is significant."""
        return self.evidence.items[self.chosen[0]].effect.name if self.chosen else ""

    @classmethod
    def among(cls, evidence: CandidateScores, length: float, rules: SearchRules) -> BestSet:
        """The best set of hypotheses whose shape parameters are first refined."""
        finalists = shortlist(evidence, rules.beam(evidence), rules)
        lists = refine(evidence.runs, starting_points(evidence, finalists, rules))
        return max(
            (cls.of(CandidateScores(evidence.runs, hypotheses), length, rules) for hypotheses in lists),
            key=lambda candidate: rules.net_gain_of_set(candidate.evidence, candidate.chosen),
        )

    @classmethod
    def of(cls, evidence: CandidateScores, length: float, rules: SearchRules) -> BestSet:
        """The best set of hypotheses, judged against slow noise.

        A random process is slow noise itself, so that it is judged against white noise: it enters where it explains
        more than what stands out from the slow noise.
        """
        against_slow = evidence.against_slow_noise()
        noises = tuple(run.slow_noise for run in against_slow.runs if run.slow_noise is not None)
        scatter = BlockScatter(against_slow, length)
        chosen = likeliest(against_slow, scatter, rules.best_set(against_slow, scatter), rules)
        chosen = plainest(against_slow, scatter, chosen, rules)
        if against_slow is not evidence:
            random = [i for i, item in enumerate(evidence.items) if item.effect.port == "process"]
            gains, dofs = evidence.gains()
            able = [i for i in random if rules.significant(float(gains[i]), int(dofs[i]), evidence.items[i])]
            net_gains = {
                i: rules.net_gain(float(gains[i]), int(dofs[i]), evidence.items[i], evidence.cost(i))
                for i in (*able, *chosen)
            }
            best = max(net_gains, key=lambda i: net_gains[i], default=-1)
            if best in able:
                return cls(evidence, BlockScatter(evidence, length), (best,), noises)
        return cls(against_slow, scatter, chosen, noises)

    def divided(
        self, trials: CandidateScores, rules: SearchRules
    ) -> tuple[tuple[DetectedEffect, ...], tuple[DetectedEffect, ...]]:
        """Effects of the set that have one size everywhere and happen once, and those that do not."""
        detected = [
            detected_effect(self.evidence, self.scatter, self.chosen, k, rules) for k in range(len(self.chosen))
        ]
        again = {
            self.evidence.items[i].effect.name
            for i in self.chosen
            if recurs(trials, self.evidence, self.chosen, i, rules)
        }
        entering = [effect for effect in detected if effect.unequal is None and effect.effect not in again]
        return tuple(entering), tuple(effect for effect in detected if effect not in entering)


def rivals_of_first(
    evidence: CandidateScores, scatter: BlockScatter, chosen: tuple[int, ...], rules: SearchRules
) -> tuple[DetectedEffect, ...]:
    """Named effects that are confounded with what comes first and have one size, nearest rival first.

    Random processes are not among them: they follow any function of time.
    """
    if not chosen:
        return ()
    able = {i: item.effect for i, item in enumerate(evidence.items) if item.effect.port != "process"}
    place = {effect.name: i for i, effect in able.items() if not effect.family}
    rivals = [
        place[name] for name in confounding_class(evidence, scatter, chosen[0], chosen[1:], rules) if name in place
    ]
    detected = (detected_effect(evidence, scatter, (i, *chosen[1:]), 0, rules) for i in rivals if i not in chosen)
    return tuple(effect for effect in detected if effect.unequal is None)


def rank(
    evidence: CandidateScores,
    scatter: BlockScatter,
    chosen: tuple[int, ...],
    rules: SearchRules,
    passes: Sequence[RunState],
) -> tuple[Candidate, ...]:
    """Every finalist as it would be in the first place of the set, largest log-evidence first."""
    others = chosen[1:]
    ranked = []
    for i, item in enumerate(evidence.items):
        if i in others:
            continue
        gain, dof, estimate, covariance = evidence.gain(i, others)
        if dof == 0:
            continue
        gain /= scatter.inflation(i, others)
        log_p = log_survival(gain, dof)
        ranked.append(
            Candidate(
                effect=item.effect.name,
                shape=dict(item.shape),
                estimate=tuple(float(v) for v in estimate),
                std=tuple(float(v) for v in np.sqrt(np.diag(covariance))),
                unit=item.effect.unit,
                gain=gain,
                dof=dof,
                p_raw=math.exp(log_p),
                p_value=math.exp(min(0.0, log_p + math.log(rules.examined * item.comparisons))),
                log_evidence=rules.net_gain(gain, dof, item, evidence.cost(i, others)) / 2.0,
                largest=max(largest(item, estimate, state) for state in passes),
                weights=confounding_class(evidence, scatter, i, others, rules),
                comparisons=item.alternatives,
            )
        )
    return tuple(sorted(ranked, key=lambda f: f.log_evidence, reverse=True))
