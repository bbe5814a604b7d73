"""Exact motion: acceleration is linear between knots and may jump at them; the rest is its exact integrals.

Signals behind poles are exact too: within a piece the response to a + j s is a polynomial and an exponential.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tests.worlds.numerics import Array

Response = Callable[[Array], Array]
"""A signal at arbitrary instants, s."""


@dataclass(frozen=True, slots=True, eq=False)
class Piecewise:
    """A signal that is linear between knots."""

    knots: Array
    """(n + 1,) s, rising."""
    first: Array
    """(n,) value at the beginning of each piece."""
    slope: Array
    """(n,) per second."""

    @property
    def lengths(self) -> Array:
        """(n,) s"""
        return np.diff(self.knots)

    @property
    def last(self) -> Array:
        """(n,) value at the end of each piece."""
        return self.first + self.slope * self.lengths

    def at(self, t: Array) -> Array:
        """Return the signal at instants inside the knots; at a jump, the value after it."""
        i, s = self.place(t)
        return np.asarray(self.first[i] + self.slope[i] * s)

    def place(self, t: Array) -> tuple[NDArray[np.int64], Array]:
        """Return the piece of each instant, and the time since that piece began."""
        t = np.asarray(t, dtype=float)
        if t.size and (t.min() < self.knots[0] or t.max() > self.knots[-1]):
            raise ValueError(f"asked for {t.min():g} to {t.max():g} s, known {self.knots[0]:g} to {self.knots[-1]:g} s")
        i = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.first) - 1)
        return i, t - self.knots[i]

    def refined(self, step: float) -> Piecewise:
        """Return the same signal on pieces of at most `step`."""
        parts = np.maximum(np.ceil(self.lengths / step * (1 - 1e-9)).astype(np.int64), 1)
        i = np.repeat(np.arange(len(parts)), parts)
        within = np.arange(len(i)) - np.repeat(np.cumsum(parts) - parts, parts)
        s = within * (self.lengths / parts)[i]
        knots = np.append(self.knots[i] + s, self.knots[-1])
        return Piecewise(knots, self.first[i] + self.slope[i] * s, self.slope[i])

    def scaled(self, factor: float) -> Piecewise:
        """Return `factor` times the signal."""
        return Piecewise(self.knots, factor * self.first, factor * self.slope)

    def behind(self, poles: Sequence[complex]) -> Response:
        """Return the signal behind prod(-p)/prod(s - p), settled at the first knot; poles differ, and pair up.

        Partial fractions: the sum over poles of r x with x' = p x + u, each solved exactly piece by piece.
        """
        if not poles:
            return self.at
        modes = [self._mode(pole, residue) for pole, residue in zip(poles, residues(poles), strict=True)]

        def response(t: Array) -> Array:
            i, s = self.place(t)
            return np.asarray(sum(mode(i, s) for mode in modes))

        return response

    def _mode(self, pole: complex, residue: complex) -> Callable[[NDArray[np.int64], Array], Array]:
        """Within a piece x(s) = c + d s + (x(0) - c) exp(p s), with d = -j/p and c = (d - a)/p."""
        d = -self.slope / pole
        c = (d - self.first) / pole
        decay = np.exp(pole * self.lengths)
        drive = c + d * self.lengths - c * decay
        start = recursion(decay, drive, -self.first[0] / pole)

        def at(i: NDArray[np.int64], s: Array) -> Array:
            return np.real(residue * (c[i] + d[i] * s + (start[i] - c[i]) * np.exp(pole * s)))

        return at


def recursion(decay: NDArray[np.complex128], drive: NDArray[np.complex128], begin: complex) -> NDArray[np.complex128]:
    """Return x (n,) with x[0] = begin and x[k + 1] = decay[k] x[k] + drive[k]."""
    if np.ptp(np.abs(decay)) < 1e-9 * np.abs(decay[0]):  # pieces of one length, up to the rounding of knots
        tail = lfilter([1.0], [1.0, -decay[0]], np.concatenate(([begin], drive[:-1])))
        return np.asarray(tail, dtype=complex)
    result = np.empty(len(drive), dtype=complex)
    x = complex(begin)
    factors, steps = decay.tolist(), drive.tolist()
    for k in range(len(steps)):
        result[k] = x
        x = factors[k] * x + steps[k]
    return result


def residues(poles: Sequence[complex]) -> NDArray[np.complex128]:
    """Return r of prod(-p)/prod(s - p) = sum r/(s - p)."""
    p = np.asarray(poles, dtype=complex)
    apart = p[:, None] - p[None, :] + np.eye(len(p))
    if len(p) > 1 and np.min(np.abs(apart[~np.eye(len(p), dtype=bool)])) < 1e-6 * np.max(np.abs(p)):
        raise ValueError(f"poles must differ, found {poles}")
    return np.asarray(np.prod(-p) / np.prod(apart, axis=1))


def rc(corner: float) -> list[complex]:
    """Return the pole of an RC low-pass, corner in Hz."""
    return [complex(-2 * np.pi * corner)]


def resonance(f0: float, quality: float) -> list[complex]:
    """Return the two poles of y'' = w0^2 (u - y) - (w0/Q) y', Q > 1/2; Q = 0.707 is a Butterworth low-pass."""
    w0 = 2 * np.pi * f0
    pole = w0 * (-1 / (2 * quality) + 1j * np.sqrt(1 - 1 / (4 * quality**2)))
    return [pole, pole.conjugate()]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A true motion, at rest at zero before its first knot."""

    a: Piecewise
    """m/s^2"""
    v0: Array
    """(n,) m/s at the beginning of each piece."""
    p0: Array
    """(n,) m at the beginning of each piece."""

    @staticmethod
    def of(a: Piecewise) -> Motion:
        """Integrate an acceleration twice from rest."""
        h = a.lengths
        speeds = np.concatenate(([0.0], np.cumsum(a.first * h + a.slope * h**2 / 2)))[:-1]
        steps = speeds * h + a.first * h**2 / 2 + a.slope * h**3 / 6
        return Motion(a, speeds, np.concatenate(([0.0], np.cumsum(steps)))[:-1])

    def refined(self, step: float) -> Motion:
        """Return the same motion on pieces of at most `step`."""
        return Motion.of(self.a.refined(step))

    def velocity(self, t: Array) -> Array:
        """m/s"""
        i, s = self.a.place(t)
        return np.asarray(self.v0[i] + s * (self.a.first[i] + s * self.a.slope[i] / 2))

    def position(self, t: Array) -> Array:
        """m"""
        i, s = self.a.place(t)
        return np.asarray(self.p0[i] + s * (self.v0[i] + s * (self.a.first[i] / 2 + s * self.a.slope[i] / 6)))

    def lagged_position(self, t: Array, tau: float) -> Array:
        """Return the position behind a first-order lag, m: p - tau v + tau^2 (a behind the lag), from rest."""
        behind = self.a.behind([complex(-1 / tau)])
        return np.asarray(self.position(t) - tau * self.velocity(t) + tau**2 * behind(t))

    def largest(self) -> float:
        """Largest acceleration, m/s^2."""
        return float(max(np.max(np.abs(self.a.first)), np.max(np.abs(self.a.last))))


def from_pieces(begin: float, lengths: Array, first: Array, last: Array) -> Motion:
    """Return the motion whose acceleration runs linearly from `first` to `last` in each piece."""
    keep = lengths > 0
    lengths, first, last = lengths[keep], first[keep], last[keep]
    knots = begin + np.concatenate(([0.0], np.cumsum(lengths)))
    return Motion.of(Piecewise(knots, first, (last - first) / np.diff(knots)))


def from_samples(begin: float, step: float, a: Array) -> Motion:
    """Return the motion whose acceleration is linear between samples (n + 1,) of one step."""
    knots = begin + step * np.arange(float(len(a)))
    return Motion.of(Piecewise(knots, a[:-1].copy(), np.diff(a) / np.diff(knots)))


def from_design(begin: float, step: float, p: Array) -> Motion:
    """Return the motion that follows design positions (n,) of one step, which begin and end with two equal values.

    The acceleration at a sample is the second difference, so that the true position there is
    (p[k-1] + 4 p[k] + p[k+1])/6: a cubic spline, and bounded as the design is.
    """
    a = np.zeros_like(p)
    a[1:-1] = np.diff(p, 2) / step**2
    return from_samples(begin, step, a)


def through_structure(set_point: Motion, f0: float, quality: float, step: float) -> Motion:
    """Return the motion of a stage behind a structure: its acceleration at every `step` is that of the resonance."""
    begin, end = set_point.a.knots[[0, -1]]
    t = begin + step * np.arange(float(int((end - begin) / step)))
    return from_samples(float(begin), step, set_point.a.behind(resonance(f0, quality))(t))
