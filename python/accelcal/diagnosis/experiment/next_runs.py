"""Next experiment: the feasible runs, ranked by how far the weights of a confounding class are expected to fall apart.

What the recordings say of each member is a normal belief on its coefficients. A further run adds the Gram matrix G of
all members, the base projected out; its scores are c ~ N(G b, G) under the member that is true, and each member's
evidence grows by what its joint fit to both gains (derivations D3.9). The entropy of the weights is averaged over draws
of truth, coefficients and scores; nothing measured enters but the beliefs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, starmap
from typing import Annotated, ClassVar

import numpy as np
import scipy
from scipy import special

from accelcal._support.arguments import checked
from accelcal._support.errors import AccelcalError
from accelcal._support.process import one_thread, within
from accelcal._support.result import NotStored, Result
from accelcal._support.values import immutable
from accelcal.data import GRAVITY, POSITION_ORDER, Array, Recording
from accelcal.diagnosis.experiment.design import (
    LEAST_SECONDS,
    PATTERNS,
    Limits,
    Recipe,
    build,
    limits_of_stage,
)
from accelcal.diagnosis.experiment.detectability import drawn_scores
from accelcal.diagnosis.experiment.power_analysis import planned_state
from accelcal.diagnosis.faults import usable
from accelcal.diagnosis.findings import Confounded
from accelcal.diagnosis.policy import CLASS_WEIGHT, INDEPENDENT_PIECES, NEXT_LEAST_FALL
from accelcal.diagnosis.runs import ANGLE_STD, DWELL, DWELLS, MOTIONS, repeated, tumble, turned
from accelcal.diagnosis.search.beam import BlockScatter, block_length
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.scan import scan
from accelcal.diagnosis.search.scores import DEGENERATE_MIX, BaseProjection, CandidateScores, scaled_gram
from accelcal.diagnosis.select.improvement import Improvement
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import find
from accelcal.estimation.dwell_rows import acts_at_rest
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.run_state import RunState
from accelcal.model import Model
from accelcal.signals.signals import Signals
from accelcal.simulation.motion import Motion

SETUP = 300.0
"""Time to change the mount or the set-up before a run, s."""
WARMING = 10.0
"""Rise of the temperature over a run that is warmed, K."""
WARMING_TIME = 1200.0
"""Time that such a rise takes at least, s; what it is expected to show is that of one run of the first one's length."""
WEAK = 0.5
"""Share of the largest expected fall below which a run comes behind all others, however short it is."""
LONGEST = 120.0
"""Longest planned motion, s."""
LARGER = 1.05
"""Ratio of limit to motion from which a larger motion is worth a run; of motion to limit from which it is too large."""
TRIED_PATTERNS = (0, 3, 4, 8)
"""Patterns of bursts that are tried: slow, fast, fast at three levels, short strong ones among long slow ones."""
SAMPLES_PER_PERIOD = 8.0
"""Samples of the slower channel in a period of the fastest tone."""
DRAWS = 400
"""Draws of coefficients and scores under each member."""


@dataclass(frozen=True, slots=True)
class Cause:
    """A member of the class, with its weight."""

    effect: str
    weight: float
    """By the recordings, all members equally likely before them."""
    before: float | None = None
    """The same without the last recording; None where there is no earlier diagnosis."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """One further run, and what it is expected to say about the class."""

    run: str
    """What to record."""
    minutes: float
    """Its length with the change of the set-up before it."""
    fall: float
    """Expected fall of the entropy of the weights, nat."""
    decided: float
    """Probability that one cause then has the weight with which `diagnose` names it."""
    separation: float
    """Distance between the two causes that it separates least, everything else estimated, standard deviations."""
    pair: tuple[str, str]
    """Those two."""
    motion: Annotated[Motion | None, NotStored("accelcal.next_experiments with the same arguments plans it again")] = (
        None
    )
    """What the stage is driven through, from the middle of its stroke; None where it repeats the first recording."""

    @property
    def per_minute(self) -> float:
        """Expected fall of the entropy for each minute, nat."""
        return self.fall / self.minutes


@immutable
@dataclass(frozen=True, slots=True)
class NextExperiments(Result):
    """Further runs, ranked by the expected fall of the entropy of the weights for each minute."""

    tables_in: ClassVar[str] = "results.experiments"
    derived: ClassVar[tuple[str, ...]] = ("sentence", "separable")

    recordings: tuple[str, ...]
    """Names of the recordings that gave the weights."""
    causes: tuple[Cause, ...]
    """Members of the class, likeliest first; the one that remains where there is no class any more."""
    entropy: float
    """Of the weights now, nat."""
    ranked: tuple[Experiment, ...] = ()
    """By the fall for each minute, those with less than half of the largest fall last; empty where no class is left."""
    left_out: tuple[str, ...] = ()
    """Members that cannot be simulated: the recordings give them no weight, or they need channels of their own."""

    def __repr__(self) -> str:
        return f"NextExperiments({self.sentence})"

    @property
    def separable(self) -> bool:
        """Whether a further run is expected to lower the entropy by a tenth or more."""
        return max((run.fall for run in self.ranked), default=0.0) >= NEXT_LEAST_FALL * self.entropy

    @property
    def sentence(self) -> str:
        """Which run to record, that none separates the causes, or which cause remains."""
        left = [cause.effect for cause in self.causes if cause.weight > 0.0]
        if not self.ranked:
            others = ", ".join(cause.effect for cause in self.causes if cause.weight == 0.0)
            last = f"{self.recordings[-1] or 'the last recording'} decides against {others}"
            return f"{left[0]} remains; {last}." if left else f"None of the causes remains: {last}."
        if not self.separable:
            return f"None of these can separate them: {', '.join(left)}."
        best = self.ranked[0]
        return (
            f"Record {best.run}: in {best.minutes:.2g} min the entropy of {len(left)} causes is expected to fall by "
            f"{best.fall:.2g} of {self.entropy:.2g} nat, and one of them is then named with probability "
            f"{best.decided:.2g}."
        )


@checked
@one_thread
def next_experiments(
    result: Diagnosis | Improvement,
    recordings: Recording | Sequence[Recording],
    *,
    before: Diagnosis | None = None,
    stroke: float | None = None,
    v_max: float | None = None,
    a_max: float | None = None,
    tiltable: bool = False,
    setup: float = SETUP,
    progress: Callable[[float], None] = lambda share: None,
) -> NextExperiments:
    """Rank the runs that a stage can do by how well they would separate the causes that a diagnosis confounds.

    Parameters
    ----------
    result : a diagnosis, or an improvement; its first class with weights is separated.
    recordings : those of the result.
    before : the diagnosis of all recordings but the last, which asked for it.
    stroke, v_max, a_max : limits of the stage, m, m/s, m/s²; by default what the first recording used.
    tiltable : whether the axis of the stage can be set level and upright.
    setup : time that a change of mount or set-up takes, s.
    progress : called with the share of the work that is done, 0 to 1.

    Returns
    -------
    NextExperiments
        The same motion again, larger, with another mount, with other tones, sampled at twice the rate, a tumble, and a
        temperature that rises where one was recorded, best first; or which cause remains, where `before` had a class.

    Raises
    ------
    ValueError
        If there is nothing to separate: the result has no class with weights.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> from accelcal.simulation.motion import Motion, Tones
    >>> tone = Motion((Tones(np.array([5e-3]), np.array([3.0]), np.zeros(1)),), 20.0)
    >>> rig, rng = ac.simulation.CXL02_RIG, np.random.default_rng(1)
    >>> simulated = ac.simulate(tone, seconds=20.0, rig=rig, parameters={"quadratic": 1e-3}, rng=rng).recording
    >>> result = ac.next_experiments(ac.diagnose(ac.fit(simulated), simulated), simulated)
    >>> result.separable, len(result.ranked) > 5
    (True, True)
    """
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    if not several:
        raise AccelcalError("no recordings; give those that the result was found on")
    names = tuple(recording.name for recording in several)
    group, earlier = class_with_weights(result), None if before is None else class_with_weights(before)
    then = {} if earlier is None else {name: w.by_record for name, w in earlier.weights.items()}
    if group is None:
        return remaining(result, names, then)
    if not (math.isfinite(setup) and setup >= 0.0):
        raise AccelcalError(f"setup: found {setup:g} s, expected the time of a change of mount, 0 s or more")
    model, states = fitted_without(result, group, several, within(progress, 0.0, 0.2))
    beliefs = Beliefs.of(states, model, group)
    given = zip((stroke, v_max, a_max), extremes(states[0].signals), strict=True)
    limits = within_range(limits_of_stage(*(used if limit is None else limit for limit, used in given)), states[0])
    tried = list(further(states[0], model, limits, beliefs.items, tiltable=tiltable, setup=setup))
    ranked = []
    for number, run in enumerate(tried):
        state = run.state()
        if not saturates(state, states[0]):
            gram = beliefs.gram(state, model)
            ranked.append(beliefs.after(added(gram, beliefs.gram(states[0], model)) if run.counted else gram, run))
        progress(0.2 + 0.8 * (number + 1) / len(tried))
    most = max(run.fall for run in ranked)
    weights = dict(zip(beliefs.names, beliefs.weights.tolist(), strict=True))
    return NextExperiments(
        names,
        causes_of({**dict.fromkeys(then, 0.0), **weights}, then),
        float(np.sum(special.entr(beliefs.weights))),
        tuple(sorted(ranked, key=lambda run: (run.fall < WEAK * most, -run.per_minute))),
        tuple(name for name in group.members if name not in weights),
    )


def remaining(result: Diagnosis | Improvement, names: tuple[str, ...], then: Mapping[str, float]) -> NextExperiments:
    """Which cause remains of a class with weights, where the recordings leave no class.

    Raises
    ------
    ValueError
        If there was no class before, either.
    """
    if not then:
        raise AccelcalError(
            f"nothing to separate: {names[0] or 'the recording'} leaves no confounded causes to choose "
            f"between; the verdict is {result.verdict}. Run accelcal diagnose for what it says"
        )
    left = next((name for _, name in map(likeliest, result.classes) if name in then), None)
    return NextExperiments(names, causes_of({name: float(name == left) for name in then}, then), 0.0)


def causes_of(weights: Mapping[str, float], then: Mapping[str, float]) -> tuple[Cause, ...]:
    """Causes with their weights, likeliest first."""
    causes = (Cause(name, weight, then.get(name)) for name, weight in weights.items())
    return tuple(sorted(causes, key=lambda cause: -cause.weight))


def class_with_weights(result: Diagnosis | Improvement) -> Confounded | None:
    """The first class of which two members or more have weights, none of them that with which it would be named."""
    return next((group for group in result.classes if 0.0 < likeliest(group)[0] < CLASS_WEIGHT), None)


def likeliest(group: Confounded) -> tuple[float, str]:
    """Largest weight of a class and its member; weight 0 and the effect itself where fewer than two have weights."""
    weights = [(float(w.by_record), name) for name, w in group.weights.items() if math.isfinite(w.by_record)]
    return max(weights) if len(weights) > 1 else (0.0, group.effect)


def fitted_without(
    result: Diagnosis | Improvement,
    group: Confounded,
    recordings: Sequence[Recording],
    progress: Callable[[float], None],
) -> tuple[Model, list[RunState]]:
    """The model with all that was found but the class, and the runs fitted with it."""
    fit = result.best if isinstance(result, Improvement) else result.fit
    model = fit.model.drop(group.effect) if group.effect in fit.model.effects else fit.model
    for effect in () if isinstance(result, Improvement) else result.scan.detected:
        model = model if effect.effect == group.effect else effect.enter(model)
    whole = usable(recordings[0])
    solution = solve_runs(
        model,
        recordings,
        start=whole.start,
        end=whole.end,
        origins=fit.origins,
        others_whole=True,
        engine=fit.engine,
        progress=progress,
    )
    return solution.model, solution.states


@dataclass(frozen=True, slots=True)
class Further:
    """A run that a stage can do."""

    text: str
    """What to record."""
    seconds: float
    """Its length with the set-up, s."""
    state: Callable[[], RunState]
    """Makes the fitted run that it would give."""
    counted: bool = False
    """Whether the first run is in that once more."""
    motion: Motion | None = None
    """The planned one."""


@dataclass(frozen=True, slots=True)
class Beliefs:
    """What recordings say of each member of a class: its coefficients in units in which they have the covariance I."""

    items: tuple[Hypothesis, ...]
    weights: Array
    """(members,)"""
    basis: Array
    """Coefficients of all members per unit of the whitened ones, (columns, directions)."""
    places: tuple[slice, ...]
    """Directions of each member."""
    mean: Array
    """Of the whitened coefficients, (directions,); those of a random process have the mean 0 in each run."""
    gains: Array
    """What each member has explained, twice the log-likelihood, (members,)."""
    inflation: float
    """Ratio of block scatter to predicted variance, by which gains are divided."""

    @property
    def names(self) -> tuple[str, ...]:
        """Effects of the members."""
        return tuple(item.effect.name for item in self.items)

    @classmethod
    def of(cls, states: Sequence[RunState], model: Model, group: Confounded) -> Beliefs:
        """Of the members that have weights, each at its likeliest shape.

        Raises
        ------
        ValueError
            If fewer than two of them can be evaluated on the recordings.
        """
        weights = {name: w.by_record for name, w in group.weights.items() if math.isfinite(w.by_record)}
        entered = scan(states, model, only=[find(name) for name in weights]).entered
        offered = [Hypothesis(find(effect.effect), effect.shape) for effect in entered]
        evidence = CandidateScores([BaseProjection(state, model) for state in states], offered)
        weakest_first = sorted(range(len(offered)), key=lambda i: evidence.gain(i)[0])
        best = {offered[i].effect.name: i for i in weakest_first}
        if len(best) < 2:
            raise AccelcalError(
                f"nothing to separate: of {', '.join(weights)} only {', '.join(best) or 'none'} can be simulated; "
                f"record {group.experiment}"
            )
        bases, means = [], []
        for i in best.values():
            A, size = evidence.G[evidence.columns[i], evidence.columns[i]], evidence.gain(i)[2]
            scaled, root = scaled_gram(A)
            values, vectors = np.linalg.eigh(scaled)
            good, random = values > DEGENERATE_MIX, offered[i].effect.port == "process"
            free = vectors[:, good] / np.sqrt(values[good]) / root[:, None]
            bases.append(float(size[0]) * np.eye(len(A)) if random else free)
            means.append((0.0 if random else 1.0) * (bases[-1].T @ evidence.c[evidence.columns[i]]))
        ends = np.cumsum([0, *map(len, means)])
        lead = best.get(group.effect, next(iter(best.values())))
        inflation = BlockScatter(evidence, max(map(block_length, states))).inflation(lead, ())
        share = np.array([weights[name] for name in best])
        return cls(
            tuple(offered[i] for i in best.values()),
            share / np.sum(share),
            scipy.linalg.block_diag(*bases),
            tuple(starmap(slice, pairwise(ends.tolist()))),
            np.concatenate(means),
            np.array([evidence.gain(i)[0] + evidence.cost(i) for i in best.values()]),
            inflation,
        )

    def gram(self, state: RunState, model: Model) -> Array:
        """Gram matrix of the whitened coefficients on one run, the base projected out, (directions, directions)."""
        G = CandidateScores([BaseProjection(state, model)], self.items).G
        return np.asarray(self.basis.T @ G @ self.basis)

    def after(self, G: Array, run: Further) -> Experiment:
        """What a further run with this Gram matrix is expected to say."""
        rng, count = np.random.default_rng(0), len(self.items)
        noise, deviates = drawn_scores(G, rng, DRAWS), rng.standard_normal((DRAWS, len(G)))
        falls, decided, distances = np.zeros(count), np.zeros(count), np.full((count, count), np.inf)
        for j, place in enumerate(self.places):
            scores = (self.mean[place] + deviates[:, place]) @ G[place] + noise
            gained = np.column_stack([self.gained(k, G, scores) for k in range(count)])
            weights = special.softmax(np.log(np.maximum(self.weights, 1e-300)) + gained, axis=1)
            falls[j] = np.mean(np.sum(special.entr(weights), axis=1))
            decided[j] = np.mean(np.max(weights, axis=1) >= CLASS_WEIGHT)
            others = np.arange(count) != j
            distances[j, others] = np.sqrt(np.maximum(2.0 * np.mean(gained[:, [j]] - gained[:, others], axis=0), 0.0))
        first, second = np.unravel_index(int(np.argmin(distances)), distances.shape)
        return Experiment(
            run.text,
            run.seconds / 60.0,
            max(0.0, float(np.sum(special.entr(self.weights)) - self.weights @ falls)),
            min(1.0, float(self.weights @ decided)),  # rounding may add up to more
            float(distances[first, second]),
            (self.names[first], self.names[second]),
            run.motion,
        )

    def gained(self, k: int, G: Array, scores: Array) -> Array:
        """Growth of the log-evidence of a member in each draw, (draws,), as the search counts gains."""
        place = self.places[k]
        joint, mean = np.eye(place.stop - place.start) + G[place, place], self.mean[place]
        h = mean + scores[:, place]
        explained = np.sum(h * np.linalg.solve(joint, h.T).T, axis=1) - mean @ mean
        gains = np.maximum(self.gains[k] + explained, 0.0) / self.inflation / INDEPENDENT_PIECES
        credited = np.log1p(gains) - math.log1p(self.gains[k] / self.inflation / INDEPENDENT_PIECES)
        return np.asarray(0.5 * (INDEPENDENT_PIECES * credited - np.linalg.slogdet(joint)[1]))


def added(G: Array, before: Array) -> Array:
    """Information that a part adds to a record, (m, m): none is negative, though a wider range may change a column."""
    values, vectors = np.linalg.eigh(G - before)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def further(
    state: RunState, model: Model, limits: Limits, items: Sequence[Hypothesis], *, tiltable: bool, setup: float
) -> Iterator[Further]:
    """Runs that a stage can do after a fitted run; where its limits are less than what that used, in a smaller
    motion."""
    s, rig, seconds = state.signals, state.run.rig, state.signals.length
    dwelled = state.run.recording.dwells is not None
    first = state = repeated(state, rig, lambda s: s) if dwelled else state
    allowed = limits.stroke, limits.speed, limits.acceleration
    factor = min(limit / used for limit, used in zip(allowed, extremes(s), strict=True))
    alone = GRAVITY not in state.run.recording.side and rig.coupled and not state.run.recording.axis
    same = "the same motion"
    if alone and factor * LARGER < 1.0:
        same, state = f"{same} {factor:.3g} times as large", repeated(state, rig, lambda s: enlarged(s, factor))
    yield Further(same if state is not first else f"{same} again", seconds, lambda: state)
    if factor >= LARGER and alone:
        text = f"{same} {factor:.3g} times as large"
        yield Further(text, seconds, lambda: repeated(state, rig, lambda s: enlarged(s, factor)))
    for text, axis, mount in MOTIONS if alone else ():
        at = axis or rig.axis, mount or rig.mount
        if at != (rig.axis, rig.mount) and (axis is None or tiltable):
            yield Further(f"{same} with {text}", seconds + setup, partial(turned, state, *at))
    if alone and any(acts_at_rest(item.effect) for item in items) and not dwelled:
        dwells = tumble(state, rig.uncertainty.level or ANGLE_STD)
        text = f"{DWELLS} dwells of {DWELL:g} s around a turn in gravity"
        yield Further(text, DWELLS * DWELL + setup, lambda: repeated(first, rig, lambda s: s, dwells), counted=True)
    if "temperature" in s.side:
        text = f"{same} while the temperature rises by {WARMING:g} K"
        yield Further(text, max(seconds, WARMING_TIME) + setup, lambda: repeated(state, rig, warmed))
    if state.weak is None:
        noise = state.noise.scaled(1.0, 0.5)  # of two independent readings half the variance in the time of one
        faster = partial(replace, state, noise=noise, filtered=None)
        yield Further(f"{same}, its position read at twice the rate", seconds, faster)
    needs = {name for item in items for name in item.effect.needs} | {n for t in model.terms for n in t.effect.needs}
    if alone and state.run.order == POSITION_ORDER and needs <= {"temperature"}:
        yield from other_motions(first, model, limits)


def other_motions(state: RunState, model: Model, limits: Limits) -> Iterator[Further]:
    """Runs with bursts of tones within limits, at the middle of the stroke of a fitted run."""
    s, run = state.signals, state.run
    rates = 1.0 / run.accel_step, 1.0 / run.reading_step
    seconds = min(max(s.length, LEAST_SECONDS), LONGEST)

    def planned(motion: Motion) -> RunState:
        at = planned_state(motion, run.rig, seconds, state.noise.usual, model, *rates)
        t, signals = at.signals.t, replace(s, whole=None, a_corner=s.a_width, v_corner=s.v_width)
        side = {name: np.interp(t, s.t - s.t[0], y) for name, y in s.side.items()}
        motion_of = {name: getattr(at.signals, name) for name in ("t", "a", "v", "jerk", "cutoff")}
        at.signals = replace(signals, p=at.signals.p + middle_of(s), side=side, **motion_of)
        return at

    for pattern in (PATTERNS[k] for k in TRIED_PATTERNS):
        low, high = min(burst.low for burst in pattern), max(burst.high for burst in pattern)
        if high * SAMPLES_PER_PERIOD <= min(rates):
            levels = len({burst.level for burst in pattern})
            text = f"bursts of tones of {low:g} to {high:g} Hz{f' at {levels} levels' if levels > 1 else ''}, and moves"
            motion = build(Recipe(pattern, 0.5, aligned=len(pattern) > 1), limits, seconds)
            yield Further(f"{text} over {limits.stroke:.2g} m", seconds, partial(planned, motion), motion=motion)


def within_range(limits: Limits, state: RunState) -> Limits:
    """Limits at which the specific force stays within the declared range of the sensor, or as far as it went."""
    s, reach = state.signals, state.run.rig.sensor.range
    if reach is None:
        return limits
    most = max(reach - float(np.max(np.abs(s.gravity))), extremes(s)[2])
    return replace(limits, acceleration=min(limits.acceleration, most))


def saturates(state: RunState, first: RunState) -> bool:
    """Whether a run exceeds the declared range of the sensor, and the first run does not exceed it as far."""
    reach = state.run.rig.sensor.range
    top, usual = (float(np.max(np.abs(run.signals.a))) for run in (state, first))
    return reach is not None and top > max(reach, usual)


def middle_of(s: Signals) -> float:
    """Middle of the stroke, from the model's origin, m."""
    return 0.5 * float(np.max(s.p) + np.min(s.p))


def extremes(s: Signals) -> tuple[float, float, float]:
    """Travel, top speed and top acceleration of the stage, m, m/s, m/s²."""
    return float(np.ptp(s.p)), float(np.max(np.abs(s.v))), float(np.max(np.abs(stage_acceleration(s))))


def stage_acceleration(s: Signals) -> Array:
    """Acceleration of the stage, m/s², (n,)."""
    return np.asarray(s.rig.polarity * s.a - s.gravity)


def enlarged(s: Signals, factor: float) -> Signals:
    """The signals of a motion some times as large about the middle of its stroke."""
    middle = middle_of(s)
    a = s.rig.polarity * (factor * stage_acceleration(s) + s.gravity)
    return replace(s, p=middle + factor * (s.p - middle), v=factor * s.v, a=a, jerk=factor * s.jerk)


def warmed(s: Signals) -> Signals:
    """The signals of the same motion while the temperature rises steadily."""
    rise = WARMING * (s.t - s.t[0]) / s.length
    return replace(s, side={**s.side, "temperature": s.side["temperature"] + rise})
