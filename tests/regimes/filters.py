"""Declared filters of a rig with responses of their own: poles in closed form, digital ones as recursions.

Written from the definitions, without SciPy's designs: Butterworth poles on a circle, Bessel poles as roots of the
reverse Bessel polynomial scaled to -3 dB.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter, lfilter_zi

from tests.worlds.numerics import Array

from .motion import Motion, Piecewise, Response, rc, residues


@dataclass(frozen=True, slots=True)
class Declared:
    """One filter: what the sidecar says of it, and what it does."""

    text: str
    """Inline table of the sidecar."""
    poles: tuple[complex, ...] = ()
    """Of an analog filter, 1/s."""
    b: tuple[float, ...] = ()
    """Numerator of a digital filter at the rate of the channel."""
    a: tuple[float, ...] = (1.0,)
    high: bool = False
    """Whether it is the high-pass s/(s - pole)."""


def text(kind: str, **keys: object) -> str:
    """Return an inline table of the sidecar."""
    entries = [f'kind = "{kind}"', *(f"{key} = {value}" for key, value in keys.items())]
    return "{ " + ", ".join(entries) + " }"


def single_pole(corner: float) -> Declared:
    """Return an RC low-pass, corner in Hz."""
    return Declared(text("RC", fc=f'"{corner:g} Hz"'), tuple(rc(corner)))


def butterworth(corner: float, order: int) -> Declared:
    """Return a Butterworth low-pass: poles evenly on the left half of a circle of radius 2 pi fc."""
    angles = math.pi * (2 * np.arange(order) + order + 1) / (2 * order)
    poles = 2 * math.pi * corner * np.exp(1j * angles)
    return Declared(text("butterworth", fc=f'"{corner:g} Hz"', order=order), tuple(poles.tolist()))


def bessel(corner: float, order: int) -> Declared:
    """Return a Bessel low-pass whose gain is -3 dB at the corner, Hz: roots of sum (2n-k)!/(2^(n-k) k! (n-k)!) s^k."""
    n = order
    powers = [
        math.factorial(2 * n - k) / (2 ** (n - k) * math.factorial(k) * math.factorial(n - k)) for k in range(n, -1, -1)
    ]
    low, high = 0.1, 10.0
    for _ in range(80):
        middle = math.sqrt(low * high)
        falls = abs(powers[-1] / np.polyval(powers, 1j * middle)) > math.sqrt(0.5)
        low, high = (middle, high) if falls else (low, middle)
    poles = np.roots(powers) * 2 * math.pi * corner / low
    return Declared(text("bessel", fc=f'"{corner:g} Hz"', order=order), tuple(poles.tolist()))


def recursion(b: Sequence[float], a: Sequence[float]) -> Declared:
    """Return a biquad at the rate of the channel."""
    return Declared(text("biquad", b=list(b), a=list(a)), b=tuple(b), a=tuple(a))


def averages(length: int, order: int) -> Declared:
    """Return `order` running means over `length` samples, one after the other."""
    taps = np.ones(1)
    for _ in range(order):
        taps = np.convolve(taps, np.full(length, 1.0 / length))
    return Declared(text("sinc", length=length, order=order), b=tuple(taps.tolist()))


def windowed(count: int, share: float) -> Declared:
    """Return a low-pass of `count` taps: a sinc cut off at a share of the rate, behind a Hamming window."""
    k = np.arange(count) - (count - 1) / 2
    taps = 2 * share * np.sinc(2 * share * k) * (0.54 + 0.46 * np.cos(2 * math.pi * k / (count - 1)))
    taps = [float(f"{x:.12g}") for x in taps / np.sum(taps)]
    return Declared(text("fir", taps=taps), b=tuple(taps))


def blocking(tau: float) -> Declared:
    """Return an RC high-pass of a time constant, s."""
    return Declared(text("RC", tau=f'"{tau:g} s"'), (complex(-1 / tau),), high=True)


def keys(filters: Sequence[Declared]) -> list[str]:
    """Return the entries of the sidecar for the filters of one channel."""
    results = []
    for key, high in (("lowpass", False), ("highpass", True)):
        tables = [f.text for f in filters if f.high == high]
        if tables:
            results.append(f"{key} = {tables[0] if len(tables) == 1 else '[' + ', '.join(tables) + ']'}")
    return results


def analog(filters: Sequence[Declared]) -> list[complex]:
    """Return the poles of the analog low-passes."""
    return [pole for f in filters if not f.high for pole in f.poles]


def behind(signal: Piecewise, filters: Sequence[Declared], poles: Sequence[complex]) -> Response:
    """Return a signal behind poles and the high-passes of a chain, exactly: s/(s - p) = 1 - (-p)/(s - p)."""
    low = signal.behind(poles)
    high = [f.poles[0] for f in filters if f.high]
    if len(high) > 1:
        raise ValueError("one high-pass at most")
    if not high:
        return low
    removed = signal.behind([*poles, high[0]])
    return lambda t: np.asarray(low(t) - removed(t))


def sampled(y: Array, filters: Sequence[Declared]) -> Array:
    """Return samples behind the digital filters of a chain, settled at the first sample."""
    for f in filters:
        if f.b:
            b, a = np.trim_zeros(np.asarray(f.b), "b"), np.asarray(f.a)
            if len(b) > 1 or len(a) > 1:
                y, _ = lfilter(b, a, y, zi=lfilter_zi(b, a) * y[0])
    return np.asarray(y)


def without_constant(y: Array, rate: float, filters: Sequence[Declared]) -> Array:
    """Return noise behind the high-passes of a chain; sampled much faster than they are."""
    for f in filters:
        if f.high:
            keep = math.exp(np.real(f.poles[0]) / rate)
            y = y - lfilter([1 - keep], [1.0, -keep], y)
    return np.asarray(y)


def position(motion: Motion, t: Array, filters: Sequence[Declared]) -> Array:
    """Return the position behind analog low-passes and one high-pass, exactly."""
    poles, high = analog(filters), [f.poles[0] for f in filters if f.high]
    passed = _low_passed(motion, t, poles)
    return passed - _low_passed(motion, t, [*poles, *high]) if high else passed


def _low_passed(motion: Motion, t: Array, poles: Sequence[complex]) -> Array:
    """Position behind poles: 1/(s - p) = -1/p - s/p^2 + (s^2/p^2)/(s - p)."""
    if not poles:
        return motion.position(t)
    r, p = residues(poles), np.asarray(poles)
    lag = float(np.real(np.sum(-r / p**2)))
    i, s = motion.a.place(t)
    modes = [motion.a._mode(pole, residue / pole**2) for pole, residue in zip(poles, r, strict=True)]
    return np.asarray(motion.position(t) + lag * motion.velocity(t) + sum(mode(i, s) for mode in modes))
