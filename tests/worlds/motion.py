"""How the stage moves: seeded positions on knots, joined by a spline of degree seven that is the truth.

Velocity, acceleration and jerk are the derivatives of the same polynomial pieces, so p'' = a holds to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from scipy.interpolate import PPoly, make_interp_spline

from .numerics import STEP, Array, stream

MARGIN = 0.1
"""The fine grid begins this long before time zero and ends this long after the record, s."""
KNOT = 4e-3
_SPARE = 0.4
_PER_KNOT = round(KNOT / STEP)
_TRAVEL = 0.1
_SPEED = 0.1


@dataclass(frozen=True, slots=True)
class Motion:
    """The true motion on the fine grid; every array is (n,)."""

    t: Array
    p: Array
    v: Array
    a: Array
    jerk: Array


@lru_cache(maxsize=4)
def move(name: str, seed: int, seconds: float) -> Motion:
    """Return the motion `name` of MOTIONS for one seed, from −MARGIN to seconds + MARGIN."""
    motions = MOTIONS | RAMPS
    if name not in motions:
        raise ValueError(f"there is no motion {name!r}; known: {', '.join(motions)}")
    knots = knots_of(seconds)
    return Motion(grid(seconds), *curve(motions[name](knots, seconds, stream(seed, 0)), seconds, 4))


def grid(seconds: float) -> Array:
    """Return the fine grid, s, (n,)."""
    return np.arange(float(round((seconds + 2 * MARGIN) / KNOT) * _PER_KNOT)) * STEP - MARGIN


def knots_of(seconds: float) -> Array:
    """Return the knots on which a curve is designed, s."""
    spare = round(_SPARE / KNOT)
    return np.arange(-float(spare), round((seconds + 2 * MARGIN) / KNOT) + spare + 1) * KNOT - MARGIN


def curve(samples: Array, seconds: float, derivatives: int) -> list[Array]:
    """Return the spline through `samples` on `knots_of(seconds)` and its first derivatives on the fine grid."""
    knots = knots_of(seconds)
    pieces = PPoly.from_spline(make_interp_spline(knots, samples, k=7))
    first = int(np.searchsorted(pieces.x, -MARGIN - KNOT / 2))
    intervals = len(grid(seconds)) // _PER_KNOT
    coefficients = pieces.c[::-1, first : first + intervals]
    powers = np.vander(np.arange(_PER_KNOT) * STEP, 8, increasing=True)
    results = []
    for _ in range(derivatives):
        results.append((coefficients.T @ powers[:, : len(coefficients)].T).ravel())
        coefficients = coefficients[1:] * np.arange(1, len(coefficients))[:, None]
    return results


def band_noise(knots: Array, low: float, high: float, rng: np.random.Generator, slope: float = 0.0) -> Array:
    """Return Gaussian noise on the knots with spectrum f^slope between two corners, soft edges, rms one."""
    n = len(knots)
    f = np.fft.rfftfreq(n, KNOT)
    shape = np.zeros_like(f)
    shape[1:] = f[1:] ** slope / (1 + (low / f[1:]) ** 8) / (1 + (f[1:] / high) ** 8)
    y = np.fft.irfft(shape * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))), n)
    return np.asarray(y / np.sqrt(np.mean(y**2)))


def _rise(s: Array) -> Array:
    """Return the polynomial from 0 to 1 with three vanishing derivatives at both ends."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3))


def _burst(slot: Array, rng: np.random.Generator, top_speed: float = _SPEED) -> Array:
    """Random shaking that begins and ends at rest where it began, up to `top_speed`."""
    edge = min(0.5, (slot[-1] - slot[0]) / 3)
    window = _rise((slot - slot[0]) / edge) * _rise((slot[-1] - slot) / edge)
    high = rng.uniform(8.0, 15.0)
    p = window * band_noise(slot, 1.5, high, rng, slope=-0.5)
    return np.asarray(p * top_speed * rng.uniform(0.6, 0.98) / np.max(np.abs(np.gradient(p, KNOT))))


def _cosine_rise(s: Array) -> Array:
    """Return the rise from 0 to 1 whose speed is a raised cosine; the jerk steps at both ends."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s - np.sin(2 * np.pi * s) / (2 * np.pi))


def _quintic_rise(s: Array) -> Array:
    """Return the polynomial from 0 to 1 with two vanishing derivatives at both ends; the jerk steps there."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def _moves(slot: Array, rng: np.random.Generator, start: float, rise: Callable[[Array], Array] = _rise) -> Array:
    """Moves from point to point with rests between; 35/16 is the largest peak of a rise's derivative."""
    p = np.full_like(slot, start)
    at, here = slot[0] + rng.uniform(0.2, 0.8), start
    while True:
        target = np.clip(
            here + rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(2e-3), np.log(0.15))), -_TRAVEL, _TRAVEL
        )
        lasts = max(35 / 16 * abs(target - here) / (_SPEED * rng.uniform(0.3, 0.98)), 0.15)
        if at + lasts > slot[-1]:
            return p
        p += (target - here) * rise((slot - at) / lasts)
        here = float(target)
        at += lasts + rng.uniform(0.3, 1.2)


def _slots(knots: Array, begin: float, end: float, rng: np.random.Generator) -> Iterator[slice]:
    """Cut [begin, end] into slots of 3 to 7 s."""
    at = begin
    while end - at > 1.5:
        lasts = rng.uniform(3.0, 7.0)
        if end - at - lasts < 3.0:
            lasts = end - at
        yield slice(int(np.searchsorted(knots, at)), int(np.searchsorted(knots, at + lasts)))
        at += lasts


Slot = Callable[[Array, np.random.Generator, float], Array]


def _sequence(knots: Array, begin: float, end: float, rng: np.random.Generator, kinds: tuple[Slot, ...]) -> Array:
    p, here = np.zeros_like(knots), 0.0
    for k, slot in enumerate(_slots(knots, begin, end, rng)):
        p[slot] = kinds[k % len(kinds)](knots[slot], rng, here)
        here = float(p[slot][-1])
        p[slot.stop :] = here
    return p


def _shake(slot: Array, rng: np.random.Generator, here: float) -> Array:
    return here + _burst(slot, rng)


def bursts(knots: Array, seconds: float, rng: np.random.Generator) -> Array:
    """Random bursts of 3 to 7 s, each with its own strength and bandwidth, |v| <= 0.1 m/s."""
    return _sequence(knots, 0.2, seconds - 0.2, rng, (_shake,))


def moves(knots: Array, seconds: float, rng: np.random.Generator) -> Array:
    """Point-to-point moves with rests, |v| <= 0.1 m/s."""
    return _sequence(knots, 0.2, seconds - 0.2, rng, (_moves,))


def interleaved(knots: Array, seconds: float, rng: np.random.Generator) -> Array:
    """Bursts and moves with rests, alternating every 3 to 7 s, |v| <= 0.1 m/s."""
    return _sequence(knots, 0.2, seconds - 0.2, rng, (_shake, _moves))


def cosine_ramps(knots: Array, seconds: float, rng: np.random.Generator) -> Array:
    """Interleaved motion whose moves have a raised cosine as speed."""
    return _sequence(knots, 0.2, seconds - 0.2, rng, (_shake, partial(_moves, rise=_cosine_rise)))


def quintic_ramps(knots: Array, seconds: float, rng: np.random.Generator) -> Array:
    """Interleaved motion whose moves are polynomials of degree five."""
    return _sequence(knots, 0.2, seconds - 0.2, rng, (_shake, partial(_moves, rise=_quintic_rise)))


def long_rest(knots: Array, seconds: float, rng: np.random.Generator) -> Array:
    """Interleaved motion between two rests of 20 s."""
    if seconds < 45:
        raise ValueError(f"found {seconds} s, but two rests of 20 s and a motion need at least 45 s")
    return _sequence(knots, 20.0, seconds - 20.0, rng, (_shake, _moves))


def tones(knots: Array, seconds: float, rng: np.random.Generator) -> Array:
    """Four steady tones between 1.5 and 10 Hz, |v| <= 0.1 m/s together."""
    f = np.array([1.7, 3.1, 5.3, 8.9]) * rng.uniform(0.9, 1.1, 4)
    share = rng.uniform(0.6, 1.0, 4)
    speed = 0.98 * _SPEED * share / share.sum()
    phase = rng.uniform(0, 2 * np.pi, 4)
    return np.asarray(np.sin(2 * np.pi * f * knots[:, None] + phase) @ (speed / (2 * np.pi * f)))


def chirp(knots: Array, seconds: float, rng: np.random.Generator) -> Array:
    """A tone of constant speed that sweeps between 0.6 and 13 Hz and back every 24 s or so."""
    period = rng.uniform(20.0, 28.0)
    centre, swing = np.log(np.sqrt(0.6 * 13)), np.log(np.sqrt(13 / 0.6))
    f = np.exp(centre - swing * np.cos(2 * np.pi * knots / period + rng.uniform(0, 2 * np.pi)))
    phase = 2 * np.pi * np.cumsum(f) * KNOT
    return np.asarray(0.085 / (2 * np.pi * f) * np.sin(phase))


def fast(knots: Array, seconds: float, rng: np.random.Generator) -> Array:
    """Bursts from 2 to 17.5 m/s² on a slow traverse; it needs an encoder faster than 0.1 m/s."""
    p = np.zeros_like(knots)
    levels = np.array([17.5, 8.0, 12.0, 3.0])
    for k, slot in enumerate(_slots(knots, 0.2, seconds - 0.2, rng)):
        shake = _burst(knots[slot], rng)
        reached = np.max(np.abs(np.gradient(np.gradient(shake, KNOT), KNOT)))
        p[slot] = shake * levels[k % 4] * rng.uniform(0.9, 0.99) / reached
    return p + 0.06 * np.sin(2 * np.pi * knots / rng.uniform(25.0, 40.0) + rng.uniform(0, 2 * np.pi))


MOTIONS: dict[str, Callable[[Array, float, np.random.Generator], Array]] = {
    "bursts": bursts,
    "moves": moves,
    "interleaved": interleaved,
    "tones": tones,
    "fast": fast,
    "chirp": chirp,
    "long_rest": long_rest,
}
"""Every motion: knots (n,) in s, length of the record in s, generator -> position (n,) in m."""
RAMPS: dict[str, Callable[[Array, float, np.random.Generator], Array]] = {
    "cosine_ramps": cosine_ramps,
    "quintic_ramps": quintic_ramps,
}
"""Interleaved motion with ramps of motion controllers, whose jerk steps; trials draw from MOTIONS alone."""
