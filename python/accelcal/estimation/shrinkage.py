"""Smoothed motion shrunk to the frequencies at which it stands above the noise that smoothing leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data.arrays import Array, Flags
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise

NEGLIGIBLE = 0.01
"""Share of noise in the power of the jerk up to which the motion is left as it is: it costs half as much of a standard
deviation."""
STANDS_ABOVE = 3.0
"""Mean density over that of the noise from which a frequency belongs to the motion: a mean of 13 exponential numbers
exceeds it once in a million frequencies."""
STANDS_ABOVE_ONCE = 20.0
"""The same in one segment, so that a short motion counts: an exponential number exceeds it once in 5e8."""
SEGMENTS = 8
"""Least number of segments (without their overlap) that a spectrum is the mean of."""
LONGEST = 16.0
"""Longest segment, s: frequencies are then told apart better than any motion of a stage needs."""
TREND = 2
"""Frequency bins at zero that always belong to the motion: the window spreads a trend over them."""
END_PERIODS = 2.0
"""Periods of the bandwidth at either end within which a low-pass has no noise of the other side to average."""
FEWEST = 64
"""Samples of a segment below which no spectrum is taken."""
BATCH = 256
"""Segments that are transformed at a time."""


def left_density(run: PreparedRun, noise: Noise, f: Array) -> Array:
    """One-sided density of the noise that smoothing leaves in the acceleration (channels in parallel), (m/s²)²/Hz."""
    noise = noise.usual
    encoder = noise.r * run.reading_step * (2.0 * np.pi * f) ** 4
    return np.asarray(2.0 * noise.q * encoder / (noise.q + encoder))


@dataclass(frozen=True, slots=True)
class Shrinkage:
    """Share of the smoothed acceleration that is kept at each frequency: Wiener's, 1 - noise/density, of the motion."""

    f: Array
    """(m,) Hz"""
    share: Array
    """(m,)"""
    rate: float
    """Of the samples that it is applied to, Hz."""
    edge: int
    """Samples at either end that smoothing determines badly."""

    @classmethod
    def of(
        cls, jerk: Array, rate: float, run: PreparedRun, noise: Noise, cutoff: float, delay: float
    ) -> Shrinkage | None:
        """Share of each frequency for a motion of bandwidth `cutoff`, Hz, with this jerk, (n,) m/s³ at `rate`, Hz,
        of an output that is late by `delay`, s.

        None where noise is a negligible share of the jerk, which holds the most of it.

        Notes
        -----
        The columns of what the motion hardly excites would otherwise consist of noise, and X'X would count that noise
        as information (derivations 3.5). Noise that smoothing leaves is not correlated with the innovations at any
        frequency, so a filter without phase keeps estimates free of bias.
        """
        below: Array = np.linspace(cutoff / 400.0, cutoff, 400)
        left = float(np.sum((2.0 * np.pi * below) ** 2 * left_density(run, noise, below)) * below[0])
        edge = int((END_PERIODS / cutoff + abs(delay)) * rate)
        jerk = jerk[edge : len(jerk) - edge]
        segment = int(min(len(jerk) // SEGMENTS, LONGEST * rate))
        if segment < FEWEST or left < NEGLIGIBLE * float(np.mean(jerk**2)):
            return None
        mean, largest = periodograms(jerk, rate, segment)
        f: Array = np.arange(len(mean), dtype=np.float64) * (rate / segment)
        noise_density = (2.0 * np.pi * f) ** 2 * left_density(run, noise, f)
        with np.errstate(divide="ignore", invalid="ignore"):
            above, once = mean / noise_density, largest / noise_density
        motion: Flags = (above > STANDS_ABOVE) | (once > STANDS_ABOVE_ONCE)
        share = np.where(motion, 1.0 - 1.0 / np.maximum(above, STANDS_ABOVE), 0.0)
        share[: TREND + 1] = 1.0
        return cls(f, share, rate, edge)

    def at(self, f: Array) -> Array:
        """Share at frequencies, Hz."""
        return np.asarray(np.interp(f, self.f, self.share))

    def __call__(self, y: Array) -> Array:
        """Filter velocity or acceleration (n,) without phase; in the edges and beyond, what lies inside is mirrored.

        Smoothed noise is a second derivative; a mirrored acceleration has its low frequencies, a mirrored jerk has not.
        """
        edge = min(self.edge, (len(y) - 1) // 3)  # what is mirrored must be there
        inner = y[edge : len(y) - edge]
        n = min(len(inner) - 1, edge + 2 * len(self.f))
        padded = np.concatenate([inner[n:0:-1], inner, inner[-2 : -n - 2 : -1]])
        length = scipy.fft.next_fast_len(len(padded), real=True)
        spectrum = scipy.fft.rfft(padded - inner[0], length)
        spectrum *= self.at(np.asarray(np.fft.rfftfreq(length, 1.0 / self.rate), dtype=np.float64))
        begin = n - edge
        return np.asarray(scipy.fft.irfft(spectrum, length)[begin : begin + len(y)] + inner[0])


def periodograms(y: Array, rate: float, segment: int) -> tuple[Array, Array]:
    """One-sided densities of segments that overlap by half, behind a Hann window: their mean and, at each frequency,
    the largest, (segment // 2 + 1,) each."""
    window = np.asarray(scipy.signal.windows.hann(segment, sym=False))
    segments = np.lib.stride_tricks.sliding_window_view(y, segment)[:: segment - segment // 2]
    total, largest = np.zeros(segment // 2 + 1), np.zeros(segment // 2 + 1)
    for begin in range(0, len(segments), BATCH):
        part = segments[begin : begin + BATCH]
        spectra = scipy.fft.rfft((part - part.mean(axis=1, keepdims=True)) * window, axis=1)
        density = 2.0 * (spectra.real**2 + spectra.imag**2) / (rate * float(window @ window))
        total += density.sum(axis=0)
        np.maximum(largest, density.max(axis=0), out=largest)
    return total / len(segments), largest
