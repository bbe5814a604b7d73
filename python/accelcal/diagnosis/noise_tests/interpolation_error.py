"""What each sample is off by when its neighbours are right, and what lost samples must be for none to be off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data.arrays import Array
from accelcal.diagnosis.noise_tests.block_spectra import BlockSpectra

Places = NDArray[np.intp]

REACH = 16
"""Samples on either side that matter for what one should be."""
KNOWN = 0.5
"""Share of what is known of a sample that neighbours which are lost may take away."""
FILLINGS = 12
"""Steps of conjugate gradients for lost samples; most of them stand alone, and few steps fill those."""
FEW = 1024
"""So many lost samples act on each other through a matrix, 8 MB; more of them through a transform of the series."""


@dataclass(frozen=True, slots=True)
class InterpolationError:
    """Filter that tells what a sample is off by when its neighbours are right: the noise is white behind its root.

    A single wrong sample is white: the filter divides by the power of the noise at each frequency.
    """

    gain: Array
    """At the frequencies of the transform, mean 1."""
    n: int
    """Samples of a series."""

    @classmethod
    def of(cls, spectra: BlockSpectra, n: int, rate: float, edge: float) -> InterpolationError:
        """The filter for noise with these spectra, above the frequency `edge`, Hz."""
        f = scipy.fft.rfftfreq(scipy.fft.next_fast_len(n, real=True), 1.0 / rate)
        gain = soft_edge(f, edge)
        if len(spectra.power):
            gain /= np.interp(f, spectra.f, np.maximum(np.mean(spectra.power, axis=0), 1e-300))
        return cls(gain / np.mean(gain), n)

    def __call__(self, y: Array) -> Array:
        """What each sample of a series (n,) is off by."""
        return filtered(y, self.gain)

    def correction(self, off: Array, lost: Places) -> Array:
        """What lost samples must be corrected by for none of them to be off, (n,); `off` is what each is, (n,)."""
        correction = np.zeros(self.n)
        if len(lost) == 0:
            return correction
        if len(lost) <= FEW:
            matrix = self.response[np.abs(lost[:, None] - lost)]
            correction[lost] = filled(lambda x: matrix @ x, off[lost])
            return correction

        def act(x: Array) -> Array:
            correction[lost] = x
            return self(correction)[lost]

        correction[lost] = filled(act, off[lost])
        return correction

    def corrected(self, off: Array, correction: Array, lost: Places) -> Array:
        """What each sample is off by once lost ones are corrected, (n,).

        Beside a lost sample less is known: the first is scaled to the spread that it has elsewhere. Beside several too
        little is known, and nothing is said.
        """
        if len(lost) == 0:
            return off
        response = self.response[: REACH + 1]
        near, known = knowledge((response[1:] / response[0]) ** 2, lost, self.n)
        off = off - self(correction)
        off[near] = np.where(known > KNOWN, off[near] / np.sqrt(np.maximum(known, KNOWN)), 0.0)
        return off

    @property
    def response(self) -> Array:
        """What a sample that is off by one unit does to those at each distance."""
        return np.asarray(scipy.fft.irfft(self.gain, scipy.fft.next_fast_len(self.n, real=True)))


def filled(act: Callable[[Array], Array], off: Array) -> Array:
    """Corrections (m,) of lost samples that are `off` (m,); `act` tells what corrections do to all of them."""
    x, r = np.zeros_like(off), off
    p, power = r, float(r @ r)
    least = 1e-8 * power
    for _ in range(FILLINGS):
        if power <= least:
            break
        q = act(p)
        step = power / float(p @ q)
        x, r = x + step * p, r - step * q
        before, power = power, float(r @ r)
        p = r + (power / before) * p
    return x


def knowledge(reach: Array, lost: Places, n: int) -> tuple[Places, Array]:
    """Samples near lost ones, and the share of what is known of them that is left, (m,) each.

    Parameters
    ----------
    reach : share that each neighbour knows, by its distance from 1 on.
    lost : which of the `n` samples are lost.
    """
    away = np.arange(1, len(reach) + 1)
    around = (lost[:, None] + np.concatenate([-away, away])).ravel()
    near, index = np.unique(np.concatenate([lost, around]), return_inverse=True)
    taken_away = np.bincount(index[len(lost) :], np.tile(reach, 2 * len(lost)), len(near))
    inside = (near >= 0) & (near < n)
    return np.asarray(near[inside]), np.asarray(1.0 - taken_away[inside])


def above(y: Array, rate: float, edge: float) -> Array:
    """Part of uniform samples above a frequency, with a soft edge that reaches 30 % higher."""
    f = scipy.fft.rfftfreq(scipy.fft.next_fast_len(len(y), real=True), 1.0 / rate)
    gain = soft_edge(f, edge)
    del f
    y = y - np.mean(y)  # what was given goes
    return filtered(y, gain)


def filtered(y: Array, gain: Array) -> Array:
    """A series (n,) behind a filter without phase, given by its gain at the frequencies of the transform."""
    n = scipy.fft.next_fast_len(len(y), real=True)
    spectrum = scipy.fft.rfft(y, n)
    spectrum *= gain
    return np.asarray(scipy.fft.irfft(spectrum, n, overwrite_x=True)[: len(y)])


def soft_edge(f: Array, edge: float) -> Array:
    """Gain that rises from 0 at a frequency to 1 at 30 % more."""
    weight = np.clip((f - edge) / (0.3 * edge), 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * weight))
