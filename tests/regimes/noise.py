"""Noise and faults of channels: white noise behind poles, 1/f, heavy tails, stamps, holes, held values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

from tests.worlds.numerics import Array


def ornstein_uhlenbeck(t: Array, deviation: float, tau: float, shocks: Array) -> Array:
    """Return a stationary Gauss-Markov process at instants t (n,), exact for any spacing; `shocks` are unit and white.

    Correlation exp(-dt/tau) between instants (Papoulis 1991, section 10.2).
    """
    dt = np.diff(t)
    keep = np.exp(-np.maximum(dt, 0.0) / tau)
    drive = deviation * shocks * np.sqrt(1 - np.concatenate(([0.0], keep)) ** 2)
    if len(dt) and np.ptp(dt) < 1e-9:
        return np.asarray(lfilter([1.0], [1.0, -keep[0]], drive))
    result, x, factors = np.empty(len(t)), 0.0, [0.0, *keep.tolist()]
    for k, (factor, step) in enumerate(zip(factors, drive.tolist(), strict=True)):
        x = factor * x + step
        result[k] = x
    return result


def behind_poles(n: int, dt: float, density: float, poles: Sequence[complex], rng: np.random.Generator) -> Array:
    """Return white noise of a one-sided density behind prod(-p)/prod(s - p), exactly, at n instants of one spacing.

    The cascade in controllable form: x' = A x + B w; the covariance of a step is van Loan's integral (1978).
    """
    coefficients = np.real(np.poly(np.asarray(poles)))
    m = len(poles)
    A = np.vstack((np.eye(m)[1:], -coefficients[:0:-1]))
    B = np.zeros((m, 1))
    B[-1] = coefficients[-1]
    scale = np.diag(np.abs(poles[0]) ** -np.arange(float(m)))
    A, B = scale @ A @ np.linalg.inv(scale), scale @ B  # states of one size
    power = density**2 / 2
    block = expm(np.block([[-A, power * B @ B.T], [np.zeros((m, m)), A.T]]) * dt)
    F = block[m:, m:].T
    Q = F @ block[:m, m:]
    root = np.linalg.cholesky((Q + Q.T) / 2 + 1e-18 * np.trace(Q) * np.eye(m))
    shocks = rng.standard_normal((n, m)) @ root.T
    x, result = np.zeros(m), np.empty(n)
    settle = int(np.ceil(20 / np.min(np.abs(np.real(poles))) / dt))
    for _ in range(min(settle, 10_000)):
        x = F @ x + root @ rng.standard_normal(m)
    for k in range(n):
        x = F @ x + shocks[k]
        result[k] = x[0]
    return result


def student(n: int, freedom: float, rng: np.random.Generator) -> Array:
    """Return Student-t noise (n,) of unit variance."""
    return np.asarray(rng.standard_t(freedom, n) * np.sqrt((freedom - 2) / freedom))


def flicker(n: int, dt: float, instability: float, rng: np.random.Generator) -> Array:
    """Return 1/f noise (n,) whose Allan deviation is flat at `instability`, as data sheets quote it.

    One-sided density instability^2/(2 ln 2 f), from 1/(8 n dt) up (IEEE Std 952-1997, annex C: 0.664 B is the floor).
    """
    m = 8 * n
    f = np.fft.rfftfreq(m, dt)
    density = np.zeros_like(f)
    density[1:] = instability**2 / (2 * np.log(2) * f[1:])
    amplitudes = np.sqrt(density * m / (4 * dt)) * (rng.standard_normal((2, len(f))).T @ np.array([1.0, 1j]))
    return np.asarray(np.fft.irfft(amplitudes, m)[:n])


def power_law(n: int, dt: float, exponent: float, deviation: float, rng: np.random.Generator) -> Array:
    """Return noise (n,) of density f^-exponent, from 1/(8 n dt) up, with the standard deviation over n samples given.

    Between 0 (white) and 2 (random walk); its mean is removed (Kasdin 1995, Proc. IEEE 83, 802).
    """
    m = 8 * n
    f = np.fft.rfftfreq(m, dt)
    shape = np.zeros_like(f)
    shape[1:] = f[1:] ** (-exponent / 2.0)
    y = np.fft.irfft(shape * (rng.standard_normal((2, len(f))).T @ np.array([1.0, 1j])), m)[:n]
    y -= np.mean(y)
    return np.asarray(deviation * y / np.std(y))


def coupled(y: Array, dt: float, corner: float) -> Array:
    """Return samples behind an AC coupling: one real pole, corner in Hz, settled at the first sample."""
    keep = np.exp(-2.0 * np.pi * corner * dt)
    return np.asarray(lfilter([1.0, -1.0], [1.0, -keep], y - y[0])) * (1.0 + keep) / 2.0


def stamps(rate: float, seconds: float, rng: np.random.Generator) -> Array:
    """Return the stamps of a free-running clock that starts at an arbitrary phase."""
    begin = rng.uniform(0, 1 / rate)
    return begin + np.arange(float(int((seconds - begin) * rate))) / rate


def holes(n: int, share: float, length: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which of n samples are missing: `share` of them, one by one, or in blocks of `length` on average."""
    if share <= 0.0:
        return np.zeros(n, dtype=bool)
    if length <= 1:
        return np.asarray(rng.random(n) < share)
    lost = np.zeros(n, dtype=bool)
    while np.mean(lost) < share:
        begin = int(rng.integers(n))
        lost[begin : begin + int(rng.integers(length // 2, length * 3 // 2 + 1))] = True
    return lost


def held(t: Array, rate: float, rng: np.random.Generator) -> Array:
    """Return the instants of the values that a logger writes at t, when the sensor renews its value at `rate` only."""
    phase = rng.uniform(0, 1 / rate)
    return np.asarray(np.floor((t - phase) * rate) / rate + phase)
