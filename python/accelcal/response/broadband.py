"""Sensitivity from a sweep or a random motion: smooth windows on overlapping segments.

The amplitude of the acceleration in a segment is the integral of the reference against the derivative of the windowed
sine, so that nothing is differentiated and a steep spectrum does not leak. Output = H acceleration + noise over all
segments is a regression whose errors have the known correlation of overlapping windows (derivation D3.12).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.data.recording import Channel
from accelcal.data.stamps import usual_step
from accelcal.response.points import Point, Reference
from accelcal.signals.transfer import Spectrum

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


@dataclass(frozen=True, slots=True)
class Segments:
    """Where segments lie and how they overlap."""

    begin: float
    """s"""
    length: float
    """s, of one."""
    count: int

    @property
    def hop(self) -> float:
        """From one begin to the next, s."""
        return self.length / OVERLAP

    def covariance(self) -> Array:
        """(m, m) correlation of white noise seen through the windows."""
        u = (np.arange(4000) + 0.5) / 4000
        first = np.zeros(self.count)
        for lag in range(min(OVERLAP, self.count)):
            shifted = u - lag / OVERLAP
            first[lag] = float(np.mean(np.where(shifted > 0.0, window(u)[0] * window(shifted)[0], 0.0)))
        return np.asarray(scipy.linalg.toeplitz(first / first[0]))


def window(u: Array) -> Array:
    """sin⁴(pi u) on 0..1 with its two derivatives in u, (3, n): all vanish at both ends."""
    s, c = np.sin(np.pi * u), np.cos(np.pi * u)
    return np.stack([s**4, 4 * np.pi * s**3 * c, 4 * np.pi**2 * s**2 * (3 * c**2 - s**2)])


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
            raise ValueError(
                f"{output.name}: this recording shows frequencies from {lowest:.4g} to {highest:.4g} Hz, asked for are "
                f"{chosen[0]:.4g} to {chosen[-1]:.4g} Hz; choose others, or record longer or faster"
            )
    factor = scipy.linalg.cholesky(segments.covariance(), lower=True)
    noise = _reference_noise(channels[1], segments)
    delay = 0.0
    for last in (False, True):  # the windows of the output follow the delay that the first pass finds
        each = (_point(channels, reference, segments, delay, float(f), factor, noise) for f in chosen)
        found = [p for p in each if p is not None]
        if not last:
            delay = _delay([p for p in found if p.std < COHERENT * p.magnitude], segments)
    return [p for p in found if frequencies is not None or p.std < COHERENT * p.magnitude]


def _delay(points: Sequence[Point], segments: Segments) -> float:
    """Slope of the unwrapped phase, s; at most a tenth of a segment."""
    if not points:
        return 0.0
    w = 2.0 * math.pi * np.array([p.frequency for p in points])
    phase = np.unwrap(np.array([p.phase for p in points]))
    weight = np.array([(p.magnitude / p.std) ** 2 for p in points])
    found = -float(np.sum(weight * w * phase) / np.sum(weight * w * w))
    return float(np.clip(found, -0.1 * segments.length, 0.1 * segments.length))


def even(channel: Channel) -> Channel:
    """The channel on even stamps: as it is, or through a cubic spline at its usual rate."""
    step = usual_step(channel.t)
    if np.max(np.abs(np.diff(channel.t) - step)) < 1e-4 * step:
        return channel
    t = np.arange(channel.t[0], channel.t[-1], step)
    return Channel(channel.name, t, scipy.interpolate.CubicSpline(channel.t, channel.y)(t), channel.unit)


def _segments(channels: tuple[Channel, Channel]) -> Segments:
    begin, end = max(float(c.t[0]) for c in channels), min(float(c.t[-1]) for c in channels)
    length = (end - begin) / SEGMENTS
    if not length > 64.0 * max(usual_step(c.t) for c in channels):
        raise ValueError(f"{channels[0].name}: output and reference share {end - begin:.3g} s; record longer")
    return Segments(begin, length, (SEGMENTS - 1) * OVERLAP + 1)


def amplitudes(channel: Channel, segments: Segments, frequency: float, order: int, delay: float = 0.0) -> Spectrum:
    """Amplitude of the derivative of an order of a channel in each segment, (m,): the integral of window times sine.

    The windows lie later by the delay, s; the sine keeps its phase.
    """
    w, step = 2.0 * math.pi * frequency, usual_step(channel.t)
    found = np.empty(segments.count, dtype=np.complex128)
    for i in range(segments.count):
        begin = segments.begin + delay + i * segments.hop
        first, last = np.searchsorted(channel.t, (begin, begin + segments.length))
        t = channel.t[first:last]
        zero, one, two = window((t - begin) / segments.length) / segments.length ** np.arange(3.0)[:, None]
        test = {0: zero + 0j, 1: -(one - 1j * w * zero), 2: two - 2j * w * one - w**2 * zero}[order]
        found[i] = step * np.sum(test * np.exp(-1j * w * t) * channel.y[first:last])
    return found


def _reference_noise(channel: Channel, segments: Segments) -> float:
    """Mean power of the windowed channel where its band ends: noise, taken as white."""
    rate = 1.0 / usual_step(channel.t)
    power = [np.abs(amplitudes(channel, segments, share * rate, 0)) ** 2 for share in (0.42, 0.44, 0.46)]
    return float(np.median(power)) / math.log(2.0)


def _point(
    channels: tuple[Channel, Channel],
    reference: Reference,
    segments: Segments,
    delay: float,
    frequency: float,
    factor: Array,
    noise: float,
) -> Point | None:
    """One frequency by generalised least squares, corrected for the noise of the reference."""
    f = np.array([frequency])
    undone = complex(reference.polarity / reference.filters(f)[0])
    y = _whitened(factor, amplitudes(channels[0], segments, frequency, 0, delay))
    raw = undone * amplitudes(channels[1], segments, frequency, reference.order)
    a = _whitened(factor, raw)
    power = float(np.sum(np.abs(a) ** 2))
    of_noise = len(a) * noise * abs(undone) ** 2 * (2.0 * math.pi * frequency) ** (2 * reference.order)
    if not power > 0.0 or of_noise > NOISE_SHARE * power:
        return None
    value = complex(np.vdot(a, y)) / (power - of_noise)
    degrees = 2 * (len(a) - 1)
    variance = float(np.sum(np.abs(y - value * a) ** 2)) / degrees
    energy = 3.0 / 8.0 * 35.0 / 48.0 * segments.length  # the integral of window²: 35/128 of its length
    return Point(
        frequency=frequency,
        value=value,
        std=math.sqrt(variance * power) / (power - of_noise),
        degrees=float(degrees),
        acceleration=complex(math.sqrt(2.0 * float(np.mean(np.abs(raw) ** 2)) / energy)),
        method="broadband",
        start=segments.begin,
        end=segments.begin + segments.length * SEGMENTS,
    )


def _whitened(factor: Array, x: Spectrum) -> Spectrum:
    return np.asarray(scipy.linalg.solve_triangular(factor, x, lower=True))
