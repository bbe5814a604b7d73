"""Noise density of the sensor, and where it comes from: the output at rest, the declaration, or a fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from accelcal.data import summary
from accelcal.data.arrays import Array
from accelcal.data.recording import Recording
from accelcal.estimation.values import Noise

LEAST_REST, LEAST_STRETCH = 5.0, 2.0
"""Rests that are shorter in all, and stretches that are, do not determine the noise of the sensor, s."""
EDGE = 0.25
"""Left out at both ends of a stretch, s: the stage still settles."""
LOWEST = 2.0
"""Periods in a stretch from which a frequency counts: slower ones are drift."""
HIGHEST, OF_CUTOFF, OF_RATE = 50.0, 0.2, 0.2
"""Highest frequency that counts, Hz, as a share of the cut-off of the low-pass, and of the sampling rate: drift is made
by the slow part of the noise."""
LEAST_ORDINATES = 30
"""Fewer frequencies than this do not determine a density."""
DIFFER = 1.5
"""Density at rest and declared density that differ by more than this factor are both told."""
Source = Literal["rest", "declared", "fit"]
SOURCES: Mapping[Source, str] = {
    "rest": "noise density at rest",
    "declared": "declared noise density",
    "fit": "fitted noise density, an upper limit",
}
"""Where a density comes from, for people."""


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Noise density of the sensor and where it comes from."""

    density: float
    """One-sided, (m/s²)/sqrt(Hz)."""
    std: float
    """Its standard deviation; 0 where it is declared."""
    source: Source
    declared: float | None = None
    """The declared density where that at rest differs from it by more than a factor `DIFFER`, (m/s²)/sqrt(Hz)."""

    @classmethod
    def of(cls, recording: Recording, fitted: Noise) -> SensorNoise:
        """Density of the output at rest, else the declared one, else the fitted one.

        Parameters
        ----------
        recording : what models are compared with.
        fitted : least noise of all models; what they lack adds to it.
        """
        declared = recording.rig.sensor.noise
        found = density_at_rest(recording)
        if found is not None:
            apart = declared is not None and not 1.0 / DIFFER <= found[0] / declared <= DIFFER
            return cls(*found, "rest", declared if apart else None)
        if declared is not None:
            return cls(declared, 0.0, "declared")
        return cls(math.sqrt(2.0 * fitted.usual.q), 0.0, "fit")


def density_at_rest(recording: Recording) -> tuple[float, float] | None:
    """One-sided noise density of the output while the encoder stands still, and its standard deviation.

    In (m/s²)/sqrt(Hz), from the median of the periodogram, which lines of mains or pumps do not move. None where the
    record rests too briefly.
    """
    accel, lowpass = recording.accel, recording.rig.lowpass
    rate = 1.0 / float(np.median(np.diff(accel.t)))
    highest = min(HIGHEST, OF_RATE * rate, math.inf if lowpass is None else OF_CUTOFF * lowpass.cutoff)
    ordinates, rested = [], 0.0
    for begin, end in summary.rest(recording):
        rows = slice(*np.searchsorted(accel.t, [begin + EDGE, end - EDGE]))
        y = accel.y[rows]
        seconds = len(y) / rate
        if seconds >= LEAST_STRETCH and np.all(np.isfinite(y)):
            rested += seconds
            ordinates.append(_ordinates(y, rate, LOWEST / seconds, highest))
    power = np.concatenate([np.empty(0), *ordinates])
    if rested < LEAST_REST or len(power) < LEAST_ORDINATES:
        return None
    middle = float(np.median(power)) / math.log(2.0)  # of an exponential distribution
    relative = 1.0 / (math.log(2.0) * math.sqrt(len(power)))
    return math.sqrt(middle), 0.5 * relative * math.sqrt(middle)


def _ordinates(y: Array, rate: float, lowest: float, highest: float) -> Array:
    """Periodogram of a stretch without its trend, between two frequencies, unit² per Hz."""
    frequency, power = scipy.signal.periodogram(y, rate, detrend="linear")
    return np.asarray(power[(frequency >= lowest) & (frequency <= highest)])
