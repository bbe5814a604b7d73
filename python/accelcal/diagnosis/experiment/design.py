"""Design of a motion that separates named effects within stroke, speed and acceleration (derivations D3.5, D7).

Bursts of several tones at several amplitudes alternate with moves over the whole stroke and rests between them: bursts
separate powers of acceleration, moves and rests everything that depends on position, direction and time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, cycle, product
from typing import Annotated, ClassVar

import numpy as np

from accelcal._support.arguments import checked
from accelcal._support.errors import AccelcalError
from accelcal._support.process import one_thread
from accelcal._support.result import NotStored, Result
from accelcal.data import Array, Rig, unit_diagonal
from accelcal.diagnosis.experiment.detectability import Detectability, Power, evidence_of
from accelcal.diagnosis.experiment.power_analysis import (
    ACCEL_RATE,
    POSITION_RATE,
    detectability_of,
    most_visible_direction,
    planned_noise,
    planned_state,
)
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA
from accelcal.diagnosis.search.beam import SearchRules
from accelcal.diagnosis.search.confounding import TIED_CORRELATION
from accelcal.diagnosis.search.hypotheses import Hypothesis, hypotheses_for
from accelcal.diagnosis.search.scan import detectable_sizes
from accelcal.diagnosis.search.scores import CandidateScores
from accelcal.effects import find
from accelcal.estimation.run_state import RunState
from accelcal.estimation.values import Noise
from accelcal.model import Model
from accelcal.simulation.motion import STEP_TOP_SPEED, Motion, Move, Part, Tones, Windowed

MARGIN = 0.999
"""Share of every limit that is used: a margin for peaks between two samples of the search for them."""
PEAK_SAMPLES = 100.0
"""Samples per period of the highest tone in the search for peaks; they miss at most (pi/100)²/2 = 5e-4 of one."""
STEP_ACCELERATION = 84.0 * math.sqrt(5.0) / 25.0
"""Top acceleration of a move over distance/duration²."""
FADE = 0.3
"""Time in which a burst fades in, and out, s; at most 0.3 of its length."""
REST = 0.25
"""Rest after a move or a burst, s; after a burst at most a fifth of its length."""
SHORTEST = 0.4
"""Shorter bursts are dropped, s."""
TONES = 6
"""Tones of a burst."""
PLACES = (0.0, 0.25, -0.25)
"""Places of the bursts, as shares of the stroke."""


@dataclass(frozen=True, slots=True)
class Burst:
    """One burst of a pattern."""

    seconds: float
    low: float
    """Hz"""
    high: float
    """Hz"""
    level: float = 1.0
    """Share of what the limits allow."""


PATTERNS = (
    (Burst(2.5, 2.0, 6.0),),
    (Burst(2.5, 3.0, 12.0),),
    (Burst(2.5, 5.0, 20.0),),
    (Burst(2.5, 8.0, 30.0),),
    (Burst(2.5, 8.0, 30.0), Burst(2.5, 8.0, 30.0, 0.5), Burst(2.5, 8.0, 30.0, 0.25)),
    (Burst(2.5, 8.0, 30.0), Burst(2.5, 2.0, 6.0)),
    (Burst(1.0, 8.0, 30.0), Burst(4.0, 2.0, 30.0, 0.5)),
    (Burst(0.7, 8.0, 30.0), Burst(2.0, 5.0, 15.0), Burst(4.0, 2.0, 6.0)),
    (Burst(0.5, 8.0, 30.0), Burst(5.0, 2.0, 6.0)),
)
"""Sequences of bursts that are tried.

A short burst of large amplitude among long ones of small amplitude separates odd powers of acceleration: the small ones
determine the scale factor, the large ones how the error grows.
"""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the stage."""

    stroke: float
    """Largest travel from end to end, m."""
    speed: float
    """m/s"""
    acceleration: float
    """m/s²"""

    def __post_init__(self) -> None:
        for name in ("stroke", "speed", "acceleration"):
            if not getattr(self, name) > 0.0:
                raise AccelcalError(f"{name} must be positive, not {getattr(self, name):g}")

    def scaled(self, factor: float) -> Limits:
        """All limits, `factor` times as large."""
        return Limits(factor * self.stroke, factor * self.speed, factor * self.acceleration)

    def duration(self, distance: float) -> float:
        """Least duration of a move, s."""
        return max(
            STEP_TOP_SPEED * abs(distance) / self.speed,
            math.sqrt(STEP_ACCELERATION * abs(distance) / self.acceleration),
        )


@dataclass(frozen=True, slots=True)
class Recipe:
    """Parameters of a motion that the search varies."""

    pattern: tuple[Burst, ...]
    share: float
    """Of the time, for moves."""
    aligned: bool
    """Whether the tones of a burst meet in one peak at its middle; otherwise their phases are random."""
    seed: int = 0


def build(recipe: Recipe, limits: Limits, seconds: float) -> Motion:
    """Bursts and groups of moves in turn; the position begins and ends at the middle of the stroke."""
    inner, rng = limits.scaled(MARGIN), np.random.default_rng(recipe.seed)
    group = max(_moves(inner, 1.0, k, 2 * len(PLACES))[1] for k in range(2 * len(PLACES)))
    count = max(1, math.floor(recipe.share * seconds / group))
    reach = _reach(inner, recipe.share * seconds) if count == 1 else 1.0
    moves = [_moves(inner, reach, k, count) for k in range(count)]
    slot = (seconds - sum(lasts for _, lasts in moves)) / count
    bursts = cycle(recipe.pattern)
    t, parts = 0.0, list[Part]()
    for k, (group_of_moves, lasts) in enumerate(moves):
        stop = t + slot
        while stop - t >= SHORTEST:
            burst = next(bursts)
            length = min(burst.seconds, stop - t)
            parts.append(_shake(burst, t, length, _place(k, count) * reach, recipe.aligned, inner, rng))
            t += length
        parts += [replace(move, start=move.start + stop) for move in group_of_moves]
        t = stop + lasts
    return Motion(tuple(parts), seconds, name="planned")


def _place(k: int, count: int) -> float:
    """Where burst group `k` happens, as a share of the stroke; the motion begins and ends in the middle."""
    return PLACES[k % len(PLACES)] if k < count else 0.0


def _moves(limits: Limits, reach: float, k: int, count: int) -> tuple[list[Move], float]:
    """Group `k` of moves from time 0, with rests, and its duration, s."""
    t, moves = 0.0, list[Move]()
    here, there, side = _place(k, count), _place(k + 1, count), 0.5 if k % 2 == 0 else -0.5
    for leg in (side - here, -2.0 * side, there + side):  # to one end, to the other, to the next place
        distance = leg * reach * limits.stroke
        duration = limits.duration(distance)
        moves.append(Move(t, duration, distance))
        t += duration + REST
    return moves, t


def _reach(limits: Limits, seconds: float) -> float:
    """Share of the stroke that one group of moves covers in the given time, by bisection."""
    if _moves(limits, 1.0, 0, 1)[1] <= seconds:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _moves(limits, middle, 0, 1)[1] <= seconds else (low, middle)
    return low


def _shake(
    burst: Burst, start: float, length: float, place: float, aligned: bool, limits: Limits, rng: np.random.Generator
) -> Windowed:
    """Tones of equal acceleration, as large as the limits allow about a place, times the level; a rest at their end."""
    stop = start + length - min(REST, 0.2 * length)
    frequency = np.exp(rng.uniform(math.log(burst.low), math.log(burst.high), TONES))
    phase = rng.uniform(0.0, 2.0 * math.pi, TONES)
    if aligned:
        phase = 0.5 * math.pi - math.pi * frequency * (start + stop)
    tones = Tones(1.0 / (2.0 * math.pi * frequency) ** 2, frequency, phase)
    part = Windowed(tones, start, stop, min(FADE, 0.3 * length))
    peaks = np.max(np.abs(part.derivatives(np.arange(start, stop, 1.0 / (PEAK_SAMPLES * burst.high)))), axis=1)
    room = (0.5 - abs(place)) * limits.stroke
    gain = burst.level * min(room / peaks[0], limits.speed / peaks[1], limits.acceleration / peaks[2])
    return replace(part, part=replace(tones, amplitude=gain * tones.amplitude))


SHARES = (0.2, 0.5)
"""Shares of the time for moves that are tried."""
SEEDS = 12
"""Random draws of tones that are tried for the best recipe."""
LEAST_SECONDS = 5.0
"""Shorter motions are not planned."""
MOST_PLANNED = 3600.0
"""Nor are longer ones, s."""
LEAST_LIMIT = 1e-6
"""Least limit of a stage, and reciprocal of the largest one, SI."""


@dataclass(frozen=True, slots=True, repr=False)
class Plan(Result):
    """A motion that separates named effects, and its detection limits."""

    tables_in: ClassVar[str] = "results.experiments"

    derived: ClassVar[tuple[str, ...]] = ("seconds", "separated")

    motion: Annotated[Motion, NotStored("accelcal.plan with the same arguments makes it again")]
    effects: tuple[str, ...]
    limits: Limits
    recipe: Recipe
    power: Power
    """Of the motion, over the whole catalogue."""
    correlations: tuple[tuple[str, str, float], ...]
    """|rho| of every pair of the named effects."""
    typical: tuple[float, ...]
    """Distance from zero, in standard deviations, of the typical size of each effect, the other named ones estimated
    jointly."""
    tried: int

    @property
    def detectabilities(self) -> tuple[Detectability, ...]:
        """Detection limit of each of the named effects."""
        return tuple(self.power[name] for name in self.effects)

    @property
    def seconds(self) -> float:
        """Length of the motion, s."""
        return self.motion.seconds

    @property
    def separated(self) -> bool:
        """Whether every pair is separated, and each effect visible."""
        return all(correlation < TIED_CORRELATION for *_, correlation in self.correlations) and all(
            s.visible for s in self.detectabilities
        )


def set_points_of(motion: Motion, rate: float = 1000.0) -> tuple[Array, Array]:
    """Times (n,) s and positions (n,) m of a motion."""
    t = np.arange(math.floor(motion.seconds * rate) + 1) / rate
    return t, motion.position(t)


@checked
@one_thread
def plan(
    effects: Sequence[str],
    *,
    stroke: float,
    v_max: float,
    a_max: float,
    seconds: float,
    rig: Rig,
    encoder_noise: float | None = None,
    alpha: float = FAMILYWISE_ALPHA,
    progress: Callable[[float], None] = lambda share: None,
) -> Plan:
    """Search for a motion that separates effects within the limits of a stage.

    Parameters
    ----------
    effects : names of the catalogue.
    stroke, v_max, a_max : limits, m, m/s, m/s²; none of them is exceeded at any instant.
    seconds : length, s.
    rig : noise density of the sensor, resolution of the encoder.
    encoder_noise : standard deviation of a reading before it is rounded, m; one step of the encoder by default.
    alpha : family-wise false-alarm rate of `diagnose`.
    progress : called with the share of the work that is done, 0 to 1.

    Returns
    -------
    Plan
        Of the motions tried the one that separates the most correlated pair (|rho| < 0.95), and the typical size of
        the least visible effect, the other effects estimated jointly, is furthest from zero.

    Raises
    ------
    ValueError
        If an effect is unknown, or no motion can show it; if the time is too short.

    Examples
    --------
    >>> from accelcal.simulation.sensor import CXL02_RIG
    >>> planned = plan(["quadratic", "cubic"], stroke=0.2, v_max=0.1, a_max=20.0, seconds=10.0, rig=CXL02_RIG)
    >>> planned.motion.top_speed <= 0.1
    True
    """
    wanted = tuple(dict.fromkeys(effects))
    require_plannable(wanted)
    if not seconds >= LEAST_SECONDS:
        raise AccelcalError(f"a motion of {seconds:g} s is too short to plan; take {LEAST_SECONDS:g} s or more")
    if seconds > MOST_PLANNED:
        raise AccelcalError(
            f"a motion of {seconds:g} s is too long to plan; take {MOST_PLANNED:g} s or less and repeat it"
        )
    limits, noise = limits_of_stage(stroke, v_max, a_max), planned_noise(rig, encoder_noise)
    first = [Recipe(*choice) for choice in product(PATTERNS, SHARES, (False, True))]
    trials: list[Trial] = []

    def try_all(recipes: Sequence[Recipe]) -> None:
        for recipe in recipes:
            trials.append(Trial.of(recipe, limits, seconds, rig, noise, wanted))
            progress(0.9 * len(trials) / (len(first) + SEEDS))

    try_all(first)
    best = max(trials, key=lambda trial: trial.score)
    try_all([replace(best.recipe, seed=seed) for seed in range(1, SEEDS + 1)])
    best = max(trials, key=lambda trial: trial.score)
    state = planned_state(best.motion, rig, seconds, noise, Model.linear())
    return Plan(
        motion=best.motion,
        effects=wanted,
        limits=limits,
        recipe=best.recipe,
        power=detectability_of(state, Model.linear(), alpha=alpha),
        correlations=best.correlations,
        typical=best.typical,
        tried=len(trials),
    )


def limits_of_stage(stroke: float, speed: float, acceleration: float) -> Limits:
    """Limits that a user gives.

    Raises
    ------
    ValueError
        If one of them is not that of a stage.
    """
    limits = Limits(stroke, speed, acceleration)
    for name, value in (("stroke", stroke), ("speed", speed), ("acceleration", acceleration)):
        if not LEAST_LIMIT <= value <= 1.0 / LEAST_LIMIT:
            raise AccelcalError(
                f"{name} {value:g}: expected {LEAST_LIMIT:g} to {1.0 / LEAST_LIMIT:g} in SI; give that of the stage"
            )
    return limits


def require_plannable(names: Sequence[str]) -> None:
    """Raise for effects that no motion can show."""
    if not names:
        raise AccelcalError("name at least one effect that the motion should show")
    for name in names:
        effect = find(name)
        reasons = (
            (name in Model.linear().effects, "is in every model; name an effect beyond the base"),
            (not effect.traits.visible, f"cannot be shown by any motion of this rig: {effect.experiment}"),
            (effect.needs, f"depends on {' and '.join(effect.needs)}, which no motion can plan"),
            (effect.port == "noise", "acts on the noise and is tested on a channel of its own, without a prediction"),
        )
        for holds, why in reasons:
            if holds:
                raise AccelcalError(f"{name!r} {why}")


@dataclass(frozen=True, slots=True)
class Trial:
    """One motion of the search with its figures of merit."""

    recipe: Recipe
    motion: Motion
    correlations: tuple[tuple[str, str, float], ...]
    typical: tuple[float, ...]

    @classmethod
    def of(
        cls, recipe: Recipe, limits: Limits, seconds: float, rig: Rig, noise: Noise, wanted: tuple[str, ...]
    ) -> Trial:
        """Build the motion of a recipe, and evaluate the wanted effects only."""
        motion = build(recipe, limits, seconds)
        state = planned_state(motion, rig, seconds, noise, Model.linear(), ACCEL_RATE, POSITION_RATE)
        evidence = evidence_of_best(state, wanted)
        correlation = correlations(evidence)
        names = [item.effect.name for item in evidence.items]
        pairs = tuple(
            (names[i], names[j], float(abs(correlation[i, j]))) for i, j in combinations(range(len(names)), 2)
        )
        return cls(recipe, motion, pairs, separated_distances(evidence, correlation))

    @property
    def score(self) -> tuple[float, float]:
        """Correlation of the worst pair beyond what is separated, then the distance of the least visible effect from
        zero."""
        worst = max((rho for *_, rho in self.correlations), default=0.0)
        return -max(0.0, worst - MARGIN * TIED_CORRELATION), min(self.typical)


def evidence_of_best(state: RunState, wanted: tuple[str, ...]) -> CandidateScores:
    """Information on the wanted effects, in their order, each at its most visible trial shape."""
    model = Model.linear()
    items = [item for item in hypotheses_for(state, model) if item.effect.name in wanted]
    if any(item.shape for item in items):
        evidence, rules = evidence_of(state, model, items), SearchRules.of(state, len(items), FAMILYWISE_ALPHA)
        smallest = [min(detectable_sizes(evidence, i, rules)[1]) for i in range(len(items))]
    else:
        smallest = [0.0] * len(items)
    best: dict[str, Hypothesis] = {}
    for k in np.argsort(smallest, kind="stable"):
        best.setdefault(items[k].effect.name, items[k])
    return evidence_of(state, model, [best[name] for name in wanted])


def correlations(evidence: CandidateScores) -> Array:
    """Correlation of the whitened signatures, (effects, effects); of several columns their most visible mixture."""
    mix = np.zeros((len(evidence.c), len(evidence.items)))
    for i in range(len(evidence.items)):
        mix[evidence.columns[i], i] = most_visible_direction(evidence, i)
    return unit_diagonal(mix.T @ evidence.G @ mix)[0]


def separated_distances(evidence: CandidateScores, correlation: Array) -> tuple[float, ...]:
    """Distance of the typical size of each effect from zero, the others estimated jointly: d sqrt(1 - R²)."""
    unshared = 1.0 / np.diag(np.linalg.inv(correlation + 1e-12 * np.eye(len(correlation))))
    powers = (float(np.max(np.diag(evidence.G[columns, columns]))) for columns in evidence.columns)
    return tuple(
        item.effect.prior.typical * math.sqrt(max(0.0, power * float(left)))
        for item, power, left in zip(evidence.items, powers, unshared, strict=True)
    )
