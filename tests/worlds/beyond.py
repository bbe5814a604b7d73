"""Effects outside the catalogue that are local, sudden or random: what is easily taken for a step, play or a tone."""

from __future__ import annotations

import numpy as np

from .catalogue import Effect, Shape, between, declare
from .numerics import STEP, Array
from .scene import Scene

BEYOND: dict[str, Effect] = {}


def _narrow_place(scene: Scene, rng: np.random.Generator) -> dict[str, float]:
    low, high = np.quantile(scene.p, (0.1, 0.9))
    return {"centre": float(rng.uniform(low, high)), "width": float((high - low) * rng.uniform(0.01, 0.03))}


@declare(BEYOND, "m/s²", "force", "position", 3e-2, draw=_narrow_place)
def narrow_bump(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A joint of two rails tilts the carriage where it passes (inclined plane, Gaussian profile of 1 to 3 % travel)."""
    return m * np.exp(-0.5 * ((scene.p - shape["centre"]) / shape["width"]) ** 2)


@declare(BEYOND, "m/s²", "force", "position", 3e-2, draw=_narrow_place)
def notch(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A dent of the rail: the carriage goes down and up again, so that its inclination changes sign in the middle."""
    u = (scene.p - shape["centre"]) / shape["width"]
    return m * u * np.exp(0.5 - 0.5 * u**2)


@declare(BEYOND, "m/s²", "force", "position velocity since_reversal", 3e-2, draw=between(period=(3e-4, 1e-3)))
def stick_slip(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Below a speed the slide sticks, loads its spring and slips: a saw tooth over the way (Bowden, Leben 1939)."""
    tooth = np.mod(np.abs(scene.p) / shape["period"], 1.0) - 0.5
    return m * np.sign(scene.v) * tooth * np.exp(-np.abs(scene.v) / 0.01) * (np.abs(scene.v) > 1e-6)


@declare(BEYOND, "m/s²", "force", "position velocity since_reversal", 3e-2, draw=between(reach=(2e-4, 2e-3)))
def breakaway(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Static friction bends the mount until the slide has moved by a reach (Dahl 1968), after each reversal."""
    moving = np.where(np.abs(scene.v) > 1e-5, np.sign(scene.v), 0.0)
    at = np.flatnonzero(moving)
    turns = at[1:][moving[at[1:]] != moving[at[:-1]]]
    marks = np.zeros(len(moving), dtype=np.int64)
    marks[turns] = turns
    way = np.abs(scene.p - scene.p[np.maximum.accumulate(marks)])
    return m * moving * np.exp(-way / shape["reach"])


@declare(BEYOND, "m/s²", "response", "time", 1e-2, draw=between(dwell=(1.0, 4.0)))
def popcorn(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A random telegraph bias: a trap in the amplifier fills and empties (Machlup 1954; Hsu 1970, burst noise)."""
    switched = rng.random(len(scene.t)) < STEP / shape["dwell"]
    return m * (np.mod(np.cumsum(switched), 2) - 0.5)


@declare(BEYOND, "m/s² per m/s³", "response", "jerk", 1e-4)
def jerk_size(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A rectified slope: bias in proportion to |da/dt| (slew-rate rectification of an amplifier)."""
    return m * np.abs(scene.jerk)
