"""What noise of the output biases a live scale factor by: the live filter regresses on the noisy output itself.

`fit` smooths its regressors with both channels; a filter that may not look ahead has the output alone (derivations
3.5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from accelcal._support.result import Storable
from accelcal.data.arrays import Array
from accelcal.io.stream_lines import Rows
from accelcal.live.settings import LiveSettings

NOTICEABLE = 1.0
"""Standard deviations of the filter above which the bias is said."""
MOST_SAVED = 3.0
"""The same above which the parameters are not saved: the value is wrong, not only less sure."""


@dataclass(frozen=True, slots=True)
class RegressorBias(Storable):
    """Expected error of the scale factor by noise of the output, and by straight lines between its samples."""

    derived: ClassVar[tuple[str, ...]] = ("sigma", "sentence")

    value: float
    """Estimate less truth, 1."""
    std: float
    """Standard deviation that the filter has for it, 1."""

    @property
    def sigma(self) -> float:
        """The error in standard deviations of the filter, at least 0."""
        return abs(self.value) / self.std if self.std > 0.0 else 0.0

    @property
    def sentence(self) -> str:
        """What is wrong and what to do, where it is above one standard deviation; else empty."""
        if self.sigma <= NOTICEABLE:
            return ""
        return (
            f"the noise of the output biases scale_factor by about {self.value:.2g}, {self.sigma:.2g} standard "
            "deviations of the live filter; its uncertainty contains that. Record with -o and fit the recording, which "
            "smooths the output: accelcal fit"
        )


class OutputMoments:
    """Running moments of output and readings: a few numbers, however long it runs.

    Products of samples one and two apart hold motion alone, since the noise is white.
    """

    def __init__(self) -> None:
        self.outputs, self.readings = 0, 0
        self._from: Array = np.zeros(2)
        self._to: Array = np.zeros(2)
        """First and last stamp of outputs and of readings, s."""
        self._zero = 0.0
        self._last: Array = np.empty(0)
        """The last two samples less the first of all, m/s²."""
        self._sum = 0.0
        self._products: Array = np.zeros(2)

    def add(self, rows: Rows) -> None:
        """Take rows in."""
        kept = np.isfinite(rows.accel)
        self.outputs = self._counted(0, self.outputs, rows.t[kept])
        self.readings = self._counted(1, self.readings, rows.t[np.isfinite(rows.position)])
        u = rows.accel[kept]
        if not len(u):
            return
        if self.outputs == len(u):
            self._zero = float(u[0])
        before = len(self._last)
        y = np.concatenate([self._last, u - self._zero])
        self._sum += float(np.sum(y[before:]))
        for k in (1, 2):
            begin = max(before, k)
            self._products[k - 1] += float(y[begin:] @ y[begin - k : len(y) - k])
        self._last = y[-2:]

    def _counted(self, channel: int, count: int, t: Array) -> int:
        """Number of samples of a channel so far, with those at `t` (s)."""
        if len(t):
            self._from[channel] = self._from[channel] if count else t[0]
            self._to[channel] = t[-1]
        return count + len(t)

    def bias(self, settings: LiveSettings, variance: float) -> RegressorBias | None:
        """What the scale factor is biased by, where the filter has a `variance` for it; None before there is motion.

        A filter that began with a model shares the bias only as far as the new readings count.
        """
        if self.outputs < 3 or self.readings < 3:
            return None
        step, apart = (self._to - self._from) / (np.array([self.outputs, self.readings]) - 1)
        one, two = self._products / (self.outputs - np.array([1, 2])) - (self._sum / self.outputs) ** 2
        slowed = max((one - two) / 1.5, 0.0)  # <a²> <w²> dt²; products k apart are <a²> (1 - k² <w²> dt²/2)
        motion = max(one + 0.5 * slowed, 0.0)
        crossover = (settings.q / (settings.r_position * apart)) ** 0.25 / (2.0 * math.pi)
        noise = 2.0 * settings.q * min(1.11 * crossover, 1.0 / (3.0 * step))
        row = settings.names.index("k")
        begun = float(settings.covariance[row, row])
        share = max(0.0, 1.0 - variance / begun) if begun > 0.0 else 0.0
        return RegressorBias(share * (noise - slowed / 12.0) / (motion + noise), math.sqrt(max(variance, 0.0)))
