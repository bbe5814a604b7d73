"""Motions of a recipe: bursts of tones alternate with moves over the stroke, within the limits of a stage."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import cycle

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.simulation.motion import Motion, Move, Part, Tones, Windowed

MARGIN = 0.999
"""Share of every limit that is used: a margin for peaks between two samples of the search for them."""
PEAK_SAMPLES = 100.0
"""Samples per period of the highest tone in the search for peaks; they miss at most (pi/100)²/2 = 5e-4 of one."""
STEP_SPEED = 35.0 / 16.0
"""Top speed of a move over distance/duration."""
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
            STEP_SPEED * abs(distance) / self.speed, math.sqrt(STEP_ACCELERATION * abs(distance) / self.acceleration)
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
    group = _group_seconds(inner)
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


def _legs(k: int, count: int) -> tuple[float, ...]:
    """Legs of group `k` as shares of the stroke: to one end, to the other, to the next place."""
    here, there, side = _place(k, count), _place(k + 1, count), 0.5 if k % 2 == 0 else -0.5
    return side - here, -2.0 * side, there + side


def _moves(limits: Limits, reach: float, k: int, count: int) -> tuple[list[Move], float]:
    """Group `k` of moves from time 0, with rests, and its duration, s."""
    t, moves = 0.0, list[Move]()
    for leg in _legs(k, count):
        distance = leg * reach * limits.stroke
        duration = limits.duration(distance)
        moves.append(Move(t, duration, distance))
        t += duration + REST
    return moves, t


def _group_seconds(limits: Limits) -> float:
    """Longest duration of a group of moves over the whole stroke, s."""
    return max(_moves(limits, 1.0, k, 2 * len(PLACES))[1] for k in range(2 * len(PLACES)))


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
