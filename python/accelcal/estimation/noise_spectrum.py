"""Measured spectrum of what a run's coefficients leave, and rows that are whitened by it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data import Array

BANDS_PER_OCTAVE = 3
"""Bands in which the level of a residual is measured."""
LEAST_LINES = 16
"""Lines in a band at least."""
FREE_SHARE = 0.5
"""Share of a line that fitted columns may take and leave it one of noise."""
MEDIAN_OF_SQUARE = float(scipy.special.chdtri(1, 0.5))
"""Median of the square of a standard normal variable."""
MEDIAN_VARIANCE = 2.33**2
"""Variance of the logarithm of such a median times the number of lines: (2 m p(m))^-2 at the median m of density p."""
WHITE_ALPHA = 1e-6
"""Probability of the measured levels under white noise below which they are a spectrum."""
WHITE_FACTOR = 2.0
"""Factor from the mean level up to which no level matters."""

Spectrum = Callable[[Array], Array]
"""Density over that of white rows of variance 1 at frequencies in Hz, none of them 0."""


@dataclass(frozen=True, slots=True)
class MeasuredSpectrum:
    """Levels in bands, straight lines between them over the logarithm of frequency, level beyond them."""

    log_f: Array
    """Logarithm of the centre of each band, Hz, (bands,)."""
    log_level: Array
    """(bands,)"""
    lines: Array
    """Number of lines in each band, (bands,)."""
    crossover: float
    """Of the filter, Hz."""

    def __call__(self, f: Array) -> Array:
        """Density over that of white rows of variance 1 at frequencies `f`, Hz, (n,).

        Above the crossover it is nowhere less than there: regressors hold noise of the output, which would count.
        """
        log_crossover = math.log(self.crossover)
        least = float(np.interp(log_crossover, self.log_f, self.log_level))
        level = np.interp(np.log(f), self.log_f, self.log_level)
        return np.asarray(np.exp(np.where(np.log(f) > log_crossover, np.maximum(level, least), level)))

    @property
    def white(self) -> bool:
        """Whether the levels are those of white noise: chance, or no factor that matters."""
        departure = self.log_level - float(self.lines @ self.log_level) / float(np.sum(self.lines))
        chi2 = float(self.lines @ departure**2) / MEDIAN_VARIANCE
        chance = float(scipy.special.chdtrc(max(1, len(self.lines) - 1), chi2))
        return chance > WHITE_ALPHA or float(np.max(np.abs(departure))) < math.log(WHITE_FACTOR)


def measured_spectrum(
    r: Array, rate: float, crossover: float, explained: Array | None = None
) -> MeasuredSpectrum | None:
    """Measure the spectrum of a residual by medians; None where it has too few lines.

    Parameters
    ----------
    r : residual of the rows, (n,).
    rate : of the rows, Hz.
    crossover : of the filter, Hz.
    explained : share of each cosine that the fitted columns take, (n,); none by default.

    Notes
    -----
    A median does not follow what a missing effect leaves in less than half of the lines of a band (derivations D3.7).
    """
    n = len(r)
    if n <= LEAST_LINES:
        return None
    power = scipy.fft.dct(r, norm="ortho")[1:] ** 2
    free = np.ones(n - 1) if explained is None else 1.0 - explained[1:]
    f = np.arange(1.0, n) * rate / (2.0 * n)
    kept = (free > FREE_SHARE) & (power > 0.0)
    power, f = power[kept] / free[kept], f[kept]
    begin, centres, levels, lines = 0, [], [], []
    while len(f) - begin >= LEAST_LINES:
        end = max(begin + LEAST_LINES, int(np.searchsorted(f, f[begin] * 2.0 ** (1.0 / BANDS_PER_OCTAVE))))
        if len(f) - end < LEAST_LINES:
            end = len(f)
        centres.append(float(np.mean(np.log(f[begin:end]))))
        levels.append(math.log(float(np.median(power[begin:end])) / MEDIAN_OF_SQUARE))
        lines.append(float(end - begin))
        begin = end
    return MeasuredSpectrum(np.array(centres), np.array(levels), np.array(lines), crossover) if centres else None


def whitener(spectrum: Spectrum | None, rate: float) -> Callable[[Array], Array]:
    """What divides rows (m, n) by the square root of a spectrum; the rows as they are without one."""
    if spectrum is None:
        return lambda rows: rows

    def whiten(rows: Array) -> Array:
        n = rows.shape[-1]
        f = np.maximum(np.arange(float(n)), 0.5) * rate / (2.0 * n)
        cosines = scipy.fft.dct(rows, norm="ortho", axis=-1)
        return np.asarray(scipy.fft.idct(cosines / np.sqrt(spectrum(f)), norm="ortho", axis=-1))

    return whiten
