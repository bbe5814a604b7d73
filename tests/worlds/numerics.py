"""Numerical tools on a uniform fine grid: interpolation, first- and second-order lags, the play operator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]

STEP = 1e-4
"""Step of the fine grid, s: 10 kHz."""


def stream(seed: int, *key: int) -> np.random.Generator:
    """Return an independent generator for one purpose: the child `key` that SeedSequence(seed).spawn would give."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def interpolate(start: float, values: Array, at: Array) -> Array:
    """Read a fine-grid signal (n,) that begins at `start` at the instants `at`: cubic Lagrange, error O(step⁴)."""
    place = (at - start) / STEP
    i = np.clip(np.floor(place).astype(np.int64), 1, len(values) - 3)
    s = place - i
    before, here, after, beyond = (values[i + k] for k in (-1, 0, 1, 2))
    return (
        -s * (s - 1) * (s - 2) / 6 * before
        + (s + 1) * (s - 1) * (s - 2) / 2 * here
        - (s + 1) * s * (s - 2) / 2 * after
        + (s + 1) * s * (s - 1) / 6 * beyond
    )


def _moments(rate: complex) -> NDArray[np.complex128]:
    """Return ∫₀¹ exp(−rate (1 − s)) sᵐ ds for m = 0..3, by 16-point Gauss-Legendre quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    s = (nodes + 1) / 2
    return np.array([np.sum(weights / 2 * np.exp(-rate * (1 - s)) * s**m) for m in range(4)])


_LAGRANGE = np.linalg.inv(np.vander([-1.0, 0.0, 1.0, 2.0], 4, increasing=True))
"""Row m, column j: coefficient of sᵐ in the cubic that is one at node j − 1 and zero at the three others."""


def _driven_pole(pole: complex, u: Array) -> NDArray[np.complex128]:
    """Solve x' = pole x + u from x = −u/pole at the first sample; the input is the cubic through four samples."""
    taps = STEP * (_moments(-pole * STEP) @ _LAGRANGE)
    padded = np.concatenate((u[:1], u, u[-1:], u[-1:]))
    n = len(u)
    drive = sum(taps[j] * padded[j : j + n] for j in range(4))
    decay = np.exp(pole * STEP)
    shifted = np.concatenate(([-u[0] / pole], drive[:-1]))
    return np.asarray(lfilter([1.0], [1.0, -decay], shifted))


def lag(u: Array, tau: float) -> Array:
    """Return the first-order lag tau x' = u − x of `u` (n,), settled at the first sample."""
    return np.real(_driven_pole(-1 / tau, u / tau))


def resonate(u: Array, f0: float, quality: float) -> Array:
    """Return y'' = w0² (u − y) − (w0/Q) y', settled at the first sample, for Q > 1/2.

    The two conjugate poles are separated, so each is a first-order equation that is solved exactly.
    """
    w0 = 2 * np.pi * f0
    pole = w0 * (-1 / (2 * quality) + 1j * np.sqrt(1 - 1 / (4 * quality**2)))
    return np.real(_driven_pole(pole, u) * (w0**2 / pole.imag) * -1j)


def play(u: Array, half_width: float) -> Array:
    """Return the play operator of `u` (n,): what a loose link of half width r hands on, with memory.

    On a rising stretch w = max(w, u − r), on a falling one w = min(w, u + r) (Brokate, Sprekels 1996, ch. 2), so that
    only turning points need a loop. Movements below 1e-9 do not count as turning.
    """
    grid = np.round(u, 9)
    direction = np.sign(np.diff(grid))
    moving = np.flatnonzero(direction)
    if len(moving) == 0:
        return np.full_like(u, u[0])
    turns = moving[1:][direction[moving[1:]] != direction[moving[:-1]]]
    bounds = np.concatenate(([0], turns, [len(u) - 1]))
    rising = np.concatenate(([direction[moving[0]]], direction[turns])) > 0
    held = np.empty(len(rising))
    w = float(u[0])
    ends = u[bounds[1:]]
    for k, (up, end) in enumerate(zip(rising.tolist(), ends.tolist(), strict=True)):
        held[k] = w
        w = max(w, end - half_width) if up else min(w, end + half_width)
    lengths = np.diff(bounds)
    lengths[-1] += 1
    entry, up_all = np.repeat(held, lengths), np.repeat(rising, lengths)
    return np.where(up_all, np.maximum(entry, u - half_width), np.minimum(entry, u + half_width))


def double_integral(values: Array) -> Array:
    """Integrate fine-grid columns (n,) or (n, m) twice from rest; cubic through four samples, error O(step⁴)."""
    return _integral(_integral(values))


def _integral(y: Array) -> Array:
    middle = (-y[:-3] + 13 * y[1:-2] + 13 * y[2:-1] - y[3:]) * (STEP / 24)
    first, last = (y[0] + y[1]) * (STEP / 2), (y[-2] + y[-1]) * (STEP / 2)
    steps = np.concatenate((np.zeros_like(y[:1]), first[None], middle, last[None]))
    return np.cumsum(steps, axis=0)
