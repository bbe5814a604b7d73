"""Noise density of the sensor, and where it comes from: the output at rest, the declaration, or a fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from accelcal.data import summary
from accelcal.data.recording import Recording
from accelcal.data.rig import Rig
from accelcal.estimation.values import Noise

LEAST_REST, LEAST_STRETCH = 5.0, 2.0
"""Rests that are shorter in all, and stretches that are, do not determine the noise of the sensor, s."""
EDGE = 0.25
"""Left out at both ends of a stretch, s: the stage still settles."""
LOWEST = 2.0
"""Periods in a stretch from which a frequency counts: slower ones are drift."""
OF_CUTOFF, OF_RATE = 0.2, 0.2
"""Highest frequency that counts, as a share of the lowest corner of a low-pass, and of the sampling rate."""
LEAST_ORDINATES, MOST_ORDINATES = 30, 100
"""Frequencies that determine a density: not fewer, and the slowest ones alone, since they make the drift."""
LEAST_CODES = 8
"""Fewer different values of the output at rest than this are the rounding of a converter, not noise."""
DIFFER = 1.5
"""Density at rest and declared density that differ by more than this factor are both told."""
Source = Literal["rest", "declared", "fit"]
SOURCES: Mapping[Source, str] = {
    "rest": "noise density at rest",
    "declared": "declared noise density",
    "fit": "at most: fitted noise density",
}
"""Where a density comes from, for people."""

ONLY_WHITE = "noise alone is white noise; 1/f noise of the sensor is not in it and adds to the drift"
"""What a floor leaves out, for people: a record does not tell 1/f noise from slow effects that a model lacks."""


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Noise density of the sensor and where it comes from."""

    density: float
    """One-sided, (m/s²)/sqrt(Hz)."""
    std: float
    """Its standard deviation; 0 where it is declared."""
    source: Source
    declared: float | None = None
    """The declared density where it differs from the one taken by more than a factor `DIFFER`, (m/s²)/sqrt(Hz)."""

    @property
    def is_limit(self) -> bool:
        """Whether the density is an upper limit only: what models lack adds to a fitted one."""
        return self.source == "fit"

    @classmethod
    def of(cls, recording: Recording, fitted: Noise, scale: float = 1.0, end: float | None = None) -> SensorNoise:
        """Density of the output at rest, else the declared one, else the fitted one.

        What a fit takes for noise is never below the noise of the sensor. So a rest that is noisier than the fit by
        more than a factor `DIFFER` is none (the stage creeps or its servo works), and such a declared density is that
        of another sensor.

        Parameters
        ----------
        recording : what models are compared with, until `end`, s.
        fitted : least noise of all models.
        scale : change of the output with acceleration, 1 + k.
        """
        limit = abs(scale) * math.sqrt(2.0 * fitted.usual.q)
        declared = recording.rig.sensor.noise or None
        found = density_at_rest(recording, end)
        if found is not None and found[0] <= DIFFER * limit:
            return cls(*found, "rest", _beside(declared, found[0]))
        if declared is not None and declared <= DIFFER * limit:
            return cls(declared, 0.0, "declared")
        return cls(limit, 0.0, "fit", _beside(declared, limit))


def _beside(declared: float | None, density: float) -> float | None:
    """The declared density where it differs from the one that is taken."""
    return None if declared is None or 1.0 / DIFFER <= density / declared <= DIFFER else declared


def density_at_rest(recording: Recording, until: float | None = None) -> tuple[float, float] | None:
    """One-sided noise density of the output while the encoder stands still, and its standard deviation.

    In (m/s²)/sqrt(Hz), from the median of the periodogram, which lines of mains or pumps do not move. None where the
    record rests too briefly.
    """
    accel = recording.accel
    rate = 1.0 / float(np.median(np.diff(accel.t)))
    lowest, highest = _band(recording.rig, rate)
    frequencies, powers, rested = [], [], 0.0
    for begin, end in summary.rest(recording):
        if until is not None and end > until:
            continue
        y = accel.y[slice(*np.searchsorted(accel.t, [begin + EDGE, end - EDGE]))]
        if end - begin >= LEAST_STRETCH and np.all(np.isfinite(y)) and len(np.unique(y)) >= LEAST_CODES:
            rested += end - begin
            frequency, power = scipy.signal.periodogram(y, rate, detrend="linear")
            inside = (frequency >= max(lowest, LOWEST * rate / len(y))) & (frequency <= highest)
            frequencies.append(frequency[inside])
            powers.append(power[inside])
    if rested < LEAST_REST or sum(map(len, powers)) < LEAST_ORDINATES:
        return None
    slowest = np.argsort(np.concatenate(frequencies))[:MOST_ORDINATES]
    power = np.concatenate(powers)[slowest]
    middle = float(np.median(power)) / math.log(2.0)  # of an exponential distribution
    relative = 1.0 / (math.log(2.0) * math.sqrt(len(power)))
    return math.sqrt(middle), 0.5 * relative * math.sqrt(middle)


def _band(rig: Rig, rate: float) -> tuple[float, float]:
    """Frequencies at which the declared filters of the output pass its noise, Hz."""
    lowest, highest = 0.0, OF_RATE * rate
    if rig.lowpass is not None:
        highest = min(highest, OF_CUTOFF * rig.lowpass.cutoff)
    for each in rig.output_filters:
        if each.cutoff is not None and each.passes == "lowpass":
            highest = min(highest, OF_CUTOFF * each.cutoff)
        elif each.cutoff is not None:
            lowest = max(lowest, each.cutoff / OF_CUTOFF)
    return lowest, highest
