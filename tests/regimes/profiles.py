"""What stages, hands and shakers do: every profile is a seeded motion that begins and ends at rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.worlds.numerics import Array

from .motion import Motion, from_design, from_pieces

MARGIN = 0.5
"""The motion is known this long before time zero and after the record, s."""
TRAVEL = 0.1
"""Half of the travel of a stage, m."""
SPEED = 0.098
"""Of a stage at most, m/s: what the encoder of the paper follows."""
STEP = 1e-4
"""Between samples of profiles that are designed on a grid, s; longer for slow ones."""

Pieces = list[tuple[float, float, float]]
"""Length in s, acceleration at its beginning and at its end in m/s^2."""
Ramp = Callable[[float, float], Pieces]
"""(change of velocity, duration) -> pieces."""


# --- moves from point to point: exact instants of every step of acceleration or jerk ----------------------------------


def _step_ramp(dv: float, lasts: float) -> Pieces:
    return [(lasts, dv / lasts, dv / lasts)]


def _jerk_ramp(dv: float, lasts: float) -> Pieces:
    """Three of the seven segments: jerk, hold, jerk back, each jerk a quarter of the ramp."""
    short = lasts / 4
    top = dv / (lasts - short)
    return [(short, 0.0, top), (lasts - 2 * short, top, top), (short, top, 0.0)]


def _cosine_ramp(dv: float, lasts: float) -> Pieces:
    """v = dv (1 - cos(pi s))/2: jerk steps of dv pi^2/(2 T^2) at both ends."""
    n = int(np.ceil(lasts / STEP))
    a = dv * np.pi / (2 * lasts) * np.sin(np.pi * np.arange(n + 1) / n)
    a[-1] = 0.0
    return [(lasts / n, a[k], a[k + 1]) for k in range(n)]


def _moves(seconds: float, rng: np.random.Generator, ramp: Ramp) -> Motion:
    """Moves of 4 to 50 mm, ramps of 35 to 150 ms, a cruise, rests of 50 to 400 ms, until 0.3 s before the end."""
    pieces: Pieces = [(MARGIN + rng.uniform(0.2, 0.5), 0.0, 0.0)]
    spent, here = pieces[0][0] - MARGIN, 0.0
    while True:
        distance, speed, lasts = _drawn(rng, here)
        cruise = max(abs(distance) / speed - lasts, 0.0)
        speed = abs(distance) / (cruise + lasts)
        rest = rng.uniform(0.05, 0.4)
        if spent + 2 * lasts + cruise + rest > seconds - 0.3:
            break
        dv = float(np.copysign(speed, distance))
        pieces += [*ramp(dv, lasts), (cruise, 0.0, 0.0), *ramp(-dv, lasts), (rest, 0.0, 0.0)]
        spent += 2 * lasts + cruise + rest
        here += distance
    pieces.append((seconds - spent + MARGIN, 0.0, 0.0))
    lengths, first, last = np.array(pieces).T
    return from_pieces(-MARGIN, lengths, first, last)


def _drawn(rng: np.random.Generator, here: float) -> tuple[float, float, float]:
    """Return distance, speed and length of a ramp."""
    distance = float(np.exp(rng.uniform(np.log(4e-3), np.log(0.05))))
    towards_centre = -1.0 if here > 0 else 1.0
    sign = towards_centre if abs(here) + distance > TRAVEL else float(rng.choice([-1.0, 1.0]))
    return sign * distance, SPEED * rng.uniform(0.3, 1.0), float(rng.uniform(0.035, 0.15))


def trapezoid(seconds: float, rng: np.random.Generator) -> Motion:
    """Trapezoidal velocity: steps of acceleration of 0.2 to 2.8 m/s^2."""
    return _moves(seconds, rng, _step_ramp)


def s_curve(seconds: float, rng: np.random.Generator) -> Motion:
    """Seven segments: steps of jerk up to 430 m/s^3."""
    return _moves(seconds, rng, _jerk_ramp)


def cosine(seconds: float, rng: np.random.Generator) -> Motion:
    """Raised-cosine ramps of velocity: steps of jerk up to 390 m/s^3."""
    return _moves(seconds, rng, _cosine_ramp)


# --- designed on a grid ------------------------------------------------------------------------------------------


def grid(seconds: float, step: float = STEP) -> Array:
    """Return the instants of a design, s."""
    return -MARGIN + step * np.arange(float(round((seconds + 2 * MARGIN) / step) + 1))


def rise5(s: Array) -> Array:
    """Minimum jerk from 0 to 1 (Flash, Hogan 1985): steps of jerk at both ends."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def rise7(s: Array) -> Array:
    """From 0 to 1 with three vanishing derivatives at both ends: continuous jerk."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3))


def _risen(
    t: Array, begin: float, end: float, rng: np.random.Generator, rise: Callable[[Array], Array], peak: float
) -> Array:
    """Moves by one polynomial each; `peak` is the largest derivative of `rise`, which sets the duration."""
    p, here = np.zeros_like(t), 0.0
    at = begin + rng.uniform(0.2, 0.5)
    while True:
        distance, speed, _ = _drawn(rng, here)
        lasts = max(peak * abs(distance) / speed, 0.12)
        if at + lasts > end - 0.3:
            return p
        i, j = np.searchsorted(t, (at, at + lasts + 2 * (t[1] - t[0])))
        p[i:j] += distance * rise((t[i:j] - at) / lasts)
        p[j:] += distance
        here += distance
        at += lasts + rng.uniform(0.05, 0.4)


def minimum_jerk(seconds: float, rng: np.random.Generator) -> Motion:
    """Minimum-jerk moves."""
    t = grid(seconds)
    return from_design(t[0], STEP, _risen(t, 0.0, seconds, rng, rise5, 15 / 8))


def smooth(seconds: float, rng: np.random.Generator) -> Motion:
    """Moves with continuous jerk."""
    t = grid(seconds)
    return from_design(t[0], STEP, _risen(t, 0.0, seconds, rng, rise7, 35 / 16))


def window(t: Array, begin: float, end: float, edge: float) -> Array:
    """Return what rises from 0 to 1 after `begin` and falls before `end`, with continuous jerk."""
    return np.asarray(rise7((t - begin) / edge) * rise7((end - t) / edge))


def band_noise(n: int, step: float, low: float, high: float, rng: np.random.Generator, slope: float = 0.0) -> Array:
    """Return Gaussian noise (n,) of spectrum f^slope between two corners, soft edges, rms one."""
    f = np.fft.rfftfreq(n, step)
    shape = np.zeros_like(f)
    shape[1:] = f[1:] ** slope / (1 + (low / f[1:]) ** 8) / (1 + (f[1:] / high) ** 8)
    y = np.fft.irfft(shape * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))), n)
    return np.asarray(y / np.sqrt(np.mean(y**2)))


def _fastest(p: Array, step: float, speed: float) -> Array:
    return np.asarray(p * speed / np.max(np.abs(np.gradient(p, step))))


def _shaken(t: Array, begin: float, end: float, rng: np.random.Generator, low: float, high: float) -> Array:
    step = t[1] - t[0]
    noise = band_noise(len(t), step, low, high, rng, slope=-0.5)
    return _fastest(window(t, begin, end, 0.5) * noise, step, SPEED * rng.uniform(0.7, 1.0))


def random(seconds: float, rng: np.random.Generator) -> Motion:
    """Band-limited random motion from 1.5 Hz to 8 to 15 Hz."""
    t = grid(seconds)
    return from_design(t[0], STEP, _shaken(t, 0.2, seconds - 0.2, rng, 1.5, rng.uniform(8.0, 15.0)))


def one_sided(seconds: float, rng: np.random.Generator) -> Motion:
    """Random motion on a travel from 0 to 0.3 m: the mean position is far from the origin."""
    t = grid(seconds)
    away = 0.25 * rise7((t - 0.2) / 4) * rise7((seconds - 0.2 - t) / 4)
    return from_design(t[0], STEP, away + 0.5 * _shaken(t, 0.2, seconds - 0.2, rng, 1.5, 12.0))


def mixed(seconds: float, rng: np.random.Generator) -> Motion:
    """Random bursts of 3 s in turn with smooth moves of 3 s."""
    t = grid(seconds, _coarse(seconds))
    p, here, begin, number = np.zeros_like(t), 0.0, 0.2, 0
    while begin + 1.5 < seconds:
        end = min(begin + 3.0, seconds - 0.2)
        part = slice(int(np.searchsorted(t, begin)), int(np.searchsorted(t, end)))
        if number % 2 == 0:
            p[part] += _shaken(t[part], begin, end, rng, 1.5, rng.uniform(8.0, 15.0))
        else:
            moved = _risen(t[part], begin, end, rng, rise7, 35 / 16) * 0.5
            p[part] += moved
            p[part.stop :] += moved[-1]
            here += moved[-1]
        begin, number = end, number + 1
    return from_design(t[0], t[1] - t[0], p)


def _coarse(seconds: float) -> float:
    return STEP if seconds <= 120 else 2.5e-4


def chirp(seconds: float, rng: np.random.Generator) -> Motion:
    """A tone of constant speed that sweeps between 0.6 and 25 Hz and back every 24 s or so."""
    t = grid(seconds)
    centre, swing = np.log(np.sqrt(0.6 * 25)), np.log(np.sqrt(25 / 0.6))
    f = np.exp(centre - swing * np.cos(2 * np.pi * t / rng.uniform(20.0, 28.0) + rng.uniform(0, 2 * np.pi)))
    p = np.sin(2 * np.pi * np.cumsum(f) * STEP) / (2 * np.pi * f)
    return from_design(t[0], STEP, 0.085 * window(t, 0.2, seconds - 0.2, 1.0) * p)


def shaker(seconds: float, rng: np.random.Generator) -> Motion:
    """Sine steps on a shaker: 5 to 40 Hz, five seconds each or a sixth of the record, 3 to 8 m/s^2."""
    t, p = grid(seconds), np.zeros(len(grid(seconds)))
    tones = rng.permutation([5.0, 8.0, 12.5, 20.0, 31.5, 40.0])
    slot = (seconds - 0.4) / len(tones)
    for k, f in enumerate(tones):
        begin = 0.2 + k * slot
        size = rng.uniform(3.0, 8.0) / (2 * np.pi * f) ** 2
        p += window(t, begin, begin + slot, 0.5) * size * np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi))
    return from_design(t[0], STEP, p)


def tone(seconds: float, rng: np.random.Generator) -> Motion:
    """One sine on a shaker: 16 Hz, 5 m/s^2."""
    t = grid(seconds)
    w = 2 * np.pi * 16.0
    return from_design(t[0], STEP, window(t, 0.2, seconds - 0.2, 0.5) * 5.0 / w**2 * np.sin(w * t))


def _hand(seconds: float, rng: np.random.Generator, tremor: float) -> Motion:
    step = 2.5e-4 if seconds <= 120 else 1e-3
    t = grid(seconds, step)
    p = band_noise(len(t), step, 0.3, 2.0, rng)
    p *= rng.uniform(1.0, 2.0) / np.std(np.diff(p, 2) / step**2)
    if tremor:
        fast = band_noise(len(t), step, 8.0, 11.0, rng)
        p += tremor * fast / np.std(np.diff(fast, 2) / step**2)
    return from_design(t[0], step, window(t, 0.2, seconds - 0.2, 1.0) * p)


def hand(seconds: float, rng: np.random.Generator) -> Motion:
    """A hand: 0.3 to 2 Hz, 1 to 2 m/s^2 rms."""
    return _hand(seconds, rng, 0.0)


def tremor(seconds: float, rng: np.random.Generator) -> Motion:
    """A hand with physiological tremor of 8 to 11 Hz, 0.08 m/s^2 rms (Elble, Koller 1990)."""
    return _hand(seconds, rng, 0.08)


def creep(seconds: float, rng: np.random.Generator) -> Motion:
    """To and fro below 0.4 Hz, at most 1 mm/s."""
    step = 1e-3
    t = grid(seconds, step)
    noise = band_noise(len(t), step, 0.03, 0.3, rng)
    return from_design(t[0], step, _fastest(window(t, 0.2, seconds - 0.2, 2.0) * noise, step, 1e-3))


def rest(seconds: float, rng: np.random.Generator) -> Motion:
    """Nothing moves."""
    return from_pieces(-MARGIN, np.array([seconds + 2 * MARGIN]), np.zeros(1), np.zeros(1))


PROFILES: dict[str, Callable[[float, np.random.Generator], Motion]] = {
    segment.__name__: segment
    for segment in (
        *(trapezoid, s_curve, cosine, minimum_jerk, smooth, random, one_sided, mixed, chirp),
        *(shaker, tone, hand, tremor, creep, rest),
    )
}
"""Every profile: length of the record in s, generator -> motion."""
