"""A shaker with a laser on it: sine steps, exactly, and a sensor of second order with a delay, exactly.

The displacement of a step is a sine under a window with cosine ramps. Each phase of it (rise, plateau, fall, rest) is a
sum of complex exponentials, so that the sensor answers each with its gain at that frequency plus a free decay, which
keeps value and slope continuous from phase to phase. Nothing is integrated numerically.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

PUBLISHED = ((4.0, 1.001, -20.4), (10.0, 0.977, -51.6), (20.0, 0.897, -106.0), (40.0, 0.377, -218.0))
"""Response of an MPU-9250: Hz, magnitude, phase in degrees."""


@dataclass(frozen=True)
class SecondOrder:
    """k w0²/(s² + w0 s/Q + w0²) exp(-s delay)."""

    k: float
    f0: float
    Q: float
    delay: float

    def response(self, f: Array) -> Spectrum:
        """Complex gain (n,) at frequencies (n,) Hz; a lag is negative."""
        s = 2j * np.pi * np.asarray(f)
        return np.asarray(self.undelayed(s) * np.exp(-s * self.delay))

    def undelayed(self, s: Spectrum) -> Spectrum:
        """Gain at complex frequencies (n,) rad/s, without the delay."""
        w0 = 2 * np.pi * self.f0
        return np.asarray(self.k * w0**2 / (s**2 + s * w0 / self.Q + w0**2))

    @property
    def poles(self) -> Spectrum:
        """(2,) rad/s"""
        w0 = 2 * np.pi * self.f0
        return np.roots([1.0, w0 / self.Q, w0**2]).astype(np.complex128)


@dataclass(frozen=True)
class Step:
    """One sine: amplitude in m/s², frequency in Hz, seconds of it, a tenth of them for either ramp."""

    frequency: float
    amplitude: float
    seconds: float


def waves(step: Step) -> tuple[Spectrum, list[Spectrum], list[float]]:
    """Exponents (3,) rad/s, displacement coefficients (3,) m of rise, plateau and fall, and where each phase begins, s.

    Time counts from the begin of the step; the displacement is the real part of the sum.
    """
    w, ramp = 2 * np.pi * step.frequency, 0.1 * step.seconds
    omega = np.pi / ramp
    size = -step.amplitude / w**2 / 1j  # Re(size exp(iwt)) = -amplitude/w² sin(wt)
    exponents = 1j * np.array([w, w + omega, w - omega])
    phase = np.exp(-1j * omega * (step.seconds - ramp))
    rise = size * np.array([0.5, -0.25, -0.25])
    fall = size * np.array([0.5, 0.25 * phase, 0.25 / phase])
    return exponents, [rise, size * np.array([1.0, 0.0, 0.0]), fall], [0.0, ramp, step.seconds - ramp]


def run(steps: Sequence[Step], sensor: SecondOrder, t: Array, tz: Array, rest: float) -> tuple[Array, Array]:
    """Output (n,) m/s² at t and displacement (m,) m at tz; both in rising order, s."""
    output, displacement = np.zeros(len(t)), np.zeros(len(tz))
    poles, state, since = sensor.poles, np.zeros(2), 0.0
    inverse = np.linalg.inv(np.array([[1, 1], poles]))

    def free(at: Array, begin: float, start: Array) -> Spectrum:
        """Free motion from value and slope `start` at `begin`."""
        return np.exp(np.outer(at - begin, poles)) @ (inverse @ start)

    def advance(begin: float, end: float, exponents: Spectrum, coefficients: Spectrum, origin: float) -> None:
        nonlocal state
        driven = coefficients * exponents**2 * sensor.undelayed(exponents)
        turns = driven * np.exp(exponents * (begin - origin))
        start = state - np.array([np.sum(turns).real, np.sum(turns * exponents).real])
        i, j = np.searchsorted(t - sensor.delay, (begin, end))
        at = t[i:j] - sensor.delay
        output[i:j] = (np.exp(np.outer(at - origin, exponents)) @ driven).real + free(at, begin, start).real
        turns = driven * np.exp(exponents * (end - origin))
        decay = (inverse @ start) * np.exp(poles * (end - begin))
        state = np.array([np.sum(turns) + np.sum(decay), np.sum(turns * exponents) + np.sum(decay * poles)]).real
        i, j = np.searchsorted(tz, (begin, end))
        displacement[i:j] = (np.exp(np.outer(tz[i:j] - origin, exponents)) @ coefficients).real

    none = np.zeros(3, dtype=np.complex128)
    for step in steps:
        exponents, phases, begins = waves(step)
        origin = since + rest
        advance(since, origin, exponents, none, origin)
        ends = [*begins[1:], step.seconds]
        for coefficients, begin, end in zip(phases, begins, ends, strict=True):
            advance(origin + begin, origin + end, exponents, coefficients, origin)
        since = origin + step.seconds
    advance(since, since + rest + 1.0, exponents, none, since)
    return output, displacement


def published_sensor() -> tuple[SecondOrder, Array]:
    """Second order with delay through the published points, and the residuals (4,) of its complex gain."""
    f, size, degrees = np.array(PUBLISHED).T
    value = size * np.exp(1j * np.radians(degrees))

    def apart(theta: Array) -> Array:
        error = SecondOrder(*theta).response(f) - value
        return np.concatenate([error.real, error.imag])

    result = least_squares(apart, [1.0, 40.0, 0.7, 0.009], x_scale=[1.0, 40.0, 1.0, 0.01])
    return SecondOrder(*map(float, result.x)), np.hypot(result.fun[:4], result.fun[4:])
