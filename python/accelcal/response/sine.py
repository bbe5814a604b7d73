"""Sine approximation (ISO 16063-11, -41): least squares of sines with a drift, on the stamps as they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.data.arrays import Array
from accelcal.data.recording import Channel
from accelcal.signals.transfer import Spectrum

DRIFT = 3
"""Terms of the drift: constant, slope, curvature."""
ROUNDS = 8
"""Gauss-Newton steps that refine a frequency."""


@dataclass(frozen=True, slots=True)
class SineFit:
    """Amplitudes of one channel: y = mean + drift + sum of Re(amplitude exp(i w (t - centre)))."""

    amplitudes: Spectrum
    """(m,) complex, unit of the channel."""
    mean: float
    """Mean over the stretch beside the sines, unit of the channel."""
    t: Array
    """(n,) s, from the centre."""
    residual: Array
    """(n,) unit of the channel."""

    def lines(self, frequencies: Array) -> Spectrum:
        """Amplitudes (k,) that the residual has at other frequencies (k,) Hz."""
        turns = np.exp(-2j * math.pi * np.outer(frequencies, self.t))
        return np.asarray(2.0 / len(self.t) * (turns @ self.residual))


def within(channel: Channel, start: float, end: float) -> Channel:
    """The samples of a channel from `start` to `end`, s."""
    first, last = np.searchsorted(channel.t, (start, end))
    return Channel(channel.name, channel.t[first:last], channel.y[first:last], channel.unit)


def fit_sines(channel: Channel, frequencies: Sequence[float] | Array, centre: float) -> SineFit:
    """Fit sines of known frequencies and a drift to all samples of a channel.

    Parameters
    ----------
    channel : the samples of one stretch.
    frequencies : (m,) Hz.
    centre : instant to which phases refer, s.

    Raises
    ------
    ValueError
        If there are fewer samples than unknowns.
    """
    t = channel.t - centre
    unknowns = DRIFT + 2 * len(frequencies)
    if len(t) <= unknowns:
        raise AccelcalError(f"{channel.name}: {len(t)} samples in this stretch, expected more than {unknowns}")
    columns = _columns(t, np.asarray(frequencies, dtype=np.float64))
    found = np.linalg.lstsq(columns, channel.y, rcond=None)[0]
    waves = found[DRIFT:]
    drift = columns[:, :DRIFT] @ found[:DRIFT]
    return SineFit(waves[::2] - 1j * waves[1::2], float(np.mean(drift)), t, channel.y - columns @ found)


def refined_frequency(channel: Channel, frequency: float) -> float:
    """Frequency of the sine in a channel, Hz, from a first value that errs by less than one period over its length."""
    length = float(channel.t[-1] - channel.t[0])
    centre = float(channel.t[0]) + 0.5 * length
    t = channel.t - centre
    for _ in range(ROUNDS):
        columns = _columns(t, np.array([frequency]))
        found = np.linalg.lstsq(columns, channel.y, rcond=None)[0]
        c, s = found[DRIFT:]
        slope = 2.0 * math.pi * t * (s * columns[:, DRIFT] - c * columns[:, DRIFT + 1])
        full = np.column_stack([columns, slope])
        step = float(np.linalg.lstsq(full, channel.y, rcond=None)[0][-1])
        frequency += float(np.clip(step, -0.5 / length, 0.5 / length))
        if abs(step) * length < 1e-9:
            break
    return frequency


def _columns(t: Array, frequencies: Array) -> Array:
    """Constant, slope, curvature, then cosine and sine of each frequency; (n, 3 + 2 m)."""
    scaled = t / float(np.max(np.abs(t)))
    waves = np.exp(2j * math.pi * np.outer(t, frequencies))
    both = np.stack([waves.real, waves.imag], axis=2).reshape(len(t), -1)
    return np.column_stack([np.vander(scaled, DRIFT, increasing=True), both])
