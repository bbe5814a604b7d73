"""Coherence of the residual with side channels, band by band: a transverse sensitivity that depends on frequency."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.data.orientation import DERIVED
from accelcal.diagnosis.evidence import Evidence
from accelcal.diagnosis.policy import COHERENCE_LEAST_SHARE, TRANSVERSE_ALPHA
from accelcal.effects import find
from accelcal.estimation.remarks import Remark, remark

SEGMENTS = 24
"""Segments of the averaged spectra, half overlapping."""
OVERLAP, WINDOW = 1.22, 1.5
"""Segments and bins, over independent ones, of half overlapping Hann windows."""
BANDS_PER_OCTAVE = 2
FASTEST = 0.4
"""Highest frequency of a channel, over its sampling rate."""


@dataclass(frozen=True, slots=True)
class CoherentBand:
    """One band of a side channel."""

    channel: str
    low: float
    """Hz"""
    high: float
    coherence: float
    """Of residual and channel, without what both share with the motion; squared magnitude."""
    sensitivity: float
    """Residual per unit of the channel."""
    p_value: float


def transverse_coherence(e: Evidence) -> Iterator[Remark]:
    """Side channels with which the residual is coherent; at most one remark for each, over its whole band.

    A channel that an effect needs which was found is left out until the model has it.

    Notes
    -----
    Partial coherence given the acceleration. Without any, its square exceeds x with probability (1 - x)^(K - 2) for K
    independent averages (Goodman 1957), times the number of bands of all channels (`TRANSVERSE_ALPHA`,
    tests/diagnosis/test_transverse.py).
    """
    if not e.scan.enough:
        return
    explained = {name for effect in e.found for name in find(effect.effect).needs}
    t, residual = e.where.accel_residual
    channels = {
        name: c
        for name, c in e.recording.side.items()
        if name not in {*explained, *DERIVED, "temperature"} and len(c.t) > 64
    }
    a = np.interp(t - e.runs[0].origins.t, e.signals.t, e.signals.a)
    bands = [
        band
        for name, channel in channels.items()
        for band in coherent_bands(
            name, np.interp(t, channel.t, channel.y), t, residual, a, highest(channel.t, e.where.band)
        )
    ]
    found = [
        band
        for band in bands
        if band.p_value * len(bands) < TRANSVERSE_ALPHA and band.coherence > COHERENCE_LEAST_SHARE
    ]
    for name in channels:
        if coherent := [band for band in found if band.channel == name]:
            strongest = max(coherent, key=lambda band: band.coherence)
            yield remark(
                "transverse_coherence",
                channel=name,
                low=min(band.low for band in coherent),
                high=max(band.high for band in coherent),
                share=100.0 * strongest.coherence,
                sensitivity=strongest.sensitivity,
            )


def highest(t: Array, band: float) -> float:
    """Highest frequency at which a channel is compared, Hz."""
    return min(band, FASTEST / float(np.median(np.diff(t))))


def coherent_bands(
    name: str, side: Array, t: Array, residual: Array, a: Array, highest: float
) -> Iterator[CoherentBand]:
    """Partial coherence of a residual with one channel given the acceleration, in bands up to a frequency, Hz."""
    segment = 2 * len(t) // (SEGMENTS + 1)
    if segment < 64 or np.ptp(side) == 0.0:
        return
    rate = 1.0 / float(np.median(np.diff(t)))
    f, _, r = scipy.signal.stft(residual - np.mean(residual), rate, nperseg=segment, boundary=None, padded=False)
    x, m = (scipy.signal.stft(y - np.mean(y), rate, nperseg=segment, boundary=None, padded=False)[2] for y in (side, a))
    lowest = 2.0 * float(f[1])
    count = int(BANDS_PER_OCTAVE * math.log2(max(highest / lowest, 1.0)))
    for low, high in pairwise(np.geomspace(lowest, highest, count + 1)):
        rows = (f >= low) & (f < high)
        averages = r.shape[1] / OVERLAP * np.count_nonzero(rows) / WINDOW
        if averages < 4.0:
            continue
        S = np.array([[np.sum(p[rows] * np.conj(q[rows])) for q in (r, x, m)] for p in (r, x, m)])
        motion = max(float(S[2, 2].real), 1e-300)
        rx = S[0, 1] - S[0, 2] * S[2, 1] / motion
        rr, xx = (float((S[k, k] - abs(S[k, 2]) ** 2 / motion).real) for k in (0, 1))
        if rr <= 0.0 or xx <= 1e-12 * float(S[1, 1].real):
            continue
        coherence = min(float(abs(rx) ** 2 / (rr * xx)), 1.0)
        p = math.exp((averages - 2.0) * math.log1p(-min(coherence, 1.0 - 1e-12)))
        yield CoherentBand(name, float(low), float(high), coherence, float(abs(rx) / xx), p)
