"""Interpolation error of each sample given its neighbours, with lost samples filled in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import Array
from accelcal.diagnosis.noise_tests.block_spectra import BlockSpectra

Places = NDArray[np.intp]

REACH = 16
"""Samples on either side that contribute to the interpolation of one."""
LEAST_INFORMATION = 0.5
"""Share of the information on a sample that lost neighbours may take away."""
BATCH = 4096
"""Samples whose lost neighbours are solved for at a time."""
REGULAR = 1e-9
"""Added to the diagonal, in responses at distance 0: several lost samples in a row may form what the filter stops."""
MOST_ITERATIONS = 12
"""Iterations of conjugate gradients for lost samples; most of them are isolated, and few iterations suffice for those.
"""
DENSE_MOST = 1024
"""Up to this many lost samples are solved with a dense matrix, 8 MB; more of them with a transform of the series."""


@dataclass(frozen=True, slots=True)
class InterpolationError:
    """Filter that gives the interpolation error of each sample; the noise is white behind the filter's square root.

    A single wrong sample is white, so the matched filter divides by the power of the noise at each frequency.
    """

    gain: Array
    """At the frequencies of the transform, mean 1."""
    n: int
    """Samples of a series."""

    @classmethod
    def of(
        cls, spectra: BlockSpectra, n: int, rate: float, edge: float, least_power: float = 0.0
    ) -> InterpolationError:
        """The filter for noise with these spectra, above the frequency `edge`, Hz; power below `least_power` is taken
        as that much, so that a stop band is not magnified."""
        f = scipy.fft.rfftfreq(scipy.fft.next_fast_len(n, real=True), 1.0 / rate)
        gain = soft_high_pass(f, edge)
        if len(spectra.power):
            gain /= np.interp(f, spectra.f, np.maximum(np.mean(spectra.power, axis=0), max(least_power, 1e-300)))
        return cls(gain / np.mean(gain), n)

    def __call__(self, y: Array) -> Array:
        """Interpolation error of each sample of a series, (n,)."""
        return filtered(y, self.gain)

    def correction(self, errors: Array, lost: Places) -> Array:
        """Correction (n,) of lost samples that makes their interpolation errors zero.

        Parameters
        ----------
        errors : (n,) interpolation errors with the lost samples as they are.
        lost : indices of the lost samples.
        """
        correction = np.zeros(self.n)
        if len(lost) == 0:
            return correction
        if len(lost) <= DENSE_MOST:
            matrix = self.response[np.abs(lost[:, None] - lost)]
            correction[lost] = solve_corrections(lambda x: matrix @ x, errors[lost])
            return correction

        def act(x: Array) -> Array:
            correction[lost] = x
            return self(correction)[lost]

        correction[lost] = solve_corrections(act, errors[lost])
        return correction

    def corrected(self, errors: Array, correction: Array, lost: Places) -> Array:
        """Interpolation errors (n,) once lost samples are corrected.

        Next to a lost sample less is known: errors there are scaled to the spread that they have elsewhere. Next to
        several lost samples too little is known, and the error is NaN.
        """
        if len(lost) == 0:
            return errors
        response = self.response[: 2 * REACH + 1]
        affected, information = remaining_information(response / response[0], lost, self.n)
        errors = errors - self(correction)
        errors[affected] /= np.sqrt(np.where(information > LEAST_INFORMATION, information, np.nan))
        return errors

    @property
    def response(self) -> Array:
        """Effect of a unit error of one sample on the interpolation errors at each distance."""
        return np.asarray(scipy.fft.irfft(self.gain, scipy.fft.next_fast_len(self.n, real=True)))


def solve_corrections(act: Callable[[Array], Array], errors: Array) -> Array:
    """Corrections (m,) of lost samples with `errors` (m,); `act` maps corrections to the errors that they cause."""
    x, r = np.zeros_like(errors), errors
    p, power = r, float(r @ r)
    least = 1e-8 * power
    for _ in range(MOST_ITERATIONS):
        if power <= least:
            break
        q = act(p)
        step = power / float(p @ q)
        x, r = x + step * p, r - step * q
        before, power = power, float(r @ r)
        p = r + (power / before) * p
    return x


def remaining_information(response: Array, lost: Places, n: int) -> tuple[Places, Array]:
    """Samples near lost ones, and the share of the information on them that remains, (m,) each.

    The lost samples about one, corrected together, take away c' R^-1 c, with c its response to each of them and R
    theirs to each other: the Schur complement of a Gaussian with that precision matrix.

    Parameters
    ----------
    response : of an interpolation error to a unit error at each distance from 0 on, over that at 0; twice the reach.
    lost : which of the `n` samples are lost, in rising order.
    """
    reach = (len(response) - 1) // 2
    window = np.arange(-reach, reach + 1)
    affected = np.unique(lost[:, None] + window)
    affected = affected[(affected >= 0) & (affected < n)]
    first = np.searchsorted(lost, affected - reach)
    count = np.searchsorted(lost, affected + reach, side="right") - first
    information = np.empty(len(affected))
    for several in np.unique(count):
        same = np.flatnonzero(count == several)
        for begin in range(0, len(same), BATCH):
            these = same[begin : begin + BATCH]
            places = lost[first[these, None] + np.arange(several)]
            c = response[np.abs(places - affected[these, None])]
            R = response[np.abs(places[:, :, None] - places[:, None, :])] + REGULAR * np.eye(several)
            taken = c * np.linalg.solve(R, c[:, :, None])[:, :, 0]
            information[these] = 1.0 - taken.sum(axis=1)
    return np.asarray(affected), information


def high_passed(y: Array, rate: float, edge: float) -> Array:
    """Part of uniform samples above a frequency, with a soft edge that reaches 30 % higher."""
    f = scipy.fft.rfftfreq(scipy.fft.next_fast_len(len(y), real=True), 1.0 / rate)
    gain = soft_high_pass(f, edge)
    del f
    y = y - np.mean(y)  # what was given goes
    return filtered(y, gain)


def filtered(y: Array, gain: Array) -> Array:
    """A series (n,) behind a zero-phase filter, given by its gain at the frequencies of the transform."""
    n = scipy.fft.next_fast_len(len(y), real=True)
    spectrum = scipy.fft.rfft(y, n)
    spectrum *= gain
    return np.asarray(scipy.fft.irfft(spectrum, n, overwrite_x=True)[: len(y)])


def soft_high_pass(f: Array, edge: float) -> Array:
    """Gain that rises from 0 at a frequency to 1 at 30 % more."""
    weight = np.clip((f - edge) / (0.3 * edge), 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * weight))
