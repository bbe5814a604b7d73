"""Sensitivity from a sweep or a random motion: smooth windows on overlapping segments.

The amplitude of the acceleration in a segment is the integral of the reference against the derivative of the windowed
sine, so that nothing is differentiated and a steep spectrum does not leak. Output = H acceleration + noise over all
segments is a regression whose errors have the known correlation of overlapping windows; further columns, the
acceleration behind derivatives of the window, take slope and curvature of H over the width of the window (derivation
6.16).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal._support.errors import AccelcalError
from accelcal.data import Array, Channel, usual_step
from accelcal.response.sine import Point, Reference
from accelcal.signals.processing import Spectrum, even_times

SEGMENTS = 16
"""Segments that fit end to end into a recording."""
OVERLAP = 4
"""Segments that begin within one."""
LEAST_CYCLES = 8.0
"""Periods in a segment, for the lowest frequency."""
COUNT = 40
"""Frequencies where none are asked for."""
HIGHEST = 0.4
"""Share of the lower rate up to which a response is estimated."""
COHERENT = 0.2
"""Relative standard uncertainty above which a frequency that was not asked for is left out."""
NOISE_SHARE = 0.2
"""Share of the reference's power that its noise may have; beyond it the reference shows no motion."""
COLUMNS = 3
"""Most columns of a regression: H over the width of a window is constant, a straight line or a parabola."""
ENERGY = 35.0 / 128.0
"""Integral of the squared window over 0..1."""


@dataclass(frozen=True, slots=True)
class Segments:
    """Where segments lie and how they overlap."""

    begin: float
    """s"""
    length: float
    """s, of one."""
    count: int

    def covariance(self) -> Array:
        """(m, m) correlation of white noise seen through the windows."""
        u = (np.arange(4000) + 0.5) / 4000
        first = np.zeros(self.count)
        for lag in range(min(OVERLAP, self.count)):
            shifted = u - lag / OVERLAP
            first[lag] = float(np.mean(np.where(shifted > 0.0, window(u)[0] * window(shifted)[0], 0.0)))
        return np.asarray(scipy.linalg.toeplitz(first / first[0]))


def window(u: Array) -> Array:
    """sin⁴(pi u) = (3 - 4 cos(2 pi u) + cos(4 pi u))/8 on 0..1 with four derivatives in u, (5, n): the first three
    vanish at both ends."""
    w, k = 2.0 * np.pi, np.arange(5)[:, None]
    waves = [0.125 * a * (m * w) ** k * np.cos(m * w * u + 0.5 * np.pi * k) for m, a in ((1, -4.0), (2, 1.0))]
    return np.asarray(0.375 * (k == 0) + waves[0] + waves[1])


def measure_broadband(output: Channel, reference: Reference, frequencies: Sequence[float] | None) -> list[Point]:
    """Sensitivity at frequencies in Hz, or at those at which output and reference are coherent.

    Raises
    ------
    ValueError
        If a frequency that was asked for is outside what the rates and the length allow.
    """
    channels = even(output), even(reference.channel)
    segments = _segments(channels)
    highest = HIGHEST / max(usual_step(c.t) for c in channels)
    lowest = LEAST_CYCLES / segments.length
    if frequencies is None:
        chosen = np.geomspace(lowest, highest, COUNT)
    else:
        chosen = np.array(sorted(frequencies))
        if len(chosen) and not (lowest <= chosen[0] and chosen[-1] <= highest):
            raise AccelcalError(
                f"{output.name}: this recording shows frequencies from {lowest:.4g} to {highest:.4g} Hz, asked for are "
                f"{chosen[0]:.4g} to {chosen[-1]:.4g} Hz; choose others, or record longer or faster"
            )
    noise = _reference_noise(channels[1], segments)
    first = _points(channels, reference, segments, 0.0, chosen, noise)
    # the windows of the output follow the delay that the first pass finds, so that a steep phase does not leak
    delay = _delay([p for p in first if p.std < COHERENT * p.magnitude], segments)
    points = _points(channels, reference, segments, delay, chosen, noise)
    return [p for p in points if frequencies is not None or p.std < COHERENT * p.magnitude]


def _delay(points: Sequence[Point], segments: Segments) -> float:
    """Slope of the unwrapped phase, s; at most a tenth of a segment."""
    if not points:
        return 0.0
    w = 2.0 * math.pi * np.array([p.frequency for p in points])
    phase = np.unwrap(np.array([p.phase for p in points]))
    weight = np.array([(p.magnitude / p.std) ** 2 for p in points])
    seconds = -float(np.sum(weight * w * phase) / np.sum(weight * w * w))
    return float(np.clip(seconds, -0.1 * segments.length, 0.1 * segments.length))


def even(channel: Channel) -> Channel:
    """The channel on even stamps: as it is, or through a cubic spline at its usual rate."""
    step = usual_step(channel.t)
    if np.max(np.abs(np.diff(channel.t) - step)) < 1e-4 * step:
        return channel
    t = even_times(channel.t[0], channel.t[-1], step)
    return Channel(channel.name, t, scipy.interpolate.CubicSpline(channel.t, channel.y)(t), channel.unit)


def _segments(channels: tuple[Channel, Channel]) -> Segments:
    begin, end = max(float(c.t[0]) for c in channels), min(float(c.t[-1]) for c in channels)
    length = (end - begin) / SEGMENTS
    if not length > 64.0 * max(usual_step(c.t) for c in channels):
        raise AccelcalError(f"{channels[0].name}: output and reference share {end - begin:.3g} s; record longer")
    return Segments(begin, length, (SEGMENTS - 1) * OVERLAP + 1)


def amplitudes(
    channel: Channel, segments: Segments, frequencies: Array, order: int, delay: float = 0.0, columns: int = COLUMNS
) -> Spectrum:
    """Amplitudes (columns, f, m) of the derivative of an order of a channel: integrals of window times sine in each
    segment, and of the window's derivatives, 1/s and 1/s², times sine.

    The windows lie later by the delay, s; the sines keep their phase. The derivative falls on the window and the sine:
    with D = d/dt, D(w exp(-iwt)) = (w' - iw w) exp(-iwt), and so on; each brings a minus sign.
    """
    w, step = 2.0 * math.pi * frequencies, usual_step(channel.t)
    turns = np.exp(-1j * np.outer(w, step * np.arange(math.ceil(segments.length / step) + 2)))
    factors = {0: (1.0,), 1: (1j * w, -1.0), 2: (-(w**2), -2j * w, 1.0)}[order]
    values, rows = np.empty((columns, len(w), segments.count), dtype=np.complex128), order + columns
    for i in range(segments.count):
        begin = segments.begin + delay + i * (segments.length / OVERLAP)
        first, last = np.searchsorted(channel.t, (begin, begin + segments.length))
        t, y = channel.t[first:last], channel.y[first:last]
        tests = window((t - begin) / segments.length)[:rows] / segments.length ** np.arange(float(rows))[:, None]
        sums = turns[:, : len(t)] @ (tests * y).T
        for column in range(columns):
            total = sum(factor * sums[:, k + column] for k, factor in enumerate(factors))
            values[column, :, i] = step * total * np.exp(-1j * w * t[0])
    return values


def _reference_noise(channel: Channel, segments: Segments) -> float:
    """Mean power of the windowed channel where its band ends: noise, taken as white."""
    rate = 1.0 / usual_step(channel.t)
    at_the_end = amplitudes(channel, segments, rate * np.array([0.42, 0.44, 0.46]), 0, columns=1)[0]
    return float(np.median(np.abs(at_the_end) ** 2)) / math.log(2.0)


def _points(
    channels: tuple[Channel, Channel],
    reference: Reference,
    segments: Segments,
    delay: float,
    frequencies: Array,
    noise: float,
) -> list[Point]:
    """Each frequency by generalised least squares, with as many columns as predict the output best at all of them."""
    factor = scipy.linalg.cholesky(segments.covariance(), lower=True)
    undone = reference.polarity / reference.filters(frequencies)
    raw = undone[:, None] * amplitudes(channels[1], segments, frequencies, reference.order)
    outputs = amplitudes(channels[0], segments, frequencies, 0, delay, columns=1)[0]
    together = np.concatenate([outputs[None], raw]).reshape(-1, segments.count)
    whitened = scipy.linalg.solve_triangular(factor, together.T, lower=True).T.reshape(1 + COLUMNS, -1, segments.count)
    of_noise = segments.count * noise * np.abs(undone) ** 2 * (2.0 * math.pi * frequencies) ** (2 * reference.order)
    power = np.sum(np.abs(whitened[1]) ** 2, axis=1)
    moved = np.flatnonzero((power > 0.0) & (of_noise <= NOISE_SHARE * power))
    orders = [
        [_regression(whitened[0, i], whitened[1 : 1 + count, i].T, of_noise[i]) for i in moved]
        for count in range(1, COLUMNS + 1)
    ]
    mean = np.sqrt(2.0 * np.mean(np.abs(raw[0]) ** 2, axis=1) / (ENERGY * segments.length))
    return [
        Point(
            frequency=float(frequencies[i]),
            value=regression.value,
            std=regression.std,
            degrees=regression.degrees,
            acceleration=complex(mean[i]),
            method="broadband",
            start=segments.begin,
            end=segments.begin + segments.length * SEGMENTS,
        )
        for i, regression in zip(moved, min(orders, key=_validation), strict=True)
    ]


@dataclass(frozen=True, slots=True)
class _Regression:
    """H at one frequency, its standard uncertainty, degrees of freedom and the variance of what is left."""

    value: complex
    std: float
    degrees: float
    variance: float


def _regression(y: Spectrum, columns: Spectrum, of_noise: float) -> _Regression:
    """Least squares (m,) on columns (m, k), corrected for the power of the noise of the reference in the first."""
    normal = columns.conj().T @ columns
    corrected = normal.copy()
    corrected[0, 0] -= of_noise
    inverse = np.linalg.pinv(corrected, hermitian=True)
    solution = inverse @ columns.conj().T @ y
    degrees = 2 * (len(y) - columns.shape[1])
    variance = float(np.sum(np.abs(y - columns @ solution) ** 2)) / degrees
    std = math.sqrt(variance * (inverse @ normal @ inverse)[0, 0].real)
    return _Regression(complex(solution[0]), std, float(degrees), variance)


def _validation(regressions: Iterable[_Regression]) -> float:
    """Generalised cross-validation of one number of columns, over all frequencies: smaller is better."""
    return sum(math.log(max(r.variance, sys.float_info.min) / r.degrees) for r in regressions)
