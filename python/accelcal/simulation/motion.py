"""How the carriage moves: position, velocity, acceleration and jerk as exact functions of time.

Every motion is a sum of parts with closed-form derivatives, so nothing is integrated numerically and a simulated
record has no error that its truth does not have. Parts are three times continuously differentiable.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from accelcal._support.errors import AccelcalError
from accelcal._support.values import listing
from accelcal.data import STANDARD_GRAVITY, Array, root_mean_square

Numbers = NDArray[np.inexact]
"""Real or complex."""

STAGE_SPEED = 0.1
"""Largest speed that the paper's encoder follows, m/s (paper II-A)."""
FAST_PEAK = 2.0 * STANDARD_GRAVITY
"""Largest acceleration of the profile "fast", m/s²."""
PAPER_TONES = (2.1, 3.3, 4.7, 6.1)
"""Frequencies of the profile "tones", Hz: no harmonic up to the third meets a base frequency."""
THIRDS = (5.0, 6.3, 8.0, 10.0, 12.5, 16.0, 20.0, 25.0, 31.5, 40.0, 50.0, 63.0, 80.0, 100.0, 125.0, 160.0)
"""Frequencies of the profile "sine_steps", Hz: the standard third octaves; "sweep" goes from the first to the last."""
REST = 20.0
"""Rest at either end of the profile "rests", s."""

MOST_SECONDS = 20_000.0
"""Longest motion, s."""
_GRID = 4000.0
"""Rate at which a motion is searched for its peak speed and its rms acceleration, Hz."""


class Part(Protocol):
    """One term of a motion. Before `start` it is zero, after `stop` it stays at `final`."""

    @property
    def start(self) -> float: ...
    @property
    def stop(self) -> float: ...
    @property
    def final(self) -> float: ...

    def derivatives(self, t: Array) -> Array:
        """Position, velocity, acceleration, jerk at t (n,) s inside [start, stop]; (4, n), SI."""
        ...


class Unlimited:
    """A term of a motion that lasts forever."""

    __slots__ = ()
    start = -math.inf
    stop = math.inf
    final = 0.0


@dataclass(frozen=True, slots=True)
class Tones(Unlimited):
    """A sum of sines: p = sum_i A_i sin(w_i t + phi_i), forever."""

    amplitude: Array
    """(m,) displacement amplitudes A_i, m."""
    frequency: Array
    """(m,) Hz."""
    phase: Array
    """(m,) rad."""

    def derivatives(self, t: Array) -> Array:
        out = np.zeros((4, len(t)))
        for A, f, phi in zip(self.amplitude, self.frequency, self.phase, strict=True):
            w = 2.0 * math.pi * f
            angle = w * t + phi
            p = np.sin(angle)
            p *= A
            v = np.cos(angle, out=angle)
            v *= A * w
            out[0] += p
            out[1] += v
            p *= w**2
            v *= w**2
            out[2] -= p
            out[3] -= v
        return out


def derivatives_of(z: Numbers, g: Numbers, g1: Numbers, g2: Numbers) -> Array:
    """Imaginary parts (4, n) of a complex motion with z' = g z, and of its derivatives: z'' = (g' + g²) z and
    z''' = (g'' + 3 g g' + g³) z; `g1` and `g2` are g' and g''."""
    return np.stack([z.imag, (g * z).imag, ((g1 + g**2) * z).imag, ((g2 + 3.0 * g * g1 + g**3) * z).imag])


@dataclass(frozen=True, slots=True)
class RisingSine(Unlimited):
    """A sine of constant acceleration amplitude whose frequency rises."""

    amplitude: float
    """A, m/s²; the acceleration reaches it up to terms of order w'/w²."""
    low: float
    """f0 at t = 0, Hz."""
    high: float
    """f1 at t = duration, Hz."""
    duration: float
    """s."""


@dataclass(frozen=True, slots=True)
class Chirp(RisingSine):
    """A sine of constant acceleration amplitude whose frequency rises at a steady rate.

    p = -A sin(phi)/w², phi' = w = 2 pi (f0 + (f1 - f0) t/duration).
    """

    def derivatives(self, t: Array) -> Array:
        rate = 2.0 * math.pi * (self.high - self.low) / self.duration
        w = 2.0 * math.pi * self.low + rate * t
        phi = (2.0 * math.pi * self.low + 0.5 * rate * t) * t
        # z = -A exp(i phi)/w² and z' = g z
        z = -self.amplitude * np.exp(1j * phi) / w**2
        g = 1j * w - 2.0 * rate / w
        g1 = 1j * rate + 2.0 * rate**2 / w**2
        g2 = -4.0 * rate**3 / w**3
        return derivatives_of(z, g, g1, g2)


@dataclass(frozen=True, slots=True)
class Sweep(RisingSine):
    """A sine of constant acceleration amplitude whose frequency grows by the same factor in equal times.

    p = -A sin(phi)/w², phi' = w = 2 pi f0 (f1/f0)^(t/duration).
    """

    def derivatives(self, t: Array) -> Array:
        growth = math.log(self.high / self.low) / self.duration
        w = 2.0 * math.pi * self.low * np.exp(growth * t)
        # as in `Chirp`, with w' = growth w
        z = -self.amplitude * np.exp(1j * (w - 2.0 * math.pi * self.low) / growth) / w**2
        g = 1j * w - 2.0 * growth
        g1, g2 = 1j * growth * w, 1j * growth**2 * w
        return derivatives_of(z, g, g1, g2)


@dataclass(frozen=True, slots=True)
class Move:
    """From rest to rest over `distance` in `duration`: the seventh-degree step, smooth through jerk at both ends."""

    start: float
    """s."""
    duration: float
    """s."""
    distance: float
    """m."""

    @property
    def stop(self) -> float:
        return self.start + self.duration

    @property
    def final(self) -> float:
        return self.distance

    def derivatives(self, t: Array) -> Array:
        return self.distance * _step(t, self.start, self.duration)


@dataclass(frozen=True, slots=True)
class Windowed:
    """A part faded in and out: times a window that is 1 in the middle and rises over `ramp` at either end."""

    part: Part
    start: float
    """s."""
    stop: float
    """s."""
    ramp: float
    """s; at most half of stop - start."""

    final = 0.0

    def derivatives(self, t: Array) -> Array:
        window = _step(t, self.start, self.ramp) - _step(t, self.stop - self.ramp, self.ramp)
        return _product(window, self.part.derivatives(t))


@dataclass(frozen=True, slots=True)
class Motion:
    """Position of the carriage as an exact function of time: `gain` times the sum of its parts."""

    parts: tuple[Part, ...]
    seconds: float
    """Length that the motion was planned for, s."""
    gain: float = 1.0
    name: str = ""

    def derivatives(self, t: Array) -> Array:
        """Position, velocity, acceleration, jerk.

        Parameters
        ----------
        t : (n,) s
            Instants in non-decreasing order.

        Returns
        -------
        (4, n) m, m/s, m/s², m/s³
        """
        out = np.zeros((4, len(t)))
        for part in self.parts:
            first, last = np.searchsorted(t, (part.start, part.stop), side="left")
            if last > first:
                out[:, first:last] += part.derivatives(t[first:last])
            if part.final != 0.0:
                out[0, last:] += part.final
        out *= self.gain
        return out

    def position(self, t: Array) -> Array:
        """(n,) m at t (n,) s, non-decreasing."""
        return np.asarray(self.derivatives(t)[0])

    def velocity(self, t: Array) -> Array:
        """(n,) m/s at t (n,) s, non-decreasing."""
        return np.asarray(self.derivatives(t)[1])

    def acceleration(self, t: Array) -> Array:
        """(n,) m/s² at t (n,) s, non-decreasing."""
        return np.asarray(self.derivatives(t)[2])

    def jerk(self, t: Array) -> Array:
        """(n,) m/s³ at t (n,) s, non-decreasing."""
        return np.asarray(self.derivatives(t)[3])

    @property
    def acceleration_rms(self) -> float:
        """Root mean square of the acceleration over the planned length, m/s²."""
        return root_mean_square(self.acceleration(self._grid()))

    @property
    def top_speed(self) -> float:
        """Largest speed over the planned length, m/s."""
        return float(np.max(np.abs(self.velocity(self._grid()))))

    def scaled(self, factor: float) -> Motion:
        """The motion, `factor` times as large."""
        return replace(self, gain=self.gain * factor)

    def _grid(self) -> Array:
        return np.arange(0.0, self.seconds, 1.0 / _GRID)


def motion(
    name: str, seconds: float, rng: np.random.Generator, *, a_rms: float | None = None, v_max: float | None = None
) -> Motion:
    """A motion profile by name.

    Parameters
    ----------
    name : str
        "rest" (nothing moves), "tones" (four steady tones, 2.1 to 6.1 Hz), "chirp" (1 to 20 Hz), "moves" (point to
        point with rests), "bursts" (random, 2 to 15 Hz, faded in and out, with rests), "interleaved" (bursts and moves
        alternate every 3 to 7 s), "rests" (interleaved between two rests of 20 s), "fast" (random, 3 to 12 Hz, up to
        2 g, over a slow traverse), "sine_steps" (one sine after another, third octaves from 5 to 160 Hz), "sweep" (one
        sine from 5 to 160 Hz).
    seconds : float
        Length, s.
    rng : numpy.random.Generator
        Draws frequencies, phases, distances and durations.
    a_rms : float, optional
        Root mean square acceleration over the whole length, m/s²; the motion is scaled to it.
    v_max : float, optional
        Alone: top speed that the motion is scaled to, m/s. With `a_rms`: a limit that must not be exceeded.
        With neither, "tones" has 4 m/s² rms, "fast" peaks at 2 g, and all others stay below 0.1 m/s.

    Raises
    ------
    ValueError
        Unknown name; a length that is too short for the profile, or above `MOST_SECONDS`; a speed limit that `a_rms`
        exceeds.

    Examples
    --------
    >>> stage = motion("tones", 10.0, np.random.default_rng(1), a_rms=2.0)
    >>> round(stage.acceleration_rms, 6)
    2.0
    """
    if name not in PROFILES:
        raise AccelcalError(f"motion {name!r} is not known. Choose one of: {', '.join(PROFILES)}.")
    if not 0.0 < seconds <= MOST_SECONDS:
        raise AccelcalError(
            f"motion {name!r}: the length must be positive and at most {MOST_SECONDS:g} s, not {seconds:g} s."
        )
    planned = replace(PROFILES[name](seconds, rng), name=name)
    if a_rms is not None:
        return _within(_of_rms(planned, a_rms), v_max)
    return planned if v_max is None else _of_top_speed(planned, v_max)


def sine_steps(frequencies: ArrayLike, amplitudes: ArrayLike, durations: ArrayLike, *, rest: float = 0.2) -> Motion:
    """A shaker's run: one sine after another, each faded in and out, with a rest before and behind it.

    Parameters
    ----------
    frequencies : (m,) Hz, above 0.
    amplitudes : (m,) or one, of the acceleration, m/s².
    durations : (m,) or one, of each step, s; a tenth of it at either end is its fading.
    rest : between steps, s.

    Returns
    -------
    The motion; its `seconds` are its length.

    Raises
    ------
    ValueError
        If a number is not positive and finite, or the lengths do not agree.

    Examples
    --------
    >>> sine_steps([5.0, 10.0], 2.0, 4.0, rest=0.5).seconds
    9.5
    """
    f = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    columns = np.broadcast_arrays(f, np.asarray(amplitudes, np.float64), np.asarray(durations, np.float64))
    if not (
        np.isfinite(columns).all() and np.min(columns, initial=math.inf) > 0.0 and 0.0 <= rest < math.inf and len(f)
    ):
        raise AccelcalError("sine_steps: expected frequencies, amplitudes and durations that are positive and finite")
    parts: list[Part] = []
    start = rest
    for frequency, amplitude, duration in zip(*columns, strict=True):
        size = np.array([amplitude / (2.0 * math.pi * frequency) ** 2])
        sine = Tones(size, np.array([frequency]), np.array([-2.0 * math.pi * frequency * start]))
        parts.append(Windowed(sine, start, start + duration, 0.1 * duration))
        start += float(duration) + rest
    return Motion(tuple(parts), start, name="sine_steps")


def _scaled(planned: Motion, now: float, wanted: float) -> Motion:
    if not 0.0 < wanted < math.inf:
        raise AccelcalError(f"motion {planned.name!r} is to be scaled to {wanted:g}; give a positive number.")
    if now == 0.0:
        raise AccelcalError(f"motion {planned.name!r} does not move and cannot be scaled.")
    return planned.scaled(wanted / now)


def _of_rms(planned: Motion, a_rms: float) -> Motion:
    return _scaled(planned, planned.acceleration_rms, a_rms)


def _of_top_speed(planned: Motion, v_max: float = STAGE_SPEED) -> Motion:
    return _scaled(planned, planned.top_speed, v_max)


def _within(planned: Motion, v_max: float | None) -> Motion:
    if v_max is not None and planned.top_speed > v_max:
        raise AccelcalError(
            f"motion {planned.name!r}: {planned.acceleration_rms:.3g} m/s² rms needs {planned.top_speed:.3g} m/s, "
            f"above the limit of {v_max:.3g} m/s. Lower a_rms or choose a profile of higher frequency."
        )
    return planned


def _sine_steps(seconds: float, rng: np.random.Generator) -> Motion:
    if seconds < 20.0:
        raise AccelcalError(f"motion 'sine_steps' needs 20 s or more for its 16 steps: {seconds:g} s is too short.")
    rest = 0.05 * seconds / (len(THIRDS) + 1)
    planned = sine_steps(THIRDS, 1.0, 0.95 * seconds / len(THIRDS), rest=rest)
    return replace(_of_top_speed(planned), seconds=seconds)


def _sweep(seconds: float, rng: np.random.Generator) -> Motion:
    sweep = Sweep(1.0, THIRDS[0], THIRDS[-1], seconds)
    return _of_top_speed(Motion((Windowed(sweep, 0.0, seconds, min(1.0, 0.1 * seconds)),), seconds))


def _moves(seconds: float, rng: np.random.Generator) -> Motion:
    if seconds < 3.0:
        raise AccelcalError(f"motion 'moves' needs 3 s or more for a move there and back: {seconds:g} s is too short.")
    return Motion(tuple(_point_to_point(0.0, seconds, rng)), seconds)


def _rests(seconds: float, rng: np.random.Generator) -> Motion:
    if seconds < 2.0 * REST + 5.0:
        raise AccelcalError(
            f"motion 'rests' begins and ends with {REST:g} s at rest: {seconds:g} s is too short, take 45 s or more."
        )
    return Motion(tuple(_alternate(REST, seconds - REST, rng)), seconds)


def _fast(seconds: float, rng: np.random.Generator) -> Motion:
    tones = _equal_acceleration(rng.uniform(3.0, 12.0, 12), rng)
    shake = Motion((Windowed(tones, 0.0, seconds, min(1.0, seconds / 2.0)),), seconds)
    shake = shake.scaled(FAST_PEAK / float(np.max(np.abs(shake.acceleration(shake._grid())))))
    traverse = (Move(0.0, seconds / 2.0, 0.3 / shake.gain), Move(seconds / 2.0, seconds / 2.0, -0.3 / shake.gain))
    return replace(shake, parts=(*shake.parts, *traverse))


PROFILES: dict[str, Callable[[float, np.random.Generator], Motion]] = {
    "rest": lambda seconds, rng: Motion((), seconds),
    "tones": lambda seconds, rng: _of_rms(Motion((_equal_acceleration(np.array(PAPER_TONES), rng),), seconds), 4.0),
    "chirp": lambda seconds, rng: _of_top_speed(Motion((Chirp(1.0, 1.0, 20.0, seconds),), seconds)),
    "moves": _moves,
    "bursts": lambda seconds, rng: Motion(
        tuple(_random_burst(t, stop, rng) for t, stop in _slots(0.0, seconds, rng)), seconds
    ),
    "interleaved": lambda seconds, rng: Motion(tuple(_alternate(0.0, seconds, rng)), seconds),
    "rests": _rests,
    "fast": _fast,
    "sine_steps": _sine_steps,
    "sweep": _sweep,
}
"""Motion profiles by name; each takes the length in s and a generator."""


def _slots(start: float, stop: float, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Divides start..stop into slots of 3 to 7 s; a shorter stretch is one slot."""
    edges = [start]
    while stop - edges[-1] > 7.0:
        edges.append(edges[-1] + rng.uniform(3.0, min(7.0, stop - edges[-1] - 3.0)))
    return list(pairwise([*edges, stop]))


def _alternate(start: float, stop: float, rng: np.random.Generator) -> list[Part]:
    """Bursts and groups of point-to-point moves in turn."""
    parts: list[Part] = []
    for i, (begin, end) in enumerate(_slots(start, stop, rng)):
        parts += _point_to_point(begin, end, rng) if i % 2 else [_random_burst(begin, end, rng)]
    return parts


def _random_burst(start: float, stop: float, rng: np.random.Generator) -> Windowed:
    """Random motion between 2 and 15 Hz, top speed 0.1 m/s, faded in and out, with up to 0.5 s of rest after it."""
    stop -= min(0.5, 0.2 * (stop - start)) * rng.uniform(0.4, 1.0)
    ramp = min(0.4, 0.4 * (stop - start))
    tones = _equal_acceleration(rng.uniform(2.0, 15.0, 8), rng)
    burst = Windowed(tones, start, stop, ramp)
    peak = np.max(np.abs(burst.derivatives(np.arange(start, stop, 1.0 / _GRID))[1]))
    return replace(burst, part=replace(tones, amplitude=tones.amplitude * (STAGE_SPEED / peak)))


def _point_to_point(start: float, stop: float, rng: np.random.Generator) -> list[Part]:
    """Moves there and back, 0.15 to 0.6 s each, top speed 0.04 to 0.1 m/s, with rests of 0.1 to 0.5 s."""
    parts: list[Part] = []
    t, side = start, 1.0
    while True:
        duration = rng.uniform(0.15, 0.6)
        if t + 2.0 * duration + 1.0 > stop:
            return parts
        distance = rng.uniform(0.04, STAGE_SPEED) * duration / STEP_TOP_SPEED
        for sign in (side, -side):  # in pairs, so that the carriage stays on its rail
            parts.append(Move(t, duration, sign * distance))
            t += duration + rng.uniform(0.1, 0.5)
        side = -side


def _equal_acceleration(frequency: Array, rng: np.random.Generator) -> Tones:
    """Tones of equal acceleration amplitude 1 m/s² and random phase."""
    phase = rng.uniform(0.0, 2.0 * math.pi, len(frequency))
    return Tones(1.0 / (2.0 * math.pi * frequency) ** 2, frequency, phase)


_STEP = np.array([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])
"""Coefficients of s(x) = 35 x⁴ - 84 x⁵ + 70 x⁶ - 20 x⁷: s(0) = 0, s(1) = 1, three derivatives vanish at both ends."""
STEP_TOP_SPEED = 35.0 / 16.0
"""s'(1/2), the largest slope of s."""


def _step(t: Array, start: float, duration: float) -> Array:
    """The smooth step from 0 to 1 and its three derivatives in time; (4, n)."""
    x = np.clip((t - start) / duration, 0.0, 1.0)
    rows = [np.polynomial.polynomial.polyval(x, np.polynomial.polynomial.polyder(_STEP, m)) for m in range(4)]
    return np.stack(rows) / duration ** np.arange(4.0)[:, None]


def _product(f: Array, g: Array) -> Array:
    """Derivatives of f g from those of f and g (Leibniz); all (4, n)."""
    return np.stack([sum(math.comb(n, m) * f[m] * g[n - m] for m in range(n + 1)) for n in range(4)])


__dir__ = listing(globals())
